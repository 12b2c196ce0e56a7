/**
 * bvh_build.c: mesh to tree in four stages: frame, Hilbert order, packs, boxes from the packs up.
 */
#include <float.h>
#include <string.h>

#include "bilinear_point.h"
#include "hilbert.h"
#include "kernel.h"
#include "radix.h"

static size_t facet_count(const qm_mesh *mesh)
{
    return mesh->face_count > 0 ? mesh->face_count : mesh->vertex_count;
}

static qm_frame make_frame(const qm_box *box)
{
    qm_frame frame;
    double half = 0.0, middle[3];
    for (int k = 0; k < 3; k++) {
        middle[k] = 0.5 * box->min[k] + 0.5 * box->max[k];
        half = fmax(half, fmax(box->max[k] - middle[k], middle[k] - box->min[k]));
    }
    /* A single point has no size of its own; the place where it lies tells the scale that others come in. */
    if (half == 0.0) half = fmax(fabs(middle[0]), fmax(fabs(middle[1]), fabs(middle[2])));
    int exponent = 0;
    if (half > 0.0) frexp(half, &exponent);
    exponent = exponent < -1000 ? -1000 : exponent > 1000 ? 1000 : exponent;
    frame.origin = qm_vec_load(middle);
    frame.scale = ldexp(1.0, -exponent);
    frame.inverse_scale = ldexp(1.0, exponent);
    return frame;
}

static void fill_keys(const qm_bvh *bvh, size_t count, uint64_t *order)
{
    qm_hilbert_table table;
    qm_hilbert_table_init(&table);
    for (size_t i = 0; i < count; i++) {
        qm_vec corner[4];
        int corners = qm_bvh_load_face(bvh, (uint32_t)i, corner);
        qm_vec sum = qm_vec_add(qm_vec_add(corner[0], corner[1]), corner[2]);
        if (corners == 4) sum = qm_vec_add(sum, corner[3]);
        qm_vec centre = qm_vec_scale(corners == 4 ? 0.25 : 1.0 / 3.0, sum);
        order[i] = qm_radix_entry(qm_hilbert_point_key(&table, centre), i);
    }
}

static int face_lanes(const qm_mesh *mesh, uint64_t entry)
{
    uint32_t face = (uint32_t)(entry & QM_RADIX_INDEX_MASK);
    return mesh->face_count > 0 && mesh->faces[4 * (size_t)face + 3] != QM_NO_INDEX ? 2 : 1;
}

/** Packs are filled in order; one with a single lane left closes before a quad. */
static size_t count_packs(const qm_mesh *mesh, const uint64_t *order, size_t count, bool *has_quads)
{
    size_t packs = 0;
    int used = QM_PACK_LANES;
    *has_quads = false;
    for (size_t i = 0; i < count; i++) {
        int lanes = face_lanes(mesh, order[i]);
        if (lanes == 2) *has_quads = true;
        if (used + lanes > QM_PACK_LANES) {
            packs++;
            used = 0;
        }
        used += lanes;
    }
    return packs;
}

static uint8_t pack_vertex(qm_pack_lanes *lanes, uint32_t vertex)
{
    for (uint8_t i = 0; i < lanes->vertex_count; i++)
        if (lanes->vertex[i] == vertex) return i;
    lanes->vertex[lanes->vertex_count] = vertex;
    return lanes->vertex_count++;
}

static void add_lane(qm_pack_lanes *lanes, uint32_t face, uint32_t a, uint32_t b, uint32_t c)
{
    int lane = lanes->lane_count++;
    lanes->face[lane] = face;
    lanes->corner[lane][0] = pack_vertex(lanes, a);
    lanes->corner[lane][1] = pack_vertex(lanes, b);
    lanes->corner[lane][2] = pack_vertex(lanes, c);
}

static void add_face(const qm_mesh *mesh, qm_pack_lanes *lanes, uint32_t face)
{
    if (mesh->face_count == 0) {
        add_lane(lanes, face, face, face, face);
        return;
    }
    const uint32_t *corner = mesh->faces + 4 * (size_t)face;
    add_lane(lanes, face, corner[0], corner[1], corner[2]);
    if (corner[3] == QM_NO_INDEX) return;
    lanes->second |= (uint8_t)(1u << lanes->lane_count);
    add_lane(lanes, face, corner[0], corner[2], corner[3]);
}

static void fill_lanes(qm_bvh *bvh, const uint64_t *order, size_t count)
{
    const qm_mesh *mesh = &bvh->mesh;
    qm_pack_lanes *lanes = bvh->lanes - 1;
    int used = QM_PACK_LANES;
    for (size_t i = 0; i < count; i++) {
        int wanted = face_lanes(mesh, order[i]);
        if (used + wanted > QM_PACK_LANES) {
            lanes++;
            lanes->lane_count = lanes->vertex_count = lanes->second = 0;
            used = 0;
        }
        add_face(mesh, lanes, (uint32_t)(order[i] & QM_RADIX_INDEX_MASK));
        used += wanted;
    }
}

/** How far the patch of a quad leaves its two triangles at most; 0 for a triangle. Local. */
static double face_twist(const qm_bvh *bvh, uint32_t face)
{
    qm_vec corner[4];
    return qm_bvh_load_face(bvh, face, corner) == 3 ? 0.0 : qm_patch_twist(corner);
}

static void fill_twist(qm_bvh *bvh, size_t pack)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        bool is_first = lanes->second >> lane & 1;
        double twist = is_first ? bvh->twist[pack][lane - 1]
                                : face_twist(bvh, lanes->face[lane < lanes->lane_count ? lane : 0]);
        bvh->twist[pack][lane] = (float)twist;
        if (twist > bvh->max_twist) bvh->max_twist = bvh->twist[pack][lane];
    }
}

/** Fills one pack and widens box (min and max of x, y, z) to its vertices. */
static void fill_pack(const qm_kernel *kernel, qm_bvh *bvh, size_t index, qm_box *box)
{
    const qm_pack_lanes *lanes = &bvh->lanes[index];
    qm_vec vertex[3 * QM_PACK_LANES];
    *box = (qm_box){{DBL_MAX, DBL_MAX, DBL_MAX}, {-DBL_MAX, -DBL_MAX, -DBL_MAX}};
    for (int i = 0; i < lanes->vertex_count; i++) {
        vertex[i] = qm_frame_local(&bvh->frame, bvh->mesh.positions + 3 * (size_t)lanes->vertex[i]);
        const double p[3] = {vertex[i].x, vertex[i].y, vertex[i].z};
        for (int k = 0; k < 3; k++) {
            if (p[k] < box->min[k]) box->min[k] = p[k];
            if (p[k] > box->max[k]) box->max[k] = p[k];
        }
    }
    _Alignas(64) double corner[3][3][QM_PACK_LANES];
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        const uint8_t *place = lanes->corner[lane < lanes->lane_count ? lane : 0];
        for (int i = 0; i < 3; i++) {
            corner[i][0][lane] = vertex[place[i]].x;
            corner[i][1][lane] = vertex[place[i]].y;
            corner[i][2][lane] = vertex[place[i]].z;
        }
    }
    kernel->fill_pack(&bvh->packs[index], corner);
    for (int lane = lanes->lane_count; lane < QM_PACK_LANES; lane++)
        bvh->lanes[index].face[lane] = lanes->face[0];
}

static void set_group_box(qm_box_group *group, int member, const qm_box *box)
{
    for (int k = 0; k < 3; k++) {
        group->low[k][member] = (float)(box->min[k] - QM_BOX_MARGIN);
        group->high[k][member] = (float)(box->max[k] + QM_BOX_MARGIN);
    }
}

static qm_status fill_packs(qm_context *ctx, qm_bvh *bvh)
{
    const qm_kernel *kernel = qm_kernel_get();
    for (size_t i = 0; i < bvh->pack_count; i++) {
        if (i % 4096 == 0 && qm_context_canceled(ctx)) return QM_E_CANCELED;
        qm_box box;
        fill_pack(kernel, bvh, i, &box);
        if (bvh->twist) fill_twist(bvh, i);
        set_group_box(&bvh->groups[1][i / 8], (int)(i % 8), &box);
        for (int k = 0; k < 3; k++)
            bvh->reach = fmax(bvh->reach, fmax(-box.min[k], box.max[k]));
    }
    return QM_OK;
}

/** Boxes of level k from those of level k - 1; floats are copied, so nothing is lost on the way up. */
static void fill_level(qm_bvh *bvh, int level)
{
    for (size_t i = 0; i < bvh->group_count[level - 1]; i++) {
        const qm_box_group *below = &bvh->groups[level - 1][i];
        qm_box_group *here = &bvh->groups[level][i / 8];
        int members = qm_bvh_member_count(bvh, level - 1, i);
        for (int k = 0; k < 3; k++) {
            float low = below->low[k][0], high = below->high[k][0];
            for (int m = 1; m < members; m++) {
                if (below->low[k][m] < low) low = below->low[k][m];
                if (below->high[k][m] > high) high = below->high[k][m];
            }
            here->low[k][i % 8] = low;
            here->high[k][i % 8] = high;
        }
    }
}

static qm_status allocate_tree(qm_context *ctx, qm_bvh *bvh, bool has_quads)
{
    bvh->packs = qm_context_alloc_aligned(ctx, bvh->pack_count, sizeof *bvh->packs);
    if (!bvh->packs) return QM_E_NO_MEMORY;
    if (has_quads && !(bvh->twist = qm_context_alloc(ctx, bvh->pack_count, sizeof *bvh->twist)))
        return QM_E_NO_MEMORY;
    size_t count = bvh->pack_count;
    bvh->group_count[0] = count;
    do {
        count = (count + 7) / 8;
        int level = ++bvh->level_count;
        bvh->group_count[level] = count;
        bvh->groups[level] = qm_context_alloc_aligned(ctx, count, sizeof *bvh->groups[level]);
        if (!bvh->groups[level]) return QM_E_NO_MEMORY;
        memset(bvh->groups[level], 0, count * sizeof *bvh->groups[level]);
    } while (count > 1);
    return QM_OK;
}

static qm_status build_from_order(qm_context *ctx, qm_bvh *bvh, const uint64_t *order, size_t count)
{
    bool has_quads;
    bvh->pack_count = count_packs(&bvh->mesh, order, count, &has_quads);
    bvh->lanes = qm_context_alloc(ctx, bvh->pack_count, sizeof *bvh->lanes);
    if (!bvh->lanes) return QM_E_NO_MEMORY;
    fill_lanes(bvh, order, count);
    qm_status status = allocate_tree(ctx, bvh, has_quads);
    if (status == QM_OK) status = fill_packs(ctx, bvh);
    for (int level = 2; status == QM_OK && level <= bvh->level_count; level++)
        fill_level(bvh, level);
    return status;
}

qm_status qm_bvh_build(qm_context *ctx, const qm_mesh *mesh, qm_bvh **out)
{
    *out = NULL;
    size_t count = facet_count(mesh);
    if (count == 0) return qm_context_fail(ctx, QM_E_EMPTY, "the mesh has no face and no vertex");
    if (count > QM_RADIX_INDEX_MASK)
        return qm_context_fail(ctx, QM_E_TOO_LARGE, "a tree holds at most %llu faces",
                               (unsigned long long)QM_RADIX_INDEX_MASK);
    qm_bvh *bvh = qm_context_alloc(ctx, 1, sizeof *bvh);
    uint64_t *order = qm_context_alloc(ctx, count, sizeof *order);
    qm_status status = QM_E_NO_MEMORY;
    if (bvh) *bvh = (qm_bvh){.mesh = *mesh};
    if (bvh && order) {
        qm_box box = qm_mesh_bounding_box(mesh);
        bvh->frame = make_frame(&box);
        fill_keys(bvh, count, order);
        status = qm_radix_sort(ctx, order, count);
        if (status == QM_OK) status = build_from_order(ctx, bvh, order, count);
    }
    qm_context_free(ctx, order, count, sizeof *order);
    if (status != QM_OK) {
        qm_bvh_destroy(ctx, bvh);
        return qm_context_fail(ctx, status, "%s while building the tree", qm_status_text(status));
    }
    *out = bvh;
    return QM_OK;
}

void qm_bvh_destroy(qm_context *ctx, qm_bvh *bvh)
{
    if (!bvh) return;
    for (int level = 1; level <= bvh->level_count; level++)
        qm_context_free_aligned(ctx, bvh->groups[level], bvh->group_count[level], sizeof *bvh->groups[level]);
    qm_context_free(ctx, bvh->twist, bvh->pack_count, sizeof *bvh->twist);
    qm_context_free_aligned(ctx, bvh->packs, bvh->pack_count, sizeof *bvh->packs);
    qm_context_free(ctx, bvh->lanes, bvh->pack_count, sizeof *bvh->lanes);
    qm_context_free(ctx, bvh, 1, sizeof *bvh);
}

const qm_mesh *qm_bvh_mesh(const qm_bvh *bvh)
{
    return &bvh->mesh;
}

size_t qm_bvh_memory_size(const qm_bvh *bvh)
{
    size_t size = sizeof *bvh + bvh->pack_count * (sizeof *bvh->packs + sizeof *bvh->lanes);
    if (bvh->twist) size += bvh->pack_count * sizeof *bvh->twist;
    for (int level = 1; level <= bvh->level_count; level++)
        size += bvh->group_count[level] * sizeof *bvh->groups[level];
    return size;
}
