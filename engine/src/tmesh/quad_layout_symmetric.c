/**
 * quad_layout_symmetric.c: a layout that is its own mirror image: of the half of a surface on one side of a plane, whose boundary there
 * becomes curves on the plane, and of the mirror image of it.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "layout/layout_creases.h"
#include "layout/layout_internal.h"
#include "qm/layout_edit.h"
#include "qm/quad_layout.h"

#define SNAP                                                                                                 \
    0.1 /* of the shortest edge of a vertex: when nearer to the plane it is moved there, else slivers are cut off */
#define ON_PLANE 1e-3 /* of the diagonal: curves and nodes that near to the plane belong to both sides */

#define STRAIGHT_COSINE                                                                                      \
    -0.8 /* of the angle between two sides on the plane: with less a corner of a patch is straight */

enum { POINT_SIZE = 3 * sizeof(double) };

/** The triangles of the surface, with the heights of its vertices above the plane, and the half that is being made. */
typedef struct half_maker {
    qm_context *ctx;
    const qm_mesh *surface;
    qm_vec point, normal;
    double *height;   /* of each vertex */
    double *shortest; /* edge of each vertex */
    uint32_t *number; /* of each vertex in the half; QM_NO_INDEX: none yet */
    uint64_t *cuts;   /* edges that pass through the plane, sorted: the lower vertex in the upper half */
    size_t cut_count, most_faces, most_vertices;
    qm_mesh half; /* with room for most_faces and most_vertices */
} half_maker;

/** The triangles of a face: one, or two of a quad. */
static int list_corners(const qm_mesh *mesh, size_t face, uint32_t out[2][3])
{
    const uint32_t *c = mesh->faces + 4 * face;
    memcpy(out[0], c, 3 * sizeof *c);
    if (c[3] == QM_NO_INDEX) return 1;
    const uint32_t second[3] = {c[0], c[2], c[3]};
    memcpy(out[1], second, sizeof second);
    return 2;
}

static qm_vec vertex_at(const half_maker *m, uint32_t vertex)
{
    return qm_vec_load(m->surface->positions + 3 * (size_t)vertex);
}

/** The heights of vertices, exactly 0 of those that are moved onto the plane. */
static void find_heights(half_maker *m)
{
    const qm_mesh *s = m->surface;
    for (size_t v = 0; v < s->vertex_count; v++)
        m->shortest[v] = INFINITY;
    for (size_t f = 0; f < s->face_count; f++) {
        uint32_t corner[2][3];
        int count = list_corners(s, f, corner);
        for (int i = 0; i < 3 * count; i++) {
            uint32_t a = corner[i / 3][i % 3], b = corner[i / 3][(i + 1) % 3];
            double length = qm_vec_distance(vertex_at(m, a), vertex_at(m, b));
            m->shortest[a] = fmin(m->shortest[a], length);
            m->shortest[b] = fmin(m->shortest[b], length);
        }
    }
    for (uint32_t v = 0; v < s->vertex_count; v++) {
        double height = qm_vec_dot(qm_vec_sub(vertex_at(m, v), m->point), m->normal);
        m->height[v] = fabs(height) <= SNAP * m->shortest[v] ? 0.0 : height;
    }
}

static bool is_cut(const half_maker *m, uint32_t a, uint32_t b)
{
    return (m->height[a] > 0.0 && m->height[b] < 0.0) || (m->height[a] < 0.0 && m->height[b] > 0.0);
}

static uint64_t key_of(uint32_t a, uint32_t b)
{
    return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

static int compare_keys(const void *a, const void *b)
{
    uint64_t one = *(const uint64_t *)a, other = *(const uint64_t *)b;
    return one < other ? -1 : one > other;
}

/** Lists the cut edges once each, or counts them with those that are listed again. */
static void list_cuts(half_maker *m)
{
    size_t count = 0;
    for (size_t f = 0; f < m->surface->face_count; f++) {
        uint32_t corner[2][3];
        int triangles = list_corners(m->surface, f, corner);
        for (int i = 0; i < 3 * triangles; i++) {
            uint32_t a = corner[i / 3][i % 3], b = corner[i / 3][(i + 1) % 3];
            if (!is_cut(m, a, b)) continue;
            if (m->cuts) m->cuts[count] = key_of(a, b);
            count++;
        }
    }
    if (!m->cuts) {
        m->cut_count = count;
        return;
    }
    qsort(m->cuts, count, sizeof *m->cuts, compare_keys);
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (i == 0 || m->cuts[i] != m->cuts[i - 1]) m->cuts[kept++] = m->cuts[i];
    m->cut_count = kept;
}

/** The vertex of the half for one of the surface that is not below the plane. */
static uint32_t take_vertex(half_maker *m, uint32_t vertex)
{
    if (m->number[vertex] != QM_NO_INDEX) return m->number[vertex];
    qm_vec at = vertex_at(m, vertex);
    if (m->height[vertex] == 0.0)
        at = qm_vec_axpy(at, -qm_vec_dot(qm_vec_sub(at, m->point), m->normal), m->normal);
    m->number[vertex] = (uint32_t)m->half.vertex_count;
    qm_vec_store(m->half.positions + 3 * m->half.vertex_count++, at);
    return m->number[vertex];
}

/** The vertex where an edge is cut: those of cuts are the first of the half. */
static uint32_t take_cut(const half_maker *m, uint32_t a, uint32_t b)
{
    uint64_t key = key_of(a, b);
    const uint64_t *found = bsearch(&key, m->cuts, m->cut_count, sizeof key, compare_keys);
    QM_ASSERT(found);
    return (uint32_t)(found - m->cuts);
}

/** Places the vertices of cuts. The end above the plane comes first, so that both edges along a seam are cut at one place. */
static void place_cuts(half_maker *m)
{
    for (size_t i = 0; i < m->cut_count; i++) {
        uint32_t a = (uint32_t)(m->cuts[i] >> 32), b = (uint32_t)m->cuts[i];
        if (m->height[a] < 0.0) {
            uint32_t lower = a;
            a = b;
            b = lower;
        }
        double share = m->height[a] / (m->height[a] - m->height[b]);
        qm_vec at = qm_vec_mix(vertex_at(m, a), vertex_at(m, b), share);
        qm_vec_store(m->half.positions + 3 * i, at);
    }
    m->half.vertex_count = m->cut_count;
}

/** Adds the part of a triangle that is above the plane. */
static void add_part(half_maker *m, const uint32_t corner[3])
{
    uint32_t ring[4];
    size_t count = 0;
    bool is_above = false;
    for (int k = 0; k < 3; k++)
        is_above |= m->height[corner[k]] > 0.0;
    for (int k = 0; k < 3 && is_above; k++) {
        uint32_t a = corner[k], b = corner[(k + 1) % 3];
        if (m->height[a] >= 0.0) ring[count++] = take_vertex(m, a);
        if (is_cut(m, a, b)) ring[count++] = take_cut(m, a, b);
    }
    QM_ASSERT(count <= 4);
    for (size_t k = 2; k < count; k++) {
        const uint32_t face[4] = {ring[0], ring[k - 1], ring[k], QM_NO_INDEX};
        QM_ASSERT(m->half.face_count < m->most_faces);
        memcpy(m->half.faces + 4 * m->half.face_count++, face, sizeof face);
    }
}

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for half of the surface");
}

/** Makes the half of the surface above the plane. */
static qm_status make_half(half_maker *m)
{
    const qm_mesh *s = m->surface;
    size_t vertices = s->vertex_count;
    m->height = qm_context_alloc(m->ctx, vertices, sizeof *m->height);
    m->shortest = qm_context_alloc(m->ctx, vertices, sizeof *m->shortest);
    m->number = qm_context_alloc(m->ctx, vertices, sizeof *m->number);
    if (!m->height || !m->shortest || !m->number) return no_memory(m->ctx);
    find_heights(m);
    list_cuts(m);
    if (m->cut_count > 0) {
        m->cuts = qm_context_alloc(m->ctx, m->cut_count, sizeof *m->cuts);
        if (!m->cuts) return no_memory(m->ctx);
    }
    size_t listed = m->cut_count;
    if (m->cuts) list_cuts(m);
    m->most_faces = 4 * s->face_count;
    m->most_vertices = vertices + m->cut_count;
    m->half.positions = qm_context_alloc(m->ctx, m->most_vertices, POINT_SIZE);
    m->half.faces = qm_context_alloc(m->ctx, m->most_faces, 4 * sizeof *m->half.faces);
    if (m->half.positions && m->half.faces) {
        for (size_t v = 0; v < vertices; v++)
            m->number[v] = QM_NO_INDEX;
        place_cuts(m);
        for (size_t f = 0; f < s->face_count; f++) {
            uint32_t corner[2][3];
            int count = list_corners(s, f, corner);
            for (int k = 0; k < count; k++)
                add_part(m, corner[k]);
        }
    }
    qm_context_free(m->ctx, m->cuts, listed, sizeof *m->cuts);
    if (!m->half.positions || !m->half.faces) return no_memory(m->ctx);
    if (m->half.face_count == 0)
        return qm_context_fail(m->ctx, QM_E_ARGUMENT,
                               "no part of the surface lies on the side that the normal points to");
    return QM_OK;
}

static void free_half(half_maker *m)
{
    size_t vertices = m->surface->vertex_count;
    qm_context_free(m->ctx, m->height, vertices, sizeof *m->height);
    qm_context_free(m->ctx, m->shortest, vertices, sizeof *m->shortest);
    qm_context_free(m->ctx, m->number, vertices, sizeof *m->number);
    qm_context_free(m->ctx, m->half.positions, m->most_vertices, POINT_SIZE);
    qm_context_free(m->ctx, m->half.faces, m->most_faces, 4 * sizeof *m->half.faces);
}

static bool is_on_plane(const half_maker *m, const qm_curve *curve, double reach)
{
    for (size_t k = 0; k < curve->point_count; k++)
        if (fabs(qm_vec_dot(qm_vec_sub(qm_vec_load(curve->points + 3 * k), m->point), m->normal)) > reach)
            return false;
    return true;
}

/** Lets go of the boundary of the half as a feature: the surface runs on across the plane, unless it bends there by more than the angle. */
static qm_status smooth_plane(const half_maker *m, const qm_ref_surface *surface, double crease_angle,
                              qm_layout *layout)
{
    double reach = ON_PLANE * surface->diagonal;
    for (size_t i = 0; i < layout->curve_count; i++) {
        qm_curve *curve = &layout->curves[i];
        if (curve->mark != QM_CURVE_SHARP || !is_on_plane(m, curve, reach)) continue;
        qm_ref_surface_point middle;
        qm_ref_surface_project(surface, curve->points + 3 * (curve->point_count / 2), &middle);
        /* A surface that is its own image bends by twice the angle between it and what is perpendicular to the plane. */
        double lean = fabs(qm_vec_dot(qm_vec_load(middle.normal), m->normal));
        bool bends = crease_angle > 0.0 && lean > sin(0.5 * crease_angle * QM_DEGREE);
        if (!bends) curve->mark = QM_CURVE_SMOOTH;
    }
    /* Corners are found again once both sides are there. */
    qm_status status = QM_OK;
    while (layout->corner_count > 0 && status == QM_OK)
        status = qm_layout_set_corner(m->ctx, layout, layout->corners[0], false);
    return status;
}

/** A corner of a patch that is straight: the boundary runs on there, so that two patches would share two sides once the image is added. */
typedef struct flat_corner {
    uint32_t curve[2]; /* ids: both on the plane */
} flat_corner;

/** Finds the straight corners of a patch; at most two of its four may go. */
static size_t find_flat(const half_maker *m, const qm_layout *layout, const qm_layout_patch *patch,
                        double reach, flat_corner out[2])
{
    size_t count = 0;
    for (int k = 0; k < 4 && count < 2; k++) {
        int before = (k + 3) % 4;
        const qm_curve *one = &layout->curves[patch->side[before]], *other = &layout->curves[patch->side[k]];
        qm_vec in = qm_layout_leaving_direction(one, !patch->against[before]),
               on = qm_layout_leaving_direction(other, patch->against[k]);
        if (one == other || !is_on_plane(m, one, reach) || !is_on_plane(m, other, reach) ||
            qm_layout_node_degree(layout, qm_layout_corner(layout, patch, k)) != 2 ||
            qm_vec_dot(in, on) > STRAIGHT_COSINE)
            continue;
        out[count++] = (flat_corner){{one->id, other->id}};
        k++; /* two that follow each other would leave a side without ends */
    }
    return count;
}

/** Puts what patterns have drawn onto the surface; ends of curves stay at their nodes, bit for bit. */
static void project_all(const qm_ref_surface *surface, qm_layout *layout)
{
    qm_ref_surface_point on;
    for (size_t i = 0; i < layout->node_count; i++) {
        qm_ref_surface_project(surface, layout->nodes + 3 * i, &on);
        memcpy(layout->nodes + 3 * i, on.position, POINT_SIZE);
    }
    for (size_t c = 0; c < layout->curve_count; c++)
        for (size_t k = 0; k < layout->curves[c].point_count; k++) {
            qm_ref_surface_project(surface, layout->curves[c].points + 3 * k, &on);
            memcpy(layout->curves[c].points + 3 * k, on.position, POINT_SIZE);
        }
}

/** Joins the sides at some straight corners, and fills the cells that have fewer sides then by patterns, if that leaves only patches. */
static qm_status try_straight(const half_maker *m, const qm_ref_surface *half, const flat_corner *corners,
                              size_t count, qm_layout *layout, bool *is_done)
{
    qm_context *ctx = m->ctx;
    qm_layout better;
    qm_layout_issues left = {0};
    size_t filled;
    *is_done = false;
    qm_status status = qm_layout_copy(ctx, layout, &better);
    if (status != QM_OK) return status;
    for (size_t i = 0; i < count && status == QM_OK; i++)
        status = qm_layout_merge_curves(ctx, &better, corners[i].curve[0], corners[i].curve[1]);
    if (status == QM_OK) status = qm_layout_fill(ctx, &better, half, NULL, &filled);
    if (status == QM_OK) {
        project_all(half, &better);
        status = qm_layout_find_patches(ctx, half, &better, &left);
    }
    *is_done = status == QM_OK && left.count == 0;
    if (*is_done) {
        qm_layout worse = *layout;
        *layout = better;
        better = worse;
    }
    qm_layout_issues_reset(ctx, &left);
    qm_layout_reset(ctx, &better);
    return status == QM_E_ARGUMENT ? QM_OK
                                   : status; /* curves that cannot be joined, cells without a pattern */
}

/** Straightens all such corners at once, as cells share their cuts then, else those that can be one after the other. */
static qm_status straighten(const half_maker *m, const qm_ref_surface *half, qm_layout *layout)
{
    double reach = ON_PLANE * half->diagonal;
    size_t count = 0, patches = layout->patch_count;
    flat_corner *corners = qm_context_alloc(m->ctx, 2 * patches, sizeof *corners);
    if (!corners) return no_memory(m->ctx);
    for (size_t p = 0; p < patches; p++)
        count += find_flat(m, layout, &layout->patches[p], reach, corners + count);
    bool is_done = count == 0;
    qm_status status = is_done ? QM_OK : try_straight(m, half, corners, count, layout, &is_done);
    bool is_one = false;
    for (size_t i = 0; i < count && !is_done && status == QM_OK; i++)
        status = try_straight(m, half, corners + i, 1, layout, &is_one);
    qm_context_free(m->ctx, corners, 2 * patches, sizeof *corners);
    return status;
}

/** Makes the layout of the half. */
static qm_status make_of_half(const half_maker *m, const qm_ref_surface *surface, const qm_ref_surface *half,
                              const qm_quads_options *quads, const qm_quad_layout_options *options,
                              qm_layout *layout, qm_layout_issues *issues, qm_quad_layout_facts *facts)
{
    qm_quads_options own = *quads;
    qm_quad_layout_options how = *options;
    own.quads = (quads->quads + 1) / 2;
    how.patches = (options->patches + 1) / 2;
    qm_status status =
        qm_quad_layout_make_of_surface(m->ctx, half, &own, NULL, &how, layout, issues, facts, NULL);
    qm_layout_issues_reset(m->ctx, issues);
    return status == QM_OK ? smooth_plane(m, surface, quads->crease_angle, layout) : status;
}

/** Adds the image of the half, and finds what is left. */
static qm_status add_image(const half_maker *m, const qm_ref_surface *surface, qm_layout *layout,
                           qm_layout_issues *issues)
{
    double point[3], normal[3];
    qm_vec_store(point, m->point);
    qm_vec_store(normal, m->normal);
    qm_status status = qm_layout_mirror(m->ctx, layout, surface, point, normal, ON_PLANE * surface->diagonal);
    if (status == QM_OK) status = qm_layout_find_crossings(m->ctx, layout, surface, issues);
    if (status == QM_OK) status = qm_creases_settle_curves(m->ctx, layout, surface, issues);
    qm_layout_issues_reset(m->ctx, issues);
    return status == QM_OK ? qm_layout_find_patches(m->ctx, surface, layout, issues) : status;
}

/** Makes the layout of the half, and adds its image on the whole surface: without straight corners, unless that leaves more issues. */
static qm_status make_both(half_maker *m, const qm_ref_surface *surface, const qm_quads_options *quads,
                           const qm_quad_layout_options *options, qm_layout *layout, qm_layout_issues *issues,
                           qm_quad_layout_facts *facts)
{
    qm_context *ctx = m->ctx;
    qm_bvh *bvh = NULL;
    qm_ref_surface half;
    qm_layout plain = {0};
    qm_layout_issues of_plain = {0};
    qm_status status = qm_bvh_build(ctx, &m->half, QM_BVH_TARGET, quads->thread_count, &bvh);
    if (status == QM_OK) status = qm_ref_surface_init(ctx, bvh, &half);
    if (status == QM_OK) status = make_of_half(m, surface, &half, quads, options, layout, issues, facts);
    if (status == QM_OK) status = qm_layout_copy(ctx, layout, &plain);
    if (status == QM_OK) status = straighten(m, &half, layout);
    qm_bvh_destroy(ctx, bvh);
    if (status == QM_OK) status = add_image(m, surface, layout, issues);
    if (status == QM_OK && issues->count > 0) {
        status = add_image(m, surface, &plain, &of_plain);
        if (status == QM_OK && of_plain.count < issues->count) {
            qm_layout spare = *layout;
            *layout = plain;
            plain = spare;
            qm_layout_issues left = *issues;
            *issues = of_plain;
            of_plain = left;
        }
    }
    qm_layout_reset(ctx, &plain);
    qm_layout_issues_reset(ctx, &of_plain);
    if (status == QM_OK && facts) facts->patches = layout->patch_count;
    return status;
}

qm_status qm_quad_layout_make_symmetric(qm_context *ctx, const qm_ref_surface *surface, const double point[3],
                                        const double normal[3], const qm_quads_options *quads,
                                        const qm_quad_layout_options *options, qm_layout *out,
                                        qm_layout_issues *issues, qm_quad_layout_facts *facts)
{
    QM_ASSERT(ctx && surface && point && normal && quads && options && out && issues);
    *out = (qm_layout){0};
    *issues = (qm_layout_issues){0};
    double length = qm_vec_norm(qm_vec_load(normal));
    if (!(length > 0.0) || !isfinite(length))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the plane of symmetry has no direction");
    if (surface->is_cloud) return qm_context_fail(ctx, QM_E_ARGUMENT, "a point set has no faces");
    half_maker m = {.ctx = ctx,
                    .surface = qm_bvh_mesh(surface->bvh),
                    .point = qm_vec_load(point),
                    .normal = qm_vec_scale(1.0 / length, qm_vec_load(normal))};
    qm_status status = make_half(&m);
    if (status == QM_OK) status = make_both(&m, surface, quads, options, out, issues, facts);
    free_half(&m);
    if (status != QM_OK) {
        qm_layout_reset(ctx, out);
        qm_layout_issues_reset(ctx, issues);
    }
    return status;
}
