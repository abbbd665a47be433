// The cloth solver: symplectic Euler in many small substeps, with contact, frame by frame.
#pragma once

#include "elastic.h"
#include "self_contact.h"
#include "uvcloth.h"

namespace uvc {

// What cloth is made of.
struct Material {
    Elastic elastic;
    Particles particles;
};

struct Solver {
    Material material;
    Sheet sheet;
    Collider collider;
    Arena arena;
};

// Reads what `read_elastic`, `read_sheet` and `read_collider` do, and "particles.mass" (N) kg,
// "particles.weight" (N) the share of the mass on which gravity acts, "particles.thickness" (N) m,
// "particles.friction" (N).
void read_solver(const Sections &sections, Solver &solver, Failure &failure);

// Moves cloth of a material through a frame; see uvc_solve in uvcloth.h. Returns whether it stays together.
// work: has to have memory for a frame, and keeps it.
bool step(const Solver &solver, const Material &material, const uvc_motion &motion, Vec *positions,
          Vec *velocities, Searched searched, SelfContact &contact, Arena &work);

}  // namespace uvc
