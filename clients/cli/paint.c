#include "paint.h"

#include <endian.h>
#include <math.h>
#include <string.h>

/* Lightness rises evenly from end to end, so that the order is seen in grey as well; hues that the
 * colour-blind tell apart. */
static const double stops[][3] = {{38, 22, 92},   {48, 62, 142},  {40, 100, 152}, {32, 134, 146},
                                  {52, 164, 122}, {112, 190, 84}, {184, 210, 62}, {246, 226, 62}};
enum { STOPS = sizeof stops / sizeof stops[0] };

/** The colour of a share from 0 to 1. */
static void find_colour(double share, uint8_t out[3])
{
    double place = share * (STOPS - 1);
    int below = place >= STOPS - 1 ? STOPS - 2 : (int)place;
    double part = place - below;
    for (int i = 0; i < 3; i++)
        out[i] = (uint8_t)lround(stops[below][i] + part * (stops[below + 1][i] - stops[below][i]));
}

static void write_double(FILE *file, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits = htole64(bits);
    fwrite(&bits, sizeof bits, 1, file);
}

static void write_face(FILE *file, const uint32_t *index)
{
    uint8_t count = index[3] == QM_NO_INDEX ? 3 : 4;
    fwrite(&count, 1, 1, file);
    for (int i = 0; i < count; i++) {
        uint32_t place = htole32(index[i]);
        fwrite(&place, sizeof place, 1, file);
    }
}

bool cli_paint(FILE *file, const qm_mesh *mesh, const double *value)
{
    double greatest = 0.0;
    for (size_t i = 0; i < mesh->vertex_count; i++)
        greatest = fmax(greatest, value[i]);
    fprintf(
        file,
        "ply\nformat binary_little_endian 1.0\nelement vertex %zu\nproperty double x\nproperty double y\n"
        "property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "property double quality\nelement face %zu\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh->vertex_count, mesh->face_count);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        uint8_t colour[3];
        for (int k = 0; k < 3; k++)
            write_double(file, mesh->positions[3 * i + (size_t)k]);
        find_colour(greatest > 0.0 ? value[i] / greatest : 0.0, colour);
        fwrite(colour, 1, sizeof colour, file);
        write_double(file, value[i]);
    }
    for (size_t i = 0; i < mesh->face_count; i++)
        write_face(file, mesh->faces + 4 * i);
    return !ferror(file);
}
