// Opened colliders: parts that mocap presses into each other are pushed apart, so that cloth has room.
#pragma once

#include "surface_graph.h"
#include "walls.h"

namespace uvc {

// Pressed parts of a collider of C vertices, before it moves.
//
// want: m, of each place in the groups, distance that the point keeps from the other part. allowed: (S C) m,
// longest push of each vertex. slope: change of a push along the skin, metres for each metre.
//
// spread: the vertices that move with a point, by its vertex. tips: of the caps, and rims: the vertices around
// each, from rim_starts on. vertex_rows: places in the groups of each vertex, from row_starts (C + 1) on.
struct Opening {
    int vertices;
    Sides sides;
    Array<float> want, allowed;
    NeighbourDistances spread;
    Array<int32_t> tips, rim_starts, rims, row_starts, vertex_rows;
    float slope;
};

// Reads what `read_sides` does, and "skin.rest" (V, 3) m, whose vertices are the first of the collider's;
// "opening.faces" (F, 3) of the skin of all parts, "opening.clear" (C) m, -1 for vertices that are no points;
// "opening.reach" (1) m, as far as a push of a point reaches along the skin; "opening.want" (P), ".allowed"
// (S, C), ".slope" (1), ".tips" (T), ".rim_starts" (T + 1), ".rims" (E).
void read_opening(const Sections &sections, int vertices, Opening &opening, Arena &arena, Failure &failure);

// A point that is pushed, by `push` m, at most by `limit` m. way: unit, off its wall, or none if nothing
// measures the point.
struct Push {
    int32_t row, side;
    float push, limit;
    Vec way;
};

// Pushes of one side that meet at a vertex: the longest, m, their sum, m, and their sum as vectors, m.
struct VertexPush {
    float longest, total;
    Vec way;
};

// Memory for frames, one at a time. active: vertices that were moved in this frame, and is_active which.
// shift: (C) m.
struct OpeningWork {
    Walls walls;
    Array<Push> pushed;
    Array<VertexPush> meetings;
    Array<Vec> shift;
    Array<int32_t> active;
    Array<uint8_t> is_active;
};

OpeningWork make_opening_work(const Opening &opening, Arena &arena);

// Pushes the parts of a collider at corners (C) m apart, in place.
void open_frame(const Opening &opening, OpeningWork &work, Vec *corners);

}  // namespace uvc
