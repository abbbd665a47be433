// All that a character's cloth remembers, as bytes.
#include "character.h"

namespace uvc {

namespace {

// Walks over bytes: counts them, or copies them out of or into what they belong to.
struct Walk {
    enum Mode { COUNT, SAVE, RESTORE } mode;
    uint8_t *bytes;
    size_t size = 0;

    void over(void *place, size_t count) {
        if (mode == SAVE) memcpy(bytes + size, place, count);
        if (mode == RESTORE) memcpy(place, bytes + size, count);
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

void walk_over(Character &character, Walk &walk) {
    Header header = header_of(character);
    int rows = character.outfit.solver.collider.parts * header.cages;
    walk.one(header);
    walk.one(character.is_started);
    walk.one(character.place);
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
    walk.all(character.contact.points.items);
    walk.all(character.contact.edges.items);
}

// Counting and saving change nothing.
Character &changeable(const Character &character) { return const_cast<Character &>(character); }

}  // namespace

size_t saved_size(const Character &character) {
    Walk walk{Walk::COUNT, nullptr};
    walk_over(changeable(character), walk);
    return walk.size;
}

void save(const Character &character, uint8_t *bytes) {
    Walk walk{Walk::SAVE, bytes};
    walk_over(changeable(character), walk);
}

bool restore(Character &character, const uint8_t *bytes, size_t size) {
    Header header, own = header_of(character);
    if (size < sizeof(header)) return false;
    memcpy(&header, bytes, sizeof(header));
    if (header.cages != own.cages || header.points != own.points || header.collider != own.collider ||
        header.point_pairs < 0 || header.edge_pairs < 0)
        return false;
    size_t pairs = sizeof(PointPair) * (size_t)header.point_pairs + sizeof(EdgePair) * (size_t)header.edge_pairs;
    character.contact.points.clear();
    character.contact.edges.clear();
    if (size != saved_size(character) + pairs) return false;
    for (int k = 0; k < header.point_pairs; k++) character.contact.points.add({});
    for (int k = 0; k < header.edge_pairs; k++) character.contact.edges.add({});
    Walk walk{Walk::RESTORE, const_cast<uint8_t *>(bytes)};
    walk_over(character, walk);
    renew_material(character);
    return true;
}

}  // namespace uvc
