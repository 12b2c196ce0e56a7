/*
 * The curve is one of Hilbert's: it passes through every cell once, from neighbour to neighbour, and all
 * cells of an octant before the next. The same places come from every instruction set.
 */
#include <string.h>

#include "bvh/kernel.h"
#include "check.h"
#include "random.h"

/** Place along the curve of one cell, by a kernel that takes many. */
static uint64_t key_of(const qm_kernel *kernel, uint32_t x, uint32_t y, uint32_t z, int bits)
{
    qm_hilbert_cells cells = {{{x}, {y}, {z}}};
    uint64_t keys[QM_HILBERT_BATCH];
    kernel->hilbert_keys(&cells, 1, bits, keys);
    return keys[0];
}

static int distance(uint32_t a, uint32_t b)
{
    return a > b ? (int)(a - b) : (int)(b - a);
}

static void it_goes_from_neighbour_to_neighbour(void **state)
{
    (void)state;
    for (int bits = 1; bits <= 5; bits++) {
        uint32_t side = 1u << bits, count = side * side * side;
        uint32_t *cell = malloc(count * sizeof *cell);
        memset(cell, 0xff, count * sizeof *cell);
        for (uint32_t i = 0; i < count; i++) {
            uint64_t key = key_of(qm_kernel_get(), i % side, i / side % side, i / side / side, bits);
            assert_true(key < count);
            QM_CHECK(cell[key] == UINT32_MAX, "cells %u and %u of %d bits at one place", cell[key], i, bits);
            cell[key] = i;
        }
        for (uint32_t i = 1; i < count; i++) {
            uint32_t a = cell[i - 1], b = cell[i];
            int steps = distance(a % side, b % side) + distance(a / side % side, b / side % side) +
                        distance(a / side / side, b / side / side);
            QM_CHECK(steps == 1, "places %u and %u of %d bits are %d cells apart", i - 1, i, bits, steps);
        }
        free(cell);
    }
}

static void a_coarser_curve_has_the_leading_bits_of_a_finer_one(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    for (int i = 0; i < 20000; i++) {
        int bits = 1 + (int)qm_random_below(&random, QM_HILBERT_BITS);
        int shift = (int)qm_random_below(&random, (size_t)bits);
        uint32_t c[3];
        for (int k = 0; k < 3; k++)
            c[k] = (uint32_t)qm_random_below(&random, (size_t)1 << bits);
        uint64_t fine = key_of(qm_kernel_get(), c[0], c[1], c[2], bits);
        uint64_t coarse = key_of(qm_kernel_get(), c[0] >> shift, c[1] >> shift, c[2] >> shift, bits - shift);
        QM_CHECK(fine >> (3 * shift) == coarse, "seed %llu, %d and %d bits",
                 (unsigned long long)qm_check_seed(), bits, bits - shift);
    }
}

static void all_instruction_sets_agree(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 1);
    qm_hilbert_cells cells;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < QM_HILBERT_BATCH; i++)
            cells.axis[k][i] = (uint32_t)qm_random_below(&random, 1 << QM_HILBERT_BITS);
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        for (int count = 1; count <= QM_HILBERT_BATCH; count++) {
            uint64_t keys[QM_HILBERT_BATCH];
            (*kernel)->hilbert_keys(&cells, count, QM_HILBERT_BITS, keys);
            for (int i = 0; i < count; i++)
                assert_int_equal(keys[i], key_of(qm_kernel_get(), cells.axis[0][i], cells.axis[1][i],
                                                 cells.axis[2][i], QM_HILBERT_BITS));
        }
    }
}

/** By the formula, one coordinate at a time. */
static uint64_t slow_fine(double local)
{
    double place = (local + 1.0) * (1 << (QM_FINE_BITS - 1)), last = (1 << QM_FINE_BITS) - 1;
    return (uint64_t)(place < 0.0 ? 0.0 : place > last ? last : place);
}

static void vertices_become_whole_numbers(void **state)
{
    (void)state;
    enum { MOST = 11 };
    const double origin[3] = {0.25, -3.0, 1e3}, scale = 0.375;
    qm_random random = qm_random_make(qm_check_seed(), 2);
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        for (size_t count = 1; count <= MOST; count++) {
            double p[3 * MOST];
            uint64_t fine[MOST + 1];
            for (size_t i = 0; i < 3 * count; i++) /* some of them outside, a few on the border */
                p[i] = origin[i % 3] + (i % 7 == 0 ? 1.0 : qm_random_range(&random, -1.2, 1.2)) / scale;
            fine[count] = 77;
            (*kernel)->vertex_fine(origin, scale, p, count, fine);
            assert_int_equal(fine[count], 77);
            for (size_t i = 0; i < count; i++) {
                uint64_t sum = 0;
                for (size_t k = 0; k < 3; k++)
                    sum += slow_fine((p[3 * i + k] - origin[k]) * scale) << (k * QM_FINE_FIELD);
                QM_CHECK(fine[i] == sum, "%s: seed %llu, vertex %zu of %zu", (*kernel)->name,
                         (unsigned long long)qm_check_seed(), i, count);
            }
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_goes_from_neighbour_to_neighbour),
        cmocka_unit_test(a_coarser_curve_has_the_leading_bits_of_a_finer_one),
        cmocka_unit_test(all_instruction_sets_agree),
        cmocka_unit_test(vertices_become_whole_numbers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
