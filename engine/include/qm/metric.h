/**
 * metric.h: the shape of single faces by the usual metrics of finite elements, and what they are over a mesh.
 *
 * Names and definitions are those of Verdict: C. J. Stimpson, C. D. Ernst, P. Knupp, P. P. Pebay, D. Thompson, The
 * Verdict geometric quality library, Sandia report SAND2007-1751, 2007. Figures are rounded, not intervals. None depends
 * on the size of the face.
 *
 * Of a face with corners P0, P1, ..: edges L_i from P_i to the next corner, their lengths l_i. Of a quad also the axes
 * X1 = (P1 - P0) + (P2 - P3) and X2 = (P2 - P1) + (P3 - P0), the normal of its middle n = X1 x X2 / |X1 x X2|, the normals
 * of its corners N_i = L_(i-1) x L_i, and their signed areas a_i = n . N_i.
 */
#ifndef QM_METRIC_H
#define QM_METRIC_H

#include "qm/mesh.h"

/** XX(suffix, name). */
#define QM_METRIC_MAP(XX)                                                                                    \
    XX(SCALED_JACOBIAN, scaled_jacobian)                                                                     \
    XX(ASPECT_RATIO, aspect_ratio)                                                                           \
    XX(SKEW, skew)                                                                                           \
    XX(TAPER, taper)                                                                                         \
    XX(WARPAGE, warpage)                                                                                     \
    XX(EDGE_RATIO, edge_ratio)                                                                               \
    XX(SHAPE, shape)                                                                                         \
    XX(STRETCH, stretch)                                                                                     \
    XX(MINIMUM_ANGLE, minimum_angle)                                                                         \
    XX(MAXIMUM_ANGLE, maximum_angle)

/**
 *                  quad                                                   triangle                              best
 *   scaled_jacobian least a_i / (l_(i-1) l_i); 0 with an edge of length 0  2 / sqrt(3) * 2 A / largest l_i l_j   1
 *   aspect_ratio    largest l_i * sum l_i / (2 (|N_1| + |N_3|))            largest l_i * sum l_i / (4 sqrt(3) A) 1
 *   skew            |X1 . X2| / (|X1| |X2|); 0 with an axis of length 0                                         0
 *   taper           |P0 - P1 + P2 - P3| / smaller of |X1|, |X2|                                                 0
 *   warpage         1 - (smaller of n_0 . n_2, n_1 . n_3)^3, n_i = N_i / |N_i|                                  0
 *   edge_ratio      largest l_i / smallest l_i                             the same                             1
 *   shape           2 least a_i / (l_(i-1)^2 + l_i^2), at least 0          4 sqrt(3) A / sum l_i^2              1
 *   stretch         sqrt(2) smallest l_i / longer diagonal                                                      1
 *   minimum_angle   smallest angle of two edges at a corner, degrees       the same                             90, 60
 *   maximum_angle   largest one; 360 minus it when an a_i is below 0       the same                             90, 60
 */
typedef enum qm_metric {
#define XX(suffix, name) QM_METRIC_##suffix,
    QM_METRIC_MAP(XX)
#undef XX
        QM_METRIC_COUNT
} qm_metric;

/** The names in the order of the enum, with NULL after the last. */
extern const char *const qm_metric_names[];

/** Whether a metric is one of faces of three corners, too. */
bool qm_metric_has_triangles(qm_metric metric);

/** The value of a quad, or of a triangle (count 3); NAN when it has none: the metric is not one of such faces, or a length
 * or an area that it divides by is 0. */
double qm_metric_of_corners(qm_metric metric, const double corners[][3], int count);

#define QM_METRIC_PERCENTILES 7
extern const double qm_metric_percents[QM_METRIC_PERCENTILES]; /* 1, 5, 25, 50, 75, 95, 99 */

/** What a metric is over a mesh. */
typedef struct qm_metric_summary {
    size_t faces;     /* of the input that have a value */
    size_t undefined; /* faces that should have one, but for a length or an area of 0 */
    /* Of those with a value; 0 when there is none. */
    double minimum, maximum, mean;
    size_t minimum_face, maximum_face;        /* of the input; the first of equal ones */
    double percentile[QM_METRIC_PERCENTILES]; /* the least value that as many are not above */
} qm_metric_summary;

/** Faces of the input: polygons count once. */
size_t qm_metric_face_count(const qm_mesh *mesh);

/**
 * Measures the faces first to first + count of the input of a valid mesh; polygons with five corners or more have no
 * value.
 *
 * values   count numbers, as of qm_metric_of_corners
 * place    where the search for the first face goes on: 0 with first 0, and as it was left by the call before
 */
void qm_metric_measure(const qm_mesh *mesh, qm_metric metric, size_t first, size_t count, size_t *place,
                       double *values);

/**
 * Sums up a metric over a valid mesh.
 *
 * Cost:    linear in the faces, of which each has 8 bytes of scratch memory.
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_metric_summarize(qm_context *ctx, const qm_mesh *mesh, qm_metric metric, qm_metric_summary *out);

#endif
