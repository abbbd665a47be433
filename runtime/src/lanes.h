// Eight numbers, or vectors, side by side: in and out of lanes, and over all of them.
#pragma once

#include "vector.h"

namespace uvc {

typedef Vector<Lanes> LaneVec;

UVC_INLINE Lanes load(const float *numbers) {
    Lanes lanes;
    __builtin_memcpy(&lanes, numbers, sizeof(lanes));
    return lanes;
}

UVC_INLINE void store(float *numbers, Lanes lanes) { __builtin_memcpy(numbers, &lanes, sizeof(lanes)); }

UVC_INLINE LaneVec repeat(Vec a) { return {Lanes{} + a.x, Lanes{} + a.y, Lanes{} + a.z}; }

UVC_INLINE Vec pick(const LaneVec &lanes, int lane) { return {lanes.x[lane], lanes.y[lane], lanes.z[lane]}; }

UVC_INLINE void put(LaneVec &lanes, int lane, Vec a) {
    lanes.x[lane] = a.x;
    lanes.y[lane] = a.y;
    lanes.z[lane] = a.z;
}

// Vectors in lanes by their indices. Numbers are put in memory first: putting them into lanes is slow.
UVC_INLINE LaneVec gather(const Vec *points, const int32_t *indices) {
    float numbers[3][LANES];
    for (int lane = 0; lane < LANES; lane++) {
        Vec point = points[indices[lane]];
        numbers[0][lane] = point.x;
        numbers[1][lane] = point.y;
        numbers[2][lane] = point.z;
    }
    return {load(numbers[0]), load(numbers[1]), load(numbers[2])};
}

// Barycentric coordinates v of b and w of c of the points of triangles that are closest to points, by the
// regions of `closest_barycentrics`, without a number where all edges have no length. ap, ab, ac: from a to
// the point, b and c.
UVC_INLINE void closest_barycentrics(LaneVec ap, LaneVec ab, LaneVec ac, Lanes &v, Lanes &w) {
    LaneVec bp = ap - ab, cp = ap - ac;
    Lanes d1 = dot(ab, ap), d2 = dot(ac, ap), d3 = dot(ab, bp);
    Lanes d4 = dot(ac, bp), d5 = dot(ab, cp), d6 = dot(ac, cp);
    Lanes to_a = d3 * d6 - d5 * d4, to_b = d5 * d2 - d1 * d6, to_c = d1 * d4 - d3 * d2;
    Lanes share = 1.0f / (to_a + to_b + to_c), none{};
    v = to_b * share, w = to_c * share;
    Lanes one = none + 1.0f, d43 = d4 - d3, d56 = d5 - d6, along = d43 / (d43 + d56);
    LaneMask is_on = is_at_most(to_a, none) & is_at_most(none, d43) & is_at_most(none, d56);
    v = choose(is_on, one - along, v), w = choose(is_on, along, w);
    is_on = is_at_most(to_b, none) & is_at_most(none, d2) & is_at_most(d6, none);
    v = choose(is_on, none, v), w = choose(is_on, d2 / (d2 - d6), w);
    is_on = is_at_most(to_c, none) & is_at_most(none, d1) & is_at_most(d3, none);
    v = choose(is_on, d1 / (d1 - d3), v), w = choose(is_on, none, w);
    is_on = is_at_most(none, d6) & is_at_most(d5, d6);
    v = choose(is_on, none, v), w = choose(is_on, one, w);
    is_on = is_at_most(none, d3) & is_at_most(d4, d3);
    v = choose(is_on, one, v), w = choose(is_on, none, w);
    is_on = is_at_most(d1, none) & is_at_most(d2, none);
    v = choose(is_on, none, v), w = choose(is_on, none, w);
}

// Extremes of eight numbers.
UVC_INLINE float lowest(Lanes a) {
    a = least(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3));
    a = least(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5));
    return least(a[0], a[1]);
}
UVC_INLINE float highest(Lanes a) { return -lowest(-a); }
UVC_INLINE Vec lowest(LaneVec a) { return {lowest(a.x), lowest(a.y), lowest(a.z)}; }
UVC_INLINE Vec highest(LaneVec a) { return {highest(a.x), highest(a.y), highest(a.z)}; }

UVC_INLINE float sum(Lanes a) {
    a += __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3);
    a += __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5);
    return a[0] + a[1];
}
UVC_INLINE Vec sum(LaneVec a) { return {sum(a.x), sum(a.y), sum(a.z)}; }

// A bit for each lane in which a condition holds.
UVC_INLINE unsigned bits(LaneMask mask) {
    mask &= LaneMask{1, 2, 4, 8, 16, 32, 64, 128};
    uint64_t pairs[4];
    __builtin_memcpy(pairs, &mask, sizeof(pairs));
    uint64_t all = pairs[0] | pairs[1] | pairs[2] | pairs[3];
    return (unsigned)(all | all >> 32) & 255u;
}

// Takes the lowest of bits.
UVC_INLINE int take(unsigned &bits) {
    int lane = __builtin_ctz(bits);
    bits &= bits - 1;
    return lane;
}

}  // namespace uvc
