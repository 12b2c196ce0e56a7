/**
 * deviation_survey.c: sums over all pieces in long double, with a bound of their rounding, and areas by level.
 */
#include "deviation_survey.h"

#include <float.h>
#include <string.h>

#include "core/rounding.h"

/* Of a piece's own area, integrals and shares, and of quotients and roots of sums */
#define PIECE_ROUNDINGS 64.0
#define CANCEL_STRIDE 0x4000 /* pieces: a few hundred microseconds */

/**
 * With L the unit roundoff of long double a sum of n terms is off by n L, relative to the sum of their
 * magnitudes. Every term is a short expression of terms that are not negative, and the shares take two sums of
 * 2 n terms one after the other.
 */
double qm_deviation_sum_error(size_t count)
{
    return PIECE_ROUNDINGS * QM_UNIT_ROUNDING + 32.0 * (double)count * (double)LDBL_EPSILON;
}

double qm_deviation_unit_area(const qm_deviation_setup *setup, double area, bool is_lower)
{
    double inverse = setup->target->frame.inverse_scale;
    double out = area * (inverse / setup->area_unit) * inverse;
    return out >= DBL_MIN ? out : is_lower || !(area > 0.0) ? 0.0 : DBL_MIN;
}

/* ---- sums ---- */

/** Sums over pieces: low and high. */
typedef struct survey_sums {
    long double area[2], mean[2], square[2], blur;
} survey_sums;

static void add_levels(qm_deviation_survey *survey, double least, double greatest, double area_low,
                       double area_high)
{
    QM_ASSERT(!(least > greatest) && !(area_low < 0.0) && !(area_low > area_high));
    survey->possible[qm_levels_find(&survey->levels, least)] += (long double)area_high;
    survey->certain[qm_levels_find(&survey->levels, greatest)] += (long double)area_low;
}

/** The interval of a sum over the surface of a function that is at most this, from the sums over all
 * pieces. */
static qm_interval sum_interval(const qm_deviation_survey *survey, const long double sum[2], double max)
{
    double leak = survey->leak > 0.0 ? survey->leak * max * (1.0 + survey->error) : 0.0;
    return (qm_interval){fmax(0.0, (double)sum[0] * (1.0 - survey->error) - leak),
                         (double)sum[1] * (1.0 + survey->error) + leak};
}

/** Of a sum divided by the area. */
static qm_interval mean_interval(qm_interval sum, qm_interval area)
{
    double upper = area.lower > 0.0 ? sum.upper / area.lower : INFINITY;
    return (qm_interval){area.upper > 0.0 ? sum.lower / area.upper : 0.0, upper};
}

static void set_totals(qm_deviation_survey *survey, const survey_sums *sums, double farthest)
{
    survey->area = sum_interval(survey, sums->area, 1.0);
    survey->mean = mean_interval(sum_interval(survey, sums->mean, farthest), survey->area);
    qm_interval squares =
        mean_interval(sum_interval(survey, sums->square, farthest * farthest), survey->area);
    survey->rms = (qm_interval){sqrt(squares.lower), sqrt(squares.upper)};
    survey->blur = survey->area.lower > 0.0 ? (double)sums->blur / survey->area.lower : INFINITY;
}

/* ---- the surveys ---- */

void qm_deviation_survey_init(qm_deviation_survey *survey, double farthest, double area)
{
    QM_ASSERT(farthest > 0.0 && farthest < INFINITY);
    memset(survey, 0, sizeof *survey);
    survey->levels = qm_levels_make(farthest, QM_SURVEY_BITS, QM_SURVEY_LEVELS);
    survey->max = survey->mean = survey->rms = (qm_interval){0.0, farthest};
    survey->area = (qm_interval){0.0, area};
    survey->blur = INFINITY;
}

/** A survey with the levels of another one, and nothing else. */
static void begin(const qm_deviation_survey *levels, size_t count, double leak, qm_deviation_survey *survey)
{
    QM_ASSERT(!(leak < 0.0));
    memset(survey, 0, sizeof *survey);
    survey->levels = levels->levels;
    survey->max = (qm_interval){-INFINITY, -INFINITY};
    survey->least = count > 0 ? INFINITY : 0.0;
    survey->leak = leak;
    survey->error = qm_deviation_sum_error(count);
}

/** The area of a face between those of its boundary, whose vector area half the cross product of the diagonals
 * is, and of a patch whose normal Q_s x Q_t has the greatest length of its corners everywhere: the length of a
 * linear function is convex. A cross product is off by 40 u (ab + S (a + b)) at most (deviation_piece.c). */
static qm_interval face_area(const qm_deviation_setup *setup, const qm_vec corner[4], int corners,
                             double longest)
{
    double margin = 0x1p-40 * longest * (longest + setup->extent), high = 0.0;
    if (corners == 3) {
        qm_vec edge = qm_vec_sub(corner[1], corner[0]), other = qm_vec_sub(corner[2], corner[0]);
        high = 0.5 * qm_vec_norm(qm_vec_cross(edge, other));
        return (qm_interval){fmax(0.0, high - margin), high + margin};
    }
    qm_vec diagonals = qm_vec_cross(qm_vec_sub(corner[2], corner[0]), qm_vec_sub(corner[3], corner[1]));
    for (int i = 0; i < 4; i++) {
        qm_vec on = qm_vec_sub(corner[(i + 1) % 4], corner[i]),
               back = qm_vec_sub(corner[(i + 3) % 4], corner[i]);
        high = fmax(high, qm_vec_norm(qm_vec_cross(on, back)));
    }
    return (qm_interval){fmax(0.0, 0.5 * qm_vec_norm(diagonals) - margin), high + margin};
}

/** The interval of the distance over a face, and its longest edge or diagonal. */
static qm_interval face_distance(const qm_vec corner[4], const double distance[4], int corners,
                                 double *longest)
{
    qm_interval within = {0.0, INFINITY};
    *longest = 0.0;
    for (int i = 0; i < corners; i++) {
        double reach = 0.0;
        for (int k = 0; k < corners; k++)
            reach = fmax(reach, qm_vec_distance(corner[i], corner[k]));
        within.lower = fmax(within.lower, distance[i] - reach);
        within.upper = fmin(within.upper, distance[i] + reach);
        *longest = fmax(*longest, reach);
    }
    return within;
}

qm_status qm_deviation_survey_vertices(qm_context *ctx, const qm_deviation_setup *setup,
                                       const double *vertex_distance, qm_deviation_survey *survey)
{
    const qm_mesh *mesh = &setup->source->mesh;
    const qm_frame *frame = &setup->target->frame;
    double margin = QM_SURVEY_MARGIN * setup->extent, greatest = 0.0;
    qm_deviation_survey here;
    survey_sums sums = {0};
    begin(survey, 2 * mesh->face_count, 0.0, &here);
    for (size_t f = 0; f < mesh->face_count; f++) {
        if (f % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "deviation canceled");
        const uint32_t *index = mesh->faces + 4 * f;
        int corners = index[3] == QM_NO_INDEX ? 3 : 4;
        qm_vec corner[4];
        double distance[4], longest;
        for (int i = 0; i < corners; i++) {
            corner[i] = qm_frame_local(frame, mesh->positions + 3 * (size_t)index[i]);
            distance[i] = vertex_distance[index[i]] * frame->scale;
            greatest = fmax(greatest, distance[i]);
        }
        qm_interval within = face_distance(corner, distance, corners, &longest);
        double least = fmax(0.0, within.lower - margin), most = within.upper + margin;
        bool is_split = corners == 4 && !setup->source_patches;
        const qm_vec second[4] = {corner[0], corner[2], corner[3]};
        qm_interval area = face_area(setup, corner, is_split ? 3 : corners, longest);
        qm_interval rest = is_split ? face_area(setup, second, 3, longest) : (qm_interval){0.0, 0.0};
        double low = setup->area_unit * (area.lower + rest.lower);
        double high = setup->area_unit * (area.upper + rest.upper);
        add_levels(&here, least, most, low, high);
        here.max.upper = fmax(here.max.upper, most);
        here.least = fmin(here.least, least);
        sums.area[0] += (long double)low;
        sums.area[1] += (long double)high;
        sums.mean[0] += (long double)(low * least);
        sums.mean[1] += (long double)(high * most);
        sums.square[0] += (long double)(low * least * least);
        sums.square[1] += (long double)(high * most * most);
        sums.blur += (long double)(high * most - low * least);
    }
    here.max.lower = greatest - margin;
    here.max.upper = fmin(here.max.upper, survey->max.upper);
    set_totals(&here, &sums, here.max.upper);
    *survey = here;
    return QM_OK;
}

qm_interval qm_deviation_piece_max(const qm_deviation_bounds *piece)
{
    qm_interval max = {-INFINITY, piece->most};
    for (int k = 0; k < 3 && !(piece->invalid_low > 0.0); k++)
        max.lower = fmax(max.lower, qm_deviation_bounds_corner_least(piece, k));
    return max;
}

qm_status qm_deviation_survey_pieces(qm_context *ctx, qm_deviation_piece_list pieces,
                                     qm_deviation_survey *survey)
{
    QM_ASSERT((pieces.bounds || pieces.count == 0) && (pieces.leak == 0.0 || pieces.farthest < INFINITY));
    qm_deviation_survey here;
    survey_sums sums = {0};
    begin(survey, pieces.count, pieces.leak, &here);
    for (size_t i = 0; i < pieces.count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "deviation canceled");
        const qm_deviation_bounds *piece = &pieces.bounds[i];
        qm_interval max = qm_deviation_piece_max(piece);
        here.max.lower = fmax(here.max.lower, max.lower);
        here.max.upper = fmax(here.max.upper, max.upper);
        double least = fmin(piece->least, max.upper);
        here.least = fmin(here.least, least);
        add_levels(&here, least, max.upper, piece->area_low, piece->area_high);
        sums.area[0] += (long double)piece->area_low;
        sums.area[1] += (long double)piece->area_high;
        sums.mean[0] += (long double)piece->mean_low;
        sums.mean[1] += (long double)piece->mean_high;
        sums.square[0] += (long double)piece->square_low;
        sums.square[1] += (long double)piece->square_high;
        sums.blur += (long double)piece->blur;
    }
    set_totals(&here, &sums, pieces.farthest);
    *survey = here;
    return QM_OK;
}

/* ---- the distribution ---- */

/** The share that an area, summed over pieces that are certain, is at least. */
static double certain_share(const qm_deviation_survey *survey, long double sum)
{
    double area = (double)sum * (1.0 - survey->error) - survey->leak * (1.0 + survey->error);
    return survey->area.upper > 0.0 ? fmax(0.0, area / survey->area.upper * (1.0 - survey->error)) : 0.0;
}

/** The share that an area, summed over pieces that are possible, is at most. */
static double possible_share(const qm_deviation_survey *survey, long double sum)
{
    double area = ((double)sum + survey->leak) * (1.0 + survey->error);
    return survey->area.lower > 0.0 ? fmin(1.0, area / survey->area.lower * (1.0 + survey->error)) : 1.0;
}

qm_interval qm_deviation_survey_percentile(const qm_deviation_survey *survey, double share, double max)
{
    long double certain = 0, possible = 0;
    size_t first = 0, last = 0;
    /* The area below the begin of a level is in the levels before it. */
    for (; first + 1 < QM_SURVEY_LEVELS; first++) {
        possible += survey->possible[first];
        if (!(possible_share(survey, possible) < share)) break;
    }
    for (; last < QM_SURVEY_LEVELS; last++) {
        certain += survey->certain[last];
        if (certain_share(survey, certain) >= share) break;
    }
    double upper = last < QM_SURVEY_LEVELS ? qm_levels_begin(&survey->levels, last + 1) : INFINITY;
    return (qm_interval){fmin(qm_levels_begin(&survey->levels, first), max), fmin(upper, max)};
}

qm_interval qm_deviation_survey_share(const qm_deviation_survey *survey, double x)
{
    long double certain = 0, possible = 0;
    for (size_t i = 0; i < QM_SURVEY_LEVELS && qm_levels_begin(&survey->levels, i) < x; i++) {
        possible += survey->possible[i];
        if (qm_levels_begin(&survey->levels, i + 1) <= x) certain += survey->certain[i];
    }
    return (qm_interval){certain_share(survey, certain), possible_share(survey, possible)};
}
