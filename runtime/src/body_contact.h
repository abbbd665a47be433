// Contact of cloth with the moving body: planes at the closest skin, and Coulomb friction on them.
#pragma once

#include "collider.h"

namespace uvc {

// A vertex near the body, with the plane that the body is for it. wait: substeps until it is looked at again.
// point: m, the closest point of the body before the frame; way: m, its motion in the frame. slide: m that the
// vertex may move past the point until it is searched again.
struct Contact {
    int32_t vertex, face, wait;
    float slide;
    Vec point, way, normal;
};

// Vertex normals of the body at the end of the frame, found where they are needed: they say which side is out.
struct Normals {
    Array<Vec> normals;
    Array<int32_t> known;
};

// Particles of cloth: inverse mass 1/kg, m of other cloth between a vertex and the body, friction.
struct Particles {
    Array<float> mass, inverse_mass, weight, thickness, friction;
};

// Moves vertices out of the body to a distance of radius + thickness, m, without a bounce, with friction. The
// body is at a share of its way through the frame of `seconds`. step: s.
void resolve_contacts(Array<Contact> contacts, const Collider &collider, const BodySweep &sweep,
                      const Normals &normals, float share, Vec *positions, Vec *velocities,
                      const Particles &particles, float radius, float step, float seconds);

}  // namespace uvc
