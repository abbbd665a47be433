#include "rigid_motion.h"

namespace uvc {

namespace {

// Of so many points one shows how all move: `most` is of all of them, for whatever turn.
constexpr int STRIDE = 8;

// Times that the turn is improved: a body turns little between two searches.
constexpr int ROUNDS = 3;

// Turns vectors around an axis by its length, radians (Rodrigues).
void turn(Vec around, Vec *vectors) {
    float squared = dot(around, around), size = root(squared);
    if (size < 1e-9f) return;
    float sine = __builtin_sinf(size) / size, rest = (1 - __builtin_cosf(size)) / squared;
    for (int k = 0; k < 3; k++) {
        Vec across = cross(around, vectors[k]);
        vectors[k] += sine * across + rest * cross(around, across);
    }
}

}  // namespace

RigidMotion fit_motion(Array<int32_t> indices, const Vec *start, const Vec *end) {
    RigidMotion motion{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {}, 0};
    if (!indices.size) return motion;
    Vec before{}, after{};
    int count = 0;
    for (int k = 0; k < indices.size; k += STRIDE, count++) {
        before += start[indices.at(k)];
        after += end[indices.at(k)];
    }
    before = (1.0f / (float)count) * before;
    after = (1.0f / (float)count) * after;
    Vec columns[3]{};
    for (int k = 0; k < indices.size; k += STRIDE) {
        Vec p = start[indices.at(k)] - before, q = end[indices.at(k)] - after;
        columns[0] += p.x * q;
        columns[1] += p.y * q;
        columns[2] += p.z * q;
    }
    // Mueller et al. 2016, "A Robust Method to Extract the Rotational Part of Deformations", section 3.
    Vec turned[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int round = 0; round < ROUNDS; round++) {
        Vec around = cross(turned[0], columns[0]) + cross(turned[1], columns[1]) + cross(turned[2], columns[2]);
        float along =
            dot(turned[0], columns[0]) + dot(turned[1], columns[1]) + dot(turned[2], columns[2]);
        turn((1 / (absolute(along) + TINY)) * around, turned);
    }
    motion.rows[0] = {turned[0].x, turned[1].x, turned[2].x};
    motion.rows[1] = {turned[0].y, turned[1].y, turned[2].y};
    motion.rows[2] = {turned[0].z, turned[1].z, turned[2].z};
    motion.shift = after - motion.take(before);
    Lanes squared{};
    for (int first = 0; first < indices.size; first += LANES) {
        int32_t few[LANES];
        for (int lane = 0; lane < LANES; lane++) few[lane] = indices.at(least(first + lane, indices.size - 1));
        LaneVec apart = gather(end, few) - motion.take(gather(start, few));
        squared = most(squared, dot(apart, apart));
    }
    motion.most = root(highest(squared));
    return motion;
}

}  // namespace uvc
