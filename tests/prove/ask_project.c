/*
 * Nearest points: of both meshes, in both readings, by every accelerator, for points on the surface, near it
 * and up to 10^6 of its sizes away. And the face that is named where several are equally near.
 */
#include "ask.h"
#include "qm/project.h"

#include <stdlib.h>
#include <string.h>

enum { POINTS = 8 };

#define ROUNDING 0x1p-53
#define PROJECTION_ERROR 1.5e-13 /* of the mesh's size: less than project.h promises */
#define FAR_ROUNDINGS 180        /* of the distance, likewise */
#define PLACE_ROUNDINGS 8        /* of the coordinates, which feet are rounded to */

/** What the engine said of a point. */
typedef struct answer {
    double distance, position[3], uv[2];
    uint32_t face;
} answer;

/** A surface and the points to project onto it. */
typedef struct inquiry {
    qm_trial *trial;
    const qm_mesh *mesh;
    const qm_bvh *tree;
    qm_quad_reading quads;
    qm_wide_frame frame;
    qm_wide_surface surface;
    double size;      /* the diagonal of the mesh's box */
    double magnitude; /* the greatest coordinate of the mesh */
    double point[POINTS][3];
} inquiry;

/* ---- points ---- */

/** A random point of a facet, rounded, or a corner, or the middle of a side. */
static void draw_on_surface(qm_random *random, const inquiry *q, double out[3])
{
    const qm_wide_facet *facet = &q->surface.facets[qm_random_below(random, q->surface.count)];
    double u = qm_random_range(random, 0, 1), v = qm_random_range(random, 0, 1);
    if (qm_random_below(random, 3) == 0) u = 0.5 * (double)qm_random_below(random, 3);
    if (qm_random_below(random, 3) == 0) v = 0.5 * (double)qm_random_below(random, 3);
    if (facet->corner_count == 4 && qm_random_below(random, 2)) {
        u = 0.3 + 0.4 * u; /* patches leave their triangles most in the middle */
        v = 0.3 + 0.4 * v;
    }
    if (facet->corner_count == 3 && u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    qm_wide_vec p = qm_wide_axpy(q->frame.origin, 1 / q->frame.scale, qm_wide_facet_at(facet, u, v));
    out[0] = (double)p.x;
    out[1] = (double)p.y;
    out[2] = (double)p.z;
}

static void draw_point(qm_random *random, const inquiry *q, const qm_mesh *other, double out[3])
{
    double direction[3], away = 0;
    draw_on_surface(random, q, out);
    /* Where b is degenerate, points elsewhere test nothing. */
    size_t kind = q->trial->kind->only_from_a ? 0 : qm_random_below(random, 6);
    if (kind == 1) away = q->size * qm_random_power(random, -15, -3);
    if (kind == 2) away = q->size * qm_random_power(random, -3, 1);
    if (kind == 3) away = q->size * qm_random_power(random, 1, 6);
    qm_random_direction(random, direction);
    for (int k = 0; k < 3; k++)
        out[k] += away * direction[k];
    if (kind == 4)
        memcpy(out, other->positions + 3 * qm_random_below(random, other->vertex_count), 3 * sizeof *out);
}

/* ---- checks ---- */

static double length(const double a[3], const double b[3])
{
    return (double)qm_wide_length(
        (qm_wide_vec){(qm_wide)a[0] - b[0], (qm_wide)a[1] - b[1], (qm_wide)a[2] - b[2]});
}

/** Distance, in the unit of the mesh, from a point to the facets of one face. */
static qm_wide_distance face_distance(const inquiry *q, uint32_t face, const double p[3])
{
    qm_wide_vec local = qm_wide_local(&q->frame, p);
    qm_wide_distance best = {.lower = INFINITY, .upper = INFINITY};
    for (size_t f = 0; f < q->surface.count; f++) {
        if (q->surface.facets[f].face != face) continue;
        qm_wide_distance d = qm_wide_facet_distance(&q->surface.facets[f], local, 0x1p-60L, best.upper);
        best.lower = qm_wide_least(best.lower, d.lower);
        best.upper = qm_wide_least(best.upper, d.upper);
    }
    best.lower /= q->frame.scale;
    best.upper /= q->frame.scale;
    return best;
}

/** The point of a face at parameters as mesh.h has them, in the unit of the mesh. */
static void position_at(const inquiry *q, uint32_t face, const double uv[2], double out[3])
{
    const qm_wide_facet *facet = q->surface.facets;
    while (facet->face != face)
        facet++;
    qm_wide u = uv[0], v = uv[1];
    bool is_cut = q->mesh->face_count > 0 && q->mesh->faces[4 * (size_t)face + 3] != QM_NO_INDEX &&
                  q->quads == QM_QUADS_TRIANGLES;
    /* Of a quad's halves, c0 c1 c2 holds v <= u at weights u - v and v, c0 c2 c3 the rest at u and v - u. */
    bool is_second = is_cut && v > u;
    qm_wide first = !is_cut ? u : is_second ? u : u - v, second = !is_cut ? v : is_second ? v - u : v;
    qm_wide_vec p = qm_wide_facet_at(facet + is_second, first, second);
    p = qm_wide_axpy(q->frame.origin, 1 / q->frame.scale, p);
    out[0] = (double)p.x;
    out[1] = (double)p.y;
    out[2] = (double)p.z;
}

static void check_answer(const inquiry *q, const double p[3], const answer *reported, qm_wide_distance d,
                         const char *how)
{
    double lower = (double)(d.lower / q->frame.scale), upper = (double)(d.upper / q->frame.scale), at[3];
    double error = PROJECTION_ERROR * q->size + FAR_ROUNDINGS * ROUNDING * upper;
    double place = PLACE_ROUNDINGS * ROUNDING * q->magnitude;
    if (!(reported->distance >= lower - error && reported->distance <= upper + error))
        qm_trial_fail(q->trial, "%s: distance %.17g of %.17g %.17g %.17g, true in [%.17g, %.17g], size %g",
                      how, reported->distance, p[0], p[1], p[2], lower, upper, q->size);
    if (reported->face >= (q->mesh->face_count ? q->mesh->face_count : q->mesh->vertex_count)) {
        qm_trial_fail(q->trial, "%s: face %u", how, reported->face);
        return;
    }
    qm_wide_distance own = face_distance(q, reported->face, p);
    if (!((double)own.lower <= upper + 2 * error))
        qm_trial_fail(q->trial, "%s: face %u of %.17g %.17g %.17g is %.17g away, the nearest at most %.17g",
                      how, reported->face, p[0], p[1], p[2], (double)own.lower, upper);
    double off = (double)face_distance(q, reported->face, reported->position).lower,
           apart = length(p, reported->position);
    if (!(off <= error + place && fabs(apart - reported->distance) <= 2 * error + place))
        qm_trial_fail(q->trial,
                      "%s: foot %.17g %.17g %.17g is %g off face %u, %.17g from %.17g %.17g %.17g, not %.17g",
                      how, reported->position[0], reported->position[1], reported->position[2], off,
                      reported->face, apart, p[0], p[1], p[2], reported->distance);
    position_at(q, reported->face, reported->uv, at);
    bool is_inside =
        reported->uv[0] >= 0 && reported->uv[0] <= 1 && reported->uv[1] >= 0 && reported->uv[1] <= 1;
    if (!(is_inside && length(at, reported->position) <= error + place))
        qm_trial_fail(q->trial, "%s: parameters %.17g %.17g of face %u are %g from the foot", how,
                      reported->uv[0], reported->uv[1], reported->face, length(at, reported->position));
}

/** The first face that is as near as the nearest, to 100 bits; *count how many there are. */
static uint32_t first_nearest(const inquiry *q, const double p[3], qm_wide nearest, size_t *count)
{
    qm_wide_vec local = qm_wide_local(&q->frame, p);
    qm_wide limit = nearest * (1 + 0x1p-100L) + 0x1p-100L;
    uint32_t first = QM_NO_INDEX;
    *count = 0;
    for (size_t f = 0; f < q->surface.count; f++) {
        const qm_wide_facet *facet = &q->surface.facets[f];
        if (first == facet->face || !(qm_wide_facet_distance(facet, local, 0x1p-60L, limit).upper <= limit))
            continue;
        if (first == QM_NO_INDEX) first = facet->face;
        ++*count;
    }
    return first;
}

static void check_tie(const inquiry *q, const double p[3], const answer *reported, qm_wide_distance d,
                      const char *how)
{
    size_t count;
    if (!(d.lower >= d.upper - 2 * 0x1p-60L)) { /* nothing is known of the nearest */
        q->trial->tally->open++;
        return;
    }
    uint32_t first = first_nearest(q, p, d.upper, &count);
    if (count < 2) return;
    q->trial->tally->tries++;
    /* A lower index may win that is farther by no more than what the distance may be off. */
    if (reported->face > first)
        qm_trial_fail(q->trial, "%s: of %zu faces equally near to %.17g %.17g %.17g, face %u, not %u", how,
                      count, p[0], p[1], p[2], reported->face, first);
}

/* ---- questions ---- */

static bool project(inquiry *q, qm_accelerator accelerator, answer reported[POINTS])
{
    qm_context *ctx = &q->trial->ctx;
    qm_locator locator;
    double distance[POINTS], position[POINTS][3], uv[POINTS][2];
    uint32_t face[POINTS];
    qm_projection out = {distance, position[0], face, uv[0]};
    qm_status status = qm_locator_build(ctx, q->tree, NULL, accelerator, &locator);
    if (status != QM_OK) {
        qm_trial_fail(q->trial, "locator: %s: %s", qm_status_code(status), ctx->message);
        return false;
    }
    status = qm_project_points_with(ctx, &locator, q->quads, q->point[0], POINTS, 1, &out);
    qm_locator_reset(ctx, &locator);
    if (status == QM_E_SCALE) q->trial->tally->refused++;
    if (status != QM_OK && status != QM_E_SCALE)
        qm_trial_fail(q->trial, "%s: %s", qm_status_code(status), ctx->message);
    for (int i = 0; status == QM_OK && i < POINTS; i++) {
        reported[i] = (answer){.distance = distance[i], .uv = {uv[i][0], uv[i][1]}, .face = face[i]};
        memcpy(reported[i].position, position[i], sizeof position[i]);
    }
    return status == QM_OK;
}

static void ask_with(inquiry *q, qm_accelerator accelerator, const qm_wide_distance reference[POINTS],
                     bool ties)
{
    static const char *const names[] = {"auto", "boxes", "tetra", "grid"};
    answer reported[POINTS];
    char how[96];
    snprintf(how, sizeof how, "%s, mesh %s, quads %d", names[accelerator],
             q->mesh == &q->trial->pair.a ? "A" : "B", (int)q->quads);
    if (!project(q, accelerator, reported)) return;
    for (int i = 0; i < POINTS; i++) {
        if (ties) {
            check_tie(q, q->point[i], &reported[i], reference[i], how);
        } else {
            q->trial->tally->tries++;
            check_answer(q, q->point[i], &reported[i], reference[i], how);
        }
    }
}

static void ask_mesh(qm_trial *trial, int side, bool ties)
{
    const qm_mesh *other = side ? &trial->pair.a : &trial->pair.b;
    inquiry q = {.trial = trial, .mesh = side ? &trial->pair.b : &trial->pair.a, .tree = trial->tree[side]};
    q.quads =
        trial->kind->only_patches ? QM_QUADS_BILINEAR : (qm_quad_reading)qm_random_below(&trial->random, 2);
    q.frame = qm_wide_frame_make(q.mesh, NULL);
    q.surface = qm_wide_surface_make(&q.frame, q.mesh, q.quads);
    qm_box box = qm_mesh_bounding_box(q.mesh);
    q.size = qm_mesh_box_diagonal(&box);
    for (int k = 0; k < 3; k++)
        q.magnitude = fmax(q.magnitude, fmax(fabs(box.min[k]), fabs(box.max[k])));
    qm_wide_distance reference[POINTS];
    for (int i = 0; i < POINTS; i++) {
        draw_point(&trial->random, &q, other, q.point[i]);
        reference[i] = qm_wide_surface_distance(&q.surface, qm_wide_local(&q.frame, q.point[i]), 0x1p-60L);
    }
    ask_with(&q, QM_ACCELERATOR_BOXES, reference, ties);
    ask_with(&q, QM_ACCELERATOR_GRID, reference, ties);
    if (q.mesh->face_count > 0) ask_with(&q, QM_ACCELERATOR_TETRA, reference, ties);
    qm_wide_surface_free(&q.surface);
}

void qm_ask_project(qm_trial *trial)
{
    if (!trial->kind->only_from_a) ask_mesh(trial, 0, false);
    ask_mesh(trial, 1, false);
}

void qm_ask_ties(qm_trial *trial)
{
    ask_mesh(trial, 0, true);
    ask_mesh(trial, 1, true);
}
