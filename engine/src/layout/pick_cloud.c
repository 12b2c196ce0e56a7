#include "bvh/bvh_demand.h"
#include "pick_work.h"

#define QUADRANT_POINTS 12 /* candidates nearest to the cursor that are kept in each quadrant round it */

enum { MOST = 4 * QUADRANT_POINTS };

/** A point near the cursor: where it is, and where it appears, from the cursor in pixels. */
typedef struct candidate {
    qm_vec at;
    double x, y, depth;
    uint32_t index;
} candidate;

typedef struct search {
    qm_context *ctx;
    const qm_view *view;
    const qm_bvh *bvh;
    double x, y;        /* of the cursor, in clip coordinates */
    double plane[5][4]; /* what the window's square round the cursor sees lies on the plus side of all */
    candidate *found;
    size_t count, capacity;
    qm_status status;
} search;

static void set_planes(search *s)
{
    const double *clip = s->view->clip;
    double rx = 2.0 * s->view->radius_px / s->view->viewport[2];
    double ry = 2.0 * s->view->radius_px / s->view->viewport[3];
    for (int k = 0; k < 4; k++) {
        s->plane[0][k] = clip[k] - (s->x - rx) * clip[12 + k];
        s->plane[1][k] = (s->x + rx) * clip[12 + k] - clip[k];
        s->plane[2][k] = clip[4 + k] - (s->y - ry) * clip[12 + k];
        s->plane[3][k] = (s->y + ry) * clip[12 + k] - clip[4 + k];
        s->plane[4][k] = clip[8 + k] + clip[12 + k];
    }
}

/** False when a box lies beyond one of the planes. */
static bool sees_box(const search *s, const qm_box_node *group, int member)
{
    for (int i = 0; i < 5; i++) {
        double most = s->plane[i][3];
        for (int k = 0; k < 3; k++) {
            double n = s->plane[i][k];
            most += n * (double)(n > 0.0 ? group->high[k][member] : group->low[k][member]);
        }
        if (most < 0.0) return false;
    }
    return true;
}

static void add(search *s, const candidate *found)
{
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
    s->found[s->count++] = *found;
}

static void look_at_point(search *s, uint32_t index, qm_vec p)
{
    double w = qm_view_row(s->view->clip, 3, p);
    if (!(w > 0.0) || qm_view_row(s->view->clip, 2, p) < -w) return;
    candidate c = {.at = p, .index = index};
    c.x = 0.5 * s->view->viewport[2] * (qm_view_row(s->view->clip, 0, p) / w - s->x);
    c.y = 0.5 * s->view->viewport[3] * (qm_view_row(s->view->clip, 1, p) / w - s->y);
    if (c.x * c.x + c.y * c.y > s->view->radius_px * s->view->radius_px) return;
    c.depth = qm_view_row(s->view->depth, 0, p);
    add(s, &c);
}

static void look_at_group(search *s, int level, size_t group)
{
    int members = qm_box_tree_child_count(&s->bvh->boxes, level, group);
    for (int i = 0; i < members && s->status == QM_OK; i++) {
        if (!sees_box(s, &s->bvh->boxes.groups[level][group], i)) continue;
        size_t member = 8 * group + (size_t)i;
        if (level > 1) {
            look_at_group(s, level - 1, member);
            continue;
        }
        const qm_pack_lanes *lanes = &s->bvh->lanes[member];
        qm_pack spare;
        const qm_pack *rows = qm_bvh_rows(s->bvh, member, &spare);
        for (int lane = 0; lane < lanes->lane_count; lane++)
            look_at_point(
                s, lanes->face[lane],
                (qm_vec){rows->row[QM_ROW_OX][lane], rows->row[QM_ROW_OY][lane], rows->row[QM_ROW_OZ][lane]});
    }
}

static double from_cursor2(const candidate *c)
{
    return c->x * c->x + c->y * c->y;
}

static bool comes_before(const candidate *a, const candidate *b)
{
    double da = from_cursor2(a), db = from_cursor2(b);
    return da < db || (da == db && a->index < b->index);
}

/** Keeps those that the viewer sees, the nearest few of each quadrant; returns how many. */
static int keep_visible(const search *s, candidate kept[MOST])
{
    double least = INFINITY;
    int count[4] = {0}, total = 0;
    candidate list[4][QUADRANT_POINTS];
    for (size_t i = 0; i < s->count; i++)
        least = fmin(least, s->found[i].depth);
    for (size_t i = 0; i < s->count; i++) {
        const candidate *c = &s->found[i];
        if (c->depth > least + s->view->reach) continue;
        int quadrant = (c->x < 0.0) + 2 * (c->y < 0.0), place = count[quadrant];
        candidate *own = list[quadrant];
        if (place == QUADRANT_POINTS) {
            if (!comes_before(c, &own[--place])) continue;
        } else {
            count[quadrant]++;
        }
        for (; place > 0 && comes_before(c, &own[place - 1]); place--)
            own[place] = own[place - 1];
        own[place] = *c;
    }
    for (int quadrant = 0; quadrant < 4; quadrant++)
        for (int i = 0; i < count[quadrant]; i++)
            kept[total++] = list[quadrant][i];
    return total;
}

/** Weights of the cursor in a triangle as it appears; false when it lies outside. */
static bool enclose(const candidate *a, const candidate *b, const candidate *c, double weight[3])
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

static bool interpolate(const candidate *kept, int count, qm_vec *out)
{
    double best = INFINITY, weight[3];
    for (int a = 0; a < count; a++) {
        for (int b = a + 1; b < count; b++) {
            double edge = qm_vec_distance(kept[a].at, kept[b].at);
            if (2.0 * edge >= best) continue;
            for (int c = b + 1; c < count; c++) {
                if (!enclose(&kept[a], &kept[b], &kept[c], weight)) continue;
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

/** The cursor at the depth of the candidate nearest to it. */
static qm_vec at_depth_of_nearest(const search *s, const candidate *kept, int count)
{
    const candidate *nearest = &kept[0];
    for (int i = 1; i < count; i++)
        if (comes_before(&kept[i], nearest)) nearest = &kept[i];
    double z = qm_view_row(s->view->clip, 2, nearest->at) / qm_view_row(s->view->clip, 3, nearest->at);
    return qm_view_unproject(s->view, s->x, s->y, z);
}

qm_status qm_pick_cloud(qm_context *ctx, const qm_view *view, const double window[2], qm_vec *out,
                        bool *found)
{
    search s = {.ctx = ctx,
                .view = view,
                .bvh = view->source->bvh,
                .x = qm_view_clip_x(view, window[0]),
                .y = qm_view_clip_y(view, window[1])};
    set_planes(&s);
    look_at_group(&s, s.bvh->boxes.level_count, 0);
    candidate kept[MOST];
    int count = s.status == QM_OK ? keep_visible(&s, kept) : 0;
    *found = count > 0;
    if (count > 0 && !interpolate(kept, count, out)) *out = at_depth_of_nearest(&s, kept, count);
    qm_context_free(ctx, s.found, s.capacity, sizeof *s.found);
    return s.status;
}
