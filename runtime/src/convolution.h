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
// channels in. bias: of each channel out.
struct Kernel {
    int size, stride, in, out;
    Array<float> weights, bias;
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

// Convolves some pixels in a row, from (y, x) on, of a block of so many registers of channels.
template <int BLOCK, int COUNT, class Finish>
UVC_INLINE void convolve_pixels(const Kernel &kernel, const FeatureMaps &from, const float *weights, int y,
                                int x, int channel, Finish finish) {
    Register sums[COUNT][BLOCK];
    for (int pixel = 0; pixel < COUNT; pixel++)
        for (int k = 0; k < BLOCK; k++)
            sums[pixel][k] = load_register(kernel.bias.data + channel + WIDTH * k);
    int before = kernel.size > 1, run = kernel.size * kernel.in, step = kernel.stride * kernel.in;
    const float *in = from.at(kernel.stride * y - before, kernel.stride * x - before);
    for (int row = 0; row < kernel.size; row++, in += from.row())
        for (int k = 0; k < run; k++, weights += WIDTH * BLOCK) {
            Register factors[BLOCK];
            for (int j = 0; j < BLOCK; j++) factors[j] = load_register(weights + WIDTH * j);
            for (int pixel = 0; pixel < COUNT; pixel++) {
                Register value = Register{} + in[pixel * step + k];
                for (int j = 0; j < BLOCK; j++) sums[pixel][j] += value * factors[j];
            }
        }
    for (int pixel = 0; pixel < COUNT; pixel++)
        for (int k = 0; k < BLOCK; k += LANES / WIDTH)
            finish(y, x + pixel, channel + WIDTH * k, lanes_of(&sums[pixel][k]));
}

template <int BLOCK, class Finish>
void convolve_block(const Kernel &kernel, const FeatureMaps &from, const float *weights, int channel,
                    Finish finish) {
    int size = from.size / kernel.stride;
    constexpr int REGISTERS = BLOCK * LANES / WIDTH;
    for (int y = 0; y < size; y++) {
        int x = 0;
        for (; x + PIXELS <= size; x += PIXELS)
            convolve_pixels<REGISTERS, PIXELS>(kernel, from, weights, y, x, channel, finish);
        for (; x < size; x++) convolve_pixels<REGISTERS, 1>(kernel, from, weights, y, x, channel, finish);
    }
}

// Convolves maps, and gives the sums of eight channels of each pixel to finish(y, x, channel, sums), which
// stores them.
template <class Finish>
void convolve(const Kernel &kernel, const FeatureMaps &from, Finish finish) {
    const float *weights = kernel.weights.data;
    int count = kernel.size * kernel.size * kernel.in;
    for (int channel = 0; channel < kernel.out;) {
        int block = lanes_of_block((kernel.out - channel) / LANES);
        if (block == 1) convolve_block<1>(kernel, from, weights, channel, finish);
        if (block == 2) convolve_block<2>(kernel, from, weights, channel, finish);
        if constexpr (MOST_BLOCK == 3)
            if (block == 3) convolve_block<3>(kernel, from, weights, channel, finish);
        weights += count * LANES * block;
        channel += LANES * block;
    }
}

}  // namespace uvc
