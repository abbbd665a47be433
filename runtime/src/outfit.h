// A baked outfit: all that dresses a character, from the joints to the vertices that are shown.
#pragma once

#include "caps.h"
#include "clearing.h"
#include "opening.h"
#include "skeleton.h"
#include "skinning.h"
#include "solver.h"
#include "wrinkles.h"

namespace uvc {

// Most garments whose order may change: one has a bit.
constexpr int MOST_ORDERED = 31;

// Settings of the solver.
//
// needed: substeps a second. radius: m, kept between cloth and body. self_radius: m, kept between pieces of
// cloth; fold_radius: m, within a piece; self_margin: m more within which cloth is watched. reach: m, how near
// the body, and how deep in it, cloth is looked for. interval: s between two searches. renewal: frames from one
// search of all faces of the body for a vertex to the next. hinge_interval: substeps between two evaluations of
// the hinges.
struct SolverSettings {
    float needed, radius, self_radius, fold_radius, self_margin, reach, interval;
    int renewal, hinge_interval;
};

// Cages, which the solver moves, of garments, whose U welded points follow them, on a body.
//
// size: height of the body over that of the nearest adult; clearances are for adults. used: (C) the vertices
// that cloth may touch, among the body's and the caps' tips. hold: (n) 1/s, attachment of bands. cage_starts
// (U + 1), cage, cage_weights: vertices of the cages around each point; cage_garments: (n) the garment of
// each. hems: (U) for points on a border that nothing holds, bits of the outer garments that it is tucked into:
// their borders are far from it at rest; empty where none is. starts: (G + 1) first point of each garment.
// shapes: (9 (J - 1), V, 3) m, offsets of the body at rest for each number of the joints' turns from those of
// their parents, less one; none for most bodies.
// shown_starts: (G + 1) first shown vertex of each garment, and shown: the point that each lies at. Garments
// with wrinkles are shown on finer meshes instead.
struct Outfit {
    float size;
    Skeleton skeleton;
    Skin body, cages, points;
    Caps caps;
    Opening opening;
    Solver solver;
    Clearing clearing;
    SolverSettings settings;
    Wrinkles wrinkles;
    Array<int32_t> used, cage_starts, cage, cage_garments, hems, starts, shown_starts, shown;
    Array<float> cage_weights, hold, shapes;
    Arena arena;

    int garments() const { return starts.size - 1; }
    // The wrinkles of a garment, null for none.
    const WrinkledGarment *wrinkled(int garment) const;
    // Number of vertices that are shown of a garment.
    int vertices(int garment) const;
};

// Reads what `derive_sections`, `read_skeleton`, `read_caps`, `read_opening`, `read_solver`, `read_clearing`
// and, where there are any, `read_wrinkles` do, skins named "body", "cages" and "points", and the arrays above
// as "outfit.size", "outfit.used", "outfit.hold", "outfit.shapes", "outfit.shown_starts", "outfit.shown",
// "follow.starts", "follow.cage", the shares "follow.weights", and "settings.needed" to
// "settings.hinge_interval".
void read_outfit(const Sections &stored, Outfit &outfit, Failure &failure);

}  // namespace uvc
