// Sections that a baked outfit does not store, because they follow from the others.
#pragma once

#include "sections.h"

namespace uvc {

// Derives from "outfit.size", "body.rest", "points.rest" and "cages.rest": "skin.rest", "fine.rest" and
// "cloth.rest"; from "sheet.faces" "membrane.corners"; from "covered.shares" (P, 2), the first two,
// "covered.weights"; from "caps.rim_starts" and "caps.rims" "caps.tips", behind the body's vertices, and
// "opening.tips", ".rim_starts" and ".rims".
//
// The parts of the collider: "parts.faces", their faces among "skin.faces", from "parts.starts" (K + 1) on;
// "parts.caps", the caps that close them, from "parts.cap_starts" (K + 1) on; "parts.met" (K), 1 for those that
// cloth may touch. From these follow "opening.faces", "outfit.used", and "collider.rest", ".faces", ".starts".
//
// The arena has to outlive the sections.
void derive_sections(Sections &sections, Arena &arena, Failure &failure);

}  // namespace uvc
