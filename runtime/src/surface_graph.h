// Distances along a surface: its edges as a graph in compressed rows, of V vertices.
#pragma once

#include "list.h"
#include "surface.h"

namespace uvc {

// neighbours of each vertex, from starts (V + 1) on, and lengths, m, of the edges to them.
struct Graph {
    Array<const int32_t> starts, neighbours;
    Array<const float> lengths;

    int vertices() const { return starts.size - 1; }
};

// Chooses vertices, in a given order, that are at least spacing, m, apart. Sets clear (V) m: for each chosen
// vertex the distance within which others were left out for it, -1 for all others.
void thin_out(const Graph &graph, Array<const int32_t> order, float spacing, float *clear);

// Edges of faces over vertices (V) m; those without a face have none.
Graph make_graph(Array<Face> faces, const Vec *rest, int vertices, Arena &arena);

// Vertices near each vertex along the surface, the nearest first, from starts (V + 1) on, and their
// distances, m.
struct NeighbourDistances {
    Array<int32_t> starts;
    List<int32_t> others;
    List<float> ways;
};

// Finds the vertices within limit, m, of each vertex whose clear (V) m is not negative; distances are less
// that of clear. Returns whether there are no more than a body may have.
bool along_skin(const Graph &graph, const float *clear, float limit, NeighbourDistances &spread, Arena &arena);

}  // namespace uvc
