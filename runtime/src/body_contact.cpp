#include "body_contact.h"

namespace uvc {

namespace {

// Neighbouring faces that a vertex is followed over at most, in a substep.
constexpr int STEPS = 3;

// Metres from a face below which its normal counts, and not the direction to it.
constexpr float ON_SURFACE = 1e-6f;

// Metres of depth that are removed at once, and the speed, m/s, at which cloth is moved out of a greater
// depth, so that it does not jump.
constexpr float SHALLOW = 1e-3f, PUSH_SPEED = 1.0f;

// Speed, m/s, that a contact may gain before it is searched again.
constexpr float ALERT_SPEED = 0.5f;

// Metres that a vertex moves past the body before its closest point is found again.
constexpr float SLIDE = 1e-3f;

Vec normal_of(const Collider &collider, const BodySweep &sweep, const Normals &normals, int vertex) {
    if (!normals.known.at(vertex)) {
        normals.known.at(vertex) = 1;
        normals.normals.at(vertex) = unit(vertex_normal(collider.surface, sweep.end, vertex));
    }
    return normals.normals.at(vertex);
}

// A face of the body at a share of its way.
struct Corners {
    Vec a, b, c;
};

UVC_INLINE Corners moving(const Surface &surface, const BodySweep &sweep, float share, int face) {
    Face f = surface.faces.at(face);
    return {between(sweep.start[f.a], sweep.end[f.a], share),
            between(sweep.start[f.b], sweep.end[f.b], share),
            between(sweep.start[f.c], sweep.end[f.c], share)};
}

UVC_INLINE Closest on_moving(const Surface &surface, const BodySweep &sweep, float share, int face,
                             Vec point) {
    Corners c = moving(surface, sweep, share, face);
    Vec weights = closest_barycentrics(point, c.a, c.b, c.c);
    return {face, weights, point - weighted(weights, c.a, c.b, c.c)};
}

// Finds the closest point of the body, from face to neighbouring face, and the plane there.
void find_plane(Contact &contact, const Collider &collider, const BodySweep &sweep, const Normals &normals,
                float share, Vec point) {
    const Surface &surface = collider.surface;
    Closest closest = walk_over(
        surface, contact.face, STEPS,
        [&](int face) { return on_moving(surface, sweep, share, face, point); });
    contact.face = closest.face;
    Face f = surface.faces.at(closest.face);
    Vec w = closest.weights;
    Vec outwards = weighted(w, normal_of(collider, sweep, normals, f.a),
                            normal_of(collider, sweep, normals, f.b),
                            normal_of(collider, sweep, normals, f.c));
    float side = dot(closest.away, outwards) >= 0 ? 1.0f : -1.0f, distance = length(closest.away);
    contact.point = weighted(w, sweep.start[f.a], sweep.start[f.b], sweep.start[f.c]);
    contact.way = weighted(w, sweep.end[f.a], sweep.end[f.b], sweep.end[f.c]) - contact.point;
    contact.normal = distance > ON_SURFACE ? (side / distance) * closest.away : unit(outwards);
    contact.slide = SLIDE;
}

}  // namespace

void resolve_contacts(Array<Contact> contacts, const Collider &collider, const BodySweep &sweep,
                      const Normals &normals, float share, Vec *positions, Vec *velocities,
                      const Particles &particles, float radius, float step, float seconds) {
    float rate = 1 / seconds;
    for (Contact &contact : contacts) {
        if (contact.wait > 0) {
            contact.wait--;
            continue;
        }
        int vertex = contact.vertex;
        Vec point = positions[vertex];
        if (contact.slide <= 0) find_plane(contact, collider, sweep, normals, share, point);
        Vec away = point - (contact.point + share * contact.way), surface = rate * contact.way;
        float gap = dot(away, contact.normal) - radius - particles.thickness.at(vertex);
        Vec slip = velocities[vertex] - surface;
        if (gap >= 0) {
            float speed = length(slip);
            contact.wait = (int)least(1e6f, gap / (2 * step * (speed + ALERT_SPEED)));
            contact.slide -= speed * step * (float)(contact.wait + 1);
            continue;
        }
        float approach = dot(slip, contact.normal);
        Vec along = slip - approach * contact.normal;
        float stopped = most(-approach, 0.0f);
        // The approach of body and cloth in this substep is undone at any speed: a tight skirt would sink in.
        float depth = -gap, pushed = depth;
        if (depth >= SHALLOW) pushed = least(depth, (PUSH_SPEED + length(surface) + stopped) * step);
        positions[vertex] = point + pushed * contact.normal;
        float speed = length(along), friction = particles.friction.at(vertex);
        float kept = speed > friction * stopped ? 1 - friction * stopped / speed : 0;
        velocities[vertex] = surface + kept * along + (approach + stopped) * contact.normal;
        contact.slide -= (kept * speed + stopped) * step + pushed;
    }
}

}  // namespace uvc
