// What the processor can, to choose between the libraries.
#include "uvcloth_codec.h"

#if defined(__x86_64__)
#include <cpuid.h>

namespace {

// Whether the operating system keeps the upper halves of wide registers when it changes threads.
bool keeps_wide_registers() {
    uint32_t low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (low & 6) == 6;
}

}  // namespace

int uvc_has_v3(void) {
    constexpr uint32_t FMA = 1u << 12, MOVBE = 1u << 22, OSXSAVE = 1u << 27, AVX = 1u << 28, F16C = 1u << 29;
    constexpr uint32_t BMI = 1u << 3, AVX2 = 1u << 5, BMI2 = 1u << 8, LZCNT = 1u << 5;
    constexpr uint32_t FIRST = FMA | MOVBE | OSXSAVE | AVX | F16C, SEVENTH = BMI | AVX2 | BMI2;
    uint32_t a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & FIRST) != FIRST || !keeps_wide_registers()) return 0;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || (b & SEVENTH) != SEVENTH) return 0;
    return __get_cpuid(0x80000001u, &a, &b, &c, &d) && (c & LZCNT);
}

#else

int uvc_has_v3(void) { return 0; }

#endif
