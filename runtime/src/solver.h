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
    ContactMesh mesh;
    Collider collider;
    Arena arena;
};

// Reads what `read_elastic`, `read_contact_mesh` and `read_collider` do, and "particles.mass" (N) kg,
// "particles.weight" (N) the share of the mass on which gravity acts, "particles.thickness" (N) m,
// "particles.friction" (N).
void read_solver(const Sections &sections, Solver &solver, Failure &failure);

// Whether cloth can follow the body through a frame, and the frame is not too long. Says why if not.
bool can_follow(const Solver &solver, const uvc_motion &motion, Failure &failure);

// Outcomes of a frame without substeps.
constexpr int FLIES_APART = 0, REFUSED = -1;

// Moves cloth of a material through a frame, with as many substeps as it takes; see uvc_solve in uvcloth.h.
// Returns their number, or one of the outcomes above and a sentence, and leaves everything as it was.
int step(const Solver &solver, const Material &material, const uvc_motion &motion, Vec *positions,
         Vec *velocities, ContactCache searched, SelfContact &contact, Arena &work, Failure &failure);

}  // namespace uvc
