// Clearing: moves fine meshes off the skin, in which garments on cages may lie by a few millimetres, and over
// skin that comes through their faces.
#pragma once

#include "box_tree.h"
#include "collider.h"
#include "layers.h"

namespace uvc {

// Points of the skin that the cloth covers at rest: corners and barycentrics on the body's faces, and their
// places at rest, m. Eight points of the order after one another lie together.
struct Covered {
    Array<Face> corners;
    Array<Vec> weights, rest;
    Array<int32_t> order;
};

// Fine meshes of an outfit. thickness: (N) m of other cloth between a vertex and the body. cloth, skin: trees
// of the faces that rays meet. rest: (N) m. layers: garments over each other.
struct Clearing {
    Collider collider;
    Rings rings;
    Array<float> thickness;
    Array<Vec> rest;
    int skin_vertices;
    BoxTree cloth, skin;
    Covered covered;
    Layers layers;
    Arena arena;
};

// What is remembered of the frame before: cloth (N) and body (C) m, search results, and how many frames there
// were.
struct ClearingMemory {
    Vec *cloth, *body;
    ContactCache searched;
    int32_t *frame;
};

// Bytes of the memory of a clearing.
size_t memory_size(const Clearing &clearing);

// Views of so many bytes, at a multiple of four: the frame's number, then search results and places.
ClearingMemory lay_out(const Clearing &clearing, void *bytes);

// Sets memory up before the first frame, from which nothing is known.
void begin(const Clearing &clearing, const ClearingMemory &memory);

// Reads what `read_collider` and `read_layers` do, and "fine.rest" (N, 3) m, "fine.faces" (M, 3),
// "fine.touches" (N), "fine.thickness" (N), "skin.rest" (V, 3) m, "skin.faces" (F, 3), and of the covered
// points "covered.corners" (P, 3), "covered.weights" (P, 3).
void read_clearing(const Sections &sections, Clearing &clearing, Failure &failure);

// Moves vertices (N) m to at least `clearance`, m, off the body at points (C) m, in place; skin deeper than
// reach is not found. Uses and renews the memory of the frame before.
void clear_skin(const Clearing &clearing, const ClearingMemory &memory, Vec *cloth, const Vec *body,
                float clearance, float reach, Arena &work);

// Moves cloth (N) m over the skin (V) m that it covers at rest and that comes through it, in place.
void cover_skin(const Clearing &clearing, Vec *cloth, const Vec *skin, Arena &work);

// Lets vertices that did not move follow the mean of their neighbours' moves (N) m, in place.
void follow(const Rings &rings, Vec *cloth, const Vec *moves);

}  // namespace uvc
