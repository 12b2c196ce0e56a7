#include "slow_twin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef long double real;
typedef __float128 wide;

typedef struct vec {
    real x, y, z;
} vec;

static vec load(const double p[3])
{
    return (vec){p[0], p[1], p[2]};
}

static void store(vec p, double out[3])
{
    out[0] = (double)p.x;
    out[1] = (double)p.y;
    out[2] = (double)p.z;
}

static vec add(vec a, vec b)
{
    return (vec){a.x + b.x, a.y + b.y, a.z + b.z};
}

static vec sub(vec a, vec b)
{
    return (vec){a.x - b.x, a.y - b.y, a.z - b.z};
}

static vec scale(real t, vec a)
{
    return (vec){t * a.x, t * a.y, t * a.z};
}

static vec lerp(vec a, vec b, real t)
{
    return add(scale(1 - t, a), scale(t, b));
}

static real dot(vec a, vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static vec cross(vec a, vec b)
{
    return (vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static real length(vec a)
{
    return sqrtl(dot(a, a));
}

static real least(real a, real b)
{
    return a < b ? a : b;
}

static real greatest(real a, real b)
{
    return a > b ? a : b;
}

/* ---- memory and a heap of (key, id), greatest key on top ---- */

typedef struct heap_entry {
    real key;
    size_t id;
} heap_entry;

typedef struct heap {
    heap_entry *entries;
    size_t count, capacity;
} heap;

/** Room for one more row; grows by doubling. */
static void *grow(void *rows, size_t count, size_t *capacity, size_t width)
{
    if (count < *capacity) return rows;
    *capacity = *capacity ? 2 * *capacity : 64;
    rows = realloc(rows, *capacity * width);
    if (!rows) {
        fprintf(stderr, "out of memory in the slow twin\n");
        abort();
    }
    return rows;
}

static void heap_push(heap *h, real key, size_t id)
{
    h->entries = grow(h->entries, h->count, &h->capacity, sizeof *h->entries);
    size_t i = h->count++;
    for (; i > 0 && h->entries[(i - 1) / 2].key < key; i = (i - 1) / 2)
        h->entries[i] = h->entries[(i - 1) / 2];
    h->entries[i] = (heap_entry){key, id};
}

static heap_entry heap_pop(heap *h)
{
    heap_entry top = h->entries[0], last = h->entries[--h->count];
    size_t i = 0;
    for (size_t child = 1; child < h->count; child = 2 * i + 1) {
        if (child + 1 < h->count && h->entries[child + 1].key > h->entries[child].key) ++child;
        if (h->entries[child].key <= last.key) break;
        h->entries[i] = h->entries[child];
        i = child;
    }
    h->entries[i] = last;
    return top;
}

/* ---- point to segment and triangle ---- */

/** The square of the distance to a segment; *at: where on it the nearest point is. */
static real segment_square(vec p, vec a, vec b, real *at)
{
    vec ab = sub(b, a);
    real square = dot(ab, ab), t = square > 0 ? dot(sub(p, a), ab) / square : 0;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    if (at) *at = t;
    vec apart = sub(p, lerp(a, b, t));
    return dot(apart, apart);
}

static real segment_distance(vec p, vec a, vec b, real *at)
{
    return sqrtl(segment_square(p, a, b, at));
}

/** True when the triangle is not thin and p surely lies off the prism over it. */
static bool clearly_beside(vec ap, vec ab, vec ac)
{
    vec n = cross(ab, ac);
    real square = dot(n, n);
    if (!(square > 1e-6L * dot(ab, ab) * dot(ac, ac))) return false;
    real v = dot(cross(ap, ac), n) / square, w = dot(cross(ab, ap), n) / square;
    return v < -1e-9L || w < -1e-9L || v + w > 1 + 1e-9L;
}

/** Square of the distance to the triangle's plane where p lies over its inside; INFINITY elsewhere. In 113 bits. */
static real inside_square(vec p, vec a, vec b, vec c)
{
    vec ap = sub(p, a), ab = sub(b, a), ac = sub(c, a);
    if (clearly_beside(ap, ab, ac)) return INFINITY;
    wide nx = (wide)ab.y * ac.z - (wide)ab.z * ac.y, ny = (wide)ab.z * ac.x - (wide)ab.x * ac.z;
    wide nz = (wide)ab.x * ac.y - (wide)ab.y * ac.x, square = nx * nx + ny * ny + nz * nz;
    if (!(square > (wide)1e-32L * (wide)dot(ab, ab) * (wide)dot(ac, ac))) return INFINITY;
    wide v = ((wide)ap.y * ac.z - (wide)ap.z * ac.y) * nx + ((wide)ap.z * ac.x - (wide)ap.x * ac.z) * ny +
             ((wide)ap.x * ac.y - (wide)ap.y * ac.x) * nz;
    wide w = ((wide)ab.y * ap.z - (wide)ab.z * ap.y) * nx + ((wide)ab.z * ap.x - (wide)ab.x * ap.z) * ny +
             ((wide)ab.x * ap.y - (wide)ab.y * ap.x) * nz;
    if (v < 0 || w < 0 || v + w > square) return INFINITY;
    wide height = nx * ap.x + ny * ap.y + nz * ap.z;
    return (real)(height * height / square);
}

/** The nearest of the three sides, and the plane where the point lies over the inside. */
static real triangle_distance(vec p, vec a, vec b, vec c)
{
    real d = segment_square(p, a, b, NULL);
    d = least(d, segment_square(p, b, c, NULL));
    d = least(d, segment_square(p, c, a, NULL));
    return sqrtl(least(d, inside_square(p, a, b, c)));
}

/** True only when p is farther than this from the hull of the corners: beside it along one axis, by more than rounding. */
static bool is_beyond(const double p[3], const double (*corner)[3], int count, double distance)
{
    for (int k = 0; k < 3; ++k) {
        double low = corner[0][k], high = corner[0][k];
        for (int i = 1; i < count; ++i) {
            if (corner[i][k] < low) low = corner[i][k];
            if (corner[i][k] > high) high = corner[i][k];
        }
        if ((1 - 1e-12) * (low - p[k]) > distance || (1 - 1e-12) * (p[k] - high) > distance) return true;
    }
    return false;
}

bool qm_slow_triangle_is_beyond(const double p[3], const double corner[3][3], double distance)
{
    return is_beyond(p, corner, 3, distance);
}

double qm_slow_triangle_distance(const double p[3], const double a[3], const double b[3], const double c[3])
{
    return (double)triangle_distance(load(p), load(a), load(b), load(c));
}

/* ---- point to bilinear patch ---- */

typedef struct patch {
    vec corner[4]; /* at (s, t) = (0,0) (1,0) (1,1) (0,1) */
} patch;

static vec patch_at(const patch *q, real s, real t)
{
    return lerp(lerp(q->corner[0], q->corner[1], s), lerp(q->corner[3], q->corner[2], s), t);
}

typedef struct rectangle {
    real s0, t0, s1, t1;
} rectangle;

static patch patch_part(const patch *q, rectangle r)
{
    return (patch){
        {patch_at(q, r.s0, r.t0), patch_at(q, r.s1, r.t0), patch_at(q, r.s1, r.t1), patch_at(q, r.s0, r.t1)}};
}

/**
 * A convex set that stands for a part of the target: no point of either is farther than slack from the other.
 * A triangle stands for itself. A patch o + s e1 + t e2 + s t w stands within |w| / 4 of the parallelogram
 * (o - w/4) + s (e1 + w/2) + t (e2 + w/2): their difference at (s, t) is (s - 1/2)(t - 1/2) w.
 */
typedef struct label {
    vec corner[4];
    int corner_count; /* 3, or 4 for a parallelogram */
    real slack;
} label;

static label label_of_triangle(vec a, vec b, vec c)
{
    return (label){{a, b, c}, 3, 0};
}

static label label_of_patch(const patch *q)
{
    vec w = add(sub(q->corner[0], q->corner[1]), sub(q->corner[2], q->corner[3]));
    vec shift = scale(0.25L, w);
    label out = {.corner_count = 4, .slack = length(shift)};
    for (int i = 0; i < 4; ++i)
        out.corner[i] = i % 2 ? add(q->corner[i], shift) : sub(q->corner[i], shift);
    return out;
}

static real label_distance(const label *l, vec p)
{
    const vec *c = l->corner;
    if (l->corner_count == 3) return triangle_distance(p, c[0], c[1], c[2]);
    /* Two triangles, whose common side rounding could put outside of both. */
    real d = segment_square(p, c[0], c[2], NULL);
    for (int i = 0; i < 4; ++i)
        d = least(d, segment_square(p, c[i], c[(i + 1) % 4], NULL));
    d = least(d, inside_square(p, c[0], c[1], c[2]));
    return sqrtl(least(d, inside_square(p, c[0], c[2], c[3])));
}

/** Improves (s, t) by turns, exactly along one parameter line at a time; returns the distance reached. */
static real descend(const patch *q, vec p, real st[2])
{
    real best = length(sub(p, patch_at(q, st[0], st[1])));
    for (int i = 0; i < 64; ++i) {
        real next[2] = {st[0], st[1]};
        segment_distance(p, patch_at(q, 0, next[1]), patch_at(q, 1, next[1]), &next[0]);
        real d = segment_distance(p, patch_at(q, next[0], 0), patch_at(q, next[0], 1), &next[1]);
        if (!(d < best)) break;
        bool settled = best - d < 1e-18L * best;
        best = d;
        memcpy(st, next, sizeof next);
        if (settled) break;
    }
    return best;
}

typedef struct real_bracket {
    real lower, upper;
} real_bracket;

static void try_start(const patch *q, vec p, real s, real t, real *best)
{
    real st[2] = {s, t};
    if (length(sub(p, patch_at(q, s, t))) < 2 * *best) *best = least(*best, descend(q, p, st));
}

/** Halves a rectangle across its longer side in space, so that a side of no length costs nothing. */
static void halve(const patch *q, rectangle r, rectangle half[2])
{
    patch part = patch_part(q, r);
    const vec *c = part.corner;
    real along_s = greatest(length(sub(c[1], c[0])), length(sub(c[2], c[3])));
    real along_t = greatest(length(sub(c[3], c[0])), length(sub(c[2], c[1])));
    half[0] = half[1] = r;
    if (along_s > along_t)
        half[0].s1 = half[1].s0 = (r.s0 + r.s1) / 2;
    else
        half[0].t1 = half[1].t0 = (r.t0 + r.t1) / 2;
}

static bool same(vec a, vec b)
{
    return a.x == b.x && a.y == b.y && a.z == b.z;
}

/**
 * True for a patch with at most two different corners, a and b: then it is the whole segment between them,
 * and endless pieces of it would have the same distance.
 */
static bool is_segment(const patch *q, vec *a, vec *b)
{
    *a = *b = q->corner[0];
    for (int i = 1; i < 4; ++i) {
        if (same(q->corner[i], *a) || same(q->corner[i], *b)) continue;
        if (!same(*a, *b)) return false;
        *b = q->corner[i];
    }
    return true;
}

/** Halves the patch, nearest possible part first, until no part can be nearer than eps below the best. */
static real_bracket patch_distance(const patch *q, vec p, real eps)
{
    enum { LIMIT = 4000 };
    vec a, b;
    if (is_segment(q, &a, &b)) {
        real d = segment_distance(p, a, b, NULL);
        return (real_bracket){d, d};
    }
    real best = INFINITY;
    for (int i = 0; i < 5; ++i)
        try_start(q, p, i == 4 ? 0.5L : i & 1, i == 4 ? 0.5L : i >> 1, &best);

    rectangle *cells = NULL;
    size_t count = 0, capacity = 0;
    heap queue = {0};
    cells = grow(cells, count, &capacity, sizeof *cells);
    cells[count++] = (rectangle){0, 0, 1, 1};
    label whole = label_of_patch(q);
    heap_push(&queue, -greatest(0, label_distance(&whole, p) - whole.slack), 0);
    while (best + queue.entries[0].key > eps && count < LIMIT) {
        heap_entry top = heap_pop(&queue);
        rectangle r = cells[top.id], half[2];
        real s = (r.s0 + r.s1) / 2, t = (r.t0 + r.t1) / 2;
        if (length(sub(p, patch_at(q, s, t))) < best) try_start(q, p, s, t, &best);
        halve(q, r, half);
        for (int i = 0; i < 2; ++i) {
            patch part = patch_part(q, half[i]);
            label l = label_of_patch(&part);
            real lower = greatest(label_distance(&l, p) - l.slack, -top.key);
            cells = grow(cells, count, &capacity, sizeof *cells);
            cells[count] = half[i];
            heap_push(&queue, -lower, count++);
        }
    }
    real_bracket out = {least(best, -queue.entries[0].key), best};
    free(cells);
    free(queue.entries);
    return out;
}

static qm_slow_bracket close_bracket(real lower, real upper, real eps)
{
    return (qm_slow_bracket){(double)lower, (double)upper, upper - lower <= eps};
}

qm_slow_bracket qm_slow_patch_distance(const double p[3], const double corners[4][3], double eps)
{
    patch q = {{load(corners[0]), load(corners[1]), load(corners[2]), load(corners[3])}};
    real_bracket d = patch_distance(&q, load(p), eps);
    return close_bracket(d.lower, d.upper, eps);
}

/* ---- a mesh as a list of parts ---- */

static vec vertex(const qm_mesh *mesh, size_t index)
{
    return load(mesh->positions + 3 * index);
}

/** Corners of a face; a point of a point set is a face of one corner. Returns their number. */
static int load_face(const qm_mesh *mesh, size_t face, vec corner[4])
{
    if (mesh->face_count == 0) {
        corner[0] = vertex(mesh, face);
        return 1;
    }
    const uint32_t *index = mesh->faces + 4 * face;
    int count = index[3] == QM_NO_INDEX ? 3 : 4;
    for (int i = 0; i < count; ++i)
        corner[i] = vertex(mesh, index[i]);
    return count;
}

static size_t part_count(const qm_mesh *mesh)
{
    return mesh->face_count ? mesh->face_count : mesh->vertex_count;
}

/** What a face is as a target: one or two labels, and the patch behind the label where it is one. */
typedef struct target_face {
    label labels[2];
    int label_count;
    bool is_patch;
    patch patch;
} target_face;

static target_face make_target(const qm_mesh *mesh, size_t face, qm_quad_reading reading)
{
    vec c[4];
    int count = load_face(mesh, face, c);
    target_face out = {.label_count = 1};
    if (count == 1) {
        out.labels[0] = label_of_triangle(c[0], c[0], c[0]);
    } else if (count == 3) {
        out.labels[0] = label_of_triangle(c[0], c[1], c[2]);
    } else if (reading == QM_QUADS_TRIANGLES) {
        out.labels[0] = label_of_triangle(c[0], c[1], c[2]);
        out.labels[1] = label_of_triangle(c[0], c[2], c[3]);
        out.label_count = 2;
    } else {
        out.is_patch = true;
        memcpy(out.patch.corner, c, sizeof c);
        out.labels[0] = label_of_patch(&out.patch);
    }
    return out;
}

static real_bracket target_distance(const target_face *target, vec p, real eps)
{
    if (target->is_patch) return patch_distance(&target->patch, p, eps);
    real d = label_distance(&target->labels[0], p);
    if (target->label_count == 2) d = least(d, label_distance(&target->labels[1], p));
    return (real_bracket){d, d};
}

qm_slow_bracket qm_slow_face_distance(const qm_mesh *mesh, size_t face, qm_quad_reading reading,
                                      const double p[3], double eps)
{
    target_face target = make_target(mesh, face, reading);
    real_bracket d = target_distance(&target, load(p), eps);
    return close_bracket(d.lower, d.upper, eps);
}

bool qm_slow_face_within(const qm_mesh *mesh, size_t face, qm_quad_reading reading, const double p[3],
                         double reach)
{
    target_face target = make_target(mesh, face, reading);
    if (!target.is_patch) return target_distance(&target, load(p), 0).upper <= reach;
    real d = label_distance(&target.labels[0], load(p)), slack = target.labels[0].slack;
    if (d + slack <= reach || d - slack > reach) return d + slack <= reach;
    return patch_distance(&target.patch, load(p), 1e-9L * reach).upper <= reach;
}

static bool face_is_beyond(const qm_mesh *mesh, size_t face, const double p[3], double distance)
{
    vec corner[4];
    double at[4][3];
    int count = load_face(mesh, face, corner);
    for (int i = 0; i < count; ++i)
        store(corner[i], at[i]);
    return is_beyond(p, at, count, distance);
}

qm_slow_bracket qm_slow_distance(const qm_mesh *mesh, qm_quad_reading reading, const double p[3], double eps)
{
    real lower = INFINITY, upper = INFINITY;
    for (size_t f = 0; f < part_count(mesh); ++f) {
        if (face_is_beyond(mesh, f, p, (double)upper)) continue;
        target_face target = make_target(mesh, f, reading);
        if (target.is_patch && label_distance(&target.labels[0], load(p)) - target.labels[0].slack >= upper)
            continue;
        real_bracket d = target_distance(&target, load(p), eps);
        lower = least(lower, d.lower);
        upper = least(upper, d.upper);
    }
    return close_bracket(least(lower, upper), upper, eps);
}

static vec face_at(const vec c[4], int count, qm_quad_reading reading, real u, real v)
{
    if (count == 1) return c[0];
    if (count == 3) return add(c[0], add(scale(u, sub(c[1], c[0])), scale(v, sub(c[2], c[0]))));
    if (reading == QM_QUADS_BILINEAR) {
        patch q = {{c[0], c[1], c[2], c[3]}};
        return patch_at(&q, u, v);
    }
    if (v <= u) return add(c[0], add(scale(u, sub(c[1], c[0])), scale(v, sub(c[2], c[1]))));
    return add(c[0], add(scale(v, sub(c[3], c[0])), scale(u, sub(c[2], c[3]))));
}

void qm_slow_position(const qm_mesh *mesh, size_t face, qm_quad_reading reading, const double uv[2],
                      double out[3])
{
    vec c[4];
    int count = load_face(mesh, face, c);
    store(face_at(c, count, reading, uv[0], uv[1]), out);
}

/* ---- Hausdorff distance ---- */

/** A part of the source: a point, a triangle, or a parameter rectangle of a patch. */
typedef struct cell {
    int corner_count;
    vec corner[4];
    bool is_patch;
    size_t face; /* of the patch */
    rectangle part;
} cell;

typedef struct slow_search {
    const qm_mesh *source;
    target_face *targets;
    size_t target_count;
    real eps;
    real lower; /* greatest distance of a sample so far */
    cell *cells;
    size_t cell_count, cell_capacity;
    heap queue;      /* by upper bound */
    real *distances; /* of the samples of the current cell to all labels: rows of label_count */
    size_t label_count;
} slow_search;

enum { SAMPLE_LIMIT = 5 };

/** The corners of a cell, then its middle: all of them points of the source. */
static int find_samples(const slow_search *search, const cell *c, vec samples[SAMPLE_LIMIT])
{
    memcpy(samples, c->corner, (size_t)c->corner_count * sizeof *samples);
    if (c->corner_count == 1) return 1;
    if (c->is_patch) {
        patch q;
        load_face(search->source, c->face, q.corner);
        samples[4] = patch_at(&q, (c->part.s0 + c->part.s1) / 2, (c->part.t0 + c->part.t1) / 2);
        return 5;
    }
    samples[3] = scale(1 / 3.0L, add(samples[0], add(samples[1], samples[2])));
    return 4;
}

static void fill_distances(slow_search *search, const vec *samples, int count)
{
    real *out = search->distances;
    for (int i = 0; i < count; ++i)
        for (size_t f = 0; f < search->target_count; ++f)
            for (int k = 0; k < search->targets[f].label_count; ++k)
                *out++ = label_distance(&search->targets[f].labels[k], samples[i]);
}

/** Bracket of a sample's distance to the target, as narrow as eps only where it could raise the lower
 * bound. */
static real_bracket sample_distance(const slow_search *search, vec p, const real *row)
{
    real_bracket coarse = {INFINITY, INFINITY};
    const real *d = row;
    for (size_t f = 0; f < search->target_count; ++f)
        for (int k = 0; k < search->targets[f].label_count; ++k, ++d) {
            real slack = search->targets[f].labels[k].slack;
            coarse.lower = least(coarse.lower, greatest(0, *d - slack));
            coarse.upper = least(coarse.upper, *d + slack);
        }
    if (coarse.lower == coarse.upper || coarse.upper <= search->lower) return coarse;

    real_bracket fine = {INFINITY, coarse.upper};
    d = row;
    for (size_t f = 0; f < search->target_count; ++f) {
        const target_face *target = &search->targets[f];
        real nearest = *d - target->labels[0].slack;
        if (target->label_count == 2) nearest = least(nearest, d[1]);
        d += target->label_count;
        if (nearest > fine.upper) continue;
        real_bracket one = target_distance(target, p, search->eps / 4);
        fine.lower = least(fine.lower, one.lower);
        fine.upper = least(fine.upper, one.upper);
    }
    fine.lower = least(fine.lower, fine.upper);
    return fine;
}

/**
 * A convex set's distance function is convex, so over the hull of the corners it is greatest at a corner: for
 * each label the greatest of its corner distances bounds the cell.
 */
static real upper_by_labels(const slow_search *search, int corner_count)
{
    real best = INFINITY;
    size_t column = 0;
    for (size_t f = 0; f < search->target_count; ++f)
        for (int k = 0; k < search->targets[f].label_count; ++k, ++column) {
            real worst = 0;
            for (int i = 0; i < corner_count; ++i)
                worst = greatest(worst, search->distances[(size_t)i * search->label_count + column]);
            best = least(best, worst + search->targets[f].labels[k].slack);
        }
    return best;
}

/** The same with a piece of one patch: the rectangle round the feet of the corners. Any feet would do. */
static real upper_by_patch_part(const patch *q, const vec *corner, int corner_count)
{
    rectangle r = {1, 1, 0, 0};
    for (int i = 0; i < corner_count; ++i) {
        real st[2] = {0.5L, 0.5L};
        descend(q, corner[i], st);
        r = (rectangle){least(r.s0, st[0]), least(r.t0, st[1]), greatest(r.s1, st[0]), greatest(r.t1, st[1])};
    }
    patch part = patch_part(q, r);
    label l = label_of_patch(&part);
    real worst = 0;
    for (int i = 0; i < corner_count; ++i)
        worst = greatest(worst, label_distance(&l, corner[i]));
    return worst + l.slack;
}

/** Bounds a cell, raises the lower bound by its samples, and queues it. bound: what its parent gave. */
static void add_cell(slow_search *search, const cell *c, real bound)
{
    vec samples[SAMPLE_LIMIT];
    int count = find_samples(search, c, samples);
    fill_distances(search, samples, count);
    real upper = least(bound, upper_by_labels(search, c->corner_count));
    for (int i = 0; i < count; ++i) {
        real_bracket d =
            sample_distance(search, samples[i], search->distances + (size_t)i * search->label_count);
        search->lower = greatest(search->lower, d.lower);
        real reach = 0;
        for (int k = 0; k < c->corner_count; ++k)
            reach = greatest(reach, length(sub(samples[i], c->corner[k])));
        upper = least(upper, d.upper + reach);
    }
    for (size_t f = 0; f < search->target_count; ++f) {
        const target_face *target = &search->targets[f];
        if (!target->is_patch || upper <= search->lower + search->eps) continue;
        upper = least(upper, upper_by_patch_part(&target->patch, c->corner, c->corner_count));
    }
    search->cells = grow(search->cells, search->cell_count, &search->cell_capacity, sizeof *search->cells);
    search->cells[search->cell_count] = *c;
    heap_push(&search->queue, upper, search->cell_count++);
}

static void add_triangle(slow_search *search, vec a, vec b, vec c, real bound)
{
    cell part = {.corner_count = 3, .corner = {a, b, c}};
    add_cell(search, &part, bound);
}

static void add_rectangle(slow_search *search, size_t face, rectangle r, real bound)
{
    patch q;
    load_face(search->source, face, q.corner);
    patch part = patch_part(&q, r);
    cell c = {.corner_count = 4, .is_patch = true, .face = face, .part = r};
    memcpy(c.corner, part.corner, sizeof c.corner);
    add_cell(search, &c, bound);
}

static void add_face(slow_search *search, size_t face, qm_quad_reading reading)
{
    vec c[4];
    int count = load_face(search->source, face, c);
    if (count == 1) {
        cell point = {.corner_count = 1, .corner = {c[0]}};
        add_cell(search, &point, INFINITY);
    } else if (count == 4 && reading == QM_QUADS_BILINEAR) {
        add_rectangle(search, face, (rectangle){0, 0, 1, 1}, INFINITY);
    } else {
        add_triangle(search, c[0], c[1], c[2], INFINITY);
        if (count == 4) add_triangle(search, c[0], c[2], c[3], INFINITY);
    }
}

static void split_cell(slow_search *search, cell c, real bound)
{
    if (c.is_patch) {
        real s = (c.part.s0 + c.part.s1) / 2, t = (c.part.t0 + c.part.t1) / 2;
        add_rectangle(search, c.face, (rectangle){c.part.s0, c.part.t0, s, t}, bound);
        add_rectangle(search, c.face, (rectangle){s, c.part.t0, c.part.s1, t}, bound);
        add_rectangle(search, c.face, (rectangle){c.part.s0, t, s, c.part.t1}, bound);
        add_rectangle(search, c.face, (rectangle){s, t, c.part.s1, c.part.t1}, bound);
    } else {
        vec ab = lerp(c.corner[0], c.corner[1], 0.5L), bc = lerp(c.corner[1], c.corner[2], 0.5L);
        vec ca = lerp(c.corner[2], c.corner[0], 0.5L);
        add_triangle(search, c.corner[0], ab, ca, bound);
        add_triangle(search, ab, c.corner[1], bc, bound);
        add_triangle(search, ca, bc, c.corner[2], bound);
        add_triangle(search, ab, bc, ca, bound);
    }
}

static qm_slow_bracket one_sided(const qm_mesh *a, const qm_mesh *b, qm_quad_reading reading, double eps,
                                 size_t cell_limit)
{
    slow_search search = {.source = a, .target_count = part_count(b), .eps = eps};
    size_t target_capacity = 0;
    for (size_t f = 0; f < search.target_count; ++f) {
        search.targets = grow(search.targets, f, &target_capacity, sizeof *search.targets);
        search.targets[f] = make_target(b, f, reading);
        search.label_count += (size_t)search.targets[f].label_count;
    }
    size_t row_capacity = 0;
    search.distances = grow(NULL, 0, &row_capacity, SAMPLE_LIMIT * search.label_count * sizeof(real));

    for (size_t f = 0; f < part_count(a); ++f)
        add_face(&search, f, reading);
    while (search.queue.entries[0].key > search.lower + eps && search.cell_count < cell_limit &&
           search.cells[search.queue.entries[0].id].corner_count > 1) {
        heap_entry top = heap_pop(&search.queue);
        split_cell(&search, search.cells[top.id], top.key);
    }
    qm_slow_bracket out =
        close_bracket(search.lower, greatest(search.lower, search.queue.entries[0].key), eps);
    free(search.targets);
    free(search.cells);
    free(search.queue.entries);
    free(search.distances);
    return out;
}

qm_slow_bracket qm_slow_hausdorff(const qm_mesh *a, const qm_mesh *b, qm_direction direction,
                                  qm_quad_reading reading, double eps, size_t cell_limit)
{
    if (direction == QM_A_TO_B) return one_sided(a, b, reading, eps, cell_limit);
    if (direction == QM_B_TO_A) return one_sided(b, a, reading, eps, cell_limit);
    qm_slow_bracket ab = one_sided(a, b, reading, eps, cell_limit);
    qm_slow_bracket ba = one_sided(b, a, reading, eps, cell_limit);
    double lower = fmax(ab.lower, ba.lower), upper = fmax(ab.upper, ba.upper);
    return (qm_slow_bracket){lower, upper, upper - lower <= eps};
}

/* ---- samples ---- */

static real face_area(const vec c[4], int count)
{
    real area = length(cross(sub(c[1], c[0]), sub(c[2], c[0])));
    return count == 4 ? area + length(cross(sub(c[2], c[0]), sub(c[3], c[0]))) : area;
}

/** Parameters spread evenly over a triangle's u, v or over the unit square. */
static void random_uv(qm_random *random, int count, double uv[2])
{
    uv[0] = qm_random_range(random, 0, 1);
    uv[1] = qm_random_range(random, 0, 1);
    if (count == 3 && uv[0] + uv[1] > 1) {
        uv[0] = 1 - uv[0];
        uv[1] = 1 - uv[1];
    }
}

void qm_slow_sample(const qm_mesh *mesh, qm_quad_reading reading, qm_random *random, size_t count,
                    double *out)
{
    vec c[4];
    real total = 0, passed = 0;
    for (size_t f = 0; f < mesh->face_count; ++f) {
        int corner_count = load_face(mesh, f, c);
        total += face_area(c, corner_count);
    }
    size_t made = 0;
    for (size_t f = 0; f < mesh->face_count; ++f) {
        int corner_count = load_face(mesh, f, c);
        passed += face_area(c, corner_count);
        size_t wanted = f + 1 == mesh->face_count ? count : (size_t)((real)count * (passed / total));
        for (; made < wanted && made < count; ++made) {
            double uv[2];
            random_uv(random, corner_count, uv);
            store(face_at(c, corner_count, reading, uv[0], uv[1]), out + 3 * made);
        }
    }
}
