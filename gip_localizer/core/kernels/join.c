// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0
//
// Cells joined into larger ones, smoothed or not.

#include "kernels.h"

// sums[c] = Σ taps[t] * values[t * step + c]
UNROLLED void sum_steps(
    const float *values, ptrdiff_t step, ptrdiff_t count, const float *taps, ptrdiff_t n_taps,
    float *restrict sums)
{
    __builtin_memset(sums, 0, (size_t)count * sizeof *sums);
    for (ptrdiff_t t = 0; t < n_taps; ++t, values += step)
        for (ptrdiff_t c = 0; c < count; ++c)
            sums[c] += taps[t] * values[c];
}

static inline ptrdiff_t clamped(ptrdiff_t value, ptrdiff_t low, ptrdiff_t high)
{
    return value < low ? low : value > high ? high : value;
}

// out[i][j] = Σ taps[a] taps[b] * plane[factor i + a - top][factor j + b - left]; beyond the plane
// is its edge (replicate) or 0. `room` holds twice the width of all windows side by side.
FOR_EACH_PROCESSOR
void join_cells(
    const float *plane, ptrdiff_t step, ptrdiff_t rows, ptrdiff_t cols, ptrdiff_t top,
    ptrdiff_t left, const float *taps, ptrdiff_t n_taps, ptrdiff_t factor, int replicate,
    float *restrict room, float *restrict out, ptrdiff_t out_rows, ptrdiff_t out_cols)
{
    const ptrdiff_t width = factor * (out_cols - 1) + n_taps;
    const ptrdiff_t begin = clamped(left, 0, width), end = clamped(left + cols, begin, width);
    float *restrict down = room, *restrict across = room + width;
    for (ptrdiff_t i = 0; i < out_rows; ++i, out += out_cols) {
        const ptrdiff_t first = factor * i - top;
        const float *values = plane + begin - left;
        if (first >= 0 && first + n_taps <= rows) {
            sum_steps(values + first * step, step, end - begin, taps, n_taps, down + begin);
        } else {
            __builtin_memset(down + begin, 0, (size_t)(end - begin) * sizeof *down);
            for (ptrdiff_t t = 0; t < n_taps; ++t) {
                const ptrdiff_t row = clamped(first + t, 0, rows - 1);
                if (row == first + t || replicate)
                    for (ptrdiff_t c = begin; c < end; ++c)
                        down[c] += taps[t] * values[row * step + c - begin];
            }
        }
        for (ptrdiff_t c = 0; c < begin; ++c)
            down[c] = replicate ? down[begin] : 0.0f;
        for (ptrdiff_t c = end; c < width; ++c)
            down[c] = replicate ? down[end - 1] : 0.0f;
        sum_steps(down, 1, width - n_taps + 1, taps, n_taps, across);
        for (ptrdiff_t j = 0; j < out_cols; ++j)
            out[j] = across[factor * j];
    }
}
