#include "lane_tree.h"

namespace uvc {

namespace {

constexpr int DEPTH = 64;

// Metres: no box is there.
constexpr float FAR = 1e9f;

// Orders faces so that every run of eight, and of eight such runs, lies together. The runs of the longest kind
// are halved at a middle one, along the widest axis.
void arrange(Array<int32_t> order, Array<Vec> centres) {
    if (order.size <= LANES) return;
    int run = LANES;
    while (run * LANES < order.size) run *= LANES;
    Vec low = centres[order[0]], high = low;
    for (int face : order) {
        Vec c = centres[face];
        low = {least(low.x, c.x), least(low.y, c.y), least(low.z, c.z)};
        high = {most(high.x, c.x), most(high.y, c.y), most(high.z, c.z)};
    }
    Vec size = high - low;
    int along = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    sort(order, [&](int a, int b) { return axis(centres[a], along) < axis(centres[b], along); });
    int runs = (order.size + run - 1) / run, middle = (runs + 1) / 2 * run;
    arrange(order.part(0, middle), centres);
    arrange(order.part(middle, order.size), centres);
}

UVC_INLINE LaneVec spread(Vec a) { return {Lanes{} + a.x, Lanes{} + a.y, Lanes{} + a.z}; }
UVC_INLINE void put(LaneVec &lanes, int lane, Vec a) {
    lanes.x[lane] = a.x;
    lanes.y[lane] = a.y;
    lanes.z[lane] = a.z;
}

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
    LaneVec ap = point - block.a, bp = ap - block.ab, cp = ap - block.ac;
    Lanes d1 = dot(block.ab, ap), d2 = dot(block.ac, ap), d3 = dot(block.ab, bp);
    Lanes d4 = dot(block.ac, bp), d5 = dot(block.ab, cp), d6 = dot(block.ac, cp);
    Lanes to_a = d3 * d6 - d5 * d4, to_b = d5 * d2 - d1 * d6, to_c = d1 * d4 - d3 * d2;
    Lanes share = 1.0f / (to_a + to_b + to_c), v = to_b * share, w = to_c * share, none{};
    Lanes one = none + 1.0f, d43 = d4 - d3, d56 = d5 - d6, along = d43 / (d43 + d56);
    LaneMask is_on = (to_a <= 0.0f) & (d43 >= 0.0f) & (d56 >= 0.0f);
    v = choose(is_on, one - along, v), w = choose(is_on, along, w);
    is_on = (to_b <= 0.0f) & (d2 >= 0.0f) & (d6 <= 0.0f);
    v = choose(is_on, none, v), w = choose(is_on, d2 / (d2 - d6), w);
    is_on = (to_c <= 0.0f) & (d1 >= 0.0f) & (d3 <= 0.0f);
    v = choose(is_on, d1 / (d1 - d3), v), w = choose(is_on, none, w);
    is_on = (d6 >= 0.0f) & (d5 <= d6);
    v = choose(is_on, none, v), w = choose(is_on, one, w);
    is_on = (d3 >= 0.0f) & (d4 <= d3);
    v = choose(is_on, one, v), w = choose(is_on, none, w);
    is_on = (d1 <= 0.0f) & (d2 <= 0.0f);
    v = choose(is_on, none, v), w = choose(is_on, none, w);
    LaneVec away = ap - v * block.ab - w * block.ac;
    Lanes squares = dot(away, away);
    return choose(squares >= 0.0f, squares, none + FAR);
}

// Extremes of eight numbers.
UVC_INLINE float lowest(Lanes a) {
    a = least(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3));
    a = least(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5));
    return least(a[0], a[1]);
}
UVC_INLINE float highest(Lanes a) { return -lowest(-a); }
UVC_INLINE Vec lowest(LaneVec a) { return {lowest(a.x), lowest(a.y), lowest(a.z)}; }
UVC_INLINE Vec highest(LaneVec a) { return {highest(a.x), highest(a.y), highest(a.z)}; }

// A bit for each lane.
UVC_INLINE unsigned bits(LaneMask mask) {
    mask &= LaneMask{1, 2, 4, 8, 16, 32, 64, 128};
    uint64_t pairs[4];
    __builtin_memcpy(pairs, &mask, sizeof(pairs));
    uint64_t all = pairs[0] | pairs[1] | pairs[2] | pairs[3];
    return (unsigned)(all | all >> 32) & 255u;
}

// Takes the lowest of bits.
UVC_INLINE int take(unsigned &bits) {
    int lane = __builtin_ctz(bits);
    bits &= bits - 1;
    return lane;
}

// The best face so far, and the square of its distance; `limit` is that of a box in which none is better,
// with more than rounding to spare, so that the order in which boxes are visited changes nothing.
struct Best {
    int face;
    float squared, limit;

    Best(float reach) : face(-1), squared(reach * reach) { limit = spared(); }

    float spared() const { return 1.001f * squared + 1e-9f; }

    void look(const LaneTree &tree, const Lying &lying, int block, LaneVec point) {
        Lanes squares = outside(lying.blocks.at(block), point);
        float low = lowest(squares);
        if (!(low <= squared)) return;
        if (low < squared) face = tree.faces.size;
        for (unsigned lanes = bits(squares == low); lanes;)
            face = least(face, tree.order.at(LANES * block + take(lanes)));
        squared = low;
        limit = spared();
    }
};

// Sets a child's box among those of its node.
void put(LaneBox &boxes, int lane, Vec low, Vec high) {
    put(boxes.low, lane, low);
    put(boxes.high, lane, high);
}

}  // namespace

LaneTree make_lane_tree(const Vec *rest, Array<Face> faces, Arena &arena) {
    LaneTree tree{};
    if (!faces.size) return tree;
    tree.faces = faces;
    tree.blocks = (faces.size + LANES - 1) / LANES;
    Arena work;
    Array<Vec> centres = work.take<Vec>(faces.size);
    tree.order = arena.take<int32_t>(LANES * tree.blocks);
    for (int k = 0; k < faces.size; k++) {
        centres[k] = rest[faces[k].a] + rest[faces[k].b] + rest[faces[k].c];
        tree.order[k] = k;
    }
    arrange(tree.order.part(0, faces.size), centres);
    for (int k = faces.size; k < tree.order.size; k++) tree.order[k] = tree.order[faces.size - 1];
    // A seventh of the blocks, and up to one more on each level.
    Array<Children> nodes = work.take<Children>(tree.blocks / (LANES - 1) + DEPTH);
    int count = 0, first = 0, last = tree.blocks;
    do {
        int before = count;
        for (int child = first; child < last; child += LANES)
            nodes[count++] = {child, least(child + LANES, last)};
        if (!tree.over_blocks) tree.over_blocks = count;
        first = before;
        last = count;
    } while (last - first > 1);
    tree.nodes = arena.copy(nodes.data, count);
    return tree;
}

Lying make_lying(const LaneTree &tree, Arena &arena) {
    Lying lying{arena.take<Block>(tree.blocks), arena.take<LaneBox>(tree.nodes.size)};
    LaneBox none{spread({FAR, FAR, FAR}), spread({-FAR, -FAR, -FAR})};
    for (LaneBox &boxes : lying.boxes) boxes = none;
    return lying;
}

void fit(const LaneTree &tree, const Vec *points, Lying &lying) {
    for (int k = 0; k < tree.blocks; k++) {
        // Lanes are written as numbers in memory: putting them in one by one is slow.
        float numbers[9][LANES];
        for (int lane = 0; lane < LANES; lane++) {
            Face f = tree.faces.at(tree.order.at(LANES * k + lane));
            Vec a = points[f.a], b = points[f.b], c = points[f.c];
            const float row[] = {a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z};
            for (int number = 0; number < 9; number++) numbers[number][lane] = row[number];
        }
        LaneVec corners[3];
        memcpy(corners, numbers, sizeof(numbers));
        LaneVec a = corners[0], b = corners[1], c = corners[2];
        lying.blocks.at(k) = {a, b - a, c - a};
        put(lying.boxes.at(k / LANES), k % LANES,
            {lowest(least(least(a.x, b.x), c.x)), lowest(least(least(a.y, b.y), c.y)),
             lowest(least(least(a.z, b.z), c.z))},
            {highest(most(most(a.x, b.x), c.x)), highest(most(most(a.y, b.y), c.y)),
             highest(most(most(a.z, b.z), c.z))});
    }
    for (int node = tree.over_blocks; node < tree.nodes.size; node++) {
        Children children = tree.nodes.at(node);
        for (int child = children.first; child < children.last; child++) {
            LaneBox boxes = lying.boxes.at(child);
            put(lying.boxes.at(node), child - children.first, lowest(boxes.low), highest(boxes.high));
        }
    }
}

int closest_face(const LaneTree &tree, const Lying &lying, Vec point, float reach) {
    Best best(reach);
    if (!tree.faces.size) return -1;
    LaneVec from = spread(point);
    int stack[DEPTH];
    float distances[DEPTH];
    int top = 1;
    stack[0] = tree.nodes.size - 1;
    distances[0] = 0;
    while (top > 0) {
        if (distances[--top] > best.limit) continue;
        int node = stack[top], first = tree.nodes.at(node).first;
        Lanes squares = outside(lying.boxes.at(node), from);
        unsigned lanes = bits(squares <= best.limit);
        if (!lanes) continue;
        // The nearest child is the next one: what is found in it rules most of the others out.
        unsigned nearest = bits(squares == lowest(squares));
        lanes &= ~nearest;
        if (node < tree.over_blocks) {
            while (nearest) best.look(tree, lying, first + take(nearest), from);
            for (lanes &= bits(squares <= best.limit); lanes;) {
                int lane = take(lanes);
                if (squares[lane] <= best.limit) best.look(tree, lying, first + lane, from);
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
    return best.face;
}

}  // namespace uvc
