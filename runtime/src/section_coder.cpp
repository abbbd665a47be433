#include "section_coder.h"

#include "uvcloth_codec.h"

namespace uvc {

namespace {

// From what a number is predicted: nothing, the row before, the number before, or those that were met last,
// as in faces, whose corners come again. The code begins with one of these, or with STORED: the numbers follow
// as they are.
enum Prediction : uint8_t { NONE = 0, ABOVE = 1, LEFT = 2, RECENT = 3 };
constexpr uint8_t STORED = 4;

constexpr int ODDS_BITS = 16;

// Columns with contexts of their own, numbers that are remembered, and places among them with contexts.
constexpr int COLUMNS = 4, REMEMBERED = 64, PLACES = 24;

// Digits of a number behind the first one that are predicted.
constexpr int PREDICTED_DIGITS = 4;

constexpr int MOST_DIGITS = 32;

// Odds of a decision for 1: the mean of a fast and of a slow estimate.
struct BitProbability {
    uint16_t fast = 1 << (ODDS_BITS - 1), slow = 1 << (ODDS_BITS - 1);

    uint32_t mean() const { return ((uint32_t)fast + slow) >> 1; }

    void learn(int bit) {
        constexpr int FAST = 4, SLOW = 7, MOST = (1 << ODDS_BITS) - 1;
        fast = (uint16_t)(bit ? fast + ((MOST - fast) >> FAST) : fast - (fast >> FAST));
        slow = (uint16_t)(bit ? slow + ((MOST - slow) >> SLOW) : slow - (slow >> SLOW));
    }
};

// The interval that the code so far stands for. Behind the end of a code that is read zeros follow.
struct Interval {
    uint32_t low = 0, high = 0xffffffffu;

    uint32_t middle(uint32_t odds) const { return low + ((high - low) >> ODDS_BITS) * odds; }

    void narrow(uint32_t middle, int bit) { (bit ? high : low) = bit ? middle : middle + 1; }

    bool is_settled() const { return (low ^ high) >> 24 == 0; }

    void shift() {
        low <<= 8;
        high = high << 8 | 255;
    }
};

struct Encoder {
    static constexpr bool WRITES = true;
    uint8_t *code;
    int64_t room, place = 0;
    Interval interval{};

    int decide(uint32_t odds, int bit) {
        interval.narrow(interval.middle(odds), bit);
        for (; interval.is_settled(); interval.shift()) put((uint8_t)(interval.high >> 24));
        return bit;
    }

    void put(uint8_t byte) {
        if (place < room) code[place] = byte;
        place++;
    }

    bool is_beyond() const { return false; }
};

struct Decoder {
    static constexpr bool WRITES = false;
    const uint8_t *code;
    size_t size, place = 0;
    Interval interval{};
    uint32_t number = 0;

    Decoder(const uint8_t *code, size_t size) : code(code), size(size) {
        for (int k = 0; k < 4; k++) take();
    }

    int decide(uint32_t odds, int) {
        uint32_t middle = interval.middle(odds);
        int bit = number <= middle;
        interval.narrow(middle, bit);
        for (; interval.is_settled(); interval.shift()) take();
        return bit;
    }

    void take() {
        number = number << 8 | (place < size ? code[place] : 0u);
        place++;
    }

    bool is_beyond() const { return place > size + 4; }
};

int digits_of(uint32_t number) { return number ? 32 - __builtin_clz(number) : 0; }

// Differences as numbers without a sign, small ones first; both wrap around.
uint32_t folded(uint32_t difference) { return difference << 1 ^ (0u - (difference >> 31)); }
uint32_t unfolded(uint32_t number) { return number >> 1 ^ (0u - (number & 1)); }

// Codes numbers, or, with a Decoder, whatever the code says instead of them.
template <class Coded> struct Coder {
    Coded coded;
    Prediction prediction;
    BitProbability classes[COLUMNS][MOST_DIGITS + 1][64], digits[MOST_DIGITS + 1][1 << PREDICTED_DIGITS];
    BitProbability places[COLUMNS][PLACES][2 * REMEMBERED], is_last[COLUMNS][PLACES], is_new[COLUMNS][PLACES];
    int32_t remembered[REMEMBERED] = {};
    int before[COLUMNS] = {}, place_before = 0;
    int32_t newest = 0;

    Coder(Coded coded, Prediction prediction) : coded(coded), prediction(prediction) {}

    int decide(BitProbability &odds, int bit) {
        bit = coded.decide(odds.mean(), bit);
        odds.learn(bit);
        return bit;
    }

    // A number below 2^bits, digit by digit from the first one, with odds of its own for each beginning.
    uint32_t choose(BitProbability *odds, int bits, uint32_t number) {
        uint32_t begun = 1;
        for (int k = bits - 1; k >= 0; k--)
            begun = 2 * begun + (uint32_t)decide(odds[begun], (int)(number >> k & 1));
        return begun - (1u << bits);
    }

    uint32_t code_folded(int column, uint32_t number) {
        constexpr int CLASS_BITS = 6;
        int count = (int)choose(classes[column][before[column]], CLASS_BITS, (uint32_t)digits_of(number));
        count = least(count, MOST_DIGITS);
        before[column] = count;
        uint32_t begun = count ? 1 : 0;
        for (int k = count - 2; k >= 0; k--) {
            int bit = (int)(number >> k & 1);
            bool is_predicted = begun < 1 << PREDICTED_DIGITS;
            bit = is_predicted ? decide(digits[count][begun], bit) : coded.decide(1u << (ODDS_BITS - 1), bit);
            begun = 2 * begun + (uint32_t)bit;
        }
        return begun;
    }

    int32_t code_difference(int column, int32_t number, int32_t predicted) {
        uint32_t difference = folded((uint32_t)number - (uint32_t)predicted);
        return (int32_t)((uint32_t)predicted + unfolded(code_folded(column, difference)));
    }

    int32_t code_recent(int column, int32_t number) {
        constexpr int BITS = 6;
        static_assert(1 << BITS == REMEMBERED);
        int place = 0, context = least(place_before, PLACES - 1);
        while (Coded::WRITES && place < REMEMBERED && remembered[place] != number) place++;
        if (decide(is_last[column][context], place == 0)) {
            place_before = 0;
            return remembered[0];
        }
        bool is_found = !decide(is_new[column][context], place == REMEMBERED);
        if (is_found) {
            place = (int)choose(places[column][context], BITS, (uint32_t)place);
            number = remembered[place];
        } else {
            number = newest = code_difference(column, number, newest);
            place = REMEMBERED - 1;
        }
        place_before = is_found ? place : PLACES - 1;
        memmove(remembered + 1, remembered, sizeof(int32_t) * (size_t)place);
        return remembered[0] = number;
    }

    // Codes numbers in place. Returns whether the code had an end behind them.
    bool code(int32_t *numbers, int count, int columns) {
        for (int k = 0, column = 0; k < count && !coded.is_beyond(); k++) {
            int few = least(column, COLUMNS - 1);
            int32_t above = k >= columns ? numbers[k - columns] : 0, left = k > 0 ? numbers[k - 1] : 0;
            int32_t predicted = prediction == ABOVE ? above : prediction == LEFT ? left : 0;
            numbers[k] = prediction == RECENT ? code_recent(few, numbers[k])
                                              : code_difference(few, numbers[k], predicted);
            column = column + 1 < columns ? column + 1 : 0;
        }
        return !coded.is_beyond();
    }
};

// Encodes numbers by one prediction. Returns the bytes that the code takes, whether there is room or not.
int64_t encode(Array<int32_t> numbers, int columns, Prediction prediction, uint8_t *code, int64_t room) {
    Arena work;
    Array<int32_t> copied = work.copy(numbers);
    Encoder encoder{code, room};
    auto *coder = make<Coder<Encoder>>(encoder, prediction);
    coder->coded.put(prediction);
    coder->code(copied.data, copied.size, columns);
    // One more byte gives a number in the interval, whatever follows.
    coder->coded.put((uint8_t)((coder->coded.interval.low >> 24) + 1));
    int64_t size = coder->coded.place;
    drop(coder);
    return size;
}

// The prediction by which the first numbers take the least code.
Prediction best_prediction(Array<int32_t> numbers, int columns) {
    constexpr int TRIED = 1 << 13;
    Array<int32_t> tried = numbers.part(0, least(numbers.size, TRIED));
    Prediction best = NONE;
    int64_t least_size = encode(tried, columns, NONE, nullptr, 0);
    constexpr Prediction OTHERS[] = {ABOVE, LEFT, RECENT};
    for (Prediction prediction : OTHERS) {
        int64_t size = encode(tried, columns, prediction, nullptr, 0);
        if (size >= least_size) continue;
        best = prediction;
        least_size = size;
    }
    return best;
}

}  // namespace

bool decode_section(const uint8_t *code, size_t size, int columns, Array<int32_t> numbers) {
    if (!numbers.size) return size == 0;
    if (size < 2 || code[0] > STORED) return false;
    if (code[0] == STORED) {
        size_t bytes = sizeof(int32_t) * (size_t)numbers.size;
        if (size - 1 != bytes) return false;
        memcpy(numbers.data, code + 1, bytes);
        return true;
    }
    Prediction prediction = (Prediction)code[0];
    Decoder decoder(code + 1, size - 1);
    auto *coder = make<Coder<Decoder>>(decoder, prediction);
    bool is_whole = coder->code(numbers.data, numbers.size, columns);
    drop(coder);
    return is_whole;
}

}  // namespace uvc

extern "C" {

int64_t uvc_encode_section(const int32_t *numbers, int rows, int columns, uint8_t *code, int64_t room) {
    uvc::Array<int32_t> all{const_cast<int32_t *>(numbers), rows * columns};
    if (!all.size) return 0;
    return uvc::encode(all, columns, uvc::best_prediction(all, columns), code, room);
}

int uvc_decode_section(const uint8_t *code, int64_t size, int32_t *numbers, int rows, int columns) {
    return uvc::decode_section(code, (size_t)size, columns, {numbers, rows * columns});
}

}  // extern "C"
