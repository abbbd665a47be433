#include "wrinkles.h"

#include "box_tree.h"
#include "section_name.h"

namespace uvc {

namespace {

// Metres from the skin beyond which its distance no longer counts, and that wrinkles keep from it.
constexpr float SKIN_REACH = 0.04f, CLEARANCE = 0.003f;

// m/s2 of specific force that the network sees at most along each axis, and gravity.
constexpr float STRONGEST = 40, GRAVITY = 9.81f;

// Seconds of the shortest frame by which rates are found, and m/s of the fastest point.
constexpr float SHORTEST = 1e-4f, FASTEST = 1e3f;

// Most garments with wrinkles.
constexpr int MOST_WRINKLED = 31;

// Times that the shares of what lies on itself are spread to neighbours.
constexpr int FADING = 2;

// Most frames that are counted.
constexpr int MOST_FRAMES = 1 << 30;

// Name of the sections of a garment with wrinkles.
struct Prefix {
    char text[12] = "wrinkles";

    explicit Prefix(int garment) {
        char *end = text + 8;
        if (garment >= 10) *end++ = (char)('0' + garment / 10);
        *end++ = (char)('0' + garment % 10);
        *end = 0;
    }
};

// Faces of a garment among those of the outfit, on its points from `first` up to `last`.
Array<Face> own_faces(Array<Face> all, int first, int last, Arena &arena) {
    Array<Face> faces = arena.take<Face>(all.size);
    faces.size = 0;
    for (Face f : all)
        if (least(f.a, least(f.b, f.c)) >= first && most(f.a, most(f.b, f.c)) < last)
            faces[faces.size++] = {f.a - first, f.b - first, f.c - first};
    return faces;
}

float limited(float number, float limit) { return least(limit, most(-limit, number)); }
Vec limited(Vec a, float limit) { return {limited(a.x, limit), limited(a.y, limit), limited(a.z, limit)}; }

// A garment in a frame: forms and axes (P) at its texels, and at its points (U) the specific force, m/s2, and
// the skin.
struct Frame {
    Array<FundamentalForms> forms;
    Array<Axes> axes;
    Array<Vec> force;
    Array<NearSkin> near;
};

// A row of the network's inputs at a texel.
void write_row(const WrinkleSheet &sheet, const Frame &frame, const FundamentalForms &before, float rate,
               int texel, float *row) {
    FundamentalForms forms = frame.forms[texel];
    Face f = sheet.corners[texel];
    Vec shares = sheet.shares[texel], rest = sheet.rest[texel];
    Vec force = weighted(shares, frame.force[f.a], frame.force[f.b], frame.force[f.c]);
    Axes axes = frame.axes[texel];
    for (int k = 0; k < 3; k++) {
        row[k] = forms.strain[k];
        row[3 + k] = forms.bend[k];
        row[6 + k] = rate * (forms.strain[k] - before.strain[k]);
        row[9 + k] = rate * (forms.bend[k] - before.bend[k]);
        row[12 + k] = sheet.rest_forms[texel].bend[k];
    }
    row[15] = dot(axes.u, force);
    row[16] = dot(axes.v, force);
    row[17] = dot(axes.normal, force);
    row[18] = dot(shares, Vec{frame.near[f.a].away, frame.near[f.b].away, frame.near[f.c].away});
    row[19] = rest.x;
    row[20] = rest.y;
    row[21] = rest.z;
    row[22] = 1;
}

// The row of a texel as it is beside a chart, on the axes there.
void turn_row(const float *from, PlaneTurn turn, float *row) {
    memcpy(row, from, sizeof(float) * INPUTS);
    float a = turn.a, b = turn.b, c = turn.c, d = turn.d;
    for (int k = 0; k < 15; k += 3) {
        float uu = from[k], vv = from[k + 1], uv = from[k + 2];
        row[k] = a * a * uu + b * b * vv + 2 * a * b * uv;
        row[k + 1] = c * c * uu + d * d * vv + 2 * c * d * uv;
        row[k + 2] = a * c * uu + b * d * vv + (a * d + b * c) * uv;
    }
    row[15] = a * from[15] + b * from[16];
    row[16] = c * from[15] + d * from[16];
}

// Maps of the network's inputs, with the pixels beside charts filled across seams.
FeatureMaps make_inputs(const WrinkleSheet &sheet, const Frame &frame, const FundamentalForms *before,
                        float rate, int size, Arena &work) {
    FeatureMaps maps = take_maps(size, INPUTS_ROOM, work);
    auto place = [&](int pixel) { return maps.at(pixel / size, pixel % size); };
    for (int k = 0; k < sheet.count(); k++)
        write_row(sheet, frame, before[k], rate, k, place(sheet.texels[k]));
    for (int k = 0; k < sheet.beside.size; k++)
        turn_row(place(sheet.texels[sheet.sources[k]]), sheet.turns[k], place(sheet.beside[k]));
    return maps;
}

// Offsets, m, of the refined mesh by displacements (P, 12) of texels; half the way to the mean around each:
// gains of texels are rough, and both sides of a seam differ.
Array<Vec> spread(const WrinkleSheet &sheet, const Axes *axes, const float *displacements, float gain,
                  Arena &work) {
    Array<Four> quarters = work.room<Four>(4 * sheet.count()), rough = work.room<Four>(sheet.vertices());
    for (int k = 0; k < sheet.count(); k++) {
        const float *own = displacements + DISPLACEMENTS * k;
        for (int quarter = 0; quarter < 4; quarter++)
            quarters[4 * k + quarter] = four(gain * (own[quarter] * axes[k].u + own[4 + quarter] * axes[k].v +
                                                     own[8 + quarter] * axes[k].normal));
    }
    for (int vertex = 0; vertex < rough.size; vertex++) {
        Four total{};
        for (int k = sheet.back.starts[vertex]; k < sheet.back.starts[vertex + 1]; k++)
            total += sheet.back.weights[k] * quarters[sheet.back.columns[k]];
        rough[vertex] = total;
    }
    Array<Vec> smooth = work.room<Vec>(rough.size);
    for (int vertex = 0; vertex < rough.size; vertex++) {
        int first = sheet.rings.starts[vertex], last = sheet.rings.starts[vertex + 1];
        Four total{}, here = rough[vertex];
        for (int k = first; k < last; k++) total += rough[sheet.rings.ring[k]];
        if (last > first) here = 0.5f * (here + (1 / (float)(last - first)) * total);
        smooth[vertex] = {here[0], here[1], here[2]};
    }
    return smooth;
}

// Shares (U) of displacements that are shown: none where the garment is folded onto itself, where both sides
// would go through each other, and few around it.
Array<float> find_shares(const WrinkledGarment &garment, const NearCloth *beside, Arena &work) {
    int count = garment.sheet.free.size;
    Array<float> shares = work.room<float>(count), before = work.room<float>(count);
    for (int k = 0; k < count; k++) shares[k] = beside[k].open;
    for (int turn = 0; turn < FADING; turn++) {
        swap(shares, before);
        for (int k = 0; k < count; k++) {
            int first = garment.rings.starts[k], last = garment.rings.starts[k + 1];
            float total = 0;
            for (int j = first; j < last; j++) total += before[garment.rings.ring[j]];
            shares[k] = last > first ? least(before[k], total / (float)(last - first)) : before[k];
        }
    }
    for (int k = 0; k < count; k++) shares[k] *= garment.sheet.free[k];
    return shares;
}

// Displaces the smooth refined surface by shares of offsets; towards the skin, or another garment that is
// closer, only up to planes, which between points are those between theirs.
void displace(const WrinkleSheet &sheet, const Vec *points, const float *thickness, const NearSkin *near,
              const NearCloth *beside, Array<float> shares, Array<Vec> offsets, Vec *vertices, Arena &work) {
    Array<Lanes> known = work.room<Lanes>(most(shares.size, 1));
    for (int k = 0; k < shares.size; k++) {
        NearSkin plane{near[k].away - thickness[k], near[k].outward};
        if (beside[k].other.away < plane.away) plane = beside[k].other;
        Vec p = points[k], n = plane.outward;
        known[k] = Lanes{p.x, p.y, p.z, n.x, n.y, n.z, plane.away, shares[k]};
    }
    const Rows &rows = sheet.refined.rows;
    for (int vertex = 0; vertex < offsets.size; vertex++) {
        Lanes total{};
        for (int k = rows.starts[vertex]; k < rows.starts[vertex + 1]; k++)
            total += rows.weights[k] * known[rows.columns[k]];
        Vec smooth{total[0], total[1], total[2]}, normal{total[3], total[4], total[5]};
        Vec offset = total[7] * offsets[vertex];
        float outwards = dot(offset, normal), room = most(total[6] - CLEARANCE, 0.0f);
        vertices[vertex] = smooth + offset + (most(outwards, -room) - outwards) * normal;
    }
}

}  // namespace

bool has_wrinkles(const Sections &sections) { return has_section(sections, "wrinkles.garments"); }

Wrinkles read_wrinkles(const Sections &sections, Arena &arena, Failure &failure) {
    Wrinkles wrinkles{};
    Arena work;
    wrinkles.network = read_wrinkle_network(sections, arena, failure);
    wrinkles.gain = read_number(sections, "wrinkles.gain", failure);
    wrinkles.lag = read_number(sections, "wrinkles.lag", failure);
    Array<float> rest = read_floats(sections, "points.rest", -1, 3, arena, failure);
    int points = wrinkles.points = rest.size / 3;
    Array<int32_t> corners = read_faces(sections, "fine.faces", points, arena, failure);
    wrinkles.thickness = read_floats(sections, "fine.thickness", points, 1, arena, failure);
    Array<int32_t> starts = read_integers(sections, "garments.starts", -1, 1, work, failure);
    int garments = most(starts.size - 1, 0);
    starts = read_starts(sections, "garments.starts", garments, points, work, failure);
    Array<int32_t> which = read_indices(sections, "wrinkles.garments", -1, 1, 0, garments, work, failure);
    Array<float> skin = read_floats(sections, "skin.rest", -1, 3, work, failure);
    Array<int32_t> skin_faces = read_faces(sections, "skin.faces", skin.size / 3, arena, failure);
    if (which.size > MOST_WRINKLED) failure.say("more than %d garments have wrinkles", MOST_WRINKLED);
    if (failure.failed) return {};
    Array<Face> faces = wrinkles.faces = {reinterpret_cast<Face *>(corners.data), corners.size / 3};
    Array<Vec> places{reinterpret_cast<Vec *>(rest.data), points};
    wrinkles.cloth = {places, arena.take<int32_t>(points)};
    for (int garment = 0; garment < garments; garment++)
        for (int k = starts[garment]; k < starts[garment + 1]; k++) wrinkles.cloth.garments[k] = garment;
    wrinkles.garments = arena.take<WrinkledGarment>(which.size);
    for (int k = 0; k < which.size; k++) {
        WrinkledGarment &one = wrinkles.garments[k];
        if (k && which[k] <= which[k - 1])
            failure.say("section wrinkles.garments of the outfit is not in order");
        int first = starts[which[k]], last = starts[which[k] + 1];
        Array<Face> own = own_faces(faces, first, last, arena);
        one.sheet = read_wrinkle_sheet(sections, Prefix(k).text, places.part(first, last), own,
                                       wrinkles.network.size, arena, failure);
        if (failure.failed) return {};
        one.rings = vertex_rings(own, last - first, arena);
        one.garment = which[k];
        one.points = first;
        one.texels = wrinkles.texels;
        one.vertices = wrinkles.vertices;
        wrinkles.texels += one.sheet.count();
        wrinkles.vertices += one.sheet.vertices();
    }
    wrinkles.skin = make_whole_skin({reinterpret_cast<Vec *>(skin.data), skin.size / 3},
                                    {reinterpret_cast<Face *>(skin_faces.data), skin_faces.size / 3}, arena);
    return wrinkles;
}

size_t memory_size(const Wrinkles &wrinkles) {
    size_t points = (size_t)wrinkles.points, texels = (size_t)wrinkles.texels;
    return 4 + points * (2 * sizeof(Vec) + 4) + texels * (sizeof(FundamentalForms) + 4 * DISPLACEMENTS);
}

WrinkleMemory lay_out(const Wrinkles &wrinkles, void *bytes) {
    int32_t *frames = static_cast<int32_t *>(bytes), *faces = frames + 1;
    Vec *points = reinterpret_cast<Vec *>(faces + wrinkles.points), *velocities = points + wrinkles.points;
    FundamentalForms *forms = reinterpret_cast<FundamentalForms *>(velocities + wrinkles.points);
    return {frames, points, velocities, faces, forms, reinterpret_cast<float *>(forms + wrinkles.texels)};
}

void begin(const Wrinkles &wrinkles, const WrinkleMemory &memory) {
    memset(memory.frames, 0, memory_size(wrinkles));
    for (int k = 0; k < wrinkles.points; k++) memory.faces[k] = -1;
}

bool is_whole(const Wrinkles &wrinkles, const WrinkleMemory &memory) {
    bool all = *memory.frames >= 0 && *memory.frames <= MOST_FRAMES;
    for (int k = 0; k < wrinkles.points; k++)
        all = all && memory.faces[k] >= -1 && memory.faces[k] < wrinkles.skin.surface.faces.size;
    // All that follows the faces is numbers.
    const float *numbers = reinterpret_cast<const float *>(memory.points);
    const float *end = memory.displacements + DISPLACEMENTS * wrinkles.texels;
    for (; numbers < end; numbers++) all = all && is_finite(*numbers);
    return all;
}

void wrinkle(const Wrinkles &wrinkles, const WrinkleMemory &memory, const Vec *points, const Vec *skin,
             float seconds, Vec way, Vec *vertices, Arena &work) {
    Scope scope(work);
    bool is_first = *memory.frames == 0;
    float rate = 1 / most(seconds, SHORTEST);
    float stays = wrinkles.lag > 0 && !is_first ? __builtin_expf(-seconds / wrinkles.lag) : 0;
    SkinSearch search(wrinkles.skin, skin, work);
    Array<Vec> normals = work.room<Vec>(wrinkles.points);
    find_normals(wrinkles.faces, points, normals);
    for (const WrinkledGarment &garment : wrinkles.garments) {
        Scope garment_scope(work);
        const WrinkleSheet &sheet = garment.sheet;
        int count = sheet.free.size, texels = sheet.count();
        const Vec *here = points + garment.points;
        Vec *before = memory.points + garment.points, *velocities = memory.velocities + garment.points;
        Frame frame{work.room<FundamentalForms>(texels), work.room<Axes>(texels), work.room<Vec>(count),
                    work.room<NearSkin>(count)};
        search.find_near(here, count, *memory.frames, SKIN_REACH, memory.faces + garment.points,
                         frame.near.data);
        for (int k = 0; k < count; k++) {
            Vec velocity = is_first ? Vec{} : limited(rate * (here[k] + way - before[k]), FASTEST);
            Vec force = Vec{0, 0, -GRAVITY} - rate * (velocity - velocities[k]);
            frame.force[k] = limited(force, STRONGEST);
            velocities[k] = velocity;
            before[k] = here[k];
        }
        find_forms(sheet, here, normals.data + garment.points, frame.forms.data, frame.axes.data, work);
        FundamentalForms *forms = memory.forms + garment.texels;
        const FundamentalForms *last = is_first ? frame.forms.data : forms;
        FeatureMaps inputs = make_inputs(sheet, frame, last, rate, wrinkles.network.size, work);
        memcpy(forms, frame.forms.data, sizeof(FundamentalForms) * (size_t)texels);
        Array<float> made = work.room<float>(DISPLACEMENTS * wrinkles.network.size * wrinkles.network.size);
        run(wrinkles.network, inputs, made.data, work);
        float *shown = memory.displacements + DISPLACEMENTS * garment.texels;
        for (int k = 0; k < texels; k++)
            for (int j = 0; j < DISPLACEMENTS; j++) {
                float now = made[DISPLACEMENTS * sheet.texels[k] + j], &kept = shown[DISPLACEMENTS * k + j];
                kept = now + stays * (kept - now);
            }
        Array<Vec> offsets = spread(sheet, frame.axes.data, shown, wrinkles.gain, work);
        Array<NearCloth> beside = work.room<NearCloth>(count);
        find_near_cloth(wrinkles.cloth, points, normals.data, garment.points, garment.points + count,
                        beside.data, work);
        displace(sheet, here, wrinkles.thickness.data + garment.points, frame.near.data, beside.data,
                 find_shares(garment, beside.data, work), offsets, vertices + garment.vertices, work);
    }
    *memory.frames = least(*memory.frames + 1, MOST_FRAMES);
}

}  // namespace uvc
