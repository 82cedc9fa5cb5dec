// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0
//
// A view against a window of the map, turned by several yaws, over few translations.

#include "kernels.h"

typedef struct {
    Planes templates;  // as `turn_little` takes them
    ptrdiff_t count, rows, cols;
    Planes fields;
    const int32_t *pairs;  // of template and field, term by term
    const int32_t *pairs_of_term;
    ptrdiff_t terms;
    ptrdiff_t totals;  // of how many templates the sums are wanted
} Compared;

static float sum_of(const float *values, ptrdiff_t step, ptrdiff_t rows, ptrdiff_t cols)
{
    double sum = 0.0;
    for (ptrdiff_t r = 0; r < rows; ++r, values += step) {
        Lanes lanes = {0};
        float rest = 0.0f;
        ptrdiff_t c = 0;
        for (; c + LANES <= cols; c += LANES)
            lanes += lanes_at(values + c);
        for (; c < cols; ++c)
            rest += values[c];
        for (int lane = 0; lane < LANES; ++lane)
            rest += lanes[lane];
        sum += rest;
    }
    return (float)sum;
}

// Of every yaw: where they are not there yet, the templates turned into its room (rows, cols), and
// their sums (yaws, totals); and the terms (yaws, terms, n_x, n_y) of its translations.
void compare_turned(
    const Compared *what, ptrdiff_t yaws, const double *turns, const uint8_t *turned,
    const Planes *rooms, ptrdiff_t rows, ptrdiff_t cols, float *totals, ptrdiff_t first_x,
    ptrdiff_t first_y, ptrdiff_t n_x, ptrdiff_t n_y, float *sums)
{
    for (ptrdiff_t yaw = 0; yaw < yaws; ++yaw, totals += what->totals) {
        const Planes *room = rooms + yaw;
        if (!turned[yaw]) {
            turn_little(&what->templates, what->rows, what->cols, turns + 6 * yaw, room,
                        what->count, rows, cols);
            for (ptrdiff_t n = 0; n < what->totals; ++n)
                totals[n] = sum_of(room->first + n * room->plane_step, room->row_step, rows, cols);
        }
        const int32_t *pairs = what->pairs;
        for (ptrdiff_t term = 0; term < what->terms; ++term, sums += n_x * n_y) {
            correlate_few(room, &what->fields, pairs, what->pairs_of_term[term], rows, cols,
                          first_x, first_y, n_x, n_y, sums);
            pairs += 2 * what->pairs_of_term[term];
        }
    }
}
