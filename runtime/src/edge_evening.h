// Evening of edges: vertices move until the edges of cloth are near given lengths, and bend as at rest.
#pragma once

#include "surface_graph.h"

namespace uvc {

// What vertices are evened by. curvatures: (V) m, lengths of the mean ways to their neighbours at rest. normals
// (V), unit, and offsets (V), m: planes on whose outer sides they stay, as the least products with the normals.
struct Evening {
    const float *curvatures;
    const Vec *normals;
    const float *offsets;
};

// Evens the edges of cloth at positions (V) m to the graph's lengths, in so many passes: Jacobi iterations with
// Chebyshev weights (Wang 2015). Short waves converge first, so that the shape stays.
void even_edges(const Graph &graph, const Evening &evening, int passes, Vec *positions);

}  // namespace uvc
