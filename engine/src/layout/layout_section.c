/**
 * layout_section.c: where a plane cuts the surface.
 *
 * On a mesh every triangle with corners on both sides of the plane has a segment of the cut. A corner on the plane counts as
 * above it, so that each segment ends on two edges, and segments are linked by the edges that they share. On a point set the
 * cut is followed in steps along the plane and the tangent plane, each projected onto the surface.
 */
#include "layout_section.h"

#include <stdlib.h>
#include <string.h>

#include "bvh/bvh_tree.h"
#include "layout_internal.h"

#define SAME_POINT 1e-9   /* of the diagonal */
#define TOLERANCE 2e-4    /* of the diagonal: points that move a curve less are left out */
#define MAX_SEGMENT 0.015 /* of the diagonal: longer segments keep a point between their ends */
#define STEPS_ACROSS 200  /* steps of a ring of a point set over the diagonal */
#define STEPS_BETWEEN 32  /* steps of a curve of a point set over the straight distance */
#define MAX_STEPS 4096
#define PROJECTED_POINTS 33 /* of a line that is projected */

void qm_section_reset(qm_context *ctx, qm_section *line)
{
    qm_context_free(ctx, line->points, line->capacity, 3 * sizeof(double));
    *line = (qm_section){0};
}

qm_status qm_section_add(qm_context *ctx, qm_section *line, qm_vec point)
{
    if (line->count == line->capacity) {
        size_t capacity = line->capacity ? 2 * line->capacity : 64;
        double *points = qm_context_resize(ctx, line->points, line->capacity, capacity, 3 * sizeof *points);
        if (!points) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a curve");
        line->points = points;
        line->capacity = capacity;
    }
    qm_vec_store(line->points + 3 * line->count++, point);
    return QM_OK;
}

static qm_vec line_point(const qm_section *line, size_t i)
{
    return qm_vec_load(line->points + 3 * i);
}

double qm_section_length(const qm_section *line)
{
    return qm_layout_points_length(line->points, line->count);
}

qm_vec qm_section_at(const qm_section *line, double length)
{
    for (size_t i = 1; i < line->count; i++) {
        qm_vec a = line_point(line, i - 1), b = line_point(line, i);
        double segment = qm_vec_distance(a, b);
        if (length <= segment) return qm_vec_mix(a, b, segment > 0.0 ? length / segment : 0.0);
        length -= segment;
    }
    return line_point(line, line->count - 1);
}

/** Leaves out points that repeat the one before: a plane through a vertex cuts several edges there. Both ends stay. */
static void drop_repeated(double least, qm_section *line)
{
    size_t kept = 1;
    for (size_t i = 1; i < line->count; i++) {
        bool is_last = i + 1 == line->count;
        if (qm_vec_distance(line_point(line, i), line_point(line, kept - 1)) <= least) {
            if (!is_last) continue;
            kept -= kept > 1; /* the end takes the place of the point that it repeats */
        }
        memmove(line->points + 3 * kept++, line->points + 3 * i, 3 * sizeof(double));
    }
    line->count = line->count > 0 ? kept : 0;
}

/** Leaves out points by which the line moves less than the tolerance (Ramer 1972, Douglas and Peucker 1973). */
static qm_status simplify(qm_context *ctx, double diagonal, qm_section *line)
{
    drop_repeated(SAME_POINT * diagonal, line);
    if (line->count < 3) return QM_OK;
    size_t count = line->count, top = 0;
    bool *keep = qm_context_alloc(ctx, count, sizeof *keep);
    size_t(*stack)[2] = qm_context_alloc(ctx, count, sizeof *stack);
    if (keep && stack) {
        memset(keep, 0, count * sizeof *keep);
        keep[0] = keep[count - 1] = true;
        stack[top][0] = 0;
        stack[top++][1] = count - 1;
    }
    while (top > 0) {
        size_t a = stack[--top][0], b = stack[top][1], farthest = a;
        qm_vec from = line_point(line, a), to = line_point(line, b), along = qm_vec_sub(to, from);
        double length2 = qm_vec_norm2(along), most = -1.0;
        for (size_t i = a + 1; i < b; i++) {
            qm_vec d = qm_vec_sub(line_point(line, i), from);
            double t = length2 > 0.0 ? qm_clamp(qm_vec_dot(d, along) / length2, 0.0, 1.0) : 0.0;
            double away = qm_vec_norm(qm_vec_axpy(d, -t, along));
            /* Of points on the line itself, the one nearest to its middle. */
            double rank = away > TOLERANCE * diagonal ? away : -fabs(t - 0.5) - 1e-9;
            if (farthest == a || rank > most) {
                most = rank;
                farthest = i;
            }
        }
        if (farthest == a || (most <= 0.0 && length2 <= MAX_SEGMENT * MAX_SEGMENT * diagonal * diagonal))
            continue;
        keep[farthest] = true;
        stack[top][0] = a;
        stack[top++][1] = farthest;
        stack[top][0] = farthest;
        stack[top++][1] = b;
    }
    bool has_memory = keep && stack;
    if (has_memory) {
        size_t kept = 0;
        for (size_t i = 0; i < count; i++)
            if (keep[i]) memmove(line->points + 3 * kept++, line->points + 3 * i, 3 * sizeof(double));
        line->count = kept;
    }
    qm_context_free(ctx, keep, count, sizeof *keep);
    qm_context_free(ctx, stack, count, sizeof *stack);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a curve");
}

/* ---- meshes ---- */

/** Where the plane cuts a triangle: between two of its edges, each named by its vertices. */
typedef struct cut_segment {
    uint64_t edge[2];
    qm_vec at[2];
} cut_segment;

typedef struct cut {
    cut_segment *segments;
    size_t count, capacity;
    uint32_t *partner; /* of end e of segment s, at 2 s + e: the end that it meets, or QM_NO_INDEX */
} cut;

static void cut_reset(qm_context *ctx, cut *c)
{
    qm_context_free(ctx, c->segments, c->capacity, sizeof *c->segments);
    qm_context_free(ctx, c->partner, 2 * c->count, sizeof *c->partner);
    *c = (cut){0};
}

static qm_status cut_triangle(qm_context *ctx, const qm_mesh *mesh, const uint32_t vertex[3], qm_vec through,
                              qm_vec normal, cut *out)
{
    double height[3];
    for (int k = 0; k < 3; k++)
        height[k] =
            qm_vec_dot(qm_vec_sub(qm_vec_load(mesh->positions + 3 * (size_t)vertex[k]), through), normal);
    cut_segment made;
    int ends = 0;
    for (int k = 0; k < 3; k++) {
        int a = k, b = (k + 1) % 3;
        if ((height[a] >= 0.0) == (height[b] >= 0.0) || vertex[a] == vertex[b]) continue;
        if (vertex[a] > vertex[b]) { /* both triangles of an edge find the same place, bit for bit */
            a = b;
            b = k;
        }
        double t = height[a] / (height[a] - height[b]);
        made.edge[ends] = (uint64_t)vertex[a] << 32 | vertex[b];
        made.at[ends++] = qm_vec_mix(qm_vec_load(mesh->positions + 3 * (size_t)vertex[a]),
                                     qm_vec_load(mesh->positions + 3 * (size_t)vertex[b]), t);
    }
    if (ends < 2) return QM_OK;
    if (out->count == out->capacity) {
        size_t capacity = out->capacity ? 2 * out->capacity : 256;
        cut_segment *segments =
            qm_context_resize(ctx, out->segments, out->capacity, capacity, sizeof *segments);
        if (!segments) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a cut of the surface");
        out->segments = segments;
        out->capacity = capacity;
    }
    out->segments[out->count++] = made;
    return QM_OK;
}

/** An end of a segment, by the edge of the mesh that it lies on. */
typedef struct edge_end {
    uint64_t edge;
    uint32_t end;
} edge_end;

static int compare_ends(const void *a, const void *b)
{
    const edge_end *p = a, *q = b;
    if (p->edge != q->edge) return p->edge < q->edge ? -1 : 1;
    return p->end < q->end ? -1 : p->end > q->end;
}

static qm_status link_ends(qm_context *ctx, cut *c)
{
    size_t count = 2 * c->count;
    edge_end *ends = qm_context_alloc(ctx, count, sizeof *ends);
    c->partner = qm_context_alloc(ctx, count, sizeof *c->partner);
    if (ends && c->partner) {
        for (uint32_t i = 0; i < count; i++) {
            ends[i] = (edge_end){c->segments[i / 2].edge[i % 2], i};
            c->partner[i] = QM_NO_INDEX;
        }
        qsort(ends, count, sizeof *ends, compare_ends);
        for (size_t i = 0; i + 1 < count; i++) {
            if (ends[i].edge != ends[i + 1].edge) continue;
            c->partner[ends[i].end] = ends[i + 1].end;
            c->partner[ends[i + 1].end] = ends[i].end;
            i++;
        }
    }
    bool has_memory = ends && c->partner;
    qm_context_free(ctx, ends, count, sizeof *ends);
    return has_memory ? QM_OK
                      : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a cut of the surface");
}

static qm_status cut_make(qm_context *ctx, const qm_mesh *mesh, qm_vec through, qm_vec normal, cut *out)
{
    *out = (cut){0};
    qm_status status = QM_OK;
    for (size_t f = 0; f < mesh->face_count && status == QM_OK; f++) {
        const uint32_t *corner = mesh->faces + 4 * f;
        status = cut_triangle(ctx, mesh, corner, through, normal, out);
        if (corner[3] == QM_NO_INDEX || status != QM_OK) continue;
        const uint32_t second[3] = {corner[0], corner[2], corner[3]};
        status = cut_triangle(ctx, mesh, second, through, normal, out);
    }
    if (status == QM_OK && out->count > 0) status = link_ends(ctx, out);
    if (status != QM_OK) {
        out->count = out->partner ? out->count : 0;
        cut_reset(ctx, out);
    }
    return status;
}

/** The segment nearest to a place. */
static uint32_t nearest_segment(const cut *c, qm_vec p)
{
    double best = INFINITY;
    uint32_t found = QM_NO_INDEX;
    for (uint32_t i = 0; i < c->count; i++) {
        qm_vec a = c->segments[i].at[0], d = qm_vec_sub(c->segments[i].at[1], a);
        double length2 = qm_vec_norm2(d);
        double t = length2 > 0.0 ? qm_clamp(qm_vec_dot(qm_vec_sub(p, a), d) / length2, 0.0, 1.0) : 0.0;
        double away = qm_vec_distance(p, qm_vec_axpy(a, t, d));
        if (away >= best) continue;
        best = away;
        found = i;
    }
    return found;
}

/** Follows the cut out of one end of a segment up to another segment. False if it ends before. */
static qm_status follow_cut(qm_context *ctx, const cut *c, uint32_t end, uint32_t target, qm_section *out,
                            bool *is_reached)
{
    *is_reached = false;
    for (size_t step = 0; step <= c->count; step++) {
        qm_status status = qm_section_add(ctx, out, c->segments[end / 2].at[end % 2]);
        if (status != QM_OK || c->partner[end] == QM_NO_INDEX) return status;
        uint32_t entered = c->partner[end];
        if (entered / 2 == target) {
            *is_reached = true;
            return QM_OK;
        }
        end = entered ^ 1;
    }
    return QM_OK;
}

static qm_status ring_on_mesh(qm_context *ctx, const qm_ref_surface *surface, qm_vec through, qm_vec normal,
                              qm_section *out)
{
    cut c;
    qm_status status = cut_make(ctx, &surface->bvh->mesh, through, normal, &c);
    if (status != QM_OK || c.count == 0) return status;
    uint32_t start = nearest_segment(&c, through);
    bool is_closed = false;
    status = qm_section_add(ctx, out, through);
    if (status == QM_OK) status = follow_cut(ctx, &c, 2 * start, start, out, &is_closed);
    if (status == QM_OK) status = qm_section_add(ctx, out, through);
    if (!is_closed) out->count = 0;
    cut_reset(ctx, &c);
    return status;
}

/** How much a line sets out in a direction. */
static double start_along(const qm_section *line, double length, qm_vec direction)
{
    return qm_vec_dot(qm_vec_sub(qm_section_at(line, length), line_point(line, 0)), direction);
}

static qm_status between_on_mesh(qm_context *ctx, const qm_ref_surface *surface, qm_vec from, qm_vec to,
                                 qm_vec normal, qm_vec toward, qm_section *out)
{
    cut c;
    qm_status status = cut_make(ctx, &surface->bvh->mesh, from, normal, &c);
    if (status != QM_OK || c.count == 0) return status;
    uint32_t start = nearest_segment(&c, from), end = nearest_segment(&c, to);
    qm_section way[2] = {{0}, {0}};
    bool is_reached[2] = {false, false};
    for (uint32_t k = 0; k < 2 && status == QM_OK; k++) {
        status = qm_section_add(ctx, &way[k], from);
        if (status == QM_OK && start != end)
            status = follow_cut(ctx, &c, 2 * start + k, end, &way[k], &is_reached[k]);
        if (status == QM_OK) status = qm_section_add(ctx, &way[k], to);
    }
    if (status == QM_OK) {
        double length = 0.15 * qm_vec_distance(from, to);
        bool is_second = is_reached[1] && (!is_reached[0] || start_along(&way[1], length, toward) >
                                                                 start_along(&way[0], length, toward));
        if (start == end || is_reached[is_second]) {
            qm_section_reset(ctx, out);
            *out = way[is_second];
            way[is_second] = (qm_section){0};
        }
    }
    for (int k = 0; k < 2; k++)
        qm_section_reset(ctx, &way[k]);
    cut_reset(ctx, &c);
    return status;
}

/* ---- point sets ---- */

static qm_vec project(const qm_ref_surface *surface, qm_vec p, qm_vec *normal)
{
    double at[3];
    qm_ref_surface_point point;
    qm_vec_store(at, p);
    qm_ref_surface_project(surface, at, &point);
    *normal = qm_vec_load(point.normal);
    return qm_vec_load(point.position);
}

/** Steps along the cut from a place until a target is within a step. Empty if it is not reached. */
static qm_status follow_points(qm_context *ctx, const qm_ref_surface *surface, qm_vec from, qm_vec to,
                               qm_vec normal, qm_vec toward, double step, qm_section *out)
{
    qm_vec at_normal, p = project(surface, from, &at_normal), before = toward;
    qm_status status = qm_section_add(ctx, out, from);
    bool is_ring = qm_vec_equal(from, to);
    for (int k = 0; k < MAX_STEPS && status == QM_OK; k++) {
        if ((!is_ring || k > 4) && qm_vec_distance(p, to) <= step) return qm_section_add(ctx, out, to);
        qm_vec along = qm_vec_cross(normal, at_normal);
        double length = qm_vec_norm(along);
        if (!(length > 1e-3)) break;
        along = qm_vec_scale((qm_vec_dot(along, before) < 0.0 ? -1.0 : 1.0) / length, along);
        before = along;
        p = project(surface, qm_vec_axpy(p, step, along), &at_normal);
        p = qm_vec_axpy(p, -qm_vec_dot(qm_vec_sub(p, from), normal), normal);
        p = project(surface, p, &at_normal);
        status = qm_section_add(ctx, out, p);
    }
    out->count = 0;
    return status;
}

/* ---- both ---- */

qm_status qm_section_ring(qm_context *ctx, const qm_ref_surface *surface, qm_vec through, qm_vec normal,
                          qm_section *out)
{
    *out = (qm_section){0};
    qm_status status;
    if (surface->is_cloud) {
        qm_vec own, any = qm_vec_perpendicular(normal);
        project(surface, through, &own);
        any = qm_vec_norm2(own) > 0.0 ? qm_vec_cross(normal, own) : any;
        status =
            follow_points(ctx, surface, through, through, normal, any, surface->diagonal / STEPS_ACROSS, out);
    } else {
        status = ring_on_mesh(ctx, surface, through, normal, out);
    }
    if (status == QM_OK) status = simplify(ctx, surface->diagonal, out);
    if (status != QM_OK) qm_section_reset(ctx, out);
    return status;
}

/** Leaves out the points near both ends. These may lie off the surface, and the cut beside them: they would make a hook. */
static void clear_ends(qm_section *line, double near_start, double near_end)
{
    size_t first = 1, last = line->count - 1;
    qm_vec start = line_point(line, 0), end = line_point(line, last);
    while (first < last && qm_vec_distance(line_point(line, first), start) <= near_start)
        first++;
    while (last > first && qm_vec_distance(line_point(line, last - 1), end) <= near_end)
        last--;
    memmove(line->points + 3, line->points + 3 * first, (last - first) * 3 * sizeof(double));
    line->count = last - first + 2;
    qm_vec_store(line->points + 3 * (line->count - 1), end);
}

qm_status qm_section_between(qm_context *ctx, const qm_ref_surface *surface, qm_vec from, qm_vec to,
                             qm_vec inward, double tilt, qm_section *out)
{
    *out = (qm_section){0};
    qm_vec normal[2], along = qm_vec_sub(to, from);
    qm_vec start = project(surface, from, &normal[0]), end = project(surface, to, &normal[1]);
    double distance = qm_vec_norm(along);
    qm_status status = QM_OK;
    if (distance > 0.0) {
        along = qm_vec_scale(1.0 / distance, along);
        bool is_flipped = surface->is_cloud && qm_vec_dot(normal[0], normal[1]) < 0.0 &&
                          qm_vec_norm2(inward) < 0.25; /* normals without orientation */
        qm_vec up = qm_vec_axpy(qm_vec_axpy(normal[0], is_flipped ? -1.0 : 1.0, normal[1]), 2.0, inward);
        qm_vec plane = qm_vec_cross(along, up), toward = qm_vec_axpy(along, 2.0, inward);
        /* Where the normals are opposed along the line, as on the insides of two legs, no plane is better than another. */
        if (!(qm_vec_norm(plane) > 1e-3)) plane = qm_vec_perpendicular(along);
        plane = qm_vec_scale(1.0 / qm_vec_norm(plane), plane);
        plane = qm_vec_axpy(qm_vec_scale(cos(tilt), plane), sin(tilt), qm_vec_cross(along, plane));
        status = surface->is_cloud
                     ? follow_points(ctx, surface, start, end, plane, toward, distance / STEPS_BETWEEN, out)
                     : between_on_mesh(ctx, surface, start, end, plane, toward, out);
    }
    if (status == QM_OK && out->count >= 2) {
        qm_vec_store(out->points, from);
        qm_vec_store(out->points + 3 * (out->count - 1), to);
        clear_ends(out, 2.0 * qm_vec_distance(from, start), 2.0 * qm_vec_distance(to, end));
        status = simplify(ctx, surface->diagonal, out);
    }
    if (status != QM_OK) qm_section_reset(ctx, out);
    return status;
}

qm_status qm_section_project(qm_context *ctx, const qm_ref_surface *surface, qm_vec from, qm_vec to,
                             qm_section *out)
{
    *out = (qm_section){0};
    qm_status status = QM_OK;
    for (int k = 0; k < PROJECTED_POINTS && status == QM_OK; k++) {
        double t = (double)k / (PROJECTED_POINTS - 1);
        qm_vec p = qm_vec_mix(from, to, t), normal;
        status = qm_section_add(ctx, out, k == 0 || t == 1.0 ? p : project(surface, p, &normal));
    }
    if (status != QM_OK) qm_section_reset(ctx, out);
    return status;
}
