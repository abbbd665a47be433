#include "self_contact.h"

#include "lanes.h"

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
constexpr int MOST_PER_FACE = 256, MOST_NEAR = 1 << 20;

// Most pairs of nodes that are numbered.
constexpr int MOST_WALKED = 1 << 28;

// Numbers the pairs of nodes that a walk meets and whose faces share a vertex, so that the walk knows at once
// which pairs to test by boxes and which by cones.
struct AdjacentNodePairs {
    const BoxTree &tree;
    Array<Box> boxes;
    List<IndexPair> following;
    int walked = 0;

    bool share_vertex(int a, int b) const {
        Face f = tree.faces.at(tree.order.at(tree.nodes.at(a).first));
        Face g = tree.faces.at(tree.order.at(tree.nodes.at(b).first));
        return f.has(g.a) || f.has(g.b) || f.has(g.c);
    }

    bool boxes_touch(int a, int b) const {
        Box x = boxes.at(a), y = boxes.at(b);
        return !any((x.low > y.high) | (y.low > x.high));
    }

    int32_t number(int a, int b) {
        if (walked == MOST_WALKED || !boxes_touch(a, b)) return APART;
        walked++;
        Node x = tree.nodes.at(a), y = tree.nodes.at(b);
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
void find_connected(ContactMesh &mesh, Arena &arena) {
    const Surface &surface = mesh.surface;
    const BoxTree &tree = mesh.tree;
    Arena work;
    int faces = surface.faces.size;
    Array<int32_t> place = work.take<int32_t>(faces), visited = work.take<int32_t>(faces);
    Array<int32_t> waiting = work.take<int32_t>(faces + 1);
    for (int k = 0; k < faces; k++) place[tree.order[k]] = k;
    mesh.connected = arena.take<int32_t>(tree.nodes.size);
    for (int node = 0; node < tree.roots[tree.roots.size - 1]; node++) {
        Node n = tree.nodes[node];
        if (n.first == n.last) continue;
        int count = 1;
        waiting[0] = tree.order[n.first];
        visited[waiting[0]] = node + 1;
        for (int head = 0; head < count; head++)
            for (int j = 0; j < 3; j++) {
                int other = surface.neighbours[waiting[head]][j];
                if (other < 0 || visited[other] == node + 1) continue;
                if (place[other] < n.first || place[other] >= n.last) continue;
                visited[other] = node + 1;
                waiting[count++] = other;
            }
        mesh.connected[node] = count == size_of(n);
    }
}

// Cosine of the half angle of a cone around an axis that holds another; -1 from a quarter turn on.
float widened(NormalCone cone, Vec axis) {
    float along = clamp(dot(axis, cone.axis), -1, 1);
    float sine = root(most(1 - cone.cosine * cone.cosine, 0.0f));
    float cosine = along * cone.cosine - root(1 - along * along) * sine;
    return along > 0 && cone.cosine > 0 && cosine > 0 ? cosine : -1;
}

void fit_cones(const ContactMesh &mesh, const Vec *positions, Array<NormalCone> cones) {
    const BoxTree &tree = mesh.tree;
    for (int k = tree.roots[tree.roots.size - 1] - 1; k >= 0; k--) {
        Node node = tree.nodes.at(k);
        if (node.is_leaf()) {
            if (node.first < node.last)
                cones.at(k) = {unit(face_normal(mesh.surface, positions, tree.order.at(node.first))), 1};
            continue;
        }
        NormalCone left = cones.at(k + 1), right = cones.at(node.right);
        Vec axis = unit(left.axis + right.axis);
        cones.at(k) = {axis, least(widened(left, axis), widened(right, axis))};
    }
}

// Whether two nodes stay farther apart than margin, m, along an axis for an interval, s.
bool are_apart(const SelfContact &contact, int a, int b, float margin, float interval) {
    const Box &x = contact.boxes.at(a), &y = contact.boxes.at(b);
    const Box &u = contact.speeds.at(a), &v = contact.speeds.at(b);
    Four none{};
    FourMask above = x.low > y.high + margin + interval * most(v.high - u.low, none);
    FourMask below = y.low > x.high + margin + interval * most(u.high - v.low, none);
    return any(above | below);
}

// Greatest speed, m/s, of a part of one node relative to a part of the other.
float relative_speed(const SelfContact &contact, int a, int b) {
    Box u = contact.speeds.at(a), v = contact.speeds.at(b);
    Four most_of = most(u.high - v.low, v.high - u.low), squares = most_of * most_of;
    return root(squares[0] + squares[1] + squares[2]);
}

// Whether two adjacent nodes are one patch, all normals within an angle of cosine `flat`.
bool is_one_patch(const ContactMesh &mesh, Array<NormalCone> cones, int a, int b, float flat) {
    NormalCone x = cones.at(a), y = cones.at(b);
    if (!mesh.connected.at(a) || !mesh.connected.at(b) || x.cosine < flat || y.cosine < flat) return false;
    Vec axis = unit(x.axis + y.axis);
    return least(widened(x, axis), widened(y, axis)) >= flat;
}

// Puts the pairs of nodes of single faces that may be near into `leaves`. Returns false if there are too many.
bool walk_pairs(const ContactMesh &mesh, SelfContact &contact, const Vec *positions, float margin,
                float interval, float flat) {
    struct Waiting {
        int32_t a, b, pair;
    };
    const Surface &surface = mesh.surface;
    const BoxTree &tree = mesh.tree;
    List<Waiting> stack;
    int pieces = tree.roots.size - 1;
    for (int i = 0; i < pieces; i++)
        for (int j = i; j < pieces; j++)
            if (!mesh.apart.at(i * pieces + j)) stack.add({tree.roots.at(i), tree.roots.at(j), APART});
    contact.leaves.clear();
    int limit = most(MOST_NEAR, MOST_PER_FACE * surface.faces.size);
    while (stack.items.size > 0) {
        if (contact.leaves.items.size > limit) return false;
        Waiting w = stack.items[--stack.items.size];
        Node x = tree.nodes.at(w.a), y = tree.nodes.at(w.b);
        if (w.a == w.b) {
            if (x.is_leaf() || (mesh.connected.at(w.a) && contact.cones.at(w.a).cosine > flat)) continue;
            stack.add({w.a + 1, w.a + 1, APART});
            stack.add({x.right, x.right, APART});
            int half = mesh.halves.at(w.a);
            stack.add({w.a + 1, x.right, half});
            continue;
        }
        // Nodes that share a vertex are not apart, and those that do not are no one patch.
        if (w.pair == APART ? are_apart(contact, w.a, w.b, margin, interval)
                            : is_one_patch(mesh, contact.cones, w.a, w.b, flat))
            continue;
        if (!x.is_leaf() || !y.is_leaf()) {
            bool halve_a = first_is_halved(x, y);
            IndexPair next = w.pair == APART ? IndexPair{APART, APART} : mesh.following.at(w.pair);
            int left = halve_a ? w.a + 1 : w.b + 1, right = halve_a ? x.right : y.right;
            stack.add({halve_a ? left : w.a, halve_a ? w.b : left, next.first});
            stack.add({halve_a ? right : w.a, halve_a ? w.b : right, next.second});
            continue;
        }
        int f = tree.order.at(x.first), g = tree.order.at(y.first);
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

// Closest points p0 + s (p1 - p0) and q0 + t (q1 - q0) of two segments: s, t, and their difference.
template <class F>
UVC_INLINE Vector<F> closest_on_segments(Vector<F> p0, Vector<F> p1, Vector<F> q0, Vector<F> q1, F &s, F &t) {
    Vector<F> along_p = p1 - p0, along_q = q1 - q0, apart = p0 - q0;
    F a = dot(along_p, along_p), e = dot(along_q, along_q), b = dot(along_p, along_q);
    F c = dot(along_p, apart), f = dot(along_q, apart), slant = a * e - b * b;
    s = choose(slant > PARALLEL * a * e, clamp((b * f - c * e) / slant, 0, 1), F{} + 0.5f);
    t = (b * s + f) / (e + TINY);
    s = choose(t < 0.0f, clamp(-c / (a + TINY), 0, 1), choose(t > 1.0f, clamp((b - c) / (a + TINY), 0, 1), s));
    t = clamp(t, 0, 1);
    return (p0 + s * along_p) - (q0 + t * along_q);
}

// Pairs that may be near, eight at a time: a first and a second thing, four vertices, the distance, m, within
// which they count, and whether both are of one piece.
struct Candidates {
    IndexPair pairs[LANES];
    int32_t vertices[4][LANES];
    float margins[LANES];
    bool is_one_piece[LANES];
    int count = 0;

    void add(IndexPair pair, int a, int b, int c, int d, float margin, bool one_piece) {
        pairs[count] = pair;
        is_one_piece[count] = one_piece;
        vertices[0][count] = a;
        vertices[1][count] = b;
        vertices[2][count] = c;
        vertices[3][count] = d;
        margins[count++] = margin;
    }

    // Fills up with the last one, and returns a bit for each.
    unsigned close() {
        unsigned lanes = (1u << count) - 1;
        for (; count < LANES; count++) {
            for (int corner = 0; corner < 4; corner++) vertices[corner][count] = vertices[corner][count - 1];
            margins[count] = margins[count - 1];
        }
        count = 0;
        return lanes;
    }
};

float distance_at_rest(const ContactMesh &mesh, int vertex, Face face) {
    const Vec *rest = mesh.rest.data;
    Vec weights = closest_barycentrics(rest[vertex], rest[face.a], rest[face.b], rest[face.c]);
    return length(rest[vertex] - weighted(weights, rest[face.a], rest[face.b], rest[face.c]));
}

float distance_at_rest(const ContactMesh &mesh, IndexPair p, IndexPair q) {
    const Vec *rest = mesh.rest.data;
    float s, t;
    return length(closest_on_segments(rest[p.first], rest[p.second], rest[q.first], rest[q.second], s, t));
}

bool share_vertex(int vertex, Face face) { return face.has(vertex); }

bool share_vertex(IndexPair p, IndexPair q) {
    return p.first == q.first || p.first == q.second || p.second == q.first || p.second == q.second;
}

// Whether an edge joins the two.
bool are_joined(const Rings &rings, int vertex, Face face) {
    return in_ring(rings, vertex, face.a) || in_ring(rings, vertex, face.b) || in_ring(rings, vertex, face.c);
}

bool are_joined(const Rings &rings, IndexPair p, IndexPair q) {
    return in_ring(rings, p.first, q.first) || in_ring(rings, p.first, q.second) ||
           in_ring(rings, p.second, q.first) || in_ring(rings, p.second, q.second);
}

// Distance, m, that two things of the cloth keep, -1 for those that are never apart: they share a vertex, or an
// edge joins them and they are within the margin at rest.
template <class First, class Second>
float kept_distance(const ContactMesh &mesh, const SelfDistances &distances, bool is_one_piece, First first,
                    Second second) {
    if (!is_one_piece) return distances.radius;
    if (share_vertex(first, second)) return -1;
    float apart = distance_at_rest(mesh, first, second);
    if (apart < distances.radius + distances.margin && are_joined(mesh.rings, first, second)) return -1;
    return most(distances.radius, least(apart, distances.fold_radius));
}

// Keeps those vertices that are within their margin of a face, and not beside it at rest.
void keep_points(const ContactMesh &mesh, const Vec *positions, const SelfDistances &distances,
                 Candidates &some, List<PointPair> &points) {
    if (!some.count) return;
    unsigned lanes = some.close();
    LaneVec a = gather(positions, some.vertices[1]), ap = gather(positions, some.vertices[0]) - a;
    LaneVec ab = gather(positions, some.vertices[2]) - a, ac = gather(positions, some.vertices[3]) - a;
    Lanes v, w, margins = load(some.margins);
    closest_barycentrics(ap, ab, ac, v, w);
    LaneVec away = ap - v * ab - w * ac;
    unsigned above = bits(dot(ap, cross(ab, ac)) >= 0.0f);
    for (lanes &= bits(dot(away, away) <= margins * margins); lanes;) {
        int lane = take(lanes), vertex = some.vertices[0][lane];
        Face face{some.vertices[1][lane], some.vertices[2][lane], some.vertices[3][lane]};
        float radius = kept_distance(mesh, distances, some.is_one_piece[lane], vertex, face);
        if (radius >= 0) points.add({some.pairs[lane], above >> lane & 1 ? 1.0f : -1.0f, radius});
    }
}

// Keeps those edges that are within their margin of another, and not beside it at rest.
void keep_edges(const ContactMesh &mesh, const Vec *positions, const SelfDistances &distances, Candidates &some,
                List<EdgePair> &edges) {
    if (!some.count) return;
    unsigned lanes = some.close();
    Lanes s, t, margins = load(some.margins);
    LaneVec apart =
        closest_on_segments(gather(positions, some.vertices[0]), gather(positions, some.vertices[1]),
                            gather(positions, some.vertices[2]), gather(positions, some.vertices[3]), s, t);
    Lanes squares = dot(apart, apart);
    LaneVec directions = (1.0f / (root(squares) + TINY)) * apart;
    for (lanes &= bits(squares <= margins * margins); lanes;) {
        int lane = take(lanes);
        int p0 = some.vertices[0][lane], p1 = some.vertices[1][lane], q0 = some.vertices[2][lane],
            q1 = some.vertices[3][lane];
        float radius =
            kept_distance(mesh, distances, some.is_one_piece[lane], IndexPair{p0, p1}, IndexPair{q0, q1});
        if (radius >= 0) edges.add({some.pairs[lane], pick(directions, lane), radius});
    }
}

// Finds the pairs of the faces in `leaves`.
void find_in_leaves(const ContactMesh &mesh, const Vec *positions, const SelfDistances &distances,
                    float interval, SelfContact &contact) {
    const BoxTree &tree = mesh.tree;
    Candidates points, edges;
    auto add_corners = [&](int f, int g, float watched, bool one_piece) {
        Face owner = tree.faces.at(f), face = tree.faces.at(g);
        for (int corner = 0; corner < 3; corner++) {
            if (!(mesh.owned.at(f) >> corner & 1)) continue;
            points.add({owner[corner], g}, owner[corner], face.a, face.b, face.c, watched, one_piece);
            if (points.count == LANES) keep_points(mesh, positions, distances, points, contact.points);
        }
    };
    for (IndexPair leaf : contact.leaves.items) {
        int f = tree.order.at(tree.nodes.at(leaf.first).first);
        int g = tree.order.at(tree.nodes.at(leaf.second).first);
        bool one_piece = mesh.pieces.at(f) == mesh.pieces.at(g);
        float watched = (one_piece ? distances.fold_radius : distances.radius) + distances.margin +
                        interval * relative_speed(contact, leaf.first, leaf.second);
        add_corners(f, g, watched, one_piece);
        add_corners(g, f, watched, one_piece);
        for (int i = 0; i < 3; i++) {
            if (!(mesh.owned.at(f) >> (3 + i) & 1)) continue;
            for (int j = 0; j < 3; j++) {
                if (!(mesh.owned.at(g) >> (3 + j) & 1)) continue;
                int first = mesh.face_edges.at(f)[i], second = mesh.face_edges.at(g)[j];
                IndexPair p = mesh.edges.at(first), q = mesh.edges.at(second);
                edges.add({first, second}, p.first, p.second, q.first, q.second, watched, one_piece);
                if (edges.count == LANES) keep_edges(mesh, positions, distances, edges, contact.edges);
            }
        }
    }
    keep_points(mesh, positions, distances, points, contact.points);
    keep_edges(mesh, positions, distances, edges, contact.edges);
}

// Orders pairs by their first index: where each of `count` begins, and the order.
template <class Pair> void group(Array<Pair> pairs, int count, List<int32_t> &starts, List<int32_t> &order) {
    starts.clear();
    order.clear();
    for (int k = 0; k < count + 2; k++) starts.add(0);
    for (int k = 0; k < pairs.size; k++) order.add(0);
    int32_t *first = starts.items.data;
    for (const Pair &pair : pairs) first[pair.indices.first + 2]++;
    for (int k = 0; k <= count; k++) first[k + 1] += first[k];
    for (int k = 0; k < pairs.size; k++) order.items[first[pairs[k].indices.first + 1]++] = k;
}

// Gives pairs the sides that they had before.
template <class Pair, class Keep>
void remember(Array<Pair> pairs, Array<Pair> before, int count, SelfContact &contact, Keep keep) {
    group(before, count, contact.starts, contact.order);
    for (Pair &pair : pairs)
        for (int k = contact.starts.items[pair.indices.first]; k < contact.starts.items[pair.indices.first + 1];
             k++) {
            const Pair &old = before[contact.order.items[k]];
            if (old.indices.second == pair.indices.second) keep(pair, old);
        }
}

void wait_for_none(List<int32_t> &wait, int count) {
    wait.clear();
    for (int k = 0; k < count; k++) wait.add(0);
}

// Four vertices, and their shares of a relative motion.
struct Corners {
    int32_t corners[4];
    float shares[4];
};

Vec relative(const Vec *velocities, const Corners &four) {
    Vec total{};
    for (int j = 0; j < 4; j++) total += four.shares[j] * velocities[four.corners[j]];
    return total;
}

// Moves four vertices apart along a normal by a negative gap, and stops their approach.
void push_apart(const Corners &four, Vec normal, float gap, Vec *positions, Vec *velocities,
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

void resolve_point(const ContactMesh &mesh, const PointPair &pair, Vec *positions, Vec *velocities,
                   const Particles &particles, float step) {
    float radius = pair.radius;
    Face face = mesh.surface.faces.at(pair.indices.second);
    Vec point = positions[pair.indices.first];
    Vec a = positions[face.a], b = positions[face.b], c = positions[face.c];
    Vec normal = pair.side * unit(cross(b - a, c - a));
    Vec weights = closest_barycentrics(point, a, b, c), away = point - weighted(weights, a, b, c);
    float height = dot(point - a, normal), distance = length(away);
    bool inside = weights.x > 0 && weights.y > 0 && weights.z > 0;
    float gap = (inside ? height : distance) - radius;
    if (gap >= 0) return;
    Corners four{{pair.indices.first, face.a, face.b, face.c}, {1, -weights.x, -weights.y, -weights.z}};
    if (inside) {
        if (gap < -2 * radius - LOST) return;
    } else {
        // Beside a face, the side of a vertex is not defined.
        if (height < 0 || distance < TOUCHING) return;
        normal = (1 / distance) * away;
    }
    push_apart(four, normal, gap, positions, velocities, particles, step);
}

void resolve_edges(const ContactMesh &mesh, EdgePair &pair, Vec *positions, Vec *velocities,
                   const Particles &particles, float step) {
    float radius = pair.radius;
    IndexPair p = mesh.edges.at(pair.indices.first), q = mesh.edges.at(pair.indices.second);
    float s, t;
    Vec apart = closest_on_segments(positions[p.first], positions[p.second], positions[q.first],
                                    positions[q.second], s, t);
    float distance = length(apart);
    bool crossed = dot(apart, pair.direction) < 0;
    if (!crossed) {
        if (distance > TOUCHING) pair.direction = (1 / distance) * apart;
        if (distance >= radius) return;
    }
    if (s <= 0 || s >= 1 || t <= 0 || t >= 1 || (crossed && distance > LOST_EDGES)) return;
    Vec normal = pair.direction;
    if (crossed) {
        if (distance > TOUCHING) normal = (-1 / distance) * apart;
        distance = -distance;
    }
    Corners four{{p.first, p.second, q.first, q.second}, {1 - s, s, t - 1, -t}};
    push_apart(four, normal, distance - radius, positions, velocities, particles, step);
}

// Eight pairs that are looked at together, the last one again where there are fewer.
struct PairBatch {
    int32_t pairs[LANES];
    int count;
};

// Substeps in which pairs with a gap, m, cannot touch.
UVC_INLINE LaneMask until(Lanes gap, LaneVec motion, float step) {
    Lanes substeps = gap / (2 * step * (root(dot(motion, motion)) + ALERT_SPEED));
    return __builtin_convertvector(least(substeps, Lanes{} + 1e6f), LaneMask);
}

// Sets the substeps that pairs wait, of those that are apart.
void wait_where(LaneMask is_apart, LaneMask substeps, const PairBatch &batch, Array<int32_t> wait) {
    for (unsigned lanes = bits(is_apart) & ((1u << batch.count) - 1); lanes;) {
        int lane = take(lanes);
        wait.at(batch.pairs[lane]) = substeps[lane];
    }
}

// Looks at eight pairs of a vertex and a face, sets how long those wait that are apart, and returns a bit for
// each that has to be resolved.
unsigned look_at_points(const ContactMesh &mesh, Array<PointPair> pairs, const PairBatch &batch,
                        const Vec *positions, const Vec *velocities, float step, Array<int32_t> wait) {
    int32_t corners[4][LANES];
    float sides[LANES], radii[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        const PointPair &pair = pairs.at(batch.pairs[lane]);
        Face face = mesh.surface.faces.at(pair.indices.second);
        sides[lane] = pair.side;
        radii[lane] = pair.radius;
        corners[0][lane] = pair.indices.first;
        corners[1][lane] = face.a;
        corners[2][lane] = face.b;
        corners[3][lane] = face.c;
    }
    Lanes radius = load(radii);
    LaneVec a = gather(positions, corners[1]), ap = gather(positions, corners[0]) - a;
    LaneVec ab = gather(positions, corners[2]) - a, ac = gather(positions, corners[3]) - a;
    Lanes v, w;
    closest_barycentrics(ap, ab, ac, v, w);
    Lanes u = 1.0f - v - w;
    LaneVec away = ap - v * ab - w * ac, normal = cross(ab, ac);
    Lanes height = load(sides) * dot(ap, normal) / (root(dot(normal, normal)) + TINY);
    Lanes distance = root(dot(away, away));
    LaneMask inside = (u > 0.0f) & (v > 0.0f) & (w > 0.0f);
    Lanes gap = choose(inside, height, distance) - radius;
    LaneVec motion = gather(velocities, corners[0]) - u * gather(velocities, corners[1]) -
                     v * gather(velocities, corners[2]) - w * gather(velocities, corners[3]);
    wait_where(gap >= 0.0f, until(gap, motion, step), batch, wait);
    LaneMask is_side_known = inside ? gap >= -2 * radius - LOST : (height >= 0.0f) & (distance >= TOUCHING);
    // A face without an area leaves no number: it is looked at alone.
    return bits(~(gap >= 0.0f) & (is_side_known | ~(gap < 0.0f)));
}

// The same for pairs of edges, whose directions are renewed.
unsigned look_at_edges(const ContactMesh &mesh, Array<EdgePair> pairs, const PairBatch &batch,
                       const Vec *positions, const Vec *velocities, float step, Array<int32_t> wait) {
    int32_t ends[4][LANES];
    float directions[3][LANES], radii[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        const EdgePair &pair = pairs.at(batch.pairs[lane]);
        IndexPair p = mesh.edges.at(pair.indices.first), q = mesh.edges.at(pair.indices.second);
        ends[0][lane] = p.first;
        ends[1][lane] = p.second;
        ends[2][lane] = q.first;
        ends[3][lane] = q.second;
        radii[lane] = pair.radius;
        directions[0][lane] = pair.direction.x;
        directions[1][lane] = pair.direction.y;
        directions[2][lane] = pair.direction.z;
    }
    Lanes s, t, radius = load(radii);
    LaneVec apart = closest_on_segments(gather(positions, ends[0]), gather(positions, ends[1]),
                                        gather(positions, ends[2]), gather(positions, ends[3]), s, t);
    LaneVec direction = {load(directions[0]), load(directions[1]), load(directions[2])};
    Lanes distance = root(dot(apart, apart));
    LaneMask crossed = dot(apart, direction) < 0.0f, is_apart = ~crossed & (distance >= radius);
    LaneVec motion = (1.0f - s) * gather(velocities, ends[0]) + s * gather(velocities, ends[1]) -
                     (1.0f - t) * gather(velocities, ends[2]) - t * gather(velocities, ends[3]);
    wait_where(is_apart, until(distance - radius, motion, step), batch, wait);
    LaneVec renewed = (1.0f / (distance + TINY)) * apart;
    for (unsigned lanes = bits(~crossed & (distance > TOUCHING)) & ((1u << batch.count) - 1); lanes;) {
        int lane = take(lanes);
        pairs.at(batch.pairs[lane]).direction = pick(renewed, lane);
    }
    LaneMask is_between = (s > 0.0f) & (s < 1.0f) & (t > 0.0f) & (t < 1.0f);
    return bits(~is_apart & is_between & ~(crossed & (distance > LOST_EDGES)));
}

// Looks at pairs that do not wait, eight at a time, and resolves those that are too near, one after another.
template <class Pair, class Look, class Resolve>
void resolve_all(Array<Pair> pairs, Array<int32_t> wait, Look look, Resolve resolve) {
    PairBatch batch{};
    auto resolve_eight = [&] {
        for (int lane = batch.count; lane < LANES; lane++) batch.pairs[lane] = batch.pairs[batch.count - 1];
        for (unsigned lanes = look(batch) & ((1u << batch.count) - 1); lanes;)
            resolve(pairs.at(batch.pairs[take(lanes)]));
        batch.count = 0;
    };
    for (int k = 0; k < pairs.size; k++) {
        if (wait.at(k) > 0) {
            wait.at(k)--;
            continue;
        }
        batch.pairs[batch.count++] = k;
        if (batch.count == LANES) resolve_eight();
    }
    if (batch.count) resolve_eight();
}

}  // namespace

ContactMesh read_contact_mesh(const Sections &sections, Arena &arena, Failure &failure) {
    ContactMesh mesh{};
    Array<float> rest = read_floats(sections, "cloth.rest", -1, 3, arena, failure);
    int vertices = rest.size / 3;
    Array<int32_t> corners = read_faces(sections, "sheet.faces", vertices, arena, failure);
    int faces = corners.size / 3;
    Array<int32_t> starts = read_integers(sections, "sheet.starts", -1, 1, arena, failure);
    starts = read_starts(sections, "sheet.starts", most(starts.size - 1, 0), faces, arena, failure);
    int pieces = most(starts.size - 1, 0);
    Array<int32_t> edges = read_indices(sections, "sheet.edges", -1, 2, 0, vertices, arena, failure);
    mesh.edges = {reinterpret_cast<IndexPair *>(edges.data), edges.size / 2};
    mesh.owned = read_integers(sections, "sheet.owned", faces, 1, arena, failure);
    Array<int32_t> face_edges =
        read_indices(sections, "sheet.face_edges", faces, 3, 0, edges.size / 2, arena, failure);
    mesh.face_edges = {reinterpret_cast<Face *>(face_edges.data), faces};
    mesh.apart = read_integers(sections, "sheet.apart", pieces, pieces, arena, failure);
    mesh.spacing = read_number(sections, "sheet.spacing", failure);
    for (int piece = 0; piece < pieces && !failure.failed; piece++)
        if (starts[piece] == starts[piece + 1]) failure.say("piece %d of the cloth has no faces", piece);
    if (failure.failed) return {};
    Array<Face> triangles{reinterpret_cast<Face *>(corners.data), faces};
    Vec *points = reinterpret_cast<Vec *>(rest.data);
    mesh.rest = {points, vertices};
    mesh.surface = make_surface(vertices, triangles, arena);
    mesh.tree = make_box_tree(points, triangles, starts, 1, arena);
    mesh.rings = vertex_rings(triangles, vertices, arena);
    find_connected(mesh, arena);
    mesh.pieces = arena.take<int32_t>(faces);
    for (int piece = 0; piece < pieces; piece++)
        for (int face = starts[piece]; face < starts[piece + 1]; face++) mesh.pieces[face] = piece;
    Arena work;
    AdjacentNodePairs walk{mesh.tree, work.take<Box>(mesh.tree.nodes.size), {}};
    for (int piece = 0; piece < pieces; piece++) fit_boxes(mesh.tree, piece, points, walk.boxes);
    mesh.halves = arena.take<int32_t>(mesh.tree.nodes.size);
    for (int k = 0; k < mesh.tree.roots[pieces]; k++)
        if (!mesh.tree.nodes[k].is_leaf()) mesh.halves[k] = walk.number(k + 1, mesh.tree.nodes[k].right);
    if (walk.walked == MOST_WALKED) failure.say("the cloth of the outfit lies all in one place");
    mesh.following = arena.copy(walk.following.items);
    return mesh;
}

bool find_pairs(const ContactMesh &mesh, const Vec *positions, const Vec *velocities,
                const SelfDistances &distances, float interval, SelfContact &contact) {
    const Surface &surface = mesh.surface;
    const BoxTree &tree = mesh.tree;
    float margin = distances.fold_radius + distances.margin;
    float flat = most(margin / mesh.spacing, LEAST_FLAT);
    for (int piece = 0; piece + 1 < tree.roots.size; piece++) {
        fit_boxes(tree, piece, positions, contact.boxes);
        fit_boxes(tree, piece, velocities, contact.speeds);
    }
    fit_cones(mesh, positions, contact.cones);
    if (!walk_pairs(mesh, contact, positions, margin, interval, flat)) return false;
    swap(contact.points, contact.points_before);
    swap(contact.edges, contact.edges_before);
    contact.points.clear();
    contact.edges.clear();
    find_in_leaves(mesh, positions, distances, interval, contact);
    remember(contact.points.items, contact.points_before.items, surface.vertices, contact,
             [](PointPair &pair, const PointPair &old) { pair.side = old.side; });
    remember(contact.edges.items, contact.edges_before.items, mesh.edges.size, contact,
             [](EdgePair &pair, const EdgePair &old) { pair.direction = old.direction; });
    wait_for_none(contact.point_wait, contact.points.items.size);
    wait_for_none(contact.edge_wait, contact.edges.items.size);
    return true;
}

void drop_caught(const ContactMesh &mesh, const Collider &collider, const int32_t *caught,
                 SelfContact &contact) {
    auto pass = [&](int one, int other) {
        return (caught[one] & collider.touches.at(other)) || (caught[other] & collider.touches.at(one));
    };
    auto passes_face = [&](int vertex, Face face) {
        return pass(vertex, face.a) || pass(vertex, face.b) || pass(vertex, face.c);
    };
    auto passes_edge = [&](int vertex, IndexPair edge) {
        return pass(vertex, edge.first) || pass(vertex, edge.second);
    };
    auto drop = [](auto &things, auto is_dropped) {
        int kept = 0;
        for (const auto &thing : things)
            if (!is_dropped(thing)) things[kept++] = thing;
        things.size = kept;
    };
    drop(contact.points.items, [&](const PointPair &pair) {
        return passes_face(pair.indices.first, mesh.surface.faces.at(pair.indices.second));
    });
    drop(contact.edges.items, [&](const EdgePair &pair) {
        IndexPair p = mesh.edges.at(pair.indices.first), q = mesh.edges.at(pair.indices.second);
        return passes_edge(p.first, q) || passes_edge(p.second, q);
    });
    drop(contact.crossings.items, [&](const Crossing &crossing) {
        Face face = mesh.surface.faces.at(crossing.face);
        return passes_face(crossing.edge.first, face) || passes_face(crossing.edge.second, face);
    });
}

void resolve_pairs(const ContactMesh &mesh, SelfContact &contact, Vec *positions, Vec *velocities,
                   const Particles &particles, float step) {
    Array<PointPair> points = contact.points.items;
    Array<EdgePair> edges = contact.edges.items;
    Array<int32_t> point_wait = contact.point_wait.items, edge_wait = contact.edge_wait.items;
    resolve_all(
        points, point_wait,
        [&](const PairBatch &batch) {
            return look_at_points(mesh, points, batch, positions, velocities, step, point_wait);
        },
        [&](const PointPair &pair) { resolve_point(mesh, pair, positions, velocities, particles, step); });
    resolve_all(
        edges, edge_wait,
        [&](const PairBatch &batch) {
            return look_at_edges(mesh, edges, batch, positions, velocities, step, edge_wait);
        },
        [&](EdgePair &pair) { resolve_edges(mesh, pair, positions, velocities, particles, step); });
}

}  // namespace uvc
