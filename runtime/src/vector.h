// Vectors of three numbers, and eight numbers side by side: the arithmetic of the whole runtime.
#pragma once

#include <stddef.h>
#include <stdint.h>

#define UVC_INLINE static inline __attribute__((always_inline))
#define UVC_MEMBER inline __attribute__((always_inline))

namespace uvc {

// Eight numbers that are computed together. Compilers split them where registers are shorter.
typedef float Lanes __attribute__((vector_size(32)));
typedef int32_t LaneMask __attribute__((vector_size(32)));

constexpr int LANES = 8;

// Four numbers in one register everywhere: half of these lanes, or a vector of three and a 0.
typedef float Four __attribute__((vector_size(16)));
typedef int32_t FourMask __attribute__((vector_size(16)));

// A squared length that is negligible beside any other, so that divisions by it are defined.
constexpr float TINY = 1e-20f;

UVC_INLINE float root(float a) { return __builtin_sqrtf(a); }
UVC_INLINE float absolute(float a) { return __builtin_fabsf(a); }
// Of two numbers of which the second is NaN, the first: limits come first where the result becomes an integer.
UVC_INLINE float least(float a, float b) { return b < a ? b : a; }
UVC_INLINE float most(float a, float b) { return b > a ? b : a; }
UVC_INLINE float choose(bool condition, float a, float b) { return condition ? a : b; }

UVC_INLINE Lanes root(Lanes a) {
    Lanes r;
    for (int k = 0; k < LANES; k++) r[k] = __builtin_sqrtf(a[k]);
    return r;
}
UVC_INLINE Four least(Four a, Four b) { return b < a ? b : a; }
UVC_INLINE Four most(Four a, Four b) { return b > a ? b : a; }

// Comparisons, and choices by them. Where registers are shorter than eight numbers, gcc compares and chooses
// one number at a time, unless it is done by halves here.
#if defined(__AVX__) || defined(__clang__)
UVC_INLINE LaneMask is_below(Lanes a, Lanes b) { return a < b; }
UVC_INLINE LaneMask is_at_most(Lanes a, Lanes b) { return a <= b; }
UVC_INLINE LaneMask is_same(Lanes a, Lanes b) { return a == b; }
UVC_INLINE Lanes choose(LaneMask condition, Lanes a, Lanes b) { return condition ? a : b; }
UVC_INLINE Lanes least(Lanes a, Lanes b) { return choose(b < a, b, a); }
UVC_INLINE Lanes most(Lanes a, Lanes b) { return choose(b > a, b, a); }
#else
template <class To, class From> UVC_INLINE To same_bits(From from) {
    To to;
    __builtin_memcpy(&to, &from, sizeof(to));
    return to;
}

template <class Whole> struct Halves {
    Whole first, second;
};

UVC_INLINE Lanes choose(LaneMask condition, Lanes a, Lanes b) {
    return same_bits<Lanes>((same_bits<LaneMask>(a) & condition) | (same_bits<LaneMask>(b) & ~condition));
}
UVC_INLINE LaneMask is_below(Lanes a, Lanes b) {
    auto one = same_bits<Halves<Four>>(a), other = same_bits<Halves<Four>>(b);
    return same_bits<LaneMask>(Halves<FourMask>{one.first < other.first, one.second < other.second});
}
UVC_INLINE LaneMask is_at_most(Lanes a, Lanes b) {
    auto one = same_bits<Halves<Four>>(a), other = same_bits<Halves<Four>>(b);
    return same_bits<LaneMask>(Halves<FourMask>{one.first <= other.first, one.second <= other.second});
}
UVC_INLINE LaneMask is_same(Lanes a, Lanes b) {
    auto one = same_bits<Halves<Four>>(a), other = same_bits<Halves<Four>>(b);
    return same_bits<LaneMask>(Halves<FourMask>{one.first == other.first, one.second == other.second});
}
UVC_INLINE Lanes least(Lanes a, Lanes b) {
    auto one = same_bits<Halves<Four>>(a), other = same_bits<Halves<Four>>(b);
    return same_bits<Lanes>(Halves<Four>{least(one.first, other.first), least(one.second, other.second)});
}
UVC_INLINE Lanes most(Lanes a, Lanes b) {
    auto one = same_bits<Halves<Four>>(a), other = same_bits<Halves<Four>>(b);
    return same_bits<Lanes>(Halves<Four>{most(one.first, other.first), most(one.second, other.second)});
}
#endif
UVC_INLINE Lanes absolute(Lanes a) { return choose(is_below(a, Lanes{}), -a, a); }
UVC_INLINE Lanes most(Lanes a, float b) { return most(a, Lanes{} + b); }
UVC_INLINE Lanes least(float a, Lanes b) { return least(Lanes{} + a, b); }

UVC_INLINE int least(int a, int b) { return b < a ? b : a; }
UVC_INLINE int most(int a, int b) { return b > a ? b : a; }
UVC_INLINE float clamp(float a, float low, float high) { return least(most(a, low), high); }
UVC_INLINE Lanes clamp(Lanes a, float low, float high) { return least(most(a, low), Lanes{} + high); }

// Whether a number is neither infinite nor NaN. By its bits: fast arithmetic assumes that all are.
UVC_INLINE bool is_finite(float a) {
    uint32_t bits;
    __builtin_memcpy(&bits, &a, 4);
    return (bits & 0x7f800000u) != 0x7f800000u;
}
UVC_INLINE bool is_finite(double a) {
    uint64_t bits;
    __builtin_memcpy(&bits, &a, 8);
    return (bits & 0x7ff0000000000000ull) != 0x7ff0000000000000ull;
}

template <class F> struct Vector {
    F x, y, z;
};
typedef Vector<float> Vec;
typedef Vector<double> Vec64;

template <class F> UVC_INLINE Vector<F> operator+(Vector<F> a, Vector<F> b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class F> UVC_INLINE Vector<F> operator-(Vector<F> a, Vector<F> b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class F> UVC_INLINE Vector<F> operator-(Vector<F> a) { return {-a.x, -a.y, -a.z}; }
template <class F> UVC_INLINE Vector<F> operator*(F s, Vector<F> a) { return {s * a.x, s * a.y, s * a.z}; }
template <class F> UVC_INLINE void operator+=(Vector<F> &a, Vector<F> b) { a = a + b; }
template <class F> UVC_INLINE void operator-=(Vector<F> &a, Vector<F> b) { a = a - b; }
template <class F> UVC_INLINE F dot(Vector<F> a, Vector<F> b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <class F> UVC_INLINE Vector<F> cross(Vector<F> a, Vector<F> b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
UVC_INLINE float length(Vec a) { return root(dot(a, a)); }
UVC_INLINE Vec unit(Vec a) { return (1.0f / (length(a) + TINY)) * a; }

UVC_INLINE Vec between(Vec start, Vec end, float share) { return (1.0f - share) * start + share * end; }
UVC_INLINE Vec64 wide(Vec a) { return {a.x, a.y, a.z}; }
UVC_INLINE Vec narrow(Vec64 a) { return {(float)a.x, (float)a.y, (float)a.z}; }
UVC_INLINE float axis(Vec a, int j) { return j == 0 ? a.x : j == 1 ? a.y : a.z; }

// Angle of (x, y) as of atan2, to within 1e-6 radians, in arithmetic that runs in lanes.
// The polynomial is atan(x) / x in powers of x^2 on [0, 1] with the least largest error.
template <class F> UVC_INLINE F angle(F y, F x) {
    F high = most(absolute(x), absolute(y)) + TINY;
    F ratio = least(absolute(x), absolute(y)) / high;
    F s = ratio * ratio;
    F arc = 0.0796236723f + s * (-0.0336042187f + s * 0.0068117923f);
    arc = ratio * (0.999996112f + s * (-0.333173681f + s * (0.198078157f + s * (-0.132333423f + s * arc))));
    arc = choose(absolute(y) > absolute(x), 1.57079632679f - arc, arc);
    arc = choose(x < 0.0f, 3.14159265359f - arc, arc);
    return choose(y < 0.0f, -arc, arc);
}

}  // namespace uvc
