// Damaged outfits: whatever the bytes are, reading ends with arrays inside of them or with a sentence.
#include <stdio.h>

#include "sections.h"
#include "uvcloth_codec.h"

using namespace uvc;

namespace {

constexpr int MUTANTS = 10000;
constexpr size_t HEADER = 24, ENTRY = 56, SECTIONS = 4, DATA = HEADER + SECTIONS * ENTRY, ROOM = 1000;

// Numbers that look random, the same in every run (xorshift).
struct Random {
    uint32_t state = 1;
    uint32_t below(uint32_t limit) {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        return state % limit;
    }
};

// An outfit of exactly its own memory, so that a byte read behind it is noticed.
struct Outfit {
    uint8_t *bytes = static_cast<uint8_t *>(calloc(1, ROOM));
    size_t size = DATA;

    Outfit() {
        memcpy(bytes, "UVCLOTH", 8);
        put(8, 2);
        put(20, SECTIONS);
        const float points[] = {1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f}, gap = 0.002f;
        const int32_t starts[] = {0, 1, 1, 2}, steps[] = {3, -5};
        int32_t bits[6], gap_bits;
        memcpy(bits, points, sizeof(bits));
        memcpy(&gap_bits, &gap, sizeof(gap_bits));
        entry(0, "points", 0, bits, 2, 3);
        entry(1, "starts", 1, starts, 4, 1);
        entry(2, "gap", 0, &gap_bits, 1, 1);
        entry(3, "rounded", 2, steps, 2, 1);
        cut(size);
        sign();
    }
    Outfit(const Outfit &) = delete;
    ~Outfit() { free(bytes); }

    void put(size_t place, uint32_t value) { memcpy(bytes + place, &value, 4); }

    // Adds a section behind those before it, every other one with its numbers as they are.
    void entry(size_t k, const char *name, uint32_t kind, const int32_t *numbers, int rows, int columns) {
        size_t place = HEADER + k * ENTRY;
        constexpr uint8_t STORED = 4;
        uint32_t length = 1 + 4 * (uint32_t)(rows * columns);
        if (k % 2) {
            bytes[size] = STORED;
            memcpy(bytes + size + 1, numbers, length - 1);
        } else {
            length = (uint32_t)uvc_encode_section(numbers, rows, columns, bytes + size, (int64_t)(ROOM - size));
        }
        const float step = 0.25f;
        memcpy(bytes + place, name, strlen(name));
        put(place + 32, kind);
        put(place + 36, (uint32_t)rows);
        put(place + 40, (uint32_t)columns);
        put(place + 44, (uint32_t)size);
        put(place + 48, length);
        memcpy(bytes + place + 52, &step, sizeof(step));
        size += length;
    }

    // Writes size and checksum as they should be.
    void sign() {
        if (size < HEADER) return;
        put(16, (uint32_t)size);
        uint32_t a = 1, b = 0;
        for (size_t k = 16; k < size; k++) {
            a = (a + bytes[k]) % 65521;
            b = (b + a) % 65521;
        }
        put(12, b << 16 | a);
    }

    void cut(size_t shorter) {
        uint8_t *rest = static_cast<uint8_t *>(malloc(shorter ? shorter : 1));
        memcpy(rest, bytes, shorter);
        free(bytes);
        bytes = rest;
        size = shorter;
    }
};

// Reads all sections; true if they are good. A failure has a sentence.
bool read(const Outfit &outfit) {
    char message[80] = "";
    Failure failure{message, sizeof(message)};
    Sections sections = read_sections(outfit.bytes, outfit.size, failure);
    Arena arena;
    float sum = 0.0f;
    for (float value : read_floats(sections, "points", -1, 3, arena, failure)) sum += value;
    for (int32_t start : read_starts(sections, "starts", 3, 2, arena, failure)) sum += (float)start;
    for (int32_t k : read_indices(sections, "starts", -1, 1, 0, 3, arena, failure)) sum += (float)k;
    sum += read_number(sections, "gap", failure);
    for (float value : read_floats(sections, "rounded", 2, 1, arena, failure)) sum += value;
    if (failure.failed != (message[0] != 0)) {
        puts("a failure without a sentence, or a sentence without a failure");
        exit(1);
    }
    return !failure.failed && is_finite(sum);
}

// Changes some bytes or numbers of an outfit, or cuts it.
void mutate(Outfit &outfit, Random &random) {
    constexpr uint32_t EDGES[] = {0, 1, 2, 0x7fffffffu, 0x80000000u, 0xffffffffu, 0x7fc00000u, 1u << 24};
    for (uint32_t k = random.below(3); k < 3; k++) {
        if (random.below(2))
            outfit.bytes[random.below((uint32_t)outfit.size)] ^= (uint8_t)(1 + random.below(255));
        else
            outfit.put(4 * random.below((uint32_t)outfit.size / 4), EDGES[random.below(8)]);
    }
    if (random.below(5) == 0) outfit.cut(random.below((uint32_t)outfit.size));
}

}  // namespace

int main() {
    if (!read(Outfit())) return puts("the outfit itself is refused"), 1;
    Random random;
    int good = 0;
    for (int k = 0; k < MUTANTS; k++) {
        Outfit outfit;
        mutate(outfit, random);
        // Most mutants get a right checksum: without, nothing behind it would be tried.
        if (random.below(10)) outfit.sign();
        good += read(outfit);
    }
    printf("%d mutants, %d of them good\n", MUTANTS, good);
    return 0;
}
