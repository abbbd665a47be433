#include "elastic.h"

#include "lanes.h"

namespace uvc {

namespace {

// Least difference of squared principal stretches, halved, so that their directions are defined.
constexpr float TILT = 1e-7f;

// Square of the stretch below which compressive strain does not grow further.
constexpr float FLATTENED = 1e-2f;

// Positions and velocities of LANES vertices, from rows to lanes: a transposition in registers.
UVC_INLINE void gather(const Row *rows, const int32_t *vertices, LaneVec &x, LaneVec &v) {
    Lanes r[LANES], pairs[LANES], quads[LANES];
    for (int k = 0; k < LANES; k++) r[k] = load(rows[vertices[k]].numbers);
    for (int k = 0; k < LANES; k += 2) {
        pairs[k] = __builtin_shufflevector(r[k], r[k + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        pairs[k + 1] = __builtin_shufflevector(r[k], r[k + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    for (int k = 0; k < LANES; k += 4)
        for (int half = 0; half < 2; half++) {
            Lanes a = pairs[k + half], b = pairs[k + 2 + half];
            quads[k + 2 * half] = __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13);
            quads[k + 2 * half + 1] = __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
        }
    x.x = __builtin_shufflevector(quads[0], quads[4], 0, 1, 2, 3, 8, 9, 10, 11);
    x.y = __builtin_shufflevector(quads[1], quads[5], 0, 1, 2, 3, 8, 9, 10, 11);
    x.z = __builtin_shufflevector(quads[2], quads[6], 0, 1, 2, 3, 8, 9, 10, 11);
    v.x = __builtin_shufflevector(quads[0], quads[4], 4, 5, 6, 7, 12, 13, 14, 15);
    v.y = __builtin_shufflevector(quads[1], quads[5], 4, 5, 6, 7, 12, 13, 14, 15);
    v.z = __builtin_shufflevector(quads[2], quads[6], 4, 5, 6, 7, 12, 13, 14, 15);
}

// Adds forces in lanes to the rows of their vertices, one vertex after another: two may be the same.
UVC_INLINE void scatter(LaneVec f, const int32_t *vertices, Force *forces) {
    Lanes none{};
    Lanes xy_low = __builtin_shufflevector(f.x, f.y, 0, 8, 1, 9, 4, 12, 5, 13);
    Lanes xy_high = __builtin_shufflevector(f.x, f.y, 2, 10, 3, 11, 6, 14, 7, 15);
    Lanes z_low = __builtin_shufflevector(f.z, none, 0, 8, 1, 9, 4, 12, 5, 13);
    Lanes z_high = __builtin_shufflevector(f.z, none, 2, 10, 3, 11, 6, 14, 7, 15);
    forces[vertices[0]] += __builtin_shufflevector(xy_low, z_low, 0, 1, 8, 9);
    forces[vertices[1]] += __builtin_shufflevector(xy_low, z_low, 2, 3, 10, 11);
    forces[vertices[2]] += __builtin_shufflevector(xy_high, z_high, 0, 1, 8, 9);
    forces[vertices[3]] += __builtin_shufflevector(xy_high, z_high, 2, 3, 10, 11);
    forces[vertices[4]] += __builtin_shufflevector(xy_low, z_low, 4, 5, 12, 13);
    forces[vertices[5]] += __builtin_shufflevector(xy_low, z_low, 6, 7, 14, 15);
    forces[vertices[6]] += __builtin_shufflevector(xy_high, z_high, 4, 5, 12, 13);
    forces[vertices[7]] += __builtin_shufflevector(xy_high, z_high, 6, 7, 14, 15);
}

// Strain of a squared principal stretch, and its slope over the stretch, divided by that: Green's in tension,
// which stiffens as a knit does, Biot's in compression, so that squeezed cloth does not give way.
UVC_INLINE void strain_of(Lanes squared, Lanes &strain, Lanes &slope) {
    Lanes stretch = root(squared);
    LaneMask is_long = is_below(Lanes{} + 1.0f, squared);
    strain = choose(is_long, 0.5f * (squared - 1.0f), stretch - 1.0f);
    slope = choose(is_long, Lanes{} + 1.0f, 1.0f / stretch);
}

// Strain that stresses a face, and its slope over the strain: reduced in compression, since coarse faces
// cannot buckle below their edge length. The slope rises from `reduction` for the first folds to 1 at a strain
// of -1, where the face is flat; or shirts would ruck up on hips and stay so.
UVC_INLINE void reduce(float reduction, Lanes strain, Lanes &reduced, Lanes &slope) {
    float stiffening = reduction - 1.0f;
    LaneMask is_long = is_below(Lanes{}, strain);
    slope = choose(is_long, Lanes{} + 1.0f, reduction + stiffening * strain);
    reduced = choose(is_long, strain, strain * (reduction + 0.5f * stiffening * strain));
}

UVC_INLINE void add_block(const Membrane &m, int k, const Row *rows, Vec wind, Force *forces) {
    LaneVec xa, xb, xc, va, vb, vc;
    gather(rows, m.corners[0].data + k, xa, va);
    gather(rows, m.corners[1].data + k, xb, vb);
    gather(rows, m.corners[2].data + k, xc, vc);
    Lanes d00 = load(m.inverse[0].data + k), d01 = load(m.inverse[1].data + k);
    Lanes d10 = load(m.inverse[2].data + k), d11 = load(m.inverse[3].data + k);
    Lanes area = load(m.area.data + k), shear = load(m.shear.data + k);
    Lanes damping = load(m.damping.data + k);
    LaneVec p = xb - xa, q = xc - xa, p_rate = vb - va, q_rate = vc - va;
    LaneVec f = d00 * p + d10 * q, g = d01 * p + d11 * q;
    LaneVec f_rate = d00 * p_rate + d10 * q_rate, g_rate = d01 * p_rate + d11 * q_rate;
    Lanes c00 = dot(f, f), c11 = dot(g, g), c01 = dot(f, g);
    Lanes mean = 0.5f * (c00 + c11), half = 0.5f * (c00 - c11);
    Lanes apart = root(half * half + c01 * c01) + TILT;
    Lanes high, low, over_long, over_short, tension, compression, upper, lower;
    strain_of(mean + apart, high, over_long);
    strain_of(most(mean - apart, FLATTENED), low, over_short);
    // Both stresses have to come from one energy: each is multiplied by the slope of its reduced strain.
    reduce(m.reduction, high, tension, upper);
    reduce(m.reduction, low, compression, lower);
    Lanes trace = load(m.spread.data + k) * (tension + compression);
    Lanes pull = upper * (2.0f * shear * tension + trace) * over_long;
    Lanes push = lower * (2.0f * shear * compression + trace) * over_short;
    Lanes middle = 0.5f * (pull + push), turned = 0.5f * (pull - push) / apart;
    Lanes s00 = middle + turned * half + damping * dot(f, f_rate);
    Lanes s11 = middle - turned * half + damping * dot(g, g_rate);
    Lanes s01 = turned * c01 + 0.5f * damping * (dot(f, g_rate) + dot(g, f_rate));
    LaneVec first = s00 * f + s01 * g, second = s01 * f + s11 * g;
    LaneVec force_b = (-area * d00) * first + (-area * d01) * second;
    LaneVec force_c = (-area * d10) * first + (-area * d11) * second;
    // Drag of still air by the square of the speed along the normal.
    LaneVec normal = cross(f, g), speeds = va + (1.0f / 3.0f + Lanes{}) * (p_rate + q_rate);
    speeds = {speeds.x + wind.x, speeds.y + wind.y, speeds.z + wind.z};
    Lanes speed = dot(speeds, normal) / root(dot(normal, normal) + TINY);
    LaneVec drag = ((-1.0f / 3.0f) * load(m.pressure.data + k) * area * speed * absolute(speed)) * normal;
    scatter(drag - force_b - force_c, m.corners[0].data + k, forces);
    scatter(drag + force_b, m.corners[1].data + k, forces);
    scatter(drag + force_c, m.corners[2].data + k, forces);
}

UVC_INLINE void add_block(const Hinges &h, int k, const Row *rows, float factor, Force *forces) {
    LaneVec x0, x1, xa, xb, v0, v1, va, vb;
    gather(rows, h.corners[0].data + k, x0, v0);
    gather(rows, h.corners[1].data + k, x1, v1);
    gather(rows, h.corners[2].data + k, xa, va);
    gather(rows, h.corners[3].data + k, xb, vb);
    LaneVec along = xb - xa, n0 = cross(xa - x0, xb - x0), n1 = cross(xb - x1, xa - x1);
    Lanes squared = dot(along, along) + TINY, shorter = 1.0f / root(squared), size = squared * shorter;
    Lanes theta = angle(dot(cross(n0, n1), along) * shorter, dot(n0, n1));
    Lanes s0 = dot(n0, n0), s1 = dot(n1, n1);
    LaneVec o0 = (1.0f / (s0 + TINY)) * n0, o1 = (1.0f / (s1 + TINY)) * n1;
    LaneVec g0 = -size * o0, g1 = -size * o1;
    LaneVec ga = (dot(xb - x0, along) * shorter) * o0 + (dot(xb - x1, along) * shorter) * o1;
    LaneVec gb = (-dot(xa - x0, along) * shorter) * o0 + (-dot(xa - x1, along) * shorter) * o1;
    Lanes rate = dot(g0, v0) + dot(g1, v1) + dot(ga, va) + dot(gb, vb);
    // All four forces fade together, or they would turn the cloth as a whole.
    Lanes fade = least(s0 / (load(h.floors[0].data + k) + TINY), s1 / (load(h.floors[1].data + k) + TINY));
    fade = least(1.0f, fade);
    Lanes stiffness = factor * load(h.stiffness.data + k);
    Lanes moment = -fade * stiffness * (theta - load(h.rest.data + k) + h.damping * rate);
    scatter(moment * g0, h.corners[0].data + k, forces);
    scatter(moment * g1, h.corners[1].data + k, forces);
    scatter(moment * ga, h.corners[2].data + k, forces);
    scatter(moment * gb, h.corners[3].data + k, forces);
}

// Columns of rows, each filled up with zeros to whole blocks.
template <class T> void split(Array<T> rows, int columns, Array<T> *column, Arena &arena) {
    int count = rows.size / columns, blocks = (count + LANES - 1) / LANES;
    for (int j = 0; j < columns; j++) {
        column[j] = arena.take<T>(blocks * LANES);
        for (int k = 0; k < count; k++) column[j][k] = rows[columns * k + j];
    }
}

void read_columns(const Sections &sections, const char *name, int rows, int columns, Array<float> *column,
                  Arena &arena, Failure &failure) {
    Arena work;
    split(read_floats(sections, name, rows, columns, work, failure), columns, column, arena);
}

}  // namespace

Elastic read_elastic(const Sections &sections, int vertices, Arena &arena, Failure &failure) {
    Elastic elastic{};
    Arena work;
    elastic.vertices = vertices;
    Membrane &m = elastic.membrane;
    Array<int32_t> corners = read_indices(sections, "membrane.corners", -1, 3, 0, vertices, work, failure);
    int faces = corners.size / 3;
    split(corners, 3, m.corners, arena);
    m.blocks = (faces + LANES - 1) / LANES;
    read_columns(sections, "membrane.inverse", faces, 4, m.inverse, arena, failure);
    read_columns(sections, "membrane.area", faces, 1, &m.area, arena, failure);
    read_columns(sections, "membrane.shear", faces, 1, &m.shear, arena, failure);
    read_columns(sections, "membrane.spread", faces, 1, &m.spread, arena, failure);
    read_columns(sections, "membrane.damping", faces, 1, &m.damping, arena, failure);
    read_columns(sections, "membrane.pressure", faces, 1, &m.pressure, arena, failure);
    m.reduction = read_number(sections, "membrane.reduction", failure);
    Hinges &h = elastic.hinges;
    corners = read_indices(sections, "hinges.corners", -1, 4, 0, vertices, work, failure);
    int edges = corners.size / 4;
    split(corners, 4, h.corners, arena);
    h.blocks = (edges + LANES - 1) / LANES;
    read_columns(sections, "hinges.stiffness", edges, 1, &h.stiffness, arena, failure);
    read_columns(sections, "hinges.rest", edges, 1, &h.rest, arena, failure);
    read_columns(sections, "hinges.floors", edges, 2, h.floors, arena, failure);
    h.damping = read_number(sections, "hinges.damping", failure);
    return elastic;
}

void add_membrane_forces(const Membrane &membrane, const Row *rows, Vec wind, Force *forces) {
    for (int block = 0; block < membrane.blocks; block++)
        add_block(membrane, block * LANES, rows, wind, forces);
}

void add_hinge_forces(const Hinges &hinges, const Row *rows, float factor, Force *forces) {
    for (int block = 0; block < hinges.blocks; block++)
        add_block(hinges, block * LANES, rows, factor, forces);
}

}  // namespace uvc
