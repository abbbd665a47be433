// Cloth that runs through itself: edges and faces are moved so that the lines where they meet become shorter.
#pragma once

#include "self_contact.h"

namespace uvc {

// Finds the edges that run through faces, of the faces that the last search has in `leaves`. Those of a face
// with a corner at an end of the edge do not count.
void find_crossings(const ContactMesh &mesh, const Vec *positions, SelfContact &contact);

// Moves edges past the faces that they run through, at a speed that a fold can follow, along the gradient of
// the length of the line where their faces meet (Volino and Magnenat-Thalmann 2006). A line shrinks from its
// ends, until the cloth is out of itself. step: s.
void resolve_crossings(const ContactMesh &mesh, const SelfContact &contact, Vec *positions,
                       const Particles &particles, float step);

}  // namespace uvc
