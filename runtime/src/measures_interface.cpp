// The C interface of measures.
#include "uvcloth_measures.h"

#include "box_tree.h"
#include "sections.h"

struct uvc_shell {
    uvc::Arena arena;
    uvc::BoxTree tree;
    uvc::Array<uvc::Vec> points;
    uvc::Array<uvc::Box> boxes;
};

namespace uvc {

namespace {

// Metres: nothing is there.
constexpr float FAR = 1e9f;

// Most faces in a leaf, whose boxes all rays are compared with.
constexpr int LEAF = 4;

// Eight vectors in a row, from the first of so many; the last one fills up.
LaneVec eight(const float *numbers, int first, int count) {
    int32_t indices[LANES];
    for (int lane = 0; lane < LANES; lane++) indices[lane] = least(first + lane, count - 1);
    return gather(reinterpret_cast<const Vec *>(numbers), indices);
}

// Writes the first of eight vectors.
void put_first(float *numbers, int count, const LaneVec &vectors) {
    for (int lane = 0; lane < count; lane++) reinterpret_cast<Vec *>(numbers)[lane] = pick(vectors, lane);
}

void move(uvc_shell &shell) {
    if (shell.tree.faces.size) fit_boxes(shell.tree, 0, shell.points.data, shell.boxes);
}

}  // namespace

}  // namespace uvc

extern "C" {

uvc_shell *uvc_make_shell(const float *vertices, int vertex_count, const int32_t *faces, int face_count,
                          char *message, size_t room) {
    uvc::Failure failure{message, room};
    for (int k = 0; k < 3 * face_count; k++)
        if (faces[k] < 0 || faces[k] >= vertex_count) {
            failure.say("face %d has the corner %d of %d vertices", k / 3, faces[k], vertex_count);
            return nullptr;
        }
    uvc_shell *shell = uvc::make<uvc_shell>();
    shell->points = shell->arena.copy(reinterpret_cast<const uvc::Vec *>(vertices), vertex_count);
    uvc::Array<uvc::Face> own = shell->arena.copy(reinterpret_cast<const uvc::Face *>(faces), face_count);
    int32_t starts[] = {0, face_count};
    shell->tree = uvc::make_box_tree(shell->points.data, own, {starts, 2}, uvc::LEAF, shell->arena);
    shell->boxes = shell->arena.room<uvc::Box>(shell->tree.nodes.size);
    uvc::move(*shell);
    return shell;
}

void uvc_free_shell(uvc_shell *shell) { uvc::drop(shell); }

void uvc_move_shell(uvc_shell *shell, const float *vertices) {
    memcpy(shell->points.data, vertices, sizeof(uvc::Vec) * (size_t)shell->points.size);
    uvc::move(*shell);
}

void uvc_first_hits(const uvc_shell *shell, const float *starts, const float *directions, int count,
                    float reach, int32_t *faces, float *distances, float *cosines, float *weights) {
    const uvc::Vec *points = shell->points.data;
    for (int first = 0; first < count; first += uvc::LANES) {
        uvc::Rays rays{uvc::eight(starts, first, count), uvc::eight(directions, first, count),
                       uvc::Lanes{} + reach};
        uvc::Hits hits = uvc::first_hits(shell->tree, 0, points, shell->boxes, rays);
        for (int lane = 0; lane < uvc::least(uvc::LANES, count - first); lane++) {
            int k = first + lane, face = hits.faces[lane];
            uvc::Vec met{}, normal{};
            if (face >= 0) met = uvc::pick(hits.weights, lane);
            if (face >= 0) normal = uvc::unit(uvc::face_normal(shell->tree.faces.at(face), points));
            faces[k] = face;
            distances[k] = face >= 0 ? hits.distance[lane] : uvc::FAR;
            cosines[k] = uvc::dot(normal, uvc::pick(rays.direction, lane));
            reinterpret_cast<uvc::Vec *>(weights)[k] = met;
        }
    }
}

void uvc_sample(const float *vertices, const int32_t *faces, const float *weights, int count, float *points,
                float *normals) {
    const uvc::Vec *places = reinterpret_cast<const uvc::Vec *>(vertices);
    for (int first = 0; first < count; first += uvc::LANES) {
        int32_t corners[3][uvc::LANES];
        for (int lane = 0; lane < uvc::LANES; lane++)
            for (int corner = 0; corner < 3; corner++)
                corners[corner][lane] = faces[3 * uvc::least(first + lane, count - 1) + corner];
        uvc::LaneVec a = uvc::gather(places, corners[0]), b = uvc::gather(places, corners[1]),
                     c = uvc::gather(places, corners[2]), w = uvc::eight(weights, first, count);
        uvc::LaneVec normal = uvc::cross(b - a, c - a);
        uvc::Lanes share = 1.0f / (uvc::root(uvc::dot(normal, normal)) + uvc::TINY);
        int some = uvc::least(uvc::LANES, count - first);
        uvc::put_first(points + 3 * first, some, w.x * a + w.y * b + w.z * c);
        uvc::put_first(normals + 3 * first, some, share * normal);
    }
}

}  // extern "C"
