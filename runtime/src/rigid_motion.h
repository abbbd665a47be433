// The rigid motion that points come closest to, and how far they are from it.
#pragma once

#include "lanes.h"
#include "memory.h"

namespace uvc {

// A turn, by rows, and then a shift. most: m, no point is farther from where it takes it.
struct RigidMotion {
    Vec rows[3], shift;
    float most;

    UVC_MEMBER Vec take(Vec a) const { return Vec{dot(rows[0], a), dot(rows[1], a), dot(rows[2], a)} + shift; }
    UVC_MEMBER LaneVec take(LaneVec a) const {
        return LaneVec{dot(repeat(rows[0]), a), dot(repeat(rows[1]), a), dot(repeat(rows[2]), a)} +
               repeat(shift);
    }
};

// Fits a motion to the points of some indices, from start to end, m.
RigidMotion fit_motion(Array<int32_t> indices, const Vec *start, const Vec *end);

}  // namespace uvc
