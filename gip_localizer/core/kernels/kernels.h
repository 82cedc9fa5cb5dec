// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0
//
// What the kernels have in common, and what they call of each other.

#ifndef GIP_LOCALIZER_KERNELS_H
#define GIP_LOCALIZER_KERNELS_H

#include <stddef.h>
#include <stdint.h>

// One build for all x86-64 processors: the version to run is chosen when it is loaded.
#if defined(__x86_64__) && defined(__GLIBC__)
#define FOR_EACH_PROCESSOR __attribute__((target_clones("fma", "default")))
#else
#define FOR_EACH_PROCESSOR
#endif
#define UNROLLED static inline __attribute__((always_inline))

// (count, rows, cols) floats; steps in floats from plane to plane and from row to row
typedef struct {
    float *first;
    ptrdiff_t plane_step, row_step;
} Planes;

// Eight floats at once, in the vector types of GCC and Clang
#define LANES 8
typedef float Lanes __attribute__((vector_size(4 * LANES)));
typedef int32_t Truths __attribute__((vector_size(4 * LANES)));

UNROLLED Lanes lanes_at(const float *values)
{
    Lanes lanes;
    __builtin_memcpy(&lanes, values, sizeof lanes);
    return lanes;
}

// correlate.c
void correlate_few(
    const Planes *templates, const Planes *fields, const int32_t *pairs, ptrdiff_t n_pairs,
    ptrdiff_t rows, ptrdiff_t cols, ptrdiff_t first_x, ptrdiff_t first_y, ptrdiff_t n_x,
    ptrdiff_t n_y, float *sums);

// turn.c
void turn_little(
    const Planes *planes, ptrdiff_t rows, ptrdiff_t cols, const double *turn, const Planes *out,
    ptrdiff_t count, ptrdiff_t out_rows, ptrdiff_t out_cols);

#endif
