// A garment on its own texture: what is known of its smooth surface at texels, and back to a finer mesh.
#pragma once

#include "refined.h"
#include "sections.h"
#include "surface.h"

namespace uvc {

// Entries 00, 11 and 01 of two symmetric tensors on the axes of the texture: strain, the first fundamental form
// less the unit matrix, and bending, 1/m, the second one less that at rest.
struct FundamentalForms {
    float strain[3], bend[3];
};

// Unit axes along u, v and the outward normal.
struct Axes {
    Vec u, v, normal;
};

// A turn or a mirror of the texture's plane, row by row.
struct PlaneTurn {
    float a, b, c, d;
};

// P texels of half the size of displacements, which have four quarters each, of a garment of U points.
//
// texels: (P) pixels. corners, shares: (P) place of each texel. slope_starts (P + 1), slope_points: points
// around each texel, and slopes: derivatives along u and v by them, 1/m, without the first of each texel: they
// sum to 0. sides: (P) 1 where u, v and the outward normal are right-handed, or -1. rest: (P) m, rest_forms:
// (P), at rest. beside: pixels next to the texels, the texels of other charts that lie there on the cloth
// (sources), and what turns directions there into directions at the pixel (turns). back: vertices of the
// refined mesh from quarters. rings: neighbours of these. free: (U) share of displacements that are shown.
struct WrinkleSheet {
    Array<Face> faces, corners;
    Array<int32_t> texels, slope_starts, slope_points, beside, sources;
    Array<Vec> shares, rest;
    Array<float> slopes, sides, free;
    Array<FundamentalForms> rest_forms;
    Array<PlaneTurn> turns;
    Refined refined;
    Rings rings;
    Rows back;

    int count() const { return texels.size; }
    int vertices() const { return refined.rows.count(); }
};

// Reads "<prefix>.texels" (P), ".corners" (P, 3), ".shares" (P, 2), ".slope_starts" (P + 1), ".slope_points",
// ".slopes" (.., 2), ".sides" (P), ".beside" (G), ".sources" (G), ".turns" (G, 4), ".back_starts" (n + 1),
// ".back" quarters, the shares ".back_shares", and ".free" (U); for a garment at rest (U) m with faces, on
// `size` x `size` pixels.
WrinkleSheet read_wrinkle_sheet(const Sections &sections, const char *prefix, Array<Vec> rest,
                                Array<Face> faces, int size, Arena &arena, Failure &failure);

// Finds forms and axes (P) at the texels of a garment at points (U), m, with unit normals (U).
void find_forms(const WrinkleSheet &sheet, const Vec *points, const Vec *normals, FundamentalForms *forms,
                Axes *axes, Arena &work);

// Unit normals (U) of cloth at points (U), m: means of faces by their areas.
void find_normals(Array<Face> faces, const Vec *points, Array<Vec> normals);

}  // namespace uvc
