#include "surface.h"

#include "lanes.h"

namespace uvc {

namespace {

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
    surface.nexts = arena.take<int32_t>(surface.around.size);
    surface.lasts = arena.take<int32_t>(surface.around.size);
    for (int k = 0; k < surface.faces.size; k++) {
        Face face = surface.faces[k];
        for (int corner = 0; corner < 3; corner++) {
            int row = next[face[corner]]++;
            surface.around[row] = k;
            surface.nexts[row] = face[(corner + 1) % 3];
            surface.lasts[row] = face[(corner + 2) % 3];
        }
    }
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

}  // namespace

Surface make_surface(int vertices, Array<Face> faces, Arena &arena) {
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

Vec vertex_normal(const Surface &surface, const Vec *points, int vertex) {
    LaneVec here = repeat(points[vertex]), total{};
    int first = surface.around_starts.at(vertex), last = surface.around_starts.at(vertex + 1);
    for (int k = first; k < last; k += LANES) {
        int32_t nexts[LANES], lasts[LANES];
        for (int lane = 0; lane < LANES; lane++) {
            // Two equal corners have no normal.
            nexts[lane] = surface.nexts.at(least(k + lane, last - 1));
            lasts[lane] = k + lane < last ? surface.lasts.at(k + lane) : nexts[lane];
        }
        LaneVec one = gather(points, nexts) - here, other = gather(points, lasts) - here;
        LaneVec normal = cross(one, other);
        Lanes area = root(dot(normal, normal));
        total += (angle(area, dot(one, other)) / (area + TINY)) * normal;
    }
    return sum(total);
}

}  // namespace uvc
