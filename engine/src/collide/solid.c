/**
 * solid.c: whether a surface bounds a solid. An edge is counted at its vertex of lower index: how many faces it has, and how
 * many of them run from there to the other end, less those that run back. A face that repeats a corner counts by its sides as they
 * are: those that it runs through both ways cancel.
 */
#include "qm/solid.h"

#include <string.h>

#include "bvh/winding.h"
#include "collide_search.h"
#include "core/face_ring.h"

#define PATCH_TOLERANCE 1e-9 /* of the diagonal: patches nearer than that may count as meeting */
#define CANCEL_STRIDE 0x10000

/** A side of a face, as seen from its end of lower index. */
typedef struct face_side {
    uint32_t other; /* end */
    int32_t turn;   /* 1: it runs there, -1: it comes from there */
} face_side;

typedef struct edge_work {
    const qm_mesh *mesh;
    size_t *start; /* vertex_count + 1: where the sides of each vertex begin */
    face_side *sides;
    uint32_t *count; /* of each vertex, as the other end of an edge: faces, */
    int32_t *turn;   /* and their sum */
} edge_work;

/** Sorts the sides of all faces by their ends of lower index. */
static qm_status sort_sides(qm_context *ctx, edge_work *work)
{
    const qm_mesh *mesh = work->mesh;
    memset(work->start, 0, (mesh->vertex_count + 1) * sizeof *work->start);
    for (int pass = 0; pass < 2; pass++) {
        for (size_t f = 0; f < mesh->face_count; f++) {
            const uint32_t *face = mesh->faces + 4 * f;
            int corners = qm_face_corners(face);
            if (f % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
                return qm_context_fail(ctx, QM_E_CANCELED, "canceled while the edges were counted");
            for (int i = 0; i < corners; i++) {
                uint32_t from = face[i], to = face[(i + 1) % corners];
                uint32_t low = from < to ? from : to, high = from < to ? to : from;
                if (from == to) continue;
                if (pass == 0)
                    work->start[low]++;
                else
                    work->sides[--work->start[low]] = (face_side){high, from < to ? 1 : -1};
            }
        }
        /* Sums after the first pass are the ends of the groups, which the second one fills backwards. */
        for (size_t v = 0, end = 0; pass == 0 && v <= mesh->vertex_count; v++)
            work->start[v] = end += work->start[v];
    }
    return QM_OK;
}

static void note_edge(qm_solid *out, qm_solid_fault fault, uint32_t low, uint32_t high)
{
    /* Vertices come in order, the other ends of a vertex do not. */
    if (out->edge_count == 0 || (out->edge[0] == low && high < out->edge[1])) {
        out->edge[0] = low;
        out->edge[1] = high;
    }
    out->fault = fault;
    out->edge_count++;
}

/** Counts the edges of all vertices with a fault of each kind. */
static void count_edges(const edge_work *work, qm_solid *open, qm_solid *turned)
{
    for (uint32_t v = 0; v < work->mesh->vertex_count; v++) {
        const face_side *begin = work->sides + work->start[v], *end = work->sides + work->start[v + 1];
        for (const face_side *side = begin; side < end; side++) {
            work->count[side->other]++;
            work->turn[side->other] += side->turn;
        }
        for (const face_side *side = begin; side < end; side++) {
            uint32_t faces = work->count[side->other];
            int32_t turn = work->turn[side->other];
            work->count[side->other] = 0;
            work->turn[side->other] = 0;
            if (turn != 0)
                note_edge(faces % 2 != 0 ? open : turned, faces % 2 != 0 ? QM_SOLID_OPEN : QM_SOLID_TURNED, v,
                          side->other);
        }
    }
}

/** Looks for edges that are open, or have neighbours oriented against one another. */
static qm_status check_edges(qm_context *ctx, const qm_mesh *mesh, qm_solid *out)
{
    size_t vertices = mesh->vertex_count, sides = 4 * mesh->face_count;
    edge_work work = {.mesh = mesh,
                      .start = qm_context_alloc(ctx, vertices + 1, sizeof *work.start),
                      .sides = qm_context_alloc(ctx, sides, sizeof *work.sides),
                      .count = qm_context_alloc(ctx, vertices, sizeof *work.count),
                      .turn = qm_context_alloc(ctx, vertices, sizeof *work.turn)};
    qm_status status = work.start && work.sides && work.count && work.turn
                           ? QM_OK
                           : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the edges");
    if (status == QM_OK) status = sort_sides(ctx, &work);
    if (status == QM_OK) {
        qm_solid open = {0}, turned = {0};
        memset(work.count, 0, vertices * sizeof *work.count);
        memset(work.turn, 0, vertices * sizeof *work.turn);
        count_edges(&work, &open, &turned);
        *out = open.edge_count > 0 ? open : turned;
    }
    qm_context_free(ctx, work.start, vertices + 1, sizeof *work.start);
    qm_context_free(ctx, work.sides, sides, sizeof *work.sides);
    qm_context_free(ctx, work.count, vertices, sizeof *work.count);
    qm_context_free(ctx, work.turn, vertices, sizeof *work.turn);
    return status;
}

static qm_status check_crossings(qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading,
                                 int thread_count, qm_solid *out)
{
    qm_collide_options options = qm_collide_options_default();
    qm_box box = qm_mesh_bounding_box(&bvh->mesh);
    double diagonal = qm_mesh_box_diagonal(&box);
    options.quads = reading;
    options.mode = QM_COLLIDE_ANY;
    options.tolerance = diagonal > 0.0 ? PATCH_TOLERANCE * diagonal : 1.0;
    if (!(options.tolerance > 0.0)) options.tolerance = diagonal;
    options.thread_count = thread_count;
    qm_collision found;
    qm_status status = qm_collide_self(ctx, bvh, &options, NULL, &found);
    if (status != QM_OK) return status;
    if (found.pair_count > 0) {
        out->fault = QM_SOLID_CROSSING;
        out->faces = found.pairs[0];
    }
    qm_collide_reset(ctx, &found);
    return QM_OK;
}

qm_status qm_solid_check(qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading, int thread_count,
                         qm_solid *out)
{
    QM_ASSERT(ctx && bvh && out);
    *out = (qm_solid){.fault = QM_SOLID_EMPTY};
    if (bvh->mesh.face_count == 0) return QM_OK;
    *out = (qm_solid){.fault = QM_SOLID_PROVEN};
    qm_status status = check_edges(ctx, &bvh->mesh, out);
    if (status == QM_OK && out->fault == QM_SOLID_PROVEN)
        status = check_crossings(ctx, bvh, reading, thread_count, out);
    return status;
}

qm_status qm_solid_require(qm_context *ctx, const qm_solid *solid, const char *mesh_name)
{
    switch (solid->fault) {
    case QM_SOLID_PROVEN:
        return QM_OK;
    case QM_SOLID_EMPTY:
        return qm_context_fail(ctx, QM_E_NOT_CLOSED, "mesh %s is a point set, which has no inside",
                               mesh_name);
    case QM_SOLID_OPEN:
        return qm_context_fail(
            ctx, QM_E_NOT_CLOSED, "mesh %s is open: %zu boundary edge%s, one from vertex %u to %u", mesh_name,
            solid->edge_count, solid->edge_count == 1 ? "" : "s", solid->edge[0], solid->edge[1]);
    case QM_SOLID_TURNED:
        return qm_context_fail(
            ctx, QM_E_NOT_CLOSED,
            "mesh %s is not consistently oriented: neighbours run the same way along %zu edge%s, one "
            "from vertex %u to %u",
            mesh_name, solid->edge_count, solid->edge_count == 1 ? "" : "s", solid->edge[0], solid->edge[1]);
    case QM_SOLID_CROSSING:
        break;
    }
    return qm_context_fail(ctx, QM_E_NOT_CLOSED, "mesh %s meets itself: its faces %u and %u do", mesh_name,
                           solid->faces.a, solid->faces.b);
}

int qm_solid_winding(const qm_bvh *bvh, qm_quad_reading reading, const double point[3])
{
    return qm_winding_number(bvh, reading, QM_WINDING_WORLD, qm_vec_load(point));
}

/* ---- two solids ---- */

/** The least vertex of the component of a vertex, by links to lesser ones. */
static uint32_t find_least(uint32_t *link, uint32_t vertex)
{
    while (link[vertex] != vertex)
        vertex = link[vertex] = link[link[vertex]];
    return vertex;
}

/** Counts the components of a mesh, by shared vertices, and those that are inside of another one. */
static qm_status count_inside(qm_context *ctx, const qm_bvh *of, const qm_bvh *other, qm_quad_reading reading,
                              size_t *components, size_t *inside)
{
    const qm_mesh *mesh = &of->mesh;
    uint32_t *link = qm_context_alloc(ctx, mesh->vertex_count, sizeof *link);
    if (!link) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the components");
    memset(link, 0xff, mesh->vertex_count * sizeof *link);
    for (size_t i = 0; i < 4 * mesh->face_count; i++) {
        uint32_t vertex = mesh->faces[i], first = mesh->faces[i & ~(size_t)3];
        if (vertex == QM_NO_INDEX) continue;
        if (link[vertex] == QM_NO_INDEX) link[vertex] = vertex;
        uint32_t a = find_least(link, first), b = find_least(link, vertex);
        link[a > b ? a : b] = a > b ? b : a;
    }
    *components = *inside = 0;
    qm_status status = QM_OK;
    for (uint32_t v = 0; status == QM_OK && v < mesh->vertex_count; v++) {
        if (link[v] != v) continue;
        *components += 1;
        *inside += qm_solid_winding(other, reading, mesh->positions + 3 * (size_t)v) != 0;
        if (qm_context_canceled(ctx))
            status = qm_context_fail(ctx, QM_E_CANCELED, "canceled between two components");
    }
    qm_context_free(ctx, link, mesh->vertex_count, sizeof *link);
    return status;
}

qm_status qm_solid_relate(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, qm_quad_reading reading,
                          qm_relation *out)
{
    QM_ASSERT(ctx && a && b && out);
    size_t a_count, a_inside, b_count, b_inside;
    qm_status status = qm_collide_check_scale(ctx, a, b);
    if (status == QM_OK) status = count_inside(ctx, a, b, reading, &a_count, &a_inside);
    if (status == QM_OK) status = count_inside(ctx, b, a, reading, &b_count, &b_inside);
    if (status != QM_OK) return status;
    *out = a_inside == 0 && b_inside == 0         ? QM_RELATION_APART
           : a_inside == a_count && b_inside == 0 ? QM_RELATION_A_INSIDE_B
           : b_inside == b_count && a_inside == 0 ? QM_RELATION_B_INSIDE_A
                                                  : QM_RELATION_OVERLAPPING;
    return QM_OK;
}
