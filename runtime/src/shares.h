// Shares of several things that make one whole.
#pragma once

#include "sections.h"

namespace uvc {

// Reads shares in rows from `starts` on, which sum to 1 in each row: the section has all but the last of a row.
Array<float> read_shares(const Sections &sections, const char *name, Array<int32_t> starts, Arena &arena,
                         Failure &failure);

}  // namespace uvc
