/**
 * extent.c: area and volume as intervals.
 *
 * Everything is computed from edges, in a unit that is a power of two near the size of the mesh: so neither a large
 * offset nor a tiny size costs digits. Let u = 2^-53, e and f two edges of a face, m the sum of the squares of its
 * edges, R a bound of the distance of a vertex from the origin o in the middle of the mesh.
 *
 *   Edge      Each coordinate is a difference, rounded once; the unit is exact. Relative error u.
 *   Cross     Each coordinate has two edges, a product and a difference on its way: it is off by 4 u times the sum of
 *             its two products' magnitudes, the vector e x f by 4 u sqrt(2) |e| |f| <= 2.9 u (|e|^2 + |f|^2).
 *   Length    of such a vector: 3 u of it more, 1.5 u (|e|^2 + |f|^2).
 *   Triangles A quad's two crosses have the edges B, G and G, C with the diagonal G, |G|^2 <= m: 3 m in place of
 *             |e|^2 + |f|^2, 13.2 u m for both lengths, and 1.5 u m for their sum.
 *   Volume    Six times that of the pyramid over a triangle is (a - o) . (e x f), a a corner: a - o is off by u R, the
 *             dot product by 3 u, in all 4.9 u R (|e|^2 + |f|^2), 14.6 u R m for a quad.
 *   Blend     Of the four crosses at the corners of a bilinear quad, with weights of sum 1: 2.9 u m of the crosses,
 *             3 u m of weights and sums, 1 u m of the place, 1.5 u m of the length; twice that for twice the area.
 *
 * With the m of a quad counted twice, all are below TERM m (times R), which is summed beside the figures. Sums are kept in two numbers with the error of
 * each addition: n additions of x_i leave u |sum| + (2 n u)^2 sum |x_i| (T. Ogita, S. M. Rump, S. Oishi, Accurate sum
 * and dot product, 2005, proposition 4.5, and the merging of blocks). Where a product or a square underflows, a face is
 * off by less than TINY.
 *
 * Bilinear quads. The normal N(u, v) = P_u x P_v of a bilinear patch is affine in u and v: the bilinear part of P has
 * no cross product with itself. So the area is the integral of f = |N| over the unit square, which is convex. Along u,
 * with w = N_u and the distance d of the line N(., v) from 0: f = sqrt(d^2 + |w|^2 t^2) with t from the foot, hence
 *
 *   f_uu = |w|^2 d^2 / f^3,   |f_uuuu| = 3 |w|^4 d^2 |d^2 - 4 |w|^2 t^2| / f^7 <= 12 |w|^4 d^2 / f^5,
 *
 * and |w| d = |w x N| does not depend on u and is largest at an end of v. The middle times the cell's area is a lower
 * bound (Jensen), and low by h^4 / 24 times the largest f_uu + f_vv. Gauss's rule with two points each way is off by
 * h^6 / 4320 times the largest |f_uuuu| + |f_vvvv|. The mean of f at the corners is an upper bound as f is convex.
 *
 * The volume below a bilinear patch is the mean of those of its two pairs of triangles: the patch halves the
 * tetrahedron of its corners, as the turn of the corners by one maps patch and tetrahedron to themselves and changes
 * the sides over.
 */
#include "qm/extent.h"

#include <float.h>

#include "core/rounding.h"
#include "core/vec.h"
#include "prim/orient.h"

#define BLOCK 4096 /* faces */
#define TERM (16.0 * QM_UNIT_ROUNDING)
#define TINY 0x1p-500
#define MAX_EXPONENT 1000
#define GAP 1e-8          /* of the area of a bilinear quad: below it a cell is not cut */
#define LEAST 0x1p-150    /* of f: the fifth power of its half is a normal number */
#define MAX_CELLS 1024    /* of one quad that wait */
#define MORE_CELLS 262144 /* of all blocks, besides two a face: small meshes are measured more closely */

/** A sum in two numbers. */
typedef struct wide_sum {
    double high, low;
} wide_sum;

static inline void add_to(wide_sum *sum, double x)
{
    double high = sum->high + x, rest = high - sum->high;
    sum->low += (sum->high - (high - rest)) + (x - rest);
    sum->high = high;
}

static inline void merge_into(wide_sum *sum, wide_sum other)
{
    add_to(sum, other.high);
    sum->low += other.low;
}

/** Sums over some faces, in the unit of the work. Areas are twice, volumes six times as large. */
typedef struct part_sums {
    wide_sum area[2], volume[2]; /* by qm_quad_reading; of bilinear areas the lower bound */
    double slack;                /* by which those may be too small */
    double squares;              /* of edges */
    size_t degenerate_faces;
    size_t cells; /* that may still be made */
} part_sums;

typedef struct extent_work {
    qm_context *ctx;
    const qm_mesh *mesh;
    qm_vec origin;
    double scale;
    int large; /* exponent that brings coordinates into the range of exact signs; 0 for nearly all meshes */
    part_sums *parts;
    size_t blocks;
} extent_work;

static inline qm_vec corner_of(const qm_mesh *mesh, size_t face, int i)
{
    return qm_vec_load(mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)i]);
}

static inline qm_vec edge_of(const extent_work *work, qm_vec from, qm_vec to)
{
    return qm_vec_scale(work->scale, qm_vec_sub(to, from));
}

/* ---- faces without area ---- */

static bool is_flat_triangle(const extent_work *work, qm_vec a, qm_vec b, qm_vec c)
{
    if (work->large != 0) {
        double scale = ldexp(1.0, work->large);
        a = qm_vec_scale(scale, a);
        b = qm_vec_scale(scale, b);
        c = qm_vec_scale(scale, c);
    }
    return qm_orient2d(a, b, c, 0) == 0 && qm_orient2d(a, b, c, 1) == 0 && qm_orient2d(a, b, c, 2) == 0;
}

static bool is_flat_face(const extent_work *work, size_t face)
{
    const qm_mesh *mesh = work->mesh;
    qm_vec a = corner_of(mesh, face, 0), c = corner_of(mesh, face, 2);
    if (!is_flat_triangle(work, a, corner_of(mesh, face, 1), c)) return false;
    return mesh->faces[4 * face + 3] == QM_NO_INDEX || is_flat_triangle(work, a, c, corner_of(mesh, face, 3));
}

/** True for the first part of a face of the input, or the only one, when all its parts are flat. */
static bool is_flat_input_face(const extent_work *work, size_t face)
{
    const uint32_t *origin = work->mesh->face_origin;
    if (!origin) return is_flat_face(work, face);
    if (face > 0 && origin[face - 1] == origin[face]) return false;
    for (size_t f = face; f < work->mesh->face_count && origin[f] == origin[face]; f++)
        if (!is_flat_face(work, f)) return false;
    return true;
}

/* ---- bilinear quads ---- */

/** The normal of a bilinear patch at its corners, as u v = 00, 10, 01, 11, and what its values are off by. */
typedef struct patch_normal {
    qm_vec at[4];
    double error;
} patch_normal;

/** A square of parameters. */
typedef struct patch_cell {
    double u, v, size;
} patch_cell;

static qm_vec normal_at(const patch_normal *normal, double u, double v)
{
    return qm_vec_mix(qm_vec_mix(normal->at[0], normal->at[1], u),
                      qm_vec_mix(normal->at[2], normal->at[3], u), v);
}

/** Bounds over a cell for the derivatives of f along u and along v: |w x N| at its largest, and |w|. */
typedef struct cell_bounds {
    double least;              /* of f; may be 0 or less */
    double turn[2], length[2]; /* |w x N| and |w| */
} cell_bounds;

static cell_bounds bound_cell(const patch_normal *normal, const patch_cell *cell, qm_vec middle, double f)
{
    const qm_vec w[2] = {qm_vec_sub(normal->at[1], normal->at[0]), qm_vec_sub(normal->at[2], normal->at[0])};
    double half = 0.5 * cell->size, error = normal->error;
    cell_bounds out;
    /* N . n is affine for the direction n of N in the middle, so least at a corner. */
    double fall = (fabs(qm_vec_dot(w[0], middle)) + fabs(qm_vec_dot(w[1], middle))) / f;
    out.least = (f - half * (fall + 2.0 * error)) - 2.0 * error;
    for (int i = 0; i < 2; i++)
        out.length[i] = qm_vec_norm(w[i]) + 2.0 * error;
    double across =
        half * qm_vec_norm(qm_vec_cross(w[0], w[1])) + 4.0 * error * (f + out.length[0] + out.length[1]);
    for (int i = 0; i < 2; i++)
        out.turn[i] = qm_vec_norm(qm_vec_cross(w[i], middle)) + across;
    return out;
}

static double square(double x)
{
    return x * x;
}

/** The integral of f over a cell lies between lower and lower + slack. */
typedef struct cell_area {
    double lower, slack;
} cell_area;

static cell_area measure_cell(const patch_normal *normal, const patch_cell *cell)
{
    const double h = cell->size, area = h * h, mid_u = cell->u + 0.5 * h, mid_v = cell->v + 0.5 * h;
    qm_vec middle = normal_at(normal, mid_u, mid_v);
    double f = qm_vec_norm(middle), highest = 0.0;
    cell_area best = {area * f, INFINITY};
    if (f > LEAST) {
        cell_bounds bounds = bound_cell(normal, cell, middle, f);
        if (bounds.least > 0.5 * f) {
            double turns = square(bounds.turn[0]) + square(bounds.turn[1]);
            best.slack = 1.001 * square(area) / 24.0 * turns / (square(bounds.least) * bounds.least);
            if (best.slack <= GAP * best.lower) return best;
            double fourth =
                12.0 *
                (square(bounds.turn[0] * bounds.length[0]) + square(bounds.turn[1] * bounds.length[1])) /
                (square(square(bounds.least)) * bounds.least);
            double rest = 1.001 * area * square(area) / 4320.0 * fourth;
            if (2.0 * rest < best.slack) {
                const double step = h * 0.28867513459481287; /* half a side over the root of 3 */
                double sum = qm_vec_norm(normal_at(normal, mid_u - step, mid_v - step)) +
                             qm_vec_norm(normal_at(normal, mid_u + step, mid_v - step)) +
                             qm_vec_norm(normal_at(normal, mid_u - step, mid_v + step)) +
                             qm_vec_norm(normal_at(normal, mid_u + step, mid_v + step));
                best = (cell_area){0.25 * area * sum - rest, 2.0 * rest};
            }
            if (best.slack <= GAP * best.lower) return best;
        }
    }
    for (int i = 0; i < 4; i++)
        highest +=
            0.25 * qm_vec_norm(normal_at(normal, cell->u + (i & 1 ? h : 0.0), cell->v + (i & 2 ? h : 0.0)));
    double gap = area * qm_max(highest - f, 0.0);
    return gap < best.slack ? (cell_area){area * f, gap} : best;
}

/** The integral over the unit square. Cells are cut in four, large ones first, while that pays and while fewer than
 * *cells have been made; *cells is lowered by those. */
static cell_area measure_patch(const patch_normal *normal, double accepted, size_t limit, size_t *cells)
{
    patch_cell queue[MAX_CELLS];
    queue[0] = (patch_cell){0.0, 0.0, 1.0};
    unsigned first = 0, count = 1;
    size_t made = 0;
    cell_area sum = {0.0, 0.0};
    while (count > 0) {
        patch_cell cell = queue[first];
        first = (first + 1) % MAX_CELLS;
        count--;
        cell_area found = measure_cell(normal, &cell);
        bool is_fine = found.slack <= qm_max(GAP * found.lower, accepted * square(cell.size));
        if (is_fine || made + 4 > limit || count + 4 > MAX_CELLS) {
            sum.lower += found.lower;
            sum.slack += found.slack;
            continue;
        }
        made += 4;
        double half = 0.5 * cell.size;
        for (int i = 0; i < 4; i++)
            queue[(first + count++) % MAX_CELLS] =
                (patch_cell){cell.u + (i & 1 ? half : 0.0), cell.v + (i & 2 ? half : 0.0), half};
    }
    *cells -= made;
    return sum;
}

/* ---- sums ---- */

/** True unless a cross product of edges with these squares may be zero. */
static inline bool is_surely_long(qm_vec cross, double squares)
{
    double error = 3.0 * QM_UNIT_ROUNDING * squares + TINY;
    return qm_vec_norm2(cross) > 1.001 * error * error;
}

static void add_triangle(const extent_work *work, size_t face, part_sums *sums)
{
    qm_vec a = corner_of(work->mesh, face, 0);
    qm_vec e = edge_of(work, a, corner_of(work->mesh, face, 1)),
           f = edge_of(work, a, corner_of(work->mesh, face, 2));
    qm_vec normal = qm_vec_cross(e, f);
    double squares = qm_vec_norm2(e) + qm_vec_norm2(f), area = qm_vec_norm(normal);
    double volume = qm_vec_dot(edge_of(work, work->origin, a), normal);
    for (int reading = 0; reading < 2; reading++) {
        add_to(&sums->area[reading], area);
        add_to(&sums->volume[reading], volume);
    }
    sums->squares += squares;
    if (!is_surely_long(normal, squares)) sums->degenerate_faces += is_flat_input_face(work, face);
}

/** rest: faces of the block from this one on, which share the cells that are left. */
static void add_quad(const extent_work *work, size_t face, size_t rest, part_sums *sums)
{
    qm_vec corner[4];
    for (int i = 0; i < 4; i++)
        corner[i] = corner_of(work->mesh, face, i);
    /* The sides, each in the direction of u or v; and the diagonal of the two triangles. */
    qm_vec bottom = edge_of(work, corner[0], corner[1]), top = edge_of(work, corner[3], corner[2]);
    qm_vec left = edge_of(work, corner[0], corner[3]), right = edge_of(work, corner[1], corner[2]);
    qm_vec diagonal = edge_of(work, corner[0], corner[2]);
    qm_vec first = qm_vec_cross(bottom, diagonal), second = qm_vec_cross(diagonal, left);
    double squares = qm_vec_norm2(bottom) + qm_vec_norm2(top) + qm_vec_norm2(left) + qm_vec_norm2(right);
    qm_vec at_start = edge_of(work, work->origin, corner[0]), at_end = edge_of(work, work->origin, corner[2]);
    patch_normal normal = {{qm_vec_cross(bottom, left), qm_vec_cross(bottom, right), qm_vec_cross(top, left),
                            qm_vec_cross(top, right)},
                           TERM * squares};
    double volume = qm_vec_dot(at_start, qm_vec_add(first, second));
    double other = qm_vec_dot(at_start, normal.at[0]) + qm_vec_dot(at_end, normal.at[3]);
    cell_area area = measure_patch(&normal, normal.error, sums->cells / rest, &sums->cells);
    add_to(&sums->area[QM_QUADS_TRIANGLES], qm_vec_norm(first) + qm_vec_norm(second));
    add_to(&sums->volume[QM_QUADS_TRIANGLES], volume);
    /* Twice the area, as of triangles. */
    add_to(&sums->area[QM_QUADS_BILINEAR], 2.0 * area.lower);
    add_to(&sums->volume[QM_QUADS_BILINEAR], 0.5 * (volume + other));
    sums->slack += 2.0 * area.slack;
    sums->squares += 2.0 * squares;
    if (!is_surely_long(first, 3.0 * squares) && !is_surely_long(second, 3.0 * squares))
        sums->degenerate_faces += is_flat_input_face(work, face);
}

static void measure_block(void *data, int worker, size_t block)
{
    (void)worker;
    extent_work *work = data;
    part_sums sums = {.cells = 2 * BLOCK + MORE_CELLS / work->blocks};
    size_t begin = block * BLOCK, end = begin + BLOCK;
    if (end > work->mesh->face_count) end = work->mesh->face_count;
    if (qm_context_canceled(work->ctx)) end = begin;
    for (size_t f = begin; f < end; f++) {
        if (work->mesh->faces[4 * f + 3] == QM_NO_INDEX)
            add_triangle(work, f, &sums);
        else
            add_quad(work, f, end - f, &sums);
    }
    work->parts[block] = sums;
}

/* ---- the result ---- */

/** The interval of a figure in the unit of the mesh: low and high are divided, and moved outward. */
static qm_interval outward(double low, double high, double divisor, int exponent)
{
    double lower = ldexp(nextafter(low / divisor, -INFINITY), exponent);
    double upper = ldexp(nextafter(high / divisor, INFINITY), exponent);
    /* What becomes subnormal is rounded once more. */
    if (fabs(lower) < DBL_MIN) lower = nextafter(lower, -INFINITY);
    if (fabs(upper) < DBL_MIN) upper = nextafter(upper, INFINITY);
    return (qm_interval){qm_min(lower, DBL_MAX), qm_max(upper, -DBL_MAX)};
}

/** Sums all parts, in order. */
static part_sums sum_parts(const extent_work *work, size_t count)
{
    part_sums all = {0};
    for (size_t i = 0; i < count; i++) {
        const part_sums *part = &work->parts[i];
        for (int reading = 0; reading < 2; reading++) {
            merge_into(&all.area[reading], part->area[reading]);
            merge_into(&all.volume[reading], part->volume[reading]);
        }
        all.slack += part->slack;
        all.squares += part->squares;
        all.degenerate_faces += part->degenerate_faces;
    }
    return all;
}

static void conclude(const part_sums *all, size_t faces, double reach, int exponent, qm_extent *out)
{
    out->degenerate_faces = all->degenerate_faces;
    if (all->squares == 0.0) return; /* all corners of each face coincide */
    /* Twice the area is at most the squares of the edges, and so are the terms' magnitudes. */
    const double u = QM_UNIT_ROUNDING, squares = 1.001 * all->squares;
    const double chain = square(8.0 * (double)faces * u) * squares + (double)faces * TINY;
    for (int reading = 0; reading < 2; reading++) {
        double area = all->area[reading].high + all->area[reading].low;
        double volume = all->volume[reading].high + all->volume[reading].low;
        double area_error = TERM * squares + chain + 2.0 * u * area;
        double volume_error = 1.001 * reach * (TERM * squares + chain) + 2.0 * u * fabs(volume);
        double slack = reading == QM_QUADS_BILINEAR ? 1.001 * all->slack : 0.0;
        out->area[reading] = outward(area - area_error, area + area_error + slack, 2.0, 2 * exponent);
        out->area[reading].lower = qm_max(out->area[reading].lower, 0.0);
        out->volume[reading] = outward(volume - volume_error, volume + volume_error, 6.0, 3 * exponent);
    }
}

qm_status qm_extent_measure(qm_context *ctx, const qm_mesh *mesh, int thread_count, qm_extent *out)
{
    QM_ASSERT(ctx && mesh && out && thread_count >= 1);
    *out = (qm_extent){0};
    if (mesh->face_count == 0) return QM_OK;
    const qm_box box = qm_mesh_bounding_box(mesh);
    double largest = 0.0, farthest = 0.0;
    for (int k = 0; k < 3; k++) {
        largest = qm_max(largest, box.max[k] - box.min[k]);
        farthest = qm_max(farthest, qm_max(fabs(box.min[k]), fabs(box.max[k])));
    }
    int exponent = 0, high = 0;
    frexp(largest, &exponent);
    frexp(farthest, &high);
    exponent = exponent < -MAX_EXPONENT ? -MAX_EXPONENT : exponent > MAX_EXPONENT ? MAX_EXPONENT : exponent;
    const size_t blocks = (mesh->face_count + BLOCK - 1) / BLOCK;
    extent_work work = {.ctx = ctx,
                        .mesh = mesh,
                        .origin = {0.5 * box.min[0] + 0.5 * box.max[0], 0.5 * box.min[1] + 0.5 * box.max[1],
                                   0.5 * box.min[2] + 0.5 * box.max[2]},
                        .scale = ldexp(1.0, -exponent),
                        .large = ldexp(1.0, -high) * QM_ORIENT_LIMIT < 1.0 ? -high : 0,
                        .blocks = blocks,
                        .parts = qm_context_alloc(ctx, blocks, sizeof *work.parts)};
    if (!work.parts) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the area of the faces");
    qm_context_parallel_for(ctx, thread_count, blocks, measure_block, &work);
    qm_status status = QM_OK;
    if (qm_context_canceled(ctx))
        status = qm_context_fail(ctx, QM_E_CANCELED, "canceled while the area was measured");
    else {
        const part_sums all = sum_parts(&work, blocks);
        /* The origin, as rounded, lies in the box: no vertex is farther from it than the diagonal of a cube. */
        conclude(&all, mesh->face_count, 1.8 * ldexp(largest, -exponent), exponent, out);
    }
    qm_context_free(ctx, work.parts, blocks, sizeof *work.parts);
    return status;
}
