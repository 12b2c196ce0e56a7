/*
 * Regions beyond a limit: known ones, and what a dense subdivision of the source finds, whose cells have distances by the slow twin.
 */
#include <math.h>
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "failing_allocator.h"
#include "measured.h"
#include "shapes.h"
#include "slow_twin.h"

static qm_status measure_in(qm_context *ctx, const qm_mesh *a, const qm_mesh *b, qm_quad_reading quads,
                            double limit, int threads, qm_deviation *out)
{
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = quads;
    options.tolerance = 1e-6;
    options.piece_limit = 1 << 16;
    options.region_limit = limit;
    options.face_limit = 100;
    options.thread_count = threads;
    return qm_measured_deviation_in(ctx, a, b, &options, out);
}

static qm_deviation measure(const qm_mesh *a, const qm_mesh *b, qm_quad_reading quads, double limit)
{
    qm_context ctx = qm_context_make();
    qm_deviation out;
    assert_int_equal(measure_in(&ctx, a, b, quads, limit, 1, &out), QM_OK);
    return out;
}

/* ---- known regions ---- */

static void a_square_through_a_box_has_a_rim_and_a_core(void **state)
{
    (void)state;
    static const double corners[4][3] = {{-2, -2, 0}, {2, -2, 0}, {2, 2, 0}, {-2, 2, 0}};
    qm_mesh a = qm_shape_face(4, corners), b = qm_shape_cube(1.0);
    for (int reading = 0; reading < 2; reading++) {
        qm_deviation found = measure(&a, &b, (qm_quad_reading)reading, 0.5);
        assert_true(found.has_regions);
        assert_int_equal(found.region_count, 2);
        const qm_deviation_region *rim = &found.region[0], *core = &found.region[1];
        assert_true(rim->parts >= 1 && core->parts >= 1);
        qm_measured_holds(rim->area, 16 - 4 - 8 * 0.5 - 0.25 * 3.14159265358979323846, 0.1, "rim");
        qm_measured_holds(core->area, 1.0, 0.1, "core");
        qm_measured_holds(rim->max, sqrt(2.0), 0.3, "distance at the rim");
        qm_measured_holds(core->max, 1.0, 0.01, "distance at the core");
        assert_true(core->has_witness && fabs(core->from.position[0]) < 0.51);
        for (int k = 0; k < 2; k++) {
            assert_true(fabs(core->centroid[k]) < 0.05 && fabs(rim->centroid[k]) < 0.05);
            assert_true(core->box.min[k] <= -0.5 && core->box.max[k] >= 0.5 && core->box.max[k] < 0.6);
        }
        assert_int_equal(core->face_count, 1);
        assert_int_equal(found.region_face[core->first_face], 0);
        qm_measured_deviation_free(&found);
        found = measure(&a, &b, (qm_quad_reading)reading, 2.0);
        assert_true(found.has_regions && found.region_count == 0);
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Plates of many quads over a floor, each at a height of its own; those that do not share corners are apart. */
static void plates_are_regions_of_their_own(void **state)
{
    (void)state;
    static const double corners[4][3] = {{-9, -9, 0}, {9, -9, 0}, {9, 9, 0}, {-9, 9, 0}};
    static const double heights[] = {0.1, 0.3, 0.2, 0.4};
    qm_mesh b = qm_shape_face(4, corners), a = qm_shape_plane(6, heights[0]);
    for (int i = 1; i < 4; i++) {
        qm_mesh plate = qm_shape_plane(5 + i, heights[i]);
        const double shift[3] = {1.5 * i, 0, 0};
        qm_shape_move(&plate, 1.0, shift);
        qm_mesh both = qm_shape_joined(&a, &plate);
        qm_shape_free(&a);
        qm_shape_free(&plate);
        a = both;
    }
    qm_mesh soup =
        qm_shape_make(4 * a.face_count, a.face_count); /* the same, but no corner is shared by its index */
    for (size_t i = 0; i < 4 * a.face_count; i++) {
        memcpy(soup.positions + 3 * i, a.positions + 3 * (size_t)a.faces[i], 3 * sizeof *a.positions);
        soup.faces[i] = (uint32_t)i;
    }
    const qm_mesh *const sources[2] = {&a, &soup};
    for (int i = 0; i < 4; i++) {
        qm_deviation found = measure(sources[i / 2], &b, (qm_quad_reading)(i % 2), 0.15);
        assert_int_equal(found.region_count, 3);
        static const double order[] = {0.4, 0.3, 0.2};
        static const size_t faces[] = {64, 36, 49};
        for (int r = 0; r < 3; r++) {
            qm_measured_holds(found.region[r].max, order[r], 1e-9, "height");
            qm_measured_holds(found.region[r].area, 1.0, 1e-9, "area");
            assert_int_equal(found.region[r].parts, 1);
            assert_int_equal(found.region[r].face_count, faces[r]);
        }
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
    qm_shape_free(&soup);
}

static void a_surface_at_the_limit_may_be_beyond(void **state)
{
    (void)state;
    static const double corners[4][3] = {{-9, -9, 0}, {9, -9, 0}, {9, 9, 0}, {-9, 9, 0}};
    qm_mesh b = qm_shape_face(4, corners), a = qm_shape_plane(6, 0.25);
    qm_deviation found = measure(&a, &b, QM_QUADS_TRIANGLES, 0.25);
    assert_int_equal(found.region_count, 1);
    assert_int_equal(found.region[0].parts, 0);
    assert_true(found.region[0].area.lower == 0.0 && found.region[0].area.upper >= 1.0);
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void points_have_no_regions(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 1);
    qm_mesh a = qm_shape_points(&random, 10), b = qm_shape_box(1, 1, 1);
    qm_context ctx = qm_context_make();
    qm_deviation out;
    assert_int_equal(measure_in(&ctx, &a, &b, QM_QUADS_TRIANGLES, 0.1, 1, &out), QM_E_UNSUPPORTED);
    assert_int_equal(measure_in(&ctx, &b, &b, QM_QUADS_TRIANGLES, -1.0, 1, &out), QM_E_ARGUMENT);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/* ---- the slow twin ---- */

enum { CELLS = 24, CELL_COUNT = CELLS * CELLS };

/** The cells of a square of the source: bounds of their distances, and components of those that are surely beyond. */
typedef struct twin {
    double least[CELL_COUNT], most[CELL_COUNT], middle[CELL_COUNT][3], area[CELL_COUNT];
    int component[CELL_COUNT];
} twin;

static void fill(int *component, const twin *cells, double limit, int i, int name)
{
    int stack[4 * CELL_COUNT], count = 0;
    stack[count++] = i;
    while (count > 0) {
        int at = stack[--count];
        if (component[at] != -1 || !(cells->least[at] > limit)) continue;
        component[at] = name;
        int u = at % CELLS, v = at / CELLS;
        const int next[4][2] = {{u - 1, v}, {u + 1, v}, {u, v - 1}, {u, v + 1}};
        for (int k = 0; k < 4; k++)
            if (next[k][0] >= 0 && next[k][0] < CELLS && next[k][1] >= 0 && next[k][1] < CELLS)
                stack[count++] = next[k][1] * CELLS + next[k][0];
    }
}

static int find_regions(twin *cells, double limit)
{
    int names = 0;
    for (int i = 0; i < CELL_COUNT; i++)
        cells->component[i] = -1;
    for (int i = 0; i < CELL_COUNT; i++)
        if (cells->component[i] == -1 && cells->least[i] > limit)
            fill(cells->component, cells, limit, i, names++);
    return names;
}

static bool is_in_box(const qm_deviation_region *region, const double p[3])
{
    for (int k = 0; k < 3; k++)
        if (p[k] < region->box.min[k] - 1e-9 || p[k] > region->box.max[k] + 1e-9) return false;
    return true;
}

/** What is surely beyond and connected lies in one region, and areas agree. */
static void regions_hold_what_a_subdivision_finds(void **state)
{
    (void)state;
    int runs = qm_check_long() ? 300 : 24, several = 0;
    for (int run = 0; run < runs; run++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)run);
        qm_quad_reading reading = (qm_quad_reading)(run % 2);
        int n = 1 + run % 3; /* quads along an edge of the source */
        qm_mesh a = qm_shape_plane(n, 0.0), b = qm_shape_soup(&random, 9, QM_SOUP_MIXED, QM_SOUP_APART, 0.3);
        const double shift[3] = {0.5, 0.5, 0.0};
        qm_shape_move(&b, 0.6, shift);
        twin cells;
        double sure = 0.0, maybe = 0.0, limit = qm_random_range(&random, 0.05, 0.2);
        for (int i = 0; i < CELL_COUNT; i++) {
            double *p = cells.middle[i];
            p[0] = (i % CELLS + 0.5) / CELLS;
            p[1] = (i / CELLS + 0.5) / CELLS;
            p[2] = 0.0;
            qm_slow_bracket far = qm_slow_distance(&b, reading, p, 1e-4);
            double reach = 0.7072 / CELLS;
            cells.least[i] = far.lower - reach;
            cells.most[i] = far.upper + reach;
            cells.area[i] = 1.0 / CELL_COUNT;
            sure += cells.least[i] > limit ? cells.area[i] : 0.0;
            maybe += cells.most[i] > limit ? cells.area[i] : 0.0;
        }
        int names = find_regions(&cells, limit);
        qm_deviation found = measure(&a, &b, reading, limit);
        double area[2] = {0.0, 0.0};
        for (size_t r = 0; r < found.region_count; r++) {
            const qm_deviation_region *region = &found.region[r];
            area[0] += region->area.lower;
            area[1] += region->area.upper;
            QM_CHECK(region->max.lower <= region->max.upper && region->max.upper > limit - 1e-9, "run %d",
                     run);
            if (!region->has_witness) continue;
            qm_slow_bracket far = qm_slow_distance(&b, reading, region->from.position, 1e-9);
            QM_CHECK(far.upper >= region->max.lower - 1e-12, "run %d: %g, %g", run, far.upper,
                     region->max.lower);
            QM_CHECK(is_in_box(region, region->from.position), "run %d", run);
        }
        QM_CHECK(area[0] <= maybe + 1e-9 && area[1] >= sure - 1e-9 && area[0] <= area[1],
                 "run %d, seed %llu: %g to %g, %g to %g", run, (unsigned long long)qm_check_seed(), area[0],
                 area[1], sure, maybe);
        for (int name = 0; name < names; name++) {
            bool is_held = false;
            for (size_t r = 0; r < found.region_count && !is_held; r++) {
                is_held = true;
                for (int i = 0; i < CELL_COUNT; i++)
                    if (cells.component[i] == name && !is_in_box(&found.region[r], cells.middle[i]))
                        is_held = false;
            }
            QM_CHECK(is_held, "run %d, seed %llu: a part is in no region", run,
                     (unsigned long long)qm_check_seed());
        }
        several += found.region_count > 1;
        qm_measured_deviation_free(&found);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
    QM_CHECK(several > runs / 8, "%d of %d have several regions", several, runs);
}

/* ---- the rules of every call ---- */

static void threads_do_not_change_the_regions(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(40, 20, 1.0, 0.4), b = qm_shape_torus(30, 16, 1.05, 0.4);
    qm_deviation found[2];
    for (int i = 0; i < 2; i++) {
        qm_context ctx = qm_host_context();
        assert_int_equal(measure_in(&ctx, &a, &b, QM_QUADS_BILINEAR, 0.04, 1 + 2 * i, &found[i]), QM_OK);
    }
    assert_int_equal(found[0].region_count, found[1].region_count);
    for (size_t r = 0; r < found[0].region_count; r++) {
        assert_true(found[0].region[r].area.upper == found[1].region[r].area.upper);
        assert_true(found[0].region[r].face_count == found[1].region[r].face_count);
    }
    assert_memory_equal(found[0].region_face, found[1].region_face,
                        found[0].region_face_count * sizeof *found[0].region_face);
    qm_context ctx = qm_host_context();
    for (int i = 0; i < 2; i++)
        qm_deviation_reset(&ctx, &found[i]);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void out_of_memory_is_reported_and_leaves_nothing(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_plane(2, 0.0), b = qm_shape_box(0.5, 0.5, 0.5);
    qm_status status = QM_E_NO_MEMORY;
    for (size_t at = 0; status == QM_E_NO_MEMORY; at++) {
        qm_failing_allocator failing = {.fail_at = at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&failing);
        qm_deviation out;
        status = measure_in(&ctx, &a, &b, QM_QUADS_TRIANGLES, 0.3, 1, &out);
        if (status == QM_OK) qm_deviation_reset(&ctx, &out);
        assert_true(status == QM_OK || status == QM_E_NO_MEMORY);
        assert_int_equal(failing.live_blocks, 0);
        assert_false(failing.mismatched);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_square_through_a_box_has_a_rim_and_a_core),
        cmocka_unit_test(plates_are_regions_of_their_own),
        cmocka_unit_test(a_surface_at_the_limit_may_be_beyond),
        cmocka_unit_test(points_have_no_regions),
        cmocka_unit_test(regions_hold_what_a_subdivision_finds),
        cmocka_unit_test(threads_do_not_change_the_regions),
        cmocka_unit_test(out_of_memory_is_reported_and_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
