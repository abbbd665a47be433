// Signed distances between parts of a body that face each other.
//
// A side is one part against another: sides 2k and 2k + 1 are a pair, and each is the wall of the other. The
// distance of a point is a moving least squares one over the points of its wall: of their tangent planes,
// weighted by a smooth function of the distance and by how much the two skins face each other. So a small
// change of the pose changes the result a little; with nearest faces it would jump.
#pragma once

#include "sections.h"
#include "surface_graph.h"

namespace uvc {

// Points of all sides, which are vertices of the body that lie close together. LANES points are a tile, LANES
// tiles a group.
//
// starts: (S + 1) first group of each side. points: (P) vertices, side after side. rows: (P) place of each
// point in the groups. vertices: of each place in the groups, -1 where there is none. core: m2, of each
// place, squared distance within which all points of a wall have the same weight. rings: the other two
// corners of the faces around each vertex, from ring_starts on.
struct Sides {
    int sides;
    Array<int32_t> starts, points, rows, vertices, ring_starts, rings;
    Array<float> core;

    int groups() const { return starts[sides]; }
};

// Reads "opening.starts" (S + 1), the first point of each side; "opening.points" (P); and "opening.spacing" (1)
// m, the least distance between points. faces, graph: of the skin of all parts.
Sides read_sides(const Sections &sections, Array<Face> faces, const Graph &graph, Arena &arena,
                 Failure &failure);

// LANES points, x y z each. start, place: m, at the beginning of the frame and now. normal: unit, outward.
struct Tile {
    float start[3][LANES], place[3][LANES], normal[3][LANES], core[LANES];
};

// What bounds the points of LANES tiles at the beginning of the frame. axis: mean of the normals. spread: most
// by which a normal differs from it.
struct Bounds {
    float low[3][LANES], high[3][LANES], axis[3][LANES], spread[LANES];
};

// Tiles that one tile is measured against.
struct OpposingTiles {
    Bounds bounds;
    int32_t tiles[LANES];
};

// Walls in a frame. near: of each group the tiles, as bits, that are within reach of the other side. facing:
// room for what one tile is measured against.
struct Walls {
    Array<Tile> tiles;
    Array<Bounds> bounds;
    Array<int32_t> near;
    Array<OpposingTiles> facing;
};

Walls make_walls(const Sides &sides, Arena &arena);

// Begins a frame with vertices at corners (C) m.
void raise_walls(const Sides &sides, const Vec *corners, Walls &walls);

// Finds what a tile of a side is measured against, and returns that part of `facing`.
Array<OpposingTiles> find_facing(const Sides &sides, Walls &walls, int side, int tile);

// What points of the wall say about a point: the sum of their weights, 1/m4; and by these weights their
// distances to it, m, their normals, and the ways from them to it, m.
struct Measured {
    float weight, above;
    Vec wall, way;

    // Signed distance from the wall, m.
    float distance() const { return above / weight; }
};

// Measures the point in a row against what was found for its tile.
Measured measure(const Walls &walls, int row, Array<OpposingTiles> facing);

// Distance, m, along the wall from a point to the middle of the points that measure it.
float lateral_distance(const Measured &measured);

// Signed distances (P) m of all points of vertices at corners (C) m; FAR for none.
void measure_all(const Sides &sides, const Vec *corners, float *distances);

}  // namespace uvc
