// A character in a baked outfit: its cloth, from one frame to the next.
#pragma once

#include "outfit.h"

namespace uvc {

// Positions, m, around an origin, which move with it.
//
// cages: (n) skinned. body: (C) the opened collider. skin: (V) and points: (U) skinned.
struct Posed {
    Vec64 origin;
    Array<Vec> cages, body, skin, points;
};

// Factors on the weight per area of a garment, and on its stiffness in the plane and in bending, as it was
// baked.
struct Fabric {
    float density = 1, stretch = 1, bend = 1;
};

// All that a character's cloth remembers; everything is in the frame of `place`, that of the first root.
//
// root: transform of the first joint in the last pose that the cloth could follow; spin: radians/s, its
// turning about the vertical. steps: since the start; solved: frames that were solved. guide: (n) m, and
// rate, 1/s: what pulls the cages, if the rate is not 0. wind, m/s, and gravity, m/s2, are in the world.
// fabrics: (G); material: what they make of the outfit's; needed: substeps a second. origin: mean of the
// cages' targets, m; drift: m/s, its velocity. positions, m, and velocities, m/s, of the cloth (n), targets
// (n) and collider (C) are around that origin. memory: of the clearing. shown: (U) points around
// shown_origin, and wrinkled: vertices of garments with wrinkles, of which folds is the memory; `posed` is of
// the last pose that was asked for, shown of the last that the cloth could follow. fabric_memory: of a changed
// material; scratch: for a frame.
struct Character {
    const Outfit &outfit;
    bool is_started;
    GroundFrame place;
    RigidTransform root;
    double spin;
    int steps, solved;
    float rate;
    Vec64 wind, gravity, origin, drift, shown_origin;
    Array<Fabric> fabrics;
    Material material;
    float needed;
    Array<Vec64> guide;
    Array<Vec> positions, velocities, targets, body, shown, wrinkled;
    ContactCache searched;
    SelfContact contact;
    ClearingMemory memory;
    WrinkleMemory folds;
    Posed posed;
    OpeningWork opening;
    Arena arena, fabric_memory, scratch;

    explicit Character(const Outfit &outfit);
};

// Pulls the cages to points (n), m, in the world, by springs of a frequency, 1/s, until it is told otherwise.
void pull(Character &character, const Vec64 *points, float rate);

// Sets wind, m/s, and gravity, m/s2, in the world. Returns false, with a sentence, for what no cloth follows.
bool set_world(Character &character, Vec64 wind, Vec64 gravity, Failure &failure);

// Changes the fabric of a garment. Returns false, with a sentence, for factors that no fabric has.
bool set_fabric(Character &character, int garment, Fabric fabric, Failure &failure);

// Whether the wind, the gravity and the fabrics are those that could be set.
bool could_be_set(const Character &character);

// Makes the material of the fabrics anew.
void renew_material(Character &character);

// Lets cloth come to rest on the body in its pose of joints' transforms (J) from rest, to which it goes from
// its rest pose; or from what pulls it, if that is stronger than 0. Shows the garments. Returns false, with a
// sentence, for joints that are not finite, or cloth that cannot rest.
bool start(Character &character, const RigidTransform *joints, Failure &failure);

// Moves cloth to the next frame of so many seconds, and clears the garments that follow it. Where the root
// jumps, the cloth is carried along. Returns false, with a sentence, and leaves the cloth as it was, for joints
// that are not finite, a body that is too fast, or cloth that flies apart.
bool step(Character &character, const RigidTransform *joints, float seconds, Failure &failure);

// Bytes of all that a character's cloth remembers now.
size_t saved_size(const Character &character);

// Writes them.
void save(const Character &character, uint8_t *bytes);

// Reads what `save` wrote for a character in the same outfit. Returns false if these are other bytes.
bool restore(Character &character, const uint8_t *bytes, size_t size);

}  // namespace uvc
