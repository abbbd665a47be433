// The body as closed parts that cloth may touch, and the closest skin of vertices while it moves.
#pragma once

#include "lane_tree.h"
#include "rigid_motion.h"
#include "sections.h"
#include "surface.h"

namespace uvc {

// starts: (K + 1) first face of each part, whose faces are in a tree. vertices: of each part, from
// vertex_starts on. touches: for each vertex of the cloth, a bit for every part that it may touch; touching:
// (K, N / 8) for each part, and eight vertices, a bit for every one of them that may touch it; crossed: as
// touches, for parts that a vertex may be inside of without a touch.
struct Collider {
    Surface surface;
    int parts;
    Array<LaneTree> trees;
    Array<int32_t> starts, vertices, vertex_starts, touches, crossed;
    Array<uint8_t> touching;
    int blocks() const { return (touches.size + LANES - 1) / LANES; }
};

// Reads "collider.rest" (C, 3) m, "collider.faces" (F, 3), "collider.starts" (K + 1) the first face of each
// part, and by their names the cloth's `touches` (N), and `crossed` (N) if that is not null.
Collider read_collider(const Sections &sections, const char *touches, const char *crossed, Arena &arena,
                       Failure &failure);

// Search results of a frame that the next one starts from. faces: (K N), the closest face of each part, -1
// for none. clear: (K N) m, a distance within which there is none.
struct ContactCache {
    int32_t *faces;
    float *clear;
};

// The trees of all parts at points, fitted when they are needed.
struct FittedParts {
    const Vec *points;
    Array<FittedTree> trees;
    Array<int32_t> is_fitted;
};

// The body on its way through a frame, from start to end (C) m, and the results of its searches.
//
// points: at the last search, points_before: at the one before. hints: (K N) faces found by it, -1 for none.
// before: results of the last frame, of which `clear` is renewed. at: (K N) share of the way at the last
// search of all faces. cloth: (N / 8) m at the last search, at a share of the way; searches: their number so
// far. turn: number of the frame. renewal: frames from one search of all faces for a vertex to the next; in
// between it is followed over neighbouring ones.
struct BodySweep {
    const Vec *start, *end;
    Array<Vec> points, points_before;
    Array<LaneVec> cloth, cloth_before;
    FittedParts parts;
    Array<int32_t> hints;
    ContactCache before;
    Array<float> at;
    float share;
    int searches, turn, renewal;
};

// Begins a frame of the body, and of cloth (N) m that has not moved yet.
BodySweep begin_sweep(const Collider &collider, const Vec *start, const Vec *end, const Vec *cloth,
                      ContactCache before, int turn, int renewal, Arena &work);

// Stores what the next frame needs in `before`, with cloth (N) m at the end of the frame.
void end_sweep(const Collider &collider, BodySweep &sweep, const Vec *cloth);

// Motion and distances by which a search decides what may touch until the next one.
//
// velocities: (N) m/s, or null for cloth that does not move. near: (N) m, distance from which a vertex
// touches. interval: share of the frame until the next search. seconds: of the frame. reach: m, how far outside
// and how deep in the body a face is found. followed: m outside the body up to which a vertex that had a face
// is followed over neighbouring faces, longer than LONGEST after a search of all of them.
struct ProximityQuery {
    const Vec *velocities;
    const float *near;
    float interval, seconds, reach, followed;
};

// A vertex near a part, and the closest face there.
struct ContactCandidate {
    int32_t vertex, face;
};

// Finds the closest face of every part that a vertex touches, or may touch until the next search, with the
// body at a share of its way. Returns how many were put into found (K N), by part.
int find_near(const Collider &collider, BodySweep &sweep, float share, const Vec *cloth,
              const ProximityQuery &watch, Array<ContactCandidate> found, Arena &work);

// Finds the parts of a body (C) m that cloth (N) m is inside of, of those that it may cross: a bit for each
// in caught (N). Returns whether there is any.
bool find_penetrated(const Collider &collider, const Vec *body, const Vec *cloth, FittedParts &parts,
                 int32_t *caught);

}  // namespace uvc
