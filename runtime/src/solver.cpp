#include "solver.h"

#include "untangling.h"

namespace uvc {

namespace {

// Metres more than where cloth touches the body within which it is watched.
constexpr float WATCHED = 0.004f;

// Impossible speed of cloth past its frame of reference, m/s: it has flown apart.
constexpr float FASTEST = 200.0f;

// Metres from the body up to which a vertex is followed: farther off, a face elsewhere may be closer.
constexpr float CLOSE = 0.01f;

// Greatest speed of a body, m/s, past the frame of reference, that can be followed.
constexpr float FASTEST_BODY = 40.0f;

// Times that a frame is repeated, each with twice the substeps.
constexpr int RETRIES = 2;

// Substeps of a frame at most.
constexpr double MOST_SUBSTEPS = 1e6;

// Substeps of a frame, and those from one search for cloth, and one for the body's faces, to the next.
struct Substepping {
    int substeps, interval, body_interval;
};

const Vec *vectors(const float *numbers) { return reinterpret_cast<const Vec *>(numbers); }

// Sets forces to the weight plus mass times an acceleration from outside, and copies rows.
void begin_substep(const Particles &particles, const uvc_motion &motion, const Vec *positions,
                   const Vec *velocities, Array<Row> rows, Array<Force> forces) {
    const Vec *acceleration = vectors(motion.acceleration);
    const float *gravity = motion.gravity;
    for (int k = 0; k < rows.size; k++) {
        Vec x = positions[k], v = velocities[k];
        rows.at(k) = {{x.x, x.y, x.z, 0, v.x, v.y, v.z, 0}};
        float mass = particles.mass.at(k), weight = particles.weight.at(k);
        Force force{gravity[0] * weight * mass, gravity[1] * weight * mass, gravity[2] * weight * mass, 0};
        if (acceleration)
            force += Force{mass * acceleration[k].x, mass * acceleration[k].y, mass * acceleration[k].z, 0};
        forces.at(k) = force;
    }
}

// Adds the forces of damped springs to the targets, at a share of the way through the frame.
void add_pull(const Particles &particles, const uvc_motion &motion, Array<int32_t> pulled, float share,
              const Vec *positions, const Vec *velocities, Array<Force> forces) {
    const Vec *start = vectors(motion.target_start), *end = vectors(motion.target_end);
    for (int32_t k : pulled) {
        float rate = motion.pull[k], mass = particles.mass.at(k);
        Vec way = end[k] - start[k], error = start[k] + share * way - positions[k];
        Vec lag = (1 / motion.seconds) * way - velocities[k];
        Vec force = (mass * rate) * (rate * error + (2 * motion.damping[k]) * lag);
        forces.at(k) += Force{force.x, force.y, force.z, 0};
    }
}

// Symplectic Euler. rounded: rounding errors of the positions: without them slow vertices would not move in
// small substeps.
void integrate(const Particles &particles, Array<Force> forces, float step, Vec *positions, Vec *velocities,
               Array<Vec64> rounded) {
    for (int k = 0; k < forces.size; k++) {
        Force force = forces.at(k);
        velocities[k] += (step * particles.inverse_mass.at(k)) * Vec{force[0], force[1], force[2]};
        Vec64 exact = wide(positions[k]) + rounded.at(k) + (double)step * wide(velocities[k]);
        positions[k] = narrow(exact);
        rounded.at(k) = exact - wide(positions[k]);
    }
}

// Whether all vertices are somewhere, and none is too fast.
bool stays_together(const Vec *positions, const Vec *velocities, int vertices) {
    for (int k = 0; k < vertices; k++)
        if (!(dot(velocities[k], velocities[k]) < FASTEST * FASTEST) ||
            !is_finite(dot(positions[k], positions[k])))
            return false;
    return true;
}

float fastest(const Vec *ways, int count) {
    float squared = 0;
    for (int k = 0; k < count; k++) squared = most(squared, dot(ways[k], ways[k]));
    return root(squared);
}

// Greatest speed of the body, m/s, past the frame of reference; not a number where a vertex is none.
float body_speed(const Solver &solver, const uvc_motion &motion) {
    const Vec *start = vectors(motion.body_start), *end = vectors(motion.body_end);
    float squared = 0;
    for (int k = 0; k < solver.collider.surface.vertices; k++) {
        Vec way = end[k] - start[k];
        float length = dot(way, way);
        if (!(length >= 0)) return length;
        squared = most(squared, length);
    }
    return root(squared) / motion.seconds;
}

double needed_substeps(const uvc_motion &motion) { return (double)motion.seconds * motion.needed; }

// Whether cloth can follow a body of a speed, m/s, through a frame that is not too long. Says why if not.
bool can_follow(float past, const uvc_motion &motion, Failure &failure) {
    if (!(past >= 0)) failure.say("a vertex of the body is not a finite number");
    if (past > FASTEST_BODY)
        failure.say("the body moves at %d m/s past the cloth in a frame, the limit is %d m/s",
                    (int)least(1e9f, past), (int)FASTEST_BODY);
    if (!(needed_substeps(motion) < MOST_SUBSTEPS))
        failure.say("a frame of %d s needs too many substeps", (int)least(1e9f, motion.seconds));
    return !failure.failed;
}

template <class T>
void put_back(T *to, Array<T> from) {
    memcpy(to, from.data, sizeof(T) * (size_t)from.size);
}

// An interval in whole substeps.
int whole(float substeps) { return (int)most(1.0f, least((float)MOST_SUBSTEPS, substeps)); }

// Moves cloth through a frame at a pace. Returns whether it stays together.
bool move(const Solver &solver, const Material &material, const uvc_motion &motion, Substepping steps,
          Vec *positions, Vec *velocities, ContactCache searched, SelfContact &contact, Arena &work) {
    Scope scope(work);
    const Collider &collider = solver.collider;
    const Elastic &elastic = material.elastic;
    const Particles &particles = material.particles;
    int vertices = particles.mass.size;
    Array<Row> rows = work.take<Row>(vertices);
    Array<Force> forces = work.take<Force>(vertices);
    Array<Vec64> rounded = work.take<Vec64>(vertices);
    contact.boxes = work.take<Box>(solver.mesh.tree.nodes.size);
    contact.speeds = work.take<Box>(solver.mesh.tree.nodes.size);
    contact.cones = work.take<NormalCone>(solver.mesh.tree.nodes.size);
    BodySweep sweep =
        begin_sweep(collider, vectors(motion.body_start), vectors(motion.body_end), positions, searched,
                    motion.frame, motion.renewal, work);
    Array<int32_t> caught = work.take<int32_t>(vertices);
    bool any_caught =
        find_penetrated(collider, vectors(motion.body_start), positions, sweep.parts, caught.data);
    Array<float> watched = work.take<float>(vertices);
    for (int k = 0; k < vertices; k++)
        watched[k] = motion.radius + WATCHED + particles.thickness[k];
    ProximityQuery watch{velocities, watched.data, (float)steps.body_interval / (float)steps.substeps,
                         motion.seconds, motion.reach, CLOSE};
    Array<ContactCandidate> found = work.take<ContactCandidate>(collider.parts * vertices);
    Array<Contact> near = work.take<Contact>(collider.parts * vertices), contacts{near.data, 0};
    Normals normals{work.take<Vec>(collider.surface.vertices), work.take<int32_t>(collider.surface.vertices)};
    Array<int32_t> pulled = work.take<int32_t>(vertices);
    pulled.size = 0;
    for (int k = 0; k < vertices; k++)
        if (motion.pull[k] != 0) pulled[pulled.size++] = k;
    SelfDistances distances{motion.self_radius, most(motion.self_radius, motion.fold_radius),
                            motion.self_margin};
    Vec wind{motion.drift[0], motion.drift[1], motion.drift[2]};
    float step = motion.seconds / (float)steps.substeps;
    for (int substep = 0; substep < steps.substeps; substep++) {
        float share = (float)(substep + 1) / (float)steps.substeps;
        begin_substep(particles, motion, positions, velocities, rows, forces);
        add_membrane_forces(elastic.membrane, rows.data, wind, forces.data);
        if (substep % motion.hinge_interval == 0)
            add_hinge_forces(elastic.hinges, rows.data,
                             (float)least(motion.hinge_interval, steps.substeps - substep), forces.data);
        add_pull(particles, motion, pulled, share, positions, velocities, forces);
        integrate(particles, forces, step, positions, velocities, rounded);
        // Where everything is near everything, a search would take for ever.
        if (substep % steps.interval == 0 && !stays_together(positions, velocities, vertices)) return false;
        if (motion.self_contact) {
            if (substep % steps.interval == 0) {
                if (!find_pairs(solver.mesh, positions, velocities, distances, step * (float)steps.interval,
                                contact))
                    return false;
                find_crossings(solver.mesh, positions, contact);
                if (any_caught) drop_caught(solver.mesh, collider, caught.data, contact);
            }
            resolve_pairs(solver.mesh, contact, positions, velocities, particles, step);
            resolve_crossings(solver.mesh, contact, positions, particles, step);
        }
        if (collider.surface.faces.size == 0) continue;
        if (substep % steps.body_interval == 0) {
            contacts.size = find_near(collider, sweep, share, positions, watch, found, work);
            for (int k = 0; k < contacts.size; k++)
                contacts[k] = {found[k].vertex, found[k].face, 0, 0, {}, {}, {}};
        }
        resolve_contacts(contacts, collider, sweep, normals, share, positions, velocities,
                         particles, motion.radius, step, motion.seconds);
    }
    end_sweep(collider, sweep, positions);
    return stays_together(positions, velocities, vertices);
}

}  // namespace

void read_solver(const Sections &sections, Solver &solver, Failure &failure) {
    Arena &arena = solver.arena;
    solver.mesh = read_contact_mesh(sections, arena, failure);
    int vertices = solver.mesh.surface.vertices;
    solver.material.elastic = read_elastic(sections, vertices, arena, failure);
    solver.collider = read_collider(sections, "cloth.touches", "cloth.crossed", arena, failure);
    Particles &p = solver.material.particles;
    p.mass = read_floats(sections, "particles.mass", vertices, 1, arena, failure);
    p.weight = read_floats(sections, "particles.weight", vertices, 1, arena, failure);
    p.thickness = read_floats(sections, "particles.thickness", vertices, 1, arena, failure);
    p.friction = read_floats(sections, "particles.friction", vertices, 1, arena, failure);
    if (!failure.failed && solver.collider.touches.size != vertices)
        failure.say("section cloth.touches of the outfit has not a row for each vertex");
    if (failure.failed) return;
    p.inverse_mass = arena.take<float>(vertices);
    for (int k = 0; k < vertices; k++) {
        if (!(p.mass[k] > 0)) failure.say("vertex %d of the outfit has no mass", k);
        p.inverse_mass[k] = 1 / p.mass[k];
    }
}

bool can_follow(const Solver &solver, const uvc_motion &motion, Failure &failure) {
    return can_follow(body_speed(solver, motion), motion, failure);
}

int step(const Solver &solver, const Material &material, const uvc_motion &motion, Vec *positions,
         Vec *velocities, ContactCache searched, SelfContact &contact, Arena &work, Failure &failure) {
    Scope scope(work);
    int vertices = material.particles.mass.size, rows = solver.collider.parts * vertices;
    float past = body_speed(solver, motion);
    if (!can_follow(past, motion, failure)) return REFUSED;
    // Cloth that moves farther than the reach between two searches could pass through the body.
    float reached = motion.reach / most(past + fastest(velocities, vertices), 1e-6f);
    float body_interval = least(motion.interval, reached);
    Array<Vec> places = work.copy(positions, vertices), speeds = work.copy(velocities, vertices);
    Array<int32_t> faces = work.copy(searched.faces, rows);
    Array<float> clear = work.copy(searched.clear, rows);
    Array<PointPair> points = work.copy(contact.points.items);
    Array<EdgePair> edges = work.copy(contact.edges.items);
    int substeps = most((int)__builtin_ceil(needed_substeps(motion)), 1);
    for (int attempt = 0; attempt <= RETRIES; attempt++, substeps *= 2) {
        Substepping steps{substeps, whole((float)substeps * motion.interval / motion.seconds + 0.5f),
                          whole((float)substeps * body_interval / motion.seconds)};
        if (move(solver, material, motion, steps, positions, velocities, searched, contact, work))
            return substeps;
        put_back(positions, places);
        put_back(velocities, speeds);
        put_back(searched.faces, faces);
        put_back(searched.clear, clear);
        contact.points.assign(points);
        contact.edges.assign(edges);
    }
    failure.say("the cloth flies apart");
    return FLIES_APART;
}

}  // namespace uvc
