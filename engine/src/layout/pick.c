/**
 * pick.c: positions on a surface under the pixels of a window.
 *
 * qm_pick_view holds the camera as one matrix from the local space of the surface's tree to clip space. On
 * a mesh the result is the first hit of the view ray, which traverses the box tree nearest child first. On
 * a point set the visible points near the cursor are candidates, and the result is interpolated in the
 * smallest triangle of candidates that encloses the cursor in the window. Positions are local up to the last
 * step.
 */
#include "qm/pick.h"

#include <string.h>

#include "bvh/bvh_demand.h"
#include "bvh/bvh_tree.h"
#include "core/vec.h"

#define DISC_RADII 5.0       /* default radius and depth of candidates, in radii of the drawn discs */
#define EDGE_TOLERANCE 1e-12 /* barycentric: triangles are larger by this, so that rays find no gaps */
#define QUADRANT_POINTS 12   /* candidates kept in each quadrant round the cursor, the nearest ones */

/** c = a b, row by row. */
static void multiply(const double a[16], const double b[16], double c[16])
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            c[4 * i + j] = 0.0;
            for (int k = 0; k < 4; k++)
                c[4 * i + j] += a[4 * i + k] * b[4 * k + j];
        }
}

static void transpose(const double a[16], double out[16])
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            out[4 * i + j] = a[4 * j + i];
}

/** Gauss-Jordan elimination with partial pivoting. False if the matrix is singular. */
static bool invert(const double matrix[16], double out[16])
{
    double a[4][8];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 8; j++)
            a[i][j] = j < 4 ? matrix[4 * i + j] : (double)(j - 4 == i);
    for (int k = 0; k < 4; k++) {
        int pivot = k;
        for (int i = k + 1; i < 4; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k])) pivot = i;
        if (!(fabs(a[pivot][k]) > 0.0)) return false;
        for (int j = 0; j < 8; j++) {
            double swap = a[k][j];
            a[k][j] = a[pivot][j];
            a[pivot][j] = swap;
        }
        for (int i = 0; i < 4; i++) {
            double factor = a[i][k] / a[k][k];
            for (int j = 0; j < 8 && i != k; j++)
                a[i][j] -= factor * a[k][j];
        }
    }
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            out[4 * i + j] = a[i][j + 4] / a[i][i];
    return true;
}

/** The product of row k of a matrix and the point (p, 1). */
static double apply_row(const double *matrix, int k, qm_vec p)
{
    const double *row = matrix + 4 * k;
    return row[0] * p.x + row[1] * p.y + row[2] * p.z + row[3];
}

/** Window coordinates to clip coordinates from -1 to 1. */
static double clip_x(const qm_pick_view *view, double x)
{
    return 2.0 * (x - view->viewport[0]) / view->viewport[2] - 1.0;
}
static double clip_y(const qm_pick_view *view, double y)
{
    return 1.0 - 2.0 * (y - view->viewport[1]) / view->viewport[3];
}

static bool all_finite(const double *values, int count)
{
    for (int i = 0; i < count; i++)
        if (!isfinite(values[i])) return false;
    return true;
}

/**
 * Sets the radius and depth within which points are candidates. The default radius is a length at the centre
 * of the surface, in pixels.
 */
static void set_candidate_limits(const qm_pick_options *options, qm_pick_view *view)
{
    double length = DISC_RADII * qm_ref_surface_disc_radius(&view->source->bvh->mesh);
    view->reach = options->depth > 0.0 ? options->depth : length;
    view->radius_px = options->radius_px;
    if (view->radius_px > 0.0) return;
    const qm_vec centre = {0, 0, 0};
    double w = apply_row(view->clip, 3, centre), scale = 0.0;
    for (int k = 0; k < 3; k++)
        scale = fmax(scale, hypot(view->clip[k] * view->viewport[2], view->clip[4 + k] * view->viewport[3]));
    double pixels = w > 0.0 ? 0.5 * scale * (length * view->source->bvh->frame.scale) / w : 0.0;
    view->radius_px = qm_clamp(pixels, 2.0, 200.0);
}

qm_status qm_pick_view_init(qm_context *ctx, const qm_ref_surface *surface, const qm_camera *camera,
                            const qm_pick_options *options, qm_pick_view *out)
{
    QM_ASSERT(ctx && surface && camera && options && out);
    if (!all_finite(camera->view, 16) || !all_finite(camera->projection, 16) ||
        !all_finite(camera->viewport, 4))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the camera has a number that is not finite");
    if (!(camera->viewport[2] > 0.0 && camera->viewport[3] > 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the viewport has no size");
    if (!(options->radius_px >= 0.0) || !(options->depth >= 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the radius and depth of candidates are 0 or more");
    *out = (qm_pick_view){.source = surface};
    memcpy(out->viewport, camera->viewport, sizeof out->viewport);
    const qm_frame *frame = &surface->bvh->frame;
    double s = frame->inverse_scale;
    const double world[16] = {s, 0, 0, frame->origin.x, 0, s, 0, frame->origin.y,
                              0, 0, s, frame->origin.z, 0, 0, 0, 1};
    double view[16], projection[16], eye[16];
    transpose(camera->view, view);
    transpose(camera->projection, projection);
    multiply(view, world, eye);
    multiply(projection, eye, out->clip);
    for (int k = 0; k < 4; k++)
        out->depth[k] = -eye[8 + k];
    if (!invert(out->clip, out->inverse) || !all_finite(out->inverse, 16))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the camera's matrices have no inverse");
    set_candidate_limits(options, out);
    return QM_OK;
}

/** The point at clip coordinates, after the perspective division. */
static qm_vec unproject(const qm_pick_view *view, double x, double y, double z)
{
    const qm_vec at = {x, y, z};
    double w = apply_row(view->inverse, 3, at);
    return qm_vec_scale(1.0 / w, (qm_vec){apply_row(view->inverse, 0, at), apply_row(view->inverse, 1, at),
                                          apply_row(view->inverse, 2, at)});
}

/** The view ray: t is 0 on the near plane and 1 on the far plane. */
typedef struct ray {
    const qm_bvh *bvh;
    qm_vec origin, direction, inverse;
    double t; /* of the first hit so far */
} ray;

/** Source: T. Moeller, B. Trumbore, Fast, minimum storage ray-triangle intersection, 1997. */
static void hit_pack(ray *r, uint32_t pack)
{
    for (uint32_t lane = 0; lane < r->bvh->lanes[pack].lane_count; lane++) {
        qm_vec corner[3];
        qm_bvh_load_triangle(r->bvh, pack, lane, corner);
        qm_vec e = qm_vec_sub(corner[1], corner[0]), f = qm_vec_sub(corner[2], corner[0]);
        qm_vec h = qm_vec_cross(r->direction, f);
        double det = qm_vec_dot(e, h);
        if (det == 0.0) continue;
        qm_vec s = qm_vec_sub(r->origin, corner[0]), q = qm_vec_cross(s, e);
        double u = qm_vec_dot(s, h) / det, v = qm_vec_dot(r->direction, q) / det, t = qm_vec_dot(f, q) / det;
        bool is_inside = u >= -EDGE_TOLERANCE && v >= -EDGE_TOLERANCE && u + v <= 1.0 + EDGE_TOLERANCE;
        if (is_inside && t >= 0.0 && t < r->t) r->t = t;
    }
}

/** The parameter at which the ray enters a box, or INFINITY if it misses the box or hits nearer before. */
static double enter_box(const ray *r, const qm_box_node *node, int child)
{
    const double origin[3] = {r->origin.x, r->origin.y, r->origin.z};
    const double inverse[3] = {r->inverse.x, r->inverse.y, r->inverse.z};
    double enter = 0.0, leave = r->t;
    for (int k = 0; k < 3; k++) {
        double a = ((double)node->low[k][child] - origin[k]) * inverse[k];
        double b = ((double)node->high[k][child] - origin[k]) * inverse[k];
        /* 0 times infinity is NaN, for a ray in the plane of a side; fmin and fmax ignore it. */
        enter = fmax(enter, fmin(a, b));
        leave = fmin(leave, fmax(a, b));
    }
    return enter <= leave ? enter : INFINITY;
}

/** Visits the children of a node, those first that the ray enters first. */
static void hit_node(ray *r, int level, size_t node)
{
    QM_ASSERT(level >= 1);
    double enter[QM_PACK_LANES];
    int order[QM_PACK_LANES], count = 0, child_count = qm_box_tree_child_count(&r->bvh->boxes, level, node);
    for (int i = 0; i < child_count; i++) {
        enter[i] = enter_box(r, &r->bvh->boxes.groups[level][node], i);
        if (enter[i] == INFINITY) continue;
        int slot = count++;
        for (; slot > 0 && enter[order[slot - 1]] > enter[i]; slot--)
            order[slot] = order[slot - 1];
        order[slot] = i;
    }
    for (int i = 0; i < count; i++) {
        if (enter[order[i]] > r->t) return;
        size_t child = 8 * node + (size_t)order[i];
        if (level > 1)
            hit_node(r, level - 1, child);
        else
            hit_pack(r, (uint32_t)child);
    }
}

/** Picks on a mesh: the first hit of the view ray. False if there is none. */
static bool pick_mesh(const qm_pick_view *view, const double window[2], qm_vec *out)
{
    double x = clip_x(view, window[0]), y = clip_y(view, window[1]);
    ray r = {.bvh = view->source->bvh, .origin = unproject(view, x, y, -1.0), .t = INFINITY};
    r.direction = qm_vec_sub(unproject(view, x, y, 1.0), r.origin);
    r.inverse = (qm_vec){1.0 / r.direction.x, 1.0 / r.direction.y, 1.0 / r.direction.z};
    hit_node(&r, r.bvh->boxes.level_count, 0);
    if (!(r.t < INFINITY)) return false;
    *out = qm_vec_axpy(r.origin, r.t, r.direction);
    return true;
}

enum { CANDIDATES_MAX = 4 * QUADRANT_POINTS };

/** A point near the cursor. */
typedef struct candidate {
    qm_vec at;
    double x, y, depth; /* offset from the cursor in pixels; distance from the eye's plane */
    uint32_t index;
} candidate;

typedef struct search {
    qm_context *ctx;
    const qm_pick_view *view;
    const qm_bvh *bvh;
    double x, y;        /* the cursor in clip coordinates */
    double plane[5][4]; /* of the view frustum of the square round the cursor: not negative inside */
    candidate *found;
    size_t count, capacity;
    qm_status status;
} search;

/** False if the whole box lies outside one plane of the frustum. */
static bool intersects_box(const search *s, const qm_box_node *node, int child)
{
    for (int i = 0; i < 5; i++) {
        double max_value = s->plane[i][3];
        for (int k = 0; k < 3; k++) {
            double n = s->plane[i][k];
            max_value += n * (double)(n > 0.0 ? node->high[k][child] : node->low[k][child]);
        }
        if (max_value < 0.0) return false;
    }
    return true;
}

/** Adds a point as a candidate if it is in front of the near plane and within the radius of the cursor. */
static void test_point(search *s, uint32_t index, qm_vec p)
{
    double w = apply_row(s->view->clip, 3, p);
    if (!(w > 0.0) || apply_row(s->view->clip, 2, p) < -w) return;
    candidate c = {.at = p, .index = index};
    c.x = 0.5 * s->view->viewport[2] * (apply_row(s->view->clip, 0, p) / w - s->x);
    c.y = 0.5 * s->view->viewport[3] * (apply_row(s->view->clip, 1, p) / w - s->y);
    if (c.x * c.x + c.y * c.y > s->view->radius_px * s->view->radius_px) return;
    c.depth = apply_row(s->view->depth, 0, p);
    if (s->count == s->capacity) {
        size_t capacity = s->capacity ? 2 * s->capacity : 256;
        candidate *larger = qm_context_resize(s->ctx, s->found, s->capacity, capacity, sizeof *larger);
        if (!larger) {
            s->status = qm_context_fail(s->ctx, QM_E_NO_MEMORY, "out of memory for the points of a pick");
            return;
        }
        s->found = larger;
        s->capacity = capacity;
    }
    QM_ASSERT(s->count < s->capacity);
    s->found[s->count++] = c;
}

static void visit_node(search *s, int level, size_t node)
{
    QM_ASSERT(level >= 1);
    int child_count = qm_box_tree_child_count(&s->bvh->boxes, level, node);
    for (int i = 0; i < child_count && s->status == QM_OK; i++) {
        if (!intersects_box(s, &s->bvh->boxes.groups[level][node], i)) continue;
        size_t child = 8 * node + (size_t)i;
        if (level > 1) {
            visit_node(s, level - 1, child);
            continue;
        }
        const qm_pack_lanes *lanes = &s->bvh->lanes[child];
        qm_pack scratch;
        const qm_pack *frames = qm_bvh_pack(s->bvh, child, &scratch);
        for (int lane = 0; lane < lanes->lane_count; lane++)
            test_point(s, lanes->face[lane],
                       (qm_vec){frames->row[QM_PACK_OX][lane], frames->row[QM_PACK_OY][lane],
                                frames->row[QM_PACK_OZ][lane]});
    }
}

static double cursor_distance2(const candidate *c)
{
    return c->x * c->x + c->y * c->y;
}

static bool is_nearer(const candidate *a, const candidate *b)
{
    double da = cursor_distance2(a), db = cursor_distance2(b);
    return da < db || (da == db && a->index < b->index);
}

/** Keeps the nearest visible candidates of each quadrant, and returns their number. */
static int keep_visible(const search *s, candidate kept[CANDIDATES_MAX])
{
    double min_depth = INFINITY;
    int count[4] = {0}, total = 0;
    candidate list[4][QUADRANT_POINTS];
    for (size_t i = 0; i < s->count; i++)
        min_depth = fmin(min_depth, s->found[i].depth);
    for (size_t i = 0; i < s->count; i++) {
        const candidate *c = &s->found[i];
        if (c->depth > min_depth + s->view->reach) continue;
        int quadrant = (c->x < 0.0) + 2 * (c->y < 0.0), slot = count[quadrant];
        candidate *own = list[quadrant];
        if (slot == QUADRANT_POINTS) {
            if (!is_nearer(c, &own[--slot])) continue;
        } else {
            count[quadrant]++;
        }
        for (; slot > 0 && is_nearer(c, &own[slot - 1]); slot--)
            own[slot] = own[slot - 1];
        own[slot] = *c;
    }
    for (int quadrant = 0; quadrant < 4; quadrant++)
        for (int i = 0; i < count[quadrant]; i++)
            kept[total++] = list[quadrant][i];
    QM_ASSERT(total <= CANDIDATES_MAX);
    return total;
}

/** Barycentric coordinates of the cursor in the picture of a triangle. False if it lies outside. */
static bool find_weights(const candidate *a, const candidate *b, const candidate *c, double weight[3])
{
    weight[0] = b->x * c->y - c->x * b->y;
    weight[1] = c->x * a->y - a->x * c->y;
    weight[2] = a->x * b->y - b->x * a->y;
    double sum = weight[0] + weight[1] + weight[2];
    if (sum == 0.0) return false;
    for (int k = 0; k < 3; k++) {
        weight[k] /= sum;
        if (!(weight[k] >= 0.0)) return false;
    }
    return true;
}

/**
 * Interpolates in the enclosing triangle of the smallest perimeter. False if no triangle encloses the cursor.
 */
static bool interpolate(const candidate *kept, int count, qm_vec *out)
{
    double best = INFINITY, weight[3];
    for (int a = 0; a < count; a++) {
        for (int b = a + 1; b < count; b++) {
            double edge = qm_vec_distance(kept[a].at, kept[b].at);
            if (2.0 * edge >= best) continue;
            for (int c = b + 1; c < count; c++) {
                if (!find_weights(&kept[a], &kept[b], &kept[c], weight)) continue;
                double perimeter =
                    edge + qm_vec_distance(kept[b].at, kept[c].at) + qm_vec_distance(kept[c].at, kept[a].at);
                if (perimeter >= best) continue;
                best = perimeter;
                *out = qm_vec_axpy(qm_vec_axpy(qm_vec_scale(weight[0], kept[a].at), weight[1], kept[b].at),
                                   weight[2], kept[c].at);
            }
        }
    }
    return best < INFINITY;
}

/** Picks on a point set. */
static qm_status pick_cloud(qm_context *ctx, const qm_pick_view *view, const double window[2], qm_vec *out,
                            bool *found)
{
    search s = {.ctx = ctx,
                .view = view,
                .bvh = view->source->bvh,
                .x = clip_x(view, window[0]),
                .y = clip_y(view, window[1])};
    const double *clip = view->clip;
    double rx = 2.0 * view->radius_px / view->viewport[2], ry = 2.0 * view->radius_px / view->viewport[3];
    for (int k = 0; k < 4; k++) {
        s.plane[0][k] = clip[k] - (s.x - rx) * clip[12 + k];
        s.plane[1][k] = (s.x + rx) * clip[12 + k] - clip[k];
        s.plane[2][k] = clip[4 + k] - (s.y - ry) * clip[12 + k];
        s.plane[3][k] = (s.y + ry) * clip[12 + k] - clip[4 + k];
        s.plane[4][k] = clip[8 + k] + clip[12 + k];
    }
    visit_node(&s, s.bvh->boxes.level_count, 0);
    candidate kept[CANDIDATES_MAX];
    int count = s.status == QM_OK ? keep_visible(&s, kept) : 0;
    *found = count > 0;
    if (count > 0 && !interpolate(kept, count, out)) { /* the cursor at the depth of the nearest candidate */
        const candidate *nearest = &kept[0];
        for (int i = 1; i < count; i++)
            if (is_nearer(&kept[i], nearest)) nearest = &kept[i];
        double z = apply_row(clip, 2, nearest->at) / apply_row(clip, 3, nearest->at);
        *out = unproject(view, s.x, s.y, z);
    }
    qm_context_free(ctx, s.found, s.capacity, sizeof *s.found);
    return s.status;
}

qm_status qm_pick_point(qm_context *ctx, const qm_pick_view *view, const double window[2], double position[3],
                        bool *found)
{
    QM_ASSERT(ctx && view && window && position && found);
    *found = false;
    if (!isfinite(window[0]) || !isfinite(window[1])) return QM_OK;
    qm_vec at;
    if (!view->source->is_cloud) {
        *found = pick_mesh(view, window, &at);
    } else {
        qm_status status = pick_cloud(ctx, view, window, &at, found);
        if (status != QM_OK) return status;
    }
    if (*found) qm_vec_store(position, qm_frame_world(&view->source->bvh->frame, at));
    *found = *found && all_finite(position, 3);
    return QM_OK;
}

qm_status qm_pick_stroke(qm_context *ctx, const qm_pick_view *view, const double *window, size_t point_count,
                         double *positions, size_t *count, size_t *missed)
{
    QM_ASSERT(ctx && view && (window || point_count == 0) && count && missed);
    *count = *missed = 0;
    for (size_t i = 0; i < point_count; i++) {
        double at[3];
        bool found;
        qm_status status = qm_pick_point(ctx, view, window + 2 * i, at, &found);
        if (status != QM_OK) return status;
        if (!found) {
            ++*missed;
        } else if (*count == 0 || memcmp(positions + 3 * (*count - 1), at, sizeof at) != 0) {
            memcpy(positions + 3 * (*count)++, at, sizeof at);
        }
    }
    return QM_OK;
}

bool qm_pick_plane(const qm_camera *camera, const double a[3], const double b[3], double normal[3])
{
    double view[16], projection[16], clip[16], inverse[16];
    transpose(camera->view, view);
    transpose(camera->projection, projection);
    multiply(projection, view, clip);
    if (!all_finite(clip, 16) || !invert(clip, inverse)) return false;
    qm_vec middle = qm_vec_mix(qm_vec_load(a), qm_vec_load(b), 0.5);
    double w = apply_row(clip, 3, middle), end[2][4];
    for (int k = 0; k < 2; k++) {
        /* The places before and behind the middle in the window, on the near and on the far plane. */
        const qm_vec at = {apply_row(clip, 0, middle) / w, apply_row(clip, 1, middle) / w,
                           k == 0 ? -1.0 : 1.0};
        for (int i = 0; i < 4; i++)
            end[k][i] = apply_row(inverse, i, at);
    }
    qm_vec near = qm_vec_scale(1.0 / end[0][3], qm_vec_load(end[0])),
           far = qm_vec_scale(1.0 / end[1][3], qm_vec_load(end[1]));
    qm_vec across = qm_vec_cross(qm_vec_sub(qm_vec_load(b), qm_vec_load(a)), qm_vec_sub(far, near));
    double length = qm_vec_norm(across);
    if (!(length > 0.0) || !isfinite(length)) return false;
    qm_vec_store(normal, qm_vec_scale(1.0 / length, across));
    return true;
}
