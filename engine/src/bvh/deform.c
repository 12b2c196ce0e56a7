/**
 * deform.c: trees of meshes whose vertices move: lookup from vertices to faces and packs, and refitting the
 * boxes of a tree.
 */
#include "qm/deform.h"

#include <math.h>
#include <string.h>

#include "bvh_build.h"
#include "bvh_demand.h"
#include "core/bits.h"
#include "core/face_ring.h"
#include "kernel.h"

/* ---- the deformer ---- */

#define VERTICES_AHEAD 16 /* vertices ahead whose faces are prefetched */

qm_status qm_deformer_build(qm_context *ctx, const qm_bvh *bvh, qm_deformer **out)
{
    const qm_mesh *mesh = &bvh->mesh;
    *out = NULL;
    qm_deformer *deformer = qm_context_alloc(ctx, 1, sizeof *deformer);
    if (!deformer) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a deformation");
    *deformer = (qm_deformer){.vertex_count = mesh->vertex_count,
                              .face_count = qm_bvh_facet_count(mesh),
                              .pack_count = bvh->pack_count};
    for (size_t f = 0; f < mesh->face_count; f++)
        deformer->corner_count += (size_t)qm_face_corners(mesh->faces + 4 * f);
    for (size_t pack = 0; pack < bvh->pack_count; pack++)
        deformer->pack_vertex_count += bvh->lanes[pack].vertex_count;
    deformer->start = qm_context_alloc(ctx, deformer->vertex_count + 1, sizeof *deformer->start);
    deformer->faces = qm_context_alloc(ctx, deformer->corner_count, sizeof *deformer->faces);
    deformer->face_pack = qm_context_alloc(ctx, deformer->face_count, sizeof *deformer->face_pack);
    deformer->pack_start = qm_context_alloc(ctx, deformer->pack_count + 1, sizeof *deformer->pack_start);
    deformer->pack_vertices =
        qm_context_alloc(ctx, deformer->pack_vertex_count, sizeof *deformer->pack_vertices);
    bool has_faces = deformer->faces || deformer->corner_count == 0;
    bool has_packs = deformer->face_pack && deformer->pack_start && deformer->pack_vertices;
    if (!deformer->start || !has_faces || !has_packs) {
        qm_deformer_destroy(ctx, deformer);
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a deformation");
    }
    memset(deformer->start, 0, (mesh->vertex_count + 1) * sizeof *deformer->start);
    for (size_t f = 0; f < mesh->face_count; f++)
        for (int i = 0; i < qm_face_corners(mesh->faces + 4 * f); i++)
            deformer->start[mesh->faces[4 * f + (size_t)i]]++;
    /* Inclusive prefix sum: the end of each vertex's faces. */
    uint32_t end = 0;
    for (size_t v = 0; v <= mesh->vertex_count; v++) {
        end += deformer->start[v];
        deformer->start[v] = end;
    }
    /* Filling backwards moves each start from the end of its vertex's faces to their beginning. */
    for (size_t f = mesh->face_count; f-- > 0;)
        for (int i = 0; i < qm_face_corners(mesh->faces + 4 * f); i++)
            deformer->faces[--deformer->start[mesh->faces[4 * f + (size_t)i]]] = (uint32_t)f;
    uint32_t pack_end = 0;
    for (size_t pack = 0; pack < bvh->pack_count; pack++) {
        const qm_pack_lanes *lanes = &bvh->lanes[pack];
        for (int lane = 0; lane < lanes->lane_count; lane++)
            deformer->face_pack[lanes->face[lane]] = (uint32_t)pack;
        deformer->pack_start[pack] = pack_end;
        for (int i = 0; i < lanes->vertex_count; i++)
            deformer->pack_vertices[pack_end++] = lanes->vertex[i];
    }
    deformer->pack_start[bvh->pack_count] = pack_end;
    *out = deformer;
    return QM_OK;
}

void qm_deformer_destroy(qm_context *ctx, qm_deformer *deformer)
{
    if (!deformer) return;
    qm_context_free(ctx, deformer->start, deformer->vertex_count + 1, sizeof *deformer->start);
    qm_context_free(ctx, deformer->faces, deformer->corner_count, sizeof *deformer->faces);
    qm_context_free(ctx, deformer->face_pack, deformer->face_count, sizeof *deformer->face_pack);
    qm_context_free(ctx, deformer->pack_start, deformer->pack_count + 1, sizeof *deformer->pack_start);
    qm_context_free(ctx, deformer->pack_vertices, deformer->pack_vertex_count,
                    sizeof *deformer->pack_vertices);
    qm_context_free(ctx, deformer, 1, sizeof *deformer);
}

size_t qm_deformer_memory_size(const qm_deformer *deformer)
{
    return sizeof *deformer + (deformer->vertex_count + 1) * sizeof *deformer->start +
           deformer->corner_count * sizeof *deformer->faces +
           deformer->face_count * sizeof *deformer->face_pack +
           (deformer->pack_count + 1) * sizeof *deformer->pack_start +
           deformer->pack_vertex_count * sizeof *deformer->pack_vertices;
}

static qm_status mark_faces(qm_context *ctx, const qm_deformer *deformer, const uint32_t *vertices,
                            size_t vertex_count, uint64_t *marks)
{
    bool is_point_set = deformer->corner_count == 0;
    for (size_t i = 0; i < vertex_count; i++) {
        if (i + 2 * VERTICES_AHEAD < vertex_count) {
            /* Prefetch the faces of a vertex soon to be visited, and the start of those of a later one. */
            uint32_t soon = vertices[i + VERTICES_AHEAD];
            uint32_t later = vertices[i + 2 * VERTICES_AHEAD];
            if (soon < deformer->vertex_count) __builtin_prefetch(deformer->faces + deformer->start[soon]);
            if (later < deformer->vertex_count) __builtin_prefetch(deformer->start + later);
        }
        uint32_t v = vertices[i];
        if (v >= deformer->vertex_count)
            return qm_context_fail(ctx, QM_E_INDEX, "entry %zu names vertex %u, the mesh has %zu", i, v,
                                   deformer->vertex_count);
        if (is_point_set) qm_bits_add(marks, v);
        for (uint32_t k = deformer->start[v]; k < deformer->start[v + 1]; k++)
            qm_bits_add(marks, deformer->faces[k]);
    }
    return QM_OK;
}

qm_status qm_deformer_find_faces(qm_context *ctx, const qm_deformer *deformer, const uint32_t *vertices,
                                 size_t vertex_count, uint32_t **faces, size_t *face_count)
{
    *faces = NULL;
    *face_count = 0;
    uint64_t *marks = qm_bits_create(ctx, deformer->face_count);
    if (!marks) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a deformation");
    qm_status status = mark_faces(ctx, deformer, vertices, vertex_count, marks);
    size_t count = status == QM_OK ? qm_bits_count(marks, deformer->face_count) : 0;
    if (count > 0) {
        *faces = qm_context_alloc(ctx, count, sizeof **faces);
        if (*faces)
            *face_count = qm_bits_list(marks, deformer->face_count, *faces);
        else
            status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a deformation");
    }
    qm_bits_free(ctx, marks, deformer->face_count);
    return status;
}

/* ---- refitting a tree ---- */

#define MIN_PACKS 512  /* packs that make another thread worthwhile */
#define PACKS_AHEAD 12 /* packs ahead whose vertices are prefetched */
#define MIN_SIZE 0.25  /* of a mesh in its local space */

/** All packs, a range for each worker. */
typedef struct fit_work {
    qm_bvh *bvh;
    const qm_deformer *deformer;
    int workers;
} fit_work;

static void fit_range(void *data, int worker)
{
    const fit_work *work = data;
    size_t count = work->bvh->pack_count, nodes = (count + 7) / 8, workers = (size_t)work->workers;
    size_t begin = nodes * (size_t)worker / workers, end = nodes * ((size_t)worker + 1) / workers;
    qm_kernel_get()->fit_nodes(work->bvh, work->deformer, begin, end);
    qm_bvh_drop_items(work->bvh, 8 * begin, 8 * end < count ? 8 * end : count);
}

/** True when a mesh with this local box may keep its local space: it lies inside, and is not much smaller. */
static bool frame_serves(const double low[3], const double high[3])
{
    double max = 0.0, size = 0.0;
    for (int k = 0; k < 3; k++) {
        max = fmax(max, fmax(fabs(low[k]), fabs(high[k])));
        size = fmax(size, high[k] - low[k]);
    }
    return max <= 1.0 && size >= MIN_SIZE;
}

/** True when a local box lies in the local space. */
static bool is_in_frame(const qm_box *box)
{
    for (int k = 0; k < 3; k++)
        if (!(fmax(-box->min[k], box->max[k]) <= 1.0)) return false;
    return true;
}

/** Asks frame_serves of the tree's boxes, all of which are refitted; they are a little larger than the
 * mesh. */
static bool boxes_fit_frame(const qm_box_tree *boxes)
{
    qm_box box = qm_box_tree_bounds(boxes);
    if (!is_in_frame(&box)) return false;
    for (int k = 0; k < 3; k++) {
        box.min[k] += QM_BOX_MARGIN;
        box.max[k] -= QM_BOX_MARGIN;
    }
    return frame_serves(box.min, box.max);
}

static bool face_in_frame(const qm_bvh *bvh, uint32_t face)
{
    qm_vec corner[4];
    int count = qm_bvh_load_face(bvh, face, corner);
    for (int i = 0; i < count; i++)
        if (!(fmax(fabs(corner[i].x), fmax(fabs(corner[i].y), fabs(corner[i].z))) <= 1.0)) return false;
    return true;
}

/** True when these faces, with their moved vertices, lie in the local space. Where the boxes do, so do the
 * faces. */
static bool faces_in_frame(const qm_bvh *bvh, const uint32_t *faces, size_t count)
{
    qm_box box = qm_box_tree_bounds(&bvh->boxes);
    if (is_in_frame(&box)) return true;
    for (size_t i = 0; i < count; i++)
        if (!face_in_frame(bvh, faces[i])) return false;
    return true;
}

/** True when the mesh has become much smaller than its local space, whose roundings it then has. The limit is
 * half of that of frame_serves, so that refit_boxes finds a new local space, and is not called again soon. */
static bool has_shrunk(const qm_box_tree *boxes)
{
    qm_box box = qm_box_tree_bounds(boxes);
    double size = 0.0;
    for (int k = 0; k < 3; k++)
        size = fmax(size, box.max[k] - box.min[k]);
    return size < 0.5 * MIN_SIZE;
}

/** Refits the boxes of all levels; the kernel makes those of the first two. */
static void fit_all(qm_context *ctx, qm_bvh *bvh, const qm_deformer *deformer, int thread_count)
{
    fit_work work = {.bvh = bvh, .deformer = deformer, .workers = thread_count};
    while (work.workers > 1 && bvh->pack_count / (size_t)work.workers < MIN_PACKS)
        work.workers--;
    qm_context_parallel(ctx, work.workers, fit_range, &work);
    qm_box_tree_fill(&bvh->boxes, 3);
}

/** Refits all boxes. A mesh rarely leaves its local space: the boxes show whether it has; if they are in
 * doubt, the box of the mesh itself decides. */
static size_t refit_boxes(qm_context *ctx, qm_bvh *bvh, const qm_deformer *deformer, int thread_count)
{
    fit_all(ctx, bvh, deformer, thread_count);
    if (!boxes_fit_frame(&bvh->boxes)) {
        qm_box box = qm_mesh_bounding_box(&bvh->mesh);
        qm_vec from = qm_frame_local(&bvh->frame, box.min), to = qm_frame_local(&bvh->frame, box.max);
        const double low[3] = {from.x, from.y, from.z}, high[3] = {to.x, to.y, to.z};
        if (!frame_serves(low, high)) {
            bvh->frame = qm_bvh_frame_make(&box);
            fit_all(ctx, bvh, deformer, thread_count);
        }
    }
    return qm_bvh_box_count(bvh);
}

static void fetch_vertices(const qm_bvh *bvh, const qm_deformer *deformer, size_t pack)
{
    for (uint32_t i = deformer->pack_start[pack]; i < deformer->pack_start[pack + 1]; i++)
        __builtin_prefetch(bvh->mesh.positions + 3 * (size_t)deformer->pack_vertices[i]);
}

/** Refits the packs listed, ascending, and the boxes above them; uses up the list. */
static size_t refit_packs(qm_bvh *bvh, const qm_deformer *deformer, uint32_t *packs, size_t count)
{
    const qm_kernel *kernel = qm_kernel_get();
    for (size_t i = 0; i < count; i++) {
        if (i + PACKS_AHEAD < count) fetch_vertices(bvh, deformer, packs[i + PACKS_AHEAD]);
        uint32_t pack = packs[i], begin = deformer->pack_start[pack], end = deformer->pack_start[pack + 1];
        kernel->fit_box(bvh, pack, deformer->pack_vertices + begin, end - begin);
        qm_bvh_drop_items(bvh, pack, pack + 1);
    }
    return count + qm_box_tree_refill(&bvh->boxes, packs, count);
}

qm_status qm_bvh_refit(qm_context *ctx, qm_bvh *bvh, const qm_deformer *deformer, const qm_mesh *mesh,
                       const uint32_t *faces, size_t face_count, int thread_count, size_t *updated)
{
    QM_ASSERT(deformer->pack_count == bvh->pack_count && mesh->vertex_count == deformer->vertex_count);
    *updated = 0;
    size_t list_size = face_count < bvh->pack_count ? face_count : bvh->pack_count;
    uint32_t *packs = faces ? qm_context_alloc(ctx, list_size, sizeof *packs) : NULL;
    uint64_t *changed = faces ? qm_bits_create(ctx, bvh->pack_count) : NULL;
    bool has_lists = !faces || face_count == 0 || (packs && changed);
    qm_status status = QM_OK;
    if (has_lists) {
        bvh->mesh = *mesh;
        bvh->has_all_floats = false;
    }
    if (!has_lists) {
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory to refit a tree");
    } else if (!faces) {
        *updated = refit_boxes(ctx, bvh, deformer, thread_count);
    } else if (face_count > 0) {
        for (size_t i = 0; i < face_count; i++)
            qm_bits_add(changed, deformer->face_pack[faces[i]]);
        *updated = refit_packs(bvh, deformer, packs, qm_bits_list(changed, bvh->pack_count, packs));
        if (has_shrunk(&bvh->boxes) || !faces_in_frame(bvh, faces, face_count))
            *updated = refit_boxes(ctx, bvh, deformer, thread_count);
    }
    if (status == QM_OK) bvh->reach = qm_box_tree_max_coordinate(&bvh->boxes);
    qm_context_free(ctx, packs, list_size, sizeof *packs);
    qm_bits_free(ctx, changed, bvh->pack_count);
    return status;
}

size_t qm_bvh_box_count(const qm_bvh *bvh)
{
    size_t count = 0;
    for (int level = 0; level < bvh->boxes.level_count; level++)
        count += bvh->boxes.group_count[level];
    return count;
}
