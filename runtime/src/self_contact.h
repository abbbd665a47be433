// Contact of cloth with itself, and of layers: vertices with faces, edges with edges, each on its side.
#pragma once

#include "body_contact.h"
#include "box_tree.h"
#include "list.h"

namespace uvc {

// Two vertices, the ends of an edge, or a vertex and a face, or two edges.
struct IndexPair {
    int32_t first, second;
};

// Cone around the normals of a node's faces: axis, and cosine of the half angle, -1 from a quarter turn on.
struct NormalCone {
    Vec axis;
    float cosine;
};

// Surface of cloth for contact with itself. Each piece of cloth is a part of the tree.
//
// owned: for each face, bits 0 to 2 of the corners and bits 3 to 5 of the edges (corner i to i + 1) that it
// stands for, so that each is tested once. face_edges: into edges. connected: nodes whose faces are one patch.
// rest: (N) m. pieces: (M) of the faces. halves, following: where a walk through pairs of nodes goes on; see
// `AdjacentNodePairs` in self_contact.cpp. apart: (K, K) whether two pieces do not touch. spacing: m, least
// distance of vertices along the mesh that are no neighbours, in slightly squeezed cloth.
struct ContactMesh {
    Array<Vec> rest;
    Surface surface;
    BoxTree tree;
    Array<IndexPair> edges;
    Array<int32_t> owned, pieces;
    Array<Face> face_edges;
    Rings rings;
    Array<int32_t> connected, halves;
    Array<IndexPair> following;
    Array<int32_t> apart;
    float spacing;
};

// Reads "cloth.rest" (N, 3) m, "sheet.faces" (M, 3), "sheet.starts" (K + 1) the first face of each piece,
// "sheet.edges" (E, 2), "sheet.owned" (M), "sheet.face_edges" (M, 3), "sheet.apart" (K, K) and
// "sheet.spacing" (1).
ContactMesh read_contact_mesh(const Sections &sections, Arena &arena, Failure &failure);

// A vertex near a face: the side, +1 or -1 along its normal, on which the vertex stays, and the distance, m,
// that it keeps.
struct PointPair {
    IndexPair indices;
    float side, radius;
};

// Two edges near each other, the unit direction from the second to the first, and the distance, m, they keep.
struct EdgePair {
    IndexPair indices;
    Vec direction;
    float radius;
};

// Distances, m, that cloth keeps from cloth: pieces from each other, and a piece from itself, but no more than
// at rest; and the margin within which it is watched beyond them.
struct SelfDistances {
    float radius, fold_radius, margin;
};

// An edge that runs through a face, and the corners of its faces that it does not have; `beyond` is -1 at a
// border.
struct Crossing {
    IndexPair edge;
    int32_t inner, beyond, face;
};

// Pairs that are near, with the substeps until each is looked at again, and what a search needs.
struct SelfContact {
    List<PointPair> points, points_before;
    List<EdgePair> edges, edges_before;
    List<int32_t> point_wait, edge_wait;
    List<IndexPair> leaves;
    List<Crossing> crossings;
    List<int32_t> starts, order;
    Array<Box> boxes, speeds;
    Array<NormalCone> cones;
};

// Finds the pairs of the cloth that are within the distances and their margin, or may get there within an
// interval, s. Sides of pairs that were there before are remembered.
//
// A patch of the mesh whose normals lie in a narrow cone is not tested against itself (Volino and
// Magnenat-Thalmann 1994): at a half angle a, points that are `spacing` apart along it keep a distance of
// spacing cos(a), more than the margin.
// Returns false, and no pairs, if there are so many that a search would take for ever.
bool find_pairs(const ContactMesh &mesh, const Vec *positions, const Vec *velocities,
                const SelfDistances &distances, float interval, SelfContact &contact);

// Drops the pairs and crossings of cloth that is inside a part of the body which the other cloth touches:
// mocap moves forearms through knees, and a sleeve there would push the trousers off the leg. caught: (N) bits
// of parts.
void drop_caught(const ContactMesh &mesh, const Collider &collider, const int32_t *caught,
                 SelfContact &contact);

// Keeps pairs apart on their sides, without a bounce, with friction. step: s.
void resolve_pairs(const ContactMesh &mesh, SelfContact &contact, Vec *positions, Vec *velocities,
                   const Particles &particles, float step);

}  // namespace uvc
