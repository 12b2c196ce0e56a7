/**
 * heatmap_ply.c: heat maps as binary PLY.
 */
#include "heatmap_ply.h"

#include <endian.h>
#include <string.h>

#include "qm/heatmap.h"

enum { CORNER_NUMBERS = 12 }; /* of a row: position and distance of three corners */

static void add_double(qm_text *out, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits = htole64(bits);
    qm_text_add(out, (const char *)&bits, sizeof bits);
}

static void add_index(qm_text *out, uint64_t value)
{
    uint32_t bits = htole32((uint32_t)value);
    qm_text_add(out, (const char *)&bits, sizeof bits);
}

void qm_heatmap_ply_begin(qm_text *out, uint64_t count, double error)
{
    char number[QM_NUMBER_SIZE];
    qm_text_printf(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment distances are within %s of what is interpolated\n"
        "element vertex %llu\nproperty double x\nproperty double y\nproperty double z\nproperty double "
        "quality\n"
        "element face %llu\nproperty list uchar uint vertex_indices\nproperty uint source_face\n"
        "property double error\nend_header\n",
        qm_text_number(error, number), 3 * (unsigned long long)count, (unsigned long long)count);
}

void qm_heatmap_ply_add_corners(qm_text *out, const double *row, size_t count)
{
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < CORNER_NUMBERS; k++)
            add_double(out, row[QM_HEATMAP_COLUMNS * i + (size_t)k]);
}

void qm_heatmap_ply_add_faces(qm_text *out, const double *row, uint64_t first, size_t count)
{
    for (size_t i = 0; i < count; i++, row += QM_HEATMAP_COLUMNS) {
        qm_text_add(out, "\3", 1);
        for (uint64_t corner = 0; corner < 3; corner++)
            add_index(out, 3 * (first + i) + corner);
        add_index(out, (uint64_t)row[QM_HEATMAP_FACE]);
        add_double(out, row[QM_HEATMAP_ERROR]);
    }
}
