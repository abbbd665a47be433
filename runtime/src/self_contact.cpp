#include "self_contact.h"

namespace uvc {

namespace {

// Cosine of the widest half angle of a cone of normals whose patch is not tested against itself: 75 degrees.
constexpr float LEAST_FLAT = 0.258819045f;

// Speed, m/s, at which cloth is moved out of cloth, and that a pair may gain before it is searched again.
constexpr float PUSH_SPEED = 0.5f, ALERT_SPEED = 1.0f;

// Metres on the wrong side, beyond twice the kept distance, from which a vertex is no longer moved; and the
// same for two edges.
constexpr float LOST = 0.004f, LOST_EDGES = 0.006f;

// Metres below which the direction between two points is not defined.
constexpr float TOUCHING = 1e-6f;

// Squared sine of the angle below which two segments count as parallel.
constexpr float PARALLEL = 1e-6f;

// Instead of the number of a pair of adjacent nodes: they share no vertex; they are two faces that share one.
constexpr int32_t APART = -1, DONE = -2;

int size_of(Node node) { return node.last - node.first; }

// Whether a walk through pairs of nodes goes on with the children of the first.
bool first_is_halved(Node a, Node b) {
    if (a.is_leaf() || b.is_leaf()) return b.is_leaf();
    return size_of(a) >= size_of(b);
}

// Most pairs of faces that a search looks at: so many for each face, or so many in all, whichever is more.
constexpr int MOST_PER_FACE = 64, MOST_NEAR = 1 << 20;

// Most pairs of nodes that are numbered.
constexpr int MOST_WALKED = 1 << 28;

// Numbers the pairs of nodes that a walk meets and whose faces share a vertex, so that the walk knows at once
// which pairs to test by boxes and which by cones.
struct Walk {
    const Surface &surface;
    Array<Box> boxes;
    List<Two> following;
    int walked = 0;

    bool share_vertex(int a, int b) const {
        Face f = surface.faces.at(surface.order.at(surface.nodes.at(a).first));
        Face g = surface.faces.at(surface.order.at(surface.nodes.at(b).first));
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                if (f[i] == g[j]) return true;
        return false;
    }

    bool boxes_touch(int a, int b) const {
        Box x = boxes.at(a), y = boxes.at(b);
        return x.low.x <= y.high.x && y.low.x <= x.high.x && x.low.y <= y.high.y && y.low.y <= x.high.y &&
               x.low.z <= y.high.z && y.low.z <= x.high.z;
    }

    int32_t number(int a, int b) {
        if (walked == MOST_WALKED || !boxes_touch(a, b)) return APART;
        walked++;
        Node x = surface.nodes.at(a), y = surface.nodes.at(b);
        if (x.is_leaf() && y.is_leaf()) return share_vertex(a, b) ? DONE : APART;
        bool halve_a = first_is_halved(x, y);
        int left = halve_a ? number(a + 1, b) : number(a, b + 1);
        int right = halve_a ? number(x.right, b) : number(a, y.right);
        if (left == APART && right == APART) return APART;
        following.add({left, right});
        return following.items.size - 1;
    }
};

// Marks the nodes whose faces are connected by edges.
void find_connected(Sheet &sheet, Arena &arena) {
    const Surface &surface = sheet.surface;
    Arena work;
    int faces = surface.faces.size;
    Array<int32_t> place = work.take<int32_t>(faces), visited = work.take<int32_t>(faces);
    Array<int32_t> waiting = work.take<int32_t>(faces + 1);
    for (int k = 0; k < faces; k++) place[surface.order[k]] = k;
    sheet.connected = arena.take<int32_t>(surface.nodes.size);
    for (int node = 0; node < surface.roots[surface.roots.size - 1]; node++) {
        Node n = surface.nodes[node];
        if (n.first == n.last) continue;
        int count = 1;
        waiting[0] = surface.order[n.first];
        visited[waiting[0]] = node + 1;
        for (int head = 0; head < count; head++)
            for (int j = 0; j < 3; j++) {
                int other = surface.neighbours[waiting[head]][j];
                if (other < 0 || visited[other] == node + 1) continue;
                if (place[other] < n.first || place[other] >= n.last) continue;
                visited[other] = node + 1;
                waiting[count++] = other;
            }
        sheet.connected[node] = count == size_of(n);
    }
}

// Cosine of the half angle of a cone around an axis that holds another; -1 from a quarter turn on.
float widened(Cone cone, Vec axis) {
    float along = clamp(dot(axis, cone.axis), -1, 1);
    float sine = root(most(1 - cone.cosine * cone.cosine, 0.0f));
    float cosine = along * cone.cosine - root(1 - along * along) * sine;
    return along > 0 && cone.cosine > 0 && cosine > 0 ? cosine : -1;
}

void fit_cones(const Sheet &sheet, const Vec *positions, Array<Cone> cones) {
    const Surface &surface = sheet.surface;
    for (int k = surface.roots[surface.roots.size - 1] - 1; k >= 0; k--) {
        Node node = surface.nodes.at(k);
        if (node.is_leaf()) {
            if (node.first < node.last)
                cones.at(k) = {unit(face_normal(surface, positions, surface.order.at(node.first))), 1};
            continue;
        }
        Cone left = cones.at(k + 1), right = cones.at(node.right);
        Vec axis = unit(left.axis + right.axis);
        cones.at(k) = {axis, least(widened(left, axis), widened(right, axis))};
    }
}

// Whether two nodes stay farther apart than margin, m, along an axis for an interval, s.
bool are_apart(const SelfContact &contact, int a, int b, float margin, float interval) {
    const Box &x = contact.boxes.at(a), &y = contact.boxes.at(b);
    const Box &u = contact.speeds.at(a), &v = contact.speeds.at(b);
    auto along = [&](float x_low, float x_high, float y_low, float y_high, float u_low, float u_high,
                     float v_low, float v_high) {
        return x_low > y_high + margin + interval * most(v_high - u_low, 0.0f) ||
               y_low > x_high + margin + interval * most(u_high - v_low, 0.0f);
    };
    return along(x.low.x, x.high.x, y.low.x, y.high.x, u.low.x, u.high.x, v.low.x, v.high.x) ||
           along(x.low.y, x.high.y, y.low.y, y.high.y, u.low.y, u.high.y, v.low.y, v.high.y) ||
           along(x.low.z, x.high.z, y.low.z, y.high.z, u.low.z, u.high.z, v.low.z, v.high.z);
}

// Greatest speed, m/s, of a part of one node relative to a part of the other.
float relative_speed(const SelfContact &contact, int a, int b) {
    Box u = contact.speeds.at(a), v = contact.speeds.at(b);
    Vec one = u.high - v.low, other = v.high - u.low;
    return length({most(one.x, other.x), most(one.y, other.y), most(one.z, other.z)});
}

// Whether two adjacent nodes are one patch, all normals within an angle of cosine `flat`.
bool is_one_patch(const Sheet &sheet, Array<Cone> cones, int a, int b, float flat) {
    Cone x = cones.at(a), y = cones.at(b);
    if (!sheet.connected.at(a) || !sheet.connected.at(b) || x.cosine < flat || y.cosine < flat) return false;
    Vec axis = unit(x.axis + y.axis);
    return least(widened(x, axis), widened(y, axis)) >= flat;
}

// Whether face g is farther than margin from the plane of face f, all on one side.
bool is_off_plane(const Surface &surface, const Vec *positions, int f, Vec normal, int g, float margin) {
    Vec on_plane = positions[surface.faces.at(f).a];
    Face face = surface.faces.at(g);
    float a = dot(positions[face.a] - on_plane, normal), b = dot(positions[face.b] - on_plane, normal);
    float c = dot(positions[face.c] - on_plane, normal);
    return least(least(a, b), c) > margin || most(most(a, b), c) < -margin;
}

// Puts the pairs of nodes of single faces that may be near into `leaves`. Returns false if there are too many.
bool walk_pairs(const Sheet &sheet, SelfContact &contact, const Vec *positions, float margin, float interval,
                float flat) {
    struct Waiting {
        int32_t a, b, pair;
    };
    const Surface &surface = sheet.surface;
    List<Waiting> stack;
    int pieces = surface.roots.size - 1;
    for (int i = 0; i < pieces; i++)
        for (int j = i; j < pieces; j++)
            if (!sheet.apart.at(i * pieces + j)) stack.add({surface.roots.at(i), surface.roots.at(j), APART});
    contact.leaves.clear();
    int limit = most(MOST_NEAR, MOST_PER_FACE * surface.faces.size);
    while (stack.items.size > 0) {
        if (contact.leaves.items.size > limit) return false;
        Waiting w = stack.items[--stack.items.size];
        Node x = surface.nodes.at(w.a), y = surface.nodes.at(w.b);
        if (w.a == w.b) {
            if (x.is_leaf() || (sheet.connected.at(w.a) && contact.cones.at(w.a).cosine > flat)) continue;
            stack.add({w.a + 1, w.a + 1, APART});
            stack.add({x.right, x.right, APART});
            int half = sheet.halves.at(w.a);
            if (half != DONE) stack.add({w.a + 1, x.right, half});
            continue;
        }
        // Nodes that share a vertex are not apart, and those that do not are no one patch.
        if (w.pair == APART ? are_apart(contact, w.a, w.b, margin, interval)
                            : is_one_patch(sheet, contact.cones, w.a, w.b, flat))
            continue;
        if (!x.is_leaf() || !y.is_leaf()) {
            bool halve_a = first_is_halved(x, y);
            Two next = w.pair == APART ? Two{APART, APART} : sheet.following.at(w.pair);
            int left = halve_a ? w.a + 1 : w.b + 1, right = halve_a ? x.right : y.right;
            if (next.first != DONE) stack.add({halve_a ? left : w.a, halve_a ? w.b : left, next.first});
            if (next.second != DONE) stack.add({halve_a ? right : w.a, halve_a ? w.b : right, next.second});
            continue;
        }
        int f = surface.order.at(x.first), g = surface.order.at(y.first);
        float watched = margin + interval * relative_speed(contact, w.a, w.b);
        if (!is_off_plane(surface, positions, f, contact.cones.at(w.a).axis, g, watched) &&
            !is_off_plane(surface, positions, g, contact.cones.at(w.b).axis, f, watched))
            contact.leaves.add({w.a, w.b});
    }
    return true;
}

// Whether two vertices are one, or the ends of an edge.
bool in_ring(const Rings &rings, int vertex, int other) {
    if (vertex == other) return true;
    for (int k = rings.starts.at(vertex); k < rings.starts.at(vertex + 1); k++)
        if (rings.ring.at(k) == other) return true;
    return false;
}

// Adds the vertices that face f stands for and that are within margin of face g.
void find_points(const Sheet &sheet, const Vec *positions, int f, int g, float margin,
                 List<PointPair> &points) {
    Face owner = sheet.surface.faces.at(f), face = sheet.surface.faces.at(g);
    Vec a = positions[face.a], b = positions[face.b], c = positions[face.c];
    Vec normal = unit(cross(b - a, c - a));
    for (int corner = 0; corner < 3; corner++) {
        if (!(sheet.owned.at(f) >> corner & 1)) continue;
        int vertex = owner[corner];
        Vec point = positions[vertex];
        float height = dot(point - a, normal);
        if (absolute(height) > margin) continue;
        if (in_ring(sheet.rings, vertex, face.a) || in_ring(sheet.rings, vertex, face.b) ||
            in_ring(sheet.rings, vertex, face.c))
            continue;
        Vec away = point - weighted(closest_barycentrics(point, a, b, c), a, b, c);
        if (dot(away, away) <= margin * margin) points.add({{vertex, g}, height >= 0 ? 1.0f : -1.0f});
    }
}

// Closest points p0 + s (p1 - p0) and q0 + t (q1 - q0) of two segments: s, t, and their difference.
Vec closest_on_segments(Vec p0, Vec p1, Vec q0, Vec q1, float &s, float &t) {
    Vec along_p = p1 - p0, along_q = q1 - q0, apart = p0 - q0;
    float a = dot(along_p, along_p), e = dot(along_q, along_q), b = dot(along_p, along_q);
    float c = dot(along_p, apart), f = dot(along_q, apart), slant = a * e - b * b;
    s = slant > PARALLEL * a * e ? clamp((b * f - c * e) / slant, 0, 1) : 0.5f;
    t = (b * s + f) / (e + TINY);
    if (t < 0) {
        t = 0;
        s = clamp(-c / (a + TINY), 0, 1);
    } else if (t > 1) {
        t = 1;
        s = clamp((b - c) / (a + TINY), 0, 1);
    }
    return (p0 + s * along_p) - (q0 + t * along_q);
}

Vec between_edges(const Sheet &sheet, const Vec *positions, Two two, float &s, float &t) {
    Two p = sheet.edges.at(two.first), q = sheet.edges.at(two.second);
    return closest_on_segments(positions[p.first], positions[p.second], positions[q.first],
                               positions[q.second], s, t);
}

bool separate(float a, float b, float c, float d, float margin) {
    return least(a, b) > most(c, d) + margin || least(c, d) > most(a, b) + margin;
}

// Adds the edges that faces f and g stand for and that are within margin of each other.
void find_edges(const Sheet &sheet, const Vec *positions, int f, int g, float margin, List<EdgePair> &edges) {
    for (int i = 0; i < 3; i++) {
        if (!(sheet.owned.at(f) >> (3 + i) & 1)) continue;
        int first = sheet.face_edges.at(f)[i];
        Two p = sheet.edges.at(first);
        Vec p0 = positions[p.first], p1 = positions[p.second];
        for (int j = 0; j < 3; j++) {
            if (!(sheet.owned.at(g) >> (3 + j) & 1)) continue;
            int second = sheet.face_edges.at(g)[j];
            Two q = sheet.edges.at(second);
            Vec q0 = positions[q.first], q1 = positions[q.second];
            if (separate(p0.x, p1.x, q0.x, q1.x, margin) || separate(p0.y, p1.y, q0.y, q1.y, margin) ||
                separate(p0.z, p1.z, q0.z, q1.z, margin))
                continue;
            if (in_ring(sheet.rings, p.first, q.first) || in_ring(sheet.rings, p.first, q.second) ||
                in_ring(sheet.rings, p.second, q.first) || in_ring(sheet.rings, p.second, q.second))
                continue;
            float s, t;
            Vec apart = closest_on_segments(p0, p1, q0, q1, s, t);
            if (dot(apart, apart) > margin * margin) continue;
            edges.add({{first, second}, (1 / (length(apart) + TINY)) * apart});
        }
    }
}

// Orders pairs by their first index: where each of `count` begins, and the order.
template <class Pair> void group(Array<Pair> pairs, int count, List<int32_t> &starts, List<int32_t> &order) {
    starts.clear();
    order.clear();
    for (int k = 0; k < count + 2; k++) starts.add(0);
    for (int k = 0; k < pairs.size; k++) order.add(0);
    int32_t *first = starts.items.data;
    for (const Pair &pair : pairs) first[pair.two.first + 2]++;
    for (int k = 0; k <= count; k++) first[k + 1] += first[k];
    for (int k = 0; k < pairs.size; k++) order.items[first[pairs[k].two.first + 1]++] = k;
}

// Gives pairs the sides that they had before.
template <class Pair, class Keep>
void remember(Array<Pair> pairs, Array<Pair> before, int count, SelfContact &contact, Keep keep) {
    group(before, count, contact.starts, contact.order);
    for (Pair &pair : pairs)
        for (int k = contact.starts.items[pair.two.first]; k < contact.starts.items[pair.two.first + 1]; k++) {
            const Pair &old = before[contact.order.items[k]];
            if (old.two.second == pair.two.second) keep(pair, old);
        }
}

void wait_for_none(List<int32_t> &wait, int count) {
    wait.clear();
    for (int k = 0; k < count; k++) wait.add(0);
}

// Four vertices, and their shares of a relative motion.
struct Four {
    int32_t corners[4];
    float shares[4];
};

Vec relative(const Vec *velocities, const Four &four) {
    Vec total{};
    for (int j = 0; j < 4; j++) total += four.shares[j] * velocities[four.corners[j]];
    return total;
}

// Substeps in which a pair with a gap, m, cannot touch.
int until(float gap, Vec motion, float step) {
    return (int)least(1e6f, gap / (2 * step * (length(motion) + ALERT_SPEED)));
}

// Moves four vertices apart along a normal by a negative gap, and stops their approach.
void push_apart(const Four &four, Vec normal, float gap, Vec *positions, Vec *velocities,
                const Particles &particles, float step) {
    float light = 0;
    for (int j = 0; j < 4; j++)
        light += four.shares[j] * four.shares[j] * particles.inverse_mass.at(four.corners[j]);
    Vec motion = relative(velocities, four);
    float approach = dot(motion, normal), shift = least(-gap, PUSH_SPEED * step) / light;
    float impulse = most(-approach, 0.0f) / light;
    Vec along = motion - approach * normal;
    float speed = length(along);
    float friction =
        0.5f * (particles.friction.at(four.corners[0]) + particles.friction.at(four.corners[3]));
    float slowed = least(friction * impulse, speed / light) / (speed + TINY);
    for (int j = 0; j < 4; j++) {
        int vertex = four.corners[j];
        float share = four.shares[j] * particles.inverse_mass.at(vertex);
        positions[vertex] += (shift * share) * normal;
        velocities[vertex] += (impulse * share) * normal + (-slowed * share) * along;
    }
}

int resolve_point(const Sheet &sheet, PointPair &pair, Vec *positions, Vec *velocities,
                  const Particles &particles, float radius, float step) {
    Face face = sheet.surface.faces.at(pair.two.second);
    Vec point = positions[pair.two.first];
    Vec a = positions[face.a], b = positions[face.b], c = positions[face.c];
    Vec normal = pair.side * unit(cross(b - a, c - a));
    Vec weights = closest_barycentrics(point, a, b, c), away = point - weighted(weights, a, b, c);
    float height = dot(point - a, normal), distance = length(away);
    bool inside = weights.x > 0 && weights.y > 0 && weights.z > 0;
    float gap = (inside ? height : distance) - radius;
    Four four{{pair.two.first, face.a, face.b, face.c}, {1, -weights.x, -weights.y, -weights.z}};
    if (gap >= 0) return until(gap, relative(velocities, four), step);
    if (inside) {
        if (gap < -2 * radius - LOST) return 0;
    } else {
        // Beside a face, the side of a vertex is not defined.
        if (height < 0 || distance < TOUCHING) return 0;
        normal = (1 / distance) * away;
    }
    push_apart(four, normal, gap, positions, velocities, particles, step);
    return 0;
}

int resolve_edges(const Sheet &sheet, EdgePair &pair, Vec *positions, Vec *velocities,
                  const Particles &particles, float radius, float step) {
    float s, t;
    Vec apart = between_edges(sheet, positions, pair.two, s, t);
    float distance = length(apart);
    bool crossed = dot(apart, pair.direction) < 0;
    Two p = sheet.edges.at(pair.two.first), q = sheet.edges.at(pair.two.second);
    Four four{{p.first, p.second, q.first, q.second}, {1 - s, s, t - 1, -t}};
    if (!crossed) {
        if (distance > TOUCHING) pair.direction = (1 / distance) * apart;
        if (distance >= radius) return until(distance - radius, relative(velocities, four), step);
    }
    if (s <= 0 || s >= 1 || t <= 0 || t >= 1 || (crossed && distance > LOST_EDGES)) return 0;
    Vec normal = pair.direction;
    if (crossed) {
        if (distance > TOUCHING) normal = (-1 / distance) * apart;
        distance = -distance;
    }
    push_apart(four, normal, distance - radius, positions, velocities, particles, step);
    return 0;
}

}  // namespace

Sheet read_sheet(const Sections &sections, Arena &arena, Failure &failure) {
    Sheet sheet{};
    Array<float> rest = read_floats(sections, "cloth.rest", -1, 3, arena, failure);
    int vertices = rest.size / 3;
    Array<int32_t> corners = read_faces(sections, "sheet.faces", vertices, arena, failure);
    int faces = corners.size / 3;
    Array<int32_t> starts = read_integers(sections, "sheet.starts", -1, 1, arena, failure);
    starts = read_starts(sections, "sheet.starts", most(starts.size - 1, 0), faces, arena, failure);
    int pieces = most(starts.size - 1, 0);
    Array<int32_t> edges = read_indices(sections, "sheet.edges", -1, 2, 0, vertices, arena, failure);
    sheet.edges = {reinterpret_cast<Two *>(edges.data), edges.size / 2};
    sheet.owned = read_integers(sections, "sheet.owned", faces, 1, arena, failure);
    Array<int32_t> face_edges =
        read_indices(sections, "sheet.face_edges", faces, 3, 0, edges.size / 2, arena, failure);
    sheet.face_edges = {reinterpret_cast<Face *>(face_edges.data), faces};
    sheet.apart = read_integers(sections, "sheet.apart", pieces, pieces, arena, failure);
    sheet.spacing = read_number(sections, "sheet.spacing", failure);
    for (int piece = 0; piece < pieces && !failure.failed; piece++)
        if (starts[piece] == starts[piece + 1]) failure.say("piece %d of the cloth has no faces", piece);
    if (failure.failed) return {};
    Array<Face> triangles{reinterpret_cast<Face *>(corners.data), faces};
    Vec *points = reinterpret_cast<Vec *>(rest.data);
    sheet.surface = make_surface(points, vertices, triangles, starts, 1, arena);
    sheet.rings = vertex_rings(triangles, vertices, arena);
    find_connected(sheet, arena);
    Arena work;
    Walk walk{sheet.surface, work.take<Box>(sheet.surface.nodes.size), {}};
    for (int piece = 0; piece < pieces; piece++) fit_boxes(sheet.surface, piece, points, walk.boxes);
    sheet.halves = arena.take<int32_t>(sheet.surface.nodes.size);
    for (int k = 0; k < sheet.surface.roots[pieces]; k++)
        if (!sheet.surface.nodes[k].is_leaf())
            sheet.halves[k] = walk.number(k + 1, sheet.surface.nodes[k].right);
    if (walk.walked == MOST_WALKED) failure.say("the cloth of the outfit lies all in one place");
    sheet.following = arena.copy(walk.following.items);
    return sheet;
}

bool find_pairs(const Sheet &sheet, const Vec *positions, const Vec *velocities, float margin, float interval,
                SelfContact &contact) {
    const Surface &surface = sheet.surface;
    float flat = most(margin / sheet.spacing, LEAST_FLAT);
    for (int piece = 0; piece + 1 < surface.roots.size; piece++) {
        fit_boxes(surface, piece, positions, contact.boxes);
        fit_boxes(surface, piece, velocities, contact.speeds);
    }
    fit_cones(sheet, positions, contact.cones);
    if (!walk_pairs(sheet, contact, positions, margin, interval, flat)) return false;
    swap(contact.points, contact.points_before);
    swap(contact.edges, contact.edges_before);
    contact.points.clear();
    contact.edges.clear();
    for (Two leaf : contact.leaves.items) {
        int f = surface.order.at(surface.nodes.at(leaf.first).first);
        int g = surface.order.at(surface.nodes.at(leaf.second).first);
        float watched = margin + interval * relative_speed(contact, leaf.first, leaf.second);
        find_points(sheet, positions, f, g, watched, contact.points);
        find_points(sheet, positions, g, f, watched, contact.points);
        find_edges(sheet, positions, f, g, watched, contact.edges);
    }
    remember(contact.points.items, contact.points_before.items, surface.vertices, contact,
             [](PointPair &pair, const PointPair &old) { pair.side = old.side; });
    remember(contact.edges.items, contact.edges_before.items, sheet.edges.size, contact,
             [](EdgePair &pair, const EdgePair &old) { pair.direction = old.direction; });
    wait_for_none(contact.point_wait, contact.points.items.size);
    wait_for_none(contact.edge_wait, contact.edges.items.size);
    return true;
}

void drop_caught(const Sheet &sheet, const Collider &collider, const int32_t *caught, SelfContact &contact) {
    auto pass = [&](int one, int other) {
        return (caught[one] & collider.touches.at(other)) || (caught[other] & collider.touches.at(one));
    };
    int kept = 0;
    for (const PointPair &pair : contact.points.items) {
        Face face = sheet.surface.faces.at(pair.two.second);
        int vertex = pair.two.first;
        if (!pass(vertex, face.a) && !pass(vertex, face.b) && !pass(vertex, face.c))
            contact.points.items[kept++] = pair;
    }
    contact.points.items.size = kept;
    kept = 0;
    for (const EdgePair &pair : contact.edges.items) {
        Two p = sheet.edges.at(pair.two.first), q = sheet.edges.at(pair.two.second);
        if (!pass(p.first, q.first) && !pass(p.first, q.second) && !pass(p.second, q.first) &&
            !pass(p.second, q.second))
            contact.edges.items[kept++] = pair;
    }
    contact.edges.items.size = kept;
}

void resolve_pairs(const Sheet &sheet, SelfContact &contact, Vec *positions, Vec *velocities,
                   const Particles &particles, float radius, float step) {
    for (int k = 0; k < contact.points.items.size; k++) {
        int32_t &wait = contact.point_wait.items.at(k);
        wait = wait > 0 ? wait - 1
                        : resolve_point(sheet, contact.points.items.at(k), positions, velocities, particles,
                                        radius, step);
    }
    for (int k = 0; k < contact.edges.items.size; k++) {
        int32_t &wait = contact.edge_wait.items.at(k);
        wait = wait > 0 ? wait - 1
                        : resolve_edges(sheet, contact.edges.items.at(k), positions, velocities, particles,
                                        radius, step);
    }
}

}  // namespace uvc
