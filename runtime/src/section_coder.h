// Numbers of a section as code: each is predicted from those before it, and what is left goes through an
// adaptive arithmetic coder that is fast to decode.
#pragma once

#include "memory.h"

namespace uvc {

// Decodes numbers in rows of so many columns. Returns whether they are all of the code; any bytes are safe.
bool decode_section(const uint8_t *code, size_t size, int columns, Array<int32_t> numbers);

}  // namespace uvc
