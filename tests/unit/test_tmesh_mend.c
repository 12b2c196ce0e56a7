/* Charts of a surface, and lattices that are drawn anew in them. What they give is judged in the plane or on the formula of the
 * surface, without the engine's own map. */
#include "check.h"

#include <math.h>
#include <string.h>

#include "ground.h"
#include "tmesh/tmesh_lattice.h"
#include "tmesh/tmesh_polygon.h"

/** A finger on a plate: a plane of 2 x 2 with a bump of this height, nearly upright. */
static qm_vec finger(double u, double v, double height)
{
    double x = 2 * u - 1, y = 2 * v - 1, r = sqrt(x * x + y * y);
    /* The disc of radius 0.5 becomes a shaft of radius 0.2 and its round end. */
    double pull = r < 0.5 ? 0.4 : 0.4 + 0.6 * fmin(1, (r - 0.5) / 0.3);
    double z = r < 0.5 ? height * (r < 0.2 ? 1 : (0.5 - r) / 0.3) : 0;
    return (qm_vec){x * pull, y * pull, z + 0.1 * (r < 0.2 ? sqrt(0.04 - r * r) / 0.2 : 0)};
}

static qm_mesh finger_mesh(int n, double height)
{
    qm_mesh mesh = qm_shape_plane(n, 0.0);
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (size_t v = 0; v < mesh.vertex_count; v++)
        for (size_t k = 0; k < 2; k++) {
            low[k] = fmin(low[k], mesh.positions[3 * v + k]);
            high[k] = fmax(high[k], mesh.positions[3 * v + k]);
        }
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        double *p = mesh.positions + 3 * v;
        qm_vec_store(
            p, finger((p[0] - low[0]) / (high[0] - low[0]), (p[1] - low[1]) / (high[1] - low[1]), height));
    }
    return mesh;
}

/** A closed line round the finger, or as a small circle on a torus. */
static void find_line(const qm_tmesh_triangles *t, double radius, double height, qm_tmesh_spot *line,
                      int count)
{
    for (int i = 0; i < count; i++) {
        double angle = 2 * M_PI * i / count;
        QM_CHECK(
            qm_tmesh_triangles_find(t, (qm_vec){radius * cos(angle), radius * sin(angle), height}, &line[i]),
            "place %d", i);
    }
}

static void a_chart_does_not_fold(void **state)
{
    (void)state;
    for (int n = 20; n <= 60; n += 20) {
        qm_ground g;
        qm_ground_make(&g, finger_mesh(n, 1.0));
        qm_tmesh_triangles t;
        assert_int_equal(qm_tmesh_triangles_make(&g.ctx, &g.source, &t), QM_OK);
        assert_int_equal(t.mesh.face_count, 2 * g.mesh.face_count);
        qm_arena arena = qm_arena_make(&g.ctx);
        qm_tmesh_spot line[24];
        qm_tmesh_chart chart;
        bool is_made;
        find_line(&t, 0.2, 0.0, line, 24);
        assert_int_equal(qm_tmesh_chart_make(&arena, &t, line, 24, t.mesh.face_count, &chart, &is_made),
                         QM_OK);
        QM_CHECK(is_made, "no chart of %d", n);
        double highest = 0;
        for (size_t i = 0; i < chart.triangle_count; i++) {
            const uint32_t *c = chart.corner[i];
            QM_CHECK(qm_tmesh_flat_area(chart.flat[c[0]], chart.flat[c[1]], chart.flat[c[2]]) > 0,
                     "triangle %zu", i);
            highest = fmax(highest, chart.at[c[0]].z);
        }
        QM_CHECK(highest > 1.05, "the tip is not in the chart: %g", highest);
        /* To the plane and back, from the middle of each triangle. */
        uint32_t hint = 0, triangle;
        for (size_t i = 0; i < chart.triangle_count; i++) {
            const qm_tmesh_spot spot = {chart.triangle[i], {0.5, 0.3, 0.2}};
            const uint32_t *c = chart.corner[i];
            qm_tmesh_flat flat;
            qm_vec at, wanted = qm_vec_scale(0.5, chart.at[c[0]]);
            wanted = qm_vec_axpy(qm_vec_axpy(wanted, 0.3, chart.at[c[1]]), 0.2, chart.at[c[2]]);
            assert_true(qm_tmesh_chart_place(&chart, &spot, &flat, &triangle));
            assert_int_equal(triangle, i);
            assert_true(qm_tmesh_chart_lift(&chart, flat, &hint, &at));
            QM_CHECK(qm_vec_distance(at, wanted) < 1e-6, "triangle %zu: %g off", i,
                     qm_vec_distance(at, wanted));
        }
        qm_arena_reset(&arena);
        qm_tmesh_triangles_reset(&t);
        qm_ground_free(&g);
    }
}

/** Round the tube of a torus, and round its hole, no disc is bounded. */
static void what_is_no_disc_has_no_chart(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(48, 24, 1.0, 0.4));
    qm_tmesh_triangles t;
    assert_int_equal(qm_tmesh_triangles_make(&g.ctx, &g.source, &t), QM_OK);
    qm_arena arena = qm_arena_make(&g.ctx);
    qm_tmesh_spot line[24];
    qm_tmesh_chart chart;
    bool is_made;
    find_line(&t, 1.4, 0.0, line, 24);
    assert_int_equal(qm_tmesh_chart_make(&arena, &t, line, 24, t.mesh.face_count / 3, &chart, &is_made),
                     QM_OK);
    assert_false(is_made);
    for (int i = 0; i < 24; i++) {
        double angle = 2 * M_PI * i / 24;
        assert_true(
            qm_tmesh_triangles_find(&t, (qm_vec){1 + 0.4 * cos(angle), 0, 0.4 * sin(angle)}, &line[i]));
    }
    assert_int_equal(qm_tmesh_chart_make(&arena, &t, line, 24, t.mesh.face_count / 3, &chart, &is_made),
                     QM_OK);
    assert_false(is_made);
    /* Nor may a chart be larger than allowed. */
    for (int i = 0; i < 24; i++) {
        double angle = 2 * M_PI * i / 24;
        assert_true(qm_tmesh_triangles_find(&t, (qm_vec){1.4, 0.3 * cos(angle), 0.2 * sin(angle)}, &line[i]));
    }
    assert_int_equal(qm_tmesh_chart_make(&arena, &t, line, 24, 10, &chart, &is_made), QM_OK);
    assert_false(is_made);
    assert_int_equal(qm_tmesh_chart_make(&arena, &t, line, 24, t.mesh.face_count / 3, &chart, &is_made),
                     QM_OK);
    assert_true(is_made);
    qm_arena_reset(&arena);
    qm_tmesh_triangles_reset(&t);
    qm_ground_free(&g);
}

enum { SIDE = 18, POINTS = (SIDE + 1) * (SIDE + 1), CELLS = SIDE * SIDE };

/** A lattice over a plane. */
typedef struct plane_lattice {
    qm_tmesh_lattice lattice;
    qm_tmesh_point points[POINTS];
    qm_tmesh_cell cells[CELLS];
    uint32_t first_at[POINTS + 1], at[4 * CELLS];
} plane_lattice;

static void make_lattice(plane_lattice *p, const qm_box *box)
{
    memset(p, 0, sizeof *p);
    p->lattice = (qm_tmesh_lattice){p->points, POINTS, p->cells, CELLS, p->first_at, p->at};
    for (uint32_t i = 0; i < POINTS; i++) {
        double u = 0.1 + 0.8 * (i % (SIDE + 1)) / SIDE, v = 0.1 + 0.8 * (i / (SIDE + 1)) / SIDE;
        p->points[i].at = (qm_vec){box->min[0] + u * (box->max[0] - box->min[0]),
                                   box->min[1] + v * (box->max[1] - box->min[1]), box->min[2]};
        p->points[i].normal = (qm_vec){0, 0, 1};
    }
    for (uint32_t c = 0; c < CELLS; c++) {
        uint32_t first = c / SIDE * (SIDE + 1) + c % SIDE;
        const uint32_t corner[4] = {first, first + 1, first + SIDE + 2, first + SIDE + 1};
        memcpy(p->cells[c].corner, corner, sizeof corner);
        p->cells[c].sign = 1;
    }
    for (uint32_t c = 0; c < 4 * CELLS; c++)
        p->first_at[p->cells[c / 4].corner[c % 4] + 1]++;
    uint32_t place[POINTS];
    for (uint32_t i = 0; i < POINTS; i++) {
        p->first_at[i + 1] += p->first_at[i];
        place[i] = p->first_at[i];
    }
    for (uint32_t c = 0; c < 4 * CELLS; c++)
        p->at[place[p->cells[c / 4].corner[c % 4]]++] = c;
}

static double area_at(const plane_lattice *p, const uint32_t *corner, int a, int b, int c)
{
    qm_vec one = p->points[corner[a]].at, two = p->points[corner[b]].at, three = p->points[corner[c]].at;
    return (two.x - one.x) * (three.y - one.y) - (two.y - one.y) * (three.x - one.x);
}

/** True for a simple quadrangle: both triangles along one of its diagonals run the same way. */
static bool is_simple(const plane_lattice *p, uint32_t cell)
{
    const uint32_t *c = p->cells[cell].corner;
    return (area_at(p, c, 0, 1, 2) > 0 && area_at(p, c, 0, 2, 3) > 0) ||
           (area_at(p, c, 1, 2, 3) > 0 && area_at(p, c, 1, 3, 0) > 0);
}

/** Inner points of a lattice are thrown about; none of its cells folds after that is mended, and curves lie on the plane. */
static void thrown_lattices_are_mended(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < (qm_check_long() ? 200u : 20u); run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        qm_ground g;
        qm_ground_make(&g, qm_shape_plane(24, 0.0));
        qm_box box = qm_mesh_bounding_box(&g.mesh);
        static plane_lattice p;
        make_lattice(&p, &box);
        uint32_t low = 7 + (uint32_t)qm_random_below(&random, 2),
                 high = low + 1 + (uint32_t)qm_random_below(&random, 3);
        for (uint32_t i = low; i <= high; i++)
            for (uint32_t j = low; j <= high; j++) {
                qm_vec *at = &p.points[i * (SIDE + 1) + j].at;
                at->x = qm_random_range(&random, box.min[0], box.max[0]);
                at->y = qm_random_range(&random, box.min[1], box.max[1]);
            }
        bool is_seed[CELLS];
        size_t seeds = 0;
        for (uint32_t c = 0; c < CELLS; c++)
            seeds += is_seed[c] = !is_simple(&p, c);
        qm_tmesh_triangles t;
        qm_tmesh_traces traces = {0};
        assert_int_equal(qm_tmesh_triangles_make(&g.ctx, &g.source, &t), QM_OK);
        qm_arena arena = qm_arena_make(&g.ctx);
        assert_int_equal(qm_tmesh_mend(&arena, &t, &p.lattice, is_seed, 2, &traces), QM_OK);
        for (uint32_t c = 0; c < CELLS; c++)
            QM_CHECK(!is_seed[c] && is_simple(&p, c), "seed %llu, run %llu: cell %u of %zu seeds",
                     (unsigned long long)qm_check_seed(), (unsigned long long)run, c, seeds);
        for (uint32_t c = 0; c < CELLS; c++)
            for (uint32_t k = 0; k < 4 && p.cells[c].is_charted; k++) {
                uint32_t a = p.cells[c].corner[k], b = p.cells[c].corner[(k + 1) & 3];
                const qm_tmesh_trace *trace = qm_tmesh_traces_find(&traces, a, b);
                assert_non_null(trace);
                assert_ptr_equal(trace, qm_tmesh_traces_find(&traces, b, a));
                for (int i = 0; i < QM_TMESH_TRACE; i++)
                    QM_CHECK(fabs(trace->at[i].z - box.min[2]) < 1e-9, "off the plane by %g", trace->at[i].z);
            }
        QM_CHECK((seeds > 0) == (traces.count > 0), "%zu seeds, %zu traces", seeds, traces.count);
        qm_arena_reset(&arena);
        qm_tmesh_triangles_reset(&t);
        qm_ground_free(&g);
    }
}

/** Cells fold at the end of a finger. In a chart that is a small spot, which the means of neighbours lie beside: what is
 * drawn anew would leave the finger. */
static void what_is_mended_stays_on_its_limb(void **state)
{
    (void)state;
    for (double height = 1.0; height <= 4.0; height *= 2.0) {
        qm_ground g;
        qm_ground_make(&g, finger_mesh(60, height));
        qm_box box = qm_mesh_bounding_box(&g.mesh);
        static plane_lattice p;
        make_lattice(&p, &box);
        for (uint32_t i = 0; i < POINTS; i++) {
            double at[3], u = 0.1 + 0.8 * (i % (SIDE + 1)) / SIDE, v = 0.1 + 0.8 * (i / (SIDE + 1)) / SIDE;
            qm_ref_surface_point on;
            qm_vec_store(at, finger(u, v, height));
            qm_ref_surface_project(&g.source, at, &on);
            p.points[i].at = p.points[i].pin = qm_vec_load(on.position);
            p.points[i].normal = qm_vec_load(on.normal);
        }
        uint32_t middle = SIDE / 2 * (SIDE + 1) + SIDE / 2;
        qm_vec at = p.points[middle].at;
        p.points[middle].at = p.points[middle + 1].at;
        p.points[middle + 1].at = at;
        bool is_seed[CELLS] = {false};
        for (uint32_t k = p.first_at[middle]; k < p.first_at[middle + 1]; k++)
            is_seed[p.at[k] / 4] = true;
        qm_tmesh_triangles t;
        qm_tmesh_traces traces = {0};
        assert_int_equal(qm_tmesh_triangles_make(&g.ctx, &g.source, &t), QM_OK);
        qm_arena arena = qm_arena_make(&g.ctx);
        assert_int_equal(qm_tmesh_mend(&arena, &t, &p.lattice, is_seed, 5, &traces), QM_OK);
        double highest = -INFINITY;
        for (uint32_t i = 0; i < POINTS; i++)
            highest = fmax(highest, p.points[i].at.z);
        QM_CHECK(highest > 0.95 * height, "the lattice reaches up to %g of %g", highest, height);
        qm_arena_reset(&arena);
        qm_tmesh_triangles_reset(&t);
        qm_ground_free(&g);
    }
}

/** A spiral of corners, wound either way: small triangles of the circle's polygon keep their sense in it, and corners are mapped to corners. */
static void polygons_are_mapped_without_folds(void **state)
{
    (void)state;
    enum { ARM = 40, COUNT = 2 * ARM };
    for (int sense = -1; sense <= 1; sense += 2) {
        qm_context ctx = qm_context_make();
        qm_arena arena = qm_arena_make(&ctx);
        qm_tmesh_flat corner[COUNT];
        for (int i = 0; i < COUNT; i++) {
            int along = i < ARM ? i : COUNT - 1 - i;
            double angle = sense * 0.3 * along, radius = (i < ARM ? 1.2 : 1.0) * (1 + 0.1 * along);
            corner[i] = (qm_tmesh_flat){radius * cos(angle), radius * sin(angle)};
        }
        qm_tmesh_polygon polygon;
        bool is_cut;
        assert_int_equal(qm_tmesh_polygon_cut(&arena, corner, COUNT, &polygon, &is_cut), QM_OK);
        assert_true(is_cut);
        double area = 0, whole = 0;
        for (int i = 0; i < COUNT; i++) {
            qm_tmesh_flat at = qm_tmesh_polygon_map(&polygon, polygon.round[i]),
                          next = corner[(i + 1) % COUNT];
            QM_CHECK(hypot(at.u - corner[i].u, at.v - corner[i].v) < 1e-9, "corner %d", i);
            whole += corner[i].u * next.v - corner[i].v * next.u;
        }
        for (int t = 0; t + 2 < COUNT; t++) {
            const uint32_t *c = polygon.triangle[t];
            double own = qm_tmesh_flat_area(corner[c[0]], corner[c[1]], corner[c[2]]),
                   round = qm_tmesh_flat_area(polygon.round[c[0]], polygon.round[c[1]], polygon.round[c[2]]);
            QM_CHECK(own * round > 0 && own * whole > 0, "triangle %d of sense %d", t, sense);
            area += own;
        }
        QM_CHECK(fabs(area - whole) < 1e-9 * fabs(whole), "the triangles cover %g of %g", area, whole);
        qm_arena_reset(&arena);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_chart_does_not_fold),
        cmocka_unit_test(what_is_no_disc_has_no_chart),
        cmocka_unit_test(thrown_lattices_are_mended),
        cmocka_unit_test(what_is_mended_stays_on_its_limb),
        cmocka_unit_test(polygons_are_mapped_without_folds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
