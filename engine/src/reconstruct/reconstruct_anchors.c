/**
 * reconstruct_anchors.c: patches whose lattices miss a part of the surface, fitted by parameters along the surface.
 *
 * The nearest point of a lattice tells nothing of a protrusion that the lattice cuts off: all of its samples come to lie on the
 * few quads, or on the border, where it was cut, so that no vertex is ever between them. Parameters along the surface do not
 * depend on where the lattice is. So the first samples are kept with theirs, as anchors. They tell which patches miss a part of
 * the surface: those with anchors farther away than a share of an edge. Samples near these patches get parameters by
 * moving least squares over the anchors, and the lattices are fitted by them; what comes nearer to the anchors, without
 * more poor quads, is kept.
 */
#include "reconstruct_internal.h"

#include <string.h>

#include "bvh/bvh_tree.h"
#include "bvh/nearest.h"
#include "core/linear.h"

#define MISSED 0.5      /* of the root mean area of a quad: anchors farther from all lattices are missed */
#define MIN_GAIN 0.7    /* times the sum of the squared distances of its anchors: a better lattice has less */
#define POOR_SINE 0.1   /* of a quad: a better lattice has no more with less */
#define NEAR_ANCHORS 16 /* round a sample; those of other patches and walls do not count */
#define WEIGHT_FLOOR 0.1 /* of the mean squared distance of these: what is nearer does not count much more */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for parts that the patches miss");
}

/** How well a lattice reaches the anchors of its patch. */
typedef struct patch_reach {
    double edge;              /* the root of the mean area of its quads */
    double squares, greatest; /* of the distances of its anchors */
    size_t poor;              /* quads, folded ones among them */
    double *saved;            /* its vertices before a fit by parameters; NULL: not fitted */
} patch_reach;

/** Counts the quads of a lattice that are folded or nearly so. */
static size_t count_poor(const qm_lattice *lattice)
{
    size_t count = 0;
    for (uint32_t j = 0; j < lattice->rows; j++)
        for (uint32_t i = 0; i < lattice->columns; i++)
            count += !(qm_lattice_quad_sine(lattice, i, j) > POOR_SINE);
    return count;
}

/** Measures how well all lattices reach the anchors; distance has room for one of each. */
static qm_status measure(qm_context *ctx, const qm_reconstruction *r, double *distance, patch_reach *reach)
{
    const qm_anchors *anchors = &r->anchors;
    qm_status status = qm_samples_distances(ctx, r, anchors->positions, anchors->sample_count, distance);
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        reach[p].squares = reach[p].greatest = 0.0;
        reach[p].poor = r->lattices[p].is_stale ? count_poor(&r->lattices[p]) : 0;
    }
    for (size_t i = 0; i < anchors->sample_count && status == QM_OK; i++) {
        patch_reach *of = &reach[anchors->at[i].patch];
        of->squares += distance[i] * distance[i];
        of->greatest = fmax(of->greatest, distance[i]);
    }
    return status;
}

/** Saves the vertices of stale lattices that miss anchors; sets how many. */
static qm_status save_missing(qm_context *ctx, const qm_reconstruction *r, patch_reach *reach,
                              size_t *missing)
{
    *missing = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const qm_lattice *lattice = &r->lattices[p];
        if (!lattice->is_stale || lattice->spans_hole || !(reach[p].greatest > MISSED * reach[p].edge))
            continue;
        size_t count = qm_lattice_vertex_count(lattice);
        reach[p].saved = qm_context_alloc(ctx, count, POINT_SIZE);
        if (!reach[p].saved) return no_memory(ctx);
        memcpy(reach[p].saved, lattice->vertices, count * POINT_SIZE);
        ++*missing;
    }
    return QM_OK;
}

static bool share_curve(const qm_layout_patch *a, const qm_layout_patch *b)
{
    for (int k = 0; k < 4; k++)
        for (int m = 0; m < 4; m++)
            if (a->side[k] == b->side[m]) return true;
    return false;
}

/** Marks the patches that miss anchors, and those beside them. */
static void mark_near(const qm_reconstruction *r, const patch_reach *reach, bool *is_near)
{
    const qm_layout_patch *patches = r->layout.patches;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        is_near[p] = reach[p].saved != NULL;
        for (size_t q = 0; q < r->layout.patch_count && !is_near[p]; q++)
            is_near[p] = reach[q].saved && share_curve(&patches[p], &patches[q]);
    }
}

/** The anchors round a sample that are of its patch and wall. */
typedef struct near_anchors {
    int count;
    uint32_t anchor[NEAR_ANCHORS];
    qm_vec way[NEAR_ANCHORS]; /* from the sample, local */
    double mean2;             /* of the squared lengths of these */
} near_anchors;

static bool look_alike(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > 0.0f;
}

/** Gathers the anchors of the patch of the nearest sample among them, on the sample's own wall. False if there is none. */
static bool gather(const qm_anchors *anchors, const double position[3], const float *normal,
                   near_anchors *out)
{
    qm_nearest_points near;
    qm_vec at = qm_frame_local(&anchors->tree->frame, position);
    qm_nearest_points_find(anchors->tree, at, NEAR_ANCHORS, &near);
    uint32_t patch = QM_NO_INDEX;
    for (int k = 0; k < near.count && patch == QM_NO_INDEX; k++)
        if (near.index[k] < anchors->sample_count &&
            look_alike(normal, anchors->normals + 3 * (size_t)near.index[k]))
            patch = anchors->at[near.index[k]].patch;
    out->count = 0;
    out->mean2 = 0.0;
    for (int k = 0; k < near.count; k++) {
        uint32_t i = near.index[k];
        if (anchors->at[i].patch != patch || !look_alike(normal, anchors->normals + 3 * (size_t)i)) continue;
        out->anchor[out->count] = i;
        out->way[out->count++] = qm_vec_sub(near.position[k], at);
        out->mean2 += near.d2[k];
    }
    if (out->count > 0) out->mean2 /= out->count;
    return out->count > 0;
}

/** The parameters at a sample of the linear functions that fit those of the anchors round it, over its tangent plane. */
static qm_sample_location interpolate(const qm_anchors *anchors, const near_anchors *near, qm_vec normal)
{
    qm_vec first = qm_vec_cross(normal, fabs(normal.x) < 0.6 * qm_vec_norm(normal) ? (qm_vec){1, 0, 0}
                                                                                   : (qm_vec){0, 1, 0});
    qm_vec second = qm_vec_cross(normal, first);
    first = qm_vec_scale(1.0 / (qm_vec_norm(first)), first);
    second = qm_vec_scale(1.0 / (qm_vec_norm(second)), second);
    qm_least_squares u = {.count = 3}, v = {.count = 3};
    double scale = near->mean2 > 0.0 ? 1.0 / sqrt(near->mean2) : 0.0, at_u[3], at_v[3];
    for (int k = 0; k < near->count; k++) {
        const qm_sample_location *at = &anchors->at[near->anchor[k]];
        qm_vec way = qm_vec_scale(scale, near->way[k]);
        const double row[3] = {1.0, qm_vec_dot(way, first), qm_vec_dot(way, second)};
        double weight = 1.0 / (qm_vec_norm2(way) + WEIGHT_FLOOR);
        qm_linear_add(&u, row, at->u, weight);
        qm_linear_add(&v, row, at->v, weight);
    }
    qm_sample_location out = anchors->at[near->anchor[0]];
    if (near->count < 3 || !qm_linear_solve(&u, at_u) || !qm_linear_solve(&v, at_v)) return out;
    out.u = at_u[0];
    out.v = at_v[0];
    return out;
}

/** True if a sample may be of a patch that misses anchors: it is nearest to that, or to the outer quads of one beside it. */
static bool may_be_missed(const qm_reconstruction *r, const patch_reach *reach, const bool *is_near,
                          const qm_sample_location *at)
{
    const qm_lattice *lattice = &r->lattices[at->patch];
    if (reach[at->patch].saved) return true;
    return is_near[at->patch] &&
           (at->u < 1.0 || at->v < 1.0 || at->u > lattice->columns - 1.0 || at->v > lattice->rows - 1.0);
}

/** Sets the locations of samples near patches that miss anchors from the anchors; others stay, and are of no such patch. */
static void locate(const qm_reconstruction *r, const patch_reach *reach, const bool *is_near,
                   qm_samples *samples)
{
    for (size_t i = 0; i < samples->count; i++) {
        qm_sample_location *at = &samples->location[i];
        if (!may_be_missed(r, reach, is_near, at)) continue;
        near_anchors near;
        const float *normal = samples->normals + 3 * i;
        at->u = at->v = 0.0; /* the fit ignores those on the border */
        if (!gather(&r->anchors, samples->positions + 3 * i, normal, &near)) continue;
        qm_sample_location to = interpolate(&r->anchors, &near, (qm_vec){normal[0], normal[1], normal[2]});
        at->patch = to.patch;
        at->u = qm_clamp(to.u, 0.0, 1.0) * r->lattices[to.patch].columns;
        at->v = qm_clamp(to.v, 0.0, 1.0) * r->lattices[to.patch].rows;
    }
    samples->is_projected = false;
}

/** Fits the lattices that miss anchors by the samples' locations. */
static qm_status fit_missing(qm_context *ctx, qm_reconstruction *r, const patch_reach *reach, bool *was_stale,
                             const qm_samples *samples)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        was_stale[p] = r->lattices[p].is_stale;
        r->lattices[p].is_stale = reach[p].saved != NULL;
    }
    qm_status status = qm_lattices_fit(ctx, r, samples);
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        if (status == QM_OK && qm_context_canceled(ctx))
            status = qm_context_fail(ctx, QM_E_CANCELED, "reconstruction canceled");
        if (status == QM_OK && reach[p].saved) qm_lattice_untangle(&r->surface, &r->lattices[p]);
        r->lattices[p].is_stale = was_stale[p];
    }
    return status;
}

/** Puts lattices back that the fit has not brought nearer to their anchors. */
static void keep_better(const qm_reconstruction *r, const patch_reach *before, const patch_reach *after)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        if (!before[p].saved) continue;
        bool is_better = after[p].squares < MIN_GAIN * before[p].squares &&
                         after[p].greatest < before[p].greatest && after[p].poor <= before[p].poor;
        if (is_better) continue;
        memcpy(r->lattices[p].vertices, before[p].saved,
               qm_lattice_vertex_count(&r->lattices[p]) * POINT_SIZE);
    }
}

/** True if a sample is so far from the lattice under it that anchors may be missed. */
static bool may_miss(const qm_reconstruction *r, const patch_reach *reach, const qm_samples *samples)
{
    for (size_t i = 0; i < samples->count; i++) {
        const qm_sample_location *at = &samples->location[i];
        if (r->lattices[at->patch].is_stale && at->distance > MISSED * reach[at->patch].edge) return true;
    }
    return false;
}

qm_status qm_anchors_recover(qm_context *ctx, qm_reconstruction *r, qm_samples *samples)
{
    size_t patches = r->layout.patch_count, anchors = r->anchors.sample_count, missing = 0;
    if (anchors == 0) return QM_OK;
    double *distance = qm_context_alloc(ctx, anchors, sizeof *distance);
    patch_reach *before = qm_context_alloc(ctx, patches, sizeof *before);
    patch_reach *after = qm_context_alloc(ctx, patches, sizeof *after);
    bool *flag = qm_context_alloc(ctx, patches, sizeof *flag);
    if (before) memset(before, 0, patches * sizeof *before);
    qm_status status = distance && before && after && flag ? QM_OK : no_memory(ctx);
    for (size_t p = 0; p < patches && status == QM_OK; p++)
        before[p].edge = qm_lattice_mean_edge(&r->lattices[p]);
    if (status == QM_OK && may_miss(r, before, samples)) {
        status = measure(ctx, r, distance, before);
        if (status == QM_OK) status = save_missing(ctx, r, before, &missing);
    }
    if (status == QM_OK && missing > 0) {
        mark_near(r, before, flag);
        locate(r, before, flag, samples);
        status = fit_missing(ctx, r, before, flag, samples);
        if (status == QM_OK) status = measure(ctx, r, distance, after);
        if (status == QM_OK) keep_better(r, before, after);
    }
    for (size_t p = 0; p < patches && before; p++)
        qm_context_free(ctx, before[p].saved, qm_lattice_vertex_count(&r->lattices[p]), POINT_SIZE);
    qm_context_free(ctx, distance, anchors, sizeof *distance);
    qm_context_free(ctx, before, patches, sizeof *before);
    qm_context_free(ctx, after, patches, sizeof *after);
    qm_context_free(ctx, flag, patches, sizeof *flag);
    return status;
}

qm_status qm_anchors_index(qm_context *ctx, qm_anchors *anchors)
{
    const qm_mesh cloud = {.positions = anchors->positions, .vertex_count = anchors->count};
    return qm_bvh_build(ctx, &cloud, QM_BVH_TARGET, 1, &anchors->tree);
}

bool qm_anchors_allocate(qm_context *ctx, size_t capacity, qm_anchors *out)
{
    *out = (qm_anchors){.capacity = capacity};
    out->positions = qm_context_alloc(ctx, capacity, POINT_SIZE);
    out->normals = qm_context_alloc(ctx, capacity, 3 * sizeof *out->normals);
    out->at = qm_context_alloc(ctx, capacity, sizeof *out->at);
    if (out->positions && out->normals && out->at) return true;
    qm_anchors_reset(ctx, out);
    return false;
}

void qm_anchors_add(qm_anchors *anchors, const double position[3], qm_vec normal, uint32_t patch, double u,
                    double v)
{
    QM_ASSERT(anchors->count < anchors->capacity);
    size_t i = anchors->count++;
    memcpy(anchors->positions + 3 * i, position, POINT_SIZE);
    anchors->normals[3 * i] = (float)normal.x;
    anchors->normals[3 * i + 1] = (float)normal.y;
    anchors->normals[3 * i + 2] = (float)normal.z;
    anchors->at[i] = (qm_sample_location){.patch = patch, .u = u, .v = v};
}

void qm_anchors_reset(qm_context *ctx, qm_anchors *anchors)
{
    qm_bvh_destroy(ctx, anchors->tree);
    qm_context_free(ctx, anchors->positions, anchors->capacity, POINT_SIZE);
    qm_context_free(ctx, anchors->normals, anchors->capacity, 3 * sizeof *anchors->normals);
    qm_context_free(ctx, anchors->at, anchors->capacity, sizeof *anchors->at);
    *anchors = (qm_anchors){0};
}
