/**
 * qm_quads_map_close: the steps of small meshes against those of a projection without the engine's solver, and what holds for
 * those of any mesh. qm_quads_find_phases: grids of a plane fit together.
 */
#include "check.h"

#include "failing_allocator.h"
#include "poll_cancel.h"
#include "quads/quads_internal.h"
#include "shapes.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define PI 3.14159265358979323846

/* The head of quads_map.c. */
#define LEAST_COMPLIANCE 0.05
#define MOST_COMPLIANCE 4.0
#define FAR_OFF 0.6
#define MOST_CHANGE 1.0
#define TOLERANCE 1e-3

#define FLOAT_ERROR 2e-5  /* of a step, after sums of many */
#define SOLVER_ERROR 0.01 /* of all changes, as a share of their norm: what TOLERANCE of the sums leaves */
#define CREASE 60.0       /* degrees: no edges of coarse spheres and tori, but those of boxes */

/* ---- meshes ---- */

static void to_sphere(double p[3])
{
    double length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    for (int k = 0; k < 3; k++)
        p[k] /= length;
}

/** A cone without its tip, round the z axis. */
static void cone_point(const void *user, double u, double v, double out[3])
{
    (void)user;
    double radius = 1.0 - 0.7 * v;
    out[0] = radius * cos(2.0 * PI * u);
    out[1] = radius * sin(2.0 * PI * u);
    out[2] = 1.2 * v;
}

static void tube_point(const void *user, double u, double v, double out[3])
{
    (void)user;
    out[0] = cos(2.0 * PI * u);
    out[1] = sin(2.0 * PI * u);
    out[2] = 2.0 * v;
}

/** A mesh, its crosses and their map. */
typedef struct subject {
    qm_context ctx;
    qm_trimesh m;
    qm_vec *cross;
    qm_quads_map map;
    double crease; /* degrees; 0: CREASE */
    char name[96];
} subject;

/** The triangles of a mesh, with boundaries and edges of more than an angle as features, none of which share a face. */
static void load(subject *s, qm_mesh surface)
{
    qm_mesh cut = qm_shape_triangulated(&surface);
    uint32_t(*corner)[3] = malloc(cut.face_count * sizeof *corner);
    assert_non_null(corner);
    for (size_t f = 0; f < cut.face_count; f++)
        memcpy(corner[f], cut.faces + 4 * f, sizeof *corner);
    s->ctx = qm_context_make();
    double crease = (s->crease > 0.0 ? s->crease : CREASE) * PI / 180.0;
    qm_trimesh *m = &s->m;
    assert_int_equal(qm_trimesh_build(&s->ctx, cut.positions, cut.vertex_count, (const uint32_t(*)[3])corner,
                                      cut.face_count, m),
                     QM_OK);
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        if (m->twin[h] != QM_NO_INDEX)
            m->is_feature[h] =
                qm_vec_angle(qm_trimesh_normal(m, h / 3), qm_trimesh_normal(m, m->twin[h] / 3)) > crease;
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        uint32_t line[2];
        int kind = qm_trimesh_kind(m, v, line);
        bool is_line = kind == QM_TRIMESH_ON_LINE;
        m->is_fixed[v] = kind == QM_TRIMESH_CORNER ||
                         (is_line && qm_vec_angle(qm_vec_sub(m->position[v], m->position[line[0]]),
                                                  qm_vec_sub(m->position[line[1]], m->position[v])) > 1.0);
    }
    assert_int_equal(qm_quads_separate_features(&s->ctx, m), QM_OK);
    s->cross = malloc(m->face_count * sizeof *s->cross);
    assert_non_null(s->cross);
    free(corner);
    qm_shape_free(&cut);
    qm_shape_free(&surface);
}

static void unload(subject *s)
{
    qm_quads_map_reset(&s->ctx, &s->map);
    qm_trimesh_reset(&s->ctx, &s->m);
    free(s->cross);
}

static qm_vec face_normal(const qm_trimesh *m, uint32_t f)
{
    return qm_vec_unit(qm_trimesh_normal(m, f));
}

static qm_vec rotated(qm_vec q, qm_vec normal, double angle)
{
    return qm_vec_add(qm_vec_scale(cos(angle), q), qm_vec_scale(sin(angle), qm_vec_cross(normal, q)));
}

/** Turns crosses by up to an angle, those at features by none, and all by any quarter turns. */
static void disturb(subject *s, qm_random *random, double angle)
{
    const qm_trimesh *m = &s->m;
    for (uint32_t f = 0; f < m->face_count; f++) {
        bool is_held = m->is_feature[3 * f] || m->is_feature[3 * f + 1] || m->is_feature[3 * f + 2];
        double turn = (is_held ? 0.0 : qm_random_range(random, -angle, angle)) +
                      0.5 * PI * (double)qm_random_below(random, 4);
        s->cross[f] = rotated(s->cross[f], face_normal(m, f), turn);
    }
}

/** The crosses that look most along a direction. */
static void aim(subject *s, qm_vec direction)
{
    for (uint32_t f = 0; f < s->m.face_count; f++) {
        qm_vec n = face_normal(&s->m, f);
        s->cross[f] = qm_vec_unit(qm_vec_axpy(direction, -qm_vec_dot(direction, n), n));
    }
}

static void build(subject *s, double unit)
{
    const qm_quads_corners none = {0};
    assert_int_equal(qm_quads_map_build(&s->ctx, &s->m, s->cross, &none, unit, &s->map), QM_OK);
}

static void close_map(subject *s, double size)
{
    assert_int_equal(qm_quads_map_close(&s->ctx, &s->m, &s->map, size), QM_OK);
}

enum { RANDOM_SHAPES = 6 };

/** A plane, a box, a sphere, a torus, a cone or a tube of a few dozen to 200 faces, with random crosses. */
static void make_random(subject *s, uint64_t run)
{
    qm_random random = qm_random_make(qm_check_seed(), run);
    static const char *const names[RANDOM_SHAPES] = {"plane", "box", "sphere", "torus", "cone", "tube"};
    qm_mesh surface = {0};
    int kind = (int)(run % RANDOM_SHAPES), n = 3 + (int)qm_random_below(&random, 2);
    switch (kind) {
    case 0:
        surface = qm_shape_plane(2 * n, 0.0);
        for (size_t v = 0; v < surface.vertex_count; v++) { /* the sides stay straight */
            double *p = surface.positions + 3 * v, shake = 0.25 / (2.0 * n);
            for (int k = 0; k < 2; k++)
                if (p[k] > 1e-9 && p[k] < 1.0 - 1e-9) p[k] += qm_random_range(&random, -shake, shake);
        }
        break;
    case 1:
        surface = qm_shape_cube_grid(n);
        break;
    case 2:
        surface = qm_shape_cube_grid(n);
        for (size_t v = 0; v < surface.vertex_count; v++)
            to_sphere(surface.positions + 3 * v);
        qm_shape_shake(&surface, &random, 0.02);
        break;
    case 3:
        surface = qm_shape_torus(9 + n, 4 + n, 1.0, 0.4);
        qm_shape_shake(&surface, &random, 0.02);
        break;
    case 4:
        surface = qm_shape_grid(8 + n, n, true, false, cone_point, NULL);
        break;
    default:
        surface = qm_shape_grid(8 + n, n + 1, true, false, tube_point, NULL);
        break;
    }
    *s = (subject){0};
    load(s, surface);
    assert_int_equal(qm_quads_find_crosses(&s->ctx, &s->m, true, s->cross), QM_OK);
    static const double angles[4] = {0.0, 0.1, 0.3, 0.7};
    double angle = angles[run / RANDOM_SHAPES % 4];
    disturb(s, &random, angle);
    snprintf(s->name, sizeof s->name, "seed %llu, run %llu (%s of %zu faces, crosses off by %g)",
             (unsigned long long)qm_check_seed(), (unsigned long long)run, names[kind], s->m.face_count,
             angle);
}

/** The root of the mean square of edges, over the size: quads are that much shorter. */
static double mean_edge(const qm_trimesh *m)
{
    double sum = 0.0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        sum += qm_vec_norm2(qm_trimesh_edge(m, h));
    return sqrt(sum / (3.0 * (double)m->face_count));
}

/* ---- steps by a projection ---- */

static void turn(double s[2], int quarters)
{
    for (int k = 0; k < (quarters & 3); k++) {
        double x = s[0];
        s[0] = -s[1], s[1] = x;
    }
}

/** The vector of a half-edge in the frame of its face. */
static void edge_in_frame(const subject *s, uint32_t h, double out[2])
{
    qm_vec q = s->cross[h / 3], edge = qm_trimesh_edge(&s->m, h);
    out[0] = qm_vec_dot(edge, q);
    out[1] = qm_vec_dot(edge, qm_vec_cross(face_normal(&s->m, h / 3), q));
}

/** The quarter turns that bring an edge in the frame of h nearest to itself in the frame across. */
static int turns_across(const subject *s, uint32_t h)
{
    double here[2], there[2];
    edge_in_frame(s, h, here);
    edge_in_frame(s, s->m.twin[h], there);
    int best = 0;
    double least = INFINITY;
    for (int k = 0; k < 4; k++) {
        double pair[2] = {here[0], here[1]};
        turn(pair, k);
        double off = hypot(pair[0] + there[0], pair[1] + there[1]);
        if (off < least) least = off, best = k;
    }
    return best;
}

static int feature_axis(const subject *s, uint32_t h)
{
    double edge[2];
    edge_in_frame(s, h, edge);
    return fabs(edge[0]) >= fabs(edge[1]) ? 0 : 1;
}

static bool is_first_half(const qm_trimesh *m, uint32_t h)
{
    return m->twin[h] == QM_NO_INDEX || m->twin[h] > h;
}

/** The problem: unknowns are the components of the first half-edges of edges, conditions the sums of faces. */
typedef struct twin {
    size_t columns, rows, rank;
    uint32_t *column; /* of each half-edge: of its first component; of a second half that of the first one */
    double *wanted, *compliance, *step;
    double *basis,
        *bound; /* orthonormal rows, of steps over the roots of their compliance, and what they amount to */
    double clamped; /* the greatest change */
} twin;

static void *allocate(size_t count, size_t size)
{
    void *block = calloc(count + 1, size);
    assert_non_null(block);
    return block;
}

/** The steps wanted: edges in sides of a quad, the mean of both faces, 0 across features. */
static twin make_twin(const subject *s, double size)
{
    const qm_trimesh *m = &s->m;
    size_t halves = 3 * m->face_count;
    twin t = {.rows = 2 * m->face_count, .column = allocate(halves, sizeof *t.column)};
    for (uint32_t h = 0; h < halves; h++)
        if (is_first_half(m, h)) t.column[h] = (uint32_t)t.columns, t.columns += 2;
    for (uint32_t h = 0; h < halves; h++)
        if (!is_first_half(m, h)) t.column[h] = t.column[m->twin[h]];
    t.wanted = allocate(t.columns, sizeof *t.wanted);
    t.compliance = allocate(t.columns, sizeof *t.compliance);
    t.step = allocate(t.columns, sizeof *t.step);
    t.basis = allocate(t.rows * t.columns, sizeof *t.basis);
    t.bound = allocate(t.rows, sizeof *t.bound);
    for (uint32_t h = 0; h < halves; h++) {
        if (!is_first_half(m, h)) continue;
        double edge[2], *wanted = t.wanted + t.column[h];
        edge_in_frame(s, h, edge);
        if (m->twin[h] != QM_NO_INDEX) {
            double other[2];
            edge_in_frame(s, m->twin[h], other);
            turn(other, 6 - turns_across(s, h));
            edge[0] = 0.5 * (edge[0] + other[0]), edge[1] = 0.5 * (edge[1] + other[1]);
        }
        for (int axis = 0; axis < 2; axis++)
            wanted[axis] = edge[axis] / size;
        if (m->is_feature[h]) wanted[1 - feature_axis(s, h)] = 0.0;
    }
    return t;
}

static void free_twin(twin *t)
{
    free(t->column), free(t->wanted), free(t->compliance), free(t->step), free(t->basis), free(t->bound);
}

/** share: of each edge, at its first component; NULL: 1 */
static void set_twin_compliance(const subject *s, twin *t, const double *share)
{
    const qm_trimesh *m = &s->m;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        if (!is_first_half(m, h)) continue;
        uint32_t c = t->column[h];
        double length2 = t->wanted[c] * t->wanted[c] + t->wanted[c + 1] * t->wanted[c + 1];
        double compliance = fmin(fmax(length2, LEAST_COMPLIANCE), MOST_COMPLIANCE) * (share ? share[c] : 1.0);
        t->compliance[c] = t->compliance[c + 1] = compliance;
        if (m->is_feature[h]) t->compliance[c + (uint32_t)(1 - feature_axis(s, h))] = 0.0;
    }
}

/** The factors of an edge's components in the sums of the face of a half-edge. */
static void add_to_sums(const subject *s, const twin *t, uint32_t h, double *const row[2])
{
    bool is_first = is_first_half(&s->m, h);
    for (int k = 0; k < 2; k++) {
        double unit[2] = {k == 0, k == 1};
        if (!is_first) turn(unit, 2 + turns_across(s, s->m.twin[h]));
        row[0][t->column[h] + (uint32_t)k] += unit[0];
        row[1][t->column[h] + (uint32_t)k] += unit[1];
    }
}

static double dot(const double *a, const double *b, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

/** The conditions as orthonormal rows, by Gram and Schmidt, twice over; those that follow from others go. */
static void find_basis(const subject *s, twin *t)
{
    double *pair[2] = {allocate(t->columns, sizeof(double)), allocate(t->columns, sizeof(double))};
    t->rank = 0;
    for (uint32_t f = 0; f < s->m.face_count; f++) {
        for (int axis = 0; axis < 2; axis++)
            memset(pair[axis], 0, t->columns * sizeof(double));
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++)
            add_to_sums(s, t, h, pair);
        for (int axis = 0; axis < 2; axis++) {
            double *row = pair[axis];
            for (size_t c = 0; c < t->columns; c++)
                row[c] *= sqrt(t->compliance[c]);
            double before = sqrt(dot(row, row, t->columns));
            for (size_t i = 0; i < 2 * t->rank; i++) {
                const double *other = t->basis + i % t->rank * t->columns;
                double part = dot(row, other, t->columns);
                for (size_t c = 0; c < t->columns; c++)
                    row[c] -= part * other[c];
            }
            double left = sqrt(dot(row, row, t->columns));
            if (!(left > 1e-7 * before) || left < 1e-12) continue;
            double *new_row = t->basis + t->rank++ * t->columns;
            for (size_t c = 0; c < t->columns; c++)
                new_row[c] = row[c] / left;
        }
    }
    free(pair[0]), free(pair[1]);
}

/** The nearest steps that sum up to 0, of which the rows of the basis are the normals. Steps across features are 0, which sums up too. */
static void project(const twin *t, const double *from, double *to)
{
    double *scaled = allocate(t->columns, sizeof *scaled), *whole = allocate(t->columns, sizeof *whole);
    for (size_t c = 0; c < t->columns; c++)
        scaled[c] = t->compliance[c] > 0.0 ? from[c] / sqrt(t->compliance[c]) : 0.0;
    for (size_t i = 0; i < 2 * t->rank; i++) {
        const double *row = t->basis + i % t->rank * t->columns;
        double part = dot(scaled, row, t->columns);
        for (size_t c = 0; c < t->columns; c++)
            scaled[c] -= part * row[c];
    }
    for (size_t c = 0; c < t->columns; c++)
        whole[c] = t->compliance[c] > 0.0 ? scaled[c] * sqrt(t->compliance[c]) : from[c];
    memcpy(to, whole, t->columns * sizeof *to);
    free(scaled), free(whole);
}

/** One pass. */
static void solve_twin(const subject *s, twin *t, const double *share)
{
    set_twin_compliance(s, t, share);
    find_basis(s, t);
    project(t, t->wanted, t->step);
    t->clamped = 0.0;
    for (size_t c = 0; c < t->columns; c++) {
        double change = t->step[c] - t->wanted[c];
        t->clamped = fmax(t->clamped, fabs(change));
        t->step[c] = t->wanted[c] + fmin(fmax(change, -MOST_CHANGE), MOST_CHANGE);
    }
}

/** What edges that have changed much keep of their compliance. */
static double *shares_of(const twin *t)
{
    double *share = allocate(t->columns, sizeof *share);
    for (size_t c = 0; c < t->columns; c += 2) {
        const double *d = t->step + c, *w = t->wanted + c;
        double change2 = (d[0] - w[0]) * (d[0] - w[0]) + (d[1] - w[1]) * (d[1] - w[1]);
        double scale = FAR_OFF * FAR_OFF * fmax(w[0] * w[0] + w[1] * w[1], LEAST_COMPLIANCE);
        share[c] = share[c + 1] = 1.0 / (1.0 + change2 / scale);
    }
    return share;
}

/** The steps of the engine, as the components of edges. */
static double *list_steps(const subject *s, const twin *t)
{
    double *step = allocate(t->columns, sizeof *step);
    for (uint32_t h = 0; h < 3 * s->m.face_count; h++)
        if (is_first_half(&s->m, h))
            for (uint32_t axis = 0; axis < 2; axis++)
                step[t->column[h] + axis] = (double)s->map.step[h][axis];
    return step;
}

static double distance_between(const double *a, const double *b, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum);
}

static double greatest_between(const double *a, const double *b, size_t count)
{
    double greatest = 0.0;
    for (size_t i = 0; i < count; i++)
        greatest = fmax(greatest, fabs(a[i] - b[i]));
    return greatest;
}

/** The norm of the sums of all faces. */
static double norm_of_sums(const subject *s, const twin *t, const double *step)
{
    double sum2 = 0.0, *row[2] = {allocate(t->columns, sizeof(double)), allocate(t->columns, sizeof(double))};
    for (uint32_t f = 0; f < s->m.face_count; f++) {
        for (int axis = 0; axis < 2; axis++)
            memset(row[axis], 0, t->columns * sizeof(double));
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++)
            add_to_sums(s, t, h, row);
        for (int axis = 0; axis < 2; axis++) {
            double sum = dot(row[axis], step, t->columns);
            sum2 += sum * sum;
        }
    }
    free(row[0]), free(row[1]);
    return sqrt(sum2);
}

static size_t count_across(const qm_quads_map *map)
{
    size_t count = 0;
    for (size_t h = 0; h < 3 * map->face_count; h++)
        count += map->is_across[h] != 0;
    return count;
}

/**
 * Compares with the twin, whose last pass is that of the engine. Changes of the engine's lie in the space that the rows span, so
 * that its steps, projected, are those of the twin however far its solver has come.
 */
static void check_steps(const subject *s, const twin *t, double error)
{
    double *step = list_steps(s, t), *nearest = allocate(t->columns, sizeof *nearest);
    double change = distance_between(t->wanted, t->step, t->columns);
    double before = norm_of_sums(s, t, t->wanted), after = norm_of_sums(s, t, step);
    double off = distance_between(step, t->step, t->columns);
    if (getenv("QM_TEST_SHOW"))
        print_message("%s: sums %.3g, %.3g; changes %.3g, greatest %.3g, off by %.3g\n", s->name, before,
                      after, change, t->clamped, off);
    double noise = FLOAT_ERROR * sqrt((double)t->columns);
    QM_CHECK(off <= error * change + noise, "%s: off by %.3g of %.3g", s->name, off, change);
    if (t->clamped < MOST_CHANGE) {
        QM_CHECK(after <= 1.1 * TOLERANCE * before + noise, "%s: sums of %.3g, before %.3g", s->name, after,
                 before);
        project(t, step, nearest);
        double apart = greatest_between(nearest, t->step, t->columns);
        QM_CHECK(error > SOLVER_ERROR || apart <= FLOAT_ERROR, "%s: %.3g apart", s->name, apart);
    }
    free(step), free(nearest);
}

/** The first pass is a projection. */
static void one_pass_is_a_projection(void **state)
{
    (void)state;
    size_t compared = 0;
    uint64_t runs = qm_check_long() ? 480 : 48;
    for (uint64_t run = 0; run < runs; run++) {
        subject s;
        make_random(&s, run);
        double size = 1.6 * mean_edge(&s.m);
        build(&s, size);
        s.map.size = size; /* as if closed before, with multipliers of 0: there is no second pass */
        close_map(&s, size);
        twin t = make_twin(&s, size);
        solve_twin(&s, &t, NULL);
        if (count_across(&s.map) == 0) {
            check_steps(&s, &t, SOLVER_ERROR);
            compared++;
        }
        free_twin(&t);
        unload(&s);
    }
    QM_CHECK(10 * compared >= 8 * runs, "seed %llu: %zu of %llu without strips",
             (unsigned long long)qm_check_seed(), compared, (unsigned long long)runs);
}

/** And so is the second, with the compliance that the first has left. */
static void both_passes_are_projections(void **state)
{
    (void)state;
    uint64_t runs = qm_check_long() ? 480 : 48;
    for (uint64_t run = 0; run < runs; run++) {
        subject s;
        make_random(&s, run);
        double size = 1.6 * mean_edge(&s.m);
        build(&s, 1.3 * size);
        close_map(&s, size);
        twin t = make_twin(&s, size);
        solve_twin(&s, &t, NULL);
        if (count_across(&s.map) == 0) {
            double *share = shares_of(&t);
            for (uint32_t h = 0; h < 3 * s.m.face_count; h++)
                QM_CHECK(fabs((double)s.map.share[h] - share[t.column[h]]) <= 0.05,
                         "%s: half-edge %u keeps %.4f, not %.4f", s.name, h, (double)s.map.share[h],
                         share[t.column[h]]);
            solve_twin(&s, &t, share);
            check_steps(&s, &t, 2.0 * SOLVER_ERROR);
            for (uint32_t h = 0; h < 3 * s.m.face_count; h++) /* the very shares of the engine */
                if (is_first_half(&s.m, h))
                    share[t.column[h]] = share[t.column[h] + 1] = (double)s.map.share[h];
            solve_twin(&s, &t, share);
            check_steps(&s, &t, SOLVER_ERROR);
            free(share);
        }
        free_twin(&t);
        unload(&s);
    }
}

/* ---- properties ---- */

/** Steps of twins agree; those of features are 0 across them; turns are those of the frames. */
static void check_map(const subject *s)
{
    const qm_trimesh *m = &s->m;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        const float *step = s->map.step[h];
        QM_CHECK(isfinite(step[0]) && isfinite(step[1]), "%s: half-edge %u", s->name, h);
        if (m->is_feature[h]) {
            double across = (double)step[1 - feature_axis(s, h)];
            QM_CHECK(across == 0.0, "%s: %.3g across the feature of half-edge %u", s->name, across, h);
        }
        uint32_t t = m->twin[h];
        if (t == QM_NO_INDEX) continue;
        QM_CHECK(s->map.turned[h] == turns_across(s, h), "%s: half-edge %u is turned %d times, not %d",
                 s->name, h, s->map.turned[h], turns_across(s, h));
        double back[2] = {(double)step[0], (double)step[1]};
        turn(back, 2 + s->map.turned[h]);
        double off = hypot(back[0] - (double)s->map.step[t][0], back[1] - (double)s->map.step[t][1]);
        QM_CHECK(off <= 1e-5 * (1.0 + hypot(back[0], back[1])), "%s: twins of half-edge %u are %.3g apart",
                 s->name, h, off);
    }
}

static void steps_agree_and_sum_up(void **state)
{
    (void)state;
    size_t closed = 0;
    uint64_t runs = qm_check_long() ? 960 : 96;
    for (uint64_t run = 0; run < runs; run++) {
        subject s;
        make_random(&s, run);
        qm_random random = qm_random_make(qm_check_seed(), 1000 + run);
        double size = qm_random_range(&random, 0.5, 2.5) * mean_edge(&s.m);
        build(&s, size);
        for (int k = 0; k < 3; k++, size *= qm_random_range(&random, 0.8, 1.25)) {
            close_map(&s, size);
            check_map(&s);
            twin t = make_twin(&s, size);
            double *step = list_steps(&s, &t);
            double before = norm_of_sums(&s, &t, t.wanted), after = norm_of_sums(&s, &t, step);
            double noise = FLOAT_ERROR * sqrt((double)t.columns);
            double greatest = greatest_between(step, t.wanted, t.columns);
            if (count_across(&s.map) == 0 && greatest < MOST_CHANGE - FLOAT_ERROR) {
                QM_CHECK(after <= 1e-2 * before + noise, "%s, size %g: sums of %.3g, before %.3g", s.name,
                         size, after, before);
                closed++;
            }
            free(step);
            free_twin(&t);
        }
        unload(&s);
    }
    QM_CHECK(2 * closed >= 3 * runs, "seed %llu: %zu of %llu closed", (unsigned long long)qm_check_seed(),
             closed, (unsigned long long)(3 * runs));
}

/** Where no length is at a limit of the compliance, the steps of all sizes are the same, scaled: another size starts from multipliers that fit. */
static void another_size_is_as_a_first_one(void **state)
{
    (void)state;
    size_t compared = 0, polls = 0;
    for (uint64_t run = 0; run < 48; run++) {
        subject s, fresh;
        make_random(&s, run);
        make_random(&fresh, run);
        double size = 1.25 * mean_edge(&s.m), next = 0.85 * size;
        build(&s, size);
        build(&fresh, next);
        close_map(&s, size);
        twin t = make_twin(&s, size);
        size_t at_limits = 0;
        for (size_t c = 0; c < t.columns; c += 2) {
            double length2 = t.wanted[c] * t.wanted[c] + t.wanted[c + 1] * t.wanted[c + 1];
            at_limits += length2 < LEAST_COMPLIANCE || length2 > MOST_COMPLIANCE * 0.7;
        }
        double *first = list_steps(&s, &t);
        close_map(&s, size);
        double *again = list_steps(&s, &t);
        double greatest = greatest_between(first, t.wanted, t.columns);
        double change = distance_between(first, t.wanted, t.columns);
        double off = distance_between(first, again, t.columns);
        QM_CHECK(off <= TOLERANCE * change + FLOAT_ERROR * sqrt((double)t.columns),
                 "%s: the same size gives other steps, off by %.3g", s.name, off);
        qm_poll_cancel c;
        qm_context watched = qm_poll_cancel_context(&c, SIZE_MAX);
        assert_int_equal(qm_quads_map_close(&watched, &s.m, &s.map, next), QM_OK);
        close_map(&fresh, next);
        if (count_across(&s.map) == 0 && count_across(&fresh.map) == 0 && at_limits == 0 &&
            greatest < 0.8 * MOST_CHANGE) {
            double *a = list_steps(&s, &t), *b = list_steps(&fresh, &t);
            off = distance_between(a, b, t.columns);
            QM_CHECK(off <= SOLVER_ERROR * change / 0.85 + FLOAT_ERROR * sqrt((double)t.columns),
                     "%s: steps of another size, off by %.3g of %.3g", s.name, off, change);
            compared++, polls += change > 1e-3 ? c.polls : 0; /* less is rounding, which differs */
            free(a), free(b);
        }
        free(first), free(again);
        free_twin(&t);
        unload(&s);
        unload(&fresh);
    }
    QM_CHECK(compared >= 16, "seed %llu: %zu of 48", (unsigned long long)qm_check_seed(), compared);
    /* the solver has nothing left to do, or nearly so */
    QM_CHECK(4 * polls <= compared, "seed %llu: %zu polls of %zu closings",
             (unsigned long long)qm_check_seed(), polls, compared);
}

/** Frames may be turned by quarters. */
static void quarter_turns_change_nothing(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 24; run++) {
        subject s, turned;
        make_random(&s, run);
        make_random(&turned, run);
        qm_random random = qm_random_make(qm_check_seed(), 2000 + run);
        disturb(&turned, &random, 0.0);
        double size = 1.6 * mean_edge(&s.m), change2 = 0.0, off2 = 0.0;
        build(&s, size);
        build(&turned, size);
        close_map(&s, size);
        close_map(&turned, size);
        for (uint32_t h = 0; h < 3 * s.m.face_count; h++) {
            double step[2] = {(double)s.map.step[h][0], (double)s.map.step[h][1]}, edge[2];
            edge_in_frame(&s, h, edge);
            change2 += pow(step[0] - edge[0] / size, 2) + pow(step[1] - edge[1] / size, 2);
            double x = qm_vec_dot(s.cross[h / 3], turned.cross[h / 3]);
            double y =
                qm_vec_dot(qm_vec_cross(s.cross[h / 3], turned.cross[h / 3]), face_normal(&s.m, h / 3));
            turn(step, 4 - (int)lrint(atan2(y, x) / (0.5 * PI)));
            off2 += pow(step[0] - (double)turned.map.step[h][0], 2) +
                    pow(step[1] - (double)turned.map.step[h][1], 2);
        }
        QM_CHECK(sqrt(off2) <=
                     SOLVER_ERROR * sqrt(change2) + FLOAT_ERROR * sqrt(6.0 * (double)s.m.face_count),
                 "%s: off by %.3g of %.3g", s.name, sqrt(off2), sqrt(change2));
        unload(&s);
        unload(&turned);
    }
}

/** A flat plane, or a tube, whose crosses are those of the grid. */
static void make_flat(subject *s, uint64_t run, int n, bool is_tube)
{
    qm_random random = qm_random_make(qm_check_seed(), run);
    *s = (subject){0};
    load(s, is_tube ? qm_shape_grid(3 * n, n, true, false, tube_point, NULL) : qm_shape_plane(n, 0.5));
    if (is_tube)
        aim(s, (qm_vec){0, 0, 1});
    else
        aim(s, (qm_vec){1, 0, 0});
    disturb(s, &random, 0.0);
    snprintf(s->name, sizeof s->name, "seed %llu, run %llu (%s)", (unsigned long long)qm_check_seed(),
             (unsigned long long)run, is_tube ? "tube" : "plane");
}

static void what_is_flat_stays(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 24; run++) {
        subject s;
        make_flat(&s, run, 3 + (int)(run / 2), run % 2);
        double size = mean_edge(&s.m) * (0.5 + 0.05 * (double)run);
        build(&s, 0.2);
        for (int k = 0; k < 2; k++, size *= 0.9) {
            close_map(&s, size);
            check_map(&s);
            QM_CHECK(count_across(&s.map) == 0, "%s: %zu half-edges across strips", s.name,
                     count_across(&s.map));
            for (uint32_t h = 0; h < 3 * s.m.face_count; h++) {
                double edge[2];
                edge_in_frame(&s, h, edge);
                double off = hypot((double)s.map.step[h][0] - edge[0] / size,
                                   (double)s.map.step[h][1] - edge[1] / size);
                QM_CHECK(off <= FLOAT_ERROR, "%s: half-edge %u is off by %.3g", s.name, h, off);
            }
        }
        unload(&s);
    }
}

/** A round plate of a radius of 3 from rings of vertices, with a chamfer at the upper rim of it or none. */
static qm_mesh round_plate(uint32_t sides, double height, double chamfer)
{
    uint32_t rings = chamfer > 0.0 ? 3 : 2, middle = rings * sides;
    const double radius[3] = {3.0, 3.0, 3.0 - chamfer}, z[3] = {0.0, height, height + chamfer};
    qm_mesh m = qm_shape_make(middle + 2, 2 * rings * sides);
    for (uint32_t v = 0; v < middle; v++) {
        double angle = 2.0 * PI * (v % sides) / sides, *p = m.positions + 3 * (size_t)v;
        p[0] = radius[v / sides] * cos(angle), p[1] = radius[v / sides] * sin(angle), p[2] = z[v / sides];
    }
    m.positions[3 * (size_t)middle + 5] = z[rings - 1];
    uint32_t *face = m.faces;
    for (uint32_t i = 0; i < sides; i++) {
        uint32_t j = (i + 1) % sides, top = (rings - 1) * sides;
        const uint32_t caps[2][4] = {{j, i, middle, QM_NO_INDEX},
                                     {top + i, top + j, middle + 1, QM_NO_INDEX}};
        memcpy(face, caps, sizeof caps);
        face += 8;
        for (uint32_t low = 0; low < top; low += sides, face += 8) {
            const uint32_t wall[2][4] = {{low + i, low + j, low + sides + j, QM_NO_INDEX},
                                         {low + i, low + sides + j, low + sides + i, QM_NO_INDEX}};
            memcpy(face, wall, sizeof wall);
        }
    }
    return m;
}

static void load_with_crosses(subject *s, qm_mesh surface, double crease, const char *name)
{
    *s = (subject){.crease = crease};
    load(s, surface);
    snprintf(s->name, sizeof s->name, "%s", name);
    assert_int_equal(qm_quads_find_crosses(&s->ctx, &s->m, true, s->cross), QM_OK);
}

/** How many half-edges without a feature lie between both sides of a strip; each has a step of 1 across it, away from the feature of
 * its face. Those that are marked have it exactly, the others as far as sums are closed. */
static size_t count_between(const subject *s, bool (*is_between)(qm_vec a, qm_vec b))
{
    size_t count = 0;
    for (uint32_t h = 0; h < 3 * s->m.face_count; h++) {
        qm_vec a = s->m.position[s->m.from[h]], b = s->m.position[qm_trimesh_to(&s->m, h)];
        uint32_t feature = h / 3 * 3;
        while (feature < h / 3 * 3 + 3 && !s->m.is_feature[feature])
            feature++;
        if (s->m.is_feature[h] || !is_between(a, b) || feature == h / 3 * 3 + 3) continue;
        count++;
        int axis = 1 - feature_axis(s, feature);
        double edge[2], step = (double)s->map.step[h][axis];
        edge_in_frame(s, h, edge);
        bool is_marked = s->map.is_across[h] >> axis & 1;
        QM_CHECK(fabs(fabs(step) - 1.0) <= (is_marked ? 0.0 : 0.02) && step * edge[axis] > 0.0,
                 "%s: half-edge %u has a step of %g", s->name, h, step);
    }
    return count;
}

static bool is_across_strip(qm_vec a, qm_vec b)
{
    return fabs(a.y - b.y) > 0.29;
}

static bool is_across_rim(qm_vec a, qm_vec b)
{
    return fabs(a.z - b.z) > 0.29;
}

/** A plane narrower than a quad, and a thin plate: what lies between their rims has a step of 1. A chamfer is none of these. */
static void strips_have_a_step_of_one(void **state)
{
    (void)state;
    subject s;
    qm_mesh strip = qm_shape_strip(8, 1, 0.0);
    for (size_t v = 0; v < strip.vertex_count; v++)
        strip.positions[3 * v + 1] *= 0.3;
    load_with_crosses(&s, strip, CREASE, "strip");
    build(&s, 1.0);
    for (double size = 1.0; size > 0.5; size *= 0.8) {
        close_map(&s, size);
        check_map(&s);
        size_t between = count_between(&s, is_across_strip);
        /* 7 sides of cells and 6 diagonals, twice each; those of the corners are cut, and two faces have no feature */
        QM_CHECK(between == 24, "%s: %zu half-edges", s.name, between);
        for (uint32_t f = 0; f < s.m.face_count; f++)
            for (int axis = 0; axis < 2; axis++) {
                float sum =
                    s.map.step[3 * f][axis] + s.map.step[3 * f + 1][axis] + s.map.step[3 * f + 2][axis];
                QM_CHECK(fabs((double)sum) < 2e-2, "%s: %g round face %u", s.name, (double)sum, f);
            }
    }
    close_map(&s, 0.1);
    QM_CHECK(count_across(&s.map) == 0, "%s: %zu half-edges across, of three quads", s.name,
             count_across(&s.map));
    unload(&s);
    load_with_crosses(&s, round_plate(16, 0.3, 0.0), CREASE, "plate");
    build(&s, 1.0);
    close_map(&s, 1.0);
    check_map(&s);
    size_t between = count_between(&s, is_across_rim);
    QM_CHECK(between == 64 && count_across(&s.map) >= 48, "%s: %zu half-edges, %zu of them marked", s.name,
             between, count_across(&s.map));
    unload(&s);
    load_with_crosses(&s, round_plate(16, 3.0, 0.2), 30.0, "chamfer");
    build(&s, 1.0);
    close_map(&s, 1.0);
    check_map(&s);
    QM_CHECK(count_across(&s.map) == 0, "%s: %zu half-edges across", s.name, count_across(&s.map));
    unload(&s);
}

/* ---- phases ---- */

static qm_quads_phases make_phases(const subject *s)
{
    return (qm_quads_phases){allocate(s->m.vertex_count, 2 * sizeof(double)),
                             allocate(3 * s->m.face_count, 1)};
}

static void free_phases(qm_quads_phases *p)
{
    free(p->phase), free(p->turned);
}

/** The phase of the first vertex of a half-edge, in the frame of its face. */
static void phase_at(const subject *s, const qm_quads_phases *p, uint32_t h, double out[2])
{
    memcpy(out, p->phase[s->m.from[h]], 2 * sizeof *out);
    turn(out, 4 - p->turned[h]);
}

/** Phases are those of the nearest corner, 0 across features and at corners. */
static void check_phases(const subject *s, const qm_quads_phases *p)
{
    const qm_trimesh *m = &s->m;
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        const double *phase = p->phase[v];
        QM_CHECK(fabs(phase[0]) <= 0.5 && fabs(phase[1]) <= 0.5, "%s: vertex %u at (%g, %g)", s->name, v,
                 phase[0], phase[1]);
        QM_CHECK(!m->is_fixed[v] || (phase[0] == 0.0 && phase[1] == 0.0), "%s: corner %u at (%g, %g)",
                 s->name, v, phase[0], phase[1]);
        QM_CHECK(p->turned[qm_trimesh_first(m, v)] == 0, "%s: the frame of vertex %u is turned", s->name, v);
    }
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t back = qm_trimesh_prev(h);
        if (m->twin[back] != QM_NO_INDEX && m->twin[back] != qm_trimesh_first(m, m->from[h]))
            QM_CHECK(p->turned[m->twin[back]] == ((p->turned[h] + turns_across(s, m->twin[back])) & 3),
                     "%s: half-edge %u is turned %d times, the one before %d", s->name, m->twin[back],
                     p->turned[m->twin[back]], p->turned[h]);
        if (!m->is_feature[h]) continue;
        int across = 1 - feature_axis(s, h);
        const uint32_t end[2] = {h, qm_trimesh_next(h)};
        for (int k = 0; k < 2; k++) {
            double phase[2];
            phase_at(s, p, end[k], phase);
            QM_CHECK(phase[across] == 0.0, "%s: vertex %u is %g off its feature", s->name, m->from[end[k]],
                     phase[across]);
        }
    }
}

/** How far the step of an edge and the phases of its ends are from whole numbers, at most. */
static double greatest_misfit(const subject *s, const qm_quads_phases *p)
{
    double greatest = 0.0;
    for (uint32_t h = 0; h < 3 * s->m.face_count; h++) {
        double from[2], to[2];
        phase_at(s, p, h, from);
        phase_at(s, p, qm_trimesh_next(h), to);
        for (int axis = 0; axis < 2; axis++) {
            double whole = (double)s->map.step[h][axis] + from[axis] - to[axis];
            greatest = fmax(greatest, fabs(whole - rint(whole)));
        }
    }
    return greatest;
}

static void grids_of_a_plane_fit_together(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 32; run++) {
        subject s;
        int quads = 2 + (int)(run % 8), n = 2 * quads + 1 + (int)(run / 8);
        make_flat(&s, run, n, false);
        double size = 1.0 / quads;
        build(&s, size);
        close_map(&s, size);
        qm_quads_phases p = make_phases(&s);
        assert_int_equal(qm_quads_find_phases(&s.ctx, &s.m, &s.map, &p), QM_OK);
        check_phases(&s, &p);
        double misfit = greatest_misfit(&s, &p);
        if (getenv("QM_TEST_SHOW")) print_message("%s, %d quads: misfit %.3g\n", s.name, quads, misfit);
        QM_CHECK(misfit <= 1e-3, "%s, %d quads a side: %.3g", s.name, quads, misfit);
        free_phases(&p);
        unload(&s);
    }
}

static void phases_are_zero_at_features(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 48; run++) {
        subject s;
        make_random(&s, run);
        double size = 1.8 * mean_edge(&s.m);
        build(&s, size);
        close_map(&s, size);
        qm_quads_phases p = make_phases(&s);
        assert_int_equal(qm_quads_find_phases(&s.ctx, &s.m, &s.map, &p), QM_OK);
        check_phases(&s, &p);
        free_phases(&p);
        unload(&s);
    }
}

/* ---- errors ---- */

/** All that is tested here, in a context; the map is given back whatever happens. */
static qm_status run_all(qm_context *ctx, const subject *s, double size, const qm_quads_phases *p)
{
    const qm_quads_corners none = {0};
    qm_quads_map map;
    qm_status status = qm_quads_map_build(ctx, &s->m, s->cross, &none, size, &map);
    if (status == QM_OK) status = qm_quads_map_close(ctx, &s->m, &map, size);
    if (status == QM_OK) status = qm_quads_map_close(ctx, &s->m, &map, 0.7 * size);
    if (status == QM_OK) status = qm_quads_find_phases(ctx, &s->m, &map, p);
    qm_quads_map_reset(ctx, &map);
    QM_CHECK(!map.turned && !map.edge && !map.step && !map.share && !map.is_across && !map.multiplier, "%s",
             s->name);
    return status;
}

static void memory_and_cancel_end_the_calls(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < RANDOM_SHAPES; run++) {
        subject s;
        make_random(&s, run + (uint64_t)2 * RANDOM_SHAPES);
        double size = 1.6 * mean_edge(&s.m);
        qm_quads_phases p = make_phases(&s);
        qm_status status = QM_E_NO_MEMORY;
        size_t calls = 0;
        for (; status != QM_OK; calls++) {
            qm_failing_allocator memory = {.fail_at = calls};
            qm_context poor = qm_context_make();
            poor.allocator = qm_failing_allocator_hook(&memory);
            status = run_all(&poor, &s, size, &p);
            QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "%s, call %zu: %d", s.name, calls, status);
            QM_CHECK(memory.live_blocks == 0 && !memory.mismatched,
                     "%s, call %zu leaves %zu blocks, mismatched %d", s.name, calls, memory.live_blocks,
                     memory.mismatched);
        }
        QM_CHECK(calls > 16, "%s: %zu calls", s.name, calls);
        qm_poll_cancel c;
        qm_context watched = qm_poll_cancel_context(&c, SIZE_MAX);
        assert_int_equal(run_all(&watched, &s, size, &p), QM_OK);
        size_t all = c.polls;
        QM_CHECK(all > 12, "%s: %zu polls", s.name, all);
        for (size_t at = 0; at < all; at++) {
            qm_failing_allocator memory = {.fail_at = SIZE_MAX};
            watched = qm_poll_cancel_context(&c, at);
            watched.allocator = qm_failing_allocator_hook(&memory);
            status = run_all(&watched, &s, size, &p);
            QM_CHECK(status == QM_E_CANCELED, "%s, poll %zu of %zu: %d", s.name, at, all, status);
            QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "%s, poll %zu leaves %zu blocks", s.name,
                     at, memory.live_blocks);
        }
        watched = qm_poll_cancel_context(&c, SIZE_MAX); /* each call by itself */
        build(&s, size);
        atomic_store(&c.is_canceled, true);
        assert_int_equal(qm_quads_map_close(&watched, &s.m, &s.map, size), QM_E_CANCELED);
        close_map(&s, size);
        assert_int_equal(qm_quads_find_phases(&watched, &s.m, &s.map, &p), QM_E_CANCELED);
        free_phases(&p);
        unload(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_pass_is_a_projection),     cmocka_unit_test(both_passes_are_projections),
        cmocka_unit_test(steps_agree_and_sum_up),       cmocka_unit_test(another_size_is_as_a_first_one),
        cmocka_unit_test(quarter_turns_change_nothing), cmocka_unit_test(what_is_flat_stays),
        cmocka_unit_test(strips_have_a_step_of_one),    cmocka_unit_test(grids_of_a_plane_fit_together),
        cmocka_unit_test(phases_are_zero_at_features),  cmocka_unit_test(memory_and_cancel_end_the_calls),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
