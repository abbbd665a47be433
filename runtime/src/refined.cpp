#include "refined.h"

namespace uvc {

namespace {

constexpr double TURN = 6.283185307179586;

// An edge of a face, and where it is among the edges of all faces, three of each.
struct FaceEdge {
    int32_t low, high, place;
};

// The two ends of an edge.
struct EdgeEnds {
    int32_t a, b;
    int32_t operator[](int end) const { return end ? b : a; }
};

// The edges of a surface. ends: (E). is_inner: (E) whether an edge has two faces. of_sides: (3 F) the edge of
// each side.
struct Edges {
    Array<EdgeEnds> ends;
    Array<int32_t> is_inner, of_sides;
};

Edges find_edges(Array<Face> faces, Arena &work) {
    Array<FaceEdge> sides = work.take<FaceEdge>(3 * faces.size);
    for (int k = 0; k < sides.size; k++) {
        int from = faces[k / 3][k % 3], to = faces[k / 3][(k + 1) % 3];
        sides[k] = {least(from, to), most(from, to), k};
    }
    sort(sides, [](FaceEdge a, FaceEdge b) { return a.high != b.high ? a.high < b.high : a.low < b.low; });
    Edges edges{work.take<EdgeEnds>(sides.size), work.take<int32_t>(sides.size),
                work.take<int32_t>(sides.size)};
    Array<int32_t> counts = edges.is_inner;
    int count = 0;
    for (int k = 0; k < sides.size; k++) {
        bool is_same = k && sides[k].low == sides[k - 1].low && sides[k].high == sides[k - 1].high;
        if (!is_same) edges.ends[count++] = {sides[k].low, sides[k].high};
        counts[count - 1]++;
        edges.of_sides[sides[k].place] = count - 1;
    }
    edges.ends.size = edges.is_inner.size = count;
    for (int32_t &faces_there : counts.part(0, count)) faces_there = faces_there == 2;
    return edges;
}

// What each vertex follows: how many edges it has, and whether one of them is on the rim.
struct Corners {
    Array<int32_t> valence, is_rim;

    // Whether a vertex follows the other end of an edge: on the rim, only along it.
    bool follows(int vertex, bool is_inner) const { return !is_rim[vertex] || !is_inner; }

    double share(int vertex) const {
        if (is_rim[vertex]) return 0.125;
        double count = most(valence[vertex], 1), wave = 2 * __builtin_cos(TURN / count) + 3;
        return (40 - wave * wave) / (64 * count);
    }

    double kept(int vertex) const { return is_rim[vertex] ? 0.75 : 1 - valence[vertex] * share(vertex); }
};

Corners find_corners(const Edges &edges, int vertices, Arena &work) {
    Corners corners{work.take<int32_t>(vertices), work.take<int32_t>(vertices)};
    for (int k = 0; k < edges.ends.size; k++)
        for (int end = 0; end < 2; end++) {
            corners.valence[edges.ends[k][end]]++;
            corners.is_rim[edges.ends[k][end]] |= !edges.is_inner[k];
        }
    return corners;
}

// An entry of the matrix.
struct Entry {
    int32_t row, column;
    float weight;
};

Rows gathered(Array<Entry> entries, int count, Arena &arena) {
    Rows rows{arena.take<int32_t>(count + 1), arena.take<int32_t>(entries.size),
              arena.take<float>(entries.size)};
    for (Entry entry : entries) rows.starts[entry.row + 1]++;
    for (int k = 0; k < count; k++) rows.starts[k + 1] += rows.starts[k];
    Arena work;
    Array<int32_t> next = work.copy(rows.starts);
    for (Entry entry : entries) {
        int place = next[entry.row]++;
        rows.columns[place] = entry.column;
        rows.weights[place] = entry.weight;
    }
    return rows;
}

}  // namespace

Refined refine(Array<Face> faces, int vertices, Arena &arena) {
    Arena work;
    Edges edges = find_edges(faces, work);
    Corners corners = find_corners(edges, vertices, work);
    // Each edge has two ends, which may follow each other, and each face has a corner beside three edges.
    Array<Entry> entries = work.room<Entry>(vertices + 4 * edges.ends.size + 3 * faces.size);
    int count = 0;
    auto add = [&](int row, int column, double weight) {
        entries[count++] = {row, column, (float)weight};
    };
    for (int k = 0; k < vertices; k++) add(k, k, corners.kept(k));
    for (int k = 0; k < edges.ends.size; k++) {
        int a = edges.ends[k].a, b = edges.ends[k].b;
        bool is_inner = edges.is_inner[k];
        if (corners.follows(a, is_inner)) add(a, b, corners.share(a));
        if (corners.follows(b, is_inner)) add(b, a, corners.share(b));
        add(vertices + k, a, is_inner ? 0.375 : 0.5);
        add(vertices + k, b, is_inner ? 0.375 : 0.5);
    }
    for (int k = 0; k < 3 * faces.size; k++) {
        int edge = edges.of_sides[k];
        if (edges.is_inner[edge]) add(vertices + edge, faces[k / 3][(k + 2) % 3], 0.125);
    }
    entries.size = count;
    Refined refined{gathered(entries, vertices + edges.ends.size, arena), arena.take<Face>(4 * faces.size)};
    for (int k = 0; k < faces.size; k++) {
        Face f = faces[k];
        const int32_t *sides = edges.of_sides.data + 3 * k;
        int ab = vertices + sides[0], bc = vertices + sides[1], ca = vertices + sides[2];
        Face split[] = {{f.a, ab, ca}, {ab, f.b, bc}, {ca, bc, f.c}, {ab, bc, ca}};
        memcpy(&refined.faces[4 * k], split, sizeof(split));
    }
    return refined;
}

}  // namespace uvc
