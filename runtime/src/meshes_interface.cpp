// The C interface of moving meshes: closest points and their sides, and edges through faces.
#include "edge_crossings.h"
#include "enclosure.h"
#include "sections.h"
#include "uvcloth_measures.h"

struct uvc_meshes {
    uvc::Arena arena;
    uvc::Array<uvc::Vec> points;
    uvc::Array<uvc::LaneTree> trees;
    uvc::Array<uvc::FittedTree> fitted;
};

namespace uvc {

namespace {

// Most meshes: each has a bit.
constexpr int MOST = 31;

// Metres that a search reaches at most.
constexpr float LONGEST_REACH = 1e4f;

// A reach, m, that searches can have; 0 for what is no number.
float limited(float reach) { return least(LONGEST_REACH, most(0.0f, reach)); }

const Vec *vectors(const float *numbers) { return reinterpret_cast<const Vec *>(numbers); }
Vec *vectors(float *numbers) { return reinterpret_cast<Vec *>(numbers); }

void fit_all(uvc_meshes &meshes) {
    for (int k = 0; k < meshes.trees.size; k++) {
        fit(meshes.trees[k], meshes.points.data, meshes.fitted[k]);
        fit_patches(meshes.trees[k], meshes.fitted[k]);
    }
}

}  // namespace

}  // namespace uvc

extern "C" {

uvc_meshes *uvc_make_meshes(const float *vertices, int vertex_count, const int32_t *faces,
                            const int32_t *starts, int count, char *message, size_t room) {
    uvc::Failure failure{message, room};
    if (count > uvc::MOST) failure.say("%d meshes are more than %d", count, uvc::MOST);
    for (int k = 0; k < 3 * starts[count]; k++)
        if (faces[k] < 0 || faces[k] >= vertex_count)
            failure.say("face %d has the corner %d of %d vertices", k / 3, faces[k], vertex_count);
    if (failure.failed) return nullptr;
    uvc_meshes *meshes = uvc::make<uvc_meshes>();
    uvc::Arena &arena = meshes->arena;
    meshes->points = arena.copy(uvc::vectors(vertices), vertex_count);
    meshes->trees = arena.take<uvc::LaneTree>(count);
    meshes->fitted = arena.take<uvc::FittedTree>(count);
    for (int k = 0; k < count; k++) {
        const uvc::Face *first = reinterpret_cast<const uvc::Face *>(faces) + starts[k];
        uvc::Array<uvc::Face> own = arena.copy(first, starts[k + 1] - starts[k]);
        meshes->trees[k] = uvc::make_lane_tree(meshes->points.data, own, arena);
        meshes->fitted[k] = uvc::make_fitted_tree(meshes->trees[k], arena);
    }
    uvc::fit_all(*meshes);
    return meshes;
}

void uvc_free_meshes(uvc_meshes *meshes) { uvc::drop(meshes); }

void uvc_move_meshes(uvc_meshes *meshes, const float *vertices) {
    memcpy(meshes->points.data, vertices, sizeof(uvc::Vec) * (size_t)meshes->points.size);
    uvc::fit_all(*meshes);
}

void uvc_closest_faces(const uvc_meshes *meshes, int mesh, const float *points, int count, float reach,
                       int32_t *faces, float *weights) {
    const uvc::LaneTree &tree = meshes->trees.at(mesh);
    // All patches are fitted: a search writes nothing.
    uvc::FittedTree fitted = meshes->fitted.at(mesh);
    for (int k = 0; k < count; k++) {
        uvc::Vec point = uvc::vectors(points)[k], met{};
        float beyond;
        faces[k] = uvc::closest_face(tree, fitted, point, uvc::limited(reach), beyond);
        if (faces[k] >= 0) {
            uvc::Face f = tree.faces.at(faces[k]);
            met = uvc::closest_barycentrics(point, fitted.points[f.a], fitted.points[f.b], fitted.points[f.c]);
        }
        uvc::vectors(weights)[k] = met;
    }
}

void uvc_signed_distances(const uvc_meshes *meshes, int mesh, const float *points, int count, float reach,
                          int32_t *faces, float *weights, float *distances, float *places, float *normals) {
    for (int k = 0; k < count; k++) {
        uvc::Vec point = uvc::vectors(points)[k];
        uvc::SignedClosest closest = uvc::signed_closest(meshes->trees.at(mesh), meshes->fitted.at(mesh), point,
                                                         uvc::limited(reach));
        faces[k] = closest.face;
        uvc::vectors(weights)[k] = closest.weights;
        distances[k] = closest.distance;
        uvc::vectors(places)[k] = closest.place;
        uvc::vectors(normals)[k] = closest.outward;
    }
}

void uvc_nearest_meshes(const uvc_meshes *meshes, const int32_t *touches, const float *points, int count,
                        float reach, float exact, float narrow, float *distances, float *normals,
                        float *offsets, float *gaps) {
    for (int k = 0; k < count; k++) {
        uvc::Vec point = uvc::vectors(points)[k];
        uvc::NearestPart nearest =
            uvc::nearest_part(meshes->trees, meshes->fitted, touches[k], point, uvc::limited(reach),
                              uvc::limited(exact), narrow);
        distances[k] = nearest.distance;
        uvc::vectors(normals)[k] = nearest.outward;
        offsets[k] = nearest.offset;
        gaps[k] = nearest.room;
    }
}

void uvc_crossing_edges(const uvc_meshes *meshes, int mesh, const int32_t *edges, int count, uint8_t *crosses) {
    for (int k = 0; k < count; k++)
        crosses[k] = uvc::is_crossing(meshes->trees.at(mesh), meshes->fitted.at(mesh),
                                      meshes->points.at(edges[2 * k]), meshes->points.at(edges[2 * k + 1]));
}

}  // extern "C"
