/**
 * quads_map.c: the surface laid onto the plane of the grid, face by face, before integers are chosen.
 *
 * Each face has a frame: the first axis is its cross, the second lies a quarter turn to its left. Frames of neighbours differ by
 * quarter turns: a pair s of face f is turned[h] quarter turns of s in the face across h. An edge divided by the side of a quad
 * is its step. Steps sum up to 0 round a face, but those of both faces of an edge differ where the crosses bend, and
 * their means no longer sum up to 0: where crosses come apart there are more rows at one end than at the other. Grids that follow
 * the edges then meet in hundreds of rows that end, and the flow (quads_steps.c) joins such ends by paths of its own.
 *
 * So the steps t change as little as possible to steps d that sum up to 0 in each face, agree across each edge, and
 * do not cross a feature: they minimise the sum of |d - t|^2 / compliance over the edges. The compliance of an edge is the square
 * of its length. The multipliers of the conditions, a pair for each face, solve a Laplace equation on the graph of faces, with
 * quarter turns along its links; conjugate gradients find them. A second pass makes edges stiffer whose steps have
 * changed much: a wide stretch of rows becomes a little narrower, instead of a few rows that fold where they end.
 *
 * Where two features run side by side less than a quad apart, round the rim of a plate, steps from one to the other would be
 * rounded to 0, and one wall would end up on the other. They are given a step of 1 (a row of narrow quads), which stays.
 *
 * Source: D. Bommes, H. Zimmer, L. Kobbelt, Mixed-integer quadrangulation, 2009, section 5 (the energy, and quarter turns between
 * charts); here the unknowns are steps of edges instead of coordinates of vertices, so that the surface need not be cut.
 */
#include <string.h>

#include "quads/quads_internal.h"

#define LEAST_COMPLIANCE 0.05
#define MOST_COMPLIANCE 4.0
#define FAR_OFF 0.6 /* change of a step, as a share of its length, that leaves half of the compliance */
#define FIRST_PASSES 2
#define TOLERANCE 1e-3 /* of the sums round faces: the norm of those that are left, as a share of the first */
#define ROUNDING 0x1p-22 /* of a step: sums of this are left as they are */
#define MOST_ITERATIONS 1000
#define FAILED 0.5      /* of these sums, that are left after most iterations */
#define MOST_CHANGE 1.0 /* of a step, along an axis */
#define POLL_ITERATIONS 16
#define STRIP_COSINE 0.8   /* of the angle between features that run side by side, at least */
#define WALL_COSINE (-0.8) /* between the walls that they are the rims of, at most: else it is a chamfer */

/*
 * Frames.
 */

static int quarters_between(double from, double to)
{
    return (int)lrint((to - from) / (90.0 * QM_DEGREE)) & 3;
}

static void find_turns(const qm_trimesh *m, const qm_vec *cross, const qm_quads_map *map)
{
    double scale = 1.0 / map->unit;
    for (uint32_t f = 0; f < m->face_count; f++) {
        qm_vec normal = qm_trimesh_normal(m, f), q = cross[f];
        double area = qm_vec_norm(normal);
        qm_vec other = qm_vec_cross(area > 0.0 ? qm_vec_scale(1.0 / area, normal) : (qm_vec){0, 0, 1}, q);
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            qm_vec edge = qm_trimesh_edge(m, h);
            map->edge[h][0] = (float)(scale * qm_vec_dot(edge, q));
            map->edge[h][1] = (float)(scale * qm_vec_dot(edge, other));
        }
    }
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        map->turned[h] = 0;
        if (t == QM_NO_INDEX) continue;
        double here = atan2(map->edge[h][1], map->edge[h][0]),
               there = atan2(-map->edge[t][1], -map->edge[t][0]);
        if (t > h)
            map->turned[h] = (uint8_t)quarters_between(here, there);
        else
            map->turned[h] = (uint8_t)((4 - map->turned[t]) & 3);
    }
}

/*
 * Strips.
 */

/** Sets the step of a half-edge and of its twin that cross a strip along an axis of the face, in a direction of 1 or -1. */
static void mark_across(const qm_trimesh *m, const qm_quads_map *map, uint32_t h, int axis, int direction)
{
    uint32_t t = m->twin[h];
    double back[2] = {0, 0};
    back[axis] = -direction;
    map->step[h][axis] = (float)direction;
    map->is_across[h] |= (uint8_t)(1 << axis);
    if (t == QM_NO_INDEX) return;
    qm_quads_turn_pair(back, map->turned[h]);
    int twin_axis = back[0] == 0;
    map->step[t][twin_axis] = (float)back[twin_axis];
    map->is_across[t] |= (uint8_t)(1 << twin_axis);
}

/** True if a feature at a vertex runs along the half-edge of another, and the walls beyond both look apart, or both are boundaries. */
static bool is_opposite(const qm_trimesh *m, uint32_t half, uint32_t vertex)
{
    qm_vec along = qm_trimesh_edge(m, half), strip = qm_trimesh_normal(m, half / 3);
    bool is_boundary = m->twin[half] == QM_NO_INDEX;
    qm_vec wall = is_boundary ? strip : qm_trimesh_normal(m, m->twin[half] / 3);
    uint32_t first = qm_trimesh_first(m, vertex), h = first;
    do {
        uint32_t back = qm_trimesh_prev(h);
        const uint32_t side[2] = {h, back};
        for (int k = 0; k < 2; k++) {
            uint32_t t = m->twin[side[k]];
            qm_vec edge = qm_trimesh_edge(m, side[k]);
            if (!m->is_feature[side[k]] || (t == QM_NO_INDEX) != is_boundary ||
                !(fabs(qm_vec_dot(edge, along)) > STRIP_COSINE * qm_vec_norm(along) * qm_vec_norm(edge)))
                continue;
            if (is_boundary) return true;
            /* the strip lies on one side of it */
            qm_vec a = qm_trimesh_normal(m, side[k] / 3), b = qm_trimesh_normal(m, t / 3);
            double scale_a = qm_vec_norm(a), scale_b = qm_vec_norm(b);
            qm_vec beyond = qm_vec_dot(a, strip) * scale_b > qm_vec_dot(b, strip) * scale_a ? b : a;
            if (qm_vec_dot(beyond, wall) < WALL_COSINE * qm_vec_norm(beyond) * qm_vec_norm(wall)) return true;
        }
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return false;
}

/** Finds the strips: faces between a feature and a vertex of another that runs along it, less than a quad away. */
static void find_strips(const qm_trimesh *m, const qm_quads_map *map)
{
    memset(map->is_across, 0, 3 * m->face_count);
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        if (!m->is_feature[h]) continue;
        int along = qm_quads_feature_axis(map, h), axis = 1 - along;
        uint32_t next = qm_trimesh_next(h), back = qm_trimesh_prev(h);
        int left = (map->edge[h][along] > 0.0F) == (along == 0) ? 1 : -1;
        /* a neighbour may have made it 1 */
        if (!((float)left * map->step[next][axis] <= 1.0F) || !is_opposite(m, h, m->from[back])) continue;
        mark_across(m, map, next, axis, left);
        mark_across(m, map, back, axis, -left);
    }
}

/*
 * Closing.
 */

typedef double pair[2];

/** The vectors of conjugate gradients, a pair for each face, and of each half-edge the step wanted and its compliance. */
typedef struct closing {
    size_t face_count;
    pair *residual, *direction, *image, *inverse; /* of the diagonal */
    pair *compliance;
    float (*wanted)[2];
} closing;

/** What a pair of each face means for the step of a half-edge: that of its face less that of the face across. */
static void difference(const qm_trimesh *m, const qm_quads_map *map, const pair *x, uint32_t h, pair out)
{
    uint32_t t = m->twin[h];
    out[0] = x[h / 3][0], out[1] = x[h / 3][1];
    if (t == QM_NO_INDEX) return;
    pair other = {x[t / 3][0], x[t / 3][1]};
    qm_quads_turn_pair(other, map->turned[t]);
    out[0] -= other[0], out[1] -= other[1];
}

/** The Laplacian: the sums round faces of steps that change by their compliance times the difference of x. */
static void apply_laplacian(const qm_trimesh *m, const qm_quads_map *map, const pair *compliance,
                            const pair *x, pair *out)
{
    for (uint32_t f = 0; f < m->face_count; f++) {
        pair sum = {0.0, 0.0};
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            pair d;
            difference(m, map, x, h, d);
            sum[0] += compliance[h][0] * d[0];
            sum[1] += compliance[h][1] * d[1];
        }
        out[f][0] = sum[0], out[f][1] = sum[1];
    }
}

/** Makes the steps of both half-edges of an edge their mean. That of a feature is 0 across it. */
static void agree(const qm_trimesh *m, const qm_quads_map *map)
{
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        pair mean = {map->step[h][0], map->step[h][1]};
        if (t != QM_NO_INDEX) {
            if (t < h) continue;
            pair back = {-map->step[t][0], -map->step[t][1]};
            qm_quads_turn_pair(back, map->turned[t]);
            mean[0] = 0.5 * (mean[0] + back[0]), mean[1] = 0.5 * (mean[1] + back[1]);
        }
        if (m->is_feature[h]) mean[1 - qm_quads_feature_axis(map, h)] = 0.0;
        map->step[h][0] = (float)mean[0], map->step[h][1] = (float)mean[1];
        if (t == QM_NO_INDEX) continue;
        qm_quads_turn_pair(mean, map->turned[h]);
        map->step[t][0] = (float)-mean[0], map->step[t][1] = (float)-mean[1];
    }
}

static double length2(const float step[2])
{
    return (double)step[0] * (double)step[0] + (double)step[1] * (double)step[1];
}

/** Leaves steps that have changed much less of their compliance. */
static void stiffen(const closing *c, const qm_quads_map *map)
{
    for (size_t h = 0; h < 3 * c->face_count; h++) {
        const float change[2] = {map->step[h][0] - c->wanted[h][0], map->step[h][1] - c->wanted[h][1]};
        double scale = FAR_OFF * FAR_OFF * qm_max(length2(c->wanted[h]), LEAST_COMPLIANCE);
        map->share[h] = (float)(1.0 / (1.0 + length2(change) / scale));
    }
}

static void set_compliance(const qm_trimesh *m, const qm_quads_map *map, const closing *c)
{
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        if (t != QM_NO_INDEX && t < h) continue;
        double compliance =
            map->share[h] * qm_min(qm_max(length2(c->wanted[h]), LEAST_COMPLIANCE), MOST_COMPLIANCE);
        for (int axis = 0; axis < 2; axis++)
            c->compliance[h][axis] = map->is_across[h] >> axis & 1 ? 0.0 : compliance;
        if (m->is_feature[h]) c->compliance[h][1 - qm_quads_feature_axis(map, h)] = 0.0;
        if (t == QM_NO_INDEX) continue;
        int odd = map->turned[h] & 1;
        c->compliance[t][odd] = c->compliance[h][0];
        c->compliance[t][1 - odd] = c->compliance[h][1];
    }
}

/** Solves for the multipliers by conjugate gradients, with the diagonal as preconditioner, and changes the steps. */
static qm_status solve(qm_context *ctx, const qm_trimesh *m, const qm_quads_map *map, const closing *c)
{
    double first = 0.0, left = 0.0, slope = 0.0;
    apply_laplacian(m, map, (const pair *)c->compliance, (const pair *)map->multiplier, c->image);
    for (uint32_t f = 0; f < m->face_count; f++)
        for (int axis = 0; axis < 2; axis++) {
            double sum = 0.0, diagonal = 0.0;
            for (uint32_t h = 3 * f; h < 3 * f + 3; h++)
                sum += (double)c->wanted[h][axis], diagonal += c->compliance[h][axis];
            double r = -sum - c->image[f][axis];
            c->inverse[f][axis] = diagonal > 0.0 ? 1.0 / diagonal : 0.0;
            c->residual[f][axis] = r;
            c->direction[f][axis] = c->inverse[f][axis] * r;
            slope += r * c->direction[f][axis];
            first += sum * sum;
            left += r * r;
        }
    double enough = qm_max(TOLERANCE * TOLERANCE * first, ROUNDING * ROUNDING * (double)(3 * m->face_count));
    for (int k = 0; k < MOST_ITERATIONS && left > enough; k++) {
        if (k % POLL_ITERATIONS == 0 && qm_context_canceled(ctx)) return QM_E_CANCELED;
        apply_laplacian(m, map, (const pair *)c->compliance, (const pair *)c->direction, c->image);
        double bend = 0.0, next = 0.0;
        for (uint32_t f = 0; f < m->face_count; f++)
            bend += c->direction[f][0] * c->image[f][0] + c->direction[f][1] * c->image[f][1];
        if (!(bend > 0.0)) break;
        double length = slope / bend;
        left = 0.0;
        for (uint32_t f = 0; f < m->face_count; f++)
            for (int axis = 0; axis < 2; axis++) {
                double r = c->residual[f][axis] - length * c->image[f][axis];
                map->multiplier[f][axis] += length * c->direction[f][axis];
                c->residual[f][axis] = r;
                next += r * r * c->inverse[f][axis];
                left += r * r;
            }
        double turn = next / slope;
        slope = next;
        for (uint32_t f = 0; f < m->face_count; f++)
            for (int axis = 0; axis < 2; axis++)
                c->direction[f][axis] =
                    c->inverse[f][axis] * c->residual[f][axis] + turn * c->direction[f][axis];
    }
    /* features that no steps go with: the flow does what it can */
    if (!(left <= qm_max(FAILED * FAILED * first, enough)))
        memset(map->multiplier, 0, m->face_count * sizeof *map->multiplier);
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        pair d;
        difference(m, map, (const pair *)map->multiplier, h, d);
        for (int axis = 0; axis < 2; axis++) {
            double change = qm_min(qm_max(c->compliance[h][axis] * d[axis], -MOST_CHANGE), MOST_CHANGE);
            map->step[h][axis] = (float)((double)c->wanted[h][axis] + change);
        }
    }
    return QM_OK;
}

qm_status qm_quads_map_close(qm_context *ctx, const qm_trimesh *m, qm_quads_map *map, double size)
{
    size_t faces = m->face_count, halves = 3 * faces;
    for (size_t h = 0; h < halves; h++)
        for (int axis = 0; axis < 2; axis++)
            map->step[h][axis] = (float)(map->unit / size * (double)map->edge[h][axis]);
    find_strips(m, map);
    agree(m, map);
    pair *vectors = qm_context_alloc(ctx, 4 * faces, sizeof *vectors);
    closing c = {.face_count = faces,
                 .compliance = qm_context_alloc(ctx, halves, sizeof *c.compliance),
                 .wanted = qm_context_alloc(ctx, halves, sizeof *c.wanted)};
    qm_status status = vectors && c.compliance && c.wanted ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        c.residual = vectors, c.direction = vectors + faces;
        c.image = vectors + 2 * faces, c.inverse = vectors + 3 * faces;
        memcpy(c.wanted, map->step, halves * sizeof *c.wanted);
        /* steps of another size are nearly those of this one, scaled: the multipliers are a good start */
        for (size_t f = 0; f < faces && map->size > 0.0; f++)
            for (int axis = 0; axis < 2; axis++)
                map->multiplier[f][axis] *= size / map->size;
        int passes = map->size > 0.0 ? 1 : FIRST_PASSES;
        for (int pass = 0; pass < passes && status == QM_OK; pass++) {
            if (pass > 0) stiffen(&c, map);
            set_compliance(m, map, &c);
            status = solve(ctx, m, map, &c);
        }
        if (status == QM_OK) map->size = size;
    }
    qm_context_free(ctx, vectors, 4 * faces, sizeof *vectors);
    qm_context_free(ctx, c.compliance, halves, sizeof *c.compliance);
    qm_context_free(ctx, c.wanted, halves, sizeof *c.wanted);
    return status;
}

qm_status qm_quads_map_build(qm_context *ctx, const qm_trimesh *m, const qm_vec *cross,
                             const qm_quads_corners *corners, double unit, qm_quads_map *map)
{
    size_t faces = m->face_count, halves = 3 * faces;
    *map = (qm_quads_map){.face_count = faces, .unit = unit};
    map->turned = qm_context_alloc(ctx, halves, 1);
    map->edge = qm_context_alloc(ctx, halves, sizeof *map->edge);
    map->step = qm_context_alloc(ctx, halves, sizeof *map->step);
    map->share = qm_context_alloc(ctx, halves, sizeof *map->share);
    map->is_across = qm_context_alloc(ctx, halves, 1);
    map->multiplier = qm_context_alloc(ctx, faces, sizeof *map->multiplier);
    if (!map->turned || !map->edge || !map->step || !map->share || !map->is_across || !map->multiplier)
        return QM_E_NO_MEMORY;
    for (size_t h = 0; h < halves; h++)
        map->share[h] = 1.0F;
    memset(map->multiplier, 0, faces * sizeof *map->multiplier);
    find_turns(m, cross, map);
    qm_quads_turn_corners(m, corners, map->turned, (const float(*)[2])map->edge);
    return QM_OK;
}

void qm_quads_map_reset(qm_context *ctx, qm_quads_map *map)
{
    size_t faces = map->face_count, halves = 3 * faces;
    qm_context_free(ctx, map->turned, halves, 1);
    qm_context_free(ctx, map->edge, halves, sizeof *map->edge);
    qm_context_free(ctx, map->step, halves, sizeof *map->step);
    qm_context_free(ctx, map->share, halves, sizeof *map->share);
    qm_context_free(ctx, map->is_across, halves, 1);
    qm_context_free(ctx, map->multiplier, faces, sizeof *map->multiplier);
    *map = (qm_quads_map){0};
}
