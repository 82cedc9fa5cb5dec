// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0
//
// Planes of floats, and eight floats at once in the vector types of GCC and Clang.

#ifndef GIP_LOCALIZER_LANES_H
#define GIP_LOCALIZER_LANES_H

#include <stddef.h>
#include <stdint.h>

// One build for all x86-64 processors: the version to run is chosen when it is loaded.
#if defined(__x86_64__) && defined(__GLIBC__)
#define FOR_EACH_PROCESSOR __attribute__((target_clones("fma", "default")))
#else
#define FOR_EACH_PROCESSOR
#endif
#define UNROLLED static inline __attribute__((always_inline))

#define LANES 8

typedef float Lanes __attribute__((vector_size(4 * LANES)));
typedef int32_t Truths __attribute__((vector_size(4 * LANES)));

// (count, rows, cols) floats; steps in floats from plane to plane and from row to row
typedef struct {
    float *first;
    ptrdiff_t plane_step, row_step;
} Planes;

UNROLLED Lanes lanes_at(const float *values)
{
    Lanes lanes;
    __builtin_memcpy(&lanes, values, sizeof lanes);
    return lanes;
}

#endif
