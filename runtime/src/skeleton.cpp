#include "skeleton.h"

namespace uvc {

namespace {

// Steps in a unit, to which the numbers of rotations, and of metres, are rounded.
constexpr double TURN_STEPS = 1 << 24, WAY_STEPS = 1 << 22;

// Square of an angle, radians, below which its sine and cosine are series.
constexpr double SMALL = 1e-6;

Rotation operator*(const Rotation &a, const Rotation &b) {
    Rotation product;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            product.at[i][j] = a.at[i][0] * b.at[0][j] + a.at[i][1] * b.at[1][j] + a.at[i][2] * b.at[2][j];
    return product;
}

Vec64 operator*(const Rotation &a, Vec64 v) {
    return {a.at[0][0] * v.x + a.at[0][1] * v.y + a.at[0][2] * v.z,
            a.at[1][0] * v.x + a.at[1][1] * v.y + a.at[1][2] * v.z,
            a.at[2][0] * v.x + a.at[2][1] * v.y + a.at[2][2] * v.z};
}

Rotation transposed(const Rotation &a) {
    return {{{a.at[0][0], a.at[1][0], a.at[2][0]},
             {a.at[0][1], a.at[1][1], a.at[2][1]},
             {a.at[0][2], a.at[1][2], a.at[2][2]}}};
}

// Angle, radians, about the vertical that is nearest to a turn.
double heading_angle(const Rotation &a) {
    return __builtin_atan2(a.at[1][0] - a.at[0][1], a.at[0][0] + a.at[1][1]);
}

Rotation about_vertical(double angle) {
    double c = __builtin_cos(angle), s = __builtin_sin(angle);
    return {{{c, -s, 0}, {s, c, 0}, {0, 0, 1}}};
}

Rotation heading(const Rotation &a) { return about_vertical(heading_angle(a)); }

// Axis times angle of a turn, by the quaternion of which the greatest number comes from a root.
Vec64 axis_angle(const Rotation &turn) {
    const double(&m)[3][3] = turn.at;
    double trace = m[0][0] + m[1][1] + m[2][2], w, numbers[3];
    if (trace > 0) {
        double twice = 2 * __builtin_sqrt(trace + 1);
        w = 0.25 * twice;
        for (int i = 0; i < 3; i++) {
            int j = (i + 1) % 3, k = (i + 2) % 3;
            numbers[i] = (m[k][j] - m[j][k]) / twice;
        }
    } else {
        int i = m[0][0] > m[1][1] && m[0][0] > m[2][2] ? 0 : m[1][1] > m[2][2] ? 1 : 2;
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double twice = 2 * __builtin_sqrt(1 + m[i][i] - m[j][j] - m[k][k]);
        w = (m[k][j] - m[j][k]) / twice;
        numbers[i] = 0.25 * twice;
        numbers[j] = (m[i][j] + m[j][i]) / twice;
        numbers[k] = (m[i][k] + m[k][i]) / twice;
    }
    Vec64 along{numbers[0], numbers[1], numbers[2]};
    double sine = __builtin_sqrt(dot(along, along));
    if (sine == 0) return {};
    double angle = 2 * (w < 0 ? __builtin_atan2(-sine, -w) : __builtin_atan2(sine, w));
    return (angle / sine) * along;
}

// The turn by an axis times an angle (Rodrigues).
Rotation turned(Vec64 v) {
    double squared = dot(v, v), angle = __builtin_sqrt(squared);
    bool is_small = squared <= SMALL;
    double a = is_small ? 1 - squared / 6 : __builtin_sin(angle) / angle;
    double b = is_small ? 0.5 - squared / 24 : (1 - __builtin_cos(angle)) / squared;
    return {{{1 - b * (v.y * v.y + v.z * v.z), b * v.x * v.y - a * v.z, b * v.x * v.z + a * v.y},
             {b * v.x * v.y + a * v.z, 1 - b * (v.x * v.x + v.z * v.z), b * v.y * v.z - a * v.x},
             {b * v.x * v.z - a * v.y, b * v.y * v.z + a * v.x, 1 - b * (v.x * v.x + v.y * v.y)}}};
}

double rounded(double a, double steps) { return __builtin_floor(a * steps + 0.5) / steps; }

}  // namespace

Vec64 taken(const RigidTransform &joint, Vec64 point) { return joint.turn * point + joint.shift; }

Skeleton read_skeleton(const Sections &sections, Arena &arena, Failure &failure) {
    Skeleton skeleton;
    skeleton.parents = read_integers(sections, "skeleton.parents", -1, 1, arena, failure);
    int joints = skeleton.parents.size;
    Array<float> heads = read_floats(sections, "skeleton.heads", joints, 3, arena, failure);
    if (failure.failed) return {};
    if (!joints) failure.say("section skeleton.parents of the outfit is empty");
    for (int joint = 0; joint < joints; joint++) {
        int parent = skeleton.parents[joint];
        if (joint ? parent < 0 || parent >= joint : parent != -1)
            failure.say("section skeleton.parents of the outfit has a wrong parent of joint %d", joint);
    }
    skeleton.heads = arena.take<Vec64>(joints);
    for (int k = 0; k < joints; k++) skeleton.heads[k] = {heads[3 * k], heads[3 * k + 1], heads[3 * k + 2]};
    return failure.failed ? Skeleton{} : skeleton;
}

Rotation local_turn(const Skeleton &skeleton, const RigidTransform *transforms, int joint) {
    return transposed(transforms[skeleton.parents[joint]].turn) * transforms[joint].turn;
}

Pose read_pose(const Skeleton &skeleton, const RigidTransform *transforms, Arena &arena) {
    const RigidTransform &root = transforms[0];
    Pose pose{arena.take<Vec64>(skeleton.parents.size), heading(root.turn),
              taken(root, skeleton.heads[0])};
    for (int joint = 0; joint < skeleton.parents.size; joint++) {
        Rotation local = joint ? local_turn(skeleton, transforms, joint) : transposed(pose.heading) * root.turn;
        pose.turns[joint] = axis_angle(local);
    }
    return pose;
}

void way_to(const Skeleton &skeleton, const Pose &pose, double share, RigidTransform *transforms) {
    double smooth = share * share * (3 - 2 * share);
    Arena work;
    Array<Vec64> places = work.take<Vec64>(skeleton.parents.size);
    for (int joint = 0; joint < skeleton.parents.size; joint++) {
        int parent = skeleton.parents[joint];
        Rotation local = turned(smooth * pose.turns[joint]);
        Vec64 head = skeleton.heads[joint];
        places[joint] = pose.root;
        if (parent >= 0)
            places[joint] = places[parent] + transforms[parent].turn * (head - skeleton.heads[parent]);
        const Rotation &above = parent < 0 ? pose.heading : transforms[parent].turn;
        transforms[joint].turn = above * local;
        transforms[joint].shift = places[joint] - transforms[joint].turn * head;
    }
}

GroundFrame ground_frame(const RigidTransform &root, Vec64 head) {
    Rotation facing = heading(root.turn);
    return {facing.at[0][0], facing.at[1][0], taken(root, head)};
}

double angle_between(const RigidTransform &before, const RigidTransform &now) {
    Vec64 turn = axis_angle(transposed(before.turn) * now.turn);
    return __builtin_sqrt(dot(turn, turn));
}

double heading_between(const RigidTransform &before, const RigidTransform &now) {
    return heading_angle(now.turn * transposed(before.turn));
}

GroundFrame after_jump(const GroundFrame &place, const RigidTransform &before, const RigidTransform &now,
                       Vec64 head, Vec64 way, double angle) {
    Rotation turn = about_vertical(heading_between(before, now) - angle);
    Vec64 origin = taken(now, head) - turn * (taken(before, head) + way);
    bring_back(place, &origin, 1);
    double c = turn.at[0][0], s = turn.at[1][0];
    GroundFrame next{place.cosine * c - place.sine * s, place.sine * c + place.cosine * s, origin};
    double size = __builtin_sqrt(next.cosine * next.cosine + next.sine * next.sine);
    next.cosine /= size;
    next.sine /= size;
    return next;
}

Vec64 brought_in(const GroundFrame &place, Vec64 point) {
    Vec64 p = point - place.origin;
    return {place.cosine * p.x + place.sine * p.y, place.cosine * p.y - place.sine * p.x, p.z};
}

void bring_in(const GroundFrame &place, RigidTransform *transforms, int joints) {
    Rotation back{{{place.cosine, place.sine, 0}, {-place.sine, place.cosine, 0}, {0, 0, 1}}};
    for (int joint = 0; joint < joints; joint++) {
        RigidTransform &transform = transforms[joint];
        Vec64 shift = brought_in(place, transform.shift);
        transform.turn = back * transform.turn;
        for (auto &row : transform.turn.at)
            for (double &number : row) number = rounded(number, TURN_STEPS);
        transform.shift = {rounded(shift.x, WAY_STEPS), rounded(shift.y, WAY_STEPS),
                           rounded(shift.z, WAY_STEPS)};
    }
}

void bring_back(const GroundFrame &place, Vec64 *points, int count) {
    for (int k = 0; k < count; k++) {
        Vec64 p = points[k];
        points[k] = place.origin + Vec64{place.cosine * p.x - place.sine * p.y,
                                         place.sine * p.x + place.cosine * p.y, p.z};
    }
}

}  // namespace uvc
