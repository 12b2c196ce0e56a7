/*
 * One pair of surfaces, written down in many ways: all brackets of its distance must overlap. No other answer
 * is needed to hold them against, so they are held against each other at the closest tolerance.
 */
#include "check.h"

#include "measured.h"
#include "random.h"
#include "shapes.h"

#include <math.h>
#include <string.h>

/** Another way to write the same surface down, possibly in another frame; random chooses among several. */
typedef qm_mesh rewrite_fn(const qm_mesh *mesh, qm_quad_reading reading, uint64_t choice);

static qm_mesh with_axes_turned(const qm_mesh *mesh, qm_quad_reading reading, uint64_t choice)
{
    (void)reading;
    qm_mesh out = qm_shape_copy(mesh);
    for (size_t i = 0; i < 3 * mesh->vertex_count; ++i) {
        size_t axis = (i + choice) % 3;
        out.positions[i] = (choice >> (2 + i % 3) & 1 ? -1 : 1) * mesh->positions[i - i % 3 + axis];
    }
    return out;
}

static qm_mesh with_faces_shuffled(const qm_mesh *mesh, qm_quad_reading reading, uint64_t choice)
{
    (void)reading;
    qm_mesh out = qm_shape_copy(mesh);
    qm_random random = qm_random_make(choice, 0);
    for (size_t f = mesh->face_count; f > 1; --f) {
        size_t other = qm_random_below(&random, f);
        uint32_t kept[4];
        memcpy(kept, out.faces + 4 * other, sizeof kept);
        memcpy(out.faces + 4 * other, out.faces + 4 * (f - 1), sizeof kept);
        memcpy(out.faces + 4 * (f - 1), kept, sizeof kept);
    }
    return out;
}

/** Faces that begin at another corner or run the other way round: as two triangles a quad keeps its
 * diagonal. */
static qm_mesh with_corners_turned(const qm_mesh *mesh, qm_quad_reading reading, uint64_t choice)
{
    qm_mesh out = qm_shape_copy(mesh);
    for (size_t f = 0; f < mesh->face_count; ++f) {
        const uint32_t *face = mesh->faces + 4 * f;
        size_t count = face[3] == QM_NO_INDEX ? 3 : 4, turn = (size_t)(choice + f) % count;
        if (count == 4 && reading == QM_QUADS_TRIANGLES) turn &= 2;
        for (size_t i = 0; i < count; ++i)
            out.faces[4 * f + i] = face[(choice & 8 ? turn + count - i : turn + i) % count];
    }
    return out;
}

static qm_mesh with_vertices_of_its_own(const qm_mesh *mesh, qm_quad_reading reading, uint64_t choice)
{
    (void)reading;
    (void)choice;
    if (mesh->face_count == 0) return qm_shape_copy(mesh);
    qm_mesh out = qm_shape_make(4 * mesh->face_count, mesh->face_count);
    for (size_t i = 0; i < 4 * mesh->face_count; ++i) {
        uint32_t corner = mesh->faces[i];
        out.faces[i] = corner == QM_NO_INDEX ? corner : (uint32_t)i;
        if (corner != QM_NO_INDEX)
            memcpy(out.positions + 3 * i, mesh->positions + 3 * (size_t)corner, 3 * sizeof(double));
    }
    return out;
}

static qm_mesh twice_over(const qm_mesh *mesh, qm_quad_reading reading, uint64_t choice)
{
    (void)reading;
    (void)choice;
    return mesh->face_count == 0 ? qm_shape_copy(mesh) : qm_shape_joined(mesh, mesh);
}

/** The point at parameters i / 2, j / 2 of a face: exact, since the corners have few digits. */
static void place_between(const qm_mesh *mesh, const uint32_t *face, int i, int j, double out[3])
{
    bool is_quad = face[3] != QM_NO_INDEX;
    const double *c[4];
    for (int k = 0; k < 4; ++k)
        c[k] = mesh->positions + 3 * (size_t)face[k == 3 && !is_quad ? 0 : k];
    for (int k = 0; k < 3; ++k)
        out[k] = is_quad ? ((2 - i) * (2 - j) * c[0][k] + i * (2 - j) * c[1][k] + i * j * c[2][k] +
                            (2 - i) * j * c[3][k]) /
                               4
                         : ((2 - i - j) * c[0][k] + i * c[1][k] + j * c[2][k]) / 2;
}

/** Every face in four that are parts of it. */
static qm_mesh in_four(const qm_mesh *mesh, qm_quad_reading reading, uint64_t choice)
{
    (void)choice;
    qm_mesh whole = reading == QM_QUADS_TRIANGLES && mesh->face_count > 0 ? qm_shape_triangulated(mesh)
                                                                          : qm_shape_copy(mesh);
    if (whole.face_count == 0) return whole;
    static const uint32_t triangles[4][4] = {
        {0, 1, 3, QM_NO_INDEX}, {1, 2, 4, QM_NO_INDEX}, {3, 4, 6, QM_NO_INDEX}, {1, 4, 3, QM_NO_INDEX}};
    static const uint32_t quads[4][4] = {{0, 1, 4, 3}, {1, 2, 5, 4}, {3, 4, 7, 6}, {4, 5, 8, 7}};
    qm_mesh out = qm_shape_make(9 * whole.face_count, 4 * whole.face_count);
    for (size_t f = 0; f < whole.face_count; ++f) {
        const uint32_t *face = whole.faces + 4 * f;
        bool is_quad = face[3] != QM_NO_INDEX;
        for (int i = 0; i < 9; ++i)
            place_between(&whole, face, i % 3, i / 3, out.positions + 27 * f + 3 * i);
        for (size_t i = 0; i < 16; ++i) {
            uint32_t corner = (is_quad ? quads : triangles)[i / 4][i % 4];
            out.faces[16 * f + i] = corner == QM_NO_INDEX ? corner : corner + 9 * (uint32_t)f;
        }
    }
    qm_shape_free(&whole);
    return out;
}

static const struct {
    const char *name;
    rewrite_fn *rewrite;
    bool both; /* both meshes must be written down the same way: it moves them */
} rewrites[] = {
    {"axes turned", with_axes_turned, true},
    {"faces shuffled", with_faces_shuffled, false},
    {"corners turned", with_corners_turned, false},
    {"vertices of their own", with_vertices_of_its_own, false},
    {"twice over", twice_over, false},
    {"in four", in_four, false},
};

enum { REWRITE_COUNT = sizeof rewrites / sizeof *rewrites };

/** Corners that are whole multiples of 2^-24: sums and halves of them are exact. */
static void round_corners(qm_mesh *mesh)
{
    for (size_t i = 0; i < 3 * mesh->vertex_count; ++i)
        mesh->positions[i] = round(mesh->positions[i] * 0x1p24) * 0x1p-24;
}

static qm_mesh draw_mesh(qm_random *random)
{
    if (qm_random_below(random, 16) == 0) return qm_shape_points(random, 1 + qm_random_below(random, 9));
    qm_soup_style style = (qm_soup_style)qm_random_below(random, QM_SOUP_STYLE_COUNT);
    double twist = (double[]){0, 0.2, 1, 2}[qm_random_below(random, 4)];
    return qm_shape_soup(random, 1 + qm_random_below(random, 12), (qm_soup_corners)qm_random_below(random, 3),
                         style, twist);
}

typedef struct written_pair {
    uint64_t seed;
    qm_mesh a, b;
    double least_upper, greatest_lower;
    const char *upper_of, *lower_of;
    qm_hausdorff_options options;
} written_pair;

/** Measures one way to write the pair down, and holds its bracket against all before. */
static void hold(written_pair *pair, const char *name, const qm_mesh *a, const qm_mesh *b, int threads)
{
    pair->options.thread_count = threads;
    qm_hausdorff_result r = qm_measured(a, b, &pair->options);
    if (r.upper < pair->least_upper) {
        pair->least_upper = r.upper;
        pair->upper_of = name;
    }
    if (r.lower > pair->greatest_lower) {
        pair->greatest_lower = r.lower;
        pair->lower_of = name;
    }
    QM_CHECK(pair->greatest_lower <= pair->least_upper,
             "seed %llu, direction %d, reading %d: %s is at least %.17g, %s at most %.17g",
             (unsigned long long)pair->seed, (int)pair->options.direction, (int)pair->options.quads,
             pair->lower_of, pair->greatest_lower, pair->upper_of, pair->least_upper);
}

static void hold_rewrites(written_pair *pair, uint64_t choice)
{
    hold(pair, "the original", &pair->a, &pair->b, 1);
    for (size_t k = 0; k < REWRITE_COUNT; ++k) {
        qm_mesh a = rewrites[k].rewrite(&pair->a, pair->options.quads, choice);
        qm_mesh b = rewrites[k].rewrite(&pair->b, pair->options.quads, choice);
        if (!rewrites[k].both) hold(pair, rewrites[k].name, &a, &pair->b, 1);
        if (!rewrites[k].both) hold(pair, rewrites[k].name, &pair->a, &b, 1);
        hold(pair, rewrites[k].name, &a, &b, 2);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static void all_ways_to_write_a_pair_down_agree(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 2000 : 60;
    for (uint64_t seed = 0; seed < count; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        written_pair pair = {
            .seed = seed, .a = draw_mesh(&random), .least_upper = INFINITY, .greatest_lower = -1};
        pair.b = qm_random_below(&random, 2) ? draw_mesh(&random) : qm_shape_copy(&pair.a);
        qm_shape_shake(&pair.b, &random, (double[]){0, 1e-6, 1e-3, 0.1}[qm_random_below(&random, 4)]);
        round_corners(&pair.a);
        round_corners(&pair.b);
        pair.options = qm_hausdorff_options_default();
        pair.options.direction = (qm_direction)qm_random_below(&random, 3);
        pair.options.quads = (qm_quad_reading)qm_random_below(&random, 2);
        pair.options.tolerance = 1e-11;
        pair.options.work_limit = pair.options.quads == QM_QUADS_BILINEAR ? 800 : 20000;
        hold_rewrites(&pair, qm_random_bits(&random));
        qm_shape_free(&pair.a);
        qm_shape_free(&pair.b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_ways_to_write_a_pair_down_agree),
    };
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    return cmocka_run_group_tests(tests, NULL, NULL);
}
