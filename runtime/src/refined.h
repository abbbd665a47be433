// Refined surfaces: one step of Loop's subdivision, so that a mesh can hold folds that its solver cannot.
#pragma once

#include "memory.h"
#include "triangle.h"

namespace uvc {

// Rows of a sparse matrix: columns and weights of each, from its start on.
struct Rows {
    Array<int32_t> starts, columns;
    Array<float> weights;

    int count() const { return starts.size - 1; }
};

// rows: of each refined vertex, over the vertices of the surface. faces: of the refined vertices, four for each
// face. The old vertices come first, then the middles of edges, by the edge's higher vertex, then the other.
struct Refined {
    Rows rows;
    Array<Face> faces;
};

// Loop 1987, "Smooth Subdivision Surfaces Based on Triangles": an edge has one face or two.
Refined refine(Array<Face> faces, int vertices, Arena &arena);

}  // namespace uvc
