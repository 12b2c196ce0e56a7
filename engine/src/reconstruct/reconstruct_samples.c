/**
 * reconstruct_samples.c: samples of the surface, their projection onto the lattices, and what their normals
 * say about sides.
 */
#include "reconstruct_internal.h"

#include <string.h>

#include "bvh/bvh_tree.h"
#include "layout/ref_samples.h"

#define MIN_LINK_COSINE -0.5 /* of the angle between the normals of two samples with a link */
#define MIN_MAJORITY 0.8     /* fraction of the samples whose normals must agree for normals to be used */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for samples of the surface");
}

/** Selects points by a hash of the index, as scans are stored line by line. */
static void sample_cloud(const qm_mesh *cloud, size_t wanted, qm_samples *out)
{
    double fraction = (double)wanted / (double)cloud->vertex_count;
    uint64_t limit = fraction >= 1.0 ? UINT64_C(1) << 32 : (uint64_t)(fraction * 0x1p32);
    size_t k = 0;
    for (size_t i = 0; i < cloud->vertex_count && k < out->count; i++) {
        uint64_t x = (uint64_t)i * UINT64_C(0x9e3779b97f4a7c15);
        x ^= x >> 32;
        x *= UINT64_C(0xd6e8feb86659fd93);
        if (x >> 32 >= limit) continue;
        memcpy(out->positions + 3 * k, cloud->positions + 3 * i, POINT_SIZE);
        if (out->normals) memcpy(out->normals + 3 * k, cloud->normals + 3 * i, 3 * sizeof *out->normals);
        k++;
    }
    out->count = k;
}

qm_status qm_samples_create(qm_context *ctx, const qm_reconstruction *r, size_t wanted, qm_samples *out)
{
    const qm_mesh *mesh = &r->surface.bvh->mesh;
    if (r->surface.is_cloud && wanted > mesh->vertex_count) wanted = mesh->vertex_count;
    /* The hash may select a few more points than wanted. */
    size_t capacity = wanted + wanted / 8 + 64;
    QM_ASSERT(ctx && r && out);
    *out = (qm_samples){.count = r->surface.is_cloud ? capacity : wanted, .capacity = capacity};
    out->positions = qm_context_alloc(ctx, capacity, POINT_SIZE);
    out->location = qm_context_alloc(ctx, capacity, sizeof *out->location);
    bool has_normals = !r->surface.is_cloud || mesh->normals;
    if (has_normals) out->normals = qm_context_alloc(ctx, capacity, 3 * sizeof *out->normals);
    if (!out->positions || !out->location || (has_normals && !out->normals)) {
        qm_samples_reset(ctx, out);
        return no_memory(ctx);
    }
    if (r->surface.is_cloud)
        sample_cloud(mesh, wanted, out);
    else
        out->count = qm_ref_surface_sample(mesh, wanted, out->positions, out->normals);
    return QM_OK;
}

void qm_samples_scale(const qm_reconstruction *r, qm_samples *samples, uint32_t base)
{
    for (size_t i = 0; i < samples->count; i++) {
        const qm_lattice *lattice = &r->lattices[samples->location[i].patch];
        samples->location[i].u *= (double)(lattice->columns / base);
        samples->location[i].v *= (double)(lattice->rows / base);
    }
}

void qm_samples_reset(qm_context *ctx, qm_samples *samples)
{
    qm_context_free(ctx, samples->positions, samples->capacity, POINT_SIZE);
    qm_context_free(ctx, samples->normals, samples->capacity, 3 * sizeof *samples->normals);
    qm_context_free(ctx, samples->location, samples->capacity, sizeof *samples->location);
    *samples = (qm_samples){0};
}

/*
 * Samples and lattices with opposed normals.
 */

/** The numbers of samples whose normals agree with other normals, and of those opposed to them. */
typedef struct side_votes {
    size_t along, against;
} side_votes;

static qm_vec own_normal(const qm_samples *samples, size_t i)
{
    const float *row = samples->normals + 3 * i;
    return (qm_vec){row[0], row[1], row[2]};
}

/** The sign of a sample's normal against the normal of the lattice quad under it; 0 where it is unknown. */
static int sample_side(const qm_reconstruction *r, const qm_samples *samples, size_t i)
{
    const qm_sample_location *location = &samples->location[i];
    const qm_lattice *lattice = &r->lattices[location->patch];
    uint32_t column = (uint32_t)location->u, row = (uint32_t)location->v;
    if (column == lattice->columns) column--;
    if (row == lattice->rows) row--;
    const double *a = qm_lattice_vertex(lattice, column, row),
                 *b = qm_lattice_vertex(lattice, column + 1, row);
    const double *c = qm_lattice_vertex(lattice, column + 1, row + 1),
                 *d = qm_lattice_vertex(lattice, column, row + 1);
    qm_vec normal =
        qm_vec_cross(qm_vec_sub(qm_vec_load(c), qm_vec_load(a)), qm_vec_sub(qm_vec_load(d), qm_vec_load(b)));
    double dot = qm_vec_dot(normal, own_normal(samples, i));
    return (dot > 0.0) - (dot < 0.0);
}

/** The sign of nearly all votes, or 0. */
static int majority_side(const side_votes *votes)
{
    double all = (double)(votes->along + votes->against);
    if ((double)votes->along > MIN_MAJORITY * all) return 1;
    return (double)votes->against > MIN_MAJORITY * all ? -1 : 0;
}

/**
 * True for two samples with opposed normals on two walls: each lies behind the other, or each in front of it. Of two
 * samples of one wall, one of which has the wrong sign, one lies behind and one in front, if the wall is curved, or
 * neither if it is flat.
 */
static bool are_on_two_walls(const qm_samples *samples, size_t i, size_t j)
{
    qm_vec way = qm_vec_sub(qm_vec_load(samples->positions + 3 * j), qm_vec_load(samples->positions + 3 * i));
    return qm_vec_dot(way, own_normal(samples, i)) * qm_vec_dot(way, own_normal(samples, j)) < 0.0;
}

/** True if nearly all neighbouring samples have consistent normals. */
static bool are_consistent(const qm_samples *samples, const qm_knn_graph *graph)
{
    side_votes votes = {0};
    for (size_t i = 0; i < samples->count; i++) {
        for (int k = 0; k < QM_KNN_MAX_LINKS && graph->link[i][k] != QM_NO_INDEX; k++) {
            if (graph->link[i][k] >= samples->count) continue;
            double dot = qm_vec_dot(own_normal(samples, i), own_normal(samples, graph->link[i][k]));
            bool agrees = dot > 0.0 || (dot < 0.0 && are_on_two_walls(samples, i, graph->link[i][k]));
            votes.along += agrees;
            votes.against += dot < 0.0 && !agrees;
        }
    }
    return majority_side(&votes) > 0;
}

qm_status qm_samples_find_sides(qm_context *ctx, qm_reconstruction *r, const qm_samples *samples)
{
    qm_knn_graph graph;
    r->has_sides = false;
    if (!samples->normals) return QM_OK;
    qm_status status = qm_knn_graph_build(ctx, samples->positions, samples->count, NULL, &graph);
    if (status != QM_OK) return status;
    r->has_sides = are_consistent(samples, &graph);
    qm_knn_graph_reset(ctx, &graph);
    return QM_OK;
}

/** Keeps the links of a sample but those to samples of another wall. */
static void cut_links(const qm_samples *samples, qm_knn_graph *graph, size_t i)
{
    int kept = 0;
    for (int k = 0; k < QM_KNN_MAX_LINKS && graph->link[i][k] != QM_NO_INDEX; k++) {
        uint32_t to = graph->link[i][k];
        if (to < samples->count &&
            qm_vec_dot(own_normal(samples, i), own_normal(samples, to)) < MIN_LINK_COSINE)
            continue;
        graph->link[i][kept++] = to;
    }
    for (; kept < QM_KNN_MAX_LINKS; kept++)
        graph->link[i][kept] = QM_NO_INDEX;
}

void qm_samples_orient_graph(const qm_samples *samples, qm_knn_graph *graph)
{
    for (size_t i = 0; i < samples->count; i++)
        cut_links(samples, graph, i);
    for (size_t i = 0; i < graph->count; i++) {
        qm_vec side = {0, 0, 0};
        if (i < samples->count) side = own_normal(samples, i);
        for (int k = 0; k < QM_KNN_MAX_LINKS && graph->link[i][k] != QM_NO_INDEX && i >= samples->count; k++)
            if (graph->link[i][k] < samples->count)
                side = qm_vec_add(side, own_normal(samples, graph->link[i][k]));
        if (qm_vec_dot(graph->normal[i], side) < 0.0) graph->normal[i] = qm_vec_scale(-1.0, graph->normal[i]);
    }
}

/** True if a sample beside a sharp curve looks as the surface does beyond it. */
static bool is_across(const qm_reconstruction *r, const qm_samples *samples, size_t i)
{
    const qm_sample_location *at = &samples->location[i];
    return r->has_sides &&
           qm_vec_dot(own_normal(samples, i), qm_lattice_own_side(r, at->patch, at->u, at->v)) < 0.0;
}

/**
 * Puts the samples whose normals are opposed to their lattice onto its corner, where the fit ignores them:
 * they lie on the other side of a gap or sheet. Only in patches where nearly all samples agree, as normals
 * may be wrong. Likewise those on the other side of a sharp curve.
 */
static qm_status exclude_opposed(qm_context *ctx, const qm_reconstruction *r, qm_samples *samples)
{
    size_t patches = r->layout.patch_count;
    side_votes *votes = qm_context_alloc(ctx, patches, sizeof *votes);
    if (!votes) return no_memory(ctx);
    memset(votes, 0, patches * sizeof *votes);
    for (size_t i = 0; i < samples->count; i++) {
        int side = sample_side(r, samples, i);
        QM_ASSERT(samples->location[i].patch < patches);
        votes[samples->location[i].patch].along += side > 0;
        votes[samples->location[i].patch].against += side < 0;
    }
    for (size_t i = 0; i < samples->count; i++) {
        qm_sample_location *at = &samples->location[i];
        int majority = majority_side(&votes[at->patch]);
        bool is_opposed = majority != 0 && sample_side(r, samples, i) == -majority;
        if (is_opposed || is_across(r, samples, i)) at->u = at->v = 0.0;
    }
    qm_context_free(ctx, votes, patches, sizeof *votes);
    return QM_OK;
}

/** Projects points onto the mesh of all lattice vertices. */
static qm_status project(qm_context *ctx, const qm_reconstruction *r, const double *points, size_t count,
                         const qm_projection *projections)
{
    qm_mesh mesh;
    qm_bvh *tree = NULL;
    qm_status status = qm_lattices_mesh(ctx, r, true, &mesh);
    if (status != QM_OK) return status;
    status = qm_bvh_build(ctx, &mesh, QM_BVH_TARGET, r->options.thread_count, &tree);
    if (status == QM_OK)
        status = qm_project_points(ctx, tree, QM_QUADS_TRIANGLES, points, count, r->options.thread_count,
                                   projections);
    qm_bvh_destroy(ctx, tree);
    qm_mesh_reset(ctx, &mesh);
    return status;
}

qm_status qm_samples_distances(qm_context *ctx, const qm_reconstruction *r, const double *points,
                               size_t count, double *out)
{
    return project(ctx, r, points, count, &(const qm_projection){.distance = out});
}

qm_status qm_samples_project(qm_context *ctx, const qm_reconstruction *r, qm_samples *samples)
{
    size_t count = samples->count, patches = r->layout.patch_count;
    qm_projection projections = {.distance = qm_context_alloc(ctx, count, sizeof *projections.distance),
                                 .face = qm_context_alloc(ctx, count, sizeof *projections.face),
                                 .uv = qm_context_alloc(ctx, count, 2 * sizeof *projections.uv)};
    size_t *first = qm_context_alloc(ctx, patches, sizeof *first);
    qm_status status = QM_OK;
    if (!projections.distance || !projections.face || !projections.uv || !first) status = no_memory(ctx);
    if (status == QM_OK) status = project(ctx, r, samples->positions, count, &projections);
    if (status == QM_OK) {
        /* The locations of samples, from their projections. */
        size_t face_count = 0;
        for (size_t p = 0; p < r->layout.patch_count; p++) {
            first[p] = face_count;
            face_count += (size_t)r->lattices[p].columns * r->lattices[p].rows;
        }
        for (size_t i = 0; i < samples->count; i++) {
            size_t patch = qm_lattices_find_patch(first, r->layout.patch_count, projections.face[i]);
            uint32_t columns = r->lattices[patch].columns,
                     face = projections.face[i] - (uint32_t)first[patch];
            samples->location[i] = (qm_sample_location){.patch = (uint32_t)patch,
                                                        .u = face % columns + projections.uv[2 * i],
                                                        .v = face / columns + projections.uv[2 * i + 1],
                                                        .distance = projections.distance[i]};
        }
        samples->is_projected = true;
        if (samples->normals) status = exclude_opposed(ctx, r, samples);
    }
    qm_context_free(ctx, projections.distance, count, sizeof *projections.distance);
    qm_context_free(ctx, projections.face, count, sizeof *projections.face);
    qm_context_free(ctx, projections.uv, count, 2 * sizeof *projections.uv);
    qm_context_free(ctx, first, patches, sizeof *first);
    return status;
}
