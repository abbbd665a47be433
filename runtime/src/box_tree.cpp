#include "box_tree.h"

#include "lane_tree.h"

namespace uvc {

namespace {

constexpr int DEPTH = 64;

// Least size of a number that is divided by.
constexpr float SMALLEST = 1e-12f;

// Barycentric coordinate of a point beside a face that still belongs to it: no ray slips between two faces.
constexpr float BESIDE = -1e-6f;

// Builds the tree of some faces, halved at the middle along the widest axis; returns its first node.
int build(BoxTree &tree, Array<Vec> centres, int leaf, int first, int last, int &count) {
    int node = count++;
    tree.nodes[node] = {first, last, 0};
    if (last - first <= leaf) return node;
    sort_along_widest(tree.order.part(first, last), centres);
    int middle = (first + last) / 2;
    build(tree, centres, leaf, first, middle, count);
    int right = build(tree, centres, leaf, middle, last, count);
    tree.nodes[node].right = right;
    return node;
}

// Rays, and one over each number of their directions.
struct Slabs {
    LaneVec start, inverse;

    explicit Slabs(const Rays &rays) : start(rays.start) {
        auto inverse_of = [](Lanes a) {
            Lanes none{};
            return 1.0f / choose(absolute(a) > SMALLEST, a, choose(a < 0.0f, none - SMALLEST, none + SMALLEST));
        };
        inverse = {inverse_of(rays.direction.x), inverse_of(rays.direction.y), inverse_of(rays.direction.z)};
    }

    // Whether rays meet a box within reach.
    LaneMask meet(const Box &box, Lanes reach) const {
        Lanes x0 = (box.low[0] - start.x) * inverse.x, x1 = (box.high[0] - start.x) * inverse.x;
        Lanes y0 = (box.low[1] - start.y) * inverse.y, y1 = (box.high[1] - start.y) * inverse.y;
        Lanes z0 = (box.low[2] - start.z) * inverse.z, z1 = (box.high[2] - start.z) * inverse.z;
        Lanes near = most(most(least(x0, x1), least(y0, y1)), most(least(z0, z1), 0.0f));
        Lanes far = least(least(most(x0, x1), most(y0, y1)), least(most(z0, z1), reach));
        return near <= far * 1.00001f;
    }
};

// Keeps what rays meet in a face, where it comes before what they have met (Moeller and Trumbore 1997).
UVC_INLINE void meet(const Rays &rays, int face, Vec a, Vec b, Vec c, Hits &hits) {
    LaneVec ab = repeat(b - a), ac = repeat(c - a), p = cross(rays.direction, ac);
    Lanes volume = dot(ab, p);
    LaneVec from = rays.start - repeat(a), q = cross(from, ab);
    Lanes share = 1.0f / volume, u = dot(from, p) * share, v = dot(rays.direction, q) * share;
    Lanes distance = dot(ac, q) * share;
    LaneMask is_met = (absolute(volume) >= TINY) & (u >= BESIDE) & (v >= BESIDE) & (u + v <= 1.0f - BESIDE) &
                      (distance >= 0.0f) & (distance < hits.distance);
    hits.faces = is_met ? LaneMask{} + face : hits.faces;
    hits.distance = choose(is_met, distance, hits.distance);
    hits.weights.x = choose(is_met, 1.0f - u - v, hits.weights.x);
    hits.weights.y = choose(is_met, u, hits.weights.y);
    hits.weights.z = choose(is_met, v, hits.weights.z);
}

}  // namespace

BoxTree make_box_tree(const Vec *rest, Array<Face> faces, Array<int32_t> starts, int leaf, Arena &arena) {
    BoxTree tree{};
    tree.faces = faces;
    int parts = starts.size - 1, count = 0;
    tree.order = arena.take<int32_t>(faces.size);
    tree.nodes = arena.take<Node>(2 * faces.size + parts);
    tree.roots = arena.take<int32_t>(parts + 1);
    Arena work;
    Array<Vec> centres = work.take<Vec>(faces.size);
    for (int k = 0; k < faces.size; k++) {
        tree.order[k] = k;
        centres[k] = rest[faces[k].a] + rest[faces[k].b] + rest[faces[k].c];
    }
    for (int part = 0; part < parts; part++) {
        tree.roots[part] = count;
        build(tree, centres, leaf, starts[part], starts[part + 1], count);
    }
    tree.roots[parts] = count;
    return tree;
}

void fit_boxes(const BoxTree &tree, int part, const Vec *points, Array<Box> boxes) {
    for (int k = tree.roots.at(part + 1) - 1; k >= tree.roots.at(part); k--) {
        Node node = tree.nodes.at(k);
        if (!node.is_leaf()) {
            Box left = boxes.at(k + 1), right = boxes.at(node.right);
            boxes.at(k) = {least(left.low, right.low), most(left.high, right.high)};
            continue;
        }
        if (node.first == node.last) continue;
        Four low = four(points[tree.faces.at(tree.order.at(node.first)).a]), high = low;
        for (int j = node.first; j < node.last; j++) {
            Face face = tree.faces.at(tree.order.at(j));
            for (int corner = 0; corner < 3; corner++) {
                Four point = four(points[face[corner]]);
                low = least(low, point);
                high = most(high, point);
            }
        }
        boxes.at(k) = {low, high};
    }
}

Hits first_hits(const BoxTree &tree, int part, const Vec *points, Array<Box> boxes, const Rays &rays) {
    Hits hits{LaneMask{} - 1, rays.reach, {}};
    int root = tree.roots.at(part);
    if (root == tree.roots.at(part + 1) || tree.nodes.at(root).first == tree.nodes.at(root).last) return hits;
    Slabs slabs(rays);
    int stack[DEPTH];
    int top = 1;
    stack[0] = root;
    while (top > 0) {
        int k = stack[--top];
        if (!bits(slabs.meet(boxes.at(k), hits.distance))) continue;
        Node node = tree.nodes.at(k);
        if (!node.is_leaf()) {
            stack[top++] = node.right;
            stack[top++] = k + 1;
            continue;
        }
        for (int j = node.first; j < node.last; j++) {
            int face = tree.order.at(j);
            Face f = tree.faces.at(face);
            meet(rays, face, points[f.a], points[f.b], points[f.c], hits);
        }
    }
    return hits;
}

}  // namespace uvc
