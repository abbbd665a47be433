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

}  // namespace

void cover_skin(const Clearing &clearing, Vec *cloth, const Vec *skin) {
    Arena work;
    int vertices = clearing.rest.size;
    Array<Box> boxes = work.take<Box>(clearing.cloth.nodes.size), skin_boxes;
    Array<Vec> ways;
    Array<float> longest;
    fit_boxes(clearing.cloth, 0, cloth, boxes);
    for (int k = 0; k < clearing.covered.corners.size; k++) {
        Face f = clearing.covered.corners[k];
        Vec a = skin[f.a], b = skin[f.b], c = skin[f.c];
        Vec point = weighted(clearing.covered.weights[k], a, b, c), normal = unit(cross(b - a, c - a));
        Hit beneath = first_hit(clearing.cloth, 0, cloth, boxes, point, -normal, UNDER_SKIN);
        if (beneath.face < 0 || dot(face_normal(clearing.cloth, cloth, beneath.face), normal) <= 0) continue;
        if (first_hit(clearing.cloth, 0, cloth, boxes, point, normal, HIDING).face >= 0) continue;
        if (!skin_boxes.size) {
            skin_boxes = work.take<Box>(clearing.skin.nodes.size);
            fit_boxes(clearing.skin, 0, skin, skin_boxes);
        }
        Vec above = point + RAY_START * normal;
        if (first_hit(clearing.skin, 0, skin, skin_boxes, above, normal, HIDING).face >= 0) continue;
        // A sleeve that an arm takes into a knee does not cover the knee.
        Face g = clearing.cloth.faces[beneath.face];
        Vec rest = weighted(beneath.weights, clearing.rest[g.a], clearing.rest[g.b], clearing.rest[g.c]);
        if (length(rest - clearing.covered.rest[k]) >= FARTHEST) continue;
        if (!ways.size) {
            ways = work.take<Vec>(vertices);
            longest = work.take<float>(vertices);
        }
        // The least moves of the corners that move the point of their face by its depth.
        Vec w = beneath.weights;
        float share = (beneath.distance + OVER) / dot(w, w);
        for (int corner = 0; corner < 3; corner++) {
            float way = share * axis(w, corner);
            ways[g[corner]] += way * normal;
            longest[g[corner]] = most(longest[g[corner]], way);
        }
    }
    if (!ways.size) return;
    for (int k = 0; k < vertices; k++) {
        float size = length(ways[k]);
        ways[k] = size > 0 ? (longest[k] / size) * ways[k] : Vec{};
        cloth[k] += ways[k];
    }
    follow(clearing.rings, cloth, ways.data);
}

}  // namespace uvc
