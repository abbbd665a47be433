#include "edge_evening.h"

namespace uvc {

namespace {

// Factor on the mean correction by a vertex's edges; 2 oscillates where all neighbours move alike.
constexpr float CORRECTION = 1.8f;

// Spectral radius that the Chebyshev weights are made for: near 1, long waves converge fast.
constexpr float SPECTRAL_RADIUS = 0.995f;

// Share of the curvature beyond that at rest which a pass undoes: without it folds are as small as edges.
constexpr float BENDING = 0.04f;

// First passes, without momentum, which remove the largest errors.
constexpr int PLAIN_PASSES = 2;

// Metres: no edge that is divided by is shorter.
constexpr float SHORTEST = 1e-9f;

// The Chebyshev weight of a pass; the first ones and the last are plain.
float weight_of(int pass, int passes, float before) {
    if (pass < PLAIN_PASSES || pass == passes - 1) return 1;
    constexpr float SQUARE = SPECTRAL_RADIUS * SPECTRAL_RADIUS;
    return pass == PLAIN_PASSES ? 2 / (2 - SQUARE) : 4 / (4 - SQUARE * before);
}

// Where a vertex moves to by half of the error of each of its edges, averaged.
Vec evened(const Graph &graph, float curvature, int vertex, const Vec *positions) {
    Vec place = positions[vertex], pull{}, curve{};
    int first = graph.starts.at(vertex), last = graph.starts.at(vertex + 1);
    for (int k = first; k < last; k++) {
        Vec edge = positions[graph.neighbours.at(k)] - place;
        curve += edge;
        pull += (1 - graph.lengths.at(k) / most(length(edge), SHORTEST)) * edge;
    }
    float share = 1 / most((float)(last - first), 1.0f);
    curve = share * curve;
    float excess = most(1 - curvature / most(length(curve), SHORTEST), 0.0f);
    return place + (0.5f * CORRECTION * share) * pull + (BENDING * excess) * curve;
}

}  // namespace

void even_edges(const Graph &graph, const Evening &evening, int passes, Vec *positions) {
    Arena work;
    int vertices = graph.vertices();
    Array<Vec> now{positions, vertices}, before = work.copy(now);
    float weight = 1;
    for (int pass = 0; pass < passes; pass++) {
        weight = weight_of(pass, passes, weight);
        for (int k = 0; k < vertices; k++) {
            Vec place = between(before[k], evened(graph, evening.curvatures[k], k, now.data), weight);
            Vec normal = evening.normals[k];
            float depth = evening.offsets[k] - dot(normal, place);
            before[k] = depth > 0 ? place + depth * normal : place;
        }
        swap(now, before);
    }
    if (now.data != positions) memcpy(positions, now.data, sizeof(Vec) * (size_t)vertices);
}

}  // namespace uvc
