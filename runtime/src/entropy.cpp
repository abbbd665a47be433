// An adaptive arithmetic coder of whole numbers that are mostly small.
//
// Each number is coded as decisions: how many binary digits it has, one decision for each, then the digits and
// the sign. Several models predict each decision from the sizes of numbers coded before, nearby in the array.
// Their predictions are mixed in the logistic domain by weights that adapt too (context mixing: Mahoney,
// "Adaptive weighing of context models for lossless data compression", 2005). All arithmetic is in whole
// numbers, so that every machine reads what another one wrote. Nothing here may change the code: files keep it.
#include <stdlib.h>

#include "uvcloth_codec.h"

namespace {

constexpr int MOST_DIGITS = 24;
constexpr int AXES = 3;
constexpr int MODELS = 7;

// Contexts of a model; the largest uses 8 x 18 x 18 x 8.
constexpr int CONTEXTS = 1 << 15;

// Classes of sizes, two for each doubling.
constexpr int BUCKETS = 18;

// Digits from which on decisions share their contexts.
constexpr int MOST_LEVEL = 7;

// Greatest logit, in 1/256.
constexpr int STRETCHED = 2047;

// Initial state of a context: even odds in the upper 22 bits, its number of decisions in the lower ones.
constexpr uint32_t EVEN = 1u << 31;
constexpr int COUNT_BITS = 10, SHARE_BITS = 22;
constexpr uint32_t MOST_COUNT = 255;

// Fractional bits of the weights, and of the coded odds.
constexpr int MIXED_BITS = 16;

// Rate at which the weights of the models are learned: LEARNING / 2^LEARNING_BITS.
constexpr int64_t LEARNING = 3;
constexpr int LEARNING_BITS = 18;

enum Result : int64_t { NO_MEMORY = -1, WRONG_ARGUMENTS = -2 };

int least(int a, int b) { return b < a ? b : a; }

int64_t size_of(int64_t value) { return value < 0 ? -value : value; }

int digits_of(int64_t size) { return size ? 64 - __builtin_clzll((uint64_t)size) : 0; }

// Class of a size, of BUCKETS.
int bucket(int64_t size) {
    if (size < 4) return (int)size;
    int digits = digits_of(size) - 2;
    return least(2 * digits + (int)(size >> digits), BUCKETS - 1);
}

struct Tables {
    int32_t odds[2 * STRETCHED + 1];
    int32_t logits[4096];
    uint64_t shares[MOST_COUNT + 1];

    // Odds, as probabilities of 2^MIXED_BITS, by logit: none is so close to a rounding boundary that the last
    // bits of the exponential count. Logits by the upper 12 bits of odds. Reciprocals of 2 * count + 3.
    Tables() {
        constexpr double STEP = 1.003913889338347573443609603903460281899;  // exp(1 / 256)
        constexpr double ONE = 1 << MIXED_BITS;
        double growth = 1.0;
        for (int k = 0; k <= STRETCHED; k++) {
            odds[STRETCHED + k] = clipped((int)(ONE * growth / (1.0 + growth) + 0.5));
            odds[STRETCHED - k] = clipped((int)(ONE / (1.0 + growth) + 0.5));
            growth *= STEP;
        }
        int place = 0;
        for (int k = 0; k < 4096; k++) {
            while (place < 2 * STRETCHED && odds[place] < 16 * k + 8) place++;
            logits[k] = place - STRETCHED;
        }
        for (uint32_t count = 0; count <= MOST_COUNT; count++) {
            uint64_t divisor = 2 * count + 3;
            shares[count] = ((1ull << RECIPROCAL_BITS) + divisor - 1) / divisor;
        }
    }

    // The state after a decision. The first estimates move fast, as a mean does, later ones by no less than
    // 1 of MOST_COUNT. The step is 2 * (bit * 2^22 - share) / (2 * count + 3), rounded down.
    uint32_t after(uint32_t state, int bit) const {
        uint32_t count = state & ((1u << COUNT_BITS) - 1), share = state >> COUNT_BITS;
        uint64_t rest = bit ? 2 * (uint64_t)((1u << SHARE_BITS) - share) : 2 * (uint64_t)(share + count + 1);
        uint32_t step = (uint32_t)(rest * shares[count] >> RECIPROCAL_BITS);
        share = bit ? share + step : share - step;
        return share << COUNT_BITS | (count < MOST_COUNT ? count + 1 : MOST_COUNT);
    }

  private:
    // Enough for exact quotients of numbers of 24 bits by divisors of 10.
    static constexpr int RECIPROCAL_BITS = 34;

    static int clipped(int odds) {
        constexpr int LEAST = 16, MOST = (1 << MIXED_BITS) - 16;
        return odds < LEAST ? LEAST : odds > MOST ? MOST : odds;
    }
};

// The interval that the code so far stands for, as it is written.
struct Encoder {
    uint8_t *code;
    int64_t room, place = 0;
    uint32_t low = 0, high = 0xffffffffu;

    // Narrows the interval by a decision, and returns it.
    int narrow(uint32_t middle, int bit) {
        (bit ? high : low) = bit ? middle : middle + 1;
        while ((low ^ high) >> 24 == 0) {
            put((uint8_t)(high >> 24));
            low <<= 8;
            high = high << 8 | 255;
        }
        return bit;
    }

    void put(uint8_t byte) {
        if (place < room) code[place] = byte;
        place++;
    }
};

// The interval that the code so far stands for, as it is read. Behind its end zeros follow.
struct Decoder {
    const uint8_t *code;
    int64_t size, place = 0;
    uint32_t low = 0, high = 0xffffffffu, number = 0;

    Decoder(const uint8_t *code, int64_t size) : code(code), size(size) {
        for (int k = 0; k < 4; k++) take();
    }

    int narrow(uint32_t middle, int) {
        int bit = number <= middle;
        (bit ? high : low) = bit ? middle : middle + 1;
        while ((low ^ high) >> 24 == 0) {
            take();
            low <<= 8;
            high = high << 8 | 255;
        }
        return bit;
    }

    void take() {
        number = number << 8 | (place < size ? code[place] : 0u);
        place++;
    }
};

// Size classes of the numbers around a place.
struct CodingContext {
    int near, all_around, in_time, in_space, longer, slow, before, others, touching, wave, frequency;
};

// Numbers (times, waves, columns), and sums of their sizes over the waves, for every group of columns: a
// range is the difference of two.
struct Numbers {
    const int64_t *values;
    int64_t *sums;
    int64_t times, waves, columns, groups, stride;

    int64_t size(int64_t time, int64_t wave, int64_t column) const {
        bool inside = time >= 0 && wave >= 0 && wave < waves;
        return inside ? size_of(values[(time * waves + wave) * columns + column]) : 0;
    }

    int64_t *group_sums(int64_t time, int64_t group) const {
        return sums + (time * groups + group) * (waves + 1);
    }

    // Sum of sizes from wave `first` up to, not including, `last`; both may lie outside.
    int64_t sum(int64_t time, int64_t group, int64_t first, int64_t last) const {
        if (time < 0) return 0;
        const int64_t *row = group_sums(time, group);
        return row[last < waves ? last : waves] - row[first > 0 ? first : 0];
    }

    CodingContext look(int64_t time, int64_t wave, int64_t column) const {
        int64_t group = column / AXES, axis = column % AXES;
        int64_t slower = time - stride, much_slower = time - 2 * stride;
        int64_t earlier = time % stride ? time - 1 : much_slower;
        int64_t in_time = size(slower, wave, column) + size(earlier, wave, column);
        int64_t first = size(time, wave - 1, column), second = size(time, wave - 2, column);
        int64_t third = size(time, wave - 3, column);
        int64_t others = axis > 0 ? size(time, wave, column - 1) : 0;
        if (axis > 1) others += size(time, wave, column - 2);
        int64_t slanted = size(slower, wave + 1, column) + size(slower, wave - 1, column);
        int64_t longer = sum(time, group, wave - 16, wave);
        int64_t slow = sum(slower, group, wave - 6, wave + 7);
        int64_t before = sum(earlier, group, wave - 6, wave + 7);
        int64_t near = 2 * (in_time + first) + size(much_slower, wave, column) + second + slanted + others;
        return {
            .near = bucket(near),
            .all_around = bucket(longer + slow + before),
            .in_time = bucket(in_time),
            .in_space = least(bucket(2 * first + second + third), 13),
            .longer = bucket(longer),
            .slow = bucket(slow),
            .before = bucket(before),
            .others = least(bucket(others), 7),
            .touching = least(bucket(others + first), 7),
            .wave = bucket(wave),
            .frequency = least(bucket(time / stride), 15),
        };
    }

    // Adds a number's size to the sums, in the order of the numbers.
    void add(int64_t time, int64_t wave, int64_t column, int64_t size) {
        int64_t *row = group_sums(time, column / AXES);
        if (column % AXES == 0) row[wave + 1] = row[wave];
        row[wave + 1] += size;
    }
};

// The models, and what they have learned so far.
template <class Interval> struct Coder {
    Interval interval;
    Tables tables;
    int64_t weights[MOST_LEVEL + 1][BUCKETS][MODELS];
    int64_t digit_weight[1] = {1 << MIXED_BITS};
    uint32_t *states;

    // states: (MODELS + 1, CONTEXTS), of the models for sizes and of that for digits.
    Coder(Interval interval, uint32_t *states) : interval(interval), states(states) {
        for (auto &level : weights)
            for (auto &mixture : level)
                for (int64_t &weight : mixture) weight = 2 * (1 << MIXED_BITS) / MODELS;
        for (int k = 0; k < (MODELS + 1) * CONTEXTS; k++) states[k] = EVEN;
    }

    // Codes one decision by the mixed odds of `COUNT` models, whose states these are, and updates the models.
    template <int COUNT> int decide(int bit, uint32_t *(&at)[COUNT], int64_t (&mixture)[COUNT]) {
        int64_t mixed = 0, logits[COUNT];
        for (int k = 0; k < COUNT; k++) {
            logits[k] = tables.logits[*at[k] >> 20];
            mixed += mixture[k] * logits[k];
        }
        mixed >>= MIXED_BITS;
        mixed = mixed < -STRETCHED ? -STRETCHED : mixed > STRETCHED ? STRETCHED : mixed;
        uint32_t odds = (uint32_t)tables.odds[mixed + STRETCHED];
        uint32_t width = interval.high - interval.low;
        uint32_t part = (width >> MIXED_BITS) * odds + ((width & 0xffff) * odds >> MIXED_BITS);
        bit = interval.narrow(interval.low + part, bit);
        int64_t missed = ((int64_t)bit << MIXED_BITS) - odds;
        for (int k = 0; k < COUNT; k++) {
            mixture[k] += (logits[k] * missed * LEARNING + (1 << (LEARNING_BITS - 1))) >> LEARNING_BITS;
            *at[k] = tables.after(*at[k], bit);
        }
        return bit;
    }

    // Codes whether a number has more digits than `level`.
    int decide_level(int bit, const CodingContext &c, int level, int axis) {
        int rank = least(level, MOST_LEVEL) * BUCKETS;
        const int contexts[MODELS] = {
            ((rank + c.in_time) * BUCKETS + c.in_space) * 8 + c.others,
            (rank + c.wave) * 16 + c.frequency,
            (rank + c.near) * BUCKETS + c.all_around,
            ((rank + c.longer) * BUCKETS + c.slow) * AXES + axis,
            ((rank + c.before) * BUCKETS + c.slow) * 8 + least(c.in_time, 7),
            (rank + c.near) * BUCKETS + c.wave,
            ((rank + c.longer) * BUCKETS + c.before) * 8 + c.touching,
        };
        uint32_t *at[MODELS];
        for (int k = 0; k < MODELS; k++) at[k] = states + k * CONTEXTS + contexts[k];
        return decide(bit, at, weights[least(level, MOST_LEVEL)][c.all_around]);
    }

    // Codes a number around which there are such sizes. To decode, whatever number is given.
    int64_t code(int64_t value, const CodingContext &classes, int axis) {
        int64_t size = size_of(value);
        int digits = digits_of(size), level = 0;
        while (level < MOST_DIGITS && decide_level(digits > level, classes, level, axis)) level++;
        if (level == 0) return 0;
        int64_t number = 1;
        for (int digit = level - 2; digit >= 0; digit--) {
            int context = level * 8 + (number < 7 ? (int)number : 7);
            uint32_t *at[1] = {states + MODELS * CONTEXTS + context};
            number = 2 * number + decide((int)(size >> digit & 1), at, digit_weight);
        }
        uint32_t middle = interval.low + ((interval.high - interval.low) >> 1);
        return interval.narrow(middle, value < 0) ? -number : number;
    }
};

// Memory of a run; all of it is zero at first.
struct Workspace {
    int64_t *sums;
    uint32_t *states;

    explicit Workspace(const Numbers &numbers)
        : sums((int64_t *)calloc((size_t)(numbers.times * numbers.groups * (numbers.waves + 1)) + 1,
                                 sizeof(int64_t))),
          states((uint32_t *)calloc((MODELS + 1) * CONTEXTS, sizeof(uint32_t))) {}
    Workspace(const Workspace &) = delete;
    ~Workspace() {
        free(sums);
        free(states);
    }
};

// Whether the numbers can be counted, with room to spare.
bool is_shape(const Numbers &numbers) {
    constexpr int64_t MOST = (int64_t)1 << 28;
    if (numbers.times < 0 || numbers.waves < 0 || numbers.columns < 0 || numbers.stride < 1) return false;
    if (numbers.times > MOST || numbers.waves > MOST || numbers.columns > MOST) return false;
    if (numbers.stride > MOST) return false;
    int64_t rows = numbers.times * (numbers.waves + 1);
    return rows <= MOST && rows * numbers.columns <= MOST;
}

// Whether no number has too many digits.
bool are_coded(const int64_t *values, int64_t count) {
    constexpr int64_t MOST = ((int64_t)1 << MOST_DIGITS) - 1;
    for (int64_t k = 0; k < count; k++)
        if (values[k] > MOST || values[k] < -MOST) return false;
    return true;
}

Numbers numbers_of(const int64_t *values, int64_t times, int64_t waves, int64_t columns, int64_t stride) {
    return {values, nullptr, times, waves, columns, (columns + AXES - 1) / AXES, stride};
}

// Calls `step(place, classes, axis)`, which returns the number there, for all numbers in order.
template <class Step> void walk(Numbers &numbers, Step step) {
    int64_t place = 0;
    for (int64_t time = 0; time < numbers.times; time++)
        for (int64_t wave = 0; wave < numbers.waves; wave++)
            for (int64_t column = 0; column < numbers.columns; column++) {
                CodingContext classes = numbers.look(time, wave, column);
                int64_t number = step(place++, classes, (int)(column % AXES));
                numbers.add(time, wave, column, size_of(number));
            }
}

}  // namespace

int64_t uvc_encode_numbers(const int64_t *values, int64_t times, int64_t waves, int64_t columns,
                           int64_t stride, uint8_t *code, int64_t room) {
    Numbers numbers = numbers_of(values, times, waves, columns, stride);
    if (!is_shape(numbers) || !are_coded(values, times * waves * columns)) return WRONG_ARGUMENTS;
    Workspace workspace(numbers);
    if (!workspace.sums || !workspace.states) return NO_MEMORY;
    numbers.sums = workspace.sums;
    Coder<Encoder> coder(Encoder{code, room}, workspace.states);
    walk(numbers, [&](int64_t place, const CodingContext &classes, int axis) {
        return coder.code(values[place], classes, axis);
    });
    // One more byte gives a number in the interval, whatever follows.
    coder.interval.put((uint8_t)((coder.interval.low >> 24) + 1));
    return coder.interval.place <= room ? coder.interval.place : (int64_t)WRONG_ARGUMENTS;
}

int64_t uvc_decode_numbers(const uint8_t *code, int64_t size, int64_t *values, int64_t times, int64_t waves,
                           int64_t columns, int64_t stride) {
    Numbers numbers = numbers_of(values, times, waves, columns, stride);
    if (!is_shape(numbers) || size < 0) return WRONG_ARGUMENTS;
    Workspace workspace(numbers);
    if (!workspace.sums || !workspace.states) return NO_MEMORY;
    numbers.sums = workspace.sums;
    Coder<Decoder> coder(Decoder(code, size), workspace.states);
    walk(numbers, [&](int64_t place, const CodingContext &classes, int axis) {
        values[place] = coder.code(0, classes, axis);
        return values[place];
    });
    return 0;
}
