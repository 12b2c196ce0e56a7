/*
 * libFuzzer target over the decoders: the input is a file, of the format that the environment names in
 * FUZZ_FORMAT; without it the format is sniffed. gzip stands for the layer around all formats. tests/fuzz/run.sh runs it
 * for each.
 */
#include <stdlib.h>
#include <string.h>

#include "format/gzip.h"

#define MAX_INFLATED 1000000

/** Counting the file must agree with the mesh that was decoded from it. */
static void check_counts(const qm_mesh *mesh, qm_format format, const uint8_t *data, size_t size,
                         const qm_codec_limits *limits)
{
    qm_context ctx = qm_context_make();
    qm_codec_counts counts;
    qm_codec_report report;
    if (qm_codec_count(&ctx, format, data, size, limits, &counts, &report) != QM_OK) abort();
    if (counts.vertices > mesh->vertex_count || counts.faces > mesh->face_count) abort();
    if (counts.is_exact && (counts.vertices != mesh->vertex_count || counts.faces != mesh->face_count))
        abort();
}

static int inflate_input(const uint8_t *data, size_t size)
{
    qm_context ctx = qm_context_make();
    qm_gzip_content content;
    qm_codec_report report = {.detail = ""};
    qm_status status = qm_gzip_inflate(&ctx, data, size, MAX_INFLATED, &content, &report);
    size_t measured;
    qm_codec_report other = {.detail = ""};
    if (qm_gzip_measure(&ctx, data, size, MAX_INFLATED, &measured, &other) != status) abort();
    if (status == QM_OK && measured != content.size) abort();
    if (status == QM_OK ? content.size > MAX_INFLATED : content.bytes || !report.detail[0]) abort();
    qm_gzip_content_free(&ctx, &content);
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *name = getenv("FUZZ_FORMAT");
    if (name && strcmp(name, "gzip") == 0) return inflate_input(data, size);
    qm_context ctx = qm_context_make();
    qm_codec_limits limits = {100000, 100000, 1, MAX_INFLATED, NULL};
    qm_format format = name ? qm_format_from_name(name) : qm_format_sniff(data, size);
    qm_mesh mesh;
    qm_codec_report report;
    qm_status status = qm_codec_decode(&ctx, format, data, size, &limits, &mesh, &report);
    if (status == QM_OK && qm_mesh_validate(&ctx, &mesh) != QM_OK) abort();
    if (status == QM_OK) check_counts(&mesh, format, data, size, &limits);
    if (status != QM_OK && (mesh.positions || !report.detail[0])) abort();
    qm_mesh_reset(&ctx, &mesh);
    return 0;
}
