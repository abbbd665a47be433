/* Entropy coding of whole numbers, as the shipped motions and rollouts are stored. */
#ifndef UVCLOTH_CODEC_H
#define UVCLOTH_CODEC_H

#include "uvcloth.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Encodes values (times, waves, columns), rows of the last axis first, into `code`, which has `room` bytes.
 * Columns go together by threes. A value has at most 24 binary digits without its sign; each of them, and two
 * decisions more, takes up to eight bytes. Returns the number of bytes, -1 if there is no memory, or -2 for a
 * shape, stride or value that cannot be coded, or too little room. */
UVC_API int64_t uvc_encode_numbers(const int64_t *values, int64_t times, int64_t waves, int64_t columns,
                                   int64_t stride, uint8_t *code, int64_t room);

/* Decodes `size` bytes of code into values (times, waves, columns). Any bytes give some numbers: callers keep
 * a checksum of theirs. Returns 0, or -1 and -2 as above. */
UVC_API int64_t uvc_decode_numbers(const uint8_t *code, int64_t size, int64_t *values, int64_t times,
                                   int64_t waves, int64_t columns, int64_t stride);

/* Encodes the numbers (rows, columns) of a section of a baked outfit, into `code`, which has `room` bytes.
 * Returns the bytes that it takes; if these are more, only what fits is written. */
UVC_API int64_t uvc_encode_section(const int32_t *numbers, int rows, int columns, uint8_t *code,
                                   int64_t room);

/* Decodes so many bytes into numbers (rows, columns), of zeros before. Returns 1, or 0 if the code ends before
 * them; any bytes are safe. */
UVC_API int uvc_decode_section(const uint8_t *code, int64_t size, int32_t *numbers, int rows, int columns);

#ifdef __cplusplus
}
#endif

#endif
