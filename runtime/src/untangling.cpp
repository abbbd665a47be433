#include "untangling.h"

namespace uvc {

namespace {

// Speed, m/s, at which an edge is moved past a face.
constexpr float UNTANGLING_SPEED = 0.5f;

// Length of a gradient below which a line does not become shorter by a motion of this edge.
constexpr float NO_GRADIENT = 0.1f;

// Cosine to the normal of a face below which an edge lies in its plane.
constexpr float IN_PLANE = 0.05f;

// Whether face g lies on one side of the plane of face f, or touches it.
bool is_on_one_side(const Surface &surface, const Vec *positions, int f, int g) {
    return is_off_plane(surface, positions, f, face_normal(surface, positions, f), g, 0);
}

// Where an edge runs through a face: the share of the way along it, and barycentric coordinates. Returns
// whether it does.
bool meet(const Vec *positions, IndexPair edge, Face face, float &share, Vec &weights) {
    Vec start = positions[edge.first], along = positions[edge.second] - start;
    Vec a = positions[face.a] - start, b = positions[face.b] - start, c = positions[face.c] - start;
    float u = dot(along, cross(b, c)), v = dot(along, cross(c, a)), w = dot(along, cross(a, b));
    float total = u + v + w;
    if (least(least(u, v), w) * most(most(u, v), w) <= 0 || total == 0) return false;
    Vec normal = cross(b - a, c - a);
    float height = dot(a, normal), rise = dot(along, normal);
    if (height * (height - rise) >= 0) return false;
    share = height / rise;
    weights = (1 / total) * Vec{u, v, w};
    return true;
}

// Unit direction of the line where a face meets a plane, from an edge of the face into it; `inner` is the
// corner that the edge does not have.
Vec line_from(const Vec *positions, IndexPair edge, int inner, Vec along, Vec plane) {
    Vec way = positions[inner] - positions[edge.first], across = way - dot(way, along) * along;
    Vec line = cross(cross(along, across), plane);
    float size = length(line);
    if (size == 0) return {};
    return (dot(line, across) < 0 ? -1 / size : 1 / size) * line;
}

}  // namespace

void find_crossings(const ContactMesh &mesh, const Vec *positions, SelfContact &contact) {
    const Surface &surface = mesh.surface;
    const BoxTree &tree = mesh.tree;
    contact.crossings.clear();
    auto look = [&](int f, int g) {
        Face owner = surface.faces.at(f), face = surface.faces.at(g);
        for (int i = 0; i < 3; i++) {
            if (!(mesh.owned.at(f) >> (3 + i) & 1)) continue;
            IndexPair edge{owner[i], owner[(i + 1) % 3]};
            if (face.has(edge.first) || face.has(edge.second)) continue;
            float share;
            Vec weights;
            if (!meet(positions, edge, face, share, weights)) continue;
            int other = surface.neighbours.at(f)[i], beyond = -1;
            if (other >= 0)
                for (int corner = 0; corner < 3; corner++) {
                    int vertex = surface.faces.at(other)[corner];
                    if (vertex != edge.first && vertex != edge.second) beyond = vertex;
                }
            contact.crossings.add({edge, owner[(i + 2) % 3], beyond, g});
        }
    };
    for (IndexPair leaf : contact.leaves.items) {
        int f = tree.order.at(tree.nodes.at(leaf.first).first);
        int g = tree.order.at(tree.nodes.at(leaf.second).first);
        if (is_on_one_side(surface, positions, f, g) || is_on_one_side(surface, positions, g, f)) continue;
        look(f, g);
        look(g, f);
    }
}

void resolve_crossings(const ContactMesh &mesh, const SelfContact &contact, Vec *positions,
                       const Particles &particles, float step) {
    for (const Crossing &crossing : contact.crossings.items) {
        Face face = mesh.surface.faces.at(crossing.face);
        IndexPair edge = crossing.edge;
        float share;
        Vec weights;
        if (!meet(positions, edge, face, share, weights)) continue;
        Vec along = unit(positions[edge.second] - positions[edge.first]);
        Vec plane = unit(face_normal(face, positions));
        float rise = dot(along, plane);
        if (absolute(rise) < IN_PLANE) continue;
        Vec line = line_from(positions, edge, crossing.inner, along, plane);
        if (crossing.beyond >= 0) line += line_from(positions, edge, crossing.beyond, along, plane);
        Vec gradient = line - (2 * dot(line, along) / rise) * plane;
        float size = length(gradient);
        if (size < NO_GRADIENT) continue;
        int32_t corners[] = {edge.first, edge.second, face.a, face.b, face.c};
        float shares[] = {1 - share, share, -weights.x, -weights.y, -weights.z};
        float light = 0;
        for (int k = 0; k < 5; k++) light += shares[k] * shares[k] * particles.inverse_mass.at(corners[k]);
        Vec shift = (UNTANGLING_SPEED * step / (light * size)) * gradient;
        for (int k = 0; k < 5; k++)
            positions[corners[k]] += (shares[k] * particles.inverse_mass.at(corners[k])) * shift;
    }
}

}  // namespace uvc
