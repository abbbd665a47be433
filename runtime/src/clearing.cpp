#include "clearing.h"

namespace uvc {

namespace {

// Frames from one search of the whole body for a vertex to the next.
constexpr int RENEWAL = 8;

// Times that vertices are moved off the skin; after all but the last one their neighbours follow.
constexpr int PASSES = 3;

// Share of the mean move of its neighbours by which a vertex follows them, and metres of its own move at
// which it no longer does.
constexpr float SPREAD = 0.6f, FREE_MOVE = 1e-3f;

// Cosine to the normal below which the way from the closest face leads inwards: faces fold at joints.
constexpr float INWARD = -0.7f;

// Metres more than the clearance within which vertices are watched: their neighbours may move them.
constexpr float WATCHED = 0.004f;

// Metres that faces keep off skin that is curved between their corners, an elbow's or a knee's.
constexpr float BENEATH_FACES = 0.001f;

// Distance of a point from a face, negative inside, and the interpolated normal there. From the inside, the
// way to the closest face jumps where another face becomes closest; normals do not.
float signed_by_normals(const Surface &surface, const Vec *body, const Vec *normals, int face, Vec point,
                        Vec &normal) {
    Closest closest = on_face(surface, body, face, point);
    Face f = surface.faces.at(face);
    normal = unit(weighted(closest.weights, normals[f.a], normals[f.b], normals[f.c]));
    float distance = length(closest.away);
    return dot(closest.away, normal) < INWARD * distance ? -distance : distance;
}

// Raises the heights of vertices over convex skin, which comes through the edges between them: an arc between
// two points rises over their chord by about an eighth of its length times the angle between its normals.
void raise_over_curves(const Clearing &clearing, Array<ContactCandidate> near, const Vec *cloth,
                       const Vec *outwards, float *heights) {
    for (ContactCandidate each : near) {
        Vec normal = outwards[each.vertex];
        if (dot(normal, normal) == 0) continue;
        int first = clearing.rings.starts.at(each.vertex), last = clearing.rings.starts.at(each.vertex + 1);
        for (int k = first; k < last; k++) {
            int neighbour = clearing.rings.ring.at(k);
            Vec other = outwards[neighbour], way = cloth[neighbour] - cloth[each.vertex];
            if (dot(other, other) == 0 || dot(way, normal) >= 0) continue;
            float rise = least(0.125f * length(way) * length(other - normal), WATCHED);
            float height = clearing.thickness.at(each.vertex) + rise + BENEATH_FACES;
            heights[each.vertex] = most(heights[each.vertex], height);
        }
    }
}

}  // namespace

size_t memory_size(const Clearing &clearing) {
    size_t vertices = (size_t)clearing.rest.size, rows = vertices * (size_t)clearing.collider.parts;
    return 4 + 8 * rows + sizeof(Vec) * (vertices + (size_t)clearing.collider.surface.vertices);
}

ClearingMemory lay_out(const Clearing &clearing, void *bytes) {
    int vertices = clearing.rest.size, rows = clearing.collider.parts * vertices;
    int32_t *frame = static_cast<int32_t *>(bytes), *faces = frame + 1;
    float *clear = reinterpret_cast<float *>(faces + rows);
    Vec *cloth = reinterpret_cast<Vec *>(clear + rows);
    return {cloth, cloth + vertices, {faces, clear}, frame};
}

void begin(const Clearing &clearing, const ClearingMemory &memory) {
    memset(memory.frame, 0, memory_size(clearing));
    int rows = clearing.collider.parts * clearing.rest.size;
    for (int k = 0; k < rows; k++) memory.searched.faces[k] = -1;
}

void read_clearing(const Sections &sections, Clearing &clearing, Failure &failure) {
    Arena &arena = clearing.arena;
    clearing.collider = read_collider(sections, "fine.touches", nullptr, arena, failure);
    Array<float> rest = read_floats(sections, "fine.rest", -1, 3, arena, failure);
    int vertices = rest.size / 3;
    clearing.rest = {reinterpret_cast<Vec *>(rest.data), vertices};
    Array<int32_t> faces = read_faces(sections, "fine.faces", vertices, arena, failure);
    clearing.thickness = read_floats(sections, "fine.thickness", vertices, 1, arena, failure);
    Array<float> skin = read_floats(sections, "skin.rest", -1, 3, arena, failure);
    int points = skin.size / 3;
    Array<int32_t> skin_faces = read_faces(sections, "skin.faces", points, arena, failure);
    Array<int32_t> corners = read_indices(sections, "covered.corners", -1, 3, 0, points, arena, failure);
    Array<float> weights = read_floats(sections, "covered.weights", corners.size / 3, 3, arena, failure);
    if (!failure.failed && clearing.collider.touches.size != vertices)
        failure.say("section fine.touches of the outfit has not a row for each vertex");
    if (failure.failed) return;
    Array<Face> triangles{reinterpret_cast<Face *>(faces.data), faces.size / 3};
    clearing.layers = read_layers(sections, clearing.rest, triangles, arena, failure);
    if (failure.failed) return;
    Array<Face> skin_triangles{reinterpret_cast<Face *>(skin_faces.data), skin_faces.size / 3};
    int32_t all[2] = {0, triangles.size}, all_skin[2] = {0, skin_triangles.size};
    Vec *skin_rest = reinterpret_cast<Vec *>(skin.data);
    clearing.skin_vertices = points;
    clearing.rings = vertex_rings(triangles, vertices, arena);
    clearing.cloth = make_box_tree(clearing.rest.data, triangles, {all, 2}, 4, arena);
    clearing.skin = make_box_tree(skin_rest, skin_triangles, {all_skin, 2}, 4, arena);
    Covered &covered = clearing.covered;
    covered.corners = {reinterpret_cast<Face *>(corners.data), corners.size / 3};
    covered.weights = {reinterpret_cast<Vec *>(weights.data), corners.size / 3};
    covered.rest = arena.take<Vec>(corners.size / 3);
    covered.order = arena.take<int32_t>(corners.size / 3);
    for (int k = 0; k < covered.rest.size; k++) {
        Face f = covered.corners[k];
        covered.rest[k] = weighted(covered.weights[k], skin_rest[f.a], skin_rest[f.b], skin_rest[f.c]);
        covered.order[k] = k;
    }
    sort_in_runs(covered.order, covered.rest);
}

void follow(const Rings &rings, Vec *cloth, const Vec *moves) {
    for (int vertex = 0; vertex + 1 < rings.starts.size; vertex++) {
        int first = rings.starts.at(vertex), last = rings.starts.at(vertex + 1);
        if (last == first) continue;
        Vec total{};
        for (int k = first; k < last; k++) total += moves[rings.ring.at(k)];
        if (dot(total, total) == 0) continue;
        float free = 1 - length(moves[vertex]) / FREE_MOVE;
        if (free > 0) cloth[vertex] += (SPREAD * free / (float)(last - first)) * total;
    }
}

void clear_skin(const Clearing &clearing, const ClearingMemory &memory, Vec *cloth, const Vec *body,
                float clearance, float reach, Arena &work) {
    Scope scope(work);
    const Surface &surface = clearing.collider.surface;
    int vertices = clearing.rest.size;
    Array<float> near = work.take<float>(vertices), heights = work.take<float>(vertices);
    for (int k = 0; k < vertices; k++) {
        heights[k] = clearance + clearing.thickness[k];
        near[k] = heights[k] + WATCHED;
    }
    Array<ContactCandidate> found = work.take<ContactCandidate>(clearing.collider.parts * vertices);
    BodySweep sweep = begin_sweep(clearing.collider, memory.body, body, memory.cloth, memory.searched,
                                    *memory.frame, RENEWAL, work);
    ProximityQuery watch{nullptr, near.data, 0, 1, reach, reach};
    found.size = find_near(clearing.collider, sweep, 1, cloth, watch, found, work);
    Array<Vec> normals = work.take<Vec>(surface.vertices);
    Array<int32_t> is_known = work.take<int32_t>(surface.vertices);
    for (ContactCandidate each : found)
        for (int corner = 0; corner < 3; corner++) {
            int vertex = surface.faces[each.face][corner];
            if (is_known[vertex]) continue;
            is_known[vertex] = 1;
            normals[vertex] = unit(vertex_normal(surface, body, vertex));
        }
    Array<Vec> moves = work.take<Vec>(vertices), outwards = work.take<Vec>(vertices);
    for (int pass = 0; pass < PASSES; pass++) {
        for (Vec &move : moves) move = {};
        for (ContactCandidate each : found) {
            Vec normal;
            float distance =
                signed_by_normals(surface, body, normals.data, each.face, cloth[each.vertex], normal);
            float lack = heights[each.vertex] - distance;
            if (lack <= 0) continue;
            cloth[each.vertex] += lack * normal;
            moves[each.vertex] += lack * normal;
            outwards[each.vertex] = normal;
        }
        if (pass == PASSES - 1) break;
        follow(clearing.rings, cloth, moves.data);
        raise_over_curves(clearing, found, cloth, outwards.data, heights.data);
    }
    end_sweep(clearing.collider, sweep, cloth);
    memcpy(memory.cloth, cloth, sizeof(Vec) * (size_t)vertices);
    memcpy(memory.body, body, sizeof(Vec) * (size_t)surface.vertices);
    ++*memory.frame;
}

}  // namespace uvc
