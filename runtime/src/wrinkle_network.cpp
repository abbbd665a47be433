#include "wrinkle_network.h"

namespace uvc {

namespace {

// Largest map and most channels, and products of a frame, with which a network still takes a second.
constexpr int LARGEST_SIZE = 512, MOST_CHANNELS = 512;
constexpr int64_t MOST_PRODUCTS = 1ll << 31;

// Metres that cloth is displaced at most, so that a damaged network gives numbers.
constexpr float FARTHEST_DISPLACED = 0.2f;

// e to the power of numbers, to within 1e-6 of it, from 2^-126 to 2^126; that of what is no number is 2^-126.
// The polynomial is that of Taylor for 2^x on [-0.5, 0.5].
UVC_INLINE Lanes exponential(Lanes a) {
    Lanes power = least(Lanes{} + 126.0f, most(Lanes{} - 126.0f, 1.44269504f * a));
    Lanes rounded = power + choose(is_below(power, Lanes{}), Lanes{} - 0.5f, Lanes{} + 0.5f);
    LaneMask whole = __builtin_convertvector(rounded, LaneMask);
    Lanes x = power - __builtin_convertvector(whole, Lanes);
    Lanes part = 0.00961812911f + x * (0.00133335581f + x * 0.000154035304f);
    part = 1.0f + x * (0.693147181f + x * (0.240226507f + x * (0.0555041087f + x * part)));
    LaneMask bits = (whole + 127) << 23;
    Lanes scale;
    __builtin_memcpy(&scale, &bits, sizeof(scale));
    return scale * part;
}

UVC_INLINE Lanes silu(Lanes a) { return a / (1.0f + exponential(-a)); }

// Numbers of the sections, one kernel and one level after another.
struct Reader {
    Array<float> weights, biases, gains;
    int weight = 0, bias = 0, gain = 0;

    // A kernel that makes maps of pixels x pixels.
    Kernel kernel(int size, int stride, int in, int out, int pixels, Arena &arena) {
        int rows = size * size, room = padded(in);
        Kernel kernel{size, stride, room, padded(out), {}, arena.take<float>(padded(out)), {}};
        for (int k = 0; k < out; k++) kernel.bias[k] = biases[bias++];
        Array<float> own = weights.part(weight, weight + rows * in * out);
        weight += own.size;
        if (size > 1 && pixels % TILE == 0) {
            if (stride == 1) put_at_points<1>(own, in, out, kernel, arena);
            if (stride == 2) put_at_points<2>(own, in, out, kernel, arena);
            return kernel;
        }
        kernel.weights = arena.take<float>(rows * room * kernel.out);
        for (int k = 0; k < own.size; k++) {
            int row = k / out / in * room + k / out % in;
            kernel.weights[place_of(rows * room, kernel.out, row, k % out)] = own[k];
        }
        return kernel;
    }

    TexelGains texel_gains(int size, int channels, Arena &arena) {
        int room = padded(channels), pixels = size * size;
        TexelGains made{arena.take<float>(pixels * room), arena.take<float>(pixels * room)};
        for (int k = 0; k < pixels * channels; k++, gain++) {
            int place = k / channels * room + k % channels;
            made.gains[place] = gains[2 * gain];
            made.offsets[place] = gains[2 * gain + 1];
        }
        return made;
    }
};

// How many numbers sections have to have, and products a frame has.
struct Counts {
    int64_t weights = 0, biases = 0, gains = 0, products = 0;

    void kernel(int64_t size, int64_t in, int64_t out, int64_t pixels) {
        weights += size * size * in * out;
        biases += out;
        products += size * size * in * out * pixels;
    }
};

Counts count_numbers(const int32_t *widths, int levels, int64_t size) {
    Counts counts;
    counts.kernel(1, INPUTS, widths[0], size * size);
    for (int level = 0; level < levels; level++) {
        int64_t half = size >> level, pixels = half * half, width = widths[level];
        counts.kernel(3, width, width, pixels);
        counts.gains += width * pixels;
        if (level + 1 == levels) continue;
        counts.kernel(4, width, widths[level + 1], pixels / 4);
        counts.kernel(1, widths[level + 1], width, pixels / 4);
        counts.kernel(3, width, width, pixels);
    }
    counts.kernel(3, widths[0], DISPLACEMENTS, size * size);
    counts.gains += widths[0] * size * size;
    return counts;
}

// Checks the size of the maps and the channels of the levels.
void check_shape(Array<int32_t> shape, Failure &failure) {
    if (failure.failed) return;
    int levels = shape.size - 1;
    bool is_whole = levels >= 1 && levels <= MOST_LEVELS && shape[0] >= 1 && shape[0] <= LARGEST_SIZE &&
                    shape[0] % (1 << (levels - 1)) == 0;
    for (int k = 1; k < shape.size; k++) is_whole = is_whole && shape[k] >= 1 && shape[k] <= MOST_CHANNELS;
    if (!is_whole)
        failure.say("the network of wrinkles has no size or channels that can be");
    else if (count_numbers(shape.data + 1, levels, shape[0]).products > MOST_PRODUCTS)
        failure.say("the network of wrinkles takes too long");
}

UVC_INLINE Lanes with_gain(const TexelGains &gains, int place, Lanes value) {
    return value * load(gains.gains.data + place) + load(gains.offsets.data + place);
}

// Adds maps that are twice as large as `from` between its pixels, to `to` (bilinear).
void add_enlarged(const FeatureMaps &from, const FeatureMaps &to) {
    for (int y = 0; y < to.size; y++) {
        int top = y / 2, beside_y = top + (y % 2 ? 1 : -1);
        beside_y = least(most(beside_y, 0), from.size - 1);
        for (int x = 0; x < to.size; x++) {
            int left = x / 2, beside_x = left + (x % 2 ? 1 : -1);
            beside_x = least(most(beside_x, 0), from.size - 1);
            const float *near = from.at(top, left), *across = from.at(top, beside_x);
            const float *above = from.at(beside_y, left), *far = from.at(beside_y, beside_x);
            float *sum = to.at(y, x);
            for (int k = 0; k < to.channels; k += LANES)
                store(sum + k, load(sum + k) + 0.5625f * load(near + k) +
                                   0.1875f * (load(across + k) + load(above + k)) + 0.0625f * load(far + k));
        }
    }
}

// Scales and limits the inputs where there is cloth; elsewhere they stay 0.
void scale_inputs(const WrinkleNetwork &network, FeatureMaps inputs) {
    for (int y = 0; y < inputs.size; y++)
        for (int x = 0; x < inputs.size; x++) {
            float *row = inputs.at(y, x);
            if (row[INPUTS - 1] == 0) continue;
            for (int k = 0; k < INPUTS; k++)
                row[k] = clamp((row[k] - network.shift[k]) * network.scale[k], -network.reach, network.reach);
        }
}

}  // namespace

WrinkleNetwork read_wrinkle_network(const Sections &sections, Arena &arena, Failure &failure) {
    WrinkleNetwork network{};
    Arena work;
    Array<int32_t> shape = read_integers(sections, "wrinkles.shape", -1, 1, work, failure);
    check_shape(shape, failure);
    if (failure.failed) return {};
    network.size = shape[0];
    network.levels = shape.size - 1;
    const int32_t *widths = shape.data + 1;
    Counts counts = count_numbers(widths, network.levels, network.size);
    network.reach = read_number(sections, "wrinkles.reach", failure);
    network.shift = read_floats(sections, "wrinkles.shift", INPUTS, 1, arena, failure);
    network.scale = read_floats(sections, "wrinkles.scale", INPUTS, 1, arena, failure);
    network.output = read_floats(sections, "wrinkles.output", DISPLACEMENTS, 1, arena, failure);
    int pixels = network.size * network.size;
    network.mean = read_floats(sections, "wrinkles.mean", pixels, DISPLACEMENTS, arena, failure);
    Reader reader;
    reader.weights = read_floats(sections, "wrinkles.weights", (int)counts.weights, 1, work, failure);
    reader.biases = read_floats(sections, "wrinkles.biases", (int)counts.biases, 1, work, failure);
    reader.gains = read_floats(sections, "wrinkles.gains", (int)counts.gains, 2, work, failure);
    if (failure.failed) return {};
    int last = network.levels - 1, size = network.size;
    network.first = reader.kernel(1, 1, INPUTS, widths[0], size, arena);
    for (int k = 0; k < last; k++)
        network.down[k] = reader.kernel(4, 2, widths[k], widths[k + 1], size >> (k + 1), arena);
    for (int k = 0; k <= last; k++)
        network.across[k] = reader.kernel(3, 1, widths[k], widths[k], size >> k, arena);
    for (int k = 0; k < last; k++)
        network.narrow[k] = reader.kernel(1, 1, widths[k + 1], widths[k], size >> (k + 1), arena);
    for (int k = 0; k < last; k++) network.up[k] = reader.kernel(3, 1, widths[k], widths[k], size >> k, arena);
    network.last = reader.kernel(3, 1, widths[0], DISPLACEMENTS, size, arena);
    for (int k = 0; k <= last; k++)
        network.here[k] = reader.texel_gains(network.size >> k, widths[k], arena);
    network.end = reader.texel_gains(network.size, widths[0], arena);
    return network;
}

void run(const WrinkleNetwork &network, FeatureMaps inputs, float *displacements, Arena &work) {
    Scope scope(work);
    scale_inputs(network, inputs);
    FeatureMaps begun[MOST_LEVELS], skips[MOST_LEVELS], made = inputs;
    for (int level = 0; level < network.levels; level++) {
        const Kernel &kernel = level ? network.down[level - 1] : network.first;
        int size = network.size >> level, channels = kernel.out;
        const FeatureMaps here = begun[level] = take_maps(size, channels, work);
        const FeatureMaps skip = skips[level] = take_maps(size, channels, work);
        const TexelGains &gains = network.here[level];
        convolve(kernel, made, work, [&](int y, int x, int channel, Lanes sums) {
            int place = (y * size + x) * channels + channel;
            store(here.at(y, x) + channel, silu(with_gain(gains, place, sums)));
        });
        convolve(network.across[level], here, work, [&](int y, int x, int channel, Lanes sums) {
            store(skip.at(y, x) + channel, load(here.at(y, x) + channel) + silu(sums));
        });
        made = skip;
    }
    for (int level = network.levels - 2; level >= 0; level--) {
        const FeatureMaps skip = skips[level], to = begun[level];
        FeatureMaps narrow = take_maps(made.size, skip.channels, work);
        convolve(network.narrow[level], made, work, [&](int y, int x, int channel, Lanes sums) {
            store(narrow.at(y, x) + channel, sums);
        });
        add_enlarged(narrow, skip);
        convolve(network.up[level], skip, work, [&](int y, int x, int channel, Lanes sums) {
            store(to.at(y, x) + channel, load(skip.at(y, x) + channel) + silu(sums));
        });
        made = to;
    }
    for (int y = 0; y < network.size; y++)
        for (int x = 0; x < network.size; x++)
            for (int k = 0; k < made.channels; k += LANES) {
                float *numbers = made.at(y, x) + k;
                int place = (y * network.size + x) * made.channels + k;
                store(numbers, with_gain(network.end, place, load(numbers)));
            }
    convolve(network.last, made, work, [&](int y, int x, int channel, Lanes sums) {
        int place = DISPLACEMENTS * (y * network.size + x);
        for (int k = channel; k < least(channel + LANES, DISPLACEMENTS); k++) {
            float value = (sums[k - channel] + network.mean[place + k]) * network.output[k];
            displacements[place + k] = least(FARTHEST_DISPLACED, most(-FARTHEST_DISPLACED, value));
        }
    });
}

}  // namespace uvc
