// Cloth that lies beside cloth: where a garment is folded onto itself, and where others lie next to it.
#pragma once

#include "skin_distance.h"

namespace uvc {

// Points of some garments, of each its number.
struct Cloth {
    Array<Vec> rest;
    Array<int32_t> garments;
};

// A point with other cloth around it. open: 1 where the garment faces none of its own cloth, 0 where it lies
// on it. other: the closest other garment, as if it were skin; the reach and nothing if none is near.
struct NearCloth {
    float open;
    NearSkin other;
};

// Finds what lies beside points of cloth, m, from `first` up to `last`, with unit normals. The points of the
// fold's both sides are further apart at rest than BESIDE_REACH.
constexpr float BESIDE_REACH = 0.025f;
void find_near_cloth(const Cloth &cloth, const Vec *points, const Vec *normals, int first, int last,
                     NearCloth *beside, Arena &work);

}  // namespace uvc
