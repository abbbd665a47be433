#include "collider.h"

namespace uvc {

namespace {

// Neighbouring faces that a vertex is followed over at most, from search to search.
constexpr int FOLLOWED = 8;

// Depth, m, up to which a vertex is followed: deeper, a face elsewhere may be closer.
constexpr float CLOSE = 0.01f;

// Seconds after a search of all faces in which a vertex is followed within the whole reach.
constexpr float LONGEST = 1.0f / 60.0f;

// Metres by which distances may be off by rounding.
constexpr float ROUNDED = 1e-5f;

// Factor on the speed of a vertex, which may grow, for its way until the next search, and m/s that it gains.
constexpr float SPARE = 1.5f, ALERT_SPEED = 0.5f;

// Metres under the skin within which caught cloth is found: no limb is twice as thick.
constexpr float DEEPEST = 0.1f;

// Vertices of each part, once each.
void find_vertices(Collider &collider, Arena &arena) {
    Arena work;
    Array<int32_t> seen = work.take<int32_t>(collider.surface.vertices);
    Array<int32_t> vertices = work.take<int32_t>(3 * collider.surface.faces.size);
    collider.vertex_starts = arena.take<int32_t>(collider.parts + 1);
    int count = 0;
    for (int part = 0; part < collider.parts; part++) {
        for (int k = collider.starts[part]; k < collider.starts[part + 1]; k++)
            for (int corner = 0; corner < 3; corner++) {
                int vertex = collider.surface.faces[k][corner];
                if (seen[vertex] == part + 1) continue;
                seen[vertex] = part + 1;
                vertices[count++] = vertex;
            }
        collider.vertex_starts[part + 1] = count;
    }
    collider.vertices = arena.copy(vertices.data, count);
}

Array<int32_t> vertices_of(const Collider &collider, int part) {
    return collider.vertices.part(collider.vertex_starts.at(part), collider.vertex_starts.at(part + 1));
}

// Motion of a part; at rest if it does not move to an end.
RigidMotion part_motion(const Collider &collider, int part, const Vec *start, const Vec *end) {
    return fit_motion(end ? vertices_of(collider, part) : Array<int32_t>{}, start, end);
}

FittedParts make_fitted_parts(const Collider &collider, Arena &arena) {
    FittedParts parts{nullptr, arena.take<FittedTree>(collider.parts), arena.take<int32_t>(collider.parts)};
    for (int part = 0; part < collider.parts; part++)
        parts.trees[part] = make_fitted_tree(collider.trees.at(part), arena);
    return parts;
}

void move_to(FittedParts &parts, const Vec *points) {
    parts.points = points;
    for (int32_t &is_fitted : parts.is_fitted) is_fitted = 0;
}

// The closest face of a part within reach, m. `guess`, a face or -1, saves time and changes nothing.
// `beyond`: where none is found, the square of a distance within which there is none.
Closest closest_of_part(const Collider &collider, FittedParts &parts, int part, Vec point, float reach,
                        int guess, float &beyond) {
    const LaneTree &tree = collider.trees.at(part);
    FittedTree &fitted = parts.trees.at(part);
    if (!parts.is_fitted.at(part)) fit(tree, parts.points, fitted);
    parts.is_fitted.at(part) = 1;
    if (guess >= 0) {
        // Rounded up, so that the guess itself is found in its turn.
        Closest guessed = on_face(collider.surface, parts.points, guess, point);
        reach = least(reach, root(dot(guessed.away, guessed.away) * 1.001f + 1e-9f));
    }
    int face = closest_face(tree, fitted, point, reach, beyond);
    if (face < 0) return {-1, {}, {}};
    return on_face(collider.surface, parts.points, collider.starts.at(part) + face, point);
}

// Metres by which cloth, from before to now, and a part approach each other at most.
UVC_INLINE Lanes approach(const RigidMotion &part, LaneVec before, LaneVec now) {
    LaneVec apart = now - part.take(before);
    return root(dot(apart, apart)) + (part.most + ROUNDED);
}

// Distance of a point from a face, negative inside, and the speed, m/s, at which it moves past it.
UVC_INLINE float past(const Surface &surface, const BodySweep &sweep, const Closest &closest, Vec velocity,
                      float rate, float &slip) {
    Face f = surface.faces.at(closest.face);
    Vec began = weighted(closest.weights, sweep.start[f.a], sweep.start[f.b], sweep.start[f.c]);
    Vec ends = weighted(closest.weights, sweep.end[f.a], sweep.end[f.b], sweep.end[f.c]);
    slip = length(velocity - rate * (ends - began));
    bool outside = dot(closest.away, face_normal(surface, sweep.points.data, closest.face)) > 0;
    float distance = length(closest.away);
    return outside ? distance : -distance;
}

// A search for the faces that cloth is near.
struct Search {
    const Collider &collider;
    BodySweep &sweep;
    const ProximityQuery &watch;
    const Vec *cloth;
    Array<ContactCandidate> found;
    bool is_first;
    int count;

    // Follows a vertex over a part from the face that is known, or looks at all faces; keeps what it is near.
    void look(int part, int vertex) {
        const Vec *points = sweep.points.data;
        int row = part * collider.touches.size + vertex;
        Vec point = cloth[vertex], velocity = watch.velocities ? watch.velocities[vertex] : Vec{};
        float rate = 1 / watch.seconds, distance = 0, slip = 0;
        int known = is_first ? sweep.before.faces[row] : -1, guess = sweep.hints.at(row);
        if (is_first && (vertex + sweep.turn) % sweep.renewal > 0) guess = known;
        Closest closest{-1, {}, {}};
        bool is_followed = false;
        if (guess >= 0) {
            closest = walk(collider.surface, points, guess, point, FOLLOWED);
            distance = past(collider.surface, sweep, closest, velocity, rate, slip);
            bool is_recent = !is_first && sweep.share - sweep.at.at(row) < LONGEST * rate;
            float limit = is_recent ? watch.reach : least(watch.reach, distance > 0 ? watch.followed : CLOSE);
            is_followed = dot(closest.away, closest.away) < limit * limit;
        }
        sweep.before.clear[row] = 0;
        if (!is_followed) {
            float beyond = 0;
            int best = closest.face >= 0 ? closest.face : known;
            closest = closest_of_part(collider, sweep.parts, part, point, watch.reach, best, beyond);
            sweep.at.at(row) = sweep.share;
            if (closest.face >= 0) distance = past(collider.surface, sweep, closest, velocity, rate, slip);
            sweep.before.clear[row] = closest.face >= 0 ? most(distance, 0.0f) : root(beyond);
        }
        sweep.hints.at(row) = closest.face;
        float touching = watch.near[vertex] + watch.interval * watch.seconds * (SPARE * slip + ALERT_SPEED);
        if (closest.face >= 0 && distance <= touching) found.at(count++) = {vertex, closest.face};
    }
};

// Vectors in blocks of eight; the last one fills up its block.
void put_in_lanes(const Vec *vectors, int count, Array<LaneVec> blocks) {
    for (int block = 0; block < blocks.size; block++) {
        int32_t indices[LANES];
        for (int lane = 0; lane < LANES; lane++) indices[lane] = least(LANES * block + lane, count - 1);
        blocks.at(block) = gather(vectors, indices);
    }
}

}  // namespace

Collider read_collider(const Sections &sections, const char *touches, const char *crossed, Arena &arena,
                       Failure &failure) {
    Collider collider{};
    Array<float> rest = read_floats(sections, "collider.rest", -1, 3, arena, failure);
    int vertices = rest.size / 3;
    Array<int32_t> corners = read_faces(sections, "collider.faces", vertices, arena, failure);
    collider.starts = read_integers(sections, "collider.starts", -1, 1, arena, failure);
    int faces = corners.size / 3, parts = most(collider.starts.size - 1, 0);
    collider.starts = read_starts(sections, "collider.starts", parts, faces, arena, failure);
    collider.touches = read_integers(sections, touches, -1, 1, arena, failure);
    collider.crossed = crossed ? read_integers(sections, crossed, collider.touches.size, 1, arena, failure)
                               : arena.take<int32_t>(collider.touches.size);
    if (failure.failed) return {};
    collider.parts = parts;
    if (parts > 31) failure.say("the collider has %d parts, at most 31 are possible", parts);
    Vec *points = reinterpret_cast<Vec *>(rest.data);
    collider.surface = make_surface(vertices, {reinterpret_cast<Face *>(corners.data), faces}, arena);
    collider.trees = arena.take<LaneTree>(parts);
    for (int part = 0; part < parts; part++) {
        Array<Face> own = collider.surface.faces.part(collider.starts[part], collider.starts[part + 1]);
        collider.trees[part] = make_lane_tree(points, own, arena);
    }
    find_vertices(collider, arena);
    collider.touching = arena.take<uint8_t>(parts * collider.blocks());
    for (int part = 0; part < parts; part++)
        for (int k = 0; k < collider.touches.size; k++)
            if (collider.touches[k] >> part & 1)
                collider.touching[part * collider.blocks() + k / LANES] |= (uint8_t)(1 << k % LANES);
    return collider;
}

BodySweep begin_sweep(const Collider &collider, const Vec *start, const Vec *end, const Vec *cloth,
                      ContactCache before, int turn, int renewal, Arena &work) {
    int rows = collider.parts * collider.touches.size;
    BodySweep sweep{};
    sweep.start = start;
    sweep.end = end;
    sweep.points = work.copy(start, collider.surface.vertices);
    sweep.points_before = work.room<Vec>(collider.surface.vertices);
    sweep.cloth = work.room<LaneVec>(collider.blocks());
    sweep.cloth_before = work.room<LaneVec>(collider.blocks());
    put_in_lanes(cloth, collider.touches.size, sweep.cloth);
    sweep.parts = make_fitted_parts(collider, work);
    sweep.hints = work.room<int32_t>(rows);
    for (int32_t &hint : sweep.hints) hint = -1;
    sweep.before = before;
    sweep.at = work.take<float>(rows);
    sweep.turn = turn;
    sweep.renewal = renewal;
    return sweep;
}

void end_sweep(const Collider &collider, BodySweep &sweep, const Vec *cloth) {
    int vertices = collider.touches.size;
    swap(sweep.cloth, sweep.cloth_before);
    put_in_lanes(cloth, vertices, sweep.cloth);
    for (int part = 0; part < collider.parts; part++) {
        RigidMotion left =
            part_motion(collider, part, sweep.points.data, sweep.share < 1 ? sweep.end : nullptr);
        float *clear = sweep.before.clear + part * vertices;
        for (int block = 0; block < collider.blocks(); block++) {
            unsigned touching = collider.touching.at(part * collider.blocks() + block);
            if (!touching) continue;
            Lanes closer = approach(left, sweep.cloth_before.at(block), sweep.cloth.at(block));
            while (touching) {
                int lane = take(touching);
                clear[LANES * block + lane] -= closer[lane];
            }
        }
    }
    memcpy(sweep.before.faces, sweep.hints.data, sizeof(int32_t) * (size_t)sweep.hints.size);
}

int find_near(const Collider &collider, BodySweep &sweep, float share, const Vec *cloth,
              const ProximityQuery &watch, Array<ContactCandidate> found, Arena &work) {
    Scope scope(work);
    int vertices = collider.touches.size;
    Search search{collider, sweep, watch, cloth, found, sweep.searches++ == 0, 0};
    swap(sweep.points, sweep.points_before);
    sweep.share = share;
    for (int k = 0; k < sweep.points.size; k++)
        sweep.points.at(k) = between(sweep.start[k], sweep.end[k], share);
    const Vec *points = sweep.points.data;
    move_to(sweep.parts, points);
    swap(sweep.cloth, sweep.cloth_before);
    put_in_lanes(cloth, vertices, sweep.cloth);
    Array<LaneVec> ends = sweep.cloth;
    if (watch.velocities) {
        ends = work.room<LaneVec>(collider.blocks());
        put_in_lanes(watch.velocities, vertices, ends);
        for (int block = 0; block < ends.size; block++)
            ends.at(block) = sweep.cloth.at(block) + (Lanes{} + watch.seconds) * ends.at(block);
    }
    for (int part = 0; part < collider.parts; part++) {
        RigidMotion since = part_motion(collider, part, sweep.points_before.data, points);
        RigidMotion way =
            part_motion(collider, part, sweep.start, watch.interval > 0 ? sweep.end : nullptr);
        float *clear = sweep.before.clear + part * vertices;
        for (int block = 0; block < collider.blocks(); block++) {
            unsigned touching = collider.touching.at(part * collider.blocks() + block);
            if (!touching) continue;
            Lanes closer = approach(since, sweep.cloth_before.at(block), sweep.cloth.at(block));
            Lanes fastest = SPARE * approach(way, sweep.cloth.at(block), ends.at(block)) +
                            watch.seconds * ALERT_SPEED;
            while (touching) {
                int lane = take(touching), k = LANES * block + lane;
                clear[k] -= closer[lane];
                float limit = watch.near[k] + watch.interval * fastest[lane];
                if (clear[k] <= least(watch.reach, limit) + ROUNDED) search.look(part, k);
            }
        }
    }
    return search.count;
}

bool find_penetrated(const Collider &collider, const Vec *body, const Vec *cloth, FittedParts &parts,
                 int32_t *caught) {
    bool any = false;
    move_to(parts, body);
    for (int part = 0; part < collider.parts; part++) {
        Vec low{}, high{};
        bool is_bounded = false;
        for (int vertex = 0; vertex < collider.crossed.size; vertex++) {
            if (!(collider.crossed.at(vertex) >> part & 1)) continue;
            if (!is_bounded) bound(vertices_of(collider, part), body, low, high);
            is_bounded = true;
            Vec point = cloth[vertex];
            if (point.x < low.x || point.y < low.y || point.z < low.z || point.x > high.x || point.y > high.y ||
                point.z > high.z)
                continue;
            float beyond = 0;
            Closest closest = closest_of_part(collider, parts, part, point, DEEPEST, -1, beyond);
            if (closest.face < 0 || dot(closest.away, face_normal(collider.surface, body, closest.face)) >= 0)
                continue;
            caught[vertex] |= 1 << part;
            any = true;
        }
    }
    return any;
}

}  // namespace uvc
