/**
 * deviation_survey.h: all that is known of the whole surface at one time: the maximum, the totals, and a coarse
 * distribution. A survey takes one pass over the pieces and none to read, so that a call that is canceled ends
 * at once with intervals for everything. Lengths are local.
 *
 * The distribution counts areas in levels of the distance, eight for each power of two: an area that is
 * certain at the level of the piece's greatest distance, and one that is possible at the level of its least.
 * The first sum of areas up to a level is one that lies within its upper end, the second one is no less than the
 * area within its lower end. Areas below zero do not occur, so that both sums keep their relative precision.
 */
#ifndef QM_DEVIATION_SURVEY_H
#define QM_DEVIATION_SURVEY_H

#include "deviation_levels.h"
#include "deviation_piece.h"
#include "qm/deviation.h"

/** All pieces; leak, the area by which they may differ from the surface; and farthest, which no distance
 * exceeds. */
typedef struct qm_deviation_piece_list {
    const qm_deviation_bounds *bounds;
    size_t count;
    double leak, farthest;
} qm_deviation_piece_list;

/** Powers of two that the levels cover, below the farthest distance that there can be. */
#define QM_SURVEY_OCTAVES 64
#define QM_SURVEY_BITS 3 /* of the mantissa, in a level */
#define QM_SURVEY_LEVELS (QM_SURVEY_OCTAVES << QM_SURVEY_BITS)

typedef struct qm_deviation_survey {
    qm_interval max;             /* of the greatest distance, over the pieces; both ends may be negative */
    qm_interval area, mean, rms; /* mean and rms have an upper bound of INFINITY where no area is certain */
    double blur;                 /* mean blur of all pieces: percentiles are about as wide */
    double least;                /* no point of a piece is nearer */
    qm_levels levels;
    double leak, error; /* of the sums below: absolute, relative */
    long double certain[QM_SURVEY_LEVELS], possible[QM_SURVEY_LEVELS];
} qm_deviation_survey;

/** The relative rounding error of a sum over so many pieces of terms that are not negative. */
double qm_deviation_sum_error(size_t count);

/** A bound of an area in square units of the meshes. The factors are powers of two; below the least normal number, and where a
 * positive area underflows to 0, it is rounded outward. */
double qm_deviation_unit_area(const qm_deviation_setup *setup, double area, bool is_lower);

/** Before anything is measured: no distance exceeds farthest, and the area does not exceed area. */
void qm_deviation_survey_init(qm_deviation_survey *survey, double farthest, double area);

/**
 * Surveys the faces of a source by the distances of its vertices, which are within QM_SURVEY_MARGIN * extent
 * of the true ones. A face lies in the convex hull of its corners, and a distance has the Lipschitz constant
 * 1: with e_i the distance of corner i from the farthest other one, d_i - e_i <= d <= d_i + e_i.
 *
 * vertex_distance  of all vertices of the source, in the unit of the meshes
 *
 * Returns QM_OK; QM_E_CANCELED, and the survey is unchanged.
 */
qm_status qm_deviation_survey_vertices(qm_context *ctx, const qm_deviation_setup *setup,
                                       const double *vertex_distance, qm_deviation_survey *survey);

/** The interval of the greatest distance over a piece; the lower end may be negative. */
qm_interval qm_deviation_piece_max(const qm_deviation_bounds *piece);

/** Surveys pieces, or points. Returns QM_OK; QM_E_CANCELED, and the survey is unchanged. */
qm_status qm_deviation_survey_pieces(qm_context *ctx, qm_deviation_piece_list pieces,
                                     qm_deviation_survey *survey);

/** The interval of the least distance within which a share of the area lies; max is no less than any
 * distance. */
qm_interval qm_deviation_survey_percentile(const qm_deviation_survey *survey, double share, double max);

/** The interval of the share of the area with a distance below x. */
qm_interval qm_deviation_survey_share(const qm_deviation_survey *survey, double x);

/** Relative to the extent: far more than the error of a projection (project.h), far less than a survey needs. */
#define QM_SURVEY_MARGIN 0x1p-36

#endif
