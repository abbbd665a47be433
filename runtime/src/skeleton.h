// Skeletons: the way of a body from its rest pose to another one, and the place in the world where it is.
#pragma once

#include "sections.h"

namespace uvc {

// Rotation, row by row.
struct Rotation {
    double at[3][3];
};

// Takes points at rest to where a joint takes them: a turn, then a shift, m.
struct RigidTransform {
    Rotation turn;
    Vec64 shift;
};

// Where a joint takes a point at rest, m.
Vec64 taken(const RigidTransform &joint, Vec64 point);

// parents: of each joint, before it; -1 for the root, which is the first. heads: of joints at rest, m.
struct Skeleton {
    Array<int32_t> parents;
    Array<Vec64> heads;
};

// Reads "skeleton.parents" (J) and "skeleton.heads" (J, 3) m.
Skeleton read_skeleton(const Sections &sections, Arena &arena, Failure &failure);

// A pose to go to: axes times angles, radians, of the joints (J) relative to their parents', the root's
// relative to its heading, and where the root is, m.
struct Pose {
    Array<Vec64> turns;
    Rotation heading;
    Vec64 root;
};

// A pose of transforms (J) from rest.
Pose read_pose(const Skeleton &skeleton, const RigidTransform *transforms, Arena &arena);

// Transforms (J) from rest at a share of the way from the rest pose to a pose, from 0 to 1, which starts and
// ends slowly. The root keeps its place, and turns from its heading.
void way_to(const Skeleton &skeleton, const Pose &pose, double share, RigidTransform *transforms);

// Turn of a joint, which is not the root, from that of its parent, by the transforms (J) of all.
Rotation local_turn(const Skeleton &skeleton, const RigidTransform *transforms, int joint);

// A place on the ground: turned about the vertical by an angle of that cosine and sine, around an origin, m.
struct GroundFrame {
    double cosine, sine;
    Vec64 origin;
};

// The place of a root, whose head is at rest at `head`, m, moved by its transform.
GroundFrame ground_frame(const RigidTransform &root, Vec64 head);

// Angle, radians, of the turn from one root to another.
double angle_between(const RigidTransform &before, const RigidTransform &now);

// The part of it that is about the vertical.
double heading_between(const RigidTransform &before, const RigidTransform &now);

// The place in whose frame a root that jumps is where it would have gone: from `before` by `way`, m, turned by
// an angle about the vertical. before, now: the root in the frame of `place`, its head at rest at `head`, m.
GroundFrame after_jump(const GroundFrame &place, const RigidTransform &before, const RigidTransform &now,
                       Vec64 head, Vec64 way, double angle);

// Brings transforms (J) into the frame of a place, in place, rounded: turned or shifted scenes get the same.
void bring_in(const GroundFrame &place, RigidTransform *transforms, int joints);

// Brings a point, m, into the frame of a place.
Vec64 brought_in(const GroundFrame &place, Vec64 point);

// Brings points (N) m in the frame of a place back.
void bring_back(const GroundFrame &place, Vec64 *points, int count);

}  // namespace uvc
