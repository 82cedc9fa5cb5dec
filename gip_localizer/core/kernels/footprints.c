// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0
//
// Means of 8-bit images over footprints.

#ifdef __SSSE3__
#include <tmmintrin.h>
#endif

#include "kernels.h"

#define BLOCK 16  // pixels that are read at once; as in library.py

// Σ weights * pixels over blocks, weights up to 64 (two products must fit into 16 bits); compilers
// make three times as many instructions of the plain loop
#ifdef __SSSE3__
UNROLLED int32_t weighted_sum(
    const uint8_t *image, const int32_t *starts, const uint8_t *weights, int32_t blocks)
{
    const __m128i one = _mm_set1_epi16(1);
    __m128i sums = _mm_setzero_si128();
    for (int32_t block = 0; block < blocks; ++block) {
        const __m128i pixels = _mm_loadu_si128((const __m128i *)(image + starts[block]));
        const __m128i shares = _mm_loadu_si128((const __m128i *)(weights + BLOCK * block));
        sums = _mm_add_epi32(sums, _mm_madd_epi16(_mm_maddubs_epi16(pixels, shares), one));
    }
    sums = _mm_add_epi32(sums, _mm_srli_si128(sums, 8));
    sums = _mm_add_epi32(sums, _mm_srli_si128(sums, 4));
    return _mm_cvtsi128_si32(sums);
}
#else
UNROLLED int32_t weighted_sum(
    const uint8_t *image, const int32_t *starts, const uint8_t *weights, int32_t blocks)
{
    int32_t sum = 0;
    for (int32_t block = 0; block < blocks; ++block)
        for (int pixel = 0; pixel < BLOCK; ++pixel)
            sum += image[starts[block] + pixel] * weights[BLOCK * block + pixel];
    return sum;
}
#endif

// means[cells[k]] = factors[k] * Σ weights * pixels, cells in groups of equally many blocks, so
// that the processor foresees where each cell ends
FOR_EACH_PROCESSOR
void footprint_means(
    const uint8_t *image, ptrdiff_t groups, const int32_t *cells_of_group,
    const int32_t *blocks_per_cell, const int32_t *starts, const uint8_t *weights,
    const int32_t *cells, const float *factors, float *means)
{
    for (ptrdiff_t group = 0; group < groups; ++group) {
        const int32_t blocks = blocks_per_cell[group];
        for (int32_t k = 0; k < cells_of_group[group]; ++k) {
            means[*cells++] = *factors++ * (float)weighted_sum(image, starts, weights, blocks);
            starts += blocks;
            weights += BLOCK * (ptrdiff_t)blocks;
        }
    }
}
