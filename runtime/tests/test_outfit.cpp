// Damaged outfits, states and joints: each is refused with a sentence, or dresses its body for some frames.
//
// Usage: test_outfit OUTFIT MOTION [MUTANTS [FIRST]], with the files of `python -m tests.player.small_outfit`.
#include <sanitizer/common_interface_defs.h>
#include <signal.h>
#include <stdio.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include "list.h"
#include "sections.h"
#include "uvcloth.h"
#include "uvcloth_codec.h"

using namespace uvc;

namespace {

constexpr int MUTANTS = 10000;
constexpr uint32_t HEADER = 24, ENTRY = 56;

// Seconds of processor time in which a mutant has to be refused or played: the sanitizers make all of it ten
// times slower. Substeps a second of more of which none is played: so many take their time without a fault.
constexpr int LONGEST = 60;
constexpr float MOST_SUBSTEPS = 4000;

// One of so many mutants comes to rest by itself, for 65 frames; others go on from where the whole one rests.
constexpr uint32_t STARTED = 8;

constexpr double FRAME = 1.0 / 30;

// Numbers that look random, the same in every run (xorshift).
struct Random {
    uint32_t state;
    uint32_t below(uint32_t limit) {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        return state % limit;
    }
};

// Bytes of exactly their own memory, so that a byte read behind them is noticed.
struct Bytes {
    uint8_t *data;
    uint32_t size;

    Bytes(const uint8_t *from, uint32_t count)
        : data(static_cast<uint8_t *>(malloc(count ? count : 1))), size(count) {
        memcpy(data, from, count);
    }
    Bytes(const Bytes &) = delete;
    ~Bytes() { free(data); }

    uint32_t get(uint32_t place) const {
        uint32_t value;
        memcpy(&value, data + place, 4);
        return value;
    }
    void put(uint32_t place, uint32_t value) { memcpy(data + place, &value, 4); }

    // Writes size and checksum as they should be.
    void sign() {
        if (size < HEADER) return;
        put(16, size);
        uint32_t a = 1, b = 0;
        for (uint32_t k = 16; k < size; k++) {
            a = (a + data[k]) % 65521;
            b = (b + a) % 65521;
        }
        put(12, b << 16 | a);
    }
};

// A section taken out of its file: its entry, its code, and the numbers, once somebody asks for them.
struct Section {
    char name[32];
    uint32_t kind, rows, columns, offset, length;
    float step;
    const uint8_t *code;
    int32_t *numbers;

    uint32_t count() const { return rows * columns; }
};

int current = 0;

void say_current() { fprintf(stderr, "mutant %d\n", current); }

void too_long(int) {
    fprintf(stderr, "mutant %d takes more than %d s\n", current, LONGEST);
    _exit(1);
}

void fail(const char *what) {
    printf("mutant %d: %s\n", current, what);
    exit(1);
}

double processor_seconds() { return (double)clock() / CLOCKS_PER_SEC; }

// A number in the place of another one: an edge of its type, a neighbour, one from elsewhere, or larger.
uint32_t other(uint32_t value, const uint32_t *all, uint32_t count, Random &random) {
    constexpr uint32_t EDGES[] = {0,           1,           2,           64,          1u << 24,    0x7fffffffu,
                                  0x80000000u, 0xffffffffu, 0x7fc00000u, 0x7f800000u, 0x7f7fffffu, 0x3f800000u,
                                  0xbf800000u, 0x5f000000u, 0xdf000000u, 0x00000001u, 0x3a83126fu};
    float number;
    switch (random.below(5)) {
        case 0:
            return EDGES[random.below(sizeof(EDGES) / sizeof(EDGES[0]))];
        case 1:
            return value + random.below(5) - 2;
        case 2:
            return count ? all[random.below(count)] : value;
        case 3:
            memcpy(&number, &value, 4);
            number *= random.below(2) ? 1000.0f : -1.0f;
            memcpy(&value, &number, 4);
            return value;
        default:
            return value ^ 1u << random.below(32);
    }
}

// Changes bytes of a packed file, or cuts it.
void change_bytes(Bytes &bytes, Random &random) {
    if (random.below(4) == 0) bytes.size = random.below(bytes.size);
    for (uint32_t k = random.below(4); k < 4 && bytes.size >= 4; k++) {
        // Half of the changes are where entries are, not code.
        uint32_t reach = random.below(2) ? bytes.size : least((int)(HEADER + 80 * ENTRY), (int)bytes.size);
        if (random.below(2)) {
            bytes.data[random.below(reach)] ^= (uint8_t)(1u << random.below(8));
        } else {
            uint32_t place = random.below(reach / 4) * 4;
            bytes.put(place, other(bytes.get(place), nullptr, 0, random));
        }
    }
    if (random.below(8)) bytes.sign();
}

// A file taken apart.
struct Parts {
    Arena arena;
    List<Section> sections;

    explicit Parts(const Bytes &bytes) {
        for (uint32_t k = 0; k < bytes.get(20); k++) {
            Section section{};
            memcpy(&section, bytes.data + HEADER + ENTRY * k, ENTRY);
            section.code = bytes.data + section.offset;
            sections.add(section);
        }
    }

    Section &any(Random &random) { return sections.items[(int)random.below((uint32_t)sections.items.size)]; }

    // Numbers of a section, to be changed.
    int32_t *numbers(Section &section) {
        if (section.numbers) return section.numbers;
        section.numbers = arena.take<int32_t>((int)section.count()).data;
        uvc_decode_section(section.code, section.length, section.numbers, (int)section.rows,
                           (int)section.columns);
        return section.numbers;
    }

    // Encodes what was changed and puts all together.
    Bytes *packed() {
        uint32_t begin = HEADER + ENTRY * (uint32_t)sections.items.size, size = begin;
        for (Section &section : sections.items) {
            if (section.numbers) {
                uint32_t room = 32 * (section.count() + 1);
                Array<uint8_t> code = arena.take<uint8_t>((int)room);
                section.length = (uint32_t)uvc_encode_section(section.numbers, (int)section.rows,
                                                              (int)section.columns, code.data, room);
                section.code = code.data;
            }
            section.offset = size;
            size += section.length;
        }
        Array<uint8_t> whole = arena.take<uint8_t>((int)size);
        Bytes *bytes = new (malloc(sizeof(Bytes))) Bytes(whole.data, size);
        const uint32_t header[] = {0x4c435655u, 0x0048544fu, 2, 0, 0, (uint32_t)sections.items.size};
        memcpy(bytes->data, header, sizeof(header));
        for (int k = 0; k < sections.items.size; k++) {
            const Section &section = sections.items[k];
            memcpy(bytes->data + HEADER + ENTRY * (uint32_t)k, &section, ENTRY);
            memcpy(bytes->data + section.offset, section.code, section.length);
        }
        bytes->sign();
        return bytes;
    }
};

// Changes some numbers of a section.
void change_numbers(Parts &parts, Section &section, Random &random) {
    if (!section.count()) return;
    uint32_t *numbers = reinterpret_cast<uint32_t *>(parts.numbers(section)), count = section.count();
    for (uint32_t k = random.below(4); k < 4; k++) {
        uint32_t place = random.below(count);
        numbers[place] = other(numbers[place], numbers, count, random);
    }
}

// Gives all numbers of a section one value, exchanges them, or makes them larger.
void change_all(Parts &parts, Section &section, Random &random) {
    if (!section.count()) return;
    uint32_t *numbers = reinterpret_cast<uint32_t *>(parts.numbers(section)), count = section.count();
    uint32_t kind = random.below(4), one = other(numbers[random.below(count)], numbers, count, random);
    for (uint32_t k = 0; k < count; k++) {
        float number;
        memcpy(&number, numbers + k, 4);
        number *= kind == 0 ? 1e4f : 1e-4f;
        if (kind < 2) memcpy(numbers + k, &number, 4);
        if (kind == 2) numbers[k] = one;
        if (kind == 3) {
            uint32_t kept = numbers[k], place = random.below(count);
            numbers[k] = numbers[place];
            numbers[place] = kept;
        }
    }
}

// Gives a section more rows, which begin again with the first ones or are zeros, or fewer.
void change_rows(Parts &parts, Section &section, Random &random) {
    constexpr uint32_t MOST = 1 << 16;
    const int32_t *before = parts.numbers(section);
    uint32_t count = section.count(), rows = section.rows;
    switch (random.below(4)) {
        case 0:
            section.rows = random.below(rows + 1);
            break;
        case 1:
            section.rows = rows + 1;
            break;
        case 2:
            section.rows = 2 * rows;
            break;
        default:
            section.rows = random.below(8) ? rows + 50 : MOST / section.columns;
    }
    bool repeats = random.below(2) && count;
    int32_t *after = parts.arena.take<int32_t>((int)section.count()).data;
    for (uint32_t k = 0; k < section.count(); k++)
        after[k] = k < count ? before[k] : repeats ? before[k % count] : 0;
    section.numbers = after;
}

// Changes one section as a whole, or the list of sections.
void change_section(Parts &parts, Random &random) {
    Section &section = parts.any(random), &second = parts.any(random);
    switch (random.below(16)) {
        case 0:
            section.kind = random.below(4);
            break;
        case 1:
            section.step = random.below(2) ? 1e30f : 0.0f;
            break;
        case 2: {
            Section kept = section;
            memcpy(kept.name, second.name, sizeof(kept.name));
            memcpy(second.name, section.name, sizeof(kept.name));
            section = kept;
            break;
        }
        case 3:
            section = parts.sections.items[--parts.sections.items.size];
            break;
        case 4:
        case 5:
        case 6:
            change_rows(parts, section, random);
            break;
        case 7:
        case 8:
        case 9:
            change_all(parts, section, random);
            break;
        default:
            change_numbers(parts, section, random);
    }
}

double edge_of(Random &random) {
    const double INFINITE = __builtin_inf(), NONE = __builtin_nan("");
    const double EDGES[] = {NONE, INFINITE, -INFINITE, 1e300, 1e7, -9e6, 0, -1, 1e-300};
    return EDGES[random.below(sizeof(EDGES) / sizeof(EDGES[0]))];
}

// Joints (J, 3, 4) that no body has: not finite, huge, all alike, of no size, or shifted.
void change_joints(double *joints, uint32_t count, Random &random) {
    uint32_t numbers = 12 * count, kind = random.below(5);
    double edge = edge_of(random);
    for (uint32_t k = 0; k < numbers; k++) {
        if (kind == 0 && k % 12 == random.below(12)) joints[k] = edge;
        if (kind == 1) joints[k] = joints[k % 12];
        if (kind == 2) joints[k] = edge;
        if (kind == 3 && k % 4 < 3) joints[k] *= random.below(2) ? edge : 1;
        if (kind == 4 && k % 4 == 3) joints[k] += k < 12 || random.below(2) ? edge : 0;
    }
}

// Pulls the cages to where they are, or to places that are none, at any rate.
void pull_somewhere(const uvc_outfit *outfit, uvc_cloth *cloth, Random &random) {
    const double RATES[] = {0, 50, 1e9, -1, 1e300, __builtin_nan("")};
    Arena arena;
    Array<double> points = arena.take<double>(3 * uvc_cages(outfit));
    uvc_cage_vertices(cloth, points.data);
    double edge = edge_of(random);
    for (uint32_t k = random.below(4); k < 3; k++) points[(int)random.below((uint32_t)points.size)] = edge;
    uvc_pull(cloth, points.data, RATES[random.below(sizeof(RATES) / sizeof(RATES[0]))]);
}

double other_seconds(Random &random) {
    const double EDGES[] = {0, -1, 1, 1e-9, 1e-40, __builtin_nan(""), __builtin_inf(), 1e9, 0.5, FRAME};
    return EDGES[random.below(sizeof(EDGES) / sizeof(EDGES[0]))];
}

// Whether an outfit takes steps of a usual length.
bool is_quick(const Bytes &bytes) {
    Failure failure{nullptr, 0};
    Sections sections = read_sections(bytes.data, bytes.size, failure);
    return read_number(sections, "settings.needed", failure) <= MOST_SUBSTEPS;
}

// Copies of all that is shown.
Array<double> shown(const uvc_outfit *outfit, const uvc_cloth *cloth, Arena &arena) {
    int total = 0;
    for (int garment = 0; garment < uvc_garments(outfit); garment++)
        total += uvc_garment_vertices(outfit, garment);
    Array<double> vertices = arena.take<double>(3 * total);
    double *next = vertices.data;
    for (int garment = 0; garment < uvc_garments(outfit); garment++) {
        uvc_vertices(cloth, garment, next);
        next += 3 * uvc_garment_vertices(outfit, garment);
    }
    return vertices;
}

struct Motion {
    Array<double> joints;
    int frames;
};

// Starts or steps cloth. A failure has a sentence, and changes nothing that is shown. Returns whether there was
// none.
bool move_on(const uvc_outfit *outfit, uvc_cloth *cloth, const double *joints, double seconds, bool is_start) {
    Arena arena;
    char message[160] = "";
    Array<double> before = shown(outfit, cloth, arena);
    int good = is_start ? uvc_start(cloth, joints, message, sizeof(message))
                        : uvc_step(cloth, joints, seconds, message, sizeof(message));
    if (!good != (message[0] != 0)) fail("not a sentence for a failure, and only then");
    Array<double> after = shown(outfit, cloth, arena);
    if (!good && memcmp(before.data, after.data, sizeof(double) * (size_t)before.size))
        fail("what is shown changed by a failure");
    return good;
}

// Lets a character wear an outfit for some frames, from a state if that fits, by damaged joints, times and
// pulls if these are asked for. Returns whether all frames are dressed.
bool play(const uvc_outfit *outfit, const Motion &motion, Array<uint8_t> state, bool is_damaged,
          Random &random) {
    Arena arena;
    uint32_t joints = (uint32_t)uvc_joints(outfit);
    bool fits = 12 * (int)joints == motion.joints.size / motion.frames, good = true;
    Array<double> own = arena.take<double>((int)(12 * joints));
    uvc_cloth *cloth = uvc_new(outfit);
    bool goes_on = fits && random.below(STARTED) && uvc_restore(cloth, state.data, (size_t)state.size);
    for (int frame = goes_on; frame < 3 && good; frame++) {
        for (int k = 0; k < own.size; k++)
            own[k] = fits ? motion.joints[own.size * frame + k] : k % 12 % 5 == 0;
        if (is_damaged && random.below(4) == 0) pull_somewhere(outfit, cloth, random);
        double seconds = FRAME;
        if (is_damaged && frame) {
            if (random.below(4)) change_joints(own.data, joints, random);
            if (random.below(3) == 0) seconds = other_seconds(random);
        }
        bool is_dressed = move_on(outfit, cloth, own.data, seconds, frame == 0);
        good = is_damaged ? good : is_dressed;
    }
    uvc_drop(cloth);
    return good;
}

// Changes a state that was saved. Some keep their size.
void change_state(Bytes &state, Random &random) {
    uint32_t kind = random.below(10);
    if (kind == 0) state.size = random.below(state.size);
    for (uint32_t k = random.below(16); k < 16 && state.size >= 4; k++) {
        // A third of the changes are in the numbers at the beginning.
        uint32_t near = random.below(3) ? state.size : (uint32_t)least((int)state.size, 200);
        uint32_t place = random.below(near / 4) * 4;
        state.put(place, other(state.get(place), nullptr, 0, random));
    }
}

Array<uint8_t> read_file(const char *path, Arena &arena) {
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END)) return {};
    Array<uint8_t> bytes = arena.take<uint8_t>((int)ftell(file));
    rewind(file);
    if (fread(bytes.data, 1, (size_t)bytes.size, file) != (size_t)bytes.size) bytes.size = 0;
    fclose(file);
    return bytes;
}

// What became of some mutants.
struct Tally {
    int tried, accepted, played;
    double longest;
    int slowest;
};

struct Whole {
    Bytes bytes;
    Motion motion;
    Array<uint8_t> state;
};

void try_outfit(const Bytes &bytes, const Whole &whole, Tally &tally, Random &random) {
    char message[160] = "";
    uvc_outfit *outfit = uvc_read(bytes.data, bytes.size, message, sizeof(message));
    if (!outfit != (message[0] != 0)) fail("not a sentence for a refusal, and only then");
    if (!outfit) return;
    tally.accepted++;
    if (is_quick(bytes)) tally.played += play(outfit, whole.motion, whole.state, false, random);
    uvc_free(outfit);
}

void try_state(const uvc_outfit *outfit, const Whole &whole, Tally &tally, Random &random) {
    Bytes state(whole.state.data, (uint32_t)whole.state.size);
    change_state(state, random);
    Arena arena;
    uvc_cloth *cloth = uvc_new(outfit);
    uvc_restore(cloth, whole.state.data, (size_t)whole.state.size);
    Array<double> before = shown(outfit, cloth, arena);
    if (uvc_restore(cloth, state.data, state.size)) {
        tally.accepted++;
        const double *joints = whole.motion.joints.data + whole.motion.joints.size / whole.motion.frames;
        tally.played += move_on(outfit, cloth, joints, FRAME, false);
    } else {
        Array<double> after = shown(outfit, cloth, arena);
        if (memcmp(before.data, after.data, sizeof(double) * (size_t)before.size))
            fail("what is shown changed by a state that was refused");
        if (!move_on(outfit, cloth, whole.motion.joints.data, FRAME, false))
            fail("cloth does not go on after a state that was refused");
    }
    uvc_drop(cloth);
}

void try_mutant(int mutant, const uvc_outfit *outfit, const Whole &whole, Tally (&tallies)[4]) {
    Random random{0x9e3779b9u * (uint32_t)(mutant + 1) | 1u};
    for (int k = 0; k < 8; k++) random.below(2);
    uint32_t turn = random.below(10), kind = turn < 3 ? 0 : turn < 8 ? 1 : turn - 6;
    Tally &tally = tallies[kind];
    double before = processor_seconds();
    tally.tried++;
    if (kind == 0) {
        Bytes bytes(whole.bytes.data, whole.bytes.size);
        uint32_t size = bytes.size;
        change_bytes(bytes, random);
        Bytes exact(bytes.data, bytes.size);
        bytes.size = size;
        try_outfit(exact, whole, tally, random);
    } else if (kind == 1) {
        Parts parts(whole.bytes);
        for (uint32_t k = random.below(3); k < 3; k++) change_section(parts, random);
        Bytes *bytes = parts.packed();
        try_outfit(*bytes, whole, tally, random);
        drop(bytes);
    } else if (kind == 2) {
        try_state(outfit, whole, tally, random);
    } else {
        tally.accepted++;
        tally.played += play(outfit, whole.motion, whole.state, true, random);
    }
    double seconds = processor_seconds() - before;
    if (seconds > tally.longest) {
        tally.longest = seconds;
        tally.slowest = mutant;
    }
}

}  // namespace

extern "C" const char *__asan_default_options() { return "hard_rss_limit_mb=4000:detect_leaks=1"; }

int main(int count, char **arguments) {
    if (count < 3) return puts("usage: test_outfit OUTFIT MOTION [MUTANTS [FIRST]]"), 1;
    Arena arena;
    Array<uint8_t> content = read_file(arguments[1], arena), motion = read_file(arguments[2], arena);
    int mutants = count > 3 ? atoi(arguments[3]) : MUTANTS, first = count > 4 ? atoi(arguments[4]) : 0;
    char message[160] = "";
    uvc_outfit *outfit = uvc_read(content.data, (size_t)content.size, message, sizeof(message));
    if (!outfit) return puts(message), 1;
    Array<double> joints{reinterpret_cast<double *>(motion.data), motion.size / 8};
    Whole whole{{content.data, (uint32_t)content.size}, {joints, joints.size / 12 / uvc_joints(outfit)}, {}};
    uvc_cloth *cloth = uvc_new(outfit);
    for (int frame = 0; frame <= whole.motion.frames; frame++) {
        const double *now = joints.data + joints.size / whole.motion.frames * most(frame - 1, 0);
        if (!move_on(outfit, cloth, now, FRAME, frame == 0)) fail("the whole outfit is not dressed");
        if (frame > 1) continue;
        whole.state = arena.take<uint8_t>((int)uvc_saved_size(cloth));
        uvc_save(cloth, whole.state.data);
    }
    uvc_drop(cloth);
    signal(SIGVTALRM, too_long);
    __sanitizer_set_death_callback(say_current);
    Tally tallies[4] = {};
    for (current = first; current < first + mutants; current++) {
        itimerval limit{{0, 0}, {LONGEST, 0}};
        setitimer(ITIMER_VIRTUAL, &limit, nullptr);
        try_mutant(current, outfit, whole, tallies);
    }
    const char *KINDS[] = {"packed bytes", "sections", "saved states", "joints"};
    for (int kind = 0; kind < 4; kind++) {
        const Tally &tally = tallies[kind];
        printf("%d mutants of %s, %d accepted, %d played; the slowest, %d, took %d ms\n", tally.tried,
               KINDS[kind], tally.accepted, tally.played, tally.slowest, (int)(1000 * tally.longest));
    }
    uvc_free(outfit);
    return 0;
}
