// The way to a pose: it starts at rest and ends in the pose, and a turned, shifted scene goes the same way.
#include <stdio.h>

#include "skeleton.h"

using namespace uvc;

namespace {

constexpr int JOINTS = 4, POSES = 2000;
constexpr double PI = 3.14159265358979323846;

// Numbers from -1 to 1 that look random, the same in every run (xorshift).
struct Random {
    uint32_t state = 1;
    double next() {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        return state / 2147483648.0 - 1;
    }
};

Rotation about(Vec64 axis, double angle) {
    double size = __builtin_sqrt(dot(axis, axis)), c = __builtin_cos(angle), s = __builtin_sin(angle);
    Vec64 a = (1 / size) * axis;
    double d = 1 - c;
    return {{{c + d * a.x * a.x, d * a.x * a.y - s * a.z, d * a.x * a.z + s * a.y},
             {d * a.x * a.y + s * a.z, c + d * a.y * a.y, d * a.y * a.z - s * a.x},
             {d * a.x * a.z - s * a.y, d * a.y * a.z + s * a.x, c + d * a.z * a.z}}};
}

Vec64 moved(const RigidTransform &by, Vec64 p) {
    const double(&m)[3][3] = by.turn.at;
    return Vec64{m[0][0] * p.x + m[0][1] * p.y + m[0][2] * p.z, m[1][0] * p.x + m[1][1] * p.y + m[1][2] * p.z,
                 m[2][0] * p.x + m[2][1] * p.y + m[2][2] * p.z} +
           by.shift;
}

// One after the other.
RigidTransform after(const RigidTransform &second, const RigidTransform &first) {
    RigidTransform both{{}, moved(second, first.shift)};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                both.turn.at[i][j] += second.turn.at[i][k] * first.turn.at[k][j];
    return both;
}

double apart(const RigidTransform &a, const RigidTransform &b) {
    double most = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double off = __builtin_fabs(a.turn.at[i][j] - b.turn.at[i][j]);
            most = __builtin_fmax(most, off);
        }
    Vec64 way = a.shift - b.shift;
    return __builtin_fmax(most, __builtin_sqrt(dot(way, way)));
}

void expect(bool holds, const char *sentence) {
    if (holds) return;
    puts(sentence);
    exit(1);
}

// Turns the joints, of which each may turn by up to half a turn, one after another along the bones.
void turn_joints(const Skeleton &skeleton, Random &random, RigidTransform *transforms) {
    for (int joint = 0; joint < JOINTS; joint++) {
        Vec64 head = skeleton.heads[joint], axis{random.next(), random.next(), random.next()};
        RigidTransform local{about(axis, PI * random.next()), {}};
        local.shift = head - moved(local, head);
        transforms[joint] = joint ? after(transforms[skeleton.parents[joint]], local) : local;
    }
}

}  // namespace

int main() {
    int32_t parents[JOINTS] = {-1, 0, 1, 0};
    Vec64 heads[JOINTS] = {{0, 0.02, 0.9}, {0.1, 0, 1.2}, {0.3, 0.1, 1.3}, {-0.2, 0, 0.5}};
    Skeleton skeleton{{parents, JOINTS}, {heads, JOINTS}};
    Random random;
    int others = 0;
    for (int k = 0; k < POSES; k++) {
        Arena arena;
        RigidTransform transforms[JOINTS], ways[2][JOINTS];
        turn_joints(skeleton, random, transforms);
        Pose pose = read_pose(skeleton, transforms, arena);
        way_to(skeleton, pose, 1, ways[0]);
        for (int joint = 0; joint < JOINTS; joint++)
            expect(apart(ways[0][joint], transforms[joint]) < 1e-7, "the way does not end in the pose");
        way_to(skeleton, pose, 0, ways[0]);
        RigidTransform rest{pose.heading, {}};
        rest.shift = pose.root - moved(rest, heads[0]);
        for (int joint = 0; joint < JOINTS; joint++)
            expect(apart(ways[0][joint], rest) < 1e-12, "the way does not start at rest");
        RigidTransform scene{about({0, 0, 1}, PI * random.next()), {}};
        scene.shift = {20 * random.next(), 20 * random.next(), random.next()};
        for (int way = 0; way < 2; way++) {
            RigidTransform seen[JOINTS];
            for (int joint = 0; joint < JOINTS; joint++)
                seen[joint] = way ? after(scene, transforms[joint]) : transforms[joint];
            GroundFrame place = ground_frame(seen[0], heads[0]);
            Vec64 point = moved(seen[2], heads[2]);
            bring_in(place, seen, JOINTS);
            Vec64 back = moved(seen[2], heads[2]);
            bring_back(place, &back, 1);
            expect(dot(back - point, back - point) < 1e-12, "points do not come back to where they were");
            way_to(skeleton, read_pose(skeleton, seen, arena), 0.4, ways[way]);
        }
        others += memcmp(ways[0], ways[1], sizeof(ways[0])) != 0;
    }
    printf("%d poses, %d of them differ where the scene is turned\n", POSES, others);
    expect(others == 0, "a turned scene goes another way");
    return 0;
}
