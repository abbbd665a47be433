#include "character.h"

#include "layer_order.h"

namespace uvc {

namespace {

// Metres that garments keep from the skin, and from each other; how far skin and cloth are looked for.
constexpr float CLEARANCE = 0.003f, CLEARING_REACH = 0.03f;

// m/s2.
constexpr double GRAVITY = 9.81;

// Damping ratios of the springs that hold bands, and that pull cages: at 1 a skirt swings out with half its
// energy.
constexpr float HOLD_DAMPING = 0.7f, PULL_DAMPING = 0.3f;

// Greatest change of the cloth's mean speed in a frame, m/s, that can be followed.
constexpr float FASTEST_CHANGE = 40.0f;

// Change of a root's speed in a frame, m/s, and speed of its turn, radians/s, above which it jumps. In mocap
// they are below 7.5 and 37.
constexpr double JUMP_SPEED = 10, JUMP_TURN = 45;

// Frames in which a body goes from its rest pose to its first pose, and in which cloth then comes to rest.
constexpr int POSING_FRAMES = 20, SETTLING_FRAMES = 45;

// Seconds of these frames.
constexpr float SETTLING_SECONDS = 1.0f / 30.0f;

// Greatest number of a joint's transform: m, as far as the earth reaches.
constexpr double FARTHEST = 1e7;

// Rotation and shift of a joint from rest, relative to an origin, for skinning.
void write_transform(const RigidTransform &joint, Vec64 origin, float *row) {
    const double shift[3] = {joint.shift.x - origin.x, joint.shift.y - origin.y, joint.shift.z - origin.z};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) row[4 * i + j] = (float)joint.turn.at[i][j];
        row[4 * i + 3] = (float)shift[i];
    }
}

// The body at rest with the offsets of its shapes, which turns of joints have.
Array<float> shaped(const Outfit &outfit, const RigidTransform *joints, Arena &work) {
    if (!outfit.shapes.size) return outfit.body.rest;
    Array<float> rest = work.copy(outfit.body.rest);
    const float *shape = outfit.shapes.data;
    for (int joint = 1; joint < outfit.skeleton.parents.size; joint++) {
        Rotation turn = local_turn(outfit.skeleton, joints, joint);
        for (int k = 0; k < 9; k++, shape += rest.size) {
            float amount = (float)(turn.at[k / 3][k % 3] - (k % 4 == 0 ? 1 : 0));
            for (int j = 0; j < rest.size; j++) rest.at(j) += amount * shape[j];
        }
    }
    return rest;
}

// Poses body, cages and points around the root, and opens the collider.
void pose_all(Character &character, const RigidTransform *joints, Posed &posed) {
    const Outfit &outfit = character.outfit;
    const Skeleton &skeleton = outfit.skeleton;
    Arena &work = character.scratch;
    Scope scope(work);
    posed.origin = taken(joints[0], skeleton.heads[0]);
    int count = skeleton.parents.size;
    Array<float> transforms = work.take<float>(12 * count);
    for (int k = 0; k < count; k++)
        write_transform(joints[k], posed.origin, transforms.data + 12 * k);
    pose(outfit.body, shaped(outfit, joints, work).data, transforms.data, posed.skin.data);
    pose(outfit.cages, outfit.cages.rest.data, transforms.data, posed.cages.data);
    pose(outfit.points, outfit.points.rest.data, transforms.data, posed.points.data);
    int vertices = posed.skin.size;
    Array<Vec> closed = work.take<Vec>(vertices + outfit.caps.tips.size);
    for (int k = 0; k < vertices; k++) closed[k] = (1 / outfit.size) * posed.skin[k];
    add_tips(outfit.caps, closed.data);
    open_frame(outfit.opening, character.opening, closed.data);
    for (int k = 0; k < posed.body.size; k++) posed.body[k] = outfit.size * closed[outfit.used[k]];
}

Posed make_posed(const Outfit &outfit, Arena &arena) {
    return {{},
            arena.take<Vec>(outfit.cages.vertices()),
            arena.take<Vec>(outfit.used.size),
            arena.take<Vec>(outfit.body.vertices()),
            arena.take<Vec>(outfit.points.vertices())};
}

Vec64 mean(Array<Vec> points) {
    Vec64 total{};
    for (Vec point : points) total += wide(point);
    return points.size ? (1.0 / points.size) * total : total;
}

Array<Vec> around(Array<Vec> points, Vec64 origin, Arena &arena) {
    Array<Vec> near = arena.take<Vec>(points.size);
    for (int k = 0; k < points.size; k++) near[k] = narrow(wide(points[k]) - origin);
    return near;
}

// Where the cloth may be at the end of a frame, until it is known that it stays together.
struct NextState {
    Vec64 origin, drift;
    Array<Vec> positions, velocities, targets, body;
    ContactCache searched;
};

// A vector of the world in the frame of a place, less another one there.
void put_in_place(const GroundFrame &place, Vec64 world, Vec64 less, float *numbers) {
    Vec64 vector = brought_in({place.cosine, place.sine, {}}, world) - less;
    numbers[0] = (float)vector.x;
    numbers[1] = (float)vector.y;
    numbers[2] = (float)vector.z;
}

// Targets of the cages, m, around the origin of `posed`: where they are pulled, or skinned where they are held.
Array<Vec> find_targets(const Character &character, Arena &work) {
    const Posed &posed = character.posed;
    Array<Vec> targets = work.copy(posed.cages);
    for (int k = 0; k < targets.size && character.rate > 0; k++)
        if (!(character.outfit.hold[k] > 0)) targets[k] = narrow(character.guide[k] - posed.origin);
    return targets;
}

// Solves a frame up to the pose, with as many substeps as it takes. Pairs of cloth near cloth are renewed at
// once, all else is in `next`.
bool solve(Character &character, float seconds, Arena &arena, NextState &next, Failure &failure) {
    const Outfit &outfit = character.outfit;
    const SolverSettings &settings = outfit.settings;
    const Posed &posed = character.posed;
    Array<Vec> targets = find_targets(character, arena);
    int count = targets.size, rows = outfit.solver.collider.parts * count;
    Vec64 middle = mean(targets);
    next.origin = posed.origin + middle;
    next.drift = (1.0 / seconds) * (next.origin - character.origin);
    next.targets = around(targets, middle, arena);
    next.body = around(posed.body, middle, arena);
    Array<Vec> speeds = arena.take<Vec>(count);
    for (int k = 0; k < count; k++) {
        Vec64 speed = wide(character.velocities[k]) + character.drift - next.drift;
        // A clip that starts in a run does not pull resting cloth away.
        if (character.steps == 1) speed = (1.0 / seconds) * wide(next.targets[k] - character.targets[k]);
        speeds[k] = narrow(speed);
    }
    Array<float> rates = arena.take<float>(count), damping = arena.take<float>(count);
    for (int k = 0; k < count; k++) {
        bool is_held = outfit.hold[k] > 0;
        rates[k] = is_held ? outfit.hold[k] : character.rate;
        damping[k] = is_held ? HOLD_DAMPING : PULL_DAMPING;
    }
    auto numbers = [](Array<Vec> vectors) { return reinterpret_cast<const float *>(vectors.data); };
    uvc_motion motion{};
    motion.body_start = numbers(character.body);
    motion.body_end = numbers(next.body);
    motion.target_start = numbers(character.targets);
    motion.target_end = numbers(next.targets);
    motion.pull = rates.data;
    motion.damping = damping.data;
    put_in_place(character.place, character.gravity, {}, motion.gravity);
    put_in_place(character.place, character.wind, next.drift, motion.drift);
    for (float &speed : motion.drift) speed = -speed;
    motion.seconds = seconds;
    motion.radius = settings.radius;
    motion.self_radius = settings.self_radius;
    motion.fold_radius = settings.fold_radius;
    motion.self_margin = settings.self_margin;
    motion.reach = settings.reach;
    motion.needed = character.needed;
    motion.interval = settings.interval;
    motion.hinge_interval = settings.hinge_interval;
    motion.frame = character.solved;
    motion.renewal = settings.renewal;
    motion.self_contact = 1;
    if (!can_follow(outfit.solver, motion, failure)) return false;
    Vec64 change = next.drift - character.drift;
    float jump = (float)__builtin_sqrt(dot(change, change));
    if (!(jump <= FASTEST_CHANGE)) {
        failure.say("the cloth jumps, by %d m/s in a frame, the limit is %d m/s: start it again",
                    (int)least(1e9f, jump), (int)FASTEST_CHANGE);
        return false;
    }
    next.positions = arena.copy(character.positions);
    next.velocities = speeds;
    next.searched = {arena.copy(character.searched.faces, rows).data,
                     arena.copy(character.searched.clear, rows).data};
    return step(outfit.solver, character.material, motion, next.positions.data, next.velocities.data,
                next.searched, character.contact, arena, failure) > 0;
}

void copy(Array<Vec> to, Array<Vec> from) { memcpy(to.data, from.data, sizeof(Vec) * (size_t)to.size); }

void accept(Character &character, NextState &next) {
    size_t rows = (size_t)(character.outfit.solver.collider.parts * character.positions.size);
    character.origin = next.origin;
    character.drift = next.drift;
    copy(character.positions, next.positions);
    copy(character.velocities, next.velocities);
    copy(character.targets, next.targets);
    copy(character.body, next.body);
    memcpy(character.searched.faces, next.searched.faces, sizeof(int32_t) * rows);
    memcpy(character.searched.clear, next.searched.clear, sizeof(float) * rows);
    character.solved++;
}

// Carries the points along with the cages, around the origin of `posed`, and clears them; makes wrinkles in a
// frame of so many seconds.
void carry(Character &character, float seconds) {
    const Outfit &outfit = character.outfit;
    const Posed &posed = character.posed;
    Arena &work = character.scratch;
    Scope scope(work);
    Vec middle = narrow(character.origin - posed.origin);
    Array<Vec> offsets = work.take<Vec>(posed.cages.size);
    for (int k = 0; k < offsets.size; k++) offsets[k] = character.positions[k] + middle - posed.cages[k];
    float smaller = 1 / outfit.size;
    Array<Vec> points = character.shown;
    for (int point = 0; point < points.size; point++) {
        Vec total = posed.points[point];
        for (int k = outfit.cage_starts[point]; k < outfit.cage_starts[point + 1]; k++)
            total += outfit.cage_weights[k] * offsets[outfit.cage[k]];
        points[point] = smaller * total;
    }
    Array<Vec> body = work.copy(posed.body), skin = work.copy(posed.skin);
    for (Vec &vertex : body) vertex = smaller * vertex;
    for (Vec &vertex : skin) vertex = smaller * vertex;
    clear_skin(outfit.clearing, character.memory, points.data, body.data, CLEARANCE, CLEARING_REACH, work);
    cover_skin(outfit.clearing, points.data, skin.data, work);
    Array<int32_t> over =
        find_points_over(outfit, character.contact.points.items, character.positions.data, work);
    lift(outfit.clearing.layers, outfit.clearing.rings, over, points.data, CLEARANCE, 1, work);
    for (Vec &point : points) point = outfit.size * point;
    Vec way = narrow(posed.origin - character.shown_origin);
    character.shown_origin = posed.origin;
    if (outfit.wrinkles.garments.size)
        wrinkle(outfit.wrinkles, character.folds, points.data, posed.skin.data, seconds, way,
                character.wrinkled.data, work);
}

bool is_near(double number) { return __builtin_fabs(number) <= FARTHEST; }

bool are_places(const RigidTransform *joints, int count, Failure &failure) {
    for (int joint = 0; joint < count; joint++) {
        const RigidTransform &one = joints[joint];
        bool near = is_near(one.shift.x) && is_near(one.shift.y) && is_near(one.shift.z);
        for (const auto &row : one.turn.at)
            for (double number : row) near = near && is_near(number);
        if (!near) {
            failure.say("the transform of joint %d is not finite, or beyond 10,000 km", joint);
            return false;
        }
    }
    return true;
}

// Puts all that a character remembers elsewhere in the world; what pulls it stays where it is there.
void change_place(Character &character, const GroundFrame &place) {
    bring_back(character.place, character.guide.data, character.guide.size);
    character.place = place;
    for (Vec64 &point : character.guide) point = brought_in(place, point);
}

// Whether the root goes on as no body does.
bool jumps(const Character &character, const RigidTransform &root, float seconds) {
    Vec64 head = character.outfit.skeleton.heads[0];
    Vec64 way = taken(root, head) - taken(character.root, head) - (double)seconds * character.drift;
    double angle = angle_between(character.root, root);
    return !(__builtin_sqrt(dot(way, way)) <= JUMP_SPEED * seconds && angle <= JUMP_TURN * seconds);
}

// Forgets what clearing and wrinkles know of the frame before.
void forget_shown(Character &character) {
    begin(character.outfit.clearing, character.memory);
    begin(character.outfit.wrinkles, character.folds);
}

void forget(Character &character) {
    const Outfit &outfit = character.outfit;
    int rows = outfit.solver.collider.parts * character.positions.size;
    for (int k = 0; k < rows; k++) character.searched.faces[k] = -1;
    for (int k = 0; k < rows; k++) character.searched.clear[k] = 0;
    forget_shown(character);
    character.contact.points.clear();
    character.contact.edges.clear();
    character.steps = character.solved = 0;
}

}  // namespace

Character::Character(const Outfit &outfit)
    : outfit(outfit), is_started(false), place{1, 0, {}}, root{}, spin(0), steps(0), solved(0), rate(0), wind{},
      gravity{0, 0, -GRAVITY}, origin{}, drift{}, shown_origin{} {
    int cages = outfit.cages.vertices(), rows = outfit.solver.collider.parts * cages;
    guide = arena.take<Vec64>(cages);
    positions = arena.take<Vec>(cages);
    velocities = arena.take<Vec>(cages);
    targets = arena.take<Vec>(cages);
    body = arena.take<Vec>(outfit.used.size);
    shown = arena.take<Vec>(outfit.points.vertices());
    searched = {arena.take<int32_t>(rows).data, arena.take<float>(rows).data};
    wrinkled = arena.take<Vec>(outfit.wrinkles.vertices);
    memory = lay_out(outfit.clearing, arena.take<uint8_t>((int)memory_size(outfit.clearing)).data);
    folds = lay_out(outfit.wrinkles, arena.take<uint8_t>((int)memory_size(outfit.wrinkles)).data);
    posed = make_posed(outfit, arena);
    opening = make_opening_work(outfit.opening, arena);
    fabrics = arena.take<Fabric>(outfit.garments());
    for (Fabric &fabric : fabrics) fabric = {};
    renew_material(*this);
    forget(*this);
}

bool start(Character &character, const RigidTransform *joints, Failure &failure) {
    const Skeleton &skeleton = character.outfit.skeleton;
    int count = skeleton.parents.size;
    if (!are_places(joints, count, failure)) return false;
    Arena &work = character.scratch;
    Scope scope(work);
    Array<RigidTransform> transforms = work.copy(joints, count), way = work.take<RigidTransform>(count);
    GroundFrame before = character.place;
    change_place(character, ground_frame(joints[0], skeleton.heads[0]));
    bring_in(character.place, transforms.data, count);
    character.root = transforms[0];
    character.spin = 0;
    forget(character);
    character.is_started = false;
    Pose pose = read_pose(skeleton, transforms.data, work);
    double energy = 0;
    int first = character.rate > 0 ? POSING_FRAMES : 0;
    for (int frame = first; frame <= POSING_FRAMES + SETTLING_FRAMES; frame++) {
        Scope frame_scope(work);
        if (frame <= POSING_FRAMES) {
            way_to(skeleton, pose, (double)frame / POSING_FRAMES, way.data);
            pose_all(character, way.data, character.posed);
        }
        Posed &posed = character.posed;
        if (frame == first) {
            Array<Vec> targets = find_targets(character, work);
            Vec64 middle = mean(targets);
            character.origin = posed.origin + middle;
            character.drift = {};
            copy(character.targets, around(targets, middle, work));
            copy(character.positions, character.targets);
            copy(character.body, around(posed.body, middle, work));
            memset(character.velocities.data, 0, sizeof(Vec) * (size_t)character.velocities.size);
            continue;
        }
        NextState next;
        if (!solve(character, SETTLING_SECONDS, work, next, failure)) {
            change_place(character, before);  // What is shown stays where it is.
            return false;
        }
        accept(character, next);
        // Kinetic damping (Barnes 1999): cloth that slows down is stopped, or a skirt would swing for seconds.
        double last = energy;
        energy = 0;
        for (Vec velocity : character.velocities) energy += (double)dot(velocity, velocity);
        if (energy < last) {
            memset(character.velocities.data, 0, sizeof(Vec) * (size_t)character.velocities.size);
            energy = 0;
        }
    }
    carry(character, SETTLING_SECONDS);
    // These start anew with the first frame, as they do where nothing was shown before.
    forget_shown(character);
    character.is_started = true;
    return true;
}

bool step(Character &character, const RigidTransform *joints, float seconds, Failure &failure) {
    int count = character.outfit.skeleton.parents.size;
    if (!are_places(joints, count, failure)) return false;
    if (!character.is_started) {
        failure.say("the cloth has not come to rest yet: start it first");
        return false;
    }
    if (!(seconds > 0)) {
        failure.say("a frame takes no time");
        return false;
    }
    Arena &work = character.scratch;
    Scope scope(work);
    Array<RigidTransform> transforms = work.copy(joints, count);
    bring_in(character.place, transforms.data, count);
    GroundFrame place = character.place;
    Array<Vec64> guide = work.copy(character.guide);
    bool is_jump = is_finite(seconds) && jumps(character, transforms[0], seconds);
    if (is_jump) {
        Vec64 way = (double)seconds * character.drift, head = character.outfit.skeleton.heads[0];
        double angle = seconds * character.spin;
        change_place(character, after_jump(place, character.root, transforms[0], head, way, angle));
        transforms = work.copy(joints, count);
        bring_in(character.place, transforms.data, count);
    }
    pose_all(character, transforms.data, character.posed);
    NextState next;
    if (!solve(character, seconds, work, next, failure)) {
        character.place = place;
        memcpy(character.guide.data, guide.data, sizeof(Vec64) * (size_t)guide.size);
        return false;
    }
    accept(character, next);
    character.spin = heading_between(character.root, transforms[0]) / seconds;
    character.root = transforms[0];
    if (is_jump) begin(character.outfit.wrinkles, character.folds);
    carry(character, seconds);
    // The run that a clip may start in is not known before a frame without a jump.
    if (!is_jump || character.steps != 1) character.steps++;
    return true;
}

void pull(Character &character, const Vec64 *points, float rate) {
    character.rate = rate;
    for (int k = 0; k < character.guide.size && rate > 0; k++)
        character.guide[k] = brought_in(character.place, points[k]);
}

}  // namespace uvc
