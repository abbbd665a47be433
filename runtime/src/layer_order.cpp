#include "layer_order.h"

namespace uvc {

namespace {

// Share of the cages around a point from which on it lies where they do.
constexpr float HALF = 0.5f;

// Votes of pairs on whether vertices of the cages (n) lie over garments (G): positive where they do.
struct Votes {
    Array<int32_t> votes;
    int garments;

    int32_t &of(int vertex, int garment) { return votes.at(vertex * garments + garment); }
};

// Whether a vertex is above or below the face, not beside it, where its side says nothing.
bool is_across(const PointPair &pair, const ContactMesh &mesh, const Vec *positions) {
    Face face = mesh.surface.faces.at(pair.indices.second);
    Vec weights = closest_barycentrics(positions[pair.indices.first], positions[face.a], positions[face.b],
                                       positions[face.c]);
    return weights.x > 0 && weights.y > 0 && weights.z > 0;
}

// Bits (U), for each point, of the garments over which most of the cages around it lie.
Array<int32_t> carry_votes(const Outfit &outfit, Votes votes, Arena &arena) {
    Array<int32_t> over = arena.take<int32_t>(outfit.points.vertices());
    for (int point = 0; point < over.size; point++)
        for (int garment = 0; garment < votes.garments; garment++) {
            float share = 0;
            for (int k = outfit.cage_starts[point]; k < outfit.cage_starts[point + 1]; k++)
                if (votes.of(outfit.cage[k], garment) > 0) share += outfit.cage_weights[k];
            if (share > HALF) over[point] |= 1 << garment;
        }
    return over;
}

// Those bits that a point shares with a hem that was tucked in, by way of points that have them too.
Array<int32_t> reached_from_hems(const Outfit &outfit, Array<int32_t> over, Arena &arena) {
    const Rings &rings = outfit.clearing.rings;
    Array<int32_t> reached = arena.take<int32_t>(over.size);
    List<int32_t> waiting;
    bool is_any = false;
    for (int point = 0; point < over.size; point++) {
        reached[point] = over[point] & outfit.hems[point];
        if (!reached[point]) continue;
        waiting.add(point);
        is_any = true;
    }
    while (waiting.items.size > 0) {
        int point = waiting.items[--waiting.items.size];
        for (int k = rings.starts[point]; k < rings.starts[point + 1]; k++) {
            int next = rings.ring[k];
            int32_t added = reached[point] & over[next] & ~reached[next];
            if (!added) continue;
            reached[next] |= added;
            waiting.add(next);
        }
    }
    return is_any ? reached : Array<int32_t>{};
}

}  // namespace

Array<int32_t> find_points_over(const Outfit &outfit, Array<PointPair> pairs, const Vec *positions,
                                Arena &arena) {
    int garments = outfit.garments(), cages = outfit.cages.vertices();
    if (!outfit.hems.size) return {};
    const ContactMesh &mesh = outfit.solver.mesh;
    Votes votes{arena.take<int32_t>(cages * garments), garments};
    bool is_any = false;
    for (const PointPair &pair : pairs) {
        Face face = mesh.surface.faces.at(pair.indices.second);
        int vertex = pair.indices.first, one = outfit.cage_garments[vertex],
            other = outfit.cage_garments[face.a];
        if (one == other || !is_across(pair, mesh, positions)) continue;
        // Faces look outwards: an inner vertex is over a face on its positive side, an inner face is over a
        // vertex on its negative one.
        int vote = (one < other) == (pair.side > 0) ? 1 : -1;
        is_any = is_any || vote > 0;
        if (one < other)
            votes.of(vertex, other) += vote;
        else
            for (int corner = 0; corner < 3; corner++) votes.of(face[corner], one) += vote;
    }
    return is_any ? reached_from_hems(outfit, carry_votes(outfit, votes, arena), arena) : Array<int32_t>{};
}

}  // namespace uvc
