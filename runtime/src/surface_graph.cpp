#include "surface_graph.h"

namespace uvc {

namespace {

// Metres that stand for a vertex that was not reached.
constexpr float FAR = 1e9f;

// Most vertices near all vertices: damaged outfits may have no lengths.
constexpr int MOST_SPREAD = 1 << 23;

struct QueuedVertex {
    float distance;
    int32_t vertex;
};

// Vertices to go on from, the nearest first: a binary heap.
class VertexQueue {
  public:
    VertexQueue(int room, Arena &arena) : queue_(arena.take<QueuedVertex>(room)) {}

    bool is_empty() const { return size_ == 0; }

    void add(QueuedVertex way) {
        int place = size_++;
        for (; place > 0 && way.distance < queue_[(place - 1) / 2].distance; place = (place - 1) / 2)
            queue_[place] = queue_[(place - 1) / 2];
        queue_[place] = way;
    }

    QueuedVertex take() {
        QueuedVertex shortest = queue_[0], last = queue_[--size_];
        int place = 0;
        for (int next = 1; next < size_; next = 2 * place + 1) {
            if (next + 1 < size_ && queue_[next + 1].distance < queue_[next].distance) next++;
            if (last.distance <= queue_[next].distance) break;
            queue_[place] = queue_[next];
            place = next;
        }
        queue_[place] = last;
        return shortest;
    }

  private:
    Array<QueuedVertex> queue_;
    int size_ = 0;
};

// Search of Dijkstra from one vertex after another. distance: (V) m, FAR where it did not get.
class Search {
  public:
    Search(const Graph &graph, Arena &arena)
        : distance(arena.take<float>(graph.vertices())),
          graph_(graph),
          reached_(arena.take<int32_t>(graph.vertices())),
          queue_(graph.neighbours.size + 1, arena) {
        for (float &metres : distance) metres = FAR;
    }

    // Finds the vertices within limit, m, of one.
    Array<int32_t> reach(int source, float limit) {
        for (int vertex : reached_.part(0, count_)) distance[vertex] = FAR;
        distance[source] = 0;
        reached_[0] = source;
        count_ = 1;
        queue_.add({0, source});
        while (!queue_.is_empty()) {
            QueuedVertex way = queue_.take();
            if (way.distance > distance[way.vertex]) continue;
            for (int edge = graph_.starts[way.vertex]; edge < graph_.starts[way.vertex + 1]; edge++) {
                int other = graph_.neighbours[edge];
                float longer = way.distance + graph_.lengths[edge];
                if (longer >= limit || longer >= distance[other]) continue;
                if (distance[other] == FAR) reached_[count_++] = other;
                distance[other] = longer;
                queue_.add({longer, other});
            }
        }
        return reached_.part(0, count_);
    }

    Array<float> distance;

  private:
    const Graph &graph_;
    Array<int32_t> reached_;
    int count_ = 0;
    VertexQueue queue_;
};

}  // namespace

void thin_out(const Graph &graph, Array<const int32_t> order, float spacing, float *clear) {
    Arena arena;
    Array<uint8_t> is_free = arena.take<uint8_t>(graph.vertices());
    for (int vertex = 0; vertex < graph.vertices(); vertex++) clear[vertex] = -1;
    for (int vertex : order) is_free[vertex] = 1;
    Search search(graph, arena);
    for (int source : order) {
        if (!is_free[source]) continue;
        clear[source] = 0;
        for (int vertex : search.reach(source, spacing)) {
            if (is_free[vertex]) clear[source] = most(clear[source], search.distance[vertex]);
            is_free[vertex] = 0;
        }
    }
}

Graph make_graph(Array<Face> faces, const Vec *rest, int vertices, Arena &arena) {
    Rings rings = vertex_rings(faces, vertices, arena);
    Array<float> lengths = arena.take<float>(rings.ring.size);
    for (int vertex = 0; vertex < vertices; vertex++)
        for (int k = rings.starts[vertex]; k < rings.starts[vertex + 1]; k++)
            lengths[k] = length(rest[vertex] - rest[rings.ring[k]]);
    return {{rings.starts.data, vertices + 1}, {rings.ring.data, lengths.size}, {lengths.data, lengths.size}};
}

bool along_skin(const Graph &graph, const float *clear, float limit, NeighbourDistances &spread, Arena &arena) {
    Arena work;
    Search search(graph, work);
    spread.starts = arena.take<int32_t>(graph.vertices() + 1);
    for (int source = 0; source < graph.vertices(); source++) {
        if (clear[source] >= 0) {
            Array<int32_t> reached = search.reach(source, limit + clear[source]);
            Array<float> distance = search.distance;
            sort(reached, [&](int a, int b) { return distance[a] < distance[b]; });
            for (int vertex : reached) {
                spread.others.add(vertex);
                spread.ways.add(most(distance[vertex] - clear[source], 0.0f));
            }
        }
        spread.starts[source + 1] = spread.others.items.size;
        if (spread.others.items.size > MOST_SPREAD) return false;
    }
    return true;
}

}  // namespace uvc
