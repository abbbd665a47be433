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
void find_vertices(Collider &collider, Array<int32_t> starts, Arena &arena) {
    Arena work;
    Array<int32_t> seen = work.take<int32_t>(collider.surface.vertices);
    Array<int32_t> vertices = work.take<int32_t>(3 * collider.surface.faces.size);
    collider.vertex_starts = arena.take<int32_t>(collider.parts + 1);
    int count = 0;
    for (int part = 0; part < collider.parts; part++) {
        for (int k = starts[part]; k < starts[part + 1]; k++)
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

PartWay part_way(const Collider &collider, int part, const Vec *start, const Vec *end) {
    int first = collider.vertex_starts.at(part), last = collider.vertex_starts.at(part + 1);
    Vec total{};
    for (int k = first; k < last; k++) {
        int vertex = collider.vertices.at(k);
        total += end[vertex] - start[vertex];
    }
    PartWay way{(1.0f / (float)most(last - first, 1)) * total, 0};
    float squared = 0;
    for (int k = first; k < last; k++) {
        int vertex = collider.vertices.at(k);
        Vec apart = end[vertex] - start[vertex] - way.mean;
        squared = most(squared, dot(apart, apart));
    }
    way.most = root(squared);
    return way;
}

// Metres by which cloth and a part approach in a share of the frame at most.
UVC_INLINE float approach(PartWay part, Vec way, float share) {
    return length(way - share * part.mean) + share * part.most + ROUNDED;
}

// Distance of a point from a face, negative inside, and the speed, m/s, at which it moves past it.
UVC_INLINE float past(const Surface &surface, const Passage &passage, const Closest &closest, Vec velocity,
                      float rate, float &slip) {
    Face f = surface.faces.at(closest.face);
    Vec began = weighted(closest.weights, passage.start[f.a], passage.start[f.b], passage.start[f.c]);
    Vec ends = weighted(closest.weights, passage.end[f.a], passage.end[f.b], passage.end[f.c]);
    slip = length(velocity - rate * (ends - began));
    bool outside = dot(closest.away, face_normal(surface, passage.points.data, closest.face)) > 0;
    float distance = length(closest.away);
    return outside ? distance : -distance;
}

}  // namespace

Collider read_collider(const Sections &sections, const char *touches, const char *crossed, Arena &arena,
                       Failure &failure) {
    Collider collider{};
    Array<float> rest = read_floats(sections, "collider.rest", -1, 3, arena, failure);
    int vertices = rest.size / 3;
    Array<int32_t> corners = read_faces(sections, "collider.faces", vertices, arena, failure);
    Array<int32_t> starts = read_integers(sections, "collider.starts", -1, 1, arena, failure);
    int faces = corners.size / 3;
    starts = read_starts(sections, "collider.starts", most(starts.size - 1, 0), faces, arena, failure);
    collider.touches = read_integers(sections, touches, -1, 1, arena, failure);
    collider.crossed = crossed ? read_integers(sections, crossed, collider.touches.size, 1, arena, failure)
                               : arena.take<int32_t>(collider.touches.size);
    if (failure.failed) return {};
    collider.parts = starts.size - 1;
    if (collider.parts > 31) failure.say("the collider has %d parts, at most 31 are possible", collider.parts);
    Array<Face> triangles{reinterpret_cast<Face *>(corners.data), faces};
    collider.surface =
        make_surface(reinterpret_cast<Vec *>(rest.data), vertices, triangles, starts, 4, arena);
    find_vertices(collider, starts, arena);
    return collider;
}

Passage begin_passage(const Collider &collider, const Vec *start, const Vec *end, const Vec *cloth,
                      Searched before, int turn, int renewal, Arena &work) {
    int rows = collider.parts * collider.touches.size;
    Passage passage{};
    passage.start = start;
    passage.end = end;
    passage.points = work.take<Vec>(collider.surface.vertices);
    passage.cloth = work.copy(cloth, collider.touches.size);
    passage.boxes = work.take<Box>(collider.surface.nodes.size);
    passage.fitted = work.take<int32_t>(collider.parts);
    passage.hints = work.take<int32_t>(rows);
    for (int32_t &hint : passage.hints) hint = -1;
    passage.before = before;
    passage.at = work.take<float>(rows);
    passage.ways = work.take<PartWay>(collider.parts);
    for (int part = 0; part < collider.parts; part++)
        passage.ways[part] = part_way(collider, part, start, end);
    passage.turn = turn;
    passage.renewal = renewal;
    return passage;
}

void end_passage(const Collider &collider, Passage &passage, const Vec *cloth) {
    int vertices = collider.touches.size;
    float left = 1 - passage.share;
    for (int part = 0; part < collider.parts; part++)
        for (int k = 0; k < vertices; k++)
            passage.before.clear[part * vertices + k] -=
                approach(passage.ways.at(part), cloth[k] - passage.cloth.at(k), left);
    memcpy(passage.before.faces, passage.hints.data, sizeof(int32_t) * (size_t)passage.hints.size);
}

int find_near(const Collider &collider, Passage &passage, float share, const Vec *cloth, const Watch &watch,
              Array<Near> found) {
    const Surface &surface = collider.surface;
    const Vec *points = passage.points.data;
    int count = 0, vertices = collider.touches.size;
    bool is_first = passage.searches == 0;
    int search = ++passage.searches;
    float since = share - passage.share, rate = 1 / watch.seconds;
    passage.share = share;
    for (int k = 0; k < surface.vertices; k++)
        passage.points.at(k) = between(passage.start[k], passage.end[k], share);
    for (int vertex = 0; vertex < vertices; vertex++) {
        Vec point = cloth[vertex], way = point - passage.cloth.at(vertex);
        Vec velocity = watch.velocities ? watch.velocities[vertex] : Vec{};
        float near = watch.near[vertex];
        int touches = collider.touches.at(vertex);
        for (int part = 0; part < collider.parts; part++) {
            if (!(touches >> part & 1)) continue;
            int row = part * vertices + vertex;
            PartWay moves = passage.ways.at(part);
            float clear = passage.before.clear[row] - approach(moves, way, since);
            passage.before.clear[row] = clear;
            float closing = length(watch.seconds * velocity - moves.mean) + moves.most;
            float fastest = SPARE * closing + watch.seconds * ALERT_SPEED;
            if (clear > least(watch.reach, near + watch.interval * fastest) + ROUNDED) continue;
            int known = is_first ? passage.before.faces[row] : -1, guess = passage.hints.at(row);
            if (is_first && (vertex + passage.turn) % passage.renewal > 0) guess = known;
            Closest closest{-1, {}, {}};
            float distance = 0, slip = 0;
            bool is_followed = false;
            if (guess >= 0) {
                closest = walk(surface, points, guess, point, FOLLOWED);
                distance = past(surface, passage, closest, velocity, rate, slip);
                bool is_recent = !is_first && share - passage.at.at(row) < LONGEST * rate;
                float limit =
                    is_recent ? watch.reach : least(watch.reach, distance > 0 ? watch.followed : CLOSE);
                is_followed = dot(closest.away, closest.away) < limit * limit;
            }
            passage.before.clear[row] = 0;
            if (!is_followed) {
                if (passage.fitted.at(part) != search) fit_boxes(surface, part, points, passage.boxes);
                passage.fitted.at(part) = search;
                float beyond = 0;
                int best = closest.face >= 0 ? closest.face : known;
                closest =
                    closest_face(surface, part, points, passage.boxes, point, watch.reach, best, beyond);
                passage.at.at(row) = share;
                if (closest.face >= 0) distance = past(surface, passage, closest, velocity, rate, slip);
                passage.before.clear[row] = closest.face >= 0 ? most(distance, 0.0f) : root(beyond);
            }
            passage.hints.at(row) = closest.face;
            float touching = near + watch.interval * watch.seconds * (SPARE * slip + ALERT_SPEED);
            if (closest.face >= 0 && distance <= touching) found.at(count++) = {vertex, closest.face};
        }
        passage.cloth.at(vertex) = point;
    }
    return count;
}

bool find_caught(const Collider &collider, const Vec *body, const Vec *cloth, Array<Box> boxes,
                 int32_t *caught) {
    const Surface &surface = collider.surface;
    bool any = false;
    for (int part = 0; part < collider.parts; part++) {
        bool is_fitted = false;
        for (int vertex = 0; vertex < collider.crossed.size; vertex++) {
            if (!(collider.crossed.at(vertex) >> part & 1)) continue;
            if (!is_fitted) fit_boxes(surface, part, body, boxes);
            is_fitted = true;
            Box box = boxes.at(surface.roots.at(part));
            Vec point = cloth[vertex];
            if (point.x < box.low.x || point.y < box.low.y || point.z < box.low.z || point.x > box.high.x ||
                point.y > box.high.y || point.z > box.high.z)
                continue;
            float beyond = 0;
            Closest closest = closest_face(surface, part, body, boxes, point, DEEPEST, -1, beyond);
            if (closest.face < 0 || dot(closest.away, face_normal(surface, body, closest.face)) >= 0) continue;
            caught[vertex] |= 1 << part;
            any = true;
        }
    }
    return any;
}

}  // namespace uvc
