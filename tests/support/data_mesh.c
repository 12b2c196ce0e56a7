#include "data_mesh.h"

#include "check.h"

#include "format/codec.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

const char *qm_data_folder(void)
{
    const char *folder = getenv("QM_TEST_DATA");
    return folder ? folder : "../shared/data";
}

bool qm_data_is_there(void)
{
    return access(qm_data_folder(), R_OK) == 0;
}

int qm_data_skip_tests(size_t count)
{
    printf("NOT RUN %zu: there is no %s\n", count, qm_data_folder());
    const char *required = getenv("QM_REQUIRE_DATA");
    return required && *required && strcmp(required, "0") != 0 ? (int)count : 0;
}

void qm_data_mesh_read(qm_context *ctx, const char *name, qm_mesh *mesh)
{
    char path[512];
    snprintf(path, sizeof path, "%s/%s", qm_data_folder(), name);
    FILE *file = fopen(path, "rb");
    QM_CHECK(file, "%s is missing", path);
    fseek(file, 0, SEEK_END);
    size_t size = (size_t)ftell(file);
    rewind(file);
    uint8_t *bytes = malloc(size);
    assert_non_null(bytes);
    assert_int_equal(fread(bytes, 1, size, file), size);
    fclose(file);
    qm_codec_limits limits = {10000000, 10000000, 1, 0, NULL};
    qm_codec_report report = {0};
    qm_status status = qm_codec_decode(ctx, qm_format_from_path(name), bytes, size, &limits, mesh, &report);
    free(bytes);
    QM_CHECK(status == QM_OK, "%s: %s", name, report.detail);
}
