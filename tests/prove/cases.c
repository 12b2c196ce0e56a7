#include "cases.h"

#include "regridded.h"

#include <math.h>
#include <string.h>

double qm_random_power(qm_random *random, double low, double high)
{
    return pow(10, qm_random_range(random, low, high));
}

/* ---- meshes ---- */

/** Mostly one to three faces: the fewer, the more tries. */
static size_t draw_count(qm_random *random)
{
    return 1 + qm_random_below(random, qm_random_below(random, 4) == 0 ? 8 : 3);
}

static qm_mesh draw_soup(qm_random *random, qm_soup_style style)
{
    if (qm_random_below(random, 24) == 0) return qm_shape_points(random, 1 + qm_random_below(random, 5));
    double twist = (double[]){0, 0.1, 0.5, 2}[qm_random_below(random, 4)];
    return qm_shape_soup(random, draw_count(random), (qm_soup_corners)qm_random_below(random, 3), style,
                         twist);
}

static qm_mesh draw_any(qm_random *random)
{
    return draw_soup(random, (qm_soup_style)qm_random_below(random, QM_SOUP_STYLE_COUNT));
}

static qm_mesh draw_quads(qm_random *random, double twist)
{
    return qm_shape_soup(random, 1 + qm_random_below(random, 3), QM_SOUP_QUADS, QM_SOUP_APART, twist);
}

static qm_pair with_noise(qm_random *random, qm_mesh a, double amplitude)
{
    qm_pair pair = {a, qm_shape_copy(&a)};
    qm_shape_shake(&pair.b, random, amplitude);
    return pair;
}

/** Turns both meshes alike, by a rotation that is random but for its roundings. */
static void turn(qm_random *random, qm_pair *pair)
{
    double x[3], y[3], z[3], along = 0;
    qm_random_direction(random, x);
    do {
        qm_random_direction(random, y);
        along = x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    } while (fabs(along) > 0.9);
    for (int k = 0; k < 3; k++)
        y[k] = (y[k] - along * x[k]) / sqrt(1 - along * along);
    for (int k = 0; k < 3; k++)
        z[k] = x[(k + 1) % 3] * y[(k + 2) % 3] - x[(k + 2) % 3] * y[(k + 1) % 3];
    qm_mesh *const meshes[] = {&pair->a, &pair->b};
    for (int m = 0; m < 2; m++)
        for (size_t v = 0; v < meshes[m]->vertex_count; v++) {
            double *p = meshes[m]->positions + 3 * v, old[3] = {p[0], p[1], p[2]};
            for (int k = 0; k < 3; k++)
                p[k] = old[0] * x[k] + old[1] * y[k] + old[2] * z[k];
        }
}

static void move(qm_pair *pair, double scale, const double shift[3])
{
    qm_shape_move(&pair->a, scale, shift);
    qm_shape_move(&pair->b, scale, shift);
}

static qm_pair swapped(qm_random *random, qm_pair pair)
{
    return qm_random_below(random, 2) ? pair : (qm_pair){pair.b, pair.a};
}

/* ---- pairs ---- */

static qm_pair near_origin(qm_random *random)
{
    qm_mesh a = draw_any(random);
    if (qm_random_below(random, 2)) return (qm_pair){a, draw_any(random)};
    return with_noise(random, a, (double[]){0, 1e-9, 1e-3, 0.1}[qm_random_below(random, 4)]);
}

/** Coordinates are 1 to 10^16 times the size of the mesh. */
static qm_pair far_off(qm_random *random)
{
    qm_pair pair = near_origin(random);
    double shift[3], away = qm_random_power(random, 3, 13);
    qm_random_direction(random, shift);
    for (int k = 0; k < 3; k++)
        shift[k] *= away;
    move(&pair, qm_random_power(random, -3, 3), shift);
    return pair;
}

/** A part of a metre or a few where maps put it. */
static qm_pair on_a_map(qm_random *random)
{
    qm_pair pair = near_origin(random);
    const double shift[3] = {qm_random_range(random, 1e5, 9e5), qm_random_range(random, 0, 1e7),
                             qm_random_range(random, -100, 4000)};
    move(&pair, qm_random_power(random, -0.5, 1), shift);
    return pair;
}

/** Adds the triangle of a quad's first three corners, lifted along z to between it and the patch. */
static void add_rival(qm_random *random, qm_mesh *mesh)
{
    static const uint32_t face[4] = {0, 1, 2, QM_NO_INDEX};
    qm_mesh triangle = qm_shape_make(3, 1);
    const double *c = mesh->positions;
    double bulge = 0.25 * (c[5] + c[11] - c[2] - c[8]), lift = bulge * qm_random_range(random, 0.2, 0.8);
    memcpy(triangle.faces, face, sizeof face);
    memcpy(triangle.positions, c, 9 * sizeof *c);
    for (int i = 0; i < 3; i++)
        triangle.positions[3 * i + 2] += lift;
    qm_mesh joined = qm_shape_joined(mesh, &triangle);
    qm_shape_free(mesh);
    qm_shape_free(&triangle);
    *mesh = joined;
}

/**
 * A quad of length 1 that is thin and bent out of its plane by less, against a face in the same place: a
 * needle along it, its two triangles, or points of it. The bend of it is what a bound for its flatness has to
 * see.
 */
static qm_pair thin_and_bent(qm_random *random)
{
    /* Most of them at the least width that a normal is taken from, bent by about as much as it is off
     * then. */
    bool at_the_limit = qm_random_below(random, 4) > 0;
    double width = at_the_limit ? qm_random_power(random, -5.7, -5.2) : qm_random_power(random, -6, -0.5);
    double bend = at_the_limit ? qm_random_power(random, -12.2, -11) : width * qm_random_power(random, -9, 0);
    qm_pair pair = {qm_shape_make(0, 0), qm_shape_make(4, 1)};
    static const uint32_t quad[4] = {0, 1, 2, 3};
    memcpy(pair.b.faces, quad, sizeof quad);
    for (int i = 0; i < 4; i++) {
        double *p = pair.b.positions + 3 * i, share = i < 2 ? 1 : qm_random_range(random, 0.2, 0.7);
        p[0] = share * (i == 1 || i == 2 ? 0.5 : -0.5);
        p[1] = i < 2 ? 0 : width * (at_the_limit ? 1 : qm_random_range(random, 0.1, 1));
        p[2] = bend * qm_random_range(random, -1, 1);
    }
    bool is_quad = qm_random_below(random, 3) == 0;
    pair.a = qm_shape_make(4, 1);
    memcpy(pair.a.faces, quad, sizeof quad);
    if (!is_quad) pair.a.faces[3] = QM_NO_INDEX;
    /* Corners on the patch or on its two triangles, on one of them or in line, or off by less than the
     * bend. */
    bool on_triangles = qm_random_below(random, 4) > 0, on_one = qm_random_below(random, 2);
    double off = qm_random_below(random, 4) ? 0 : bend * qm_random_power(random, -6, 0);
    for (int i = 0; i < 4; i++) {
        double s = qm_random_range(random, 0, 1), t = qm_random_range(random, 0, 1),
               *p = pair.a.positions + 3 * i;
        if (is_quad || qm_random_below(random, 4) == 0) {
            s = i == 1 || i == 2;
            t = i >= 2;
        } else if (on_one) {
            double least = fmin(s, t);
            s = fmax(s, t);
            t = least;
        }
        for (int k = 0; k < 3; k++) {
            const double *c = pair.b.positions + k;
            double flat = s > t ? c[0] + s * (c[3] - c[0]) + t * (c[6] - c[3])
                                : c[0] + t * (c[9] - c[0]) + s * (c[6] - c[9]);
            double bent = (1 - s) * (1 - t) * c[0] + s * (1 - t) * c[3] + s * t * c[6] + (1 - s) * t * c[9];
            p[k] = on_triangles ? flat : bent;
        }
        p[2] += off * qm_random_range(random, -1, 1);
    }
    if (qm_random_below(random, 2)) add_rival(random, &pair.b);
    turn(random, &pair);
    return pair;
}

static qm_pair slivers(qm_random *random)
{
    qm_mesh a = draw_soup(random, QM_SOUP_NEEDLES);
    qm_pair pair;
    if (qm_random_below(random, 2))
        pair = with_noise(random, a, qm_random_power(random, -12, -1));
    else
        pair = swapped(random, (qm_pair){a, qm_random_below(random, 2) ? draw_soup(random, QM_SOUP_NEEDLES)
                                                                       : draw_any(random)});
    turn(random, &pair);
    return pair;
}

/** Faces without area: corners that repeat, by index or by place, and corners in line. */
static qm_pair degenerate(qm_random *random)
{
    qm_mesh a = draw_soup(random, QM_SOUP_DEGENERATE);
    qm_pair pair = qm_random_below(random, 2) ? with_noise(random, a, qm_random_power(random, -15, -1))
                                              : (qm_pair){a, draw_any(random)};
    for (size_t times = qm_random_below(random, 3); times > 0; times--) {
        double *p = pair.a.positions;
        size_t from = qm_random_below(random, pair.a.vertex_count),
               to = qm_random_below(random, pair.a.vertex_count);
        if (from != to) memcpy(p + 3 * to, p + 3 * from, 3 * sizeof *p);
    }
    if (qm_random_below(random, 2)) turn(random, &pair);
    return swapped(random, pair);
}

static qm_pair nearly_identical(qm_random *random)
{
    qm_pair pair = with_noise(random, draw_any(random), qm_random_power(random, -15, -5));
    if (qm_random_below(random, 2)) turn(random, &pair);
    return pair;
}

/** Quads whose corners are swapped, so that they cross themselves, or folded over a diagonal. */
static qm_pair folded(qm_random *random)
{
    qm_mesh a = draw_quads(random, (double[]){0, 1e-9, 0.1, 1}[qm_random_below(random, 4)]);
    for (size_t f = 0; f < a.face_count; f++) {
        uint32_t *index = a.faces + 4 * f;
        size_t how = qm_random_below(random, 3);
        if (how < 2) {
            uint32_t first = index[1 + how];
            index[1 + how] = index[2 + how];
            index[2 + how] = first;
        } else {
            double *p = a.positions + 3 * (size_t)index[3], *q = a.positions + 3 * (size_t)index[1];
            for (int k = 0; k < 3; k++)
                p[k] = q[k] + qm_random_range(random, -0.1, 0.1);
        }
    }
    if (qm_random_below(random, 3) == 0) return swapped(random, (qm_pair){a, draw_any(random)});
    return with_noise(random, a, qm_random_power(random, -14, -1));
}

/** One surface of folded quads in two grids that do not match. */
static qm_pair regridded(qm_random *random)
{
    qm_fold fold = (qm_fold)qm_random_below(random, QM_FOLD_COUNT);
    qm_regridded_pair drawn =
        qm_regridded_draw(random, fold, (qm_regridding)qm_random_below(random, QM_REGRIDDING_COUNT));
    qm_pair pair = {drawn.a, drawn.b};
    if (qm_random_below(random, 2)) turn(random, &pair);
    return swapped(random, pair);
}

static qm_pair twisted(qm_random *random)
{
    qm_mesh a = draw_quads(random, qm_random_range(random, 0, 5));
    return swapped(random,
                   (qm_pair){a, qm_random_below(random, 2) ? draw_quads(random, 2) : draw_any(random)});
}

static qm_pair nearly_coincident_twisted(qm_random *random)
{
    return with_noise(random, draw_quads(random, qm_random_range(random, 0, 5)),
                      qm_random_power(random, -15, -2));
}

/** More faces than elsewhere, of all kinds, sharing corners and edges. */
static qm_pair mixed(qm_random *random)
{
    qm_mesh a = qm_shape_soup(random, 1 + qm_random_below(random, 20), QM_SOUP_MIXED,
                              (qm_soup_style)qm_random_below(random, QM_SOUP_STYLE_COUNT), 0.5);
    if (qm_random_below(random, 2)) return with_noise(random, a, qm_random_power(random, -12, -1));
    return (qm_pair){
        a, qm_shape_soup(random, 1 + qm_random_below(random, 20), QM_SOUP_MIXED, QM_SOUP_POOLED, 0.5)};
}

static qm_pair very_small_or_large(qm_random *random)
{
    qm_pair pair = near_origin(random);
    move(&pair, qm_random_power(random, -300, 290), (const double[3]){0, 0, 0});
    return pair;
}

/** The same facets twice, near and far, where the search has to go down to the last cells. */
static qm_pair deep(qm_random *random)
{
    size_t kind = qm_random_below(random, 4);
    return kind == 0 ? twisted(random) : kind == 1 ? nearly_coincident_twisted(random) : near_origin(random);
}

/** Whole numbers: distances that are equal to the last bit. */
static qm_pair tied(qm_random *random)
{
    qm_mesh a = draw_soup(random, QM_SOUP_LATTICE);
    qm_pair pair = {a, qm_random_below(random, 2) ? qm_shape_copy(&a) : draw_soup(random, QM_SOUP_LATTICE)};
    double shift[3];
    for (int k = 0; k < 3; k++)
        shift[k] = (double)qm_random_below(random, 5) - 2;
    qm_shape_move(&pair.b, qm_random_below(random, 2) ? 1 : -1, shift);
    return pair;
}

/** A face over the unit square or a stretch beside it, at a height and out of its plane by less than a
 * bend. */
static qm_mesh draw_layer(qm_random *random, int corners, double reach, double height, double bend)
{
    static const double square[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    double at[4][3];
    for (int i = 0; i < 4; i++) {
        for (int k = 0; k < 2; k++)
            at[i][k] = square[i][k] + qm_random_range(random, -reach, reach);
        at[i][2] = height + bend * qm_random_range(random, -1, 1);
    }
    return qm_shape_face(corners, (const double(*)[3])at);
}

/** A face over a patch, and between the two, or through the patch, another face that is nearer in part. */
static qm_pair layers(qm_random *random)
{
    double bend = qm_random_power(random, -4, 0), height = qm_random_power(random, -3, 0);
    qm_mesh patch = draw_layer(random, 4, 0.1, 0, bend);
    qm_mesh between = draw_layer(random, 3 + (int)qm_random_below(random, 2), 0.5,
                                 height * qm_random_range(random, -0.2, 0.9), bend);
    qm_pair pair = {draw_layer(random, 3 + (int)qm_random_below(random, 2), 0.3, height, 0.5 * bend),
                    qm_shape_joined(&patch, &between)};
    qm_shape_free(&patch);
    qm_shape_free(&between);
    turn(random, &pair);
    return pair;
}

/** Both meshes of a few faces and up to 10^6 of their sizes apart. */
static qm_pair apart(qm_random *random)
{
    qm_mesh a = draw_any(random);
    qm_pair pair = {a, draw_any(random)};
    double shift[3], away = qm_random_power(random, 0, 6);
    qm_random_direction(random, shift);
    for (int k = 0; k < 3; k++)
        shift[k] *= away;
    qm_shape_move(&pair.b, qm_random_power(random, -3, 0), shift);
    return swapped(random, pair);
}

const qm_case_kind qm_case_kinds[] = {
    {.name = "origin", .draw = near_origin},
    {.name = "offset", .draw = far_off},
    {.name = "map", .draw = on_a_map},
    {.name = "thin",
     .draw = thin_and_bent,
     .coarsest = -12,
     .only_patches = true,
     .only_from_a = true,
     .has_no_ties = true,
     .share = 4,
     .is_slow = true},
    {.name = "sliver", .draw = slivers, .is_slow = true},
    {.name = "degenerate", .draw = degenerate, .is_slow = true},
    {.name = "near-identical", .draw = nearly_identical, .coarsest = -10, .is_slow = true},
    {.name = "folded", .draw = folded, .only_patches = true, .is_slow = true},
    {.name = "regridded", .draw = regridded, .coarsest = -5, .only_patches = true, .is_slow = true},
    {.name = "twisted", .draw = twisted, .only_patches = true, .is_slow = true},
    {.name = "near-twisted",
     .draw = nearly_coincident_twisted,
     .has_no_ties = true,
     .coarsest = -10,
     .only_patches = true,
     .is_slow = true},
    {.name = "layers", .draw = layers, .only_patches = true, .has_no_ties = true, .is_slow = true},
    {.name = "mixed", .draw = mixed, .is_slow = true},
    {.name = "scales", .draw = very_small_or_large},
    {.name = "deep", .draw = deep, .coarsest = -10},
    {.name = "ties", .draw = tied},
    {.name = "apart", .draw = apart},
};
const size_t qm_case_kind_count = sizeof qm_case_kinds / sizeof *qm_case_kinds;
