#include "surface.h"

namespace uvc {

namespace {

constexpr int DEPTH = 64;
constexpr float FAR = 1e30f;

// Rows of the faces around each vertex.
void find_around(Surface &surface, Arena &arena) {
    surface.around_starts = arena.take<int32_t>(surface.vertices + 1);
    surface.around = arena.take<int32_t>(3 * surface.faces.size);
    Array<int32_t> starts = surface.around_starts;
    for (Face face : surface.faces)
        for (int corner = 0; corner < 3; corner++) starts[face[corner] + 1]++;
    for (int k = 0; k < surface.vertices; k++) starts[k + 1] += starts[k];
    Arena work;
    Array<int32_t> next = work.copy(starts);
    for (int face = 0; face < surface.faces.size; face++)
        for (int corner = 0; corner < 3; corner++)
            surface.around[next[surface.faces[face][corner]]++] = face;
}

// The face across the edge from one vertex to another: the one that has it the other way round.
int across(const Surface &surface, int from, int to) {
    for (int k = surface.around_starts[from]; k < surface.around_starts[from + 1]; k++) {
        Face face = surface.faces[surface.around[k]];
        for (int corner = 0; corner < 3; corner++)
            if (face[corner] == to && face[(corner + 1) % 3] == from) return surface.around[k];
    }
    return -1;
}

// Builds the tree of some faces, halved at the middle along the widest axis; returns its first node.
int build(Surface &surface, Array<Vec> centres, int leaf, int first, int last, int &count) {
    int node = count++;
    surface.nodes[node] = {first, last, 0};
    if (last - first <= leaf) return node;
    Vec low = centres[surface.order[first]], high = low;
    for (int k = first; k < last; k++) {
        Vec c = centres[surface.order[k]];
        low = {least(low.x, c.x), least(low.y, c.y), least(low.z, c.z)};
        high = {most(high.x, c.x), most(high.y, c.y), most(high.z, c.z)};
    }
    Vec size = high - low;
    int along = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    sort(surface.order.part(first, last),
         [&](int a, int b) { return axis(centres[a], along) < axis(centres[b], along); });
    int middle = (first + last) / 2;
    build(surface, centres, leaf, first, middle, count);
    int right = build(surface, centres, leaf, middle, last, count);
    surface.nodes[node].right = right;
    return node;
}

UVC_INLINE float outside(const Box &box, Vec point) {
    float x = most(most(box.low.x - point.x, point.x - box.high.x), 0.0f);
    float y = most(most(box.low.y - point.y, point.y - box.high.y), 0.0f);
    float z = most(most(box.low.z - point.z, point.z - box.high.z), 0.0f);
    return x * x + y * y + z * z;
}

UVC_INLINE void widen(Box &box, Vec p) {
    box.low = {least(box.low.x, p.x), least(box.low.y, p.y), least(box.low.z, p.z)};
    box.high = {most(box.high.x, p.x), most(box.high.y, p.y), most(box.high.z, p.z)};
}

// Whether a ray meets a box within reach (slabs; an axis along which it does not move has no inverse).
UVC_INLINE bool meets(const Box &box, Vec start, Vec inverse, float reach) {
    float x0 = (box.low.x - start.x) * inverse.x, x1 = (box.high.x - start.x) * inverse.x;
    float y0 = (box.low.y - start.y) * inverse.y, y1 = (box.high.y - start.y) * inverse.y;
    float z0 = (box.low.z - start.z) * inverse.z, z1 = (box.high.z - start.z) * inverse.z;
    float near = most(most(least(x0, x1), least(y0, y1)), most(least(z0, z1), 0.0f));
    float far = least(least(most(x0, x1), most(y0, y1)), least(most(z0, z1), reach));
    return near <= far * 1.00001f;
}

}  // namespace

Surface make_surface(const Vec *rest, int vertices, Array<Face> faces, Array<int32_t> starts, int leaf,
                     Arena &arena) {
    Surface surface{};
    surface.vertices = vertices;
    surface.faces = faces;
    find_around(surface, arena);
    surface.neighbours = arena.take<Face>(faces.size);
    for (int k = 0; k < faces.size; k++) {
        Face f = faces[k];
        surface.neighbours[k] = {across(surface, f.a, f.b), across(surface, f.b, f.c),
                                 across(surface, f.c, f.a)};
    }
    int parts = starts.size - 1, count = 0;
    surface.order = arena.take<int32_t>(faces.size);
    surface.nodes = arena.take<Node>(2 * faces.size + parts);
    surface.roots = arena.take<int32_t>(parts + 1);
    Arena work;
    Array<Vec> centres = work.take<Vec>(faces.size);
    for (int k = 0; k < faces.size; k++) {
        surface.order[k] = k;
        centres[k] = rest[faces[k].a] + rest[faces[k].b] + rest[faces[k].c];
    }
    for (int part = 0; part < parts; part++) {
        surface.roots[part] = count;
        build(surface, centres, leaf, starts[part], starts[part + 1], count);
    }
    surface.roots[parts] = count;
    return surface;
}

Rings vertex_rings(Array<Face> faces, int vertices, Arena &arena) {
    Arena work;
    Array<int32_t> counts = work.take<int32_t>(vertices + 1);
    for (Face face : faces)
        for (int corner = 0; corner < 3; corner++) counts[face[corner] + 1] += 2;
    for (int k = 0; k < vertices; k++) counts[k + 1] += counts[k];
    Array<int32_t> rows = work.take<int32_t>(6 * faces.size), ends = work.copy(counts);
    Rings rings{arena.take<int32_t>(vertices + 1), {}};
    for (Face face : faces)
        for (int corner = 0; corner < 3; corner++)
            for (int other = 1; other < 3; other++) {
                int from = face[corner], to = face[(corner + other) % 3];
                bool is_known = false;
                for (int k = counts[from]; k < ends[from]; k++) is_known |= rows[k] == to;
                if (!is_known) rows[ends[from]++] = to;
            }
    for (int k = 0; k < vertices; k++) rings.starts[k + 1] = rings.starts[k] + ends[k] - counts[k];
    rings.ring = arena.take<int32_t>(rings.starts[vertices]);
    for (int k = 0; k < vertices; k++) {
        Array<int32_t> row = rows.part(counts[k], ends[k]);
        sort(row, [](int a, int b) { return a < b; });
        for (int j = 0; j < row.size; j++) rings.ring[rings.starts[k] + j] = row[j];
    }
    return rings;
}

void fit_boxes(const Surface &surface, int part, const Vec *points, Array<Box> boxes) {
    for (int k = surface.roots.at(part + 1) - 1; k >= surface.roots.at(part); k--) {
        Node node = surface.nodes.at(k);
        if (!node.is_leaf()) {
            Box box = boxes.at(k + 1), right = boxes.at(node.right);
            widen(box, right.low);
            widen(box, right.high);
            boxes.at(k) = box;
            continue;
        }
        if (node.first == node.last) continue;
        Vec start = points[surface.faces.at(surface.order.at(node.first)).a];
        Box box{start, start};
        for (int j = node.first; j < node.last; j++) {
            Face face = surface.faces.at(surface.order.at(j));
            widen(box, points[face.a]);
            widen(box, points[face.b]);
            widen(box, points[face.c]);
        }
        boxes.at(k) = box;
    }
}

Closest on_face(const Surface &surface, const Vec *points, int face, Vec point) {
    Face f = surface.faces.at(face);
    Vec a = points[f.a], b = points[f.b], c = points[f.c];
    Vec weights = closest_barycentrics(point, a, b, c);
    return {face, weights, point - weighted(weights, a, b, c)};
}

Closest walk(const Surface &surface, const Vec *points, int face, Vec point, int steps) {
    return walk_over(surface, face, steps,
                     [&](int other) { return on_face(surface, points, other, point); });
}

Closest closest_face(const Surface &surface, int part, const Vec *points, Array<Box> boxes, Vec point,
                     float reach, int guess, float &beyond) {
    Closest best{-1, {}, {}};
    beyond = FAR;
    int root = surface.roots.at(part);
    if (root == surface.roots.at(part + 1) || surface.nodes.at(root).first == surface.nodes.at(root).last)
        return best;
    float squared = reach * reach;
    if (guess >= 0) {
        // Rounded up, so that the guess itself is found in its turn.
        Closest found = on_face(surface, points, guess, point);
        squared = least(squared, dot(found.away, found.away) * 1.001f + 1e-9f);
    }
    int stack[DEPTH];
    float distances[DEPTH];
    int top = 1;
    stack[0] = root;
    distances[0] = outside(boxes.at(root), point);
    while (top > 0) {
        top--;
        if (distances[top] >= squared) {
            beyond = least(beyond, distances[top]);
            continue;
        }
        int k = stack[top];
        Node node = surface.nodes.at(k);
        if (node.is_leaf()) {
            for (int j = node.first; j < node.last; j++) {
                Closest found = on_face(surface, points, surface.order.at(j), point);
                float distance = dot(found.away, found.away);
                beyond = least(beyond, distance);
                if (distance < squared) {
                    squared = distance;
                    best = found;
                }
            }
            continue;
        }
        float left = outside(boxes.at(k + 1), point), right = outside(boxes.at(node.right), point);
        bool left_first = left < right;
        stack[top] = left_first ? node.right : k + 1;
        distances[top++] = left_first ? right : left;
        stack[top] = left_first ? k + 1 : node.right;
        distances[top++] = left_first ? left : right;
    }
    return best;
}

Hit first_hit(const Surface &surface, int part, const Vec *points, Array<Box> boxes, Vec start,
              Vec direction, float reach) {
    Hit hit{-1, reach, {}};
    int root = surface.roots.at(part);
    if (root == surface.roots.at(part + 1) || surface.nodes.at(root).first == surface.nodes.at(root).last)
        return hit;
    auto inverse_of = [](float a) { return 1.0f / (absolute(a) > 1e-12f ? a : a < 0 ? -1e-12f : 1e-12f); };
    Vec inverse{inverse_of(direction.x), inverse_of(direction.y), inverse_of(direction.z)};
    int stack[DEPTH];
    int top = 1;
    stack[0] = root;
    while (top > 0) {
        int k = stack[--top];
        if (!meets(boxes.at(k), start, inverse, hit.distance)) continue;
        Node node = surface.nodes.at(k);
        if (!node.is_leaf()) {
            stack[top++] = node.right;
            stack[top++] = k + 1;
            continue;
        }
        for (int j = node.first; j < node.last; j++) {
            int face = surface.order.at(j);
            Face f = surface.faces.at(face);
            Vec weights{};
            float distance = ray_hit(start, direction, points[f.a], points[f.b], points[f.c], weights);
            if (distance >= 0 && distance < hit.distance) hit = {face, distance, weights};
        }
    }
    return hit;
}

Vec vertex_normal(const Surface &surface, const Vec *points, int vertex) {
    Vec total{};
    for (int k = surface.around_starts.at(vertex); k < surface.around_starts.at(vertex + 1); k++) {
        Face f = surface.faces.at(surface.around.at(k));
        Vec a = points[f.a], b = points[f.b], c = points[f.c];
        if (f.b == vertex) {
            Vec turned = a;
            a = b, b = c, c = turned;
        } else if (f.c == vertex) {
            Vec turned = c;
            c = b, b = a, a = turned;
        }
        Vec one = b - a, other = c - a, normal = cross(one, other);
        float area = length(normal);
        total += (angle(area, dot(one, other)) / (area + TINY)) * normal;
    }
    return total;
}

}  // namespace uvc
