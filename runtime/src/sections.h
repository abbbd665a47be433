// A baked outfit as bytes: named arrays one after another, which are checked before anything reads them.
#pragma once

#include <stdarg.h>

#include "memory.h"

namespace uvc {

// What went wrong, as one sentence in a buffer that the caller brought.
struct Failure {
    char *message;
    size_t room;
    bool failed = false;

    // Notes the first failure. The format knows %s and %d.
    void say(const char *format, ...);
};

// A section that a file does not have because it follows from others.
struct Derived {
    const char *name;
    bool is_float;
    int rows, columns;
    const void *numbers;
};

constexpr int MOST_DERIVED = 32;

// Sections of a file, as `uvcloth.player.sections` writes them, and what was derived from them.
struct Sections {
    const uint8_t *bytes;
    size_t size;
    uint32_t count;
    Derived derived[MOST_DERIVED];
    int derived_count;
};

// Checks header, checksum and the places of all sections.
Sections read_sections(const void *bytes, size_t size, Failure &failure);

// Adds a section of rows of `columns` numbers, which stay where they are while sections are read.
void derive(Sections &sections, const char *name, Array<float> numbers, int columns);
void derive(Sections &sections, const char *name, Array<int32_t> numbers, int columns);

// Whether there is a section of a name.
bool has_section(const Sections &sections, const char *name);

// Copies a section, of `columns` numbers a row, into an arena. Floats have to be finite. A section that is
// absent, of another type, or not of `rows` rows (if that is not -1) is a failure, and an empty array.
Array<float> read_floats(const Sections &, const char *name, int rows, int columns, Arena &, Failure &);
Array<int32_t> read_integers(const Sections &, const char *name, int rows, int columns, Arena &, Failure &);

// The same for indices, each of which has to be from `low` up to, not including, `high`.
Array<int32_t> read_indices(const Sections &, const char *name, int rows, int columns, int low, int high,
                            Arena &, Failure &);

// The same for the corners of faces, three in a row, which may have no crowd of faces around a vertex: to find
// neighbours there would take for ever.
Array<int32_t> read_faces(const Sections &, const char *name, int vertices, Arena &, Failure &);

// Rows of a jagged array: `count` + 1 starts that never fall, from 0 to `total`.
Array<int32_t> read_starts(const Sections &, const char *name, int count, int total, Arena &, Failure &);

// One number of a section of one row.
float read_number(const Sections &, const char *name, Failure &);

// Makes an object of packed sections, by read(sections, object, failure); null, with a sentence, if they are
// damaged or do not fit together. `drop` gives it back.
template <class T, class Read>
T *read_object(const void *bytes, size_t size, char *message, size_t room, Read read) {
    Failure failure{message, room};
    T *object = make<T>();
    Sections sections = read_sections(bytes, size, failure);
    if (!failure.failed) read(sections, *object, failure);
    if (!failure.failed) return object;
    drop(object);
    return nullptr;
}

}  // namespace uvc
