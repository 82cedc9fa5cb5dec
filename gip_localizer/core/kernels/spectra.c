// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0
//
// What is done to complex planes between transforms; complex numbers are two floats side by side.

#include "kernels.h"

// Clang has no __builtin_shuffle, GCC before 12 no other
#ifdef __clang__
#define SHUFFLED(lanes, ...) __builtin_shufflevector(lanes, lanes, __VA_ARGS__)
#else
#define SHUFFLED(lanes, ...) __builtin_shuffle(lanes, (Truths){__VA_ARGS__})
#endif
#define REAL 0, 0, 2, 2, 4, 4, 6, 6
#define IMAG 1, 1, 3, 3, 5, 5, 7, 7
#define SWAPPED 1, 0, 3, 2, 5, 4, 7, 6

// out[r][c] = first[r][c] + i second[r][c] of two real planes, `out_step` floats from row to row
FOR_EACH_PROCESSOR
void pair_planes(
    const Planes *pair, ptrdiff_t rows, ptrdiff_t cols, float *restrict out, ptrdiff_t out_step)
{
    for (ptrdiff_t r = 0; r < rows; ++r, out += out_step) {
        const float *first = pair->first + r * pair->row_step;
        const float *second = first + pair->plane_step;
        for (ptrdiff_t c = 0; c < cols; ++c) {
            out[2 * c] = first[c];
            out[2 * c + 1] = second[c];
        }
    }
}

// sums[n] = Σ left[k][n] * right[k][n] over the pairs k; sums may be one of the planes
FOR_EACH_PROCESSOR
void sum_complex_products(
    const float *const *left, const float *const *right, ptrdiff_t pairs, ptrdiff_t size,
    float *sums)
{
    const Lanes sign = {-1, 1, -1, 1, -1, 1, -1, 1};
    ptrdiff_t n = 0;
    for (; n + LANES <= 2 * size; n += LANES) {
        Lanes straight = {0}, crossed = {0};
        for (ptrdiff_t k = 0; k < pairs; ++k) {
            const Lanes a = lanes_at(left[k] + n), b = lanes_at(right[k] + n);
            straight += a * SHUFFLED(b, REAL);
            crossed += SHUFFLED(a, SWAPPED) * SHUFFLED(b, IMAG);
        }
        const Lanes sum = straight + sign * crossed;
        __builtin_memcpy(sums + n, &sum, sizeof sum);
    }
    for (; n < 2 * size; n += 2) {
        float re = 0.0f, im = 0.0f;
        for (ptrdiff_t k = 0; k < pairs; ++k) {
            const float *a = left[k] + n, *b = right[k] + n;
            re += a[0] * b[0] - a[1] * b[1];
            im += a[0] * b[1] + a[1] * b[0];
        }
        sums[n] = re;
        sums[n + 1] = im;
    }
}
