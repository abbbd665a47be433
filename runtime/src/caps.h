// Tips of the caps that close the parts of a collider.
#pragma once

#include "sections.h"

namespace uvc {

// rims: (E, 2) directed edges around each cap, from rim_starts on. tips: vertices of the collider.
struct Caps {
    Array<int32_t> rim_starts, rims, tips;
};

// Reads "caps.tips" (T), "caps.rim_starts" (T + 1) and "caps.rims" (E, 2), of a collider of so many vertices.
Caps read_caps(const Sections &sections, int vertices, Arena &arena, Failure &failure);

// Places the tips above the middles of their rims, among the vertices, m, in place.
void add_tips(const Caps &caps, Vec *vertices);

}  // namespace uvc
