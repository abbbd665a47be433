#include "surface_graph.h"

namespace uvc {

namespace {

// Metres that stand for a vertex that was not reached.
constexpr float FAR = 1e9f;

struct Way {
    float distance;
    int32_t vertex;
};

// Ways of which the shortest is taken first: a binary heap.
class Ways {
  public:
    Ways(int room, Arena &arena) : ways_(arena.take<Way>(room)) {}

    bool is_empty() const { return size_ == 0; }

    void add(Way way) {
        int place = size_++;
        for (; place > 0 && way.distance < ways_[(place - 1) / 2].distance; place = (place - 1) / 2)
            ways_[place] = ways_[(place - 1) / 2];
        ways_[place] = way;
    }

    Way take() {
        Way shortest = ways_[0], last = ways_[--size_];
        int place = 0;
        for (int next = 1; next < size_; next = 2 * place + 1) {
            if (next + 1 < size_ && ways_[next + 1].distance < ways_[next].distance) next++;
            if (last.distance <= ways_[next].distance) break;
            ways_[place] = ways_[next];
            place = next;
        }
        ways_[place] = last;
        return shortest;
    }

  private:
    Array<Way> ways_;
    int size_ = 0;
};

// Search of Dijkstra from one vertex after another. distance: (V) m, FAR where it did not get.
class Search {
  public:
    Search(const Graph &graph, Arena &arena)
        : distance(arena.take<float>(graph.vertices())), graph_(graph),
          reached_(arena.take<int32_t>(graph.vertices())), ways_(graph.neighbours.size + 1, arena) {
        for (float &metres : distance) metres = FAR;
    }

    // Finds the vertices within limit, m, of one.
    Array<int32_t> reach(int source, float limit) {
        for (int vertex : reached_.part(0, count_)) distance[vertex] = FAR;
        distance[source] = 0;
        reached_[0] = source;
        count_ = 1;
        ways_.add({0, source});
        while (!ways_.is_empty()) {
            Way way = ways_.take();
            if (way.distance > distance[way.vertex]) continue;
            for (int edge = graph_.starts[way.vertex]; edge < graph_.starts[way.vertex + 1]; edge++) {
                int other = graph_.neighbours[edge];
                float longer = way.distance + graph_.lengths[edge];
                if (longer >= limit || longer >= distance[other]) continue;
                if (distance[other] == FAR) reached_[count_++] = other;
                distance[other] = longer;
                ways_.add({longer, other});
            }
        }
        return reached_.part(0, count_);
    }

    Array<float> distance;

  private:
    const Graph &graph_;
    Array<int32_t> reached_;
    int count_ = 0;
    Ways ways_;
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

int along_skin(const Graph &graph, const float *clear, float limit, int32_t *firsts, Array<int32_t> others,
               Array<float> ways) {
    Arena arena;
    Search search(graph, arena);
    int total = 0;
    firsts[0] = 0;
    for (int source = 0; source < graph.vertices(); source++) {
        if (clear[source] >= 0) {
            Array<int32_t> reached = search.reach(source, limit + clear[source]);
            Array<float> distance = search.distance;
            sort(reached, [&](int a, int b) { return distance[a] < distance[b]; });
            for (int vertex : reached) {
                if (total < others.size) {
                    others[total] = vertex;
                    ways[total] = most(distance[vertex] - clear[source], 0.0f);
                }
                total++;
            }
        }
        firsts[source + 1] = total;
    }
    return total;
}

}  // namespace uvc
