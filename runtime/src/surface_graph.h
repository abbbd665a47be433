// Distances along a surface: its edges as a graph in compressed rows, of V vertices.
#pragma once

#include "memory.h"

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

// Finds the vertices within limit, m, of each vertex whose clear (V) m is not negative, the nearest first.
//
// Sets firsts (V + 1), the first row of each vertex. Rows are the vertices, and their distances less that of
// clear, m. Returns how many there are; those beyond the room for them are not stored.
int along_skin(const Graph &graph, const float *clear, float limit, int32_t *firsts, Array<int32_t> others,
               Array<float> ways);

}  // namespace uvc
