#include "wrinkle_sheet.h"

#include "lanes.h"
#include "section_name.h"
#include "shares.h"

namespace uvc {

namespace {

// Square of the least area of a texel's unit square on the cloth by which its axes are found.
constexpr float LEAST_AREA = 1e-12f;

// Reads places of texels: corners, and two of three shares of each.
void read_places(WrinkleSheet &sheet, const Sections &sections, const char *prefix, int points, Arena &arena,
                 Failure &failure) {
    SectionName corners(prefix, ".corners"), shares(prefix, ".shares");
    int count = sheet.texels.size;
    Array<int32_t> indices = read_indices(sections, corners.text, count, 3, 0, points, arena, failure);
    Arena work;
    Array<float> two = read_floats(sections, shares.text, count, 2, work, failure);
    if (failure.failed) return;
    sheet.corners = {reinterpret_cast<Face *>(indices.data), count};
    sheet.shares = arena.take<Vec>(count);
    for (int k = 0; k < count; k++)
        sheet.shares[k] = {two[2 * k], two[2 * k + 1], 1 - two[2 * k] - two[2 * k + 1]};
}

void read_slopes(WrinkleSheet &sheet, const Sections &sections, const char *prefix, int points, Arena &arena,
                 Failure &failure) {
    SectionName starts(prefix, ".slope_starts"), around(prefix, ".slope_points"), slopes(prefix, ".slopes");
    sheet.slope_points = read_indices(sections, around.text, -1, 1, 0, points, arena, failure);
    int count = sheet.texels.size, total = sheet.slope_points.size;
    sheet.slope_starts = read_starts(sections, starts.text, count, total, arena, failure);
    for (int k = 0; k < count && !failure.failed; k++)
        if (sheet.slope_starts[k] == sheet.slope_starts[k + 1])
            failure.say("texel %d of the outfit's wrinkles has no points around it", k);
    if (!failure.failed) sheet.slopes = read_floats(sections, slopes.text, total - count, 2, arena, failure);
}

void read_beside(WrinkleSheet &sheet, const Sections &sections, const char *prefix, int pixels, Arena &arena,
                 Failure &failure) {
    SectionName beside(prefix, ".beside"), sources(prefix, ".sources"), turns(prefix, ".turns");
    sheet.beside = read_indices(sections, beside.text, -1, 1, 0, pixels, arena, failure);
    int count = sheet.beside.size;
    sheet.sources = read_indices(sections, sources.text, count, 1, 0, sheet.texels.size, arena, failure);
    Array<float> numbers = read_floats(sections, turns.text, count, 4, arena, failure);
    sheet.turns = {reinterpret_cast<PlaneTurn *>(numbers.data), count};
}

void read_back(WrinkleSheet &sheet, const Sections &sections, const char *prefix, Arena &arena,
               Failure &failure) {
    SectionName starts(prefix, ".back_starts"), back(prefix, ".back"), shares(prefix, ".back_shares");
    sheet.back.columns = read_indices(sections, back.text, -1, 1, 0, 4 * sheet.texels.size, arena, failure);
    sheet.back.starts =
        read_starts(sections, starts.text, sheet.vertices(), sheet.back.columns.size, arena, failure);
    sheet.back.weights = read_shares(sections, shares.text, sheet.back.starts, arena, failure);
}

// Right-angled unit axes that are nearest to slopes along u and v: F (F^T F)^(-1/2). The root of a symmetric
// 2 x 2 matrix M is (M + root(det M)) / root(tr M + 2 root(det M)).
Axes right_angled(Vec u, Vec v, float side) {
    float a = dot(u, u), b = dot(u, v), c = dot(v, v);
    float area = root(most(a * c - b * b, LEAST_AREA));
    float scale = 1 / (area * root(most(a + c + 2 * area, LEAST_AREA)));
    Vec one = scale * ((c + area) * u - b * v), other = scale * ((a + area) * v - b * u);
    return {one, other, side * cross(one, other)};
}

Vec xyz(Lanes a) { return {a[0], a[1], a[2]}; }
Vec next_xyz(Lanes a) { return {a[3], a[4], a[5]}; }

}  // namespace

WrinkleSheet read_wrinkle_sheet(const Sections &sections, const char *prefix, Array<Vec> rest,
                                Array<Face> faces, int size, Arena &arena, Failure &failure) {
    WrinkleSheet sheet{};
    SectionName texels(prefix, ".texels"), sides(prefix, ".sides"), free(prefix, ".free");
    int pixels = size * size, points = rest.size;
    sheet.faces = faces;
    sheet.texels = read_indices(sections, texels.text, -1, 1, 0, pixels, arena, failure);
    read_places(sheet, sections, prefix, points, arena, failure);
    read_slopes(sheet, sections, prefix, points, arena, failure);
    sheet.sides = read_floats(sections, sides.text, sheet.texels.size, 1, arena, failure);
    read_beside(sheet, sections, prefix, pixels, arena, failure);
    sheet.free = read_floats(sections, free.text, points, 1, arena, failure);
    if (failure.failed) return {};
    sheet.refined = refine(faces, points, arena);
    sheet.rings = vertex_rings(sheet.refined.faces, sheet.vertices(), arena);
    read_back(sheet, sections, prefix, arena, failure);
    if (failure.failed) return {};
    Arena work;
    int count = sheet.count();
    sheet.rest = arena.take<Vec>(count);
    for (int k = 0; k < count; k++) {
        Face f = sheet.corners[k];
        sheet.rest[k] = weighted(sheet.shares[k], rest[f.a], rest[f.b], rest[f.c]);
    }
    Array<Vec> normals = work.take<Vec>(points);
    Array<Axes> axes = work.take<Axes>(count);
    find_normals(faces, rest.data, normals);
    sheet.rest_forms = arena.take<FundamentalForms>(count);
    Array<FundamentalForms> forms = work.take<FundamentalForms>(count);
    find_forms(sheet, rest.data, normals.data, forms.data, axes.data, work);
    memcpy(sheet.rest_forms.data, forms.data, sizeof(FundamentalForms) * (size_t)count);
    return sheet;
}

void find_normals(Array<Face> faces, const Vec *points, Array<Vec> normals) {
    for (Vec &normal : normals) normal = {};
    for (Face face : faces) {
        Vec area = face_normal(face, points);
        for (int corner = 0; corner < 3; corner++) normals[face[corner]] += area;
    }
    for (Vec &normal : normals) normal = unit(normal);
}

void find_forms(const WrinkleSheet &sheet, const Vec *points, const Vec *normals, FundamentalForms *forms,
                Axes *axes, Arena &work) {
    Scope scope(work);
    Array<Lanes> both = work.room<Lanes>(most(sheet.free.size, 1));
    for (int k = 0; k < sheet.free.size; k++) {
        Vec p = points[k], n = normals[k];
        both[k] = Lanes{p.x, p.y, p.z, n.x, n.y, n.z, 0, 0};
    }
    const float *slopes = sheet.slopes.data;
    for (int texel = 0; texel < sheet.count(); texel++) {
        int first = sheet.slope_starts[texel], last = sheet.slope_starts[texel + 1];
        Lanes origin = both[sheet.slope_points[first]], along_u{}, along_v{};
        for (int k = first + 1; k < last; k++, slopes += 2) {
            Lanes way = both[sheet.slope_points[k]] - origin;
            along_u += slopes[0] * way;
            along_v += slopes[1] * way;
        }
        Vec u = xyz(along_u), v = xyz(along_v), normal_u = next_xyz(along_u), normal_v = next_xyz(along_v);
        float bend[] = {-dot(u, normal_u), -dot(v, normal_v), -0.5f * (dot(u, normal_v) + dot(v, normal_u))};
        FundamentalForms made{{dot(u, u) - 1, dot(v, v) - 1, dot(u, v)}, {}};
        for (int k = 0; k < 3; k++) made.bend[k] = bend[k] - sheet.rest_forms[texel].bend[k];
        forms[texel] = made;
        axes[texel] = right_angled(u, v, sheet.sides[texel]);
    }
}

}  // namespace uvc
