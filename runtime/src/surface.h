// A triangle mesh that moves: what is known of it at rest, its tree of boxes, closest faces and rays.
#pragma once

#include "memory.h"
#include "triangle.h"

namespace uvc {

// Lowest and highest corner.
struct Box {
    Vec low, high;
};

// Node of a tree: a leaf with faces order[first] to order[last - 1], or a node with two children, of which
// the left one follows it.
struct Node {
    int32_t first, last, right;
    bool is_leaf() const { return right == 0; }
};

// One or several parts, each a surface of its own, over the same vertices. Nothing here changes.
//
// neighbours: face across each edge, corner i to i + 1, -1 at a border. around: the faces around each vertex,
// from around_starts on. roots: a tree's first node for each part, and the number of all nodes.
struct Surface {
    int vertices;
    Array<Face> faces;
    Array<Face> neighbours;
    Array<int32_t> around, around_starts;
    Array<Node> nodes;
    Array<int32_t> order, roots;
};

// Faces of each part follow one another; `starts` are their first faces and, last, the number of all. leaf:
// most faces in a leaf of the tree.
Surface make_surface(const Vec *rest, int vertices, Array<Face> faces, Array<int32_t> starts, int leaf,
                     Arena &arena);

// Vertices on an edge with each vertex, in rows from starts[vertex] on.
struct Rings {
    Array<int32_t> starts, ring;
};
Rings vertex_rings(Array<Face> faces, int vertices, Arena &arena);

// Fits the boxes of a part's tree to the vertices as they are now.
void fit_boxes(const Surface &surface, int part, const Vec *points, Array<Box> boxes);

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

// The closest face of a part within reach, m. `guess`, a face or -1, saves time and changes nothing.
// `beyond`: where none is found, the square of a distance within which there is none.
Closest closest_face(const Surface &surface, int part, const Vec *points, Array<Box> boxes, Vec point,
                     float reach, int guess, float &beyond);

// First face that a ray along a unit direction meets within reach, -1 for none.
struct Hit {
    int face;
    float distance;
    Vec weights;
};
Hit first_hit(const Surface &surface, int part, const Vec *points, Array<Box> boxes, Vec start,
              Vec direction, float reach);

// Normal of a vertex: the mean of the faces around it, by their angles there; not of unit length.
Vec vertex_normal(const Surface &surface, const Vec *points, int vertex);

UVC_INLINE Vec face_normal(const Surface &surface, const Vec *points, int face) {
    Face f = surface.faces.at(face);
    return cross(points[f.b] - points[f.a], points[f.c] - points[f.a]);
}

}  // namespace uvc
