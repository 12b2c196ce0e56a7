/**
 * raster.c: triangles, lines and squares into a depth buffer.
 */
#include "raster.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define MARGIN 0.92       /* fraction of the picture that a box fills */
#define MAX_CELLS 64      /* along each side of a patch */
#define LEAST_HEIGHT 1e-9 /* of a triangle that is filled, beside its longest side */

/** A corner in the picture, with its parameters. */
typedef struct raster_corner {
    double at[3], uv[2];
} raster_corner;

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void normalise(double v[3])
{
    double greatest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    for (int k = 0; k < 3 && greatest > 0.0; k++)
        v[k] /= greatest;
    double length = sqrt(dot(v, v));
    for (int k = 0; k < 3 && length > 0.0; k++)
        v[k] /= length;
}

/* ---- views ---- */

qm_view qm_raster_view(const qm_box *box, const double towards[3], const double up[3], int width, int height)
{
    qm_view view = {.width = width, .height = height, .size = qm_mesh_box_diagonal(box)};
    /* A single point has a size all the same. */
    if (!(view.size > 0.0)) view.size = 1.0;
    memcpy(view.towards, towards, sizeof view.towards);
    normalise(view.towards);
    cross(up, view.towards, view.right);
    normalise(view.right);
    cross(view.towards, view.right, view.up);
    double wide = 0.0, high = 0.0;
    for (int k = 0; k < 3; k++) {
        double half = 0.5 * (box->max[k] / view.size - box->min[k] / view.size);
        view.centre[k] = 0.5 * box->min[k] + 0.5 * box->max[k];
        wide += half * fabs(view.right[k]);
        high += half * fabs(view.up[k]);
    }
    view.scale = MARGIN * fmin(0.5 * width / fmax(wide, 1e-3), 0.5 * height / fmax(high, 1e-3));
    return view;
}

void qm_raster_project(const qm_view *view, const double point[3], double out[3])
{
    double away[3];
    for (int k = 0; k < 3; k++)
        away[k] = view->scale * ((point[k] - view->centre[k]) / view->size);
    out[0] = 0.5 * view->width + dot(away, view->right);
    out[1] = 0.5 * view->height - dot(away, view->up);
    out[2] = dot(away, view->towards);
}

double qm_raster_shine(const qm_view *view, const double normal[3])
{
    double light[3];
    for (int k = 0; k < 3; k++)
        light[k] = view->towards[k] + 0.4 * view->up[k] - 0.3 * view->right[k];
    normalise(light);
    return 0.25 + 0.75 * fmin(fabs(dot(normal, light)), 1.0);
}

/* ---- the buffer ---- */

static size_t count_pixels(const qm_view *view)
{
    return (size_t)view->width * (size_t)view->height;
}

bool qm_raster_init(qm_context *ctx, const qm_view *view, qm_raster *out)
{
    size_t count = count_pixels(view);
    *out = (qm_raster){.view = *view,
                       .depth = qm_context_alloc(ctx, count, sizeof(double)),
                       .face = qm_context_alloc(ctx, count, sizeof(uint32_t)),
                       .uv = qm_context_alloc(ctx, count, 2 * sizeof(double))};
    if (!out->depth || !out->face || !out->uv) {
        qm_raster_reset(ctx, out);
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        out->depth[i] = -DBL_MAX;
        out->face[i] = QM_NO_INDEX;
    }
    return true;
}

void qm_raster_reset(qm_context *ctx, qm_raster *raster)
{
    size_t count = count_pixels(&raster->view);
    qm_context_free(ctx, raster->uv, count, 2 * sizeof(double));
    qm_context_free(ctx, raster->face, count, sizeof(uint32_t));
    qm_context_free(ctx, raster->depth, count, sizeof(double));
    *raster = (qm_raster){.view = raster->view};
}

static void put(qm_raster *r, int x, int y, double depth, uint32_t face, double u, double v)
{
    size_t at = (size_t)y * (size_t)r->view.width + (size_t)x;
    if (!(depth > r->depth[at])) return;
    r->depth[at] = depth;
    r->face[at] = face;
    r->uv[2 * at] = u;
    r->uv[2 * at + 1] = v;
}

static int clamp(double x, int max)
{
    return !(x > 0.0) ? 0 : x > max ? max : (int)x;
}

/** The pixels of a span, as indices; false when it lies beside the picture. */
static bool find_span(double a, double b, double c, int size, int *first, int *last)
{
    double low = fmin(a, fmin(b, c)), high = fmax(a, fmax(b, c));
    *first = clamp(floor(low), size - 1);
    *last = clamp(floor(high), size - 1);
    return low < size && high >= 0.0;
}

/* ---- lines ---- */

/** Cuts [t0, t1] of a line down to where from + t * way is 0 to size. */
static void clip(double from, double way, double size, double *t0, double *t1)
{
    if (way == 0.0) {
        if (from < 0.0 || from >= size) *t1 = -1.0;
        return;
    }
    double a = (0.0 - from) / way, b = (size - from) / way;
    *t0 = fmax(*t0, fmin(a, b));
    *t1 = fmin(*t1, fmax(a, b));
}

static void draw_line(qm_raster *r, const raster_corner *a, const raster_corner *b, uint32_t face)
{
    double way[3], t0 = 0.0, t1 = 1.0;
    for (int k = 0; k < 3; k++)
        way[k] = b->at[k] - a->at[k];
    clip(a->at[0], way[0], r->view.width, &t0, &t1);
    clip(a->at[1], way[1], r->view.height, &t0, &t1);
    if (!(t0 <= t1)) return;
    int steps =
        (int)fmin((t1 - t0) * fmax(fabs(way[0]), fabs(way[1])), 2.0 * (r->view.width + r->view.height)) + 1;
    for (int i = 0; i <= steps; i++) {
        double t = t0 + (t1 - t0) * i / steps;
        put(r, clamp(a->at[0] + t * way[0], r->view.width - 1),
            clamp(a->at[1] + t * way[1], r->view.height - 1), a->at[2] + t * way[2], face,
            a->uv[0] + t * (b->uv[0] - a->uv[0]), a->uv[1] + t * (b->uv[1] - a->uv[1]));
    }
}

/* ---- triangles ---- */

/** The corner at which the longest side begins; writes the square of its length. */
static int find_longest(const raster_corner c[3], double *square)
{
    int longest = 0;
    *square = -1.0;
    for (int k = 0; k < 3; k++) {
        const double *a = c[k].at, *b = c[(k + 1) % 3].at;
        double side = (b[0] - a[0]) * (b[0] - a[0]) + (b[1] - a[1]) * (b[1] - a[1]);
        if (side <= *square) continue;
        *square = side;
        longest = k;
    }
    return longest;
}

/** The pixels that a triangle may cover. */
typedef struct pixel_box {
    int left, right, top, bottom;
} pixel_box;

/** False when the triangle lies beside the picture. */
static bool find_box(const qm_raster *r, const raster_corner c[3], pixel_box *out)
{
    return find_span(c[0].at[0], c[1].at[0], c[2].at[0], r->view.width, &out->left, &out->right) &&
           find_span(c[0].at[1], c[1].at[1], c[2].at[1], r->view.height, &out->top, &out->bottom);
}

static void fill(qm_raster *r, const raster_corner c[3], const pixel_box *box, double area, uint32_t face)
{
    double e[3], f[3];
    for (int k = 0; k < 3; k++) {
        e[k] = c[1].at[k] - c[0].at[k];
        f[k] = c[2].at[k] - c[0].at[k];
    }
    for (int y = box->top; y <= box->bottom; y++) {
        for (int x = box->left; x <= box->right; x++) {
            double dx = x + 0.5 - c[0].at[0], dy = y + 0.5 - c[0].at[1];
            double v = (dx * f[1] - f[0] * dy) / area, w = (e[0] * dy - dx * e[1]) / area;
            if (!(v >= 0.0 && w >= 0.0 && v + w <= 1.0)) continue;
            put(r, x, y, c[0].at[2] + v * e[2] + w * f[2], face,
                c[0].uv[0] + v * (c[1].uv[0] - c[0].uv[0]) + w * (c[2].uv[0] - c[0].uv[0]),
                c[0].uv[1] + v * (c[1].uv[1] - c[0].uv[1]) + w * (c[2].uv[1] - c[0].uv[1]));
        }
    }
}

static void draw_triangle(qm_raster *r, const raster_corner c[3], uint32_t face)
{
    pixel_box box;
    if (!find_box(r, c, &box)) return;
    double area = (c[1].at[0] - c[0].at[0]) * (c[2].at[1] - c[0].at[1]) -
                  (c[2].at[0] - c[0].at[0]) * (c[1].at[1] - c[0].at[1]);
    double square;
    int longest = find_longest(c, &square);
    if (area * area <= square) {
        const raster_corner *a = &c[longest];
        if (box.left == box.right && box.top == box.bottom)
            put(r, box.left, box.top, a->at[2], face, a->uv[0], a->uv[1]);
        else
            draw_line(r, a, &c[(longest + 1) % 3], face);
    }
    /* What is thinner has no inside but that of its rounding. */
    if (fabs(area) > LEAST_HEIGHT * square) fill(r, c, &box, area, face);
}

/* ---- faces ---- */

/** Parameters of the corners of a quad. */
static const double quad_uv[4][2] = {{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}};

static bool is_patch(const uint32_t *corners, qm_quad_reading quads)
{
    return corners[3] != QM_NO_INDEX && quads == QM_QUADS_BILINEAR;
}

/** Weights of a face's corners at its parameters. */
static void weigh(const uint32_t *corners, qm_quad_reading quads, const double uv[2], double weight[4])
{
    double u = uv[0], v = uv[1];
    weight[3] = 0.0;
    if (corners[3] == QM_NO_INDEX) {
        weight[0] = 1.0 - u - v;
        weight[1] = u;
        weight[2] = v;
    } else if (quads == QM_QUADS_BILINEAR) {
        weight[0] = (1.0 - u) * (1.0 - v);
        weight[1] = u * (1.0 - v);
        weight[2] = u * v;
        weight[3] = (1.0 - u) * v;
    } else {
        /* (c0 c1 c2) where u >= v, else (c0 c2 c3). */
        weight[0] = 1.0 - fmax(u, v);
        weight[1] = fmax(u - v, 0.0);
        weight[2] = fmin(u, v);
        weight[3] = fmax(v - u, 0.0);
    }
}

void qm_raster_position(const qm_mesh *mesh, qm_quad_reading quads, uint32_t face, const double uv[2],
                        double out[3])
{
    if (mesh->face_count == 0) {
        memcpy(out, mesh->positions + 3 * (size_t)face, 3 * sizeof *out);
        return;
    }
    const uint32_t *corners = mesh->faces + 4 * (size_t)face;
    const double *origin = mesh->positions + 3 * (size_t)corners[0];
    double weight[4];
    weigh(corners, quads, uv, weight);
    /* From the first corner on: the weights do not add up to 1 to the last bit, and coordinates may be large. */
    memcpy(out, origin, 3 * sizeof *out);
    for (int c = 1; c < (corners[3] == QM_NO_INDEX ? 3 : 4); c++) {
        for (int k = 0; k < 3; k++)
            out[k] += weight[c] * (mesh->positions[3 * (size_t)corners[c] + (size_t)k] - origin[k]);
    }
}

/** The direction from one corner to another, divided by the greatest coordinate of the sides. */
static void side(const qm_mesh *mesh, const uint32_t *corners, int from, int to, double weight, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] += weight * (mesh->positions[3 * (size_t)corners[to] + (size_t)k] -
                            mesh->positions[3 * (size_t)corners[from] + (size_t)k]);
}

void qm_raster_normal(const qm_mesh *mesh, qm_quad_reading quads, uint32_t face, const double uv[2],
                      double out[3])
{
    double e[3] = {0.0}, f[3] = {0.0};
    memset(out, 0, 3 * sizeof *out);
    if (mesh->face_count == 0) return;
    const uint32_t *corners = mesh->faces + 4 * (size_t)face;
    if (is_patch(corners, quads)) {
        side(mesh, corners, 0, 1, 1.0 - uv[1], e);
        side(mesh, corners, 3, 2, uv[1], e);
        side(mesh, corners, 0, 3, 1.0 - uv[0], f);
        side(mesh, corners, 1, 2, uv[0], f);
    } else {
        bool is_second = corners[3] != QM_NO_INDEX && uv[1] > uv[0];
        side(mesh, corners, 0, is_second ? 2 : 1, 1.0, e);
        side(mesh, corners, 0, is_second ? 3 : 2, 1.0, f);
    }
    /* Neither product overflows nor vanishes. */
    normalise(e);
    normalise(f);
    cross(e, f, out);
    normalise(out);
}

static void draw_face(qm_raster *r, const qm_mesh *mesh, uint32_t face)
{
    static const double triangle_uv[3][2] = {{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}};
    const uint32_t *corners = mesh->faces + 4 * (size_t)face;
    const bool is_quad = corners[3] != QM_NO_INDEX;
    raster_corner c[4];
    for (int k = 0; k < (is_quad ? 4 : 3); k++) {
        qm_raster_project(&r->view, mesh->positions + 3 * (size_t)corners[k], c[k].at);
        memcpy(c[k].uv, is_quad ? quad_uv[k] : triangle_uv[k], sizeof c[k].uv);
    }
    draw_triangle(r, c, face);
    if (!is_quad) return;
    const raster_corner second[3] = {c[0], c[2], c[3]};
    draw_triangle(r, second, face);
}

/** A patch in cells of two triangles, which are off by at most |c0 - c1 + c2 - c3| / (4 cells^2) from it: a quarter of a
 * pixel, until MAX_CELLS is reached. The parameters give the point of the patch itself. */
static void draw_patch(qm_raster *r, const qm_mesh *mesh, uint32_t face)
{
    const uint32_t *corners = mesh->faces + 4 * (size_t)face;
    double at[4][3], twist = 0.0;
    for (int k = 0; k < 4; k++)
        qm_raster_project(&r->view, mesh->positions + 3 * (size_t)corners[k], at[k]);
    for (int k = 0; k < 3; k++)
        twist = fmax(twist, fabs((at[0][k] - at[1][k]) + (at[2][k] - at[3][k])));
    int cells = (int)fmin(ceil(sqrt(fmax(twist, 1.0))), MAX_CELLS);
    raster_corner row[2][MAX_CELLS + 1];
    for (int j = 0; j <= cells; j++) {
        for (int i = 0; i <= cells; i++) {
            raster_corner *c = &row[j % 2][i];
            c->uv[0] = (double)i / cells;
            c->uv[1] = (double)j / cells;
            double weight[4];
            weigh(corners, QM_QUADS_BILINEAR, c->uv, weight);
            for (int k = 0; k < 3; k++)
                c->at[k] =
                    weight[0] * at[0][k] + weight[1] * at[1][k] + weight[2] * at[2][k] + weight[3] * at[3][k];
        }
        const raster_corner *below = row[(j + 1) % 2], *above = row[j % 2];
        for (int i = 0; j > 0 && i < cells; i++) {
            const raster_corner first[3] = {below[i], below[i + 1], above[i + 1]},
                                second[3] = {below[i], above[i + 1], above[i]};
            draw_triangle(r, first, face);
            draw_triangle(r, second, face);
        }
    }
}

static void draw_points(qm_raster *r, const qm_mesh *mesh)
{
    /* The squares of evenly spread points just cover a quarter of the picture. */
    double share = 0.25 * (double)count_pixels(&r->view) / (double)mesh->vertex_count;
    int reach = (int)fmin(fmax(0.5 * sqrt(share), 1.0), 3.0);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        double at[3];
        qm_raster_project(&r->view, mesh->positions + 3 * i, at);
        if (!(at[0] >= 0.0 && at[0] < r->view.width && at[1] >= 0.0 && at[1] < r->view.height)) continue;
        int x = (int)at[0], y = (int)at[1];
        for (int dy = -reach; dy <= reach; dy++) {
            for (int dx = -reach; dx <= reach; dx++) {
                if (x + dx >= 0 && x + dx < r->view.width && y + dy >= 0 && y + dy < r->view.height)
                    put(r, x + dx, y + dy, at[2], (uint32_t)i, 0.0, 0.0);
            }
        }
    }
}

void qm_raster_draw(qm_raster *raster, const qm_mesh *mesh, qm_quad_reading quads)
{
    if (mesh->face_count == 0) draw_points(raster, mesh);
    for (size_t face = 0; face < mesh->face_count; face++) {
        if (is_patch(mesh->faces + 4 * face, quads))
            draw_patch(raster, mesh, (uint32_t)face);
        else
            draw_face(raster, mesh, (uint32_t)face);
    }
}
