// Sparse symmetric systems that are factored already, for eight columns at a time.
#include "memory.h"
#include "uvcloth_measures.h"

namespace uvc {

namespace {

typedef double Doubles __attribute__((vector_size(8 * LANES)));

// Eight numbers, real or complex.
template <int PARTS> struct Numbers {
    Doubles parts[PARTS];
};

template <int PARTS> UVC_INLINE void subtract(Numbers<PARTS> &from, const double *factor, Numbers<PARTS> of) {
    if constexpr (PARTS == 1) {
        from.parts[0] -= factor[0] * of.parts[0];
    } else {
        from.parts[0] -= factor[0] * of.parts[0] - factor[1] * of.parts[1];
        from.parts[1] -= factor[0] * of.parts[1] + factor[1] * of.parts[0];
    }
}

template <int PARTS> UVC_INLINE void divide(Numbers<PARTS> &numbers, const double *pivot) {
    if constexpr (PARTS == 1) {
        numbers.parts[0] *= 1.0 / pivot[0];
    } else {
        double share = 1.0 / (pivot[0] * pivot[0] + pivot[1] * pivot[1]);
        Doubles real = numbers.parts[0], imaginary = numbers.parts[1];
        numbers.parts[0] = share * (pivot[0] * real + pivot[1] * imaginary);
        numbers.parts[1] = share * (pivot[0] * imaginary - pivot[1] * real);
    }
}

template <int PARTS> void solve(const uvc_factors &factors, double *columns, int count) {
    Arena arena;
    int size = factors.size;
    Array<Numbers<PARTS>> x = arena.take<Numbers<PARTS>>(size);
    for (int first = 0; first < count; first += LANES) {
        size_t bytes = sizeof(double) * (size_t)least(LANES, count - first);
        auto place = [&](int row, int part) { return columns + (int64_t)(row * PARTS + part) * count + first; };
        for (int row = 0; row < size; row++)
            for (int part = 0; part < PARTS; part++) memcpy(&x.at(row).parts[part], place(row, part), bytes);
        for (int k = 0; k < size; k++) {
            Numbers<PARTS> here = x.at(k);
            for (int j = factors.starts[k]; j < factors.starts[k + 1]; j++)
                subtract(x.at(factors.rows[j]), factors.values + PARTS * (int64_t)j, here);
        }
        for (int k = size - 1; k >= 0; k--) {
            Numbers<PARTS> here = x.at(k);
            divide(here, factors.pivots + PARTS * (int64_t)k);
            for (int j = factors.starts[k]; j < factors.starts[k + 1]; j++)
                subtract(here, factors.values + PARTS * (int64_t)j, x.at(factors.rows[j]));
            x.at(k) = here;
        }
        for (int row = 0; row < size; row++)
            for (int part = 0; part < PARTS; part++) memcpy(place(row, part), &x.at(row).parts[part], bytes);
    }
}

}  // namespace

}  // namespace uvc

extern "C" {

void uvc_solve_columns(const uvc_factors *factors, double *columns, int count) {
    if (factors->parts == 1)
        uvc::solve<1>(*factors, columns, count);
    else
        uvc::solve<2>(*factors, columns, count);
}

}  // extern "C"
