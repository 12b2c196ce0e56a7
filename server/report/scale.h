/**
 * scale.h: the colours of distances in a report: one scale for all of its pictures and charts, in bands, so that a colour
 * in a picture is one of those that are printed beside it.
 *
 * Lightness falls or grows evenly, so that the order is seen in grey as well. With a limit the bands up to it are blue and
 * those beyond it orange and red, which readers without red or without green tell apart; the limit is the edge of a band.
 */
#ifndef QM_SCALE_H
#define QM_SCALE_H

#include <stdbool.h>
#include <stdint.h>

#define QM_SCALE_BANDS 16 /* and one more for what is beyond the last edge */

typedef struct qm_scale {
    double edge[QM_SCALE_BANDS + 1]; /* ascending, from 0 */
    int within;                      /* bands up to the limit; 0: no limit */
} qm_scale;

/**
 * limit     0 or more, NAN for none; 0 has no bands within and is treated as none
 * range     the last edge, above 0; NAN: twice the limit, or without one a round number that is not below `greatest`
 * greatest  a distance, 0 or more
 */
qm_scale qm_scale_make(double limit, double range, double greatest);

/** The band of a distance: it belongs to the lower one of two that it is the edge of. QM_SCALE_BANDS: beyond the last. */
int qm_scale_band(const qm_scale *scale, double distance);

/** Red, green and blue of a band, 0 to 255. */
void qm_scale_colour(const qm_scale *scale, int band, uint8_t colour[3]);

#endif
