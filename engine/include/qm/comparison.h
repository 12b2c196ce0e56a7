/**
 * comparison.h: two surfaces compared both ways: the deviation of A from B and of B from A, and the figures that join
 * both, each as an interval that is proven to contain the true value. Nothing is sampled.
 *
 * Let d be the distance of a point of one surface from the other surface, mean_a and rms_a its averages over A, mean_b
 * and rms_b those over B.
 *   hausdorff    the greater of both maxima
 *   hd95         the greater of both 95th percentiles
 *   mean, rms    over both surfaces together, each weighted by its area (or its count of points): the average symmetric
 *                surface distance, and its root mean square. Where the measures are of different kinds, as for points
 *                against a surface, both surfaces count alike
 *   chamfer_l1   mean_a + mean_b
 *   chamfer_l2   rms_a^2 + rms_b^2: the mean squares, added
 *   f_score      for a limit: precision is the share of A within the limit of B (also called accuracy), recall the
 *                share of B within the limit of A (completeness), f their harmonic mean, 0 where both are 0
 *   deviation    of the distance over one surface: the root of its variance
 *
 * With a sign, A is measured with sign against B, which must prove it as for a deviation, and B against A where A can
 * prove it too; else that direction has no sign. Regions of B are found where B has an area.
 */
#ifndef QM_COMPARISON_H
#define QM_COMPARISON_H

#include "qm/deviation.h"

/** The options of both deviations, which also say of what percentiles, limits, bands, regions and worst places there are. Bins must
 * be 0; the solid is B's; progress is of the symmetric Hausdorff distance. */
typedef qm_deviation_options qm_comparison_options;

typedef struct qm_f_score {
    double limit;
    qm_interval precision, recall, f;
} qm_f_score;

typedef struct qm_comparison {
    qm_deviation
        side[2]; /* of A from B, of B from A; their last percentile is the 95th, besides the requested ones */
    qm_interval spread[2]; /* standard deviation of the distance over A, over B */
    qm_interval hausdorff, hd95, mean, rms;
    qm_interval chamfer_l1, chamfer_l2;
    qm_f_score *f_score; /* limit_count of them */
    size_t limit_count;
    bool is_signed[2]; /* a direction has a sign, and its side[i].sides are set */
    bool
        knows_solid; /* with a sign that is to be proven: solid_a is known, which a cancelation may prevent */
    qm_solid solid_a; /* why there is no sign of B against A, where that is so */
    bool is_accurate; /* both deviations are */
    bool is_canceled; /* the intervals hold */
    double elapsed_ms;
} qm_comparison;

/**
 * Compares two meshes. Both trees serve both directions. solid_a is what qm_solid_check says of A; NULL: the call asks it itself
 * when the sign needs it.
 *
 * Ownership: borrows everything but *out, which is the caller's, for qm_comparison_reset in the same context.
 * Threads:   only reads the trees; splits its work with ctx->parallel.
 * Returns:   as qm_deviation_measure of A from B; what B cannot be measured for is left out of its direction.
 */
qm_status qm_comparison_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                                const qm_comparison_options *options, const qm_solid *solid_a,
                                qm_comparison *out);

void qm_comparison_reset(qm_context *ctx, qm_comparison *comparison);

#endif
