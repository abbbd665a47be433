#include "enclosure.h"

namespace uvc {

namespace {

constexpr int DEPTH = 64;

// A direction along no edge or axis.
constexpr Vec OBLIQUE{0.36f, 0.48f, 0.8f};

// Metres within which a point lies on the surface: no ray from it tells which side.
constexpr float ON_SURFACE = 1e-5f;

// Metres by which boxes are larger for rays, more than rounding.
constexpr float BESIDE = 4e-6f;

// Least size of a number that is divided by.
constexpr float SMALLEST = 1e-12f;

UVC_INLINE float inverse_of(float a) {
    return 1.0f / (absolute(a) > SMALLEST ? a : a < 0 ? -SMALLEST : SMALLEST);
}

// A ray in coordinates around its start in which it runs along z: axes are named anew so that it extends most
// along z, and then sheared (Woop, Benthin and Wald 2013, "Watertight ray/triangle intersection").
struct Ray {
    LaneVec start;
    Vec inverse;
    int x, y, z;
    float shear_x, shear_y, along;

    Ray(Vec from, Vec direction) : start(repeat(from)) {
        inverse = {inverse_of(direction.x), inverse_of(direction.y), inverse_of(direction.z)};
        float sizes[] = {absolute(direction.x), absolute(direction.y), absolute(direction.z)};
        z = sizes[0] >= sizes[1] && sizes[0] >= sizes[2] ? 0 : sizes[1] >= sizes[2] ? 1 : 2;
        x = (z + 1) % 3;
        y = (z + 2) % 3;
        along = axis(direction, z) < 0 ? -1.0f : 1.0f;
        shear_x = axis(direction, x) * axis(inverse, z);
        shear_y = axis(direction, y) * axis(inverse, z);
    }

    // Vertices around the start, in the ray's coordinates.
    LaneVec local(LaneVec points) const {
        LaneVec way = points - start;
        const Lanes *axes[] = {&way.x, &way.y, &way.z};
        Lanes depth = *axes[z];
        return {*axes[x] - shear_x * depth, *axes[y] - shear_y * depth, depth};
    }

    // Which of eight boxes it meets.
    LaneMask meets(const LaneBox &box) const {
        Lanes near{}, far = Lanes{} + 1e9f;
        narrow_to(box.low.x - start.x, box.high.x - start.x, inverse.x, near, far);
        narrow_to(box.low.y - start.y, box.high.y - start.y, inverse.y, near, far);
        narrow_to(box.low.z - start.z, box.high.z - start.z, inverse.z, near, far);
        return near <= far;
    }

    static UVC_MEMBER void narrow_to(Lanes low, Lanes high, float inverse, Lanes &near, Lanes &far) {
        Lanes one = (low - BESIDE) * inverse, other = (high + BESIDE) * inverse;
        near = most(near, least(one, other));
        far = least(far, most(one, other));
    }
};

// Twice the area of the triangles of the ray and edges from a to b, and in `left` on which side of these it
// passes. Both faces at an edge compute the same number, so that of them it meets one.
UVC_INLINE Lanes turn(const LaneVec &a, const LaneVec &b, LaneMask &left) {
    LaneMask is_turned = (b.x < a.x) | ((b.x == a.x) & (b.y < a.y));
    Lanes ax = choose(is_turned, b.x, a.x), ay = choose(is_turned, b.y, a.y);
    Lanes bx = choose(is_turned, a.x, b.x), by = choose(is_turned, a.y, b.y);
    Lanes area = ax * by - ay * bx;
    left = (area >= 0.0f) ^ is_turned;
    return choose(is_turned, -area, area);
}

// Exits minus entries of a ray among the faces of a block.
int crossings(const LaneTree &tree, const Vec *points, int block, const Ray &ray) {
    LaneFace faces = faces_of(tree, points, block);
    LaneVec a = ray.local(faces.a), b = ray.local(faces.b), c = ray.local(faces.c);
    LaneMask one, two, three;
    Lanes to_c = turn(a, b, one), to_a = turn(b, c, two), to_b = turn(c, a, three);
    Lanes depth = ray.along * (to_a * a.z + to_b * b.z + to_c * c.z);
    LaneMask is_own = LaneMask{0, 1, 2, 3, 4, 5, 6, 7} < tree.faces.size - LANES * block;
    Lanes none{}, one_way = choose(one & two & three & is_own & (depth > 0.0f), none + 1.0f, none);
    Lanes signs = choose(~(one | two | three) & is_own & (depth < 0.0f), none - 1.0f, one_way);
    return (int)(ray.along * sum(signs));
}

// Looks at the parts once; see nearest_part.
NearestPart look_at_parts(Array<LaneTree> trees, Array<FittedTree> fitted, int touched, Vec point, float reach,
                          float exact) {
    NearestPart best{reach, {}, 0, FARTHEST};
    for (int part = 0; part < trees.size; part++) {
        const LaneTree &tree = trees.at(part);
        if (!(touched >> part & 1) || !tree.faces.size) continue;
        float near = least(reach, exact);
        SignedClosest here = signed_closest(tree, fitted.at(part), point, near);
        if (here.face < 0 && near < reach) {
            // Farther away, it counts only with the point inside. The ray leads away from the part, which makes
            // it short, and out of the body's plane of symmetry.
            Vec away = unit(point - fitted.at(part).points[tree.faces.at(0).a]) + OBLIQUE;
            if (count_crossings(tree, fitted.at(part), point, away) > 0)
                here = signed_closest(tree, fitted.at(part), point, reach);
            else
                best.distance = least(best.distance, near);
        }
        if (dot(best.outward, here.outward) < 0) best.room = least(best.room, best.distance + here.distance);
        if (here.face >= 0 && here.distance < best.distance) {
            best.distance = here.distance;
            best.outward = here.outward;
            best.offset = dot(here.outward, here.place);
        }
    }
    return best;
}

}  // namespace

int count_crossings(const LaneTree &tree, const FittedTree &fitted, Vec start, Vec direction) {
    if (!tree.faces.size) return 0;
    Ray ray(start, direction);
    int stack[DEPTH];
    int top = 1, count = 0;
    stack[0] = tree.nodes.size - 1;
    while (top > 0) {
        int node = stack[--top];
        Children children = tree.nodes.at(node);
        unsigned lanes = bits(ray.meets(fitted.boxes.at(node)));
        for (lanes &= (1u << (children.last - children.first)) - 1; lanes;) {
            int child = children.first + take(lanes);
            if (node < tree.patches)
                count += crossings(tree, fitted.points, child, ray);
            else
                stack[top++] = child;
        }
    }
    return count;
}

SignedClosest signed_closest(const LaneTree &tree, const FittedTree &fitted, Vec point, float reach) {
    SignedClosest best{reach, point, {}, -1, {}};
    // All patches are fitted: the search writes nothing.
    FittedTree view = fitted;
    float beyond;
    best.face = closest_face(tree, view, point, reach, beyond);
    if (best.face < 0) return best;
    const Vec *points = fitted.points;
    Face f = tree.faces.at(best.face);
    best.weights = closest_barycentrics(point, points[f.a], points[f.b], points[f.c]);
    best.place = weighted(best.weights, points[f.a], points[f.b], points[f.c]);
    best.outward = unit(face_normal(f, points));
    Vec away = point - best.place;
    float size = length(away);
    if (size > ON_SURFACE) {
        away = (1.0f / size) * away;
        bool is_inside = count_crossings(tree, fitted, point, away) > 0;
        if (is_inside != (dot(best.outward, away) < 0)) {
            bool there = count_crossings(tree, fitted, point, OBLIQUE) > 0;
            bool back = count_crossings(tree, fitted, point, -OBLIQUE) > 0;
            is_inside = (there && back) || (is_inside && (there || back));
        }
        best.outward = is_inside ? -away : away;
    }
    best.distance = dot(point - best.place, best.outward) < 0 ? -size : size;
    return best;
}

NearestPart nearest_part(Array<LaneTree> trees, Array<FittedTree> fitted, int touched, Vec point, float reach,
                         float exact, float narrow) {
    NearestPart best = look_at_parts(trees, fitted, touched, point, reach, exact);
    // So deep in one part, even one that is farther away may leave too little room.
    if (best.distance < narrow - exact)
        best = look_at_parts(trees, fitted, touched, point, reach, FARTHEST);
    return best;
}

}  // namespace uvc
