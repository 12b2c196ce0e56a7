/**
 * bvh_refit.c: boxes of a tree whose vertices have moved.
 */
#include "bvh_demand.h"
#include "bvh_order.h"
#include "core/bits.h"
#include "deform.h"
#include "kernel.h"

#define MIN_PACKS 512   /* packs that make it worth to start another thread */
#define AHEAD 12        /* packs ahead of the one at hand whose vertices are fetched */
#define LEAST_SIZE 0.25 /* of a mesh in its frame */

/** All packs, a range for each worker. */
typedef struct pack_work {
    qm_bvh *bvh;
    const qm_deformer *deformer; /* to fit boxes */
    size_t count;
    int workers;
} pack_work;

static void each_pack(qm_context *ctx, pack_work *work, int thread_count, void (*task)(void *, int))
{
    work->workers = thread_count;
    while (work->workers > 1 && work->count / (size_t)work->workers < MIN_PACKS)
        work->workers--;
    qm_context_parallel(ctx, work->workers, task, work);
}

static void fit_range(void *data, int worker)
{
    const pack_work *work = data;
    size_t groups = (work->count + 7) / 8, workers = (size_t)work->workers;
    size_t begin = groups * (size_t)worker / workers, end = groups * ((size_t)worker + 1) / workers;
    qm_kernel_get()->fit_groups(work->bvh, work->deformer, begin, end);
    qm_bvh_drop_items(work->bvh, 8 * begin, 8 * end < work->count ? 8 * end : work->count);
}

/** True when a frame serves a mesh with this local box: it is held, and not much smaller than the frame. */
static bool frame_serves(const double low[3], const double high[3])
{
    double most = 0.0, size = 0.0;
    for (int k = 0; k < 3; k++) {
        most = fmax(most, fmax(fabs(low[k]), fabs(high[k])));
        size = fmax(size, high[k] - low[k]);
    }
    return most <= 1.0 && size >= LEAST_SIZE;
}

/** True when this box lies in the frame. */
static bool is_in_frame(const qm_box *box)
{
    for (int k = 0; k < 3; k++)
        if (!(fmax(-box->min[k], box->max[k]) <= 1.0)) return false;
    return true;
}

/** The boxes' word for it, which have all been found anew; they reach a little beyond the mesh. */
static bool boxes_fit_frame(const qm_box_tree *boxes)
{
    qm_box box = qm_box_tree_whole(boxes);
    if (!is_in_frame(&box)) return false;
    for (int k = 0; k < 3; k++) {
        box.min[k] += QM_BOX_MARGIN;
        box.max[k] -= QM_BOX_MARGIN;
    }
    return frame_serves(box.min, box.max);
}

static bool mesh_fits_frame(const qm_frame *frame, const qm_box *box)
{
    qm_vec from = qm_frame_local(frame, box->min), to = qm_frame_local(frame, box->max);
    const double low[3] = {from.x, from.y, from.z}, high[3] = {to.x, to.y, to.z};
    return frame_serves(low, high);
}

static bool face_in_frame(const qm_bvh *bvh, uint32_t face)
{
    qm_vec corner[4];
    int count = qm_bvh_load_face(bvh, face, corner);
    for (int i = 0; i < count; i++)
        if (!(fmax(fabs(corner[i].x), fmax(fabs(corner[i].y), fabs(corner[i].z))) <= 1.0)) return false;
    return true;
}

/** True when these faces, with their new vertices, lie in the frame. Where the boxes do, so do the faces. */
static bool faces_in_frame(const qm_bvh *bvh, const uint32_t *faces, size_t count)
{
    qm_box box = qm_box_tree_whole(&bvh->boxes);
    if (is_in_frame(&box)) return true;
    for (size_t i = 0; i < count; i++)
        if (!face_in_frame(bvh, faces[i])) return false;
    return true;
}

/** True when the mesh has become much smaller than its frame, whose roundings it then has. At half the size
 * that a frame serves down to, so that the search for a new one finds it, and then not soon again. */
static bool has_shrunk(const qm_box_tree *boxes)
{
    qm_box box = qm_box_tree_whole(boxes);
    double size = 0.0;
    for (int k = 0; k < 3; k++)
        size = fmax(size, box.max[k] - box.min[k]);
    return size < 0.5 * LEAST_SIZE;
}

/** Boxes of all levels; the kernel leaves those above the groups of packs. */
static void fit_all(qm_context *ctx, qm_bvh *bvh, const qm_deformer *deformer, int thread_count)
{
    pack_work work = {.bvh = bvh, .deformer = deformer, .count = bvh->pack_count};
    each_pack(ctx, &work, thread_count, fit_range);
    qm_box_tree_fill(&bvh->boxes, 3);
}

/** A mesh rarely leaves its frame: boxes in the frame that is there tell, or else the mesh's own. */
static size_t refit_all(qm_context *ctx, qm_bvh *bvh, const qm_deformer *deformer, int thread_count)
{
    fit_all(ctx, bvh, deformer, thread_count);
    if (!boxes_fit_frame(&bvh->boxes)) {
        qm_box box = qm_mesh_bounding_box(&bvh->mesh);
        if (!mesh_fits_frame(&bvh->frame, &box)) {
            bvh->frame = qm_frame_make(&box);
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

/** packs are those of the faces that changed, ascending; they are used up. */
static size_t refit_packs(qm_bvh *bvh, const qm_deformer *deformer, uint32_t *packs, size_t count)
{
    const qm_kernel *kernel = qm_kernel_get();
    for (size_t i = 0; i < count; i++) {
        if (i + AHEAD < count) fetch_vertices(bvh, deformer, packs[i + AHEAD]);
        uint32_t pack = packs[i], begin = deformer->pack_start[pack], end = deformer->pack_start[pack + 1];
        kernel->fit_box(bvh, pack, deformer->pack_vertices + begin, end - begin);
        qm_bvh_drop_items(bvh, pack, pack + 1);
    }
    return count + qm_box_tree_refill(&bvh->boxes, packs, count);
}

qm_status qm_bvh_refit(qm_context *ctx, qm_bvh *bvh, const qm_deformer *deformer, const qm_mesh *mesh,
                       const uint32_t *faces, size_t face_count, int thread_count, size_t *updated)
{
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
        *updated = refit_all(ctx, bvh, deformer, thread_count);
    } else if (face_count > 0) {
        for (size_t i = 0; i < face_count; i++)
            qm_bits_add(changed, deformer->face_pack[faces[i]]);
        *updated = refit_packs(bvh, deformer, packs, qm_bits_list(changed, bvh->pack_count, packs));
        if (has_shrunk(&bvh->boxes) || !faces_in_frame(bvh, faces, face_count))
            *updated = refit_all(ctx, bvh, deformer, thread_count);
    }
    if (status == QM_OK) bvh->reach = qm_box_tree_reach(&bvh->boxes);
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
