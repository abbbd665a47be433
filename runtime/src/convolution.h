// Convolutions of maps of channels, which lie side by side in memory, eight of them in lanes.
#pragma once

#include "lanes.h"
#include "memory.h"

namespace uvc {

// Square maps of channels, a multiple of LANES, with a border of one pixel of zeros.
struct FeatureMaps {
    float *numbers;
    int size, channels;

    int row() const { return (size + 2) * channels; }
    // The channels of a pixel, or of the border at -1 and at `size`.
    float *at(int y, int x) const { return numbers + (y + 1) * row() + (x + 1) * channels; }
};

UVC_INLINE int padded(int channels) { return (channels + LANES - 1) / LANES * LANES; }

// Maps of zeros.
UVC_INLINE FeatureMaps take_maps(int size, int channels, Arena &arena) {
    return {arena.take<float>((size + 2) * (size + 2) * channels).data, size, channels};
}

// A convolution over `size` x `size` pixels, from one set of channels to another, both multiples of LANES, at
// every pixel or at every second one (stride 2), as wide maps or half as wide.
//
// weights: blocks of as many channels out as `lanes_of_block` says; in each, row by row, the weights of all
// channels in. bias: of each channel out. at_points: what `convolve_tiles` has in their place, if it is used.
struct Kernel {
    int size, stride, in, out;
    Array<float> weights, bias, at_points;
};

// Numbers of a register, and pixels and lanes of channels that are computed together: sums stay in registers.
#if defined(__AVX__)
typedef Lanes Register;
constexpr int PIXELS = 4, MOST_BLOCK = 3;
#else
typedef float Register __attribute__((vector_size(16)));
constexpr int PIXELS = 2, MOST_BLOCK = 2;
#endif
constexpr int WIDTH = sizeof(Register) / sizeof(float);

// Lanes of channels in the next block, of so many that are left: four are two and two.
UVC_INLINE int lanes_of_block(int left) { return left == 4 ? 2 : least(left, MOST_BLOCK); }

UVC_INLINE Register load_register(const float *numbers) {
    Register loaded;
    __builtin_memcpy(&loaded, numbers, sizeof(loaded));
    return loaded;
}

// The numbers of one register, or two.
#if defined(__AVX__)
UVC_INLINE Lanes lanes_of(const Register *registers) { return *registers; }
#else
UVC_INLINE Lanes lanes_of(const Register *registers) {
    return __builtin_shufflevector(registers[0], registers[1], 0, 1, 2, 3, 4, 5, 6, 7);
}
#endif

UVC_INLINE void store_register(float *numbers, Register stored) {
    __builtin_memcpy(numbers, &stored, sizeof(stored));
}

// Adds, to sums, the products of `count` values, of rows that are `step` apart, with weights of some registers
// of channels.
template <int BLOCK, int COUNT>
UVC_INLINE void add_products(const float *values, int step, int count, const float *weights,
                             Register (&sums)[COUNT][BLOCK]) {
    for (int k = 0; k < count; k++, weights += WIDTH * BLOCK) {
        Register factors[BLOCK];
        for (int j = 0; j < BLOCK; j++) factors[j] = load_register(weights + WIDTH * j);
        for (int row = 0; row < COUNT; row++) {
            Register value = Register{} + values[row * step + k];
            for (int j = 0; j < BLOCK; j++) sums[row][j] += value * factors[j];
        }
    }
}

// Goes on with act<BLOCK>(channel, weights) for each block of lanes of channels, of weights with so many rows.
template <class Act> void for_blocks(int channels, int rows, const float *weights, Act act) {
    for (int channel = 0; channel < channels;) {
        int block = lanes_of_block((channels - channel) / LANES);
        if (block == 1) act.template operator()<1>(channel, weights);
        if (block == 2) act.template operator()<2>(channel, weights);
        if constexpr (MOST_BLOCK == 3)
            if (block == 3) act.template operator()<3>(channel, weights);
        weights += rows * LANES * block;
        channel += LANES * block;
    }
}

// Where, in such blocks, the weight of a row and a channel is.
UVC_INLINE int place_of(int rows, int channels, int row, int out) {
    int channel = 0;
    for (;;) {
        int block = LANES * lanes_of_block((channels - channel) / LANES);
        if (out < channel + block) return channel * rows + row * block + out - channel;
        channel += block;
    }
}

// Convolves some pixels in a row, from (y, x) on, of a block of so many registers of channels.
template <int BLOCK, int COUNT, class Finish>
UVC_INLINE void convolve_pixels(const Kernel &kernel, const FeatureMaps &from, const float *weights, int y,
                                int x, int channel, Finish finish) {
    Register sums[COUNT][BLOCK];
    for (int pixel = 0; pixel < COUNT; pixel++)
        for (int k = 0; k < BLOCK; k++)
            sums[pixel][k] = load_register(kernel.bias.data + channel + WIDTH * k);
    int before = kernel.size > 1, run = kernel.size * kernel.in;
    const float *in = from.at(kernel.stride * y - before, kernel.stride * x - before);
    for (int row = 0; row < kernel.size; row++, in += from.row(), weights += run * WIDTH * BLOCK)
        add_products(in, kernel.stride * kernel.in, run, weights, sums);
    for (int pixel = 0; pixel < COUNT; pixel++)
        for (int k = 0; k < BLOCK; k += LANES / WIDTH)
            finish(y, x + pixel, channel + WIDTH * k, lanes_of(&sums[pixel][k]));
}

// Convolves maps, and gives the sums of eight channels of each pixel to finish(y, x, channel, sums), which
// stores them.
template <class Finish>
void convolve_directly(const Kernel &kernel, const FeatureMaps &from, Finish finish) {
    int size = from.size / kernel.stride;
    for_blocks(kernel.out, kernel.size * kernel.size * kernel.in, kernel.weights.data,
               [&]<int BLOCK>(int channel, const float *weights) {
                   constexpr int REGISTERS = BLOCK * LANES / WIDTH;
                   for (int y = 0; y < size; y++) {
                       int x = 0;
                       for (; x + PIXELS <= size; x += PIXELS)
                           convolve_pixels<REGISTERS, PIXELS>(kernel, from, weights, y, x, channel, finish);
                       for (; x < size; x++)
                           convolve_pixels<REGISTERS, 1>(kernel, from, weights, y, x, channel, finish);
                   }
               });
}

}  // namespace uvc
