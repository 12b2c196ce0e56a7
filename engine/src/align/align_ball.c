/**
 * align_ball.c: the smallest ball around a surface, between two bounds that are proven.
 *
 * A support of up to four points is kept. The point that lies farthest out of its ball joins it, and the smallest ball of
 * these five, found among all their subsets, gives the next support; the radius rises each time, so a support never
 * returns. Whatever the support is, its ball gives both bounds:
 *   - upper: the largest distance of any point from the center;
 *   - lower: weights w_i >= 0 of sum 1 on the points of the support. For every center c the largest squared distance is at
 *     least sum w_i |p_i - c|^2 >= sum w_i |p_i - m|^2 with m = sum w_i p_i, which is at least the same sum around another
 *     point less its squared distance from m.
 *
 * Source: Gaertner, Fast and robust smallest enclosing balls, 1999 (pivots); the lower bound is the dual program.
 */
#include "qm/align.h"

#include <float.h>

#include "core/bits.h"
#include "core/linear.h"
#include "core/vec.h"

#define MAX_SUPPORT 4
#define MAX_PIVOTS 256
#define ROUNDING                                                                                             \
    1e-12 /* a smaller negative weight is 0, and as a fraction of the radius a smaller distance */

/**
 * What both bounds are opened by, as a fraction of the radius R. With u = 2^-53: points are shifted by the center of their
 * box, of which they are at most sqrt(3) R away, with one rounding each: at most 1.8 u R. A computed distance is off by at most
 * 4 u (a difference, a square, two sums, half of that by the root, and the root's own). The lower bound's sum V of positive
 * terms is off by at most 16 u V, and V less the square, at least V / 2, by twice that, of which the root takes half: 16 u.
 * Together less than 32 u.
 */
#define MARGIN 0x1p-48

typedef struct ball {
    qm_vec support[MAX_SUPPORT];
    double weight[MAX_SUPPORT];
    int count;
    qm_vec center;
    double radius;
} ball;

/** The smallest sphere through points that are not degenerate, when its center lies in their hull; false else. */
static bool make_ball(const qm_vec *point, int count, ball *out)
{
    qm_vec edge[MAX_SUPPORT - 1];
    double x[MAX_SUPPORT - 1];
    qm_least_squares gram = {.count = count - 1};
    for (int i = 1; i < count; i++) {
        edge[i - 1] = qm_vec_sub(point[i], point[0]);
        for (int j = 1; j <= i; j++)
            gram.matrix[i - 1][j - 1] = qm_vec_dot(edge[i - 1], edge[j - 1]);
        gram.right[i - 1] = 0.5 * qm_vec_norm2(edge[i - 1]);
    }
    if (count > 1 && !qm_linear_solve(&gram, x)) return false;
    *out = (ball){.count = count, .center = point[0]};
    double first = 1.0;
    for (int i = 1; i < count; i++) {
        if (!(x[i - 1] >= -ROUNDING)) return false;
        out->weight[i] = qm_max(x[i - 1], 0.0);
        out->center = qm_vec_axpy(out->center, x[i - 1], edge[i - 1]);
        first -= x[i - 1];
    }
    if (!(first >= -ROUNDING)) return false;
    out->weight[0] = qm_max(first, 0.0);
    for (int i = 0; i < count; i++)
        out->support[i] = point[i];
    out->radius = qm_vec_radius(point, count, out->center);
    return true;
}

/** The smallest ball of a few points: the smallest of a subset that contains the others. False when roundings hide it. */
static bool enclose_few(const qm_vec *point, int count, ball *out)
{
    bool is_found = false;
    for (unsigned set = 1; set < 1u << count; set++) {
        qm_vec chosen[MAX_SUPPORT + 1];
        int size = 0;
        for (int i = 0; i < count; i++)
            if (set >> i & 1u) chosen[size++] = point[i];
        ball candidate;
        if (size > MAX_SUPPORT || !make_ball(chosen, size, &candidate)) continue;
        if (qm_vec_radius(point, count, candidate.center) > candidate.radius * (1.0 + ROUNDING)) continue;
        if (is_found && candidate.radius >= out->radius) continue;
        *out = candidate;
        is_found = true;
    }
    return is_found;
}

static size_t find_farthest(const qm_vec *point, size_t count, qm_vec center, double *distance)
{
    size_t farthest = 0;
    double most = -1.0;
    for (size_t i = 0; i < count; i++) {
        double d = qm_vec_norm2(qm_vec_sub(point[i], center));
        if (d > most) {
            most = d;
            farthest = i;
        }
    }
    *distance = qm_vec_distance(point[farthest], center);
    return farthest;
}

/** The lower bound that the weights of a support prove, before the margin; reach is at least the radius. */
static double find_lower(const ball *b, double reach)
{
    double sum = 0.0, total = 0.0;
    qm_vec mean = {0, 0, 0};
    for (int i = 0; i < b->count; i++) {
        const qm_vec d = qm_vec_sub(b->support[i], b->center);
        sum += b->weight[i] * qm_vec_norm2(d);
        mean = qm_vec_axpy(mean, b->weight[i], d);
        total += b->weight[i];
    }
    if (!(total > 0.0)) return 0.0;
    const double square = sum / total, off = qm_vec_norm(mean) / total + MARGIN * reach;
    return off * off > 0.5 * square ? 0.0 : sqrt(square - off * off);
}

/** Bounds of the radius of points of about size 1 around 0. */
static void enclose_points(const qm_vec *point, size_t count, qm_vec *center, double *lower, double *upper)
{
    ball b = {.support = {point[0]}, .weight = {1.0}, .count = 1, .center = point[0]};
    *lower = 0.0;
    *upper = INFINITY;
    for (int pivot = 0; pivot < MAX_PIVOTS; pivot++) {
        double reach;
        const size_t farthest = find_farthest(point, count, b.center, &reach);
        if (reach < *upper) {
            *upper = reach;
            *center = b.center;
        }
        *lower = qm_max(*lower, find_lower(&b, reach));
        if (reach <= b.radius) break;
        qm_vec few[MAX_SUPPORT + 1];
        for (int i = 0; i < b.count; i++)
            few[i] = b.support[i];
        few[b.count] = point[farthest];
        ball next;
        if (!enclose_few(few, b.count + 1, &next) || !(next.radius > b.radius)) break;
        b = next;
    }
    *upper *= 1.0 + MARGIN;
    *lower *= 1.0 - MARGIN;
}

/** The vertices that are part of the surface, shifted by the center of their box and scaled by 2^-exponent. */
static size_t gather(const qm_mesh *mesh, const uint64_t *used, const double center[3], int exponent,
                     qm_vec *point)
{
    size_t count = 0;
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        if (used && !qm_bits_has(used, i)) continue;
        const double *p = mesh->positions + 3 * i;
        point[count++] = (qm_vec){ldexp(p[0] - center[0], -exponent), ldexp(p[1] - center[1], -exponent),
                                  ldexp(p[2] - center[2], -exponent)};
    }
    return count;
}

qm_status qm_align_enclose(qm_context *ctx, const qm_mesh *mesh, qm_align_ball *out)
{
    QM_ASSERT(ctx && mesh && out && mesh->vertex_count > 0);
    const qm_box box = qm_mesh_bounding_box(mesh);
    int exponent;
    frexp(qm_mesh_box_diagonal(&box), &exponent);
    for (int k = 0; k < 3; k++)
        out->center[k] = 0.5 * box.min[k] + 0.5 * box.max[k];
    qm_vec *point = qm_context_alloc(ctx, mesh->vertex_count, sizeof *point);
    uint64_t *used = mesh->face_count > 0 ? qm_bits_create(ctx, mesh->vertex_count) : NULL;
    const bool has_memory = point && (used || mesh->face_count == 0);
    if (has_memory) {
        for (size_t i = 0; i < 4 * mesh->face_count; i++)
            if (mesh->faces[i] != QM_NO_INDEX) qm_bits_add(used, mesh->faces[i]);
        const size_t count = gather(mesh, used, out->center, exponent, point);
        qm_vec center = {0.0, 0.0, 0.0};
        enclose_points(point, count, &center, &out->lower, &out->upper);
        /* Scaling back is exact, but for subnormal numbers. */
        out->lower = out->lower > 0.0 ? nextafter(ldexp(out->lower, exponent), 0.0) : 0.0;
        out->upper = out->upper > 0.0 ? nextafter(ldexp(out->upper, exponent), INFINITY) : 0.0;
        out->center[0] += ldexp(center.x, exponent);
        out->center[1] += ldexp(center.y, exponent);
        out->center[2] += ldexp(center.z, exponent);
    }
    if (used) qm_bits_free(ctx, used, mesh->vertex_count);
    qm_context_free(ctx, point, mesh->vertex_count, sizeof *point);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the enclosing ball");
}

double qm_align_floor(const qm_align_ball *a, const qm_align_ball *b)
{
    const double floor = qm_max(a->lower - b->upper, b->lower - a->upper);
    /* The difference is rounded once. */
    return floor > 0.0 ? nextafter(floor, 0.0) : 0.0;
}
