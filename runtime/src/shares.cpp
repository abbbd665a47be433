#include "shares.h"

namespace uvc {

Array<float> read_shares(const Sections &sections, const char *name, Array<int32_t> starts, Arena &arena,
                         Failure &failure) {
    Arena work;
    if (failure.failed) return {};
    int rows = starts.size - 1, total = starts[rows];
    for (int row = 0; row < rows; row++)
        if (starts[row] == starts[row + 1]) failure.say("section %s of the outfit has an empty row", name);
    Array<float> stored = read_floats(sections, name, total - rows, 1, work, failure);
    if (failure.failed) return {};
    Array<float> shares = arena.take<float>(total);
    const float *next = stored.data;
    for (int row = 0; row < rows; row++) {
        float left = 1;
        int last = starts[row + 1] - 1;
        for (int k = starts[row]; k < last; k++) {
            shares[k] = *next++;
            left -= shares[k];
        }
        shares[last] = left;
    }
    return shares;
}

}  // namespace uvc
