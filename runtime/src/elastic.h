// Forces inside cloth: membrane and air on its faces, bending at its hinges.
#pragma once

#include "sections.h"
#include "surface.h"

namespace uvc {

// Faces of cloth, in whole blocks of LANES; those that fill the last one have no area.
//
// corners: three arrays. inverse: 1/m, entries 00, 01, 10, 11 of the inverse of the rest edges' matrix. area:
// m2. shear, spread: N/m, Lame parameters mu and lambda. damping: N s/m, of strain rates. pressure: kg/m3,
// half the density of air times the drag coefficient. reduction: root of the share of the stiffness that is
// left where cloth begins to be compressed; it grows to 1 where a face is flat.
struct Membrane {
    int blocks;
    Array<int32_t> corners[3];
    Array<float> inverse[4], area, shear, spread, damping, pressure;
    float reduction;
};

// Edges between two faces, in whole blocks of LANES.
//
// corners: the two vertices opposite of the edge, then its ends. stiffness: N m. rest: radians. floors: m4,
// square of the doubled area of each face below which forces fade: they would grow without bound. damping: s,
// times the stiffness.
struct Hinges {
    int blocks;
    Array<int32_t> corners[4];
    Array<float> stiffness, rest, floors[2];
    float damping;
};

struct Elastic {
    int vertices;
    Membrane membrane;
    Hinges hinges;
};

// A position and a velocity, each followed by a gap, so that a vertex is one register.
struct Row {
    float numbers[LANES];
};

// A force, N, followed by a gap.
typedef float Force __attribute__((vector_size(16)));

// Reads "membrane.corners" (M, 3), "membrane.inverse" (M, 4), "membrane.area", ".shear", ".spread",
// ".damping", ".pressure" (M), ".reduction" (1), "hinges.corners" (E, 4), "hinges.stiffness", ".rest" (E),
// ".floors" (E, 2) and ".damping" (1).
Elastic read_elastic(const Sections &sections, int vertices, Arena &arena, Failure &failure);

// Adds the forces, N, of all faces. wind: m/s, velocity of the frame of reference through the air.
void add_membrane_forces(const Membrane &membrane, const Row *rows, Vec wind, Force *forces);

// Adds the forces, N, of all hinges, times a factor.
void add_hinge_forces(const Hinges &hinges, const Row *rows, float factor, Force *forces);

}  // namespace uvc
