#include "reach.h"

#include <string.h>

#include "bigint.h"

#define DEGREE 6
/* A difference has a bit more than its terms, a sum of three products two more than these: less than three for each
 * factor. */
#define MAX_BITS ((QM_BIGINT_LIMBS - 2) * 64 / DEGREE - 3)

/* ---- vectors of integers ---- */

typedef struct big_vec {
    qm_bigint x[3];
} big_vec;

/** The power of two of which all these numbers are integers; false when that takes too many bits. */
static bool find_unit(const double *const *points, int count, double limit, int *low)
{
    int high = 0, here_low, here_high;
    bool found = qm_bigint_span(&limit, 1, low, &high);
    for (int i = 0; i < count; i++) {
        if (!qm_bigint_span(points[i], 3, &here_low, &here_high)) continue;
        if (!found || here_low < *low) *low = here_low;
        if (!found || here_high > high) high = here_high;
        found = true;
    }
    if (!found) *low = 0;
    return !found || high - *low + 1 <= MAX_BITS;
}

static void set_difference(big_vec *out, const double p[3], const double q[3], int low)
{
    for (int k = 0; k < 3; k++) {
        qm_bigint a, b;
        qm_bigint_set(&a, p[k], low);
        qm_bigint_set(&b, q[k], low);
        qm_bigint_add(&out->x[k], &a, &b, 1);
    }
}

static void set_dot(qm_bigint *out, const big_vec *a, const big_vec *b)
{
    qm_bigint product;
    qm_bigint_multiply(out, &a->x[0], &b->x[0]);
    for (int k = 1; k < 3; k++) {
        qm_bigint_multiply(&product, &a->x[k], &b->x[k]);
        qm_bigint_add(out, out, &product, 0);
    }
}

static void set_cross(big_vec *out, const big_vec *a, const big_vec *b)
{
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        qm_bigint left, right;
        qm_bigint_multiply(&left, &a->x[i], &b->x[j]);
        qm_bigint_multiply(&right, &a->x[j], &b->x[i]);
        qm_bigint_add(&out->x[k], &left, &right, 1);
    }
}

static bool is_at_most(const qm_bigint *a, const qm_bigint *b)
{
    qm_bigint difference;
    qm_bigint_add(&difference, a, b, 1);
    return difference.sign <= 0;
}

/** a <= limit2 * b. */
static bool is_within(const qm_bigint *a, const qm_bigint *limit2, const qm_bigint *b)
{
    qm_bigint product;
    qm_bigint_multiply(&product, limit2, b);
    return is_at_most(a, &product);
}

/* ---- features ---- */

/** Near the line of an edge, with the foot between its ends; from is the point as seen from the edge's first end. */
static bool is_near_edge(const big_vec *from, const big_vec *edge, const qm_bigint *limit2)
{
    qm_bigint along, length2, aside2;
    big_vec aside;
    set_dot(&length2, edge, edge);
    set_dot(&along, from, edge);
    if (length2.sign == 0 || along.sign < 0 || !is_at_most(&along, &length2)) return false;
    set_cross(&aside, from, edge);
    set_dot(&aside2, &aside, &aside);
    return is_within(&aside2, limit2, &length2);
}

/** Near the plane, with the foot inside of all edges. */
static bool is_near_plane(const big_vec from[3], const big_vec edge[3], const qm_bigint *limit2)
{
    big_vec normal, side;
    qm_bigint length2, height, height2, inside;
    set_cross(&normal, &edge[0], &edge[1]);
    set_dot(&length2, &normal, &normal);
    if (length2.sign == 0) return false;
    for (int i = 0; i < 3; i++) {
        set_cross(&side, &edge[i], &from[i]);
        set_dot(&inside, &side, &normal);
        if (inside.sign < 0) return false;
    }
    set_dot(&height, &from[0], &normal);
    qm_bigint_multiply(&height2, &height, &height);
    return is_within(&height2, limit2, &length2);
}

bool qm_reach_point(const double p[3], const double q[3], double limit)
{
    int low;
    if (p[0] == q[0] && p[1] == q[1] && p[2] == q[2]) return true;
    if (!find_unit((const double *const[]){p, q}, 2, limit, &low)) return false;
    big_vec from;
    qm_bigint length2, reach, limit2;
    set_difference(&from, p, q, low);
    set_dot(&length2, &from, &from);
    qm_bigint_set(&reach, limit, low);
    qm_bigint_multiply(&limit2, &reach, &reach);
    return is_at_most(&length2, &limit2);
}

bool qm_reach_triangle(const double p[3], const double *const corner[3], double limit)
{
    int low;
    for (int i = 0; i < 3; i++)
        if (memcmp(p, corner[i], 3 * sizeof *p) == 0) return true;
    if (!find_unit((const double *const[]){p, corner[0], corner[1], corner[2]}, 4, limit, &low)) return false;
    big_vec from[3], edge[3];
    qm_bigint reach, limit2, length2;
    qm_bigint_set(&reach, limit, low);
    qm_bigint_multiply(&limit2, &reach, &reach);
    for (int i = 0; i < 3; i++) {
        set_difference(&from[i], p, corner[i], low);
        set_difference(&edge[i], corner[(i + 1) % 3], corner[i], low);
    }
    if (is_near_plane(from, edge, &limit2)) return true;
    for (int i = 0; i < 3; i++) {
        set_dot(&length2, &from[i], &from[i]);
        if (is_at_most(&length2, &limit2) || is_near_edge(&from[i], &edge[i], &limit2)) return true;
    }
    return false;
}

bool qm_reach_is_flat(const double *const corner[4])
{
    int low;
    if (!find_unit(corner, 4, 0.0, &low)) return false;
    big_vec first, second;
    set_difference(&first, corner[0], corner[1], low);
    set_difference(&second, corner[3], corner[2], low);
    for (int k = 0; k < 3; k++) {
        qm_bigint difference;
        qm_bigint_add(&difference, &first.x[k], &second.x[k], 1);
        if (difference.sign != 0) return false;
    }
    return true;
}
