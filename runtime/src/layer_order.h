// Order of layers where cloth came out from beneath another garment: a shirt out of its waistband.
#pragma once

#include "outfit.h"

namespace uvc {

// Bits (U), for each point, of the garments beneath which it belongs and over which it lies now; nothing where
// no point does. Only what hangs together with a hem that was tucked in counts, since cages of layers may cross
// by a little anywhere. pairs: vertices of the cages near faces, with their sides. positions: (n) m, of the
// cages.
Array<int32_t> find_points_over(const Outfit &outfit, Array<PointPair> pairs, const Vec *positions,
                                Arena &arena);

}  // namespace uvc
