// A surface that moves, and its faces that are closest to points: eight faces, or boxes, at a time.
#pragma once

#include "lanes.h"
#include "memory.h"
#include "triangle.h"

namespace uvc {

// Lowest and highest corner, m, of the box around points of some indices; around none, a box in which nothing
// is.
void bound(Array<int32_t> indices, const Vec *points, Vec &low, Vec &high);

// Sorts indices of points along the axis in which these extend most.
void sort_along_widest(Array<int32_t> order, Array<Vec> points);

// Orders indices of points so that every run of eight, of eight such runs and so on lies together.
void sort_in_runs(Array<int32_t> order, Array<Vec> points);

// Children of a node of a tree, from the first up to, not including, the last.
struct Children {
    int32_t first, last;
};

// Faces in blocks of eight that lie together, the last of them filled up with its last face, under a tree of
// nodes that each have up to eight children. Nothing here changes.
//
// order: the faces of the blocks. nodes: those over blocks, which are patches, come first; the children of
// others are nodes before them, and the root is the last. vertices: of each patch, once each, from
// vertex_starts on.
struct LaneTree {
    Array<Face> faces;
    Array<int32_t> order, vertices, vertex_starts;
    Array<Children> nodes;
    int blocks, patches;
};

// Faces have corners among the points at rest, m; there may be none.
LaneTree make_lane_tree(const Vec *rest, Array<Face> faces, Arena &arena);

// Corners of eight faces, m.
struct LaneFace {
    LaneVec a, b, c;
};

// The faces of a block with their corners at points, m.
UVC_INLINE LaneFace faces_of(const LaneTree &tree, const Vec *points, int block) {
    int32_t indices[3][LANES];
    for (int lane = 0; lane < LANES; lane++) {
        Face f = tree.faces.at(tree.order.at(LANES * block + lane));
        indices[0][lane] = f.a;
        indices[1][lane] = f.b;
        indices[2][lane] = f.c;
    }
    return {gather(points, indices[0]), gather(points, indices[1]), gather(points, indices[2])};
}

// Corners a of the faces of a block, and the ways from there to b and to c.
struct Block {
    LaneVec a, ab, ac;
};

// Boxes of a node's children; where there is none, a box that nothing is near.
struct LaneBox {
    LaneVec low, high;
};

// The tree of a surface at points, m. The blocks of a patch are fitted to them when a search first comes there.
struct FittedTree {
    const Vec *points;
    Array<Block> blocks;
    Array<LaneBox> boxes;
    Array<uint8_t> is_fitted;
};

// Memory for the tree of a surface, which is nowhere yet.
FittedTree make_fitted_tree(const LaneTree &tree, Arena &arena);

// Fits a tree to points, which have to stay where they are while it is searched.
void fit(const LaneTree &tree, const Vec *points, FittedTree &fitted);

// Fits all patches, so that any number of threads may search the tree.
void fit_patches(const LaneTree &tree, FittedTree &fitted);

// The face closest to a point within reach, m, of several the first; -1 if there is none, and then `beyond`
// is the square of a distance within which there is none.
int closest_face(const LaneTree &tree, FittedTree &fitted, Vec point, float reach, float &beyond);

}  // namespace uvc
