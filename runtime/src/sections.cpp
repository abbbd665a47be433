#include "sections.h"

#include "section_coder.h"

namespace uvc {

namespace {

constexpr char MAGIC[8] = {'U', 'V', 'C', 'L', 'O', 'T', 'H', 0};
constexpr uint32_t VERSION = 2;
constexpr int NAME = 32;
constexpr int MOST_ROWS = 1 << 24;

// Most numbers of all sections: those that repeat take nearly no bytes, but time and memory.
constexpr uint64_t MOST_NUMBERS = 1 << 26;

// Most of the sum, over all vertices, of the squared number of faces around each: usually 36 a vertex.
constexpr int64_t MOST_CROWDED = 1 << 30;

// What the coded whole numbers are: the bits of floats, themselves, or steps of a float.
enum Kind : uint32_t { FLOATS = 0, INTEGERS = 1, STEPS = 2 };

// All numbers are little-endian, as are all machines that this runs on.
struct Header {
    char magic[8];
    uint32_t version, checksum, size, count;
};

struct Entry {
    char name[NAME];
    uint32_t kind, rows, columns, offset, size;
    float step;
};

// Checksum by Adler (RFC 1950), over all bytes after the header's checksum.
uint32_t adler(const uint8_t *bytes, size_t size) {
    uint32_t a = 1, b = 0;
    while (size) {
        size_t run = size < 5552 ? size : 5552;
        size -= run;
        for (size_t k = 0; k < run; k++) {
            a += *bytes++;
            b += a;
        }
        a %= 65521;
        b %= 65521;
    }
    return b << 16 | a;
}

Entry entry_at(const Sections &sections, uint32_t k) {
    Entry entry;
    memcpy(&entry, sections.bytes + sizeof(Header) + sizeof(Entry) * k, sizeof(Entry));
    return entry;
}

bool find(const Sections &sections, const char *name, Entry &found) {
    for (uint32_t k = 0; k < sections.count; k++) {
        found = entry_at(sections, k);
        if (strncmp(found.name, name, NAME) == 0) return true;
    }
    return false;
}

const Derived *find_derived(const Sections &sections, const char *name) {
    for (int k = 0; k < sections.derived_count; k++)
        if (strcmp(sections.derived[k].name, name) == 0) return &sections.derived[k];
    return nullptr;
}

bool check_shape(const char *name, bool is_float, int has_rows, int has_columns, bool is_wanted_float, int rows,
                 int columns, Failure &failure) {
    if (is_float != is_wanted_float || has_columns != columns)
        failure.say("section %s of the outfit has not %d columns of its type", name, columns);
    else if (rows >= 0 && has_rows != rows)
        failure.say("section %s of the outfit has %d rows, %d were expected", name, has_rows, rows);
    return !failure.failed;
}

// Numbers of a section: whole ones, or the bits of floats.
Array<int32_t> read(const Sections &sections, const char *name, bool is_float, int rows, int columns,
                    Arena &arena, Failure &failure) {
    if (failure.failed) return {};
    if (const Derived *derived = find_derived(sections, name)) {
        if (!check_shape(name, derived->is_float, derived->rows, derived->columns, is_float, rows, columns,
                         failure))
            return {};
        return arena.copy(static_cast<const int32_t *>(derived->numbers), derived->rows * columns);
    }
    Entry entry;
    if (!find(sections, name, entry)) {
        failure.say("the outfit has no section %s", name);
        return {};
    }
    if (!check_shape(name, entry.kind != INTEGERS, (int)entry.rows, (int)entry.columns, is_float, rows,
                     columns, failure))
        return {};
    Array<int32_t> numbers = arena.take<int32_t>((int)(entry.rows * entry.columns));
    if (!decode_section(sections.bytes + entry.offset, entry.size, columns, numbers)) {
        failure.say("section %s of the outfit is cut", name);
        return {};
    }
    if (entry.kind != STEPS) return numbers;
    for (int32_t &number : numbers) {
        float value = entry.step * (float)number;
        memcpy(&number, &value, sizeof(value));
    }
    return numbers;
}

void add_derived(Sections &sections, Derived derived) {
    if (sections.derived_count == MOST_DERIVED) __builtin_trap();
    sections.derived[sections.derived_count++] = derived;
}

}  // namespace

void Failure::say(const char *format, ...) {
    if (failed) return;
    failed = true;
    if (!message || room == 0) return;
    size_t end = 0;
    auto put = [&](char c) {
        if (end + 1 < room) message[end++] = c;
    };
    va_list arguments;
    va_start(arguments, format);
    for (const char *c = format; *c; c++) {
        if (*c != '%') {
            put(*c);
        } else if (*++c == 's') {
            for (const char *text = va_arg(arguments, const char *); *text; text++) put(*text);
        } else {
            int value = va_arg(arguments, int);
            unsigned rest = value < 0 ? 0u - (unsigned)value : (unsigned)value;
            char digits[12];
            int count = 0;
            do {
                digits[count++] = (char)('0' + rest % 10);
                rest /= 10;
            } while (rest);
            if (value < 0) put('-');
            while (count) put(digits[--count]);
        }
    }
    va_end(arguments);
    message[end] = 0;
}

Sections read_sections(const void *data, size_t size, Failure &failure) {
    const uint8_t *bytes = static_cast<const uint8_t *>(data);
    Header header;
    if (!bytes || size < sizeof(Header)) {
        failure.say("the outfit is cut: it has fewer bytes than a header");
        return {};
    }
    memcpy(&header, bytes, sizeof(Header));
    if (memcmp(header.magic, MAGIC, sizeof(MAGIC)) != 0) {
        failure.say("these bytes are no baked outfit");
        return {};
    }
    if (header.version != VERSION) {
        failure.say("the outfit is of version %d, this runtime reads version %d: bake it again",
                    (int)header.version, (int)VERSION);
        return {};
    }
    constexpr size_t CHECKED = sizeof(header.magic) + 2 * sizeof(uint32_t);
    if (header.size != size || adler(bytes + CHECKED, size - CHECKED) != header.checksum) {
        failure.say("the outfit is cut or damaged");
        return {};
    }
    Sections sections{bytes, size, header.count, {}, 0};
    if (header.count > (size - sizeof(Header)) / sizeof(Entry)) {
        failure.say("the outfit has more sections than bytes");
        return {};
    }
    uint64_t total = 0;
    for (uint32_t k = 0; k < header.count; k++) {
        Entry entry = entry_at(sections, k);
        uint64_t numbers = (uint64_t)entry.rows * entry.columns;
        if (entry.name[NAME - 1] != 0 || entry.kind > STEPS || entry.rows > MOST_ROWS ||
            numbers > MOST_ROWS || entry.offset > size || entry.size > size - entry.offset) {
            failure.say("section %d of the outfit lies outside of it", (int)k);
            return {};
        }
        total += numbers;
        if (total > MOST_NUMBERS) {
            failure.say("the outfit has more than %d numbers", (int)MOST_NUMBERS);
            return {};
        }
    }
    return sections;
}

void derive(Sections &sections, const char *name, Array<float> numbers, int columns) {
    add_derived(sections, {name, true, numbers.size / columns, columns, numbers.data});
}

void derive(Sections &sections, const char *name, Array<int32_t> numbers, int columns) {
    add_derived(sections, {name, false, numbers.size / columns, columns, numbers.data});
}

bool has_section(const Sections &sections, const char *name) {
    Entry entry;
    return find(sections, name, entry);
}

Array<float> read_floats(const Sections &sections, const char *name, int rows, int columns, Arena &arena,
                         Failure &failure) {
    Array<int32_t> bits = read(sections, name, true, rows, columns, arena, failure);
    Array<float> values{reinterpret_cast<float *>(bits.data), bits.size};
    for (float value : values)
        if (!is_finite(value)) {
            failure.say("section %s of the outfit has a number that is not finite", name);
            return {};
        }
    return values;
}

Array<int32_t> read_integers(const Sections &sections, const char *name, int rows, int columns, Arena &arena,
                             Failure &failure) {
    return read(sections, name, false, rows, columns, arena, failure);
}

Array<int32_t> read_indices(const Sections &sections, const char *name, int rows, int columns, int low,
                            int high, Arena &arena, Failure &failure) {
    Array<int32_t> values = read_integers(sections, name, rows, columns, arena, failure);
    for (int32_t value : values)
        if (value < low || value >= high) {
            failure.say("section %s of the outfit has the index %d, from %d to %d were expected", name,
                        (int)value, low, high - 1);
            return {};
        }
    return values;
}

Array<int32_t> read_faces(const Sections &sections, const char *name, int vertices, Arena &arena,
                          Failure &failure) {
    Array<int32_t> corners = read_indices(sections, name, -1, 3, 0, vertices, arena, failure);
    Arena work;
    Array<int32_t> around = work.take<int32_t>(vertices);
    for (int32_t corner : corners) around[corner]++;
    int64_t crowded = 0;
    for (int64_t count : around) crowded += count * count;
    if (crowded <= MOST_CROWDED) return corners;
    failure.say("section %s of the outfit has too many faces around a vertex", name);
    return {};
}

Array<int32_t> read_starts(const Sections &sections, const char *name, int count, int total, Arena &arena,
                           Failure &failure) {
    Array<int32_t> starts = read_integers(sections, name, count + 1, 1, arena, failure);
    int before = 0;
    for (int32_t start : starts) {
        if (start < before || start > total) {
            failure.say("section %s of the outfit is not in order", name);
            return {};
        }
        before = start;
    }
    if (starts.size && (starts[0] != 0 || starts[count] != total)) {
        failure.say("section %s of the outfit does not end at %d", name, total);
        return {};
    }
    return starts;
}

float read_number(const Sections &sections, const char *name, Failure &failure) {
    Arena arena;
    Array<float> values = read_floats(sections, name, 1, 1, arena, failure);
    return values.size ? values[0] : 0.0f;
}

}  // namespace uvc
