#include "edge_crossings.h"

namespace uvc {

namespace {

constexpr int DEPTH = 64;

// Which corners are at neither end of the edge from the origin along a vector.
UVC_INLINE LaneMask apart(const LaneVec &corner, const LaneVec &along) {
    LaneVec way = corner - along;
    return (dot(corner, corner) > 0.0f) & (dot(way, way) > 0.0f);
}

// Whether an edge from a start along a vector runs through a face of a block.
bool meets_block(const LaneTree &tree, const Vec *points, int block, const LaneVec &start,
                 const LaneVec &along) {
    LaneFace faces = faces_of(tree, points, block);
    LaneVec a = faces.a - start, b = faces.b - start, c = faces.c - start;
    LaneVec normal = cross(b - a, c - a);
    // The ends are on either side of the face's plane, and the corners turn one way around the edge.
    Lanes ends = dot(a, normal) * dot(a - along, normal);
    Lanes u = dot(along, cross(a, b)), v = dot(along, cross(b, c)), w = dot(along, cross(c, a));
    LaneMask turns = least(least(u, v), w) * most(most(u, v), w) > 0.0f;
    return bits((ends < 0.0f) & turns & apart(a, along) & apart(b, along) & apart(c, along)) != 0;
}

}  // namespace

bool is_crossing(const LaneTree &tree, const FittedTree &fitted, Vec start, Vec end) {
    if (!tree.faces.size) return false;
    LaneVec first = repeat(start), last = repeat(end), along = last - first;
    LaneVec low{least(first.x, last.x), least(first.y, last.y), least(first.z, last.z)};
    LaneVec high{most(first.x, last.x), most(first.y, last.y), most(first.z, last.z)};
    int stack[DEPTH];
    int top = 1;
    stack[0] = tree.nodes.size - 1;
    while (top > 0) {
        int node = stack[--top];
        const LaneBox &boxes = fitted.boxes.at(node);
        LaneMask is_beside = (boxes.low.x <= high.x) & (boxes.high.x >= low.x) & (boxes.low.y <= high.y) &
                             (boxes.high.y >= low.y) & (boxes.low.z <= high.z) & (boxes.high.z >= low.z);
        for (unsigned lanes = bits(is_beside); lanes;) {
            int child = tree.nodes.at(node).first + take(lanes);
            if (node >= tree.patches)
                stack[top++] = child;
            else if (meets_block(tree, fitted.points, child, first, along))
                return true;
        }
    }
    return false;
}

}  // namespace uvc
