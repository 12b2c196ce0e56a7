/**
 * mesh_load.c: decoding, preparation, copies and deformations of meshes, and their memory.
 */
#include "mesh_load.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "format/gzip.h"

#define FACT_WARNINGS 3

static void add_warning(qm_loaded_mesh *mesh, const char *format, size_t count)
{
    QM_ASSERT(mesh->warnings);
    snprintf(mesh->warnings[mesh->warning_count++], QM_CODEC_DETAIL_SIZE, format, count);
}

static bool mentions(const qm_codec_report *report, const char *word)
{
    for (size_t i = 0; i < report->warning_count; i++)
        if (strstr(report->warnings[i], word)) return true;
    return false;
}

static qm_status set_warnings(qm_loaded_mesh *out, const qm_codec_report *report)
{
    out->warnings = calloc(report->warning_count + FACT_WARNINGS, sizeof *out->warnings);
    if (!out->warnings) return QM_E_NO_MEMORY;
    for (size_t i = 0; i < report->warning_count; i++)
        memcpy(out->warnings[out->warning_count++], report->warnings[i], QM_CODEC_DETAIL_SIZE);
    if (out->facts.unused_vertices > 0)
        add_warning(out, "vertices that no face uses: %zu (kept, but no part of the surface)",
                    out->facts.unused_vertices);
    if (out->facts.repeated_corner_faces > 0 && !mentions(report, "twice"))
        add_warning(out, "%zu faces name a vertex twice; they are kept", out->facts.repeated_corner_faces);
    if (out->facts.nonmanifold_edges > 0)
        add_warning(out, "%zu edges have three faces or more", out->facts.nonmanifold_edges);
    QM_ASSERT(out->warning_count <= report->warning_count + FACT_WARNINGS);
    return QM_OK;
}

/** Grids of the decoder are hints for the search of patches, and are not needed after it. */
static void drop_grids(qm_context *ctx, qm_mesh *mesh)
{
    qm_context_free(ctx, mesh->grids, mesh->grid_count, sizeof *mesh->grids);
    mesh->grids = NULL;
    mesh->grid_count = 0;
}

static qm_status prepare(qm_context *ctx, const qm_preparation *preparation, qm_loaded_mesh *out)
{
    QM_ASSERT(preparation->thread_count >= 1 && !out->bvh && !out->tetra);
    QM_ASSERT(preparation->has_facts || !preparation->has_patches);
    double start = qm_clock_now_ms();
    qm_status status = preparation->has_facts ? qm_mesh_find_facts(ctx, &out->mesh, &out->facts) : QM_OK;
    if (status == QM_OK && preparation->has_extent)
        status = qm_extent_measure(ctx, &out->mesh, preparation->thread_count, &out->extent);
    out->box = qm_mesh_bounding_box(&out->mesh);
    out->diagonal = qm_mesh_box_diagonal(&out->box);
    double facts_end = qm_clock_now_ms();
    out->topology_ms = facts_end - start;
    bool has_patches = status == QM_OK && preparation->has_patches && out->facts.quads > 0;
    /* A grid does not show a third face at one of its inner edges. */
    if (!out->facts.manifold) drop_grids(ctx, &out->mesh);
    if (has_patches) status = qm_patch_set_find(ctx, &out->mesh, &out->patches);
    drop_grids(ctx, &out->mesh);
    double patches_end = qm_clock_now_ms();
    out->patches_ms = patches_end - facts_end;
    if (status == QM_OK && !preparation->has_no_tree)
        status = qm_bvh_build(ctx, &out->mesh, preparation->parts, preparation->thread_count, &out->bvh);
    if (status == QM_OK && has_patches && preparation->has_tetra)
        status = qm_tetra_build(ctx, out->bvh, &out->patches, &out->tetra);
    if (status == QM_OK && preparation->keeps_pairs) {
        out->self_pairs = qm_self_pairs_create(out->mesh.vertex_count);
        out->solids = qm_solids_create();
        if (!out->self_pairs || !out->solids) status = QM_E_NO_MEMORY;
    }
    out->bvh_ms = qm_clock_now_ms() - patches_end;
    return status;
}

/** Normals belong to the positions of the file. */
static void drop_normals(qm_context *ctx, qm_mesh *mesh)
{
    qm_context_free(ctx, mesh->normals, mesh->vertex_count, 3 * sizeof *mesh->normals);
    mesh->normals = NULL;
}

/** Replaces the positions of the file by those of a revision. */
static qm_status set_positions(qm_context *ctx, const qm_preparation *preparation, qm_mesh *mesh,
                               qm_codec_report *report)
{
    qm_status status = QM_E_FORMAT;
    if (preparation->position_count == mesh->vertex_count) {
        memcpy(mesh->positions, preparation->positions, 3 * sizeof *mesh->positions * mesh->vertex_count);
        drop_normals(ctx, mesh);
        status = qm_mesh_validate(ctx, mesh);
    }
    if (status != QM_OK)
        snprintf(report->detail, sizeof report->detail, "the positions of the revision do not fit the mesh");
    return status;
}

/** Moves a mesh to where it is asked for. */
static qm_status move(qm_context *ctx, const double *transform, qm_loaded_mesh *loaded,
                      qm_codec_report *report)
{
    qm_mesh *mesh = &loaded->mesh;
    ctx->message[0] = '\0';
    loaded->moved = qm_transform_find_change(transform, mesh);
    qm_status status = qm_transform_positions(ctx, transform, mesh, mesh->positions);
    drop_normals(ctx, mesh);
    if (status == QM_OK) status = qm_mesh_validate(ctx, mesh);
    if (status != QM_OK)
        snprintf(report->detail, sizeof report->detail, "the moved mesh is no mesh: %.150s", ctx->message);
    return status;
}

/** The content of a file, which may be compressed with gzip. */
typedef struct file_content {
    const uint8_t *bytes;
    size_t size;
    qm_gzip_content inflated;
    qm_format format;
} file_content;

/** Inflates what is compressed and detects the format; close_file frees in any case. */
static qm_status open_file(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                           const qm_codec_limits *limits, file_content *out, qm_codec_report *report)
{
    *out = (file_content){.bytes = bytes, .size = size};
    *report = (qm_codec_report){.line = QM_NO_LOCATION, .offset = QM_NO_LOCATION};
    if (qm_gzip_is_packed(bytes, size)) {
        qm_status status = qm_gzip_inflate(ctx, bytes, size, limits->max_size, &out->inflated, report);
        if (status != QM_OK) return status;
        out->bytes = out->inflated.bytes;
        out->size = out->inflated.size;
    }
    out->format = format == QM_FORMAT_UNKNOWN ? qm_format_sniff(out->bytes, out->size) : format;
    return QM_OK;
}

static void close_file(qm_context *ctx, file_content *file)
{
    qm_gzip_content_free(ctx, &file->inflated);
}

qm_status qm_mesh_read(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                       const qm_codec_limits *limits, qm_loaded_mesh *out, qm_codec_report *report)
{
    *out = (qm_loaded_mesh){.file_size = size};
    double start = qm_clock_now_ms();
    file_content file;
    qm_status status = open_file(ctx, format, bytes, size, limits, &file, report);
    if (status == QM_OK)
        status = qm_codec_decode(ctx, file.format, file.bytes, file.size, limits, &out->mesh, report);
    out->format = file.format;
    memcpy(out->unit, report->unit, sizeof out->unit);
    close_file(ctx, &file);
    out->parse_ms = qm_clock_now_ms() - start;
    if (status != QM_OK) qm_loaded_mesh_reset(ctx, out);
    return status;
}

qm_status qm_mesh_measure(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                          qm_codec_limits *limits, const qm_preparation *preparation, size_t *needed,
                          qm_codec_report *report)
{
    file_content file;
    qm_codec_counts counts;
    qm_status status = QM_OK;
    size_t inflated = 0;
    *report = (qm_codec_report){.line = QM_NO_LOCATION, .offset = QM_NO_LOCATION};
    if (qm_gzip_is_packed(bytes, size))
        status = qm_gzip_measure(ctx, bytes, size, limits->max_size, &inflated, report);
    *needed = inflated;
    if (status != QM_OK) return status;
    status = open_file(ctx, format, bytes, size, limits, &file, report);
    if (status == QM_OK)
        status = qm_codec_count(ctx, file.format, file.bytes, file.size, limits, &counts, report);
    close_file(ctx, &file);
    if (status != QM_OK) return status;
    /* The content of a compressed file is freed before the tree is built. */
    const size_t facets = counts.faces > 0 ? counts.faces : counts.vertices;
    size_t tree = preparation->has_no_tree
                      ? 0
                      : qm_bvh_memory_needed(facets - counts.quads, counts.quads, preparation->parts);
    *needed = 3 * sizeof(double) * counts.vertices + 4 * sizeof(uint32_t) * counts.faces +
              (tree > inflated ? tree : inflated);
    if (counts.is_exact) {
        limits->max_vertices = counts.vertices;
        limits->max_faces = counts.faces;
    }
    return QM_OK;
}

qm_status qm_mesh_make_ready(qm_context *ctx, const qm_preparation *preparation, qm_loaded_mesh *mesh,
                             qm_codec_report *report)
{
    qm_status status = QM_OK;
    if (preparation->positions) status = set_positions(ctx, preparation, &mesh->mesh, report);
    if (status == QM_OK && preparation->transform) status = move(ctx, preparation->transform, mesh, report);
    if (status == QM_OK) {
        status = prepare(ctx, preparation, mesh);
        if (status == QM_OK) status = set_warnings(mesh, report);
        if (status != QM_OK) snprintf(report->detail, sizeof report->detail, "%s", qm_status_text(status));
    }
    if (status != QM_OK) qm_loaded_mesh_reset(ctx, mesh);
    return status;
}

qm_status qm_mesh_load(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                       const qm_codec_limits *limits, const qm_preparation *preparation, qm_loaded_mesh *out,
                       qm_codec_report *report)
{
    qm_status status = qm_mesh_read(ctx, format, bytes, size, limits, out, report);
    return status == QM_OK ? qm_mesh_make_ready(ctx, preparation, out, report) : status;
}

static qm_status copy_arrays(qm_context *ctx, const qm_loaded_mesh *from, qm_loaded_mesh *to)
{
    const qm_mesh *mesh = &from->mesh;
    to->mesh.faces = qm_context_alloc(ctx, mesh->face_count, 4 * sizeof *mesh->faces);
    if (mesh->face_origin)
        to->mesh.face_origin = qm_context_alloc(ctx, mesh->face_count, sizeof *mesh->face_origin);
    to->warnings = calloc(from->warning_count + 1, sizeof *to->warnings);
    bool has_faces = to->mesh.faces || mesh->face_count == 0;
    if (!has_faces || (mesh->face_origin && !to->mesh.face_origin) || !to->warnings) return QM_E_NO_MEMORY;
    if (mesh->face_count > 0) memcpy(to->mesh.faces, mesh->faces, mesh->face_count * 4 * sizeof *mesh->faces);
    if (mesh->face_origin)
        memcpy(to->mesh.face_origin, mesh->face_origin, mesh->face_count * sizeof *mesh->face_origin);
    memcpy(to->warnings, from->warnings, from->warning_count * sizeof *to->warnings);
    to->warning_count = from->warning_count;
    return QM_OK;
}

qm_status qm_loaded_mesh_copy(qm_context *ctx, const qm_loaded_mesh *mesh, double *positions,
                              const qm_preparation *preparation, qm_loaded_mesh *out)
{
    *out = (qm_loaded_mesh){.mesh = mesh->mesh,
                            .format = mesh->format,
                            .unit = {mesh->unit[0], mesh->unit[1], mesh->unit[2], mesh->unit[3]},
                            .file_size = mesh->file_size,
                            .parse_ms = mesh->parse_ms,
                            .revision = mesh->revision + 1};
    out->mesh.positions = NULL;
    out->mesh.faces = NULL;
    out->mesh.face_origin = NULL;
    out->mesh.normals = NULL;
    qm_status status = copy_arrays(ctx, mesh, out);
    if (status == QM_OK) {
        out->mesh.positions = positions;
        status = prepare(ctx, preparation, out);
    }
    if (status == QM_OK) return QM_OK;
    out->mesh.positions = NULL;
    qm_loaded_mesh_reset(ctx, out);
    return status;
}

void qm_loaded_mesh_move_notes(const qm_loaded_mesh *mesh, qm_notes *notes)
{
    qm_mesh_move_notes(&mesh->moved, notes);
}

void qm_mesh_move_notes(const qm_transform_change *moved, qm_notes *notes)
{
    if (moved->norm > 0.0 && notes->uncertainty > 0.0) /* a product and a sum, each rounded once */
        notes->uncertainty = (moved->norm * notes->uncertainty + moved->rounding) * (1.0 + 0x1p-50);
}

qm_status qm_loaded_mesh_deform(qm_context *ctx, qm_loaded_mesh *mesh, double *positions,
                                const uint32_t *vertices, size_t vertex_count, int thread_count,
                                size_t *updated)
{
    QM_ASSERT(positions && mesh->bvh && thread_count >= 1);
    uint32_t *faces = NULL;
    size_t face_count = 0, boxes = 0, radii = 0;
    qm_context_free(ctx, mesh->mesh.positions, mesh->mesh.vertex_count, 3 * sizeof *positions);
    mesh->mesh.positions = positions;
    drop_normals(ctx, &mesh->mesh);
    mesh->box = qm_mesh_bounding_box(&mesh->mesh);
    mesh->diagonal = qm_mesh_box_diagonal(&mesh->box);
    mesh->revision++;
    if (mesh->self_pairs) qm_self_pairs_move(mesh->self_pairs, vertices, vertex_count);
    if (mesh->solids) qm_solids_forget(mesh->solids);
    qm_status status = mesh->deformer ? QM_OK : qm_deformer_build(ctx, mesh->bvh, &mesh->deformer);
    if (status == QM_OK && vertices)
        status = qm_deformer_find_faces(ctx, mesh->deformer, vertices, vertex_count, &faces, &face_count);
    /* If no face uses the moved vertices, the refit only updates the pointer to the positions. */
    const uint32_t none = 0, *list = vertices && !faces ? &none : faces;
    if (status == QM_OK)
        status =
            qm_bvh_refit(ctx, mesh->bvh, mesh->deformer, &mesh->mesh, list, face_count, thread_count, &boxes);
    if (status == QM_OK && mesh->tetra) status = qm_tetra_refit(ctx, mesh->tetra, list, face_count, &radii);
    qm_context_free(ctx, faces, face_count, sizeof *faces);
    *updated = boxes + radii;
    return status;
}

void qm_loaded_mesh_reset(qm_context *ctx, qm_loaded_mesh *mesh)
{
    qm_deformer_destroy(ctx, mesh->deformer);
    qm_self_pairs_destroy(mesh->self_pairs);
    qm_solids_destroy(mesh->solids);
    qm_tetra_destroy(ctx, mesh->tetra);
    qm_patch_set_reset(ctx, &mesh->patches);
    qm_bvh_destroy(ctx, mesh->bvh);
    qm_mesh_reset(ctx, &mesh->mesh);
    free(mesh->warnings);
    *mesh = (qm_loaded_mesh){0};
}

size_t qm_loaded_mesh_memory_size(const qm_loaded_mesh *mesh)
{
    size_t face_width =
        4 * sizeof *mesh->mesh.faces + (mesh->mesh.face_origin ? sizeof *mesh->mesh.face_origin : 0);
    size_t normal_width = mesh->mesh.normals ? 3 * sizeof *mesh->mesh.normals : 0;
    return sizeof *mesh + (3 * sizeof *mesh->mesh.positions + normal_width) * mesh->mesh.vertex_count +
           face_width * mesh->mesh.face_count + qm_bvh_memory_size(mesh->bvh) +
           qm_patch_set_memory_size(&mesh->patches) + (mesh->tetra ? qm_tetra_memory_size(mesh->tetra) : 0) +
           (mesh->deformer ? qm_deformer_memory_size(mesh->deformer) : 0);
}

qm_regular_patch qm_loaded_mesh_largest_patch(const qm_loaded_mesh *mesh)
{
    qm_regular_patch largest = {0};
    size_t max_faces = 0;
    for (size_t i = 0; i < mesh->patches.patch_count; i++) {
        const qm_regular_patch *patch = &mesh->patches.patches[i];
        size_t faces = (size_t)patch->rows * patch->columns;
        if (faces > max_faces) {
            max_faces = faces;
            largest = *patch;
        }
    }
    return largest;
}

const char *qm_loaded_mesh_kind(const qm_loaded_mesh *mesh)
{
    if (mesh->mesh.face_count == 0) return "points";
    if (mesh->facts.quads == 0) return "triangles";
    return mesh->facts.quads == mesh->mesh.face_count ? "quads" : "mixed";
}
