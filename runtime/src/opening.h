// Opened colliders: parts that mocap presses into each other are pushed apart, so that cloth has room.
#pragma once

#include "walls.h"

namespace uvc {

// Pressed parts of a collider of C vertices, before it moves.
//
// want: m, of each place in the groups, distance that the point keeps from the other part. allowed: (S C) m,
// longest push of each vertex. slope: change of a push along the skin, metres for each metre.
//
// spread_vertices: the vertices that move with a point, from spread_starts (C + 1) of its vertex on, the nearest
// first; spread_lengths: m, their distances along the skin. tips: of the caps, and rims: the vertices around
// each, from rim_starts on. vertex_rows: places in the groups of each vertex, from row_starts (C + 1) on.
struct Opening {
    int vertices;
    Sides sides;
    Array<float> want, allowed, spread_lengths;
    Array<int32_t> spread_starts, spread_vertices, tips, rim_starts, rims, row_starts, vertex_rows;
    float slope;
};

// Reads what `read_sides` does, and "opening.want" (P), ".allowed" (S, C), ".slope" (1), ".spread_starts"
// (C + 1), ".spread_vertices" (M), ".spread_lengths" (M), ".tips" (T), ".rim_starts" (T + 1), ".rims" (E).
Opening read_opening(const Sections &sections, int vertices, Arena &arena, Failure &failure);

// A point that is pushed, by `push` m, at most by `limit` m. way: unit, off its wall, or none if nothing
// measures the point.
struct Pushed {
    int32_t row, side;
    float push, limit;
    Vec way;
};

// Pushes of one side that meet at a vertex: the longest, m, their sum, m, and their sum as vectors, m.
struct Meeting {
    float longest, total;
    Vec way;
};

// Memory for frames, one at a time. active: vertices that were moved in this frame, and is_active which.
// shift: (C) m.
struct OpeningWork {
    Walls walls;
    Array<Pushed> pushed;
    Array<Meeting> meetings;
    Array<Vec> shift;
    Array<int32_t> active;
    Array<uint8_t> is_active;
};

OpeningWork make_opening_work(const Opening &opening, Arena &arena);

// Pushes the parts of a collider at corners (C) m apart, in place.
void open_frame(const Opening &opening, OpeningWork &work, Vec *corners);

}  // namespace uvc
