#include "outfit.h"

#include "derived.h"
#include "shares.h"

namespace uvc {

namespace {

// Most substeps a second, somewhat more than the 60,000 above which cloth is not baked, and longest of the
// distances, m, of contact: with more, a frame would take for ever.
constexpr float MOST_NEEDED = 65536, LONGEST_DISTANCE = 0.2f;

// Metres at rest from an outer garment's borders from which on a hem is tucked into it.
constexpr float TUCKED = 0.05f;

SolverSettings read_settings(const Sections &sections, Failure &failure) {
    SolverSettings settings{};
    settings.needed = read_number(sections, "settings.needed", failure);
    settings.radius = read_number(sections, "settings.radius", failure);
    settings.self_radius = read_number(sections, "settings.self_radius", failure);
    settings.fold_radius = read_number(sections, "settings.fold_radius", failure);
    settings.self_margin = read_number(sections, "settings.self_margin", failure);
    settings.reach = read_number(sections, "settings.reach", failure);
    settings.interval = read_number(sections, "settings.interval", failure);
    settings.renewal = (int)clamp(read_number(sections, "settings.renewal", failure), 1, 1000);
    settings.hinge_interval = (int)clamp(read_number(sections, "settings.hinge_interval", failure), 1, 16);
    if (!(settings.needed > 0 && settings.needed <= MOST_NEEDED && settings.interval > 0))
        failure.say("the settings of the outfit leave no time step");
    const float distances[] = {settings.radius, settings.self_radius, settings.fold_radius,
                               settings.self_margin, settings.reach};
    for (float distance : distances)
        if (!(distance >= 0 && distance <= LONGEST_DISTANCE))
            failure.say("a distance of contact in the settings of the outfit is not from 0 to 0.2 m");
    return settings;
}

// Whether parts have the sizes of each other.
void check_sizes(const Outfit &outfit, Failure &failure) {
    const Outfit &o = outfit;
    if (failure.failed) return;
    if (o.cages.vertices() != o.solver.material.particles.mass.size)
        failure.say("the outfit's cages have not as many vertices as its cloth");
    if (o.points.vertices() != o.clearing.rest.size)
        failure.say("the outfit's points are not as many as those that are cleared");
    if (o.used.size != o.solver.collider.surface.vertices ||
        o.used.size != o.clearing.collider.surface.vertices)
        failure.say("the outfit's collider has not as many vertices as are used");
    if (o.clearing.skin_vertices != o.body.vertices())
        failure.say("the skin that the outfit covers has not as many vertices as its body");
}

// The garment of each vertex of the cages: that of the points around it, or of its neighbours where there is
// none.
Array<int32_t> find_cage_garments(const Outfit &outfit, Arena &arena) {
    Array<int32_t> garments = arena.take<int32_t>(outfit.cages.vertices());
    for (int32_t &garment : garments) garment = -1;
    for (int garment = 0; garment < outfit.garments(); garment++)
        for (int point = outfit.starts[garment]; point < outfit.starts[garment + 1]; point++)
            for (int k = outfit.cage_starts[point]; k < outfit.cage_starts[point + 1]; k++)
                garments[outfit.cage[k]] = garment;
    const Array<Face> &faces = outfit.solver.mesh.surface.faces;
    for (bool is_new = true; is_new;) {
        is_new = false;
        for (Face face : faces)
            for (int corner = 0; corner < 3; corner++) {
                int32_t &garment = garments[face[corner]], other = garments[face[(corner + 1) % 3]];
                if (garment >= 0 || other < 0) continue;
                garment = other;
                is_new = true;
            }
    }
    for (int32_t &garment : garments) garment = most(garment, 0);
    return garments;
}

// Whether each vertex is on a border, where it has more neighbours than faces.
Array<int32_t> find_borders(Array<Face> faces, const Rings &rings, Arena &arena) {
    Array<int32_t> is_border = arena.take<int32_t>(rings.starts.size - 1);
    for (Face face : faces)
        for (int corner = 0; corner < 3; corner++) is_border[face[corner]]--;
    for (int k = 0; k < is_border.size; k++)
        is_border[k] = is_border[k] + rings.starts[k + 1] - rings.starts[k] > 0;
    return is_border;
}

// For points on borders that no cage holds, the outer garments whose borders are far away at rest, as bits;
// nothing where no garment is tucked into another.
Array<int32_t> find_hems(const Outfit &outfit, Arena &arena) {
    int garments = outfit.garments();
    if (garments < 2 || garments > MOST_ORDERED) return {};
    const Clearing &fine = outfit.clearing;
    Arena work;
    Array<int32_t> is_border = find_borders(fine.cloth.faces, fine.rings, work);
    Array<int32_t> hems = arena.take<int32_t>(outfit.points.vertices());
    List<IndexPair> borders;  // Garments, and their points on borders, the outermost garment first.
    int32_t outer = 0, tucked = 0;
    for (int garment = garments - 1; garment >= 0; garment--) {
        for (int point = outfit.starts[garment]; point < outfit.starts[garment + 1]; point++) {
            bool is_free = is_border[point];
            for (int k = outfit.cage_starts[point]; k < outfit.cage_starts[point + 1]; k++)
                is_free = is_free && !(outfit.hold[outfit.cage[k]] > 0);
            if (!is_free) continue;
            hems[point] = outer;
            for (IndexPair other : borders.items)
                if (length(fine.rest[point] - fine.rest[other.second]) <= TUCKED)
                    hems[point] &= ~(1 << other.first);
            tucked |= hems[point];
        }
        for (int point = outfit.starts[garment]; point < outfit.starts[garment + 1]; point++)
            if (is_border[point]) borders.add({garment, point});
        outer |= 1 << garment;
    }
    return tucked ? hems : Array<int32_t>{};
}

}  // namespace

const WrinkledGarment *Outfit::wrinkled(int garment) const {
    for (const WrinkledGarment &one : wrinkles.garments)
        if (one.garment == garment) return &one;
    return nullptr;
}

int Outfit::vertices(int garment) const {
    const WrinkledGarment *one = wrinkled(garment);
    return one ? one->sheet.vertices() : shown_starts[garment + 1] - shown_starts[garment];
}

void read_outfit(const Sections &stored, Outfit &outfit, Failure &failure) {
    Arena work, &arena = outfit.arena;
    Sections sections = stored;
    derive_sections(sections, work, failure);
    outfit.size = read_number(sections, "outfit.size", failure);
    outfit.skeleton = read_skeleton(sections, arena, failure);
    int joints = outfit.skeleton.parents.size;
    outfit.body = read_skin(sections, "body", joints, arena, failure);
    outfit.cages = read_skin(sections, "cages", joints, arena, failure);
    outfit.points = read_skin(sections, "points", joints, arena, failure);
    int cages = outfit.cages.vertices(), points = outfit.points.vertices();
    int numbers = 3 * outfit.body.vertices();
    outfit.shapes = read_floats(sections, "outfit.shapes", -1, numbers, arena, failure);
    if (outfit.shapes.size && outfit.shapes.size != 9 * (int64_t)(joints - 1) * numbers)
        failure.say("section outfit.shapes of the outfit has not nine rows for each joint but the root");
    Array<int32_t> tips = read_integers(sections, "caps.tips", -1, 1, arena, failure);
    int vertices = outfit.body.vertices() + tips.size;
    outfit.caps = read_caps(sections, vertices, arena, failure);
    read_opening(sections, vertices, outfit.opening, arena, failure);
    outfit.used = read_indices(sections, "outfit.used", -1, 1, 0, vertices, arena, failure);
    read_solver(sections, outfit.solver, failure);
    read_clearing(sections, outfit.clearing, failure);
    outfit.settings = read_settings(sections, failure);
    outfit.hold = read_floats(sections, "outfit.hold", cages, 1, arena, failure);
    outfit.cage = read_indices(sections, "follow.cage", -1, 1, 0, cages, arena, failure);
    outfit.cage_starts = read_starts(sections, "follow.starts", points, outfit.cage.size, arena, failure);
    outfit.cage_weights = read_shares(sections, "follow.weights", outfit.cage_starts, arena, failure);
    Array<int32_t> starts = read_integers(sections, "garments.starts", -1, 1, arena, failure);
    int garments = most(starts.size - 1, 0);
    outfit.starts = read_starts(sections, "garments.starts", garments, points, arena, failure);
    outfit.shown = read_indices(sections, "outfit.shown", -1, 1, 0, points, arena, failure);
    outfit.shown_starts =
        read_starts(sections, "outfit.shown_starts", garments, outfit.shown.size, arena, failure);
    check_sizes(outfit, failure);
    if (has_wrinkles(sections)) outfit.wrinkles = read_wrinkles(sections, arena, failure);
    if (failure.failed) return;
    outfit.cage_garments = find_cage_garments(outfit, arena);
    outfit.hems = find_hems(outfit, arena);
}

}  // namespace uvc
