// Covering: cloth that lies beneath skin in sight is moved over it. Clearing moves vertices out of the body.
// Between them the faces of cloth may still cut through an elbow, and a vertex that is deep in a knee leaves
// it on the wrong side. So skin itself looks for the cloth beneath it.
#include "clearing.h"

namespace uvc {

namespace {

// Metres under the skin within which cloth is looked for.
constexpr float UNDER_SKIN = 0.05f;

// Metres in front of the skin within which other cloth, or another limb, hides it.
constexpr float HIDING = 0.1f;

// Metres above the skin from where rays that may meet the body itself start.
constexpr float RAY_START = 1e-5f;

// Metres over the skin to which cloth is moved: a face between two points stays over it.
constexpr float OVER = 0.002f;

// Metres at rest from skin to cloth that may slide over it: a skirt turns around a leg.
constexpr float FARTHEST = 0.45f;

// Eight points of the skin, in the order of `covered`, and how many there are.
struct Points {
    int32_t indices[LANES];
    int count;
    LaneVec places, normals;
};

Points points_from(const Covered &covered, int first, const Vec *skin) {
    Points points{};
    points.count = least(covered.order.size - first, LANES);
    for (int lane = 0; lane < LANES; lane++) {
        int k = covered.order.at(first + least(lane, points.count - 1));
        Face f = covered.corners.at(k);
        Vec a = skin[f.a], b = skin[f.b], c = skin[f.c];
        points.indices[lane] = k;
        put(points.places, lane, weighted(covered.weights.at(k), a, b, c));
        put(points.normals, lane, unit(cross(b - a, c - a)));
    }
    return points;
}

// A reach, m, for the lanes of some bits.
Lanes reach_of(unsigned lanes, float reach) {
    Lanes all = Lanes{} - 1.0f;
    while (lanes) all[take(lanes)] = reach;
    return all;
}

// Takes from lanes those whose rays meet something.
void leave_out(unsigned &lanes, const BoxTree &tree, const Vec *vertices, Array<Box> boxes, LaneVec start,
               LaneVec direction) {
    if (!lanes) return;
    Hits hits = first_hits(tree, 0, vertices, boxes, {start, direction, reach_of(lanes, HIDING)});
    lanes &= ~bits(hits.faces >= 0);
}

// The move, m, of the corners of a face along the normal of the skin over it.
struct Moves {
    Array<Vec> ways;
    Array<float> longest;

    // The least moves of the corners that move the point of their face by its depth.
    void add(Face face, Vec weights, float depth, Vec normal) {
        float share = depth / dot(weights, weights);
        for (int corner = 0; corner < 3; corner++) {
            float way = share * axis(weights, corner);
            ways[face[corner]] += way * normal;
            longest[face[corner]] = most(longest[face[corner]], way);
        }
    }
};

}  // namespace

void cover_skin(const Clearing &clearing, Vec *cloth, const Vec *skin, Arena &work) {
    Scope scope(work);
    const Covered &covered = clearing.covered;
    int vertices = clearing.rest.size;
    Array<Box> boxes = work.room<Box>(clearing.cloth.nodes.size), skin_boxes;
    Moves moves{};
    fit_boxes(clearing.cloth, 0, cloth, boxes);
    for (int first = 0; first < covered.order.size; first += LANES) {
        Points points = points_from(covered, first, skin);
        unsigned lanes = (1u << points.count) - 1;
        Hits beneath = first_hits(clearing.cloth, 0, cloth, boxes,
                                  {points.places, -points.normals, reach_of(lanes, UNDER_SKIN)});
        lanes = bits(beneath.faces >= 0);
        for (unsigned met = lanes; met;) {
            int lane = take(met);
            Face f = clearing.cloth.faces.at(beneath.faces[lane]);
            // A sleeve that an arm takes into a knee does not cover the knee.
            Vec rest = weighted(pick(beneath.weights, lane), clearing.rest[f.a], clearing.rest[f.b],
                                clearing.rest[f.c]);
            if (dot(face_normal(f, cloth), pick(points.normals, lane)) <= 0 ||
                length(rest - covered.rest[points.indices[lane]]) >= FARTHEST)
                lanes &= ~(1u << lane);
        }
        leave_out(lanes, clearing.cloth, cloth, boxes, points.places, points.normals);
        if (!lanes) continue;
        if (!skin_boxes.size) {
            skin_boxes = work.room<Box>(clearing.skin.nodes.size);
            fit_boxes(clearing.skin, 0, skin, skin_boxes);
        }
        LaneVec above = points.places + (Lanes{} + RAY_START) * points.normals;
        leave_out(lanes, clearing.skin, skin, skin_boxes, above, points.normals);
        while (lanes) {
            int lane = take(lanes);
            if (!moves.ways.size) moves = {work.take<Vec>(vertices), work.take<float>(vertices)};
            moves.add(clearing.cloth.faces.at(beneath.faces[lane]), pick(beneath.weights, lane),
                      beneath.distance[lane] + OVER, pick(points.normals, lane));
        }
    }
    if (!moves.ways.size) return;
    for (int k = 0; k < vertices; k++) {
        Vec &way = moves.ways[k];
        float size = length(way);
        way = size > 0 ? (moves.longest[k] / size) * way : Vec{};
        cloth[k] += way;
    }
    follow(clearing.rings, cloth, moves.ways.data);
}

}  // namespace uvc
