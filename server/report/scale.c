/**
 * scale.c: edges, and colours by way of OKLab, in which equal steps look equal.
 */
#include "scale.h"

#include <math.h>
#include <stddef.h>

/** The least number of two digits that is not below x and is easy to divide. */
static double round_up(double x)
{
    static const double steps[] = {1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0};
    double unit = pow(10.0, floor(log10(x)));
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        if (steps[i] * unit >= x) return steps[i] * unit;
    return x;
}

qm_scale qm_scale_make(double limit, double range, double greatest)
{
    qm_scale scale = {.within = 0};
    bool has_limit = limit > 0.0;
    /* Distances of 0 alone need a range all the same; a number so small that its bands would vanish has none. */
    double top = range > 0.0 ? range : has_limit ? 2.0 * limit : greatest > 1e-290 ? round_up(greatest) : 1.0;
    if (has_limit && limit >= top) {
        scale.within = QM_SCALE_BANDS;
        top = limit;
    } else if (has_limit) {
        double share = round(QM_SCALE_BANDS * (limit / top));
        scale.within = (int)fmin(fmax(share, 1.0), QM_SCALE_BANDS - 1.0);
    }
    for (int i = 0; i <= QM_SCALE_BANDS; i++) {
        int beyond = i - scale.within, rest = QM_SCALE_BANDS - scale.within;
        if (scale.within == 0)
            scale.edge[i] = top * ((double)i / QM_SCALE_BANDS);
        else if (beyond <= 0)
            scale.edge[i] = limit * ((double)i / scale.within);
        else
            scale.edge[i] = limit + (top - limit) * ((double)beyond / rest);
    }
    return scale;
}

int qm_scale_band(const qm_scale *scale, double distance)
{
    int band = 0;
    while (band < QM_SCALE_BANDS && distance > scale->edge[band + 1])
        band++;
    return band;
}

/** Source: B. Ottosson, A perceptual color space for image processing, 2020; what lies outside sRGB is cut off. */
static void from_oklab(double lightness, double chroma, double hue_degrees, uint8_t colour[3])
{
    double hue = hue_degrees * acos(-1.0) / 180.0, a = chroma * cos(hue), b = chroma * sin(hue);
    double l = pow(lightness + 0.3963377774 * a + 0.2158037573 * b, 3.0);
    double m = pow(lightness - 0.1055613458 * a - 0.0638541728 * b, 3.0);
    double s = pow(lightness - 0.0894841775 * a - 1.2914855480 * b, 3.0);
    const double linear[3] = {4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
                              -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
                              -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s};
    for (int k = 0; k < 3; k++) {
        double x = fmax(linear[k], 0.0);
        double encoded = x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055;
        colour[k] = (uint8_t)lround(255.0 * fmin(encoded, 1.0));
    }
}

void qm_scale_colour(const qm_scale *scale, int band, uint8_t colour[3])
{
    if (scale->within == 0) {
        /* From blue over magenta to yellow, as on the page; beyond that nearly white. */
        double share = (double)band / (QM_SCALE_BANDS - 1);
        if (band == QM_SCALE_BANDS)
            from_oklab(0.98, 0.03, 100.0, colour);
        else
            from_oklab(0.34 + 0.6 * share, 0.06 + 0.36 * share * (1.0 - share) + 0.07 * share,
                       265.0 + 195.0 * share, colour);
    } else if (band < scale->within) {
        double share = (band + 1.0) / scale->within;
        from_oklab(0.95 - 0.47 * share, 0.02 + 0.14 * share, 250.0, colour);
    } else {
        double share = (band + 1.0 - scale->within) / (QM_SCALE_BANDS + 1.0 - scale->within);
        from_oklab(0.82 - 0.46 * share, 0.15, 75.0 - 47.0 * share, colour);
    }
}
