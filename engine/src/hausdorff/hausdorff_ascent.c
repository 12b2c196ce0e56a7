/**
 * hausdorff_ascent.c: from a witness uphill over the source, to a place from which no direction leads farther
 * from the target. The distance is the least of those to the facets of the target; each of these is nearly
 * linear near a point, and the highest point below them (max_min.h) is where to measure next. A measured
 * point that lies below what was expected brings the facet that was missing.
 *
 * Nothing here is certain, nor need it be: the point at the end is a sample like any other.
 */
#include "hausdorff_ground.h"
#include "prim/tri_distance.h"
#include "prim/tri_point.h"

#define MAX_FACETS 12   /* of the target, known to a climb */
#define MAX_MEASURED 64 /* points of one climb */
#define STOP_SHARE 0.25 /* of the tolerance: expected to be gained, to go on */
#define MIN_RISE 4.0    /* tolerances by which a witness must have risen for the next climb */
#define POOR_GAIN 0.25  /* of what was expected: the radius falls */
#define GOOD_GAIN 0.75  /* the radius grows */

/** A facet of the target: a triangle or a patch; and how a point lies to it. */
typedef struct facet {
    uint64_t key;
    bool is_patch;
    qm_triangle triangle;
    qm_vec corner[3];
    qm_bilinear patch;
    double uv[2];
    double distance;
    qm_vec away; /* from the foot to the point, of length 1 */
} facet;

typedef struct climb {
    qm_worker *worker;
    const qm_side *side;
    const qm_kernel *kernel;
    qm_vec place;
    double distance;
    double radius; /* round the place, in which the facets are trusted to be nearly linear */
    uint32_t hint;
    int measured, facet_count;
    facet facets[MAX_FACETS];
    qm_incident_facets grounds;
} climb;

static void look_from(facet *f, qm_vec p)
{
    qm_vec foot;
    if (f->is_patch) {
        qm_bilinear_foot at = {.distance = INFINITY, .uv = {f->uv[0], f->uv[1]}};
        qm_bilinear_polish(&f->patch, p, &at);
        f->uv[0] = at.uv[0];
        f->uv[1] = at.uv[1];
        foot = qm_bilinear_at(&f->patch, at.uv[0], at.uv[1]);
    } else {
        double weight[3];
        qm_triangle_footpoint(&f->triangle, p, weight);
        foot = qm_tri_at(f->corner, weight);
    }
    f->away = qm_vec_sub(p, foot);
    f->distance = qm_vec_norm(f->away);
    f->away = qm_vec_scale(f->distance > 0.0 ? 1.0 / f->distance : 0.0, f->away);
}

/** Keeps a facet unless it is known, in place of the farthest when there is no room. */
static bool remember(climb *c, const facet *f)
{
    for (int i = 0; i < c->facet_count; i++)
        if (c->facets[i].key == f->key) return false;
    int place = 0;
    if (c->facet_count < MAX_FACETS) {
        place = c->facet_count++;
    } else {
        for (int i = 1; i < MAX_FACETS; i++)
            if (c->facets[i].distance > c->facets[place].distance) place = i;
    }
    c->facets[place] = *f;
    look_from(&c->facets[place], c->place);
    return true;
}

static facet load_triangle(const climb *c, qm_hit hit)
{
    facet f = {.key = (uint64_t)hit.pack * QM_PACK_LANES + hit.lane};
    qm_bvh_load_triangle(c->side->target, hit.pack, hit.lane, f.corner);
    f.triangle = qm_triangle_make(f.corner[0], f.corner[1], f.corner[2]);
    return f;
}

/** Distance of a point; *is_new tells that the facet there was not known. */
static double measure(climb *c, qm_vec p, bool *is_new)
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
            qm_bilinear_foot foot = qm_bilinear_descend(&f.patch, p, INFINITY);
            f.uv[0] = foot.uv[0];
            f.uv[1] = foot.uv[1];
            *is_new = remember(c, &f);
            return found.distance;
        }
        distance = found.distance;
    }
    facet f = load_triangle(c, hit);
    *is_new = remember(c, &f);
    return distance;
}

/** How much is expected to be gained on a ground, and by which step of its parameters. */
static double expect(const climb *c, const qm_incident_facet *ground, double step[2])
{
    qm_vec along_u = qm_vec_axpy(ground->patch.e1, ground->uv[1], ground->patch.w);
    qm_vec along_v = qm_vec_axpy(ground->patch.e2, ground->uv[0], ground->patch.w);
    double speed[2] = {qm_vec_norm(along_u), qm_vec_norm(along_v)};
    if (!(speed[0] > 0.0) || !(speed[1] > 0.0)) return 0.0;
    qm_slope slopes[MAX_FACETS + QM_MAX_BOUNDS];
    int count = 0;
    for (; count < c->facet_count; count++) {
        const facet *f = &c->facets[count];
        slopes[count] = (qm_slope){
            .slope = {qm_vec_dot(f->away, along_u) / speed[0], qm_vec_dot(f->away, along_v) / speed[1]},
            .height = f->distance,
        };
    }
    count += qm_incident_bounds(ground, speed, slopes + count);
    double expected = qm_max_min(slopes, count, c->radius, step);
    for (int k = 0; k < 2; k++)
        step[k] /= speed[k];
    return expected - c->distance;
}

static void move_to(climb *c, qm_vec p, double distance)
{
    c->place = p;
    c->distance = distance;
    for (int i = 0; i < c->facet_count; i++)
        look_from(&c->facets[i], p);
}

/** Climbs on one facet of the source as far as it leads. True when that was a way. */
static bool ascend_on(climb *c, qm_incident_facet *ground, double enough)
{
    qm_vec from = c->place;
    while (c->measured < MAX_MEASURED) {
        double step[2], expected = expect(c, ground, step);
        if (!(expected > enough)) break;
        double u = qm_clamp(ground->uv[0] + step[0], 0.0, 1.0);
        double v = qm_clamp(ground->uv[1] + step[1], 0.0, ground->is_triangle ? 1.0 - u : 1.0);
        qm_vec p = qm_bilinear_at(&ground->patch, u, v);
        bool is_new;
        double distance = measure(c, p, &is_new), gained = distance - c->distance;
        if (gained > GOOD_GAIN * expected)
            c->radius *= 2.0;
        else if (!is_new && gained < POOR_GAIN * expected)
            c->radius = POOR_GAIN * qm_min(c->radius, qm_vec_distance(p, c->place));
        if (!(gained > 0.0)) continue;
        ground->uv[0] = u;
        ground->uv[1] = v;
        move_to(c, p, distance);
    }
    return qm_vec_distance(from, c->place) > 0.0;
}

/** The facet of the source at the place that promises most, or NULL. */
static qm_incident_facet *best_incident(climb *c, double enough)
{
    qm_incident_facet *best = NULL;
    double most = enough;
    for (int i = 0; i < c->grounds.count; i++) {
        double step[2], expected = expect(c, &c->grounds.at[i], step);
        if (!(expected > most)) continue;
        most = expected;
        best = &c->grounds.at[i];
    }
    return best;
}

void qm_worker_ascend(qm_worker *worker)
{
    const qm_search *search = worker->search;
    const qm_side *side = &search->side[worker->witness_side];
    double enough = STOP_SHARE * search->tolerance * side->scale;
    climb c = {.worker = worker, .side = side, .kernel = search->kernel, .place = worker->witness_point};
    c.hint = worker->witness_hint;
    bool is_new;
    c.distance = measure(&c, c.place, &is_new);
    qm_incident_find(search, side, c.place, &c.grounds);
    c.radius = qm_incident_longest(&c.grounds);
    /* A witness may lie beside the source; what is climbed to lies on it. */
    uint32_t face = QM_NO_INDEX;
    for (qm_incident_facet *ground; c.measured < MAX_MEASURED && (ground = best_incident(&c, enough));) {
        if (!ascend_on(&c, ground, enough)) continue;
        face = ground->face;
        qm_incident_find(search, side, c.place, &c.grounds);
    }
    if (face != QM_NO_INDEX) qm_worker_sample(worker, side, c.place, 0.0, face, 0.0, &c.hint);
    worker->ascend_above = worker->witness + MIN_RISE * search->tolerance;
}
