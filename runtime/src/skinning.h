// Linear blend skinning with the few joints that each vertex follows.
#pragma once

#include "sections.h"

namespace uvc {

// rest: (V, 3) m. joints that each vertex follows, from starts (V + 1) on, and their weights.
struct Skin {
    Array<float> rest;
    Array<int32_t> starts, joints;
    Array<float> weights;

    int vertices() const { return rest.size / 3; }
};

// Reads "<prefix>.rest" (V, 3), "<prefix>.starts" (V + 1), "<prefix>.joints" and the shares "<prefix>.weights",
// for a skeleton of so many joints. The prefix has at most 20 bytes.
Skin read_skin(const Sections &sections, const char *prefix, int joints, Arena &arena, Failure &failure);

// Moves vertices (V) m at `rest` by transforms (J, 3, 4) of the joints, row by row.
void pose(const Skin &skin, const float *rest, const float *transforms, Vec *posed);

}  // namespace uvc
