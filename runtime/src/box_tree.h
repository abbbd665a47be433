// A binary tree of boxes over faces that move, and the faces that rays meet, eight rays at a time.
#pragma once

#include "lanes.h"
#include "memory.h"
#include "triangle.h"

namespace uvc {

UVC_INLINE Four four(Vec a) { return Four{a.x, a.y, a.z, 0}; }
UVC_INLINE bool any(FourMask mask) {
    uint64_t halves[2];
    __builtin_memcpy(halves, &mask, sizeof(halves));
    return (halves[0] | halves[1]) != 0;
}

// Lowest and highest corner.
struct Box {
    Four low, high;
};

// Node of a tree: a leaf with faces order[first] to order[last - 1], or a node with two children, of which
// the left one follows it.
struct Node {
    int32_t first, last, right;
    bool is_leaf() const { return right == 0; }
};

// Trees of one or several parts over the same vertices. Nothing here changes.
//
// roots: first node of each part, and the number of all nodes.
struct BoxTree {
    Array<Face> faces;
    Array<Node> nodes;
    Array<int32_t> order, roots;
};

// Faces of each part follow one another; `starts` are their first faces and, last, the number of all. leaf:
// most faces in a leaf. The faces have to outlive the tree.
BoxTree make_box_tree(const Vec *rest, Array<Face> faces, Array<int32_t> starts, int leaf, Arena &arena);

// Fits the boxes of a part to the vertices as they are now.
void fit_boxes(const BoxTree &tree, int part, const Vec *points, Array<Box> boxes);

// Eight rays: starts, unit directions, and how far they reach, m; below 0 for none.
struct Rays {
    LaneVec start, direction;
    Lanes reach;
};

// First faces that rays meet, -1 for none, the distances, m, and barycentric coordinates there.
struct Hits {
    LaneMask faces;
    Lanes distance;
    LaneVec weights;
};

Hits first_hits(const BoxTree &tree, int part, const Vec *points, Array<Box> boxes, const Rays &rays);

}  // namespace uvc
