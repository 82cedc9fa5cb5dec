// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0
//
// Sums of products of templates and fields over few translations.

#include "kernels.h"

#define MOST_X 3  // translations that share what is read
#define MOST_Y 3
#define ROWS_AT_ONCE 64  // whose products are summed in float32

// The first of as even parts as can be of which none is larger than `most`
static inline ptrdiff_t even_share(ptrdiff_t count, ptrdiff_t most)
{
    const ptrdiff_t parts = (count + most - 1) / most;
    return (count + parts - 1) / parts;
}

// Sums of one block: LANES of them, in one or two sets that do not wait for each other, and those
// of the columns that are left
typedef struct {
    Lanes lanes[2][MOST_X][MOST_Y];
    float rest[MOST_X][MOST_Y];
} Block;

// sums[x][y] += Σ template[r - x][c] * field[r][c + y] over the columns of one row r; n_x, n_y and
// sets are constants
UNROLLED void row_products(
    const float *template, ptrdiff_t template_step, const float *field, ptrdiff_t cols,
    int n_x, int n_y, int sets, int first_x, Block *sums)
{
    ptrdiff_t col = 0;
    for (; col + sets * LANES <= cols; col += sets * LANES)
        for (int set = 0; set < sets; ++set) {
            const ptrdiff_t c = col + set * LANES;
            Lanes met[MOST_Y];
            for (int y = 0; y < n_y; ++y)
                met[y] = lanes_at(field + c + y);
            for (int x = 0; x < n_x; ++x) {
                const Lanes values = lanes_at(template - x * template_step + c);
                for (int y = 0; y < n_y; ++y)
                    sums->lanes[set][first_x + x][y] += values * met[y];
            }
        }
    for (; col < cols; ++col)
        for (int y = 0; y < n_y; ++y)
            for (int x = 0; x < n_x; ++x)
                sums->rest[first_x + x][y] += field[col + y] * template[col - x * template_step];
}

// sums[x * step + y] = Σ over pairs, rows and columns, in pieces of rows so that float32 does
UNROLLED void block_of_sums(
    Planes templates, Planes fields, const int32_t *pairs, ptrdiff_t n_pairs, ptrdiff_t rows,
    ptrdiff_t cols, int n_x, int n_y, float *sums, ptrdiff_t step)
{
    const ptrdiff_t down = templates.row_step, fields_down = fields.row_step;
    const int sets = n_x * n_y <= 4 ? 2 : 1;
    double total[MOST_X][MOST_Y] = {{0}};
    for (ptrdiff_t first = 0; first < rows; first += ROWS_AT_ONCE) {
        const ptrdiff_t last = first + ROWS_AT_ONCE < rows ? first + ROWS_AT_ONCE : rows;
        Block block = {0};
        for (ptrdiff_t n = 0; n < n_pairs; ++n) {
            const float *template = templates.first + pairs[2 * n] * templates.plane_step;
            const float *field = fields.first + pairs[2 * n + 1] * fields.plane_step;
            for (ptrdiff_t r = first + n_x - 1; r < last; ++r)
                row_products(template + r * down, down, field + r * fields_down, cols, n_x, n_y,
                             sets, 0, &block);
            for (int x = 0; x < n_x; ++x) {  // rows of the field that not all translations meet
                const ptrdiff_t above = first + n_x - 1 - x, below = last - x;
                for (ptrdiff_t r = first; r < last; ++r)
                    if (r < above || r >= below)
                        row_products(template + r * down, down, field + (r + x) * fields_down,
                                     cols, 1, n_y, sets, x, &block);
            }
        }
        for (int x = 0; x < n_x; ++x)
            for (int y = 0; y < n_y; ++y) {
                float sum = block.rest[x][y];
                for (int set = 0; set < sets; ++set)
                    for (int lane = 0; lane < LANES; ++lane)
                        sum += block.lanes[set][x][y][lane];
                total[x][y] += sum;
            }
    }
    for (int x = 0; x < n_x; ++x)
        for (int y = 0; y < n_y; ++y)
            sums[x * step + y] = (float)total[x][y];
}

// sums[x * n_y + y] = Σ over pairs of template[r][c] * field[first_x + x + r][first_y + y + c]
FOR_EACH_PROCESSOR
void correlate_few(
    const Planes *templates, const Planes *fields, const int32_t *pairs, ptrdiff_t n_pairs,
    ptrdiff_t rows, ptrdiff_t cols, ptrdiff_t first_x, ptrdiff_t first_y, ptrdiff_t n_x,
    ptrdiff_t n_y, float *sums)
{
    for (ptrdiff_t x = 0, xs; x < n_x; x += xs)
        for (ptrdiff_t y = 0, ys; y < n_y; y += ys) {
            xs = even_share(n_x - x, MOST_X);
            ys = even_share(n_y - y, MOST_Y);
            Planes there = *fields;
            there.first += (first_x + x) * fields->row_step + first_y + y;
#define OF(X, Y) case 8 * X + Y: \
            block_of_sums(*templates, there, pairs, n_pairs, rows, cols, X, Y, \
                          sums + x * n_y + y, n_y); \
            break;
            switch (8 * xs + ys) {
                OF(1, 1) OF(1, 2) OF(1, 3)
                OF(2, 1) OF(2, 2) OF(2, 3)
                OF(3, 1) OF(3, 2) OF(3, 3)
            }
#undef OF
        }
}
