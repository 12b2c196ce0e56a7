/*
 * Solids: what is closed, oriented and free of crossings, and what is inside. Winding numbers are held against solid angles in long
 * double, of patches by dense subdivision, and where the point is in line with corners and edges against what is known.
 */
#include <math.h>
#include <string.h>

#include "check.h"
#include "qm/solid.h"
#include "shapes.h"

/* ---- the slow twin ---- */

typedef struct vector {
    long double x, y, z;
} vector;

static long double dot(vector a, vector b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static vector cross(vector a, vector b)
{
    return (vector){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/** The signed solid angle of a triangle as seen from the origin (van Oosterom, Strackee, 1983), positive from behind. */
static long double solid_angle(vector a, vector b, vector c)
{
    long double la = sqrtl(dot(a, a)), lb = sqrtl(dot(b, b)), lc = sqrtl(dot(c, c));
    long double above = dot(a, cross(b, c));
    long double below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
    return 2.0L * atan2l(above, below);
}

static vector corner_at(const qm_mesh *mesh, size_t face, int corner, const double p[3])
{
    const double *at = mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)corner];
    return (vector){(long double)at[0] - p[0], (long double)at[1] - p[1], (long double)at[2] - p[2]};
}

static vector patch_at(const vector c[4], long double s, long double t)
{
    long double w[4] = {(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t};
    vector sum = {0, 0, 0};
    for (int i = 0; i < 4; i++)
        sum = (vector){sum.x + w[i] * c[i].x, sum.y + w[i] * c[i].y, sum.z + w[i] * c[i].z};
    return sum;
}

/** The winding number before it is rounded to a whole one. */
static double slow_winding(const qm_mesh *mesh, qm_quad_reading reading, const double p[3], int cells)
{
    long double sum = 0.0L;
    for (size_t f = 0; f < mesh->face_count; f++) {
        bool is_quad = mesh->faces[4 * f + 3] != QM_NO_INDEX;
        vector c[4];
        for (int i = 0; i < (is_quad ? 4 : 3); i++)
            c[i] = corner_at(mesh, f, i, p);
        if (!is_quad || reading == QM_QUADS_TRIANGLES) {
            sum += solid_angle(c[0], c[1], c[2]);
            if (is_quad) sum += solid_angle(c[0], c[2], c[3]);
            continue;
        }
        for (int i = 0; i < cells; i++)
            for (int k = 0; k < cells; k++) {
                long double n = cells;
                vector q[4] = {patch_at(c, i / n, k / n), patch_at(c, (i + 1) / n, k / n),
                               patch_at(c, (i + 1) / n, (k + 1) / n), patch_at(c, i / n, (k + 1) / n)};
                sum += solid_angle(q[0], q[1], q[2]) + solid_angle(q[0], q[2], q[3]);
            }
    }
    return (double)(sum / (4.0L * 3.14159265358979323846L));
}

/* ---- meshes ---- */

static void turn_faces(qm_mesh *mesh)
{
    for (size_t f = 0; f < mesh->face_count; f++) {
        uint32_t *face = mesh->faces + 4 * f, kept = face[1];
        int last = face[3] == QM_NO_INDEX ? 2 : 3;
        face[1] = face[last];
        face[last] = kept;
    }
}

static qm_mesh box_at(double low, double high, bool is_turned)
{
    qm_mesh box = qm_shape_box(high - low, high - low, high - low);
    const double shift[3] = {low, low, low};
    qm_shape_move(&box, 1.0, shift);
    if (is_turned) turn_faces(&box);
    return box;
}

static qm_mesh joined(qm_mesh a, qm_mesh b)
{
    qm_mesh both = qm_shape_joined(&a, &b);
    qm_shape_free(&a);
    qm_shape_free(&b);
    return both;
}

static qm_bvh *tree_of(const qm_mesh *mesh)
{
    qm_context ctx = qm_context_make();
    qm_bvh *tree = NULL;
    assert_int_equal(qm_bvh_build(&ctx, mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    return tree;
}

static void free_tree(qm_bvh *tree)
{
    qm_context ctx = qm_context_make();
    qm_bvh_destroy(&ctx, tree);
}

static qm_solid check(const qm_mesh *mesh, qm_quad_reading reading)
{
    qm_context ctx = qm_context_make();
    qm_bvh *tree = tree_of(mesh);
    qm_solid solid;
    assert_int_equal(qm_solid_check(&ctx, tree, reading, 1, &solid), QM_OK);
    free_tree(tree);
    return solid;
}

/* ---- certificates ---- */

static void closed_meshes_are_solids_and_faults_are_named(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 2, 3);
    for (int reading = 0; reading < 2; reading++)
        assert_int_equal(check(&box, (qm_quad_reading)reading).fault, QM_SOLID_PROVEN);

    qm_mesh open = qm_shape_copy(&box);
    open.face_count--;
    qm_solid found = check(&open, QM_QUADS_TRIANGLES);
    assert_int_equal(found.fault, QM_SOLID_OPEN);
    assert_int_equal(found.edge_count, 4);

    qm_mesh turned = qm_shape_copy(&box);
    uint32_t kept = turned.faces[1];
    turned.faces[1] = turned.faces[3];
    turned.faces[3] = kept;
    found = check(&turned, QM_QUADS_TRIANGLES);
    assert_int_equal(found.fault, QM_SOLID_TURNED);
    assert_int_equal(found.edge_count, 4);

    qm_mesh two = joined(box_at(0, 1, false), box_at(0.5, 1.5, false));
    for (int reading = 0; reading < 2; reading++) {
        found = check(&two, (qm_quad_reading)reading);
        assert_int_equal(found.fault, QM_SOLID_CROSSING);
        qm_context ctx = qm_context_make();
        assert_int_equal(qm_solid_require(&ctx, &found, "B"), QM_E_NOT_CLOSED);
        assert_non_null(strstr(ctx.message, "meets itself"));
    }
    qm_mesh touching = joined(box_at(0, 1, false), box_at(1, 2, false));
    assert_int_equal(check(&touching, QM_QUADS_TRIANGLES).fault, QM_SOLID_CROSSING);

    qm_random random = qm_random_make(qm_check_seed(), 1);
    qm_mesh points = qm_shape_points(&random, 20);
    assert_int_equal(check(&points, QM_QUADS_TRIANGLES).fault, QM_SOLID_EMPTY);
    qm_mesh *const all[] = {&box, &open, &turned, &two, &touching, &points};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        qm_shape_free(all[i]);
}

static void faces_that_repeat_corners_bound_solids_too(void **state)
{
    (void)state;
    /* A tetrahedron, one of whose faces is a quad with two equal corners, and a face that is a segment. */
    qm_mesh mesh = qm_shape_make(4, 5);
    static const double at[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const uint32_t faces[20] = {0, 2,           1, QM_NO_INDEX, 0, 1,           3, 3, 1, 2,
                                       3, QM_NO_INDEX, 2, 0,           3, QM_NO_INDEX, 1, 1, 2, QM_NO_INDEX};
    memcpy(mesh.positions, at, sizeof at);
    memcpy(mesh.faces, faces, sizeof faces);
    assert_int_equal(check(&mesh, QM_QUADS_TRIANGLES).fault, QM_SOLID_PROVEN);
    qm_bvh *tree = tree_of(&mesh);
    static const double inside[3] = {0.1, 0.2, 0.3}, outside[3] = {0.5, 0.4, 0.3};
    for (int reading = 0; reading < 2; reading++) {
        assert_int_equal(qm_solid_winding(tree, (qm_quad_reading)reading, inside), 1);
        assert_int_equal(qm_solid_winding(tree, (qm_quad_reading)reading, outside), 0);
    }
    free_tree(tree);
    qm_shape_free(&mesh);
}

/* ---- inside ---- */

/** Every point of a lattice, whose lines run through corners, along edges and along diagonals. */
static void shells_and_cavities_are_told_from_lattice_points(void **state)
{
    (void)state;
    /* A box with a cavity, in which there is a box; and one beside it that is inside out. */
    qm_mesh mesh = joined(joined(box_at(0, 8, false), box_at(2, 6, true)),
                          joined(box_at(3, 5, false), box_at(9, 11, true)));
    assert_int_equal(check(&mesh, QM_QUADS_TRIANGLES).fault, QM_SOLID_PROVEN);
    qm_bvh *tree = tree_of(&mesh);
    for (int i = 0; i < 27 * 27 * 27; i++) {
        const double p[3] = {0.5 * (i % 27) - 1, 0.5 * (i / 27 % 27) - 1, 0.5 * (i / 729) - 1};
        double far[4] = {0, 0, 0, 0}; /* from the centre of each box along the farthest axis */
        for (int k = 0; k < 3; k++)
            for (int b = 0; b < 4; b++)
                far[b] = fmax(far[b], fabs(p[k] - (b < 3 ? 4 : 10)));
        if (far[0] == 4 || far[1] == 2 || far[2] == 1 || far[3] == 1) continue; /* on the surface */
        int truth = far[3] < 1 ? -1 : (far[0] < 4) - (far[1] < 2) + (far[2] < 1);
        for (int reading = 0; reading < 2; reading++)
            QM_CHECK(qm_solid_winding(tree, (qm_quad_reading)reading, p) == truth,
                     "point %g %g %g, reading %d", p[0], p[1], p[2], reading);
    }
    free_tree(tree);
    qm_shape_free(&mesh);
}

static qm_relation relate(const qm_mesh *a, const qm_mesh *b)
{
    qm_context ctx = qm_context_make();
    qm_bvh *tree_a = tree_of(a), *tree_b = tree_of(b);
    qm_relation found[2];
    for (int reading = 0; reading < 2; reading++)
        assert_int_equal(qm_solid_relate(&ctx, tree_a, tree_b, (qm_quad_reading)reading, &found[reading]),
                         QM_OK);
    free_tree(tree_a);
    free_tree(tree_b);
    assert_int_equal(found[0], found[1]);
    return found[0];
}

static void solids_that_do_not_meet_are_told_apart(void **state)
{
    (void)state;
    qm_mesh hollow = joined(box_at(0, 8, false), box_at(2, 6, true)), small = box_at(3, 5, false),
            whole = box_at(0, 8, false);
    qm_mesh large = box_at(-1, 9, true), shell = box_at(1, 7, false),
            two = joined(box_at(3, 5, false), box_at(9, 10, false));
    assert_int_equal(relate(&small, &hollow), QM_RELATION_APART);
    assert_int_equal(relate(&small, &whole), QM_RELATION_A_INSIDE_B);
    assert_int_equal(relate(&whole, &small), QM_RELATION_B_INSIDE_A);
    assert_int_equal(relate(&hollow, &large), QM_RELATION_A_INSIDE_B);
    assert_int_equal(relate(&shell, &hollow), QM_RELATION_OVERLAPPING);
    assert_int_equal(relate(&two, &whole), QM_RELATION_OVERLAPPING);
    qm_mesh *const all[] = {&hollow, &small, &whole, &large, &shell, &two};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        qm_shape_free(all[i]);
}

/** A closed mesh: a torus of few large quads, shaken, so that its patches are far from their triangles. */
static qm_mesh random_solid(qm_random *random, int i)
{
    qm_mesh mesh =
        qm_shape_torus(3 + (int)qm_random_below(random, 6), 3 + (int)qm_random_below(random, 4), 1.0, 0.5);
    qm_shape_shake(&mesh, random, i % 3 == 0 ? 0.0 : 0.25);
    static const double scales[] = {1.0, 1e-30, 1e9, 1.0};
    static const double shifts[][3] = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {1e6, -1e6, 1e6}};
    qm_shape_move(&mesh, scales[i % 4], shifts[i % 4]);
    return mesh;
}

static void winding_numbers_are_solid_angles(void **state)
{
    (void)state;
    enum { MESHES = 60, POINTS = 60, CELLS = 12, FINE_CELLS = 120 };
    int inside = 0, twisted = 0, skipped = 0;
    for (int i = 0; i < MESHES; i++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)i);
        qm_mesh mesh = random_solid(&random, i);
        qm_bvh *tree = tree_of(&mesh);
        qm_box box = qm_mesh_bounding_box(&mesh);
        for (int k = 0; k < POINTS; k++) {
            double p[3];
            for (int axis = 0; axis < 3; axis++)
                p[axis] = qm_random_range(&random, box.min[axis], box.max[axis]);
            /* Above a corner, beside an edge of the grid, or anywhere. */
            const double *corner = mesh.positions + 3 * qm_random_below(&random, mesh.vertex_count);
            for (int axis = 0; k % 3 == 1 && axis < 2; axis++)
                p[axis] = corner[axis];
            int number[2];
            for (int reading = 0; reading < 2; reading++) {
                double slow = slow_winding(&mesh, (qm_quad_reading)reading, p, CELLS);
                number[reading] = qm_solid_winding(tree, (qm_quad_reading)reading, p);
                /* On the surface, and between a patch and its subdivision, the twin knows nothing. */
                double coarse = slow_winding(&mesh, (qm_quad_reading)reading, p, CELLS - 5);
                if (fabs(slow - coarse) > 0.1 || fabs(slow - round(slow)) > 0.1) {
                    skipped++;
                    number[reading] = 0;
                    continue;
                }
                /* A point that near to a patch that its subdivision lies on the other side takes a finer one. */
                if (reading == QM_QUADS_BILINEAR && fabs(slow - number[reading]) > 0.1)
                    slow = slow_winding(&mesh, QM_QUADS_BILINEAR, p, FINE_CELLS);
                QM_CHECK(fabs(slow - number[reading]) < 0.1,
                         "mesh %d, point %d, reading %d, seed %llu: %g and %d", i, k, reading,
                         (unsigned long long)qm_check_seed(), slow, number[reading]);
                inside += number[reading] != 0;
            }
            twisted += number[0] != number[1];
        }
        free_tree(tree);
        qm_shape_free(&mesh);
    }
    assert_true(inside > MESHES * POINTS / 10);
    assert_true(twisted > 20);
    assert_true(skipped < MESHES * POINTS / 20);
}

/** One quad of small whole numbers and its two triangles turned: a closed mesh that is empty as triangles. */
static void the_space_between_a_patch_and_its_triangles_is_exact(void **state)
{
    (void)state;
    int between = 0;
    for (int i = 0; i < 400; i++) {
        qm_random random = qm_random_make(qm_check_seed(), 1000 + (uint64_t)i);
        qm_mesh mesh = qm_shape_make(4, 3);
        for (int k = 0; k < 12; k++)
            mesh.positions[k] = (double)qm_random_below(&random, 9) - 4;
        static const uint32_t faces[12] = {0, 1, 2, 3, 2, 1, 0, QM_NO_INDEX, 3, 2, 0, QM_NO_INDEX};
        memcpy(mesh.faces, faces, sizeof faces);
        qm_bvh *tree = tree_of(&mesh);
        double c[4][3];
        memcpy(c, mesh.positions, sizeof c);
        for (int x = -4; x <= 4; x++)
            for (int y = -4; y <= 4; y++)
                for (int z = -4; z <= 4; z++) {
                    const double p[3] = {x, y, z};
                    /* Whole numbers: six times the volumes of the tetrahedra with a corner replaced. */
                    long volume[5];
                    for (int k = 0; k < 5; k++) {
                        double e[3][3], at[4][3];
                        memcpy(at, c, sizeof at);
                        if (k < 4) memcpy(at[k], p, sizeof p);
                        for (int m = 0; m < 9; m++)
                            e[m / 3][m % 3] = at[m / 3 + 1][m % 3] - at[0][m % 3];
                        volume[k] = lround(e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                                           e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                                           e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]));
                    }
                    long sign = volume[4] > 0 ? 1 : volume[4] < 0 ? -1 : 0;
                    bool on_border = false, is_inside = sign != 0;
                    for (int k = 0; k < 4; k++) {
                        is_inside &= volume[k] * sign > 0;
                        on_border |= volume[k] == 0;
                    }
                    long side = volume[0] * volume[2] - volume[1] * volume[3];
                    if (on_border || (is_inside && side == 0)) continue; /* may be on a surface */
                    int truth = is_inside && side > 0 ? (int)sign : 0;
                    QM_CHECK(qm_solid_winding(tree, QM_QUADS_BILINEAR, p) == truth, "case %d, %d %d %d", i, x,
                             y, z);
                    assert_int_equal(qm_solid_winding(tree, QM_QUADS_TRIANGLES, p), 0);
                    between += truth != 0;
                }
        free_tree(tree);
        qm_shape_free(&mesh);
    }
    assert_true(between > 100);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_meshes_are_solids_and_faults_are_named),
        cmocka_unit_test(faces_that_repeat_corners_bound_solids_too),
        cmocka_unit_test(shells_and_cavities_are_told_from_lattice_points),
        cmocka_unit_test(solids_that_do_not_meet_are_told_apart),
        cmocka_unit_test(winding_numbers_are_solid_angles),
        cmocka_unit_test(the_space_between_a_patch_and_its_triangles_is_exact),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
