#include "derived.h"

#include "caps.h"
#include "triangle.h"

namespace uvc {

namespace {

// Most parts, and most faces of a collider, so that damaged caps fill no memory.
constexpr int MOST_PARTS = 31, MOST_FACES = 1 << 22;

struct Parts {
    int count;
    Array<int32_t> starts, faces, cap_starts, caps, met;
};

Parts read_parts(const Sections &sections, int faces, int caps, Arena &arena, Failure &failure) {
    Parts parts{};
    parts.met = read_indices(sections, "parts.met", -1, 1, 0, 2, arena, failure);
    parts.count = parts.met.size;
    if (parts.count > MOST_PARTS)
        failure.say("the body has %d parts, at most %d are possible", parts.count, MOST_PARTS);
    parts.faces = read_indices(sections, "parts.faces", -1, 1, 0, faces, arena, failure);
    parts.starts = read_starts(sections, "parts.starts", parts.count, parts.faces.size, arena, failure);
    parts.caps = read_indices(sections, "parts.caps", -1, 1, 0, caps, arena, failure);
    parts.cap_starts = read_starts(sections, "parts.cap_starts", parts.count, parts.caps.size, arena, failure);
    return parts;
}

// Reads a section that is needed again, which would be decoded again.
Array<float> keep_floats(Sections &sections, const char *name, Arena &arena, Failure &failure) {
    Array<float> numbers = read_floats(sections, name, -1, 3, arena, failure);
    derive(sections, name, numbers, 3);
    return numbers;
}

Array<int32_t> keep_indices(Sections &sections, const char *name, int high, Arena &arena, Failure &failure) {
    Array<int32_t> numbers = read_indices(sections, name, -1, 3, 0, high, arena, failure);
    derive(sections, name, numbers, 3);
    return numbers;
}

Array<float> divided(Array<float> numbers, float divisor, Arena &arena) {
    Array<float> quotients = arena.take<float>(numbers.size);
    for (int k = 0; k < numbers.size; k++) quotients[k] = numbers[k] / divisor;
    return quotients;
}

Array<int32_t> integers(Array<Face> faces) {
    return {reinterpret_cast<int32_t *>(faces.data), 3 * faces.size};
}

// Faces of a part, of the skin and then of its caps. Returns how many there are; null counts them.
int64_t close_part(const Parts &parts, int part, const Caps &caps, const Face *skin, Face *closed) {
    int64_t count = 0;
    for (int k = parts.starts[part]; k < parts.starts[part + 1]; k++, count++)
        if (closed) closed[count] = skin[parts.faces[k]];
    for (int32_t cap : parts.caps.part(parts.cap_starts[part], parts.cap_starts[part + 1])) {
        const int32_t *rim = caps.rims.data + 2 * caps.rim_starts[cap];
        int edges = caps.rim_starts[cap + 1] - caps.rim_starts[cap];
        for (int k = 0; closed && k < edges; k++)
            closed[count + k] = {rim[2 * k + 1], rim[2 * k], caps.tips[cap]};
        count += edges;
    }
    return count;
}

// Numbers the vertices of a part's faces in their order, behind those of the parts before, and adds them.
int renumber(Array<Face> faces, int vertices, Array<int32_t> used, int count) {
    Arena work;
    Array<int32_t> number = work.take<int32_t>(vertices);
    for (Face face : faces)
        for (int corner = 0; corner < 3; corner++) number[face[corner]] = 1;
    for (int vertex = 0; vertex < vertices; vertex++) {
        if (!number[vertex]) continue;
        used[count] = vertex;
        number[vertex] = count++;
    }
    for (Face &face : faces) face = {number[face.a], number[face.b], number[face.c]};
    return count;
}

// Derives what the collider's parts are made of. rest: (C, 3) m, of the body, at an adult's size, and the tips.
void derive_collider(Sections &sections, const Parts &parts, const Caps &caps, Array<Face> skin,
                     Array<Vec> rest, Arena &arena, Failure &failure) {
    int64_t total = 0;
    for (int part = 0; part < parts.count && total <= MOST_FACES; part++)
        total += close_part(parts, part, caps, skin.data, nullptr);
    if (total > MOST_FACES) {
        failure.say("the collider of the outfit has more than %d faces", MOST_FACES);
        return;
    }
    Array<Face> faces = arena.take<Face>((int)total), skins = arena.take<Face>(parts.faces.size);
    Array<int32_t> starts = arena.take<int32_t>(parts.count + 1);
    Array<int32_t> used = arena.take<int32_t>(3 * faces.size);
    int met = 0, count = 0;
    for (int part = 0; part < parts.count; part++) {
        if (!parts.met[part]) continue;
        int first = starts[met];
        int end = first + (int)close_part(parts, part, caps, skin.data, faces.data + first);
        starts[++met] = end;
        count = renumber(faces.part(first, end), rest.size, used, count);
    }
    for (int k = 0; k < skins.size; k++) skins[k] = skin[parts.faces[k]];
    used = used.part(0, count);
    Array<Vec> places = arena.take<Vec>(count);
    for (int k = 0; k < count; k++) places[k] = rest[used[k]];
    derive(sections, "outfit.used", used, 1);
    derive(sections, "collider.rest", Array<float>{reinterpret_cast<float *>(places.data), 3 * count}, 3);
    derive(sections, "collider.faces", integers(faces.part(0, starts[met])), 3);
    derive(sections, "collider.starts", starts.part(0, met + 1), 1);
    derive(sections, "opening.faces", integers(skins), 3);
}

// Derives the tips behind so many vertices of the body, and what an opening knows of the caps.
Caps derive_caps(Sections &sections, int body, Arena &arena, Failure &failure) {
    Array<int32_t> starts = read_integers(sections, "caps.rim_starts", -1, 1, arena, failure);
    Array<int32_t> tips = arena.take<int32_t>(starts.size - 1);
    for (int k = 0; k < tips.size; k++) tips[k] = body + k;
    derive(sections, "caps.tips", tips, 1);
    Caps caps = read_caps(sections, body + tips.size, arena, failure);
    Array<int32_t> rims = arena.take<int32_t>(caps.rims.size / 2);
    for (int k = 0; k < rims.size; k++) rims[k] = caps.rims[2 * k];
    derive(sections, "opening.tips", caps.tips, 1);
    derive(sections, "opening.rim_starts", caps.rim_starts, 1);
    derive(sections, "opening.rims", rims, 1);
    return caps;
}

// Derives the third share of each covered point.
void derive_covered(Sections &sections, Arena &arena, Failure &failure) {
    Array<float> shares = read_floats(sections, "covered.shares", -1, 2, arena, failure);
    Array<float> weights = arena.take<float>(shares.size / 2 * 3);
    for (int k = 0; k < shares.size / 2; k++) {
        float first = shares[2 * k], second = shares[2 * k + 1];
        weights[3 * k] = first;
        weights[3 * k + 1] = second;
        weights[3 * k + 2] = 1 - first - second;
    }
    derive(sections, "covered.weights", weights, 3);
}

}  // namespace

void derive_sections(Sections &sections, Arena &arena, Failure &failure) {
    float size = read_number(sections, "outfit.size", failure);
    if (!failure.failed && !(size > 0)) failure.say("the size of the outfit's body is not positive");
    Array<float> body = keep_floats(sections, "body.rest", arena, failure);
    Array<float> points = keep_floats(sections, "points.rest", arena, failure);
    Array<float> cages = keep_floats(sections, "cages.rest", arena, failure);
    Array<float> skin = divided(body, size, arena);
    int vertices = body.size / 3;
    derive(sections, "skin.rest", skin, 3);
    derive(sections, "fine.rest", divided(points, size, arena), 3);
    derive(sections, "cloth.rest", cages, 3);
    Array<int32_t> sheet = keep_indices(sections, "sheet.faces", cages.size / 3, arena, failure);
    derive(sections, "membrane.corners", sheet, 3);
    derive_covered(sections, arena, failure);
    Caps caps = derive_caps(sections, vertices, arena, failure);
    Array<int32_t> corners = keep_indices(sections, "skin.faces", vertices, arena, failure);
    Array<Face> faces{reinterpret_cast<Face *>(corners.data), corners.size / 3};
    Parts parts = read_parts(sections, faces.size, caps.tips.size, arena, failure);
    if (failure.failed) return;
    Array<Vec> rest = arena.take<Vec>(vertices + caps.tips.size);
    for (int k = 0; k < vertices; k++) rest[k] = {skin[3 * k], skin[3 * k + 1], skin[3 * k + 2]};
    add_tips(caps, rest.data);
    derive_collider(sections, parts, caps, faces, rest, arena, failure);
}

}  // namespace uvc
