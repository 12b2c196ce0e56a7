#include "deviation_integral.h"

static double sum3(const double x[3])
{
    return x[0] + x[1] + x[2];
}

static double least(const double x[3])
{
    return qm_lesser(x[0], qm_lesser(x[1], x[2]));
}

static double greatest(const double x[3])
{
    return qm_greater(x[0], qm_greater(x[1], x[2]));
}

/** Mean over a triangle of the product of two linear functions. */
static double mean_product(const double f[3], const double g[3])
{
    return (sum3(f) * sum3(g) + f[0] * g[0] + f[1] * g[1] + f[2] * g[2]) / 12.0;
}

/** Integral of max(f, 0)^2 from below. */
static double square_below(const double f[3], const qm_piece_shape *w)
{
    double mean = qm_greater(0.0, sum3(f) / 3.0);
    double by_mean = least(w->low) * mean * mean;
    if (least(f) < 0.0) return by_mean;
    if (w->is_uniform) return w->low[0] * mean_product(f, f);
    /* f^2 lies above its tangent at the middle, which is linear. */
    double tangent[3];
    for (int i = 0; i < 3; i++)
        tangent[i] = (2.0 * f[i] - mean) * mean;
    return least(tangent) < 0.0 ? by_mean : qm_greater(by_mean, mean_product(tangent, w->low));
}

/** Integral of f^2, f >= 0, from above; f^2 is convex. */
static double square_above(const double f[3], const qm_piece_shape *w)
{
    if (w->is_uniform) return w->high[0] * mean_product(f, f);
    const double f2[3] = {f[0] * f[0], f[1] * f[1], f[2] * f[2]};
    return mean_product(f2, w->high);
}

void qm_piece_integrate(const qm_piece_shape *w, qm_piece_bounds *out)
{
    out->area_low = sum3(w->low) / 3.0;
    out->area_high = sum3(w->high) / 3.0;
    out->density_low = least(w->low);
    out->density_high = greatest(w->high);
    out->mean_low = least(out->low) >= 0.0 ? mean_product(out->low, w->low)
                                           : out->density_low * qm_greater(0.0, sum3(out->low) / 3.0);
    out->mean_high = mean_product(out->high, w->high);
    out->square_low = square_below(out->low, w);
    out->square_high = square_above(out->high, w);
}
