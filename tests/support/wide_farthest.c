#include "wide_farthest.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_LABELS = 12, MAX_COLUMNS = 2 * MAX_LABELS, MAX_ROWS = 9, MAX_PIVOTS = 60 };

/* Points of cells are rounded to long double, by 2^-64 a level and at most 2^-58 in all; nets and distances
 * to them add a few 2^-64. Distances change no more than points do. */
#define SLACK 0x1p-57L

/** A facet of the target near a cell, and about where on it. */
typedef struct label {
    size_t facet;
    qm_long uv[2];
    qm_long distance; /* from the middle of the cell */
} label;

typedef struct cell {
    size_t facet; /* of the source */
    int corner_count;
    qm_long_vec corner[4];
    qm_long uv[4][2]; /* of the corners, in the facet */
    qm_long upper;
    int label_count; /* of those on patches, and of all while the cell is measured */
    label labels[MAX_LABELS];
} cell;

typedef struct search {
    const qm_wide_surface *source, *target;
    qm_long eps;
    qm_wide lower;
    qm_wide_vec at;
    cell **heap; /* greatest upper on top */
    size_t count, capacity, cells;
} search;

/* ---- the queue ---- */

static void push(search *s, const cell *c)
{
    if (s->count == s->capacity) {
        s->capacity = s->capacity ? 2 * s->capacity : 64;
        s->heap = realloc(s->heap, s->capacity * sizeof *s->heap);
    }
    cell *copy = malloc(sizeof *copy);
    if (!s->heap || !copy) {
        fprintf(stderr, "out of memory for the cells of a reference\n");
        abort();
    }
    *copy = *c;
    size_t i = s->count++;
    for (; i > 0 && s->heap[(i - 1) / 2]->upper < c->upper; i = (i - 1) / 2)
        s->heap[i] = s->heap[(i - 1) / 2];
    s->heap[i] = copy;
}

static cell *pop(search *s)
{
    cell *top = s->heap[0], *last = s->heap[--s->count];
    size_t i = 0;
    for (size_t child = 1; child < s->count; child = 2 * i + 1) {
        if (child + 1 < s->count && s->heap[child + 1]->upper > s->heap[child]->upper) child++;
        if (s->heap[child]->upper <= last->upper) break;
        s->heap[i] = s->heap[child];
        i = child;
    }
    s->heap[i] = last;
    return top;
}

/* ---- the matrix game ---- */

/** Values of the labels (columns; a patch has two) at the net (rows). */
typedef struct matrix {
    int rows, columns;
    qm_long at[MAX_ROWS][MAX_COLUMNS];
} matrix;

/**
 * Looks for the average of columns whose greatest row is least, by the simplex method on
 *     maximise sum y  where  M y <= 1, y >= 0,
 * M being the matrix scaled to [1, 2]. Returns that greatest row: a valid bound wherever the search ends,
 * since it is computed from the average itself. The other player's weights of the rows go to weight.
 */
static qm_long play(const matrix *m, qm_long weight[MAX_ROWS])
{
    qm_long low = INFINITY, high = -INFINITY, t[MAX_ROWS + 1][MAX_COLUMNS + MAX_ROWS + 1] = {{0}};
    int width = m->columns + m->rows, basis[MAX_ROWS];
    for (int i = 0; i < m->rows; i++)
        for (int k = 0; k < m->columns; k++) {
            low = qm_long_least(low, m->at[i][k]);
            high = qm_long_greatest(high, m->at[i][k]);
        }
    qm_long span = high > low ? high - low : 1;
    for (int i = 0; i < m->rows; i++) {
        for (int k = 0; k < m->columns; k++)
            t[i][k] = 1 + (m->at[i][k] - low) / span;
        t[i][m->columns + i] = t[i][width] = 1;
        basis[i] = m->columns + i;
    }
    qm_long *gain = t[m->rows];
    for (int k = 0; k < m->columns; k++)
        gain[k] = -1;
    for (int pivot = 0; pivot < MAX_PIVOTS; pivot++) {
        int enter = 0, leave = -1;
        for (int k = 1; k < width; k++)
            if (gain[k] < gain[enter]) enter = k;
        if (!(gain[enter] < -1e-17L)) break;
        for (int i = 0; i < m->rows; i++)
            if (t[i][enter] > 1e-17L &&
                (leave < 0 || t[i][width] / t[i][enter] < t[leave][width] / t[leave][enter]))
                leave = i;
        if (leave < 0) break;
        basis[leave] = enter;
        qm_long by = t[leave][enter];
        for (int k = 0; k <= width; k++)
            t[leave][k] /= by;
        for (int i = 0; i <= m->rows; i++) {
            qm_long share = t[i][enter];
            for (int k = 0; i != leave && share != 0 && k <= width; k++)
                t[i][k] -= share * t[leave][k];
        }
    }
    qm_long y[MAX_COLUMNS] = {0}, sum = 0, all = 0, worst = 0;
    for (int i = 0; i < m->rows; i++)
        if (basis[i] < m->columns && t[i][width] > 0) sum += y[basis[i]] = t[i][width];
    for (int i = 0; i < m->rows; i++) {
        qm_long value = 0;
        for (int k = 0; k < m->columns; k++)
            value += y[k] / sum * m->at[i][k];
        worst = qm_long_greatest(worst, value);
        all += weight[i] = qm_long_greatest(0, gain[m->columns + i]);
    }
    for (int i = 0; i < m->rows; i++)
        weight[i] /= all;
    return worst;
}

/* ---- cells ---- */

static qm_long_vec point_at(const search *s, const cell *c, const qm_long uv[2])
{
    return qm_wide_round(qm_wide_facet_at(&s->source->facets[c->facet], uv[0], uv[1]));
}

/** The rows of a net: its corners, the middles of its sides, its middle; which corners each is the mean
 * of. */
static int net_rows(const cell *c, int row, int corners[4])
{
    int n = c->corner_count;
    corners[0] = row < n ? row : row - n;
    corners[1] = row < n ? row : (row - n + 1) % n;
    if (row < 2 * n) return 2;
    for (int i = 0; i < 4; i++)
        corners[i] = i;
    return 4;
}

/** Adds a label unless one like it is there, or enough that are nearer. */
static void add_label(const search *s, cell *c, label made)
{
    bool is_patch = s->target->facets[made.facet].corner_count == 4;
    for (int i = 0; i < c->label_count; i++) {
        const label *have = &c->labels[i];
        if (have->facet != made.facet) continue;
        if (!is_patch || fabsl(have->uv[0] - made.uv[0]) + fabsl(have->uv[1] - made.uv[1]) < 1e-6L) return;
    }
    int place = c->label_count < MAX_LABELS ? c->label_count++ : MAX_LABELS;
    if (place == MAX_LABELS && !(made.distance < c->labels[--place].distance)) return;
    for (; place > 0 && c->labels[place - 1].distance > made.distance; place--)
        c->labels[place] = c->labels[place - 1];
    c->labels[place] = made;
}

static void add_near(const search *s, cell *c, size_t facet, qm_long u, qm_long v, qm_long_vec p)
{
    label made = {.facet = facet, .uv = {u, v}};
    made.distance = qm_wide_facet_near(&s->target->facets[facet], p, made.uv);
    add_label(s, c, made);
}

/** Labels near the middle p of a cell of this radius: convex facets again, facets on patches from the
 * parent's. */
static void find_labels(const search *s, cell *c, qm_long_vec p, qm_long radius, bool is_root)
{
    label old[MAX_LABELS];
    int old_count = c->label_count;
    memcpy(old, c->labels, sizeof old);
    c->label_count = 0;
    for (int i = 0; i < old_count; i++)
        if (s->target->facets[old[i].facet].corner_count == 4)
            add_near(s, c, old[i].facet, old[i].uv[0], old[i].uv[1], p);
    for (size_t f = 0; f < s->target->count; f++) {
        const qm_wide_facet *facet = &s->target->facets[f];
        if (facet->corner_count == 4 && !is_root) continue;
        qm_long away = qm_long_length(qm_long_sub(p, facet->centre)) - facet->radius;
        if (c->label_count > 0 && away > c->labels[0].distance + 2 * radius) continue;
        add_near(s, c, f, 0.5L, 0.5L, p);
        for (int k = 0; k < 4 && facet->corner_count == 4; k++)
            add_near(s, c, f, k & 1 ? 0.9L : 0.1L, k & 2 ? 0.9L : 0.1L, p);
    }
    while (c->label_count > 1 && c->labels[c->label_count - 1].distance > c->labels[0].distance + 2 * radius)
        c->label_count--;
}

/** Raises the lower bound by a point of the cell if it is farther; its foot becomes a label. */
static void try_point(search *s, cell *c, qm_long_vec p, qm_long about)
{
    if (!(about > s->lower + s->eps / 4)) return;
    qm_wide_distance d = qm_wide_surface_distance(s->target, qm_long_widen(p), s->eps / 8);
    if (d.lower - SLACK > s->lower) {
        s->lower = d.lower - SLACK;
        s->at = qm_long_widen(p);
    }
    if (s->target->facets[d.facet].corner_count == 4)
        add_label(s, c, (label){d.facet, {(qm_long)d.uv[0], (qm_long)d.uv[1]}, (qm_long)d.upper});
}

/** A convex set's column, from its distances from the corners: means of them bound those of the rows
 * between. */
static void fill_convex(const cell *c, const qm_long distance[4], matrix *m)
{
    for (int row = 0; row < m->rows; row++) {
        int corners[4], n = net_rows(c, row, corners);
        qm_long sum = 0;
        for (int i = 0; i < n; i++)
            sum += distance[corners[i]];
        m->at[row][m->columns] = sum / n;
    }
    m->columns++;
}

static void fill_facet(const cell *c, const qm_wide_facet *facet, matrix *m)
{
    qm_long distance[4];
    for (int i = 0; i < c->corner_count; i++) {
        qm_long uv[2] = {0, 0};
        distance[i] = qm_wide_facet_near(facet, c->corner[i], uv);
    }
    fill_convex(c, distance, m);
}

/** A patch in powers of its parameters. */
typedef struct powers {
    qm_long_vec origin, e1, e2, w;
} powers;

static qm_long_vec power_at(const powers *q, qm_long u, qm_long v)
{
    return qm_long_axpy(qm_long_axpy(q->origin, u, q->e1), v, qm_long_axpy(q->e2, u, q->w));
}

/**
 * Over a map of the cell into the square that is (bi)linear through uv[i], the patch is (bi)quadratic, and
 * its net comes from the polar form: between corners i and j lies o + (ui + uj)/2 e1 + (vi + vj)/2 e2 + (ui
 * vj + uj vi)/2 w, in the middle the mean over both diagonals.
 */
static void fill_matched(const cell *c, const powers *q, qm_long uv[4][2], matrix *m)
{
    for (int row = 0; row < m->rows; row++) {
        int corners[4], n = net_rows(c, row, corners);
        qm_long_vec gap = {0, 0, 0};
        for (int i = 0; i < n / 2; i++) {
            /* Of the middle row the diagonals: 0 with 2, 1 with 3. */
            int from = corners[i], to = corners[n == 4 ? i + 2 : 1];
            const qm_long *p = uv[from], *r = uv[to];
            qm_long_vec foot = qm_long_axpy(q->origin, (p[0] + r[0]) / 2, q->e1);
            foot = qm_long_axpy(foot, (p[1] + r[1]) / 2, q->e2);
            foot = qm_long_axpy(foot, (p[0] * r[1] + r[0] * p[1]) / 2, q->w);
            gap = qm_long_add(gap, qm_long_sub(qm_long_lerp(c->corner[from], c->corner[to], 0.5L), foot));
        }
        m->at[row][m->columns] = qm_long_length(gap) / (n / 2);
    }
    m->columns++;
}

/**
 * A convex quad in a plane that the part of a patch with these corners projects onto, and how far the part is
 * from it. The part's projection is bilinear in the projected corners and goes once round the quad with its
 * border, so it covers it; and no point of it is farther from the plane than a corner. So the distance to the
 * part is at most that to the quad and lift. False where the quad is not surely convex.
 */
static bool flatten(const qm_long_vec corner[4], qm_wide_facet half[2], qm_long *lift)
{
    qm_long_vec n = qm_long_cross(qm_long_sub(corner[2], corner[0]), qm_long_sub(corner[3], corner[1]));
    qm_long length = qm_long_length(n);
    if (!(length > 0)) return false;
    n = qm_long_scale(1 / length, n);
    qm_long_vec centre = {0, 0, 0}, flat[4];
    for (int i = 0; i < 4; i++)
        centre = qm_long_axpy(centre, 0.25L, corner[i]);
    *lift = 0;
    for (int i = 0; i < 4; i++) {
        qm_long height = qm_long_dot(n, qm_long_sub(corner[i], centre));
        flat[i] = qm_long_axpy(corner[i], -height, n);
        *lift = qm_long_greatest(*lift, fabsl(height));
    }
    for (int i = 0; i < 4; i++) {
        qm_long_vec in = qm_long_sub(flat[(i + 1) % 4], flat[i]),
                    out = qm_long_sub(flat[(i + 2) % 4], flat[(i + 1) % 4]);
        qm_long turn = qm_long_dot(n, qm_long_cross(in, out));
        if (!(turn > 0x1p-40L * qm_long_length(in) * qm_long_length(out))) return false;
    }
    for (int k = 0; k < 2; k++) {
        half[k].corner_count = 3;
        for (int i = 0; i < 3; i++)
            half[k].rounded[i] = flat[i == 0 ? 0 : i + k];
    }
    return true;
}

/** By the quad of the part of the patch that the feet span: for surfaces that nearly coincide, but whose
 * parameters do not go together. */
static void fill_flattened(const cell *c, const powers *q, qm_long uv[4][2], matrix *m)
{
    qm_long low[2] = {1, 1}, high[2] = {0, 0}, lift, distance[4];
    for (int i = 0; i < c->corner_count; i++)
        for (int axis = 0; axis < 2; axis++) {
            low[axis] = qm_long_least(low[axis], uv[i][axis]);
            high[axis] = qm_long_greatest(high[axis], uv[i][axis]);
        }
    const qm_long_vec corner[4] = {power_at(q, low[0], low[1]), power_at(q, high[0], low[1]),
                                   power_at(q, high[0], high[1]), power_at(q, low[0], high[1])};
    qm_wide_facet half[2];
    if (!flatten(corner, half, &lift)) return;
    for (int i = 0; i < c->corner_count; i++) {
        qm_long at[2] = {0, 0};
        distance[i] = lift + qm_long_least(qm_wide_facet_near(&half[0], c->corner[i], at),
                                           qm_wide_facet_near(&half[1], c->corner[i], at));
    }
    fill_convex(c, distance, m);
}

static void fill_patch(const cell *c, const qm_wide_facet *facet, const qm_long start[2], matrix *m)
{
    qm_long uv[4][2];
    for (int i = 0; i < c->corner_count; i++) {
        uv[i][0] = start[0];
        uv[i][1] = start[1];
        qm_wide_facet_near(facet, c->corner[i], uv[i]);
    }
    const qm_long_vec *b = facet->rounded;
    powers q = {b[0], qm_long_sub(b[1], b[0]), qm_long_sub(b[3], b[0]), {0, 0, 0}};
    q.w = qm_long_sub(qm_long_sub(b[2], b[1]), q.e2);
    fill_matched(c, &q, uv, m);
    fill_flattened(c, &q, uv, m);
}

static void fill_matrix(const search *s, const cell *c, matrix *m)
{
    bool has_patch = false;
    for (int k = 0; k < c->label_count; k++)
        has_patch = has_patch || s->target->facets[c->labels[k].facet].corner_count == 4;
    m->columns = 0;
    m->rows = c->corner_count == 1 ? 1 : !has_patch ? c->corner_count : c->corner_count == 4 ? 9 : 6;
    for (int k = 0; k < c->label_count; k++) {
        const qm_wide_facet *facet = &s->target->facets[c->labels[k].facet];
        if (facet->corner_count == 4)
            fill_patch(c, facet, c->labels[k].uv, m);
        else
            fill_facet(c, facet, m);
    }
}

/** Tries the point at the mean of the rows with these weights: where the game says that the farthest is. */
static void try_mean(search *s, cell *c, const matrix *m, const qm_long weight[MAX_ROWS])
{
    qm_long uv[2] = {0, 0};
    for (int row = 0; row < m->rows; row++) {
        int corners[4], n = net_rows(c, row, corners);
        for (int i = 0; i < n; i++)
            for (int axis = 0; axis < 2; axis++)
                uv[axis] += weight[row] / n * c->uv[corners[i]][axis];
    }
    qm_long_vec p = point_at(s, c, uv);
    qm_long about = INFINITY;
    for (int k = 0; k < c->label_count; k++) {
        qm_long foot[2] = {c->labels[k].uv[0], c->labels[k].uv[1]};
        about = qm_long_least(about, qm_wide_facet_near(&s->target->facets[c->labels[k].facet], p, foot));
    }
    try_point(s, c, p, about);
}

/** Bounds a cell, raises the lower bound by points of it, and queues it unless it is settled. */
static void measure(search *s, cell *c, bool is_root)
{
    qm_long middle[2] = {0, 0}, radius = 0, weight[MAX_ROWS];
    for (int i = 0; i < c->corner_count; i++)
        for (int axis = 0; axis < 2; axis++)
            middle[axis] += c->uv[i][axis] / c->corner_count;
    qm_long_vec p = point_at(s, c, middle);
    for (int i = 0; i < c->corner_count; i++)
        radius = qm_long_greatest(radius, qm_long_length(qm_long_sub(c->corner[i], p)));
    s->cells++;
    find_labels(s, c, p, radius, is_root);
    try_point(s, c, p, c->labels[0].distance);
    matrix m;
    fill_matrix(s, c, &m);
    qm_long upper = play(&m, weight);
    upper = qm_long_least(upper, c->labels[0].distance + radius) + SLACK;
    c->upper = qm_long_least(c->upper, upper);
    if (!(c->upper > s->lower + s->eps)) return;
    try_mean(s, c, &m, weight);
    if (is_root)
        for (int i = 0; i < c->corner_count; i++)
            try_point(s, c, c->corner[i], INFINITY);
    if (c->upper > s->lower + s->eps) push(s, c);
}

static void start_facet(search *s, size_t f)
{
    static const qm_long uv[2][4][2] = {{{0, 0}, {1, 0}, {0, 1}}, {{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
    const qm_wide_facet *facet = &s->source->facets[f];
    cell c = {.facet = f, .corner_count = facet->corner_count, .upper = INFINITY};
    memcpy(c.uv, uv[facet->corner_count == 4], sizeof c.uv);
    memcpy(c.corner, facet->rounded, sizeof c.corner);
    measure(s, &c, true);
}

/** Makes the corner between corners i and j of whole the corner k of c. */
static void cut_corner(const search *s, const cell *whole, int i, int j, cell *c, int k)
{
    for (int axis = 0; axis < 2; axis++)
        c->uv[k][axis] = (whole->uv[i][axis] + whole->uv[j][axis]) / 2;
    c->corner[k] = point_at(s, whole, c->uv[k]);
}

static qm_long side_length(const cell *c, int i)
{
    return qm_long_length(qm_long_sub(c->corner[(i + 1) % c->corner_count], c->corner[i]));
}

/** Halves a cell across its longest side, a rectangle across the longer pair of sides. */
static void split(search *s, const cell *c)
{
    int n = c->corner_count, longest = 0;
    for (int i = 1; i < n; i++)
        if (side_length(c, i) > side_length(c, longest)) longest = i;
    int i = longest, j = (i + 1) % n, k = (i + 2) % n, l = (i + 3) % n;
    cell first = *c, second = *c;
    cut_corner(s, c, i, j, &first, j);
    cut_corner(s, c, i, j, &second, i);
    if (n == 4) {
        cut_corner(s, c, k, l, &first, k);
        cut_corner(s, c, k, l, &second, l);
    }
    measure(s, &first, false);
    measure(s, &second, false);
}

qm_wide_maximum qm_wide_farthest(const qm_wide_surface *source, const qm_wide_surface *target, qm_long eps,
                                 size_t cell_limit)
{
    search s = {.source = source, .target = target, .eps = eps};
    s.at = source->facets[0].corner[0];
    for (size_t f = 0; f < source->count; f++)
        start_facet(&s, f);
    while (s.count > 0 && s.heap[0]->upper > s.lower + eps && s.cells < cell_limit &&
           s.heap[0]->corner_count > 1) {
        cell *top = pop(&s);
        split(&s, top);
        free(top);
    }
    qm_wide_maximum out = {s.lower, s.lower + eps, s.at, s.cells};
    if (s.count > 0) out.upper = qm_wide_greatest(out.upper, s.heap[0]->upper);
    for (size_t i = 0; i < s.count; i++)
        free(s.heap[i]);
    free(s.heap);
    return out;
}
