/**
 * patch_links.c: pairs of quads that share an edge. A counting sort groups all sides by their lower vertex;
 * within one vertex, arrays by the upper vertex pair them.
 */
#include "patch_work.h"

#include <string.h>

#include "core/face_ring.h"

#define MAX_FACES ((size_t)1 << 29)
#define CANCEL_STRIDE 65536
#define NOT_A_QUAD (UINT32_C(1) << 31)

/** One side of a face, in the group of its lower vertex. */
typedef struct grouped_side {
    uint32_t upper;
    uint32_t id; /* face * 4 + side; NOT_A_QUAD for a side of anything else */
} grouped_side;

typedef struct link_work {
    const qm_mesh *mesh;
    size_t side_count;
    uint32_t *start; /* vertex_count + 1 */
    grouped_side *sides;
    uint32_t *seen;  /* by upper vertex: the lower vertex that the two below belong to */
    uint32_t *first; /* by upper vertex: id of the first side */
    uint32_t *count; /* by upper vertex: sides so far */
} link_work;

static bool work_alloc(qm_context *ctx, const qm_mesh *mesh, link_work *work)
{
    size_t n = mesh->vertex_count;
    *work = (link_work){.mesh = mesh};
    work->start = qm_context_alloc(ctx, n + 1, sizeof *work->start);
    work->seen = qm_context_alloc(ctx, n, sizeof *work->seen);
    work->first = qm_context_alloc(ctx, n, sizeof *work->first);
    work->count = qm_context_alloc(ctx, n, sizeof *work->count);
    if (!work->start || !work->seen || !work->first || !work->count) return false;
    memset(work->start, 0, (n + 1) * sizeof *work->start);
    memset(work->seen, 0xff, n * sizeof *work->seen);
    return true;
}

static uint32_t lower_of(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

/** Two passes over the sides of a vertex: the first counts, the second links the pairs. */
static void link_vertex(link_work *work, qm_patch_links *links, uint32_t v)
{
    const grouped_side *begin = work->sides + work->start[v], *end = work->sides + work->start[v + 1];
    for (const grouped_side *side = begin; side < end; side++) {
        if (work->seen[side->upper] != v) {
            work->seen[side->upper] = v;
            work->count[side->upper] = 0;
            work->first[side->upper] = side->id;
        }
        work->count[side->upper]++;
    }
    for (const grouped_side *side = begin; side < end; side++) {
        uint32_t first = work->first[side->upper];
        if (work->count[side->upper] != 2 || side->id == first) continue;
        if (!((side->id | first) & NOT_A_QUAD)) {
            const uint32_t *faces = work->mesh->faces;
            bool same_way = faces[first] == faces[side->id];
            QM_ASSERT(first != side->id && first / 4 < links->face_count && side->id / 4 < links->face_count);
            links->across[first] = side->id << 1 | same_way;
            links->across[side->id] = first << 1 | same_way;
            links->cuts[first / 4] &= (uint8_t) ~(1u << first % 4);
            links->cuts[side->id / 4] &= (uint8_t) ~(1u << side->id % 4);
        }
    }
}

static qm_status link_all(qm_context *ctx, link_work *work, qm_patch_links *links)
{
    for (size_t f = 0; f < work->mesh->face_count; f++) {
        uint32_t ring[4];
        int corners = qm_face_ring(work->mesh->faces + 4 * f, ring);
        for (int i = 0; i < corners; i++)
            work->start[lower_of(ring[i], ring[(i + 1) % corners])]++;
        work->side_count += (size_t)corners;
    }
    uint32_t end = 0;
    for (size_t v = 0; v <= work->mesh->vertex_count; v++) {
        end += work->start[v];
        work->start[v] = end;
    }
    if (work->side_count == 0) return QM_OK;
    work->sides = qm_context_alloc(ctx, work->side_count, sizeof *work->sides);
    if (!work->sides)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the sides of %zu faces",
                               work->mesh->face_count);
    /* Filling backwards from the last face moves each start from the end of its vertex's sides to their
     * beginning. */
    for (size_t f = work->mesh->face_count; f-- > 0;) {
        const uint32_t *face = work->mesh->faces + 4 * f;
        uint32_t ring[4];
        int corners = qm_face_ring(face, ring);
        bool is_quad = corners == 4;
        for (int i = 0; i < corners; i++) {
            uint32_t a = ring[i], b = ring[(i + 1) % corners];
            work->sides[--work->start[lower_of(a, b)]] =
                (grouped_side){a < b ? b : a, is_quad ? (uint32_t)(4 * f) + (uint32_t)i : NOT_A_QUAD};
        }
    }
    for (uint32_t v = 0; v < work->mesh->vertex_count; v++) {
        if (v % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "canceled while the quads were linked");
        link_vertex(work, links, v);
    }
    return QM_OK;
}

qm_status qm_patch_links_find(qm_context *ctx, const qm_mesh *mesh, qm_patch_links *out)
{
    size_t n = mesh->face_count;
    *out = (qm_patch_links){.face_count = n};
    if (n >= MAX_FACES)
        return qm_context_fail(ctx, QM_E_TOO_LARGE, "patches need a mesh of fewer than 2^29 faces");
    out->across = qm_context_alloc(ctx, 4 * n, sizeof *out->across);
    out->cuts = qm_context_alloc(ctx, n, sizeof *out->cuts);
    link_work work;
    bool has_memory = work_alloc(ctx, mesh, &work) && out->across && out->cuts;
    qm_status status =
        has_memory ? QM_OK
                   : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the links of %zu faces", n);
    if (has_memory) {
        memset(out->across, 0xff, 4 * n * sizeof *out->across);
        memset(out->cuts, 0xf, n);
        status = link_all(ctx, &work, out);
    }
    size_t vertices = work.mesh->vertex_count;
    qm_context_free(ctx, work.start, vertices + 1, sizeof *work.start);
    qm_context_free(ctx, work.seen, vertices, sizeof *work.seen);
    qm_context_free(ctx, work.first, vertices, sizeof *work.first);
    qm_context_free(ctx, work.count, vertices, sizeof *work.count);
    qm_context_free(ctx, work.sides, work.side_count, sizeof *work.sides);
    return status;
}

void qm_patch_links_reset(qm_context *ctx, qm_patch_links *links)
{
    qm_context_free(ctx, links->across, 4 * links->face_count, sizeof *links->across);
    qm_context_free(ctx, links->cuts, links->face_count, sizeof *links->cuts);
    *links = (qm_patch_links){0};
}

/* ---- blocks ---- */

/** Goes back to the first column; false when the cells form a ring, which has none. */
static bool find_start(const qm_patch_links *links, qm_patch_cell *cell)
{
    qm_patch_cell at = qm_patch_cell_reverse_u(*cell), begin = at;
    while (qm_patch_cell_next(links, &at))
        if (at.face == begin.face && at.u == begin.u) return false;
    *cell = qm_patch_cell_reverse_u(at);
    return true;
}

/** Counts the cells from this one to the last column. */
static uint32_t count_columns(const qm_patch_links *links, qm_patch_cell cell)
{
    uint32_t count = 1;
    while (qm_patch_cell_next(links, &cell))
        count++;
    return count;
}

bool qm_patch_block_find(const qm_patch_links *links, qm_patch_cell cell, qm_patch_block *block,
                         unsigned *ring)
{
    *ring = find_start(links, &cell) ? 0 : 1;
    cell = qm_patch_cell_swap(cell);
    if (!find_start(links, &cell)) *ring |= 2;
    if (*ring) return false;
    block->rows = count_columns(links, cell);
    block->first = cell = qm_patch_cell_swap(cell);
    block->columns = count_columns(links, cell);
    return true;
}
