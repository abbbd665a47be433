#include "layers.h"

#include "clearing.h"

namespace uvc {

namespace {

// Metres within which an inner garment is looked for.
constexpr float REACH = 0.03f;

// Metres within which a garment is looked for beneath what came out from it.
constexpr float REACH_BENEATH = 0.1f;

// Least cosine between its normal and the way to a point that it covers: beside its hem it does not.
constexpr float COVERING = 0.7f;

// First face of each garment; empty where one has corners of two, or comes too late.
Array<int32_t> first_faces(Array<int32_t> starts, Array<Face> faces, Arena &arena) {
    Array<int32_t> firsts = arena.take<int32_t>(starts.size);
    int face = 0;
    for (int garment = 0; garment + 1 < starts.size; garment++) {
        auto has = [&](int vertex) { return vertex >= starts[garment] && vertex < starts[garment + 1]; };
        firsts[garment] = face;
        while (face < faces.size && has(faces[face].a) && has(faces[face].b) && has(faces[face].c)) face++;
    }
    firsts[starts.size - 1] = face;
    return face == faces.size ? firsts : Array<int32_t>{};
}

// A garment where it lies now, and its normals at vertices (N), of unit length.
struct Placed {
    bool is_fitted;
    FittedTree tree;
};

void fit_garment(const Layers &layers, int garment, const Vec *cloth, Placed &placed, Vec *normals,
                 Arena &work) {
    if (placed.is_fitted) return;
    const LaneTree &tree = layers.trees[garment];
    placed = {true, make_fitted_tree(tree, work)};
    fit(tree, cloth, placed.tree);
    for (int k = layers.starts[garment]; k < layers.starts[garment + 1]; k++) normals[k] = {};
    for (Face f : tree.faces) {
        Vec normal = cross(cloth[f.b] - cloth[f.a], cloth[f.c] - cloth[f.a]);
        for (int corner = 0; corner < 3; corner++) normals[f[corner]] += normal;
    }
    for (int k = layers.starts[garment]; k < layers.starts[garment + 1]; k++) normals[k] = unit(normals[k]);
}

// A point over a face: the height along the interpolated normal, and whether it is not beside the face.
struct HeightOverFace {
    Vec normal;
    float height;
    bool is_across;
};

HeightOverFace over_face(Face f, const Vec *cloth, const Vec *normals, Vec point) {
    Vec weights = closest_barycentrics(point, cloth[f.a], cloth[f.b], cloth[f.c]);
    Vec away = point - weighted(weights, cloth[f.a], cloth[f.b], cloth[f.c]);
    Vec normal = unit(weighted(weights, normals[f.a], normals[f.b], normals[f.c]));
    float height = dot(away, normal);
    return {normal, height, absolute(height) >= COVERING * length(away)};
}

// The move of a point off a face that is closest to it.
Vec move_off(Face f, const Vec *cloth, const Vec *normals, Vec point, float clearance) {
    HeightOverFace over = over_face(f, cloth, normals, point);
    if (over.height >= clearance || !over.is_across) return {};
    return (clearance - over.height) * over.normal;
}

bool lies_over(Array<int32_t> over, int vertex, int garment) {
    return over.size && over.at(vertex) >> garment & 1;
}

// Moves the outer garment of a pair off the inner one, and adds its moves (N), where these are asked for.
void lift_off(const Layers &layers, int pair, Array<int32_t> over, FittedTree &fitted, const Vec *normals,
              Vec *cloth, Vec *moves, float clearance) {
    int outer = layers.outer[pair], inner = layers.inner[pair];
    const LaneTree &tree = layers.trees[inner];
    const int32_t *parts = layers.parts.data + layers.face_starts[inner];
    for (int vertex = layers.starts[outer]; vertex < layers.starts[outer + 1]; vertex++) {
        int touches = layers.touches.at(vertex);
        if (!(touches & layers.all_parts.at(inner))) continue;
        float beyond = 0;
        int face = closest_face(tree, fitted, cloth[vertex], REACH, beyond);
        if (face < 0 || !(touches & parts[face])) continue;
        Face f = tree.faces.at(face);
        if (lies_over(over, f.a, outer) || lies_over(over, f.b, outer) || lies_over(over, f.c, outer)) continue;
        Vec move = move_off(f, cloth, normals, cloth[vertex], clearance);
        cloth[vertex] += move;
        if (moves) moves[vertex] += move;
    }
}

// Whether a point is on the outer side of the face that is closest to it, not beside it.
bool is_outside(const LaneTree &tree, FittedTree &fitted, const Vec *cloth, const Vec *normals, Vec point) {
    float beyond = 0;
    int face = closest_face(tree, fitted, point, REACH_BENEATH, beyond);
    if (face < 0) return false;
    HeightOverFace over = over_face(tree.faces.at(face), cloth, normals, point);
    return over.is_across && over.height >= 0;
}

// Adds the neighbours of what lies over the outer garment of a pair that are outside it too.
void spread_over(const Layers &layers, int pair, const Rings &rings, FittedTree &fitted, const Vec *cloth,
                 const Vec *normals, Array<int32_t> over, Arena &work) {
    Scope scope(work);
    int outer = layers.outer[pair], inner = layers.inner[pair];
    int first = layers.starts[inner], last = layers.starts[inner + 1], count = 0;
    Array<int32_t> waiting = work.take<int32_t>(last - first);
    for (int vertex = first; vertex < last; vertex++)
        if (lies_over(over, vertex, outer)) waiting[count++] = vertex;
    for (int head = 0; head < count; head++)
        for (int k = rings.starts[waiting[head]]; k < rings.starts[waiting[head] + 1]; k++) {
            int vertex = rings.ring[k];
            if (lies_over(over, vertex, outer)) continue;
            if (!is_outside(layers.trees[outer], fitted, cloth, normals, cloth[vertex])) continue;
            over[vertex] |= 1 << outer;
            waiting[count++] = vertex;
        }
}

// Moves what came out from beneath the outer garment of a pair off it. Returns whether there is any.
bool lift_over(const Layers &layers, int pair, Array<int32_t> over, FittedTree &fitted, const Vec *normals,
               Vec *cloth, float clearance) {
    int outer = layers.outer[pair], inner = layers.inner[pair];
    const LaneTree &tree = layers.trees[outer];
    bool is_any = false;
    for (int vertex = layers.starts[inner]; vertex < layers.starts[inner + 1]; vertex++) {
        if (!lies_over(over, vertex, outer)) continue;
        float beyond = 0;
        int face = closest_face(tree, fitted, cloth[vertex], REACH, beyond);
        if (face < 0) continue;
        cloth[vertex] += move_off(tree.faces.at(face), cloth, normals, cloth[vertex], clearance);
        is_any = true;
    }
    return is_any;
}

}  // namespace

Layers read_layers(const Sections &sections, Array<Vec> rest, Array<Face> faces, Arena &arena,
                   Failure &failure) {
    Layers layers{};
    layers.starts = read_integers(sections, "garments.starts", -1, 1, arena, failure);
    int garments = most(layers.starts.size - 1, 0);
    layers.starts = read_starts(sections, "garments.starts", garments, rest.size, arena, failure);
    layers.outer = read_indices(sections, "layers.outer", -1, 1, 0, garments, arena, failure);
    int pairs = layers.outer.size;
    layers.inner = read_indices(sections, "layers.inner", pairs, 1, 0, garments, arena, failure);
    layers.touches = read_integers(sections, "layers.touches", rest.size, 1, arena, failure);
    if (failure.failed) return {};
    for (int pair = 0; pair < pairs; pair++) {
        int outer = layers.outer[pair], inner = layers.inner[pair], before = most(pair - 1, 0);
        bool comes_later = outer > layers.outer[before] ||
                           (outer == layers.outer[before] && inner > layers.inner[before]);
        if (inner >= outer || (pair && !comes_later))
            failure.say("pair %d of section layers.outer of the outfit is not in order", pair);
    }
    layers.face_starts = first_faces(layers.starts, faces, arena);
    if (!layers.face_starts.size) failure.say("section fine.faces of the outfit mixes garments");
    if (failure.failed) return {};
    layers.parts = arena.take<int32_t>(faces.size);
    layers.all_parts = arena.take<int32_t>(garments);
    layers.trees = arena.take<LaneTree>(garments);
    for (int garment = 0; garment < garments; garment++) {
        for (int face = layers.face_starts[garment]; face < layers.face_starts[garment + 1]; face++) {
            for (int corner = 0; corner < 3; corner++)
                layers.parts[face] |= layers.touches[faces[face][corner]];
            layers.all_parts[garment] |= layers.parts[face];
        }
        Array<Face> own = faces.part(layers.face_starts[garment], layers.face_starts[garment + 1]);
        layers.trees[garment] = make_lane_tree(rest.data, own, arena);
    }
    return layers;
}

void lift(const Layers &layers, const Rings &rings, Array<int32_t> over, Vec *cloth, float clearance, int turns,
          Arena &work) {
    Scope scope(work);
    int garments = layers.starts.size - 1, vertices = layers.touches.size;
    if (!layers.outer.size) return;
    Array<Placed> placed = work.take<Placed>(garments);
    Array<Vec> normals = work.take<Vec>(vertices), moves;
    // Of one turn nobody asks for the moves.
    if (turns > 1) moves = work.take<Vec>(vertices);
    int first = 0, last = 0;
    for (int outer = 0; outer < garments; outer++, first = last) {
        while (last < layers.outer.size && layers.outer[last] == outer) last++;
        if (first == last) continue;
        // The inner garments are where their own lifting left them; only what came out of them is moved again.
        for (int pair = first; pair < last; pair++) {
            int garment = layers.inner[pair];
            fit_garment(layers, garment, cloth, placed[garment], normals.data, work);
        }
        if (over.size) {
            fit_garment(layers, outer, cloth, placed[outer], normals.data, work);
            for (int pair = first; pair < last; pair++)
                spread_over(layers, pair, rings, placed[outer].tree, cloth, normals.data, over, work);
            placed[outer].is_fitted = false;
        }
        for (int turn = 0; turn < turns; turn++) {
            for (Vec &move : moves) move = {};
            for (int pair = first; pair < last; pair++)
                lift_off(layers, pair, over, placed[layers.inner[pair]].tree, normals.data, cloth, moves.data,
                         clearance);
            if (turn < turns - 1) follow(rings, cloth, moves.data);
        }
        if (!over.size) continue;
        fit_garment(layers, outer, cloth, placed[outer], normals.data, work);
        for (int pair = first; pair < last; pair++)
            if (lift_over(layers, pair, over, placed[outer].tree, normals.data, cloth, clearance))
                placed[layers.inner[pair]].is_fitted = false;
    }
}

}  // namespace uvc
