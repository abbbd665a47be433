// All that a character's cloth remembers, as bytes.
#include "character.h"

namespace uvc {

namespace {

// Walks over bytes: counts them, or copies them out of or into what they belong to.
struct StateStream {
    enum Mode { COUNT, SAVE, RESTORE } mode;
    uint8_t *bytes;
    size_t size = 0;

    void over(void *place, size_t count) {
        if (mode == SAVE && count) memcpy(bytes + size, place, count);
        if (mode == RESTORE && count) memcpy(place, bytes + size, count);
        size += count;
    }
    template <class T> void one(T &value) { over(&value, sizeof(T)); }
    template <class T> void all(Array<T> array) { over(array.data, sizeof(T) * (size_t)array.size); }
};

// Numbers that say whose bytes they are: of cages, points and collider vertices, and of pairs.
struct Header {
    int32_t cages, points, collider, point_pairs, edge_pairs;
};

Header header_of(const Character &character) {
    return {character.positions.size, character.shown.size, character.body.size,
            character.contact.points.items.size, character.contact.edges.items.size};
}

void walk_over(Character &character, StateStream &walk) {
    Header header = header_of(character);
    int rows = character.outfit.solver.collider.parts * header.cages;
    walk.one(header);
    int32_t is_started = character.is_started;
    walk.one(is_started);
    character.is_started = is_started == 1;
    walk.one(character.place);
    walk.one(character.root);
    walk.one(character.spin);
    walk.one(character.steps);
    walk.one(character.solved);
    walk.one(character.rate);
    walk.one(character.wind);
    walk.one(character.gravity);
    walk.all(character.fabrics);
    walk.one(character.origin);
    walk.one(character.drift);
    walk.one(character.shown_origin);
    walk.all(character.guide);
    walk.all(character.positions);
    walk.all(character.velocities);
    walk.all(character.targets);
    walk.all(character.body);
    walk.all(character.shown);
    walk.all(Array<int32_t>{character.searched.faces, rows});
    walk.all(Array<float>{character.searched.clear, rows});
    walk.over(character.memory.frame, memory_size(character.outfit.clearing));
    if (character.wrinkled.size) {
        walk.over(character.folds.frames, memory_size(character.outfit.wrinkles));
        walk.all(character.wrinkled);
    }
    walk.all(character.contact.points.items);
    walk.all(character.contact.edges.items);
}

size_t pairs_size(const Header &header) {
    return sizeof(PointPair) * (size_t)header.point_pairs + sizeof(EdgePair) * (size_t)header.edge_pairs;
}

// Reads bytes of the size that their header asks for.
void copy_in(Character &character, const Header &header, const uint8_t *bytes) {
    character.contact.points.clear();
    character.contact.edges.clear();
    for (int k = 0; k < header.point_pairs; k++) character.contact.points.add({});
    for (int k = 0; k < header.edge_pairs; k++) character.contact.edges.add({});
    StateStream walk{StateStream::RESTORE, const_cast<uint8_t *>(bytes)};
    walk_over(character, walk);
}

// Most steps that cloth remembers: half of those that can be counted, so that more of them can follow.
constexpr int MOST_STEPS = 1 << 30;

bool is_finite(Vec64 a) { return uvc::is_finite(a.x) && uvc::is_finite(a.y) && uvc::is_finite(a.z); }

bool are_finite(Array<Vec> vectors) {
    bool all = true;
    for (Vec a : vectors) all = all && is_finite(wide(a));
    return all;
}

bool are_indices(const int32_t *numbers, int count, int low, int high) {
    bool all = true;
    for (int k = 0; k < count; k++) all = all && numbers[k] >= low && numbers[k] < high;
    return all;
}

// Whether pairs are of two things that there are so many of.
template <class Pair> bool are_pairs(Array<Pair> pairs, int firsts, int seconds) {
    bool all = true;
    for (const Pair &pair : pairs)
        all = all && are_indices(&pair.indices.first, 1, 0, firsts) &&
              are_indices(&pair.indices.second, 1, 0, seconds);
    return all;
}

// Whether a character can go on from what was read: bytes of its size may be those of anything.
bool is_whole(const Character &c) {
    const Outfit &outfit = c.outfit;
    const ContactMesh &mesh = outfit.solver.mesh;
    const Collider &collider = outfit.solver.collider, &cleared = outfit.clearing.collider;
    bool all = c.steps >= 0 && c.steps <= MOST_STEPS && c.solved >= 0 && c.solved <= MOST_STEPS;
    all = all && *c.memory.frame >= 0 && *c.memory.frame <= MOST_STEPS;
    all = all && is_finite({c.place.cosine, c.place.sine, c.rate}) && is_finite(c.place.origin);
    all = all && is_finite(c.origin) && is_finite(c.drift) && is_finite(c.shown_origin);
    all = all && is_finite(c.root.shift) && uvc::is_finite(c.spin);
    for (const auto &row : c.root.turn.at) all = all && is_finite(Vec64{row[0], row[1], row[2]});
    all = all && could_be_set(c);
    for (Vec64 point : c.guide) all = all && is_finite(point);
    all = all && are_finite(c.positions) && are_finite(c.velocities) && are_finite(c.targets);
    all = all && are_finite(c.body) && are_finite(c.shown);
    all = all && are_finite(c.wrinkled) && is_whole(outfit.wrinkles, c.folds);
    all = all && are_finite({c.memory.cloth, c.shown.size}) && are_finite({c.memory.body, c.body.size});
    int rows = collider.parts * c.positions.size, cleared_rows = cleared.parts * c.shown.size;
    all = all && are_indices(c.searched.faces, rows, -1, collider.surface.faces.size);
    all = all && are_indices(c.memory.searched.faces, cleared_rows, -1, cleared.surface.faces.size);
    return all && are_pairs(c.contact.points.items, c.positions.size, mesh.surface.faces.size) &&
           are_pairs(c.contact.edges.items, mesh.edges.size, mesh.edges.size);
}

// Counting and saving change nothing.
Character &changeable(const Character &character) { return const_cast<Character &>(character); }

}  // namespace

size_t saved_size(const Character &character) {
    StateStream walk{StateStream::COUNT, nullptr};
    walk_over(changeable(character), walk);
    return walk.size;
}

void save(const Character &character, uint8_t *bytes) {
    StateStream walk{StateStream::SAVE, bytes};
    walk_over(changeable(character), walk);
}

bool restore(Character &character, const uint8_t *bytes, size_t size) {
    Header header, own = header_of(character);
    if (size < sizeof(header)) return false;
    memcpy(&header, bytes, sizeof(header));
    if (header.cages != own.cages || header.points != own.points || header.collider != own.collider ||
        header.point_pairs < 0 || header.edge_pairs < 0)
        return false;
    size_t expected = saved_size(character) - pairs_size(own) + pairs_size(header);
    if (size != expected) return false;
    Arena work;
    Array<uint8_t> before = work.take<uint8_t>((int)saved_size(character));
    Array<Fabric> fabrics = work.copy(character.fabrics);
    save(character, before.data);
    copy_in(character, header, bytes);
    if (is_whole(character)) {
        if (memcmp(fabrics.data, character.fabrics.data, sizeof(Fabric) * (size_t)fabrics.size))
            renew_material(character);
        return true;
    }
    copy_in(character, own, before.data);
    return false;
}

}  // namespace uvc
