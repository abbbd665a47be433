// Layers: points of outer garments are moved off the garments beneath them, and cloth that came out from
// beneath one is moved off that.
#pragma once

#include "lane_tree.h"
#include "sections.h"
#include "surface.h"

namespace uvc {

// Garments over each other, the innermost first, and the pairs of them that may meet, by outer garment.
//
// starts: (G + 1) first vertex of each garment; face_starts: (G + 1) its first face. touches: (N) a bit for
// each part of the body that may touch a vertex; parts: (M) the bits of a face's corners together, all_parts:
// (G) those of a garment. A sleeve touches sleeves, not the trousers that an arm is pressed into.
struct Layers {
    Array<int32_t> outer, inner, starts, face_starts, touches, parts, all_parts;
    Array<LaneTree> trees;
};

// Reads "garments.starts" (G + 1), "layers.outer" (L), "layers.inner" (L) and "layers.touches" (N), for
// garments of so many vertices at rest and of faces that the arena keeps.
Layers read_layers(const Sections &sections, Array<Vec> rest, Array<Face> faces, Arena &arena,
                   Failure &failure);

// Moves vertices (N) m to `clearance`, m, off each garment beneath them that they cover, one outer garment
// after another, in place. over: (N) bits of the garments beneath which a vertex belongs and over which it
// lies, so that it is moved off them instead; or nothing. turns: times that each garment is moved; after all
// but the last one neighbours follow.
void lift(const Layers &layers, const Rings &rings, Array<int32_t> over, Vec *cloth, float clearance, int turns,
          Arena &work);

}  // namespace uvc
