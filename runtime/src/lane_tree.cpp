#include "lane_tree.h"

namespace uvc {

namespace {

constexpr int DEPTH = 64;

// Metres, and square metres: nothing is there.
constexpr float FAR = 1e9f;

// Squares of the distances of a point from eight boxes.
UVC_INLINE Lanes outside(const LaneBox &box, LaneVec point) {
    Lanes x = most(most(box.low.x - point.x, point.x - box.high.x), 0.0f);
    Lanes y = most(most(box.low.y - point.y, point.y - box.high.y), 0.0f);
    Lanes z = most(most(box.low.z - point.z, point.z - box.high.z), 0.0f);
    return x * x + y * y + z * z;
}

// Squares of the distances of a point from eight faces, by the regions of `closest_barycentrics`; far from
// those without an edge of some length.
UVC_INLINE Lanes outside(const Block &block, LaneVec point) {
    LaneVec ap = point - block.a;
    Lanes v, w;
    closest_barycentrics(ap, block.ab, block.ac, v, w);
    LaneVec away = ap - v * block.ab - w * block.ac;
    Lanes squares = dot(away, away);
    return choose(is_at_most(Lanes{}, squares), squares, Lanes{} + FAR);
}

// The best face so far, and the square of its distance; `limit` is that of a box in which none is better,
// with more than rounding to spare, so that the order in which boxes are visited changes nothing. beyond: the
// least square of a distance from what was looked at, or left out, in each lane.
struct NearestFace {
    int face;
    float squared, limit;
    Lanes beyond;

    explicit NearestFace(float reach) : face(-1), squared(reach * reach), beyond(Lanes{} + FAR) {
        limit = spared();
    }

    float spared() const { return 1.001f * squared + 1e-9f; }

    void look(const LaneTree &tree, const FittedTree &fitted, int block, LaneVec point) {
        Lanes squares = outside(fitted.blocks.at(block), point);
        beyond = least(beyond, squares);
        float low = lowest(squares);
        if (!(low <= squared)) return;
        if (low < squared) face = tree.faces.size;
        for (unsigned lanes = bits(is_same(squares, Lanes{} + low)); lanes;)
            face = least(face, tree.order.at(LANES * block + take(lanes)));
        squared = low;
        limit = spared();
    }
};

// Sets a child's box among those of its node.
UVC_INLINE void put(LaneBox &boxes, int lane, Vec low, Vec high) {
    put(boxes.low, lane, low);
    put(boxes.high, lane, high);
}

// Fits the blocks of a patch, and its boxes.
void fit_patch(const LaneTree &tree, int patch, FittedTree &fitted) {
    fitted.is_fitted.at(patch) = 1;
    Children children = tree.nodes.at(patch);
    float sides[6][LANES];
    for (int lane = 0; lane < LANES; lane++)
        for (int side = 0; side < 6; side++) sides[side][lane] = side < 3 ? FAR : -FAR;
    for (int k = children.first; k < children.last; k++) {
        auto [a, b, c] = faces_of(tree, fitted.points, k);
        fitted.blocks.at(k) = {a, b - a, c - a};
        int lane = k - children.first;
        sides[0][lane] = lowest(least(least(a.x, b.x), c.x));
        sides[1][lane] = lowest(least(least(a.y, b.y), c.y));
        sides[2][lane] = lowest(least(least(a.z, b.z), c.z));
        sides[3][lane] = highest(most(most(a.x, b.x), c.x));
        sides[4][lane] = highest(most(most(a.y, b.y), c.y));
        sides[5][lane] = highest(most(most(a.z, b.z), c.z));
    }
    fitted.boxes.at(patch) = {{load(sides[0]), load(sides[1]), load(sides[2])},
                              {load(sides[3]), load(sides[4]), load(sides[5])}};
}

// Finds the vertices of each patch.
void find_vertices(LaneTree &tree, int vertices, Arena &arena) {
    Arena work;
    Array<int32_t> seen = work.take<int32_t>(vertices);
    Array<int32_t> found = work.room<int32_t>(3 * LANES * tree.blocks);
    tree.vertex_starts = arena.take<int32_t>(tree.patches + 1);
    int count = 0;
    for (int patch = 0; patch < tree.patches; patch++) {
        Children children = tree.nodes[patch];
        for (int k = LANES * children.first; k < LANES * children.last; k++)
            for (int corner = 0; corner < 3; corner++) {
                int vertex = tree.faces[tree.order[k]][corner];
                if (seen[vertex] == patch + 1) continue;
                seen[vertex] = patch + 1;
                found[count++] = vertex;
            }
        tree.vertex_starts[patch + 1] = count;
    }
    tree.vertices = arena.copy(found.data, count);
}

}  // namespace

void bound(Array<int32_t> indices, const Vec *points, Vec &low, Vec &high) {
    low = {FAR, FAR, FAR};
    high = -low;
    for (int index : indices) {
        Vec p = points[index];
        low = {least(low.x, p.x), least(low.y, p.y), least(low.z, p.z)};
        high = {most(high.x, p.x), most(high.y, p.y), most(high.z, p.z)};
    }
}

void sort_along_widest(Array<int32_t> order, Array<Vec> points) {
    Vec low, high;
    bound(order, points.data, low, high);
    Vec size = high - low;
    int along = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    sort(order, [&](int a, int b) { return axis(points[a], along) < axis(points[b], along); });
}

void sort_in_runs(Array<int32_t> order, Array<Vec> points) {
    if (order.size <= LANES) return;
    int run = LANES;
    while (run * LANES < order.size) run *= LANES;
    sort_along_widest(order, points);
    // The runs of the longest kind are halved at a middle one.
    int runs = (order.size + run - 1) / run, middle = (runs + 1) / 2 * run;
    sort_in_runs(order.part(0, middle), points);
    sort_in_runs(order.part(middle, order.size), points);
}

LaneTree make_lane_tree(const Vec *rest, Array<Face> faces, Arena &arena) {
    LaneTree tree{};
    if (!faces.size) return tree;
    tree.faces = faces;
    tree.blocks = (faces.size + LANES - 1) / LANES;
    Arena work;
    Array<Vec> centres = work.take<Vec>(faces.size);
    tree.order = arena.take<int32_t>(LANES * tree.blocks);
    int vertices = 0;
    for (int k = 0; k < faces.size; k++) {
        centres[k] = rest[faces[k].a] + rest[faces[k].b] + rest[faces[k].c];
        tree.order[k] = k;
        for (int corner = 0; corner < 3; corner++) vertices = most(vertices, faces[k][corner] + 1);
    }
    sort_in_runs(tree.order.part(0, faces.size), centres);
    for (int k = faces.size; k < tree.order.size; k++) tree.order[k] = tree.order[faces.size - 1];
    // A seventh of the blocks, and up to one more on each level.
    Array<Children> nodes = work.take<Children>(tree.blocks / (LANES - 1) + DEPTH);
    int count = 0, first = 0, last = tree.blocks;
    do {
        int before = count;
        for (int child = first; child < last; child += LANES)
            nodes[count++] = {child, least(child + LANES, last)};
        if (!tree.patches) tree.patches = count;
        first = before;
        last = count;
    } while (last - first > 1);
    tree.nodes = arena.copy(nodes.data, count);
    find_vertices(tree, vertices, arena);
    return tree;
}

FittedTree make_fitted_tree(const LaneTree &tree, Arena &arena) {
    FittedTree fitted{nullptr, arena.room<Block>(tree.blocks), arena.room<LaneBox>(tree.nodes.size),
                      arena.room<uint8_t>(tree.patches)};
    LaneBox none{repeat({FAR, FAR, FAR}), repeat({-FAR, -FAR, -FAR})};
    for (LaneBox &boxes : fitted.boxes) boxes = none;
    return fitted;
}

void fit(const LaneTree &tree, const Vec *points, FittedTree &fitted) {
    fitted.points = points;
    for (uint8_t &is_fitted : fitted.is_fitted) is_fitted = 0;
    for (int node = tree.patches; node < tree.nodes.size; node++) {
        Children children = tree.nodes.at(node);
        for (int child = children.first; child < children.last; child++) {
            int lane = child - children.first;
            if (child >= tree.patches) {
                LaneBox boxes = fitted.boxes.at(child);
                put(fitted.boxes.at(node), lane, lowest(boxes.low), highest(boxes.high));
                continue;
            }
            Vec low, high;
            int first = tree.vertex_starts.at(child), last = tree.vertex_starts.at(child + 1);
            bound(tree.vertices.part(first, last), points, low, high);
            put(fitted.boxes.at(node), lane, low, high);
        }
    }
}

void fit_patches(const LaneTree &tree, FittedTree &fitted) {
    for (int patch = 0; patch < tree.patches; patch++)
        if (!fitted.is_fitted.at(patch)) fit_patch(tree, patch, fitted);
}

int closest_face(const LaneTree &tree, FittedTree &fitted, Vec point, float reach, float &beyond) {
    NearestFace best(reach);
    beyond = FAR;
    if (!tree.faces.size) return -1;
    LaneVec from = repeat(point);
    int stack[DEPTH];
    float distances[DEPTH];
    int top = 1;
    stack[0] = tree.nodes.size - 1;
    distances[0] = 0;
    while (top > 0) {
        if (distances[--top] > best.limit) continue;
        int node = stack[top], first = tree.nodes.at(node).first;
        if (node < tree.patches && !fitted.is_fitted.at(node)) fit_patch(tree, node, fitted);
        Lanes squares = outside(fitted.boxes.at(node), from);
        LaneMask is_near = is_at_most(squares, Lanes{} + best.limit);
        best.beyond = least(best.beyond, choose(is_near, Lanes{} + FAR, squares));
        unsigned lanes = bits(is_near);
        if (!lanes) continue;
        // The nearest child is the next one: what is found in it rules most of the others out. Beside one whose
        // distance is no number, the least number may be that of no child.
        unsigned nearest = bits(is_same(squares, Lanes{} + lowest(squares))) & lanes;
        lanes &= ~nearest;
        if (node < tree.patches) {
            while (nearest) best.look(tree, fitted, first + take(nearest), from);
            for (lanes &= bits(is_at_most(squares, Lanes{} + best.limit)); lanes;) {
                int lane = take(lanes);
                if (squares[lane] <= best.limit) best.look(tree, fitted, first + lane, from);
            }
        } else {
            unsigned both[] = {lanes, nearest};
            for (unsigned every : both)
                while (every) {
                    int lane = take(every);
                    stack[top] = first + lane;
                    distances[top++] = squares[lane];
                }
        }
    }
    beyond = lowest(best.beyond);
    return best.face;
}

}  // namespace uvc
