#include "soup.h"

#include <string.h>

uint8_t qm_bytes_take(qm_bytes *bytes)
{
    if (bytes->size == 0) return 0;
    bytes->size--;
    return *bytes->next++;
}

static double read_coordinate(qm_bytes *bytes, qm_soup_kind kind, double scale)
{
    if (kind == QM_SOUP_WHOLE) return (double)(int8_t)qm_bytes_take(bytes);
    uint64_t bits = 0;
    for (int i = kind == QM_SOUP_FINE ? 2 : 8; i > 0; i--)
        bits = bits << 8 | qm_bytes_take(bytes);
    if (kind == QM_SOUP_FINE) return scale * (double)(int16_t)bits;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

void qm_soup_move(qm_soup *soup, qm_bytes *bytes, qm_soup_kind kind, double scale)
{
    for (size_t i = 0; i < 3 * soup->mesh.vertex_count; i++)
        soup->positions[i] = read_coordinate(bytes, kind, scale);
}

/** A nibble a corner: 15 ends a triangle where the fourth is due. */
static void read_face(qm_bytes *bytes, size_t vertex_count, uint32_t face[4])
{
    for (int i = 0; i < 4; i += 2) {
        uint8_t pair = qm_bytes_take(bytes);
        face[i] = (pair & 15) % (uint32_t)vertex_count;
        face[i + 1] = (pair >> 4) % (uint32_t)vertex_count;
        if (i == 2 && pair >> 4 == 15) face[3] = QM_NO_INDEX;
    }
}

void qm_soup_read(qm_soup *out, qm_bytes *bytes, qm_soup_kind kind, double scale)
{
    out->mesh = (qm_mesh){.positions = out->positions, .faces = out->faces};
    out->mesh.vertex_count = 1 + qm_bytes_take(bytes) % QM_SOUP_VERTICES;
    out->mesh.face_count = qm_bytes_take(bytes) % (QM_SOUP_FACES + 1);
    for (size_t i = 0; i < out->mesh.face_count; i++)
        read_face(bytes, out->mesh.vertex_count, out->faces + 4 * i);
    qm_soup_move(out, bytes, kind, scale);
}
