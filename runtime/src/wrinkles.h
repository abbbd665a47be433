// Wrinkles: folds that cages are too coarse for, which a network displaces a finer mesh by.
#pragma once

#include "near_cloth.h"
#include "wrinkle_network.h"
#include "wrinkle_sheet.h"

namespace uvc {

// A garment with wrinkles. garment: its place in the outfit. points, texels, vertices: first of its points
// among those of the outfit, and of its texels and vertices among those of all garments with wrinkles.
// rings: neighbours of its points.
struct WrinkledGarment {
    WrinkleSheet sheet;
    Rings rings;
    int garment, points, texels, vertices;
};

// Garments of an outfit with wrinkles. cloth, faces: of all garments. thickness: (U) m of other cloth between
// a point and the body. gain: factor on displacements. lag: s after which they have gone 63 % of the way to new
// ones. points: U; texels, vertices: of all these garments.
struct Wrinkles {
    WrinkleNetwork network;
    Array<WrinkledGarment> garments;
    WholeSkin skin;
    Cloth cloth;
    Array<Face> faces;
    Array<float> thickness;
    float gain, lag;
    int points, texels, vertices;
};

// What is remembered of the frame before. points (U) m, velocities (U) m/s; forms (P) and displacements (P, 12)
// m of the texels of all garments; faces: (U) the closest skin. frames: how many there were.
struct WrinkleMemory {
    int32_t *frames;
    Vec *points, *velocities;
    int32_t *faces;
    FundamentalForms *forms;
    float *displacements;
};

// Whether an outfit has wrinkles.
bool has_wrinkles(const Sections &sections);

// Reads what `read_wrinkle_network` and, for each of "wrinkles.garments" by the prefix "wrinkles0" and so on,
// `read_wrinkle_sheet` do, and "wrinkles.gain", "wrinkles.lag", "points.rest" (U, 3) m, "fine.faces" (M, 3),
// "fine.thickness" (U), "garments.starts", "skin.rest" (V, 3) and "skin.faces".
Wrinkles read_wrinkles(const Sections &sections, Arena &arena, Failure &failure);

// Bytes of the memory.
size_t memory_size(const Wrinkles &wrinkles);

// Views of so many bytes, at a multiple of four.
WrinkleMemory lay_out(const Wrinkles &wrinkles, void *bytes);

// Sets memory up before the first frame, from which nothing is known.
void begin(const Wrinkles &wrinkles, const WrinkleMemory &memory);

// Whether a frame may go on from memory, bytes of its size.
bool is_whole(const Wrinkles &wrinkles, const WrinkleMemory &memory);

// Makes the vertices, m, of the refined meshes of all garments with wrinkles in the next frame, `seconds` after
// the one before, of the outfit's points (U), m, on a body with skin (V), m. way: m, of the origin since then.
void wrinkle(const Wrinkles &wrinkles, const WrinkleMemory &memory, const Vec *points, const Vec *skin,
             float seconds, Vec way, Vec *vertices, Arena &work);

}  // namespace uvc
