// Step size of explicit integration: from the highest frequency and damping of the cloth.
#pragma once

#include "elastic.h"

namespace uvc {

// Longest stable step, s, of symplectic Euler for cloth of masses (N) kg at rest (N) m.
//
// With a largest frequency w and a largest damping rate c, both measured by power iteration on the forces, the
// step h has to keep h^2 w^2 + 2 h c < 4.
float stable_step(const Elastic &elastic, Array<float> mass, const Vec *rest, Arena &work);

}  // namespace uvc
