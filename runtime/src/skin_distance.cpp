#include "skin_distance.h"

namespace uvc {

namespace {

// Metres within which a point lies on the skin.
constexpr float ON_SKIN = 1e-5f;

// Frames from one search of all faces for a point to the next, and faces over which it is followed in between.
constexpr int RENEWAL = 8, STEPS = 8;

// Direction of the skin where a point is closest, on whose side is outside: of a face, of the two at an edge,
// or of a vertex (Baerentzen and Aanaes 2005). Not of unit length.
Vec facing(const Surface &surface, const Vec *vertices, const Closest &closest) {
    Vec w = closest.weights;
    Face f = surface.faces[closest.face];
    int zeros = (w.x <= 0) + (w.y <= 0) + (w.z <= 0);
    if (zeros == 2) return vertex_normal(surface, vertices, w.x > 0 ? f.a : w.y > 0 ? f.b : f.c);
    Vec own = unit(face_normal(f, vertices));
    if (zeros == 0) return own;
    int other = surface.neighbours[closest.face][w.x <= 0 ? 1 : w.y <= 0 ? 2 : 0];
    return other < 0 ? own : own + unit(face_normal(surface, vertices, other));
}

NearSkin beside(const Surface &surface, const Vec *vertices, const Closest &closest) {
    float distance = length(closest.away);
    Vec outside = facing(surface, vertices, closest);
    float side = dot(closest.away, outside) < 0 ? -1.0f : 1.0f;
    return {side * distance, distance > ON_SKIN ? (side / distance) * closest.away : unit(outside)};
}

}  // namespace

WholeSkin make_whole_skin(Array<Vec> rest, Array<Face> faces, Arena &arena) {
    return {make_surface(rest.size, faces, arena), make_lane_tree(rest.data, faces, arena)};
}

SkinSearch::SkinSearch(const WholeSkin &skin, const Vec *vertices, Arena &work)
    : skin_(skin), vertices_(vertices), fitted_(make_fitted_tree(skin.tree, work)) {
    fit(skin.tree, vertices, fitted_);
}

void SkinSearch::find_near(const Vec *points, int count, int frame, float reach, int32_t *faces,
                           NearSkin *near) {
    const Surface &surface = skin_.surface;
    for (int k = 0; k < count; k++) {
        near[k] = {reach, {}};
        Closest closest{-1, {}, {}};
        if (faces[k] >= 0) closest = walk(surface, vertices_, faces[k], points[k], STEPS);
        if (frame == 0 || k % RENEWAL == frame % RENEWAL) {
            float limit = closest.face < 0 ? reach : least(reach, length(closest.away)), beyond;
            int face = closest_face(skin_.tree, fitted_, points[k], limit, beyond);
            if (face >= 0) closest = on_face(surface, vertices_, face, points[k]);
        }
        faces[k] = closest.face;
        if (closest.face >= 0 && length(closest.away) <= reach) near[k] = beside(surface, vertices_, closest);
    }
}

}  // namespace uvc
