// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0
//
// A plane turned by little, bilinear.

#include "kernels.h"

// Cells with 32 bits behind the point
static inline int64_t fixed(double cells) { return (int64_t)(cells * 0x1p32); }
static inline ptrdiff_t whole(int64_t cells) { return (ptrdiff_t)(cells >> 32); }
static inline float part(int64_t cells) { return (float)(uint32_t)cells * 0x1p-32f; }

UNROLLED Lanes positive_part(Lanes values)
{
    return (Lanes)((Truths)values & (values > 0.0f));
}

UNROLLED Lanes right_of(const float *first, Lanes right)
{
    const Lanes values = lanes_at(first);
    return values + right * (lanes_at(first + 1) - values);
}

// Values `right` of the cells from `first` on, and `down`, by less than a row or (if `steep`) two
UNROLLED Lanes between(const float *first, ptrdiff_t step, Lanes right, Lanes down, int steep)
{
    const Lanes top = right_of(first, right), middle = right_of(first + step, right);
    if (!steep)
        return top + down * (middle - top);
    const Lanes bottom = right_of(first + 2 * step, right);
    return middle + positive_part(1.0f - down) * (top - middle)
        + positive_part(down - 1.0f) * (bottom - middle);
}

static __attribute__((noinline)) void turn_one_by_one(
    const float *plane, ptrdiff_t step, int64_t row, int64_t col, int64_t row_step,
    int64_t col_step, float *out)
{
    for (int lane = 0; lane < LANES; ++lane, row += row_step, col += col_step) {
        const float down = part(row), right = part(col);
        const float *at = plane + whole(row) * step + whole(col);
        const float above = at[0] + right * (at[1] - at[0]);
        const float below = at[step] + right * (at[step + 1] - at[step]);
        out[lane] = above + down * (below - above);
    }
}

typedef struct {
    Lanes wider, falling;  // of neighbours, from the first of them on
    int64_t row_step, col_step, rows_back;  // per cell; from the highest neighbour to the first
} Slope;

// One row of a turned plane, from a place (row of its highest neighbour, col) of the plane on
UNROLLED void turn_row(
    const float *plane, ptrdiff_t step, ptrdiff_t rows, ptrdiff_t cols, const Slope *slope,
    int64_t row, int64_t col, float *out, ptrdiff_t out_cols)
{
    const Lanes wider = slope->wider, falling = slope->falling;
    const float steepest = falling[0] + falling[LANES - 1];
    for (ptrdiff_t c = 0; c < out_cols; c += LANES) {
        float room[LANES], *to = c + LANES <= out_cols ? out + c : room;
        const float last = part(col) + wider[LANES - 1];
        if (whole(col) <= -2 - LANES || whole(col) >= cols || whole(row) <= -4
                || whole(row) >= rows) {
            __builtin_memset(to, 0, sizeof room);
        } else if (last < 0.0f || last >= 1.0f) {
            turn_one_by_one(plane, step, row + slope->rows_back, col, slope->row_step,
                            slope->col_step, to);
        } else {
            const Lanes values = between(
                plane + whole(row) * step + whole(col), step, part(col) + wider,
                part(row) + falling, part(row) + steepest >= 1.0f);
            __builtin_memcpy(to, &values, sizeof values);
        }
        if (to == room)
            for (int lane = 0; c + lane < out_cols; ++lane)
                out[c + lane] = room[lane];
        row += LANES * slope->row_step;
        col += LANES * slope->col_step;
    }
}

// out[n][r][c] = plane n at column turn[0] c + turn[1] r + turn[2] and row turn[3] c + turn[4] r +
// turn[5], bilinear. For turns by so little that LANES neighbours in a row lie on three rows of
// the planes, which have LANES + 2 zeros on every side.
FOR_EACH_PROCESSOR
void turn_little(
    const Planes *planes, ptrdiff_t rows, ptrdiff_t cols, const double *turn, const Planes *out,
    ptrdiff_t count, ptrdiff_t out_rows, ptrdiff_t out_cols)
{
    const double highest = turn[3] < 0.0 ? (LANES - 1) * turn[3] : 0.0;
    Slope slope = {.row_step = fixed(turn[3]), .col_step = fixed(turn[0]),
                   .rows_back = -fixed(highest)};
    for (int lane = 0; lane < LANES; ++lane) {
        slope.wider[lane] = (float)((turn[0] - 1.0) * lane);
        slope.falling[lane] = (float)(turn[3] * lane - highest);
    }
    for (ptrdiff_t n = 0; n < count; ++n)
        for (ptrdiff_t r = 0; r < out_rows; ++r)
            turn_row(planes->first + n * planes->plane_step, planes->row_step, rows, cols, &slope,
                     fixed(turn[4] * (double)r + turn[5] + highest),
                     fixed(turn[1] * (double)r + turn[2]),
                     out->first + n * out->plane_step + r * out->row_step, out_cols);
}
