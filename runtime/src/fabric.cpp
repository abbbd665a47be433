// What acts on the cloth of a character, and what it is made of, while it plays.
#include "character.h"
#include "stability.h"

namespace uvc {

namespace {

// Greatest wind, m/s, and gravity, m/s2.
constexpr double STRONGEST = 100;

// Least and greatest factor on the numbers of a fabric.
constexpr float LEAST_FACTOR = 0.01f, GREATEST_FACTOR = 100;

// Substeps a second that no fabric needs.
constexpr float MOST_NEEDED = 1e6f;

bool is_weak(Vec64 vector) { return dot(vector, vector) <= STRONGEST * STRONGEST; }

bool is_factor(float number) { return number >= LEAST_FACTOR && number <= GREATEST_FACTOR; }

bool has_factors(Fabric fabric) {
    return is_factor(fabric.density) && is_factor(fabric.stretch) && is_factor(fabric.bend);
}

bool is_baked(Fabric fabric) { return fabric.density == 1 && fabric.stretch == 1 && fabric.bend == 1; }

void multiply(Array<float> numbers, Array<int32_t> corners, const Character &character, float Fabric::*factor) {
    for (int k = 0; k < numbers.size; k++)
        numbers[k] *= character.fabrics[character.outfit.cage_garments[corners[k]]].*factor;
}

}  // namespace

void renew_material(Character &character) {
    const Outfit &outfit = character.outfit;
    const Material &baked = outfit.solver.material;
    Arena &work = character.scratch;
    Scope scope(work);
    bool is_changed = false;
    for (Fabric fabric : character.fabrics) is_changed |= !is_baked(fabric);
    character.material = baked;
    character.needed = outfit.settings.needed;
    character.fabric_memory.clear();
    if (!is_changed) return;
    Arena &arena = character.fabric_memory;
    Membrane &membrane = character.material.elastic.membrane;
    Hinges &hinges = character.material.elastic.hinges;
    Particles &particles = character.material.particles;
    membrane.shear = arena.copy(membrane.shear);
    membrane.spread = arena.copy(membrane.spread);
    membrane.damping = arena.copy(membrane.damping);
    hinges.stiffness = arena.copy(hinges.stiffness);
    particles.mass = arena.copy(particles.mass);
    particles.inverse_mass = arena.copy(particles.inverse_mass);
    multiply(membrane.shear, membrane.corners[0], character, &Fabric::stretch);
    multiply(membrane.spread, membrane.corners[0], character, &Fabric::stretch);
    multiply(membrane.damping, membrane.corners[0], character, &Fabric::stretch);
    multiply(hinges.stiffness, hinges.corners[0], character, &Fabric::bend);
    for (int k = 0; k < particles.mass.size; k++) {
        particles.mass[k] *= character.fabrics[outfit.cage_garments[k]].density;
        particles.inverse_mass[k] = 1 / particles.mass[k];
    }
    const Vec *rest = reinterpret_cast<const Vec *>(outfit.cages.rest.data);
    float before = stable_step(baked.elastic, baked.particles.mass, rest, work);
    float after = stable_step(character.material.elastic, particles.mass, rest, work);
    character.needed *= before / after;
}

bool could_be_set(const Character &character) {
    bool all = is_weak(character.wind) && is_weak(character.gravity);
    for (Fabric fabric : character.fabrics) all = all && has_factors(fabric);
    return all;
}

bool set_world(Character &character, Vec64 wind, Vec64 gravity, Failure &failure) {
    if (!is_weak(wind) || !is_weak(gravity)) {
        failure.say("wind of more than %d m/s, or gravity of more than %d m/s2", (int)STRONGEST,
                    (int)STRONGEST);
        return false;
    }
    character.wind = wind;
    character.gravity = gravity;
    return true;
}

bool set_fabric(Character &character, int garment, Fabric fabric, Failure &failure) {
    if (garment < 0 || garment >= character.fabrics.size) {
        failure.say("there is no garment %d, the outfit has %d", garment, character.fabrics.size);
        return false;
    }
    if (!has_factors(fabric)) {
        failure.say("a factor on the fabric of garment %d is not between 0.01 and 100", garment);
        return false;
    }
    Fabric before = character.fabrics[garment];
    character.fabrics[garment] = fabric;
    renew_material(character);
    // Too stiff for its weight: NaN where no step is stable.
    if (character.needed < MOST_NEEDED) return true;
    character.fabrics[garment] = before;
    renew_material(character);
    failure.say("garment %d is too stiff for its weight", garment);
    return false;
}

}  // namespace uvc
