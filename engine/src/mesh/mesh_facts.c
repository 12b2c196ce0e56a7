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
#include "core/union_find.h"

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
    bool *has_other;  /* the vertex is a corner of a face that is not a quad */
    bool *is_crowded; /* the vertex may be one of a duplicate face */
    bool has_crowded;
    uint32_t *loop; /* union-find over the vertices, by boundary edges; QM_NO_INDEX: on none */
    /* Of the nodes of the current link: valid for n where seen[n] is the current vertex. */
    uint32_t *seen, *degree, *group;
} facts_work;

/**
 * A degree is kept in units of FACE, plus one for each face that runs from the vertex to the node: that tells, of an
 * edge with two faces, whether they run through it in opposite directions, ONE_WAY_EACH. With three faces two run
 * the same way.
 */
enum { FACE = 4, ONE_WAY_EACH = 2 * FACE + 1, CROWDED = 3 * FACE };

/** Facts from the link of one vertex. */
typedef struct link_facts {
    size_t nodes, groups;
    size_t open_nodes, crowded_nodes; /* of degree 1; of degree 3 or more */
} link_facts;

static bool work_alloc(qm_context *ctx, facts_work *work, size_t vertex_count)
{
    size_t n = vertex_count;
    *work = (facts_work){.vertex_count = n};
    work->component = qm_context_alloc(ctx, n, sizeof *work->component);
    work->start = qm_context_alloc(ctx, n + 1, sizeof *work->start);
    work->has_other = qm_context_alloc(ctx, n, sizeof *work->has_other);
    work->is_crowded = qm_context_alloc(ctx, n, sizeof *work->is_crowded);
    work->loop = qm_context_alloc(ctx, n, sizeof *work->loop);
    work->seen = qm_context_alloc(ctx, n, sizeof *work->seen);
    work->degree = qm_context_alloc(ctx, n, sizeof *work->degree);
    work->group = qm_context_alloc(ctx, n, sizeof *work->group);
    if (!work->component || !work->start || !work->has_other || !work->is_crowded || !work->loop ||
        !work->seen || !work->degree || !work->group)
        return false;
    memset(work->component, 0xff, n * sizeof *work->component);
    memset(work->start, 0, (n + 1) * sizeof *work->start);
    memset(work->has_other, 0, n * sizeof *work->has_other);
    memset(work->is_crowded, 0, n * sizeof *work->is_crowded);
    memset(work->loop, 0xff, n * sizeof *work->loop);
    memset(work->seen, 0xff, n * sizeof *work->seen);
    return true;
}

/** First pass over the faces: facts of single faces, components, and the number of lines at each vertex. */
static qm_status scan_faces(qm_context *ctx, const qm_mesh *mesh, facts_work *work, qm_mesh_facts *facts)
{
    for (size_t f = 0; f < mesh->face_count; ++f) {
        if (f % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "canceled while the faces were counted");
        const uint32_t *face = mesh->faces + 4 * f;
        int count = qm_face_corners(face);
        if (!qm_face_is_fan_part(mesh, f)) ++*(count == 3 ? &facts->triangles : &facts->quads);
        facts->repeated_corner_faces += qm_face_repeats_vertex(face, count);
        /* The vertices of a face are used, and are one component. */
        for (int i = 0; i < qm_face_corners(face); ++i) {
            if (work->component[face[i]] == QM_NO_INDEX) work->component[face[i]] = face[i];
            qm_union_find_join(work->component, face[0], face[i]);
        }

        uint32_t ring[4];
        int ring_count = qm_face_ring(face, ring);
        for (int i = 0; i < ring_count; ++i)
            ++work->start[ring[i]];
        work->line_count += (size_t)ring_count;
        facts->euler_number += ring_count > 0;
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
static void touch_node(facts_work *work, uint32_t v, uint32_t node, uint32_t direction, link_facts *link)
{
    if (work->seen[node] != v) {
        work->seen[node] = v;
        work->degree[node] = 0;
        work->group[node] = node;
        ++link->nodes;
        ++link->groups;
    }
    work->degree[node] += FACE + direction;
}

/** Puts a vertex on a boundary loop, at first one of its own. */
static void begin_loop(facts_work *work, uint32_t v, qm_mesh_facts *facts)
{
    if (work->loop[v] != QM_NO_INDEX) return;
    work->loop[v] = v;
    ++facts->boundary_loops;
}

/** Classifies a node of the finished link, once: its degree is reset to zero. The edge to it is counted at its vertex
 * of lower index. */
static void classify_node(facts_work *work, uint32_t v, uint32_t node, link_facts *link, qm_mesh_facts *facts)
{
    uint32_t degree = work->degree[node];
    if (degree == 0) return;
    work->degree[node] = 0;
    bool is_open = degree < 2 * FACE, is_crowded = degree >= CROWDED;
    link->open_nodes += is_open;
    link->crowded_nodes += is_crowded;
    if (v > node) return;
    ++facts->edges;
    facts->boundary_edges += is_open;
    facts->nonmanifold_edges += is_crowded;
    if (!is_open && degree != ONE_WAY_EACH) facts->winding_consistent = false;
    if (!is_open) return;
    begin_loop(work, v, facts);
    begin_loop(work, node, facts);
    facts->boundary_loops -= qm_union_find_join(work->loop, v, node);
}

static qm_status scan_vertices(qm_context *ctx, facts_work *work, qm_mesh_facts *facts)
{
    for (uint32_t v = 0; v < work->vertex_count; ++v) {
        if (v % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "canceled while the edges were counted");
        facts->unused_vertices += work->component[v] == QM_NO_INDEX;
        facts->components += work->component[v] == v;
        if (work->start[v] == work->start[v + 1]) continue;
        ++facts->euler_number;

        link_facts link = {0};
        const link_line *first = work->lines + work->start[v], *end = work->lines + work->start[v + 1];
        for (const link_line *line = first; line < end; ++line) {
            touch_node(work, v, line->before, 0, &link);
            touch_node(work, v, line->after, 1, &link);
            link.groups -= qm_union_find_join(work->group, line->before, line->after);
        }
        QM_ASSERT(link.groups <= link.nodes);
        for (const link_line *line = first; line < end; ++line) {
            classify_node(work, v, line->before, &link, facts);
            classify_node(work, v, line->after, &link, facts);
        }
        bool is_fan = link.groups == 1 && link.crowded_nodes == 0;
        if (!is_fan) facts->manifold = false;
        /* Two equal faces add a line between the same two nodes each: a fan has such lines only when it is the two. */
        work->is_crowded[v] = !is_fan || (link.nodes == 2 && link.open_nodes == 0);
        work->has_crowded |= work->is_crowded[v];
        if (is_fan && link.open_nodes == 0 && !work->has_other[v] && link.nodes != 4)
            ++facts->irregular_vertices;
    }
    return QM_OK;
}

/* ---- duplicate faces ---- */

/** A face by its vertices, in an order that depends neither on where its list starts nor on its direction. */
typedef struct face_key {
    uint32_t vertex[4]; /* the fourth of a triangle is vertex_count, which sorts as one more vertex */
    uint32_t face;
} face_key;

typedef struct duplicates {
    face_key *keys; /* of the faces whose vertices are all crowded, by face */
    uint32_t *order, *spare;
    size_t count;
} duplicates;

/** Makes the key of a face; false when the face is no candidate. */
static bool make_key(const facts_work *work, const uint32_t face[4], face_key *out)
{
    uint32_t ring[4];
    int count = qm_face_ring(face, ring), first = 0;
    for (int i = 0; i < count; ++i) {
        if (!work->is_crowded[ring[i]]) return false;
        if (ring[i] < ring[first]) first = i;
    }
    if (count == 0) return false;
    bool is_reversed = ring[(first + count - 1) % count] < ring[(first + 1) % count];
    out->vertex[3] = (uint32_t)work->vertex_count;
    for (int i = 0; i < count; ++i)
        out->vertex[i] = ring[(first + (is_reversed ? count - i : i)) % count];
    return true;
}

/** Lists the candidates; their arrays are for free_duplicates also after an error. */
static qm_status list_candidates(qm_context *ctx, const qm_mesh *mesh, const facts_work *work,
                                 duplicates *out)
{
    face_key key;
    *out = (duplicates){0};
    for (size_t f = 0; f < mesh->face_count; ++f)
        out->count += make_key(work, mesh->faces + 4 * f, &key);
    if (out->count == 0) return QM_OK;
    out->keys = qm_context_alloc(ctx, out->count, sizeof *out->keys);
    out->order = qm_context_alloc(ctx, out->count, sizeof *out->order);
    out->spare = qm_context_alloc(ctx, out->count, sizeof *out->spare);
    if (!out->keys || !out->order || !out->spare)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for %zu faces with crowded edges",
                               out->count);
    size_t i = 0;
    for (size_t f = 0; f < mesh->face_count; ++f)
        if (make_key(work, mesh->faces + 4 * f, &key)) {
            key.face = (uint32_t)f;
            out->keys[i] = key;
            out->order[i] = (uint32_t)i;
            ++i;
        }
    return QM_OK;
}

/** Sorts the order by the keys: a counting sort by each vertex, the last one first; the starts of the lines are not
 * needed any more and count. */
static qm_status sort_candidates(qm_context *ctx, facts_work *work, duplicates *d)
{
    for (int column = 3; column >= 0; --column) {
        if (qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "canceled while duplicate faces were counted");
        memset(work->start, 0, (work->vertex_count + 1) * sizeof *work->start);
        for (size_t i = 0; i < d->count; ++i)
            ++work->start[d->keys[i].vertex[column]];
        size_t end = 0;
        for (size_t v = 0; v <= work->vertex_count; ++v) {
            end += work->start[v];
            work->start[v] = end;
        }
        for (size_t i = d->count; i-- > 0;)
            d->spare[--work->start[d->keys[d->order[i]].vertex[column]]] = d->order[i];
        uint32_t *sorted = d->spare;
        d->spare = d->order;
        d->order = sorted;
    }
    return QM_OK;
}

/** Counts faces of the input that have one of the keys before, or a part that has. */
static size_t count_sorted(const qm_mesh *mesh, duplicates *d)
{
    /* The sort is stable: of equal faces the first one leads. spare holds a mark of each candidate. */
    memset(d->spare, 0, d->count * sizeof *d->spare);
    for (size_t i = 1; i < d->count; ++i)
        d->spare[d->order[i]] =
            memcmp(d->keys[d->order[i]].vertex, d->keys[d->order[i - 1]].vertex, sizeof d->keys->vertex) == 0;
    size_t count = 0;
    uint32_t last = QM_NO_INDEX;
    for (size_t i = 0; i < d->count; ++i) {
        uint32_t face = qm_mesh_input_face(mesh, d->keys[i].face);
        if (!d->spare[i] || face == last) continue;
        ++count;
        last = face;
    }
    return count;
}

static qm_status count_duplicates(qm_context *ctx, const qm_mesh *mesh, facts_work *work,
                                  qm_mesh_facts *facts)
{
    duplicates d;
    qm_status status = list_candidates(ctx, mesh, work, &d);
    if (status == QM_OK && d.count > 1) status = sort_candidates(ctx, work, &d);
    if (status == QM_OK && d.count > 1) facts->duplicate_faces = count_sorted(mesh, &d);
    qm_context_free(ctx, d.keys, d.count, sizeof *d.keys);
    qm_context_free(ctx, d.order, d.count, sizeof *d.order);
    qm_context_free(ctx, d.spare, d.count, sizeof *d.spare);
    return status;
}

/** Components by the edges of faces alone: a face that is left without edges may join others. */
static size_t count_surfaces(const qm_mesh *mesh, facts_work *work)
{
    size_t count = 0;
    memset(work->component, 0xff, work->vertex_count * sizeof *work->component);
    for (size_t f = 0; f < mesh->face_count; ++f) {
        uint32_t ring[4];
        int ring_count = qm_face_ring(mesh->faces + 4 * f, ring);
        for (int i = 0; i < ring_count; ++i) {
            if (work->component[ring[i]] == QM_NO_INDEX) {
                work->component[ring[i]] = ring[i];
                ++count;
            }
            count -= qm_union_find_join(work->component, ring[0], ring[i]);
        }
    }
    return count;
}

/** What follows from the counts. */
static void conclude(const qm_mesh *mesh, facts_work *work, qm_mesh_facts *facts)
{
    facts->euler_number -= (ptrdiff_t)facts->edges;
    facts->watertight = facts->edges > 0 && facts->boundary_edges == 0 && facts->nonmanifold_edges == 0;
    facts->winding_consistent &= facts->edges > 0;
    /* A closed orientable surface of c components has the Euler number 2 c - 2 g. */
    if (facts->manifold && facts->watertight && facts->winding_consistent) {
        size_t surfaces = facts->repeated_corner_faces > 0 ? count_surfaces(mesh, work) : facts->components;
        ptrdiff_t twice = 2 * (ptrdiff_t)surfaces - facts->euler_number;
        QM_ASSERT(twice >= 0 && twice % 2 == 0);
        facts->genus = (size_t)twice / 2;
    }
}

qm_status qm_mesh_find_facts(qm_context *ctx, const qm_mesh *mesh, qm_mesh_facts *out)
{
    QM_ASSERT(ctx && mesh && out);
    *out = (qm_mesh_facts){.polygons = mesh->polygon_count,
                           .manifold = mesh->face_count > 0,
                           .winding_consistent = true,
                           .genus = QM_NO_GENUS};
    if (mesh->face_count == 0) {
        out->winding_consistent = false;
        return QM_OK;
    }

    facts_work work;
    qm_status status = QM_OK;
    if (!work_alloc(ctx, &work, mesh->vertex_count))
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the edges at %zu vertices",
                                 mesh->vertex_count);
    if (status == QM_OK) status = scan_faces(ctx, mesh, &work, out);
    if (status == QM_OK) status = group_lines(ctx, mesh, &work);
    if (status == QM_OK) status = scan_vertices(ctx, &work, out);
    if (status == QM_OK && work.has_crowded) status = count_duplicates(ctx, mesh, &work, out);
    if (status == QM_OK) conclude(mesh, &work, out);
    size_t n = work.vertex_count;
    qm_context_free(ctx, work.component, n, sizeof *work.component);
    qm_context_free(ctx, work.start, n + 1, sizeof *work.start);
    qm_context_free(ctx, work.lines, work.line_count, sizeof *work.lines);
    qm_context_free(ctx, work.has_other, n, sizeof *work.has_other);
    qm_context_free(ctx, work.is_crowded, n, sizeof *work.is_crowded);
    qm_context_free(ctx, work.loop, n, sizeof *work.loop);
    qm_context_free(ctx, work.seen, n, sizeof *work.seen);
    qm_context_free(ctx, work.degree, n, sizeof *work.degree);
    qm_context_free(ctx, work.group, n, sizeof *work.group);
    return status;
}
