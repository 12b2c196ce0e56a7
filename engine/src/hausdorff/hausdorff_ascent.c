/**
 * hausdorff_ascent.c: from a witness over the source to a local maximum of the distance, by sequential linear
 * programming in a trust region.
 *
 * The distance is the minimum of the distances to the facets of the target; each of these is nearly linear
 * near a point. The point with the largest minimum of the linear functions within the trust region
 * (linear.h) is the next to be measured. One whose distance is below that value shows either the facet that
 * was missing, which is added, or that the region is too large.
 *
 * The ascent proves nothing, and need not: its last point is a sample like any other.
 */
#include "core/linear.h"
#include "hausdorff_sample.h"
#include "prim/triangle.h"

#define MAX_FACETS 12   /* of the target, known to an ascent */
#define SAME_FOOT 1e-3  /* in the parameters of a patch */
#define MAX_MEASURED 64 /* points of one ascent */
#define MAX_INCIDENT 16 /* facets of the source at a point; more are not examined */
#define MAX_BOUNDS 4    /* edges of a facet of the source */
#define TOUCH 0x1p-36   /* of the reach: a facet of the source is incident to a point within it */
#define SAME_FOOT 1e-3  /* in the parameters of a patch: footpoints on one sheet of it */
#define STOP_SHARE 0.25 /* of the tolerance: gain expected of a step that is worth it */
#define MIN_RISE 4.0    /* tolerances by which a witness must have risen for the next ascent */
#define POOR_GAIN 0.25  /* of the gain expected: the trust region shrinks */
#define GOOD_GAIN 0.75  /* of the gain expected: the trust region grows */

/** A facet of the target, a triangle or a patch, and its footpoint for the current point. */
typedef struct facet {
    uint64_t key;
    bool is_patch;
    qm_triangle triangle;
    qm_vec corner[3];
    qm_bilinear patch;
    double uv[2];
    double distance;
    qm_vec away; /* unit vector from the footpoint to the point */
} facet;

/** A facet of the source, in local space; w is 0 for triangles, whose parameters sum to 1 at most. */
typedef struct incident_facet {
    qm_bilinear patch;
    bool is_triangle;
    uint32_t face;
    double uv[2]; /* of the current point */
} incident_facet;

/** The facets of the source that meet in a point. */
typedef struct incident_list {
    int count;
    incident_facet at[MAX_INCIDENT];
} incident_list;

typedef struct ascent {
    qm_worker *worker;
    const qm_side *side;
    const qm_kernel *kernel;
    qm_vec point; /* the current one */
    double distance;
    double radius; /* of the trust region round it */
    uint32_t hint;
    int measured, facet_count;
    facet facets[MAX_FACETS];
    incident_list incident;
} ascent;

/* --- Facets of the source at a point --- */

static incident_facet incident_patch(const qm_vec corner[4], qm_vec point, double *away)
{
    incident_facet on = {.patch = qm_bilinear_make(corner)};
    qm_bilinear_footpoint foot = qm_bilinear_minimise(&on.patch, point, INFINITY);
    on.uv[0] = foot.uv[0];
    on.uv[1] = foot.uv[1];
    *away = foot.distance;
    return on;
}

static incident_facet incident_triangle(const qm_vec corner[3], qm_vec point, double *away)
{
    incident_facet on = {
        .patch = {corner[0], qm_vec_sub(corner[1], corner[0]), qm_vec_sub(corner[2], corner[0]), {0, 0, 0}},
        .is_triangle = true,
    };
    qm_triangle triangle = qm_triangle_make(corner[0], corner[1], corner[2]);
    double weight[3];
    qm_triangle_footpoint(&triangle, point, weight);
    on.uv[0] = weight[1];
    on.uv[1] = weight[2];
    *away = qm_vec_distance(qm_bilinear_at(&on.patch, weight[1], weight[2]), point);
    return on;
}

/** Finds the facets that hold a point of the source. */
static void find_incident(const qm_search *search, const qm_side *side, qm_vec point, incident_list *out)
{
    qm_vec p = qm_vec_scale(1.0 / side->factor, qm_vec_sub(point, side->shift));
    qm_box box = qm_vec_box(&p, 1);
    qm_near_packs near;
    search->kernel->gather(side->source, &box, TOUCH, &near);
    out->count = 0;
    for (int k = 0; k < near.count; k++) {
        const qm_pack_lanes *lanes = &side->source->lanes[near.pack[k]];
        for (int lane = 0, count; lane < lanes->lane_count && out->count < MAX_INCIDENT; lane += count - 2) {
            qm_vec corner[4];
            count = qm_side_corners(side, lanes, (uint32_t)lane, corner);
            double away;
            incident_facet on =
                count == 4 ? incident_patch(corner, point, &away) : incident_triangle(corner, point, &away);
            on.face = lanes->face[lane];
            if (away <= TOUCH * side->reach) out->at[out->count++] = on;
        }
    }
}

/** The edges of a facet as bound constraints on steps from its current point, in units of length along its
 * parameters; speed is the length per unit of each parameter. Returns how many. */
static int edge_bounds(const incident_facet *on, const double speed[2], qm_max_min_plane bounds[MAX_BOUNDS])
{
    double u = on->uv[0], v = on->uv[1];
    int count = 0;
    bounds[count++] = (qm_max_min_plane){{1.0, 0.0}, u * speed[0], true};
    bounds[count++] = (qm_max_min_plane){{0.0, 1.0}, v * speed[1], true};
    if (on->is_triangle) {
        double slower = qm_min(speed[0], speed[1]);
        bounds[count++] = (qm_max_min_plane){
            {-slower / speed[0], -slower / speed[1]}, qm_max(0.0, 1.0 - u - v) * slower, true};
    } else {
        bounds[count++] = (qm_max_min_plane){{-1.0, 0.0}, (1.0 - u) * speed[0], true};
        bounds[count++] = (qm_max_min_plane){{0.0, -1.0}, (1.0 - v) * speed[1], true};
    }
    QM_ASSERT(count <= MAX_BOUNDS);
    return count;
}

/* --- The ascent --- */

/** Finds the footpoint of p on a facet, near the last one on a patch. */
static void set_footpoint(facet *f, qm_vec p)
{
    qm_vec foot;
    if (f->is_patch) {
        qm_bilinear_footpoint at = {.distance = INFINITY, .uv = {f->uv[0], f->uv[1]}};
        qm_bilinear_polish(&f->patch, p, QM_FINE_GAIN, &at);
        f->uv[0] = at.uv[0];
        f->uv[1] = at.uv[1];
        foot = qm_bilinear_at(&f->patch, at.uv[0], at.uv[1]);
    } else {
        double weight[3];
        qm_triangle_footpoint(&f->triangle, p, weight);
        foot = qm_triangle_at(f->corner, weight);
    }
    f->away = qm_vec_sub(p, foot);
    f->distance = qm_vec_norm(f->away);
    f->away = qm_vec_scale(f->distance > 0.0 ? 1.0 / f->distance : 0.0, f->away);
}

/** True when two facets have one footpoint: of a folded patch each sheet is a facet of its own. */
static bool is_same(const facet *a, const facet *b)
{
    if (a->key != b->key) return false;
    return !a->is_patch || (fabs(a->uv[0] - b->uv[0]) < SAME_FOOT && fabs(a->uv[1] - b->uv[1]) < SAME_FOOT);
}

/** Adds a facet unless it is known for the current point, in place of the farthest when there is no room. */
static bool remember(ascent *c, const facet *found)
{
    QM_ASSERT(c->facet_count <= MAX_FACETS);
    facet f = *found;
    bool has_key = false;
    for (int i = 0; i < c->facet_count && !has_key; i++)
        has_key = c->facets[i].key == f.key;
    if (has_key && !f.is_patch) return false;
    set_footpoint(&f, c->point);
    for (int i = 0; i < c->facet_count && has_key; i++)
        if (is_same(&c->facets[i], &f)) return false;
    int slot = 0;
    if (c->facet_count < MAX_FACETS) {
        slot = c->facet_count++;
    } else {
        for (int i = 1; i < MAX_FACETS; i++)
            if (c->facets[i].distance > c->facets[slot].distance) slot = i;
    }
    c->facets[slot] = f;
    return true;
}

/** Distance of a point; *is_new reports whether the facet there was not known. */
static double measure(ascent *c, qm_vec p, bool *is_new)
{
    qm_hit hit = {.d2 = INFINITY, .pack = c->hint};
    c->measured++;
    c->worker->projections++;
    qm_nearest_triangle(c->kernel, &c->side->nearest, p, &hit);
    c->hint = hit.pack;
    double distance = sqrt(hit.d2);
    if (c->side->target_patches) {
        qm_bilinear_hit found;
        qm_nearest_patch(c->kernel, &c->side->nearest, p, hit.pack, INFINITY, &found);
        qm_vec corner[4];
        if (qm_bvh_load_face(c->side->target, found.face, corner) == 4) {
            facet f = {
                .key = UINT64_C(1) << 63 | found.face, .is_patch = true, .patch = qm_bilinear_make(corner)};
            qm_bilinear_footpoint foot = qm_bilinear_minimise(&f.patch, p, INFINITY);
            f.uv[0] = foot.uv[0];
            f.uv[1] = foot.uv[1];
            *is_new = remember(c, &f);
            return found.distance;
        }
        distance = found.distance;
    }
    facet f = {.key = (uint64_t)hit.pack * QM_PACK_LANES + hit.lane};
    qm_bvh_load_triangle(c->side->target, hit.pack, hit.lane, f.corner);
    f.triangle = qm_triangle_make(f.corner[0], f.corner[1], f.corner[2]);
    *is_new = remember(c, &f);
    return distance;
}

/** The gain expected on a facet of the source, and the step of its parameters that makes it. */
static double expect(const ascent *c, const incident_facet *on, double step[2])
{
    qm_vec along_u = qm_vec_axpy(on->patch.e1, on->uv[1], on->patch.w);
    qm_vec along_v = qm_vec_axpy(on->patch.e2, on->uv[0], on->patch.w);
    double speed[2] = {qm_vec_norm(along_u), qm_vec_norm(along_v)};
    if (!(speed[0] > 0.0) || !(speed[1] > 0.0)) return 0.0;
    qm_max_min_plane slopes[MAX_FACETS + MAX_BOUNDS];
    int count = 0;
    for (; count < c->facet_count; count++) {
        const facet *f = &c->facets[count];
        slopes[count] = (qm_max_min_plane){
            .slope = {qm_vec_dot(f->away, along_u) / speed[0], qm_vec_dot(f->away, along_v) / speed[1]},
            .height = f->distance,
        };
    }
    count += edge_bounds(on, speed, slopes + count);
    double expected = qm_linear_max_min(slopes, count, c->radius, step);
    for (int k = 0; k < 2; k++)
        step[k] /= speed[k];
    return expected - c->distance;
}

/** Ascends on one facet of the source as far as it leads. True when that moved the point. */
static bool ascend_on(ascent *c, incident_facet *on, double enough)
{
    qm_vec from = c->point;
    while (c->measured < MAX_MEASURED) {
        double step[2], expected = expect(c, on, step);
        if (!(expected > enough)) break;
        double u = qm_clamp(on->uv[0] + step[0], 0.0, 1.0);
        double v = qm_clamp(on->uv[1] + step[1], 0.0, on->is_triangle ? 1.0 - u : 1.0);
        qm_vec p = qm_bilinear_at(&on->patch, u, v);
        bool is_new;
        double distance = measure(c, p, &is_new), gained = distance - c->distance;
        if (gained > GOOD_GAIN * expected)
            c->radius *= 2.0;
        else if (!is_new && gained < POOR_GAIN * expected)
            c->radius = POOR_GAIN * qm_min(c->radius, qm_vec_distance(p, c->point));
        if (!(gained > 0.0)) continue;
        on->uv[0] = u;
        on->uv[1] = v;
        c->point = p;
        c->distance = distance;
        for (int i = 0; i < c->facet_count; i++)
            set_footpoint(&c->facets[i], p);
    }
    return qm_vec_distance(from, c->point) > 0.0;
}

/** The facet of the source at the current point with the largest expected gain, or NULL. */
static incident_facet *best_incident(ascent *c, double enough)
{
    incident_facet *best = NULL;
    double best_gain = enough;
    for (int i = 0; i < c->incident.count; i++) {
        double step[2], expected = expect(c, &c->incident.at[i], step);
        if (!(expected > best_gain)) continue;
        best_gain = expected;
        best = &c->incident.at[i];
    }
    return best;
}

void qm_ascent_run(qm_worker *worker)
{
    QM_ASSERT(worker && worker->witness >= 0.0);
    const qm_search *search = worker->search;
    const qm_side *side = &search->side[worker->witness_side];
    double enough = STOP_SHARE * search->tolerance * side->scale;
    ascent c = {.worker = worker, .side = side, .kernel = search->kernel, .point = worker->witness_point};
    c.hint = worker->witness_hint;
    bool is_new;
    c.distance = measure(&c, c.point, &is_new);
    find_incident(search, side, c.point, &c.incident);
    for (int i = 0; i < c.incident.count; i++) {
        const qm_bilinear *patch = &c.incident.at[i].patch;
        c.radius = qm_max(c.radius, qm_max(qm_vec_norm(patch->e1), qm_vec_norm(patch->e2)));
    }
    /* A witness may be off the source by its slack; the points of an ascent are on it. */
    uint32_t face = QM_NO_INDEX;
    for (incident_facet *on; c.measured < MAX_MEASURED && (on = best_incident(&c, enough));) {
        if (!ascend_on(&c, on, enough)) continue;
        face = on->face;
        find_incident(search, side, c.point, &c.incident);
    }
    if (face != QM_NO_INDEX) qm_sample_point(worker, side, c.point, 0.0, face, 0.0, &c.hint);
    worker->ascend_above = worker->witness + MIN_RISE * search->tolerance;
}
