/**
 * layout_cross.c: curves that cross without a node. Two pieces cross when the nearest points of their lines
 * lie inside both and are much nearer to one another than the pieces are long. Pieces are swept along x, so
 * that only those that overlap there are compared.
 */
#include "layout_work.h"

#define NEAR 0.1    /* of the sum of two lengths: crossing pieces are nearer than that */
#define AT_END 1e-9 /* of a piece: curves may cross at a point of both */
#define TREMOR 0.1  /* of its length: a loop of a curve over fewer of its pieces is the hand's tremor */

typedef struct piece {
    double low, high; /* range along x */
    uint32_t curve, place;
} piece;

static double x_of(const qm_curve *curve, uint32_t place)
{
    return curve->points[3 * (size_t)place];
}

static size_t fill_pieces(const qm_layout *layout, piece *pieces)
{
    size_t count = 0;
    for (size_t c = 0; c < layout->curve_count; c++) {
        for (uint32_t i = 0; i + 1 < layout->curves[c].point_count; i++) {
            double a = x_of(&layout->curves[c], i), b = x_of(&layout->curves[c], i + 1);
            pieces[count++] = (piece){fmin(a, b), fmax(a, b), (uint32_t)c, i};
        }
    }
    return count;
}

/** Shell sort by where a piece begins: no memory, quick enough for what people draw. */
static void sort_pieces(piece *pieces, size_t count)
{
    for (size_t gap = count / 2; gap > 0; gap = gap == 2 ? 1 : gap * 5 / 11) {
        for (size_t i = gap; i < count; i++) {
            piece moved = pieces[i];
            size_t k = i;
            for (; k >= gap && pieces[k - gap].low > moved.low; k -= gap)
                pieces[k] = pieces[k - gap];
            pieces[k] = moved;
        }
    }
}

static qm_vec piece_end(const qm_layout *layout, const piece *p, uint32_t end)
{
    return qm_vec_load(layout->curves[p->curve].points + 3 * (size_t)(p->place + end));
}

/** True when s of a piece is an end of its whole curve: one that touches another there does not cross it. */
static bool ends_at(const qm_layout *layout, const piece *p, double s)
{
    return (s <= AT_END && p->place == 0) ||
           (s >= 1.0 - AT_END && p->place + 2 == layout->curves[p->curve].point_count);
}

static bool cross(const qm_layout *layout, const piece *a, const piece *b, qm_vec *at)
{
    qm_vec p = piece_end(layout, a, 0), q = piece_end(layout, b, 0);
    qm_vec d = qm_vec_sub(piece_end(layout, a, 1), p), e = qm_vec_sub(piece_end(layout, b, 1), q);
    qm_vec r = qm_vec_sub(p, q);
    double dd = qm_vec_norm2(d), ee = qm_vec_norm2(e), de = qm_vec_dot(d, e), dr = qm_vec_dot(d, r),
           er = qm_vec_dot(e, r), det = dd * ee - de * de;
    if (!(det > 1e-6 * dd * ee)) return false; /* nearly parallel */
    double s = (de * er - ee * dr) / det, t = (dd * er - de * dr) / det;
    if (s < -AT_END || s > 1.0 + AT_END || t < -AT_END || t > 1.0 + AT_END) return false;
    if (ends_at(layout, a, s) || ends_at(layout, b, t)) return false;
    *at = qm_vec_axpy(p, s, d);
    return qm_vec_distance(*at, qm_vec_axpy(q, t, e)) < NEAR * (sqrt(dd) + sqrt(ee));
}

/** One issue for each pair of curves, however often they cross. */
static bool is_known(const qm_layout_issues *issues, uint32_t a, uint32_t b)
{
    for (size_t i = 0; i < issues->count; i++)
        if (issues->items[i].fault == QM_LAYOUT_CROSSING && issues->items[i].curve[0] == a &&
            issues->items[i].curve[1] == b)
            return true;
    return false;
}

static bool is_tremor(const qm_layout *layout, const piece *a, const piece *b)
{
    if (a->curve != b->curve) return false;
    double apart = fabs((double)a->place - (double)b->place);
    return apart < 3.0 || apart < TREMOR * (double)layout->curves[a->curve].point_count;
}

static qm_status compare(qm_context *ctx, const qm_layout *layout, const piece *a, const piece *b,
                         qm_layout_issues *out)
{
    qm_vec at;
    if (is_tremor(layout, a, b) || !cross(layout, a, b, &at)) return QM_OK;
    uint32_t first = layout->curves[a->curve].id, second = layout->curves[b->curve].id;
    qm_layout_issue issue = {.fault = QM_LAYOUT_CROSSING,
                             .curve = {first < second ? first : second, first < second ? second : first},
                             .node = QM_NO_INDEX};
    if (is_known(out, issue.curve[0], issue.curve[1])) return QM_OK;
    qm_vec_store(issue.position, at);
    return qm_layout_add_issue(ctx, out, &issue);
}

qm_status qm_layout_find_crossings(qm_context *ctx, const qm_layout *layout, qm_layout_issues *out)
{
    size_t total = 0;
    for (size_t c = 0; c < layout->curve_count; c++)
        total += layout->curves[c].point_count - 1;
    if (total == 0) return QM_OK;
    piece *pieces = qm_context_alloc(ctx, total, sizeof *pieces);
    if (!pieces) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the curves");
    sort_pieces(pieces, fill_pieces(layout, pieces));
    qm_status status = QM_OK;
    for (size_t i = 0; i < total && status == QM_OK; i++)
        for (size_t k = i + 1; k < total && pieces[k].low <= pieces[i].high && status == QM_OK; k++)
            status = compare(ctx, layout, &pieces[i], &pieces[k], out);
    qm_context_free(ctx, pieces, total, sizeof *pieces);
    return status;
}
