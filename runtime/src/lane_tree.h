// A surface that moves, and its faces that are closest to points: eight faces, or boxes, at a time.
#pragma once

#include "memory.h"
#include "triangle.h"

namespace uvc {

// Children of a node of a tree, from the first up to, not including, the last.
struct Children {
    int32_t first, last;
};

// Faces in blocks of eight that lie together, the last of them filled up with its last face, under a tree of
// nodes that each have up to eight children. Nothing here changes.
//
// order: the faces of the blocks. nodes: those over blocks come first, over_blocks of them; the children of
// others are nodes before them, and the root is the last.
struct LaneTree {
    Array<Face> faces;
    Array<int32_t> order;
    Array<Children> nodes;
    int blocks, over_blocks;
};

// Faces have corners among the points at rest, m; there may be none.
LaneTree make_lane_tree(const Vec *rest, Array<Face> faces, Arena &arena);

typedef Vector<Lanes> LaneVec;

// Corners a of the faces of a block, and the ways from there to b and to c.
struct Block {
    LaneVec a, ab, ac;
};

// Boxes of a node's children; where there is none, a box that nothing is near.
struct LaneBox {
    LaneVec low, high;
};

// The tree of a surface where it lies now.
struct Lying {
    Array<Block> blocks;
    Array<LaneBox> boxes;
};

Lying make_lying(const LaneTree &tree, Arena &arena);

void fit(const LaneTree &tree, const Vec *points, Lying &lying);

// The face closest to a point within reach, m, of several the first; -1 if there is none. It starts from no
// guess: the last answer costs about as much to look at as it saves.
int closest_face(const LaneTree &tree, const Lying &lying, Vec point, float reach);

}  // namespace uvc
