/**
 * deviation_integral.c: means, squares and areas over a triangle, in closed form: of linear functions where
 * they are positive, and of quadratic and cubic ones, in parts of one sign, by a rule that is exact for them.
 */
#include "deviation_integral.h"

#define BEND_DEPTH 6 /* of quarters of a part whose height changes its sign */

static double sum3(const double x[3])
{
    return x[0] + x[1] + x[2];
}

static double min3(const double x[3])
{
    return qm_min(x[0], qm_min(x[1], x[2]));
}

static double max3(const double x[3])
{
    return qm_max(x[0], qm_max(x[1], x[2]));
}

/** Mean over a triangle of the product of two linear functions. */
static double mean_product(const double f[3], const double g[3])
{
    return (sum3(f) * sum3(g) + f[0] * g[0] + f[1] * g[1] + f[2] * g[2]) / 12.0;
}

static qm_positive_part part_between(double share, double f, double g)
{
    /* A triangle with values f, g and 0. */
    return (qm_positive_part){share * (f + g) / 3.0, share * (f * f + f * g + g * g) / 6.0, share};
}

static qm_positive_part add_parts(qm_positive_part a, qm_positive_part b)
{
    return (qm_positive_part){a.mean + b.mean, a.square + b.square, a.share + b.share};
}

static int count_positive(const double f[3])
{
    return (f[0] > 0.0) + (f[1] > 0.0) + (f[2] > 0.0);
}

/** The corner whose sign no other one has, where one or two are positive. */
static int find_odd(const double f[3], int positive)
{
    int odd = 0;
    while ((f[odd] > 0.0) != (positive == 1))
        odd++;
    return odd;
}

qm_positive_part qm_integral_positive_part(const double f[3])
{
    int positive = count_positive(f);
    if (positive == 0) return (qm_positive_part){0.0, 0.0, 0.0};
    if (positive == 3) return (qm_positive_part){sum3(f) / 3.0, mean_product(f, f), 1.0};
    int odd = find_odd(f, positive);
    double a = f[odd], b = f[(odd + 1) % 3], c = f[(odd + 2) % 3];
    if (positive == 1) return part_between(a / (a - b) * (a / (a - c)), a, 0.0);
    /* From the corner c to the zero on the edge from b to a, and on to the one on the edge from c to a. */
    return add_parts(part_between(b / (b - a), b, c), part_between(-a / (b - a) * (c / (c - a)), c, 0.0));
}

/** Adds a triangle to the region, by the weights of its corners. */
static void add_triangle(qm_positive_region *region, double share, const double corner[3][3])
{
    QM_ASSERT(region->count < 2);
    region->share[region->count] = share;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            region->weight[region->count][i][k] = corner[i][k];
    region->count++;
}

qm_positive_region qm_integral_positive_region(const double f[3])
{
    static const double whole[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    qm_positive_region region = {.count = 0};
    int positive = count_positive(f);
    if (positive == 3) add_triangle(&region, 1.0, whole);
    if (positive == 0 || positive == 3) return region;
    int odd = find_odd(f, positive), second = (odd + 1) % 3, third = (odd + 2) % 3;
    double to_second = f[odd] / (f[odd] - f[second]), to_third = f[odd] / (f[odd] - f[third]);
    double corner[3][3] = {{0}};
    if (positive == 1) {
        corner[0][odd] = 1.0;
        corner[1][odd] = 1.0 - to_second;
        corner[1][second] = to_second;
        corner[2][odd] = 1.0 - to_third;
        corner[2][third] = to_third;
        add_triangle(&region, to_second * to_third, (const double(*)[3])corner);
        return region;
    }
    corner[0][second] = 1.0;
    corner[1][third] = 1.0;
    corner[2][odd] = 1.0 - to_second;
    corner[2][second] = to_second;
    add_triangle(&region, 1.0 - to_second, (const double(*)[3])corner);
    corner[0][second] = 0.0;
    corner[0][odd] = 1.0 - to_third;
    corner[0][third] = to_third;
    add_triangle(&region, to_second * (1.0 - to_third), (const double(*)[3])corner);
    return region;
}

qm_positive_part qm_integral_positive_part_in(const qm_positive_region *region, const double f[3])
{
    qm_positive_part sum = {0.0, 0.0, 0.0};
    if (count_positive(f) == 0) return sum;
    for (int i = 0; i < region->count; i++) {
        double here[3];
        for (int k = 0; k < 3; k++) {
            const double *weight = region->weight[i][k];
            here[k] = weight[0] * f[0] + weight[1] * f[1] + weight[2] * f[2];
        }
        qm_positive_part part = qm_integral_positive_part(here);
        sum.mean += region->share[i] * part.mean;
        sum.square += region->share[i] * part.square;
        sum.share += region->share[i] * part.share;
    }
    return sum;
}

/** Integral of max(f, 0)^2 from below. */
static double square_below(const double f[3], const qm_deviation_shape *w)
{
    if (w->is_uniform || min3(f) < 0.0) return min3(w->low) * qm_integral_positive_part(f).square;
    /* f^2 lies above its tangent at the centroid, which is linear. */
    double tangent[3], mean = sum3(f) / 3.0, by_mean = min3(w->low) * mean * mean;
    for (int i = 0; i < 3; i++)
        tangent[i] = (2.0 * f[i] - mean) * mean;
    return min3(tangent) < 0.0 ? by_mean : qm_max(by_mean, mean_product(tangent, w->low));
}

/** Integral of max(f, 0)^2 from above; f^2 is convex. */
static double square_above(const double f[3], const qm_deviation_shape *w)
{
    if (w->is_uniform || min3(f) < 0.0) return max3(w->high) * qm_integral_positive_part(f).square;
    const double f2[3] = {f[0] * f[0], f[1] * f[1], f[2] * f[2]};
    return mean_product(f2, w->high);
}

/** Integral of max(f, 0) from below. */
static double mean_below(const double f[3], const qm_deviation_shape *w)
{
    return min3(f) < 0.0 ? min3(w->low) * qm_integral_positive_part(f).mean : mean_product(f, w->low);
}

/** Integral of max(f, 0) from above. */
static double mean_above(const double f[3], const qm_deviation_shape *w)
{
    return min3(f) < 0.0 ? max3(w->high) * qm_integral_positive_part(f).mean : mean_product(f, w->high);
}

void qm_deviation_integrate(const qm_deviation_shape *w, qm_deviation_bounds *out)
{
    out->area_low = sum3(w->low) / 3.0;
    out->area_high = sum3(w->high) / 3.0;
    out->density_low = min3(w->low);
    out->density_high = max3(w->high);
    out->least = qm_max(0.0, min3(out->low));
    out->most = max3(out->high);
    out->mean_low = mean_below(out->low, w);
    out->mean_high = mean_above(out->high, w);
    out->square_low = square_below(out->low, w);
    out->square_high = square_above(out->high, w);
    out->blur = out->mean_high - out->mean_low;
}

/** Adds the integrals of the greater of high and -low, and of low and -high, where they are positive. */
static void add_signed(const double low[3], const double high[3], const qm_deviation_shape *w,
                       qm_deviation_bounds *sum)
{
    const double other_low[3] = {-high[0], -high[1], -high[2]}, other_high[3] = {-low[0], -low[1], -low[2]};
    sum->mean_low += mean_below(low, w) + mean_below(other_low, w);
    sum->mean_high += mean_above(high, w) + mean_above(other_high, w);
    sum->square_low += square_below(low, w) + square_below(other_low, w);
    sum->square_high += square_above(high, w) + square_above(other_high, w);
}

/** Subtracts the loss of a height from the integrals, and adds its excess; the greatest values of its lower
 * and upper function bound both. */
static void add_invalid(qm_positive_part lost, qm_excess outside, double max_low, double max_high,
                        qm_deviation_bounds *out)
{
    double missed = out->density_high * lost.mean, beside = out->density_high * outside.part.mean;
    out->mean_low = qm_max(0.0, out->mean_low - missed);
    out->mean_high += beside;
    out->square_low = qm_max(0.0, out->square_low - 2.0 * qm_max(0.0, max_low) * missed);
    out->square_high += (2.0 * max_high + outside.most) * beside;
    out->invalid_low = qm_min(1.0, lost.share);
    out->invalid_high = qm_min(1.0, outside.part.share);
    out->excess = outside.most;
    out->most = qm_max(max3(out->high), -min3(out->low)) + outside.most;
    out->blur = out->density_high * (max_high + outside.most) * (out->invalid_low + out->invalid_high);
}

static void start_signed(const qm_deviation_shape *w, qm_deviation_bounds *out)
{
    qm_deviation_integrate(w, out);
    out->is_signed = true;
    out->bend.cells = 0;
    out->mean_low = out->mean_high = out->square_low = out->square_high = 0.0;
}

/** Opens the functions; where they are nowhere invalid they bound the least distance. */
static void open_signed(double room, qm_deviation_bounds *out)
{
    for (int i = 0; i < 3; i++) {
        out->low[i] -= room;
        out->high[i] += room;
    }
    bool holds = !(out->invalid_low > 0.0);
    out->least = holds ? qm_max(0.0, qm_max(min3(out->low), -max3(out->high))) : 0.0;
}

void qm_deviation_integrate_signed(const qm_deviation_shape *w, qm_positive_part lost, qm_excess outside,
                                   double room, qm_deviation_bounds *out)
{
    double low[3], high[3];
    start_signed(w, out);
    add_signed(out->low, out->high, w, out);
    qm_deviation_bounds_flip(out, low, high);
    add_invalid(lost, outside, qm_max(max3(out->low), max3(low)), qm_max(max3(out->high), max3(high)), out);
    open_signed(room, out);
    out->blur += out->density_high * (sum3(out->high) - sum3(out->low)) / 3.0;
}

/** The height of one sign over a part of a piece, for integrals from below and above: side times the quadratic function and
 * its cubic part, less below or with above; the part has corners of these weights. */
typedef struct sided_height {
    const qm_quadratic *bend;
    const double (*corner)[3];
    double side, below, above;
} sided_height;

/** Adds a point of a rule for integrals over the part; all terms are positive. */
static void add_point(const sided_height *height, const double l[3], double weight,
                      const qm_deviation_shape *w, qm_deviation_bounds *sum)
{
    const qm_quadratic *bend = height->bend;
    const double *f = bend->value;
    double at[3], value = l[0] * l[0] * f[0] + l[1] * l[1] * f[1] + l[2] * l[2] * f[2] +
                          2.0 * (l[0] * l[1] * f[3] + l[1] * l[2] * f[4] + l[2] * l[0] * f[5]);
    if (bend->cubic_most > 0.0) {
        for (int k = 0; k < 3; k++)
            at[k] = l[0] * height->corner[0][k] + l[1] * height->corner[1][k] + l[2] * height->corner[2][k];
        value += qm_quadratic_cubic_at(bend->cubic, at);
    }
    double low = qm_max(0.0, height->side * value - height->below);
    double high = qm_max(0.0, height->side * value + height->above);
    double low_part = weight * low * (l[0] * w->low[0] + l[1] * w->low[1] + l[2] * w->low[2]);
    double high_part = weight * high * (l[0] * w->high[0] + l[1] * w->high[1] + l[2] * w->high[2]);
    sum->mean_low += low_part;
    sum->square_low += low_part * low;
    sum->mean_high += high_part;
    sum->square_high += high_part * high;
}

/**
 * Adds the integrals of a height of one sign. The integral of the square of a quadratic height over a linear density is of degree
 * five, that of a cubic one of degree seven; the rules, of 7 and of 12 points, are exact up to these.
 *
 * Sources: J. Radon, Zur mechanischen Kubatur, 1948; K. Gatermann, The construction of symmetric cubature formulas for the
 * square and the triangle, 1988.
 */
static void add_rule(const sided_height *height, const qm_deviation_shape *w, qm_deviation_bounds *sum)
{
    static const double third = 1.0 / 3.0;
    static const double quadratic[2][4] = {
        {0.47014206410511509, 0.47014206410511509, 0.059715871789769820, 0.13239415278850618},
        {0.10128650732345634, 0.10128650732345634, 0.79742698535308732, 0.12593918054482715}};
    static const double cubic[4][4] = {
        {0.062382265094402117, 0.067517867073916091, 0.87009986783168181, 0.053034056314872506},
        {0.055225456656926609, 0.32150249385198182, 0.62327204949109161, 0.087762817428892109},
        {0.034324302945097147, 0.66094919618673564, 0.30472650086816722, 0.057550085569963175},
        {0.51584233435359172, 0.27771616697639179, 0.20644149867001643, 0.13498637401960556}};
    bool is_cubic = height->bend->cubic_most > 0.0;
    const double(*ring)[4] = is_cubic ? cubic : quadratic;
    if (!is_cubic) add_point(height, (const double[3]){third, third, third}, 0.225, w, sum);
    for (int k = 0; k < (is_cubic ? 4 : 2); k++)
        for (int i = 0; i < 3; i++) {
            const double l[3] = {ring[k][i], ring[k][(i + 1) % 3], ring[k][(i + 2) % 3]};
            add_point(height, l, ring[k][3], w, sum);
        }
}

static double max6(const double x[6])
{
    return qm_max(max3(x), max3(x + 3));
}

static double min6(const double x[6])
{
    return qm_min(min3(x), min3(x + 3));
}

/** Adds the integrals of a height that is nowhere negative on a side, 1 or -1; false when it may be. */
static bool add_sided(const qm_quadratic *bend, const double corner[3][3], double side,
                      const qm_deviation_shape *w, qm_deviation_bounds *sum)
{
    double low = side > 0.0 ? min6(bend->value) : -max6(bend->value);
    double below = side > 0.0 ? bend->below : bend->above, above = side > 0.0 ? bend->above : bend->below;
    if (low - below < 0.0) return false;
    const sided_height height = {bend, corner, side, below - bend->cubic_most, above - bend->cubic_most};
    add_rule(&height, w, sum);
    return true;
}

/** A quarter of a part of a piece, and its corners. */
static void cut_quarter(const qm_quadratic *bend, const double corner[3][3], const qm_deviation_shape *w,
                        const double quarter[3][3], qm_quadratic *part, double at[3][3],
                        qm_deviation_shape *of)
{
    *part = *bend;
    qm_quadratic_restrict(bend->value, quarter, part->value);
    of->is_uniform = w->is_uniform;
    for (int i = 0; i < 3; i++) {
        of->low[i] = of->high[i] = 0.0;
        for (int k = 0; k < 3; k++) {
            of->low[i] += 0.25 * quarter[i][k] * w->low[k];
            of->high[i] += 0.25 * quarter[i][k] * w->high[k];
            at[i][k] =
                quarter[i][0] * corner[0][k] + quarter[i][1] * corner[1][k] + quarter[i][2] * corner[2][k];
        }
    }
}

/** Adds the integrals of a part. Its height is off linear by open, which is wrong only where it changes its
 * sign, and in a share of the whole of about 1 / 2^depth then. */
static void add_bent(const qm_quadratic *bend, const double corner[3][3], const qm_deviation_shape *w,
                     int depth, double little, qm_deviation_bounds *sum)
{
    static const double quarter[4][3][3] = {{{1, 0, 0}, {0.5, 0.5, 0}, {0.5, 0, 0.5}},
                                            {{0.5, 0.5, 0}, {0, 1, 0}, {0, 0.5, 0.5}},
                                            {{0.5, 0, 0.5}, {0, 0.5, 0.5}, {0, 0, 1}},
                                            {{0, 0.5, 0.5}, {0.5, 0, 0.5}, {0.5, 0.5, 0}}};
    if (add_sided(bend, corner, 1.0, w, sum) || add_sided(bend, corner, -1.0, w, sum)) return;
    double open[2];
    qm_quadratic_linear_error(bend->value, open);
    if (depth == BEND_DEPTH || ldexp(open[0] + open[1] + 2.0 * bend->cubic_most, -depth) <= little) {
        double low[3], high[3];
        for (int i = 0; i < 3; i++) {
            low[i] = bend->value[i] - open[0] - bend->below;
            high[i] = bend->value[i] + open[1] + bend->above;
        }
        add_signed(low, high, w, sum);
        return;
    }
    for (int k = 0; k < 4; k++) {
        qm_quadratic part;
        double at[3][3];
        qm_deviation_shape of;
        cut_quarter(bend, corner, w, quarter[k], &part, at, &of);
        add_bent(&part, (const double(*)[3])at, &of, depth + 1, little, sum);
    }
}

void qm_deviation_integrate_quadratic(const qm_deviation_shape *w, qm_positive_part lost, qm_excess outside,
                                      double room, double little, qm_deviation_bounds *out)
{
    qm_quadratic bend = out->bend;
    double open[2], up = max6(bend.value), down = -min6(bend.value);
    static const double whole[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    start_signed(w, out);
    add_bent(&bend, whole, w, 0, little, out);
    add_invalid(lost, outside, qm_max(up - bend.below, down - bend.above) + 2.0 * bend.cubic_most,
                qm_max(up + bend.above, down + bend.below), out);
    open_signed(room, out);
    bend.below += room;
    bend.above += room;
    qm_quadratic_linear_error(bend.value, open);
    out->bend = bend;
    out->blur += out->density_high *
                 (bend.below + bend.above + (open[0] + open[1]) / (double)(bend.cells * bend.cells));
}

void qm_deviation_bounds_combine(qm_deviation_bounds *bounds, const qm_deviation_bounds *over)
{
    qm_deviation_bounds best = over->blur < bounds->blur ? *over : *bounds;
    best.least = qm_max(bounds->least, over->least);
    best.most = qm_min(bounds->most, over->most);
    best.mean_low = qm_max(bounds->mean_low, over->mean_low);
    best.mean_high = qm_min(bounds->mean_high, over->mean_high);
    best.square_low = qm_max(bounds->square_low, over->square_low);
    best.square_high = qm_min(bounds->square_high, over->square_high);
    *bounds = best;
}
