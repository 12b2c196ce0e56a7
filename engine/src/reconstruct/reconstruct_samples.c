#include "bvh/bvh_tree.h"
#include "reconstruct_work.h"

#include <string.h>

enum { ROW = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for samples of the surface");
}

static void load_triangle(const qm_mesh *mesh, size_t face, int half, qm_vec corner[3])
{
    const uint32_t *index = mesh->faces + 4 * face;
    const uint32_t of[3] = {index[0], index[1 + half], index[2 + half]};
    for (int k = 0; k < 3; k++)
        corner[k] = qm_vec_load(mesh->positions + 3 * (size_t)of[k]);
}

/** As long as the triangle's area twice. */
static qm_vec triangle_normal(const qm_vec corner[3])
{
    return qm_vec_cross(qm_vec_sub(corner[1], corner[0]), qm_vec_sub(corner[2], corner[0]));
}

static double triangle_area(const qm_vec corner[3])
{
    return 0.5 * qm_vec_norm(triangle_normal(corner));
}

static void store_normal(float row[3], qm_vec normal)
{
    double length = qm_vec_norm(normal);
    qm_vec unit = length > 0.0 ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
    row[0] = (float)unit.x;
    row[1] = (float)unit.y;
    row[2] = (float)unit.z;
}

/**
 * A point of a triangle for the k-th sample: multiples of two irrational numbers, which fill the square
 * evenly, folded into the triangle. Source: M. Roberts, The unreasonable effectiveness of quasirandom
 * sequences, 2018.
 */
static qm_vec triangle_sample(const qm_vec corner[3], size_t k)
{
    double s = fmod(0.5 + 0.7548776662466927 * (double)k, 1.0);
    double t = fmod(0.5 + 0.5698402909980532 * (double)k, 1.0);
    if (s + t > 1.0) {
        s = 1.0 - s;
        t = 1.0 - t;
    }
    qm_vec along = qm_vec_axpy(corner[0], s, qm_vec_sub(corner[1], corner[0]));
    return qm_vec_axpy(along, t, qm_vec_sub(corner[2], corner[0]));
}

/** Samples at equal steps of the area summed up over the faces: each gets its share, however small it is. */
static void sample_mesh(const qm_mesh *mesh, double total, qm_samples *out)
{
    double done = 0.0;
    size_t k = 0;
    for (size_t face = 0; face < mesh->face_count; face++) {
        int halves = mesh->faces[4 * face + 3] == QM_NO_INDEX ? 1 : 2;
        for (int half = 0; half < halves; half++) {
            qm_vec corner[3];
            load_triangle(mesh, face, half, corner);
            done += triangle_area(corner);
            for (; k < out->count && ((double)k + 0.5) * total <= done * (double)out->count; k++) {
                qm_vec_store(out->positions + 3 * k, triangle_sample(corner, k));
                store_normal(out->normals + 3 * k, triangle_normal(corner));
            }
        }
    }
    out->count = k;
}

static double mesh_area(const qm_mesh *mesh)
{
    double area = 0.0;
    for (size_t face = 0; face < mesh->face_count; face++) {
        int halves = mesh->faces[4 * face + 3] == QM_NO_INDEX ? 1 : 2;
        for (int half = 0; half < halves; half++) {
            qm_vec corner[3];
            load_triangle(mesh, face, half, corner);
            area += triangle_area(corner);
        }
    }
    return area;
}

/** A share of a point set that does not follow the order of its rows, as scans are stored line by line. */
static bool is_taken(size_t i, uint64_t limit)
{
    uint64_t x = (uint64_t)i * UINT64_C(0x9e3779b97f4a7c15);
    x ^= x >> 32;
    x *= UINT64_C(0xd6e8feb86659fd93);
    return x >> 32 < limit;
}

static void sample_cloud(const qm_mesh *cloud, size_t wanted, qm_samples *out)
{
    double share = (double)wanted / (double)cloud->vertex_count;
    uint64_t limit = share >= 1.0 ? UINT64_C(1) << 32 : (uint64_t)(share * 0x1p32);
    size_t k = 0;
    for (size_t i = 0; i < cloud->vertex_count && k < out->count; i++) {
        if (!is_taken(i, limit)) continue;
        memcpy(out->positions + 3 * k, cloud->positions + 3 * i, ROW);
        if (out->normals) memcpy(out->normals + 3 * k, cloud->normals + 3 * i, 3 * sizeof *out->normals);
        k++;
    }
    out->count = k;
}

qm_status qm_samples_create(qm_context *ctx, const qm_reconstruction *r, size_t wanted, qm_samples *out)
{
    const qm_mesh *mesh = &r->source.bvh->mesh;
    if (r->source.is_cloud && wanted > mesh->vertex_count) wanted = mesh->vertex_count;
    /* A hashed share of the points may come out a little above what was wanted. */
    size_t capacity = wanted + wanted / 8 + 64;
    *out = (qm_samples){.count = r->source.is_cloud ? capacity : wanted, .capacity = capacity};
    out->positions = qm_context_alloc(ctx, capacity, ROW);
    out->place = qm_context_alloc(ctx, capacity, sizeof *out->place);
    bool has_normals = !r->source.is_cloud || mesh->normals;
    if (has_normals) out->normals = qm_context_alloc(ctx, capacity, 3 * sizeof *out->normals);
    if (!out->positions || !out->place || (has_normals && !out->normals)) {
        qm_samples_reset(ctx, out);
        return no_memory(ctx);
    }
    if (r->source.is_cloud)
        sample_cloud(mesh, wanted, out);
    else
        sample_mesh(mesh, mesh_area(mesh), out);
    return QM_OK;
}

void qm_samples_scale(const qm_reconstruction *r, qm_samples *samples, uint32_t base)
{
    for (size_t i = 0; i < samples->count; i++) {
        const qm_patch_grid *grid = &r->grids[samples->place[i].patch];
        samples->place[i].u *= (double)(grid->columns / base);
        samples->place[i].v *= (double)(grid->rows / base);
    }
}

void qm_samples_reset(qm_context *ctx, qm_samples *samples)
{
    qm_context_free(ctx, samples->positions, samples->capacity, ROW);
    qm_context_free(ctx, samples->normals, samples->capacity, 3 * sizeof *samples->normals);
    qm_context_free(ctx, samples->place, samples->capacity, sizeof *samples->place);
    *samples = (qm_samples){0};
}

size_t qm_patch_of_face(const size_t *first, size_t patch_count, uint32_t face)
{
    size_t low = 0, high = patch_count;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (first[middle] <= face)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static void set_places(const qm_reconstruction *r, const size_t *first, const qm_projection *feet,
                       qm_samples *samples)
{
    for (size_t i = 0; i < samples->count; i++) {
        size_t patch = qm_patch_of_face(first, r->layout.patch_count, feet->face[i]);
        uint32_t columns = r->grids[patch].columns, place = feet->face[i] - (uint32_t)first[patch];
        samples->place[i] = (qm_sample_place){.patch = (uint32_t)patch,
                                              .u = place % columns + feet->uv[2 * i],
                                              .v = place / columns + feet->uv[2 * i + 1],
                                              .distance = feet->distance[i]};
    }
}

/** Numbers of the patches' first faces in the working mesh. */
static void set_first(const qm_reconstruction *r, size_t *first)
{
    size_t count = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        first[p] = count;
        count += (size_t)r->grids[p].columns * r->grids[p].rows;
    }
}

static qm_status project(qm_context *ctx, const qm_reconstruction *r, const qm_samples *samples,
                         const qm_projection *feet)
{
    qm_mesh mesh;
    qm_bvh *tree = NULL;
    qm_status status = qm_grids_mesh(ctx, r, true, &mesh);
    if (status != QM_OK) return status;
    status = qm_bvh_build(ctx, &mesh, QM_BVH_TARGET, r->options.thread_count, &tree);
    if (status == QM_OK)
        status = qm_project_points(ctx, tree, QM_QUADS_TRIANGLES, samples->positions, samples->count,
                                   r->options.thread_count, feet);
    qm_bvh_destroy(ctx, tree);
    qm_mesh_reset(ctx, &mesh);
    return status;
}

qm_status qm_samples_locate(qm_context *ctx, const qm_reconstruction *r, qm_samples *samples)
{
    size_t count = samples->count, patches = r->layout.patch_count;
    qm_projection feet = {.distance = qm_context_alloc(ctx, count, sizeof *feet.distance),
                          .face = qm_context_alloc(ctx, count, sizeof *feet.face),
                          .uv = qm_context_alloc(ctx, count, 2 * sizeof *feet.uv)};
    size_t *first = qm_context_alloc(ctx, patches, sizeof *first);
    qm_status status = QM_OK;
    if (!feet.distance || !feet.face || !feet.uv || !first) status = no_memory(ctx);
    if (status == QM_OK) status = project(ctx, r, samples, &feet);
    if (status == QM_OK) {
        set_first(r, first);
        set_places(r, first, &feet, samples);
        samples->is_projected = true;
        if (samples->normals) status = qm_samples_drop_turned(ctx, r, samples);
    }
    qm_context_free(ctx, feet.distance, count, sizeof *feet.distance);
    qm_context_free(ctx, feet.face, count, sizeof *feet.face);
    qm_context_free(ctx, feet.uv, count, 2 * sizeof *feet.uv);
    qm_context_free(ctx, first, patches, sizeof *first);
    return status;
}
