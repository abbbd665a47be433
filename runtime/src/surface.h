// A triangle mesh that moves: its faces and their neighbours, closest points, and normals.
#pragma once

#include "memory.h"
#include "triangle.h"

namespace uvc {

// One or several parts, each a surface of its own, over the same vertices. Nothing here changes.
//
// neighbours: face across each edge, corner i to i + 1, -1 at a border. around: the faces around each vertex,
// from around_starts on; nexts, lasts: the corners that follow the vertex in them.
struct Surface {
    int vertices;
    Array<Face> faces;
    Array<Face> neighbours;
    Array<int32_t> around, around_starts, nexts, lasts;
};

Surface make_surface(int vertices, Array<Face> faces, Arena &arena);

// Vertices on an edge with each vertex, in rows from starts[vertex] on.
struct Rings {
    Array<int32_t> starts, ring;
};
Rings vertex_rings(Array<Face> faces, int vertices, Arena &arena);

// A face, -1 for none, the barycentric coordinates of its closest point, and the way from there to the point.
struct Closest {
    int face;
    Vec weights, away;
};

Closest on_face(const Surface &surface, const Vec *points, int face, Vec point);

// Walks from a face over its neighbours to a closer one, at most so many steps. on(face): the closest point
// of a face.
template <class On> Closest walk_over(const Surface &surface, int face, int steps, On on) {
    Closest best = on(face);
    for (int step = 0; step < steps; step++) {
        Face here = surface.faces.at(best.face);
        Vec w = best.weights;
        int from = best.face;
        float squared = dot(best.away, best.away) - 1e-12f;
        auto look = [&](int other) {
            Closest found = on(other);
            if (dot(found.away, found.away) < squared) {
                best = found;
                squared = dot(found.away, found.away);
            }
        };
        int corner = w.x <= 0 ? (w.y <= 0 ? 2 : w.z <= 0 ? 1 : -1) : (w.y <= 0 && w.z <= 0 ? 0 : -1);
        if (corner >= 0) {
            // The closest point is a corner: each face around it may be closer.
            int vertex = here[corner];
            for (int k = surface.around_starts.at(vertex); k < surface.around_starts.at(vertex + 1); k++)
                look(surface.around.at(k));
        } else {
            if (w.x > 0 && w.y > 0 && w.z > 0) break;
            int other = surface.neighbours.at(from)[w.x <= 0 ? 1 : w.y <= 0 ? 2 : 0];
            if (other < 0) break;
            look(other);
        }
        if (best.face == from) break;
    }
    return best;
}

// The same on the surface as it is.
Closest walk(const Surface &surface, const Vec *points, int face, Vec point, int steps);

// Normal of a vertex: the mean of the faces around it, by their angles there; not of unit length. A point is
// outside of a closed surface where this says so (Baerentzen and Aanaes 2005).
Vec vertex_normal(const Surface &surface, const Vec *points, int vertex);

UVC_INLINE Vec face_normal(const Surface &surface, const Vec *points, int face) {
    return face_normal(surface.faces.at(face), points);
}

// Whether all of face g is at least a margin, in lengths of the normal, off the plane of face f, on one side.
UVC_INLINE bool is_off_plane(const Surface &surface, const Vec *points, int f, Vec normal, int g,
                             float margin) {
    Vec on_plane = points[surface.faces.at(f).a];
    Face face = surface.faces.at(g);
    float a = dot(points[face.a] - on_plane, normal), b = dot(points[face.b] - on_plane, normal);
    float c = dot(points[face.c] - on_plane, normal);
    return least(least(a, b), c) >= margin || most(most(a, b), c) <= -margin;
}

}  // namespace uvc
