/* Meshes for the benchmark: read, disturbed, and written for programs that know triangles only. */
#include "engine.h"

#include "format/codec.h"
#include "random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The same twin on every machine. */
#define NOISE_SEED 20240607

#define PART 100 /* one vertex in so many is picked */

_Noreturn void bench_fail(const char *subject, const char *detail)
{
    fprintf(stderr, "bench_engine: %s: %s\n", subject, detail);
    exit(EXIT_FAILURE);
}

void *bench_alloc(size_t count, size_t width)
{
    void *block = calloc(count > 0 ? count : 1, width);
    if (!block) bench_fail("memory", "there is not enough");
    return block;
}

static uint8_t *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END) != 0) bench_fail(path, "cannot be read");
    long end = ftell(file);
    rewind(file);
    uint8_t *bytes = bench_alloc((size_t)end, 1);
    *size = fread(bytes, 1, (size_t)end, file);
    fclose(file);
    return bytes;
}

static void disturb(qm_mesh *mesh, const bench_change *change)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    double diagonal = qm_mesh_box_diagonal(&box);
    double step = change->shift * diagonal / sqrt(3.0), reach = change->noise * diagonal;
    qm_random random = qm_random_make(NOISE_SEED, 0);
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        mesh->positions[i] += step + qm_random_range(&random, -reach, reach);
}

/** Rodrigues' formula about the middle of the box. */
static void turn(qm_mesh *mesh, double angle)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    double axis[3], length = sqrt(14.0), c = cos(angle), s = sin(angle);
    for (int k = 0; k < 3; k++)
        axis[k] = (k + 1) / length;
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        double *p = mesh->positions + 3 * i, from[3], along = 0.0;
        for (int k = 0; k < 3; k++) {
            from[k] = p[k] - 0.5 * (box.min[k] + box.max[k]);
            along += axis[k] * from[k];
        }
        for (int k = 0; k < 3; k++) {
            double across = axis[(k + 1) % 3] * from[(k + 2) % 3] - axis[(k + 2) % 3] * from[(k + 1) % 3];
            p[k] += (c - 1.0) * from[k] + s * across + (1.0 - c) * along * axis[k];
        }
    }
}

static void cut(qm_context *ctx, qm_mesh *mesh, double part)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    const double end = box.min[0] + part * (box.max[0] - box.min[0]);
    size_t kept = 0;
    for (size_t i = 0; i < mesh->face_count; i++)
        if (mesh->positions[3 * (size_t)mesh->faces[4 * i]] <= end)
            memmove(mesh->faces + 4 * kept++, mesh->faces + 4 * i, 4 * sizeof *mesh->faces);
    if (kept == 0 || mesh->face_origin) bench_fail("part", "the mesh has no such part, or polygons");
    uint32_t *fewer = qm_context_resize(ctx, mesh->faces, mesh->face_count, kept, 4 * sizeof *mesh->faces);
    if (!fewer) bench_fail("memory", "there is not enough");
    mesh->faces = fewer;
    mesh->face_count = kept;
}

qm_mesh bench_read_mesh(qm_context *ctx, const char *path, const bench_change *change)
{
    qm_mesh mesh = bench_read_any(ctx, path);
    if (mesh.face_count == 0)
        bench_fail(path, "is a set of points; this part of the benchmark takes surfaces");
    if (change->refine) bench_refine(ctx, &mesh);
    if (change->coarsen != 0.0) bench_coarsen(&mesh, change->coarsen);
    if (change->shift != 0.0 || change->noise != 0.0) disturb(&mesh, change);
    if (change->turn != 0.0) turn(&mesh, change->turn);
    if (change->part != 0.0) cut(ctx, &mesh, change->part);
    return mesh;
}

qm_mesh bench_read_any(qm_context *ctx, const char *path)
{
    qm_mesh mesh;
    if (bench_make_torus(ctx, path, &mesh)) return mesh;
    size_t size;
    uint8_t *bytes = read_file(path, &size);
    qm_codec_limits limits = {QM_NO_INDEX - 1, QM_NO_INDEX - 1, 1, 0, NULL};
    qm_codec_report report = {0};
    qm_format format = qm_format_from_path(path);
    qm_status status =
        qm_codec_decode(ctx, format == QM_FORMAT_UNKNOWN ? qm_format_sniff(bytes, size) : format, bytes, size,
                        &limits, &mesh, &report);
    free(bytes);
    if (status != QM_OK) bench_fail(path, report.detail);
    return mesh;
}

void bench_write_array(const char *prefix, const char *suffix, const void *data, size_t count, size_t width)
{
    char path[4096];
    int length = snprintf(path, sizeof path, "%s.%s", prefix, suffix);
    FILE *file = length < (int)sizeof path ? fopen(path, "wb") : NULL;
    if (!file || fwrite(data, width, count, file) != count || fclose(file) != 0)
        bench_fail(prefix, "cannot be written");
}

/** number[v] becomes the place of vertex v among the used ones, which move to the front. */
static size_t number_used(qm_mesh *mesh, uint32_t *number)
{
    size_t count = 0;
    for (size_t i = 0; i < 4 * mesh->face_count; i++)
        if (mesh->faces[i] != QM_NO_INDEX) number[mesh->faces[i]] = 1;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        if (!number[v]) continue;
        for (int k = 0; k < 3; k++)
            mesh->positions[3 * count + (size_t)k] = mesh->positions[3 * v + (size_t)k];
        number[v] = (uint32_t)count++;
    }
    return count;
}

static size_t split_faces(const qm_mesh *mesh, const uint32_t *number, uint32_t *triangles)
{
    size_t count = 0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *corner = mesh->faces + 4 * f;
        for (size_t k = 1; k < 3 && corner[k + 1] != QM_NO_INDEX; k++) {
            uint32_t *triangle = triangles + 3 * count++;
            triangle[0] = number[corner[0]];
            triangle[1] = number[corner[k]];
            triangle[2] = number[corner[k + 1]];
        }
    }
    return count;
}

void bench_export(const char *path, const bench_change *change, const char *prefix)
{
    qm_context ctx = qm_context_make();
    qm_mesh mesh = bench_read_mesh(&ctx, path, change);
    qm_box box = qm_mesh_bounding_box(&mesh);
    uint32_t *number = bench_alloc(mesh.vertex_count, sizeof *number);
    uint32_t *triangles = bench_alloc(mesh.face_count, 6 * sizeof *triangles);
    size_t vertex_count = number_used(&mesh, number);
    size_t triangle_count = split_faces(&mesh, number, triangles);
    bench_write_array(prefix, "vertices", mesh.positions, vertex_count, 3 * sizeof *mesh.positions);
    bench_write_array(prefix, "triangles", triangles, triangle_count, 3 * sizeof *triangles);
    printf("{\"vertices\": %zu, \"faces\": %zu, \"triangles\": %zu, \"diagonal\": %.17g}\n", vertex_count,
           mesh.face_count, triangle_count, qm_mesh_box_diagonal(&box));
    free(triangles);
    free(number);
    qm_mesh_reset(&ctx, &mesh);
}

uint32_t *bench_pick_part(const qm_mesh *mesh, size_t *count)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    size_t wanted = mesh->vertex_count / PART + 1;
    uint32_t *part = bench_alloc(mesh->vertex_count, sizeof *part);
    *count = 0;
    for (double reach = 1e-3 * qm_mesh_box_diagonal(&box); *count < wanted; reach *= 1.05) {
        *count = 0;
        for (uint32_t v = 0; v < mesh->vertex_count && *count < wanted; v++) {
            double d2 = 0.0;
            for (int k = 0; k < 3; k++) {
                double d = mesh->positions[3 * (size_t)v + (size_t)k] - mesh->positions[k];
                d2 += d * d;
            }
            if (d2 <= reach * reach) part[(*count)++] = v;
        }
    }
    return part;
}
