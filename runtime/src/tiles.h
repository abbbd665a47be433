// Convolutions by tiles (Winograd 1980; Lavin and Gray 2016): sums of 4 x 4 pixels need fewer products once the
// channels of a patch, and the weights, are sums of theirs.
#pragma once

#include "convolution.h"

namespace uvc {

constexpr int TILE = 4;

// Tiles that are computed together, so that what lies between stays in the cache.
constexpr int STRIP = 8;

// A kernel of 3 x 3 pixels (STRIDE 1), or of 4 x 4 at every second one (STRIDE 2), which is one of 2 x 2 on
// each of the four maps of pixels that are even or odd: PHASES of TAPS x TAPS; POINTS^2 products for a tile.
template <int STRIDE> struct Tiling {
    static constexpr int PHASES = STRIDE * STRIDE, TAPS = STRIDE == 1 ? 3 : 2, POINTS = TILE + TAPS - 1;
};

// What weights count at each point, F(4, 3) and F(4, 2) on the points 0, 1, -1, 2 (-2) and infinity.
constexpr float AT_POINTS_3[6][3] = {{1 / 4.f, 0, 0},
                                     {-1 / 6.f, -1 / 6.f, -1 / 6.f},
                                     {-1 / 6.f, 1 / 6.f, -1 / 6.f},
                                     {1 / 24.f, 1 / 12.f, 1 / 6.f},
                                     {1 / 24.f, -1 / 12.f, 1 / 6.f},
                                     {0, 0, 1}};
constexpr float AT_POINTS_2[5][2] = {
    {1 / 2.f, 0}, {-1 / 2.f, -1 / 2.f}, {-1 / 6.f, 1 / 6.f}, {1 / 6.f, 1 / 3.f}, {0, 1}};

// Values of a row of a patch at the points; both rows have steps between their values.
template <int STRIDE>
UVC_INLINE void into_points(const Register *d, int step, Register *at, int step_at) {
    Register d0 = d[0], d1 = d[step], d2 = d[2 * step], d3 = d[3 * step], d4 = d[4 * step];
    if constexpr (STRIDE == 1) {
        Register d5 = d[5 * step];
        Register even = d4 - 4.0f * d2, odd = d3 - 4.0f * d1, near = d4 - d2, far = 2.0f * (d3 - d1);
        at[0] = 4.0f * d0 - 5.0f * d2 + d4;
        at[step_at] = even + odd, at[2 * step_at] = even - odd;
        at[3 * step_at] = near + far, at[4 * step_at] = near - far;
        at[5 * step_at] = 4.0f * d1 - 5.0f * d3 + d5;
    } else {
        Register odd = d3 - d1;
        at[0] = 2.0f * (d0 - d2) + odd;
        at[step_at] = odd - d1 - d2, at[2 * step_at] = d3 + 2.0f * d1 - 3.0f * d2, at[3 * step_at] = odd;
        at[4 * step_at] = d4 - d2 - 2.0f * odd;
    }
}

// The four sums of a row of a tile, of products at the points.
template <int STRIDE>
UVC_INLINE void from_points(const Register *m, int step, Register *sums, int step_sums) {
    Register both = m[step] + m[2 * step], other = m[step] - m[2 * step];
    Register far = m[3 * step], other_far = far, last = m[4 * step];
    if constexpr (STRIDE == 1) far += last, other_far -= last, last = m[5 * step];
    sums[0] = m[0] + both + far;
    sums[step_sums] = other + 2.0f * other_far;
    sums[2 * step_sums] = both + 4.0f * far;
    sums[3 * step_sums] = other + 8.0f * other_far + last;
}

// Weights of products, one point after another, in blocks as `Kernel` has them, of a kernel's weights, row by
// row, each channel in, each channel out.
template <int STRIDE>
void put_at_points(Array<float> weights, int in, int out, Kernel &kernel, Arena &arena) {
    using Tiles = Tiling<STRIDE>;
    constexpr int POINTS = Tiles::POINTS, TAPS = Tiles::TAPS;
    auto at = [](int point, int tap) {
        return STRIDE == 1 ? AT_POINTS_3[point][tap] : AT_POINTS_2[point][tap];
    };
    int depth = Tiles::PHASES * kernel.in;
    kernel.at_points = arena.take<float>(POINTS * POINTS * depth * kernel.out);
    for (int point = 0; point < POINTS * POINTS; point++)
        for (int row = 0; row < Tiles::PHASES * in; row++)
            for (int k = 0; k < out; k++) {
                int phase = row / in, channel = row % in;
                float sum = 0;
                for (int i = 0; i < TAPS; i++)
                    for (int j = 0; j < TAPS; j++) {
                        int pixel = kernel.size * (STRIDE * i + phase / STRIDE) + STRIDE * j + phase % STRIDE;
                        float weight = weights[(pixel * in + channel) * out + k];
                        sum += at(point / POINTS, i) * at(point % POINTS, j) * weight;
                    }
                int place = place_of(depth, kernel.out, phase * kernel.in + channel, k);
                kernel.at_points[point * depth * kernel.out + place] = sum;
            }
}

// The channels of a tile's patch at the points: at + point * apart, phase by phase.
template <int STRIDE>
UVC_INLINE void read_patch(const FeatureMaps &from, int row, int column, float *at, int apart) {
    constexpr int POINTS = Tiling<STRIDE>::POINTS;
    for (int phase = 0; phase < Tiling<STRIDE>::PHASES; phase++) {
        int y = STRIDE * TILE * row + phase / STRIDE - 1, x = STRIDE * TILE * column + phase % STRIDE - 1;
        for (int k = 0; k < from.channels; k += WIDTH) {
            Register patch[POINTS * POINTS], points[POINTS];
            for (int j = 0; j < POINTS; j++) {
                for (int i = 0; i < POINTS; i++)
                    points[i] = load_register(from.at(y + STRIDE * i, x + STRIDE * j) + k);
                into_points<STRIDE>(points, 1, patch + j, POINTS);
            }
            for (int i = 0; i < POINTS; i++) {
                into_points<STRIDE>(patch + POINTS * i, 1, points, 1);
                for (int j = 0; j < POINTS; j++)
                    store_register(at + (POINTS * i + j) * apart + phase * from.channels + k, points[j]);
            }
        }
    }
}

// Products of so many rows of `depth` values with the weights of one point, in as many rows of all channels.
template <int BLOCK, int COUNT>
UVC_INLINE void multiply_rows(const float *values, int depth, const float *weights, float *made, int channels) {
    Register sums[COUNT][BLOCK] = {};
    add_products(values, depth, depth, weights, sums);
    for (int row = 0; row < COUNT; row++)
        for (int k = 0; k < BLOCK; k++) store_register(made + row * channels + WIDTH * k, sums[row][k]);
}

// Adds products at the points up to the pixels of a tile, from (y, x) on, and finishes them.
template <int STRIDE, class Finish>
UVC_INLINE void finish_tile(const Kernel &kernel, const float *made, int apart, int y, int x, Finish finish) {
    constexpr int POINTS = Tiling<STRIDE>::POINTS, PARTS = LANES / WIDTH;
    for (int channel = 0; channel < kernel.out; channel += LANES) {
        Register pixels[TILE * TILE][PARTS];
        for (int part = 0; part < PARTS; part++) {
            Register points[POINTS], columns[TILE * POINTS], sums[TILE];
            int place = channel + WIDTH * part;
            Register bias = load_register(kernel.bias.data + place);
            for (int j = 0; j < POINTS; j++) {
                for (int i = 0; i < POINTS; i++)
                    points[i] = load_register(made + (POINTS * i + j) * apart + place);
                from_points<STRIDE>(points, 1, columns + j, POINTS);
            }
            for (int i = 0; i < TILE; i++) {
                from_points<STRIDE>(columns + POINTS * i, 1, sums, 1);
                for (int j = 0; j < TILE; j++) pixels[TILE * i + j][part] = sums[j] + bias;
            }
        }
        for (int k = 0; k < TILE * TILE; k++) finish(y + k / TILE, x + k % TILE, channel, lanes_of(pixels[k]));
    }
}

// A strip of tiles from number `first` on, row by row: channels at the points, and their products.
struct Strip {
    int first, count, room, across;
    float *values, *made;
};

template <int STRIDE> void multiply_strip(const Kernel &kernel, const FeatureMaps &from, const Strip &strip) {
    constexpr int POINTS = Tiling<STRIDE>::POINTS;
    int depth = Tiling<STRIDE>::PHASES * kernel.in, out = kernel.out;
    for (int k = 0; k < strip.count; k++) {
        int tile = strip.first + k;
        read_patch<STRIDE>(from, tile / strip.across, tile % strip.across, strip.values + k * depth,
                           strip.room * depth);
    }
    for (int point = 0; point < POINTS * POINTS; point++) {
        const float *values = strip.values + point * strip.room * depth;
        float *made = strip.made + point * strip.room * out;
        for_blocks(out, depth, kernel.at_points.data + point * depth * out,
                   [&]<int BLOCK>(int channel, const float *weights) {
                       constexpr int REGISTERS = BLOCK * LANES / WIDTH;
                       int row = 0;
                       for (; row + PIXELS <= strip.count; row += PIXELS)
                           multiply_rows<REGISTERS, PIXELS>(values + row * depth, depth, weights,
                                                            made + row * out + channel, out);
                       for (; row < strip.count; row++)
                           multiply_rows<REGISTERS, 1>(values + row * depth, depth, weights,
                                                       made + row * out + channel, out);
                   });
    }
}

// What `convolve_directly` does, by tiles: the size of the maps that are made is a multiple of TILE.
template <int STRIDE, class Finish>
void convolve_tiles(const Kernel &kernel, const FeatureMaps &from, Finish finish, Arena &work) {
    Scope scope(work);
    constexpr int NUMBER = Tiling<STRIDE>::POINTS * Tiling<STRIDE>::POINTS;
    int across = from.size / STRIDE / TILE, tiles = across * across, room = least(STRIP, tiles);
    int depth = Tiling<STRIDE>::PHASES * kernel.in;
    Strip strip{0, room, room, across, work.room<float>(NUMBER * room * depth).data,
                work.room<float>(NUMBER * room * kernel.out).data};
    for (; strip.first < tiles; strip.first += room) {
        strip.count = least(room, tiles - strip.first);
        multiply_strip<STRIDE>(kernel, from, strip);
        for (int k = 0; k < strip.count; k++) {
            int tile = strip.first + k;
            finish_tile<STRIDE>(kernel, strip.made + k * kernel.out, room * kernel.out, tile / across * TILE,
                                tile % across * TILE, finish);
        }
    }
}

// Convolves maps by tiles, if the kernel has weights for them, or directly.
template <class Finish>
void convolve(const Kernel &kernel, const FeatureMaps &from, Arena &work, Finish finish) {
    if (!kernel.at_points.size)
        convolve_directly(kernel, from, finish);
    else if (kernel.stride == 1)
        convolve_tiles<1>(kernel, from, finish, work);
    else
        convolve_tiles<2>(kernel, from, finish, work);
}

}  // namespace uvc
