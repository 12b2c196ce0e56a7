#include "exact_twin.h"

static qm_bigint_point minus(qm_bigint_point a, qm_bigint_point b)
{
    return (qm_bigint_point){{a.x[0] - b.x[0], a.x[1] - b.x[1], a.x[2] - b.x[2]}};
}

static qm_bigint_point cross(qm_bigint_point a, qm_bigint_point b)
{
    return (qm_bigint_point){{a.x[1] * b.x[2] - a.x[2] * b.x[1], a.x[2] * b.x[0] - a.x[0] * b.x[2],
                              a.x[0] * b.x[1] - a.x[1] * b.x[0]}};
}

static __int128 dot(qm_bigint_point a, qm_bigint_point b)
{
    __int128 sum = 0;
    for (int k = 0; k < 3; k++)
        sum += (__int128)a.x[k] * b.x[k];
    return sum;
}

static bool is_zero(qm_bigint_point a)
{
    return a.x[0] == 0 && a.x[1] == 0 && a.x[2] == 0;
}

static int sign(__int128 x)
{
    return (x > 0) - (x < 0);
}

int qm_exact_turn(qm_bigint_point a, qm_bigint_point b, qm_bigint_point c, qm_bigint_point d)
{
    return sign(dot(cross(minus(b, a), minus(c, a)), minus(d, a)));
}

/** 0 on the segment a b */
static bool zero_in_segment(qm_bigint_point a, qm_bigint_point b)
{
    return is_zero(cross(a, b)) && dot(a, b) <= 0;
}

/** 0 in the proper triangle a b c */
static bool zero_in_triangle(qm_bigint_point a, qm_bigint_point b, qm_bigint_point c)
{
    qm_bigint_point normal = cross(minus(b, a), minus(c, a));
    if (is_zero(normal) || dot(normal, a) != 0) return false;
    return dot(normal, cross(a, b)) >= 0 && dot(normal, cross(b, c)) >= 0 && dot(normal, cross(c, a)) >= 0;
}

/** 0 in the tetrahedron, which must have a volume */
static bool zero_in_tetrahedron(const qm_bigint_point p[4])
{
    int volume = qm_exact_turn(p[0], p[1], p[2], p[3]);
    if (volume == 0) return false;
    for (int i = 0; i < 4; i++) {
        qm_bigint_point q[4] = {p[0], p[1], p[2], p[3]};
        q[i] = (qm_bigint_point){{0, 0, 0}};
        if (qm_exact_turn(q[0], q[1], q[2], q[3]) * volume < 0) return false;
    }
    return true;
}

/** 0 in the hull of count points */
static bool zero_in_hull(const qm_bigint_point *p, int count)
{
    for (int i = 0; i < count; i++) {
        if (is_zero(p[i])) return true;
        for (int j = i + 1; j < count; j++) {
            if (zero_in_segment(p[i], p[j])) return true;
            for (int k = j + 1; k < count; k++) {
                if (zero_in_triangle(p[i], p[j], p[k])) return true;
                for (int l = k + 1; l < count; l++)
                    if (zero_in_tetrahedron((const qm_bigint_point[]){p[i], p[j], p[k], p[l]})) return true;
            }
        }
    }
    return false;
}

bool qm_exact_meet(const qm_bigint_point a[3], const qm_bigint_point b[3])
{
    qm_bigint_point difference[9];
    for (int i = 0; i < 9; i++)
        difference[i] = minus(a[i / 3], b[i % 3]);
    return zero_in_hull(difference, 9);
}

/** Splits the rays from a shared corner into cones without a line in them; returns how many. */
static int make_cones(qm_bigint_point u, qm_bigint_point v, qm_bigint_point cone[2][2], int size[2])
{
    if (!is_zero(cross(u, v))) {
        cone[0][0] = u;
        cone[0][1] = v;
        size[0] = 2;
        return 1;
    }
    int count = 0;
    if (!is_zero(u)) cone[count][0] = u, size[count++] = 1;
    if (!is_zero(v)) cone[count][0] = v, size[count++] = 1;
    return count;
}

/** Cones have a ray in common when 0 is in the hull of the rays of one and the turned ones of the other. */
static bool cones_meet(const qm_bigint_point u[2], const qm_bigint_point w[2])
{
    qm_bigint_point a[2][2], b[2][2];
    int a_size[2], b_size[2];
    int a_count = make_cones(u[0], u[1], a, a_size), b_count = make_cones(w[0], w[1], b, b_size);
    for (int i = 0; i < a_count; i++) {
        for (int k = 0; k < b_count; k++) {
            qm_bigint_point all[4];
            int count = 0;
            for (int n = 0; n < a_size[i]; n++)
                all[count++] = a[i][n];
            for (int n = 0; n < b_size[k]; n++)
                all[count++] = minus((qm_bigint_point){{0, 0, 0}}, b[k][n]);
            if (zero_in_hull(all, count)) return true;
        }
    }
    return false;
}

/** The part of v at a right angle to e, times |e|^2. */
static qm_bigint_point across(qm_bigint_point v, qm_bigint_point e)
{
    return cross(cross(e, v), e);
}

/** Triangles over one edge from 0 to e, with third corners r and s. */
static bool meet_beyond(qm_bigint_point e, qm_bigint_point r, qm_bigint_point s)
{
    if (is_zero(e)) return is_zero(cross(r, s)) && dot(r, s) > 0;
    qm_bigint_point up_r = across(r, e), up_s = across(s, e);
    if (is_zero(up_r) != is_zero(up_s)) return false;
    if (!is_zero(up_r)) return is_zero(cross(cross(e, r), cross(e, s))) && dot(up_r, up_s) > 0;
    __int128 at_r = dot(r, e), at_s = dot(s, e), end = dot(e, e);
    return (at_r < 0 && at_s < 0) || (at_r > end && at_s > end);
}

bool qm_exact_cross(const qm_bigint_point a[3], const uint32_t a_index[3], const qm_bigint_point b[3],
                    const uint32_t b_index[3])
{
    const qm_bigint_point zero = {{0, 0, 0}};
    qm_bigint_point shared[3], rest_a[2] = {zero, zero}, rest_b[2] = {zero, zero};
    int shared_count = 0, a_count = 0, b_count = 0;
    for (int i = 0; i < 3; i++) {
        bool in_b = a_index[i] == b_index[0] || a_index[i] == b_index[1] || a_index[i] == b_index[2];
        bool is_new = true;
        for (int k = 0; k < i; k++)
            is_new &= a_index[k] != a_index[i];
        if (in_b && is_new) shared[shared_count++] = a[i];
    }
    if (shared_count == 0) return qm_exact_meet(a, b);
    if (shared_count == 3) return !is_zero(cross(minus(a[1], a[0]), minus(a[2], a[0])));
    for (int i = 0; i < 3; i++) {
        bool in_b = a_index[i] == b_index[0] || a_index[i] == b_index[1] || a_index[i] == b_index[2];
        bool in_a = b_index[i] == a_index[0] || b_index[i] == a_index[1] || b_index[i] == a_index[2];
        if (!in_b && a_count < 2) rest_a[a_count++] = minus(a[i], shared[0]);
        if (!in_a && b_count < 2) rest_b[b_count++] = minus(b[i], shared[0]);
    }
    if (shared_count == 2) return meet_beyond(minus(shared[1], shared[0]), rest_a[0], rest_b[0]);
    return cones_meet(rest_a, rest_b);
}
