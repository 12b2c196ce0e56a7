/**
 * deviation_feature.c: which edge or vertex is the nearest, and the cubic function by interpolation, with its
 * error by the coefficients of a polynomial of degree six. A polynomial is an array of the coefficients of its
 * monomials l_0^i l_1^j l_2^k, i + j + k its degree, at index (j + k) (j + k + 1) / 2 + k.
 */
#include "deviation_feature.h"

#include "deviation_match.h"

#define CORNERS 10   /* coefficients of a cubic function */
#define MAX_COUNT 28 /* and of one of degree six */
#define ROUNDING                                                                                             \
    0x1p-45 /* 256 u: of a difference of squares, relative to the greatest coefficients' squares */
#define LEAST_CLEAR 0.5          /* of c_0^2: the greatest R */
#define RELATIVE (1.0 + 0x1p-40) /* for the roundings of a few operations on positive terms */

/* ---- the nearest ---- */

static bool make_vertex(qm_vec at, qm_deviation_feature *out)
{
    *out = (qm_deviation_feature){at, {0.0, 0.0, 0.0}, 0.0};
    return true;
}

static bool make_edge(qm_vec from, qm_vec to, qm_deviation_feature *out)
{
    qm_vec edge = qm_vec_sub(to, from);
    double length = qm_vec_norm(edge);
    if (!(length > QM_MIN_LENGTH)) return make_vertex(from, out);
    *out = (qm_deviation_feature){from, qm_vec_scale(1.0 / length, edge), length};
    return true;
}

bool qm_deviation_feature_of_triangle(const qm_triangle *t, qm_vec p, qm_deviation_feature *out)
{
    double weight[3];
    qm_vec corner[3];
    int used[3], count = 0;
    qm_triangle_corners(t, corner);
    qm_triangle_footpoint(t, p, weight);
    for (int i = 0; i < 3; i++)
        if (weight[i] > 0.0) used[count++] = i;
    if (count == 1) return make_vertex(corner[used[0]], out);
    return count == 2 && make_edge(corner[used[0]], corner[used[1]], out);
}

bool qm_deviation_feature_of_patch(const qm_bilinear *patch, const double start[2], qm_vec p,
                                   qm_deviation_feature *out)
{
    double at[2] = {start[0], start[1]}, from[2], to[2];
    qm_deviation_match_foot(patch, p, true, at);
    bool is_end[2] = {at[0] <= 0.0 || at[0] >= 1.0, at[1] <= 0.0 || at[1] >= 1.0};
    if (is_end[0] && is_end[1]) return make_vertex(qm_bilinear_at(patch, at[0], at[1]), out);
    if (!is_end[0] && !is_end[1]) return false;
    for (int axis = 0; axis < 2; axis++) {
        from[axis] = is_end[axis] ? at[axis] : 0.0;
        to[axis] = is_end[axis] ? at[axis] : 1.0;
    }
    return make_edge(qm_bilinear_at(patch, from[0], from[1]), qm_bilinear_at(patch, to[0], to[1]), out);
}

bool qm_deviation_feature_under(const qm_deviation_facets *near, int facet, qm_vec p,
                                qm_deviation_feature *out)
{
    int rectangle = qm_deviation_facets_rectangle(near, facet);
    if (rectangle == QM_NO_RECTANGLE) {
        qm_triangle triangle =
            qm_deviation_facet_at(&near->pack[facet / QM_PACK_LANES], facet % QM_PACK_LANES);
        return qm_deviation_feature_of_triangle(&triangle, p, out);
    }
    const qm_deviation_rectangle *of = &near->rectangle[rectangle];
    const double centre[2] = {0.5 * (of->box.low[0] + of->box.high[0]),
                              0.5 * (of->box.low[1] + of->box.high[1])};
    return qm_deviation_feature_of_patch(&of->patch, centre, p, out);
}

/* ---- polynomials ---- */

/** The coefficient of a monomial in a product: all pairs of degrees that make its own. */
static void multiply(const double *a, int degree_a, const double *b, int degree_b, double *product)
{
    int degree = degree_a + degree_b, count = (degree + 1) * (degree + 2) / 2;
    for (int i = 0; i < count; i++)
        product[i] = 0.0;
    for (int ra = 0, ia = 0; ra <= degree_a; ra++)
        for (int ka = 0; ka <= ra; ka++, ia++)
            for (int rb = 0, ib = 0; rb <= degree_b; rb++)
                for (int kb = 0; kb <= rb; kb++, ib++)
                    product[(ra + rb) * (ra + rb + 1) / 2 + ka + kb] += a[ia] * b[ib];
}

/** The greatest coefficient of one of degree six in the Bernstein basis. */
static double find_greatest(const double sextic[MAX_COUNT])
{
    static const double factorial[7] = {1, 1, 2, 6, 24, 120, 720};
    double most = 0.0;
    for (int r = 0, index = 0; r <= 6; r++)
        for (int k = 0; k <= r; k++, index++)
            most = qm_max(most,
                          fabs(sextic[index]) * (factorial[6 - r] * factorial[r - k] * factorial[k] / 720.0));
    return most;
}

/** Monomials of a quadratic function with these coefficients: 00 11 22 01 12 20. */
static void expand_quadratic(const double value[6], double monomial[6])
{
    const double all[6] = {value[0], 2.0 * value[3], 2.0 * value[5], value[1], 2.0 * value[4], value[2]};
    for (int i = 0; i < 6; i++)
        monomial[i] = all[i];
}

/** f^2 as one of degree six, and the greatest coefficient of x squared. */
static double expand_square(const qm_vec x[6], double sextic[MAX_COUNT])
{
    static const double second[6] = {1, 2, 2, 1, 2, 1}; /* (l_0 + l_1 + l_2)^2 = 1 */
    double sum[15] = {0.0}, most2 = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        double value[6], monomial[6], square[15];
        for (int k = 0; k < 6; k++)
            value[k] = axis == 0 ? x[k].x : axis == 1 ? x[k].y : x[k].z;
        expand_quadratic(value, monomial);
        multiply(monomial, 2, monomial, 2, square);
        for (int i = 0; i < 15; i++)
            sum[i] += square[i];
    }
    for (int k = 0; k < 6; k++)
        most2 = qm_max(most2, qm_vec_norm2(x[k]));
    multiply(sum, 4, second, 2, sextic);
    return most2;
}

/* ---- the cubic function ---- */

/** f at a point of the piece. */
static double distance_at(const qm_vec x[6], double a, double b, double c)
{
    qm_vec sum = qm_vec_scale(a * a, x[0]);
    sum = qm_vec_axpy(qm_vec_axpy(sum, b * b, x[1]), c * c, x[2]);
    sum = qm_vec_axpy(qm_vec_axpy(sum, 2.0 * a * b, x[3]), 2.0 * b * c, x[4]);
    return qm_vec_norm(qm_vec_axpy(sum, 2.0 * c * a, x[5]));
}

/** The coefficients in the Bernstein basis of the cubic function that interpolates f: corners; for each edge ij, of 01
 * 12 20, those of l_i^2 l_j and l_i l_j^2; the middle. */
static void interpolate(const qm_vec x[6], double c[CORNERS])
{
    double inner = 0.0, outer = 0.0;
    for (int k = 0; k < 3; k++) {
        c[k] = qm_vec_norm(x[k]);
        outer += c[k];
    }
    for (int k = 0; k < 3; k++) {
        double l[3] = {0.0, 0.0, 0.0}, from = c[k], to = c[(k + 1) % 3];
        l[k] = 2.0 / 3.0;
        l[(k + 1) % 3] = 1.0 / 3.0;
        double near = distance_at(x, l[0], l[1], l[2]);
        l[k] = 1.0 / 3.0;
        l[(k + 1) % 3] = 2.0 / 3.0;
        double far = distance_at(x, l[0], l[1], l[2]);
        c[3 + 2 * k] = (18.0 * near - 9.0 * far - 5.0 * from + 2.0 * to) / 6.0;
        c[4 + 2 * k] = (18.0 * far - 9.0 * near - 5.0 * to + 2.0 * from) / 6.0;
        inner += c[3 + 2 * k] + c[4 + 2 * k];
    }
    double middle = distance_at(x, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0);
    c[9] = (27.0 * middle - outer - 3.0 * inner) / 6.0;
}

/** Splits a cubic function into q and e. */
static void split(const double c[CORNERS], qm_feature_distance *out)
{
    double middle = 0.0;
    for (int k = 0; k < 3; k++) {
        double from = c[k], to = c[(k + 1) % 3], near = c[3 + 2 * k], far = c[4 + 2 * k];
        out->value[k] = from;
        out->value[3 + k] = 0.25 * (3.0 * (near + far) - from - to);
        out->cubic[k] = 0.5 * (near - far) - (from - to) / 6.0;
        middle += out->value[3 + k] / 3.0;
    }
    out->cubic[3] = c[9] - middle;
}

/** q + e as they are stored, in monomials; and in the Bernstein basis the least and the greatest coefficient. */
static void expand_cubic(const qm_feature_distance *of, double monomial[CORNERS], double *least, double *most)
{
    /* Of l_i^2 l_j and l_i l_j^2 for ij = 01 12 20. */
    static const int place[3][2] = {{1, 3}, {7, 8}, {5, 2}}, corner[3] = {0, 6, 9};
    const double *q = of->value;
    *least = *most = q[0];
    for (int k = 0; k < 3; k++) {
        double near = (q[k] + 2.0 * q[3 + k]) / 3.0 + of->cubic[k];
        double far = (q[(k + 1) % 3] + 2.0 * q[3 + k]) / 3.0 - of->cubic[k];
        monomial[corner[k]] = q[k];
        monomial[place[k][0]] = 3.0 * near;
        monomial[place[k][1]] = 3.0 * far;
        *least = qm_min(*least, qm_min(q[k], qm_min(near, far)));
        *most = qm_max(*most, qm_max(q[k], qm_max(near, far)));
    }
    double middle = (q[3] + q[4] + q[5]) / 3.0 + of->cubic[3];
    monomial[4] = 6.0 * middle;
    *least = qm_min(*least, middle);
    *most = qm_max(*most, middle);
}

bool qm_deviation_feature_distance(const qm_deviation_setup *setup, const qm_deviation_feature *feature,
                                   const qm_vec at[6], qm_feature_distance *out)
{
    qm_vec x[6];
    double c[CORNERS], monomial[CORNERS], square[MAX_COUNT], exact[MAX_COUNT], least, most;
    for (int k = 0; k < 6; k++)
        x[k] = qm_deviation_feature_offset(feature, at[k]);
    interpolate(x, c);
    split(c, out);
    expand_cubic(out, monomial, &least, &most);
    if (!(least > 0.0)) return false;
    double farthest2 = expand_square(x, exact);
    multiply(monomial, 3, monomial, 3, square);
    for (int i = 0; i < MAX_COUNT; i++)
        square[i] -= exact[i];
    double rest = (find_greatest(square) + ROUNDING * (most * most + farthest2)) * RELATIVE;
    if (!(rest <= LEAST_CLEAR * least * least)) return false;
    double f = sqrt(least * least - rest) / RELATIVE;
    out->off = rest / (least + f) * RELATIVE + setup->eta;
    out->least = f - setup->eta;
    out->cubic_most = qm_quadratic_cubic_most(out->cubic) * RELATIVE;
    return out->least > 0.0;
}
