/**
 * mesh_facts.c: counts of a mesh that need no geometry.
 *
 * All facts about edges and fans come from the links of the vertices. The link of a vertex v is a graph: its
 * nodes are the neighbours of v, and every face at v adds one line, from the corner before v to the corner
 * after it. The degree of a node n is the number of faces on the edge (v, n), and the faces around v form one
 * fan when the link is connected and no degree exceeds two. A counting sort groups the lines by vertex, so
 * the cost is linear but for the short paths of the union-find.
 *
 * A face that repeats a vertex counts as its face ring (face_ring.h): a quad with two equal adjacent corners
 * is a triangle, and a face with fewer than three distinct corners, or one that folds back on itself, has no
 * edges. So a triangle that was collapsed to a segment does not separate its two neighbours.
 */
#include <string.h>

#include "core/face_ring.h"

#define CANCEL_STRIDE 65536

/** The two corners next to a vertex in one of its faces. */
typedef struct link_line {
    uint32_t before, after;
} link_line;

typedef struct facts_work {
    size_t vertex_count;
    uint32_t *component; /* union-find over the vertices, by shared faces; QM_NO_INDEX: not used by a face */
    size_t *start;       /* vertex_count + 1: where the lines of each vertex begin */
    link_line *lines;
    size_t line_count;
    bool *has_other; /* the vertex is a corner of a face that is not a quad */
    /* Of the nodes of the current link: valid for n where seen[n] is the current vertex. */
    uint32_t *seen, *degree, *group;
} facts_work;

/** Facts from the link of one vertex. */
typedef struct link_facts {
    size_t nodes, groups;
    size_t open_nodes, crowded_nodes;         /* of degree 1; of degree 3 or more */
    size_t boundary_edges, nonmanifold_edges; /* to vertices of higher index, to count each edge once */
} link_facts;

static bool work_alloc(qm_context *ctx, facts_work *work, size_t vertex_count)
{
    size_t n = vertex_count;
    *work = (facts_work){.vertex_count = n};
    work->component = qm_context_alloc(ctx, n, sizeof *work->component);
    work->start = qm_context_alloc(ctx, n + 1, sizeof *work->start);
    work->has_other = qm_context_alloc(ctx, n, sizeof *work->has_other);
    work->seen = qm_context_alloc(ctx, n, sizeof *work->seen);
    work->degree = qm_context_alloc(ctx, n, sizeof *work->degree);
    work->group = qm_context_alloc(ctx, n, sizeof *work->group);
    if (!work->component || !work->start || !work->has_other || !work->seen || !work->degree || !work->group)
        return false;
    memset(work->component, 0xff, n * sizeof *work->component);
    memset(work->start, 0, (n + 1) * sizeof *work->start);
    memset(work->has_other, 0, n * sizeof *work->has_other);
    memset(work->seen, 0xff, n * sizeof *work->seen);
    return true;
}

static uint32_t find_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

/** Joins two components; true when they were separate. */
static bool join(uint32_t *parent, uint32_t i, uint32_t j)
{
    i = find_root(parent, i);
    j = find_root(parent, j);
    if (i == j) return false;
    if (i < j)
        parent[j] = i;
    else
        parent[i] = j;
    return true;
}

/** True when the face is part of a polygon: a neighbour in the list has its index in the input. */
static bool is_fan_part(const qm_mesh *mesh, size_t face)
{
    const uint32_t *origin = mesh->face_origin;
    if (!origin) return false;
    return (face > 0 && origin[face - 1] == origin[face]) ||
           (face + 1 < mesh->face_count && origin[face + 1] == origin[face]);
}

/** First pass over the faces: facts of single faces, components, and the number of lines at each vertex. */
static qm_status scan_faces(qm_context *ctx, const qm_mesh *mesh, facts_work *work, qm_mesh_facts *facts)
{
    for (size_t f = 0; f < mesh->face_count; ++f) {
        if (f % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "canceled while the faces were counted");
        const uint32_t *face = mesh->faces + 4 * f;
        int count = qm_face_corners(face);
        if (!is_fan_part(mesh, f)) ++*(count == 3 ? &facts->triangles : &facts->quads);
        facts->repeated_corner_faces += qm_face_repeats_vertex(face, count);
        /* The vertices of a face are used, and are one component. */
        for (int i = 0; i < qm_face_corners(face); ++i) {
            if (work->component[face[i]] == QM_NO_INDEX) work->component[face[i]] = face[i];
            join(work->component, face[0], face[i]);
        }

        uint32_t ring[4];
        int ring_count = qm_face_ring(face, ring);
        for (int i = 0; i < ring_count; ++i)
            ++work->start[ring[i]];
        work->line_count += (size_t)ring_count;
        for (int i = 0; i < count && ring_count != 4; ++i)
            work->has_other[face[i]] = true;
    }
    return QM_OK;
}

/** Second pass: a prefix sum over the numbers of lines, then each line goes to the group of its vertex. */
static qm_status group_lines(qm_context *ctx, const qm_mesh *mesh, facts_work *work)
{
    work->lines = qm_context_alloc(ctx, work->line_count, sizeof *work->lines);
    if (!work->lines && work->line_count > 0)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the edges of %zu faces",
                               mesh->face_count);
    size_t end = 0;
    for (size_t v = 0; v <= work->vertex_count; ++v) {
        end += work->start[v];
        work->start[v] = end;
    }
    /* Filling backwards moves each start from the end of its vertex's lines to their beginning. */
    for (size_t f = mesh->face_count; f-- > 0;) {
        if (f % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "canceled while the edges were gathered");
        uint32_t ring[4];
        int count = qm_face_ring(mesh->faces + 4 * f, ring);
        for (int i = 0; i < count; ++i)
            work->lines[--work->start[ring[i]]] =
                (link_line){ring[(i + count - 1) % count], ring[(i + 1) % count]};
    }
    return QM_OK;
}

/** Counts one end of a line at its node; a node of the current link starts as a component of its own. */
static void touch_node(facts_work *work, uint32_t v, uint32_t node, link_facts *link)
{
    if (work->seen[node] != v) {
        work->seen[node] = v;
        work->degree[node] = 0;
        work->group[node] = node;
        ++link->nodes;
        ++link->groups;
    }
    ++work->degree[node];
}

/** Classifies a node of the finished link, once: its degree is reset to zero. */
static void classify_node(facts_work *work, uint32_t v, uint32_t node, link_facts *link)
{
    uint32_t degree = work->degree[node];
    work->degree[node] = 0;
    if (degree == 1) {
        ++link->open_nodes;
        link->boundary_edges += v < node;
    } else if (degree >= 3) {
        ++link->crowded_nodes;
        link->nonmanifold_edges += v < node;
    }
}

static qm_status scan_vertices(qm_context *ctx, facts_work *work, qm_mesh_facts *facts)
{
    for (uint32_t v = 0; v < work->vertex_count; ++v) {
        if (v % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "canceled while the edges were counted");
        facts->unused_vertices += work->component[v] == QM_NO_INDEX;
        facts->components += work->component[v] == v;
        if (work->start[v] == work->start[v + 1]) continue;

        link_facts link = {0};
        const link_line *first = work->lines + work->start[v], *end = work->lines + work->start[v + 1];
        for (const link_line *line = first; line < end; ++line) {
            touch_node(work, v, line->before, &link);
            touch_node(work, v, line->after, &link);
            link.groups -= join(work->group, line->before, line->after);
        }
        QM_ASSERT(link.groups <= link.nodes);
        for (const link_line *line = first; line < end; ++line) {
            classify_node(work, v, line->before, &link);
            classify_node(work, v, line->after, &link);
        }
        facts->boundary_edges += link.boundary_edges;
        facts->nonmanifold_edges += link.nonmanifold_edges;
        bool is_fan = link.groups == 1 && link.crowded_nodes == 0;
        if (!is_fan) facts->manifold = false;
        if (is_fan && link.open_nodes == 0 && !work->has_other[v] && link.nodes != 4)
            ++facts->irregular_vertices;
    }
    return QM_OK;
}

qm_status qm_mesh_find_facts(qm_context *ctx, const qm_mesh *mesh, qm_mesh_facts *out)
{
    QM_ASSERT(ctx && mesh && out);
    *out = (qm_mesh_facts){.polygons = mesh->polygon_count, .manifold = mesh->face_count > 0};
    if (mesh->face_count == 0) return QM_OK;

    facts_work work;
    qm_status status = QM_OK;
    if (!work_alloc(ctx, &work, mesh->vertex_count))
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the edges at %zu vertices",
                                 mesh->vertex_count);
    if (status == QM_OK) status = scan_faces(ctx, mesh, &work, out);
    if (status == QM_OK) status = group_lines(ctx, mesh, &work);
    if (status == QM_OK) status = scan_vertices(ctx, &work, out);
    size_t n = work.vertex_count;
    qm_context_free(ctx, work.component, n, sizeof *work.component);
    qm_context_free(ctx, work.start, n + 1, sizeof *work.start);
    qm_context_free(ctx, work.lines, work.line_count, sizeof *work.lines);
    qm_context_free(ctx, work.has_other, n, sizeof *work.has_other);
    qm_context_free(ctx, work.seen, n, sizeof *work.seen);
    qm_context_free(ctx, work.degree, n, sizeof *work.degree);
    qm_context_free(ctx, work.group, n, sizeof *work.group);
    return status;
}
