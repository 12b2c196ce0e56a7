/*
 * libFuzzer target over every decoder: the first byte chooses the format, the rest is the file. Build and run
 * it with `make fuzz`; a corpus is a folder of files with that byte in front, as fuzz_corpus.sh makes it.
 */
#include "codec.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0) return 0;
    qm_context ctx = qm_context_make();
    qm_codec_limits limits = {100000, 100000};
    qm_format format = (qm_format)(data[0] % (QM_FORMAT_XYZ + 1));
    qm_mesh mesh;
    qm_codec_report report;
    if (format == QM_FORMAT_UNKNOWN) format = qm_format_sniff(data + 1, size - 1);
    qm_status status = qm_codec_decode(&ctx, format, data + 1, size - 1, &limits, &mesh, &report);
    if (status == QM_OK && qm_mesh_validate(&ctx, &mesh) != QM_OK) __builtin_trap();
    if (status != QM_OK && (mesh.positions || !report.detail[0])) __builtin_trap();
    qm_mesh_reset(&ctx, &mesh);
    return 0;
}
