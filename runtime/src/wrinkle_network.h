// The network of wrinkles: a small U-Net from maps of what is known of a surface to what is missing there.
#pragma once

#include "sections.h"
#include "tiles.h"

namespace uvc {

// Channels of the inputs, the last of which is 1 where there is cloth and 0 elsewhere, and of the displacements
// along u, v and the normal, each at the four quarters of a texel.
constexpr int INPUTS = 23, DISPLACEMENTS = 12;

constexpr int MOST_LEVELS = 6;

// A gain and an offset of each pixel and channel, side by side by pixels.
struct TexelGains {
    Array<float> gains, offsets;
};

// size: of the maps of inputs and displacements; each of the levels has half of that of the one before. shift,
// scale: (INPUTS) of inputs, which are then limited to `reach`. output: (DISPLACEMENTS) m. mean: of each pixel.
struct WrinkleNetwork {
    int size, levels;
    float reach;
    Array<float> shift, scale, output, mean;
    Kernel first, last, down[MOST_LEVELS], across[MOST_LEVELS], narrow[MOST_LEVELS], up[MOST_LEVELS];
    TexelGains here[MOST_LEVELS], end;
};

// Reads "wrinkles.shape": the size of the inputs' maps and the channels of each level; "wrinkles.reach",
// "wrinkles.shift", "wrinkles.scale", "wrinkles.output"; "wrinkles.mean" (size^2, DISPLACEMENTS);
// "wrinkles.weights" and "wrinkles.biases" of the kernels first, down, across, narrow, up and last, level by
// level: row by row and column by column, each channel in, each channel out; "wrinkles.gains" (T, 2) gain and
// offset of each pixel and channel on all levels, and at the end.
WrinkleNetwork read_wrinkle_network(const Sections &sections, Arena &arena, Failure &failure);

// Channels that the maps of inputs have in memory.
constexpr int INPUTS_ROOM = 24;

// Makes displacements (size^2, DISPLACEMENTS), m, of maps of INPUTS_ROOM channels, which change.
void run(const WrinkleNetwork &network, FeatureMaps inputs, float *displacements, Arena &work);

}  // namespace uvc
