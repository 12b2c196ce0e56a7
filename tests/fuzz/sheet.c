#include "sheet.h"

#include <math.h>
#include <string.h>

#define WHOLE 6.283185307179586

double qm_bytes_take_share(qm_bytes *bytes)
{
    return qm_bytes_take(bytes) / 255.0;
}

double qm_bytes_take_harm(qm_bytes *bytes)
{
    static const double numbers[] = {0.0,  -0.0, 1e160,  -1e160,   1e308,  -1.7e308,
                                     1e30, 1e-3, 1e-160, 4.9e-324, 0x1p53, 1.0};
    enum { COUNT = sizeof numbers / sizeof *numbers };
    uint8_t kind = qm_bytes_take(bytes) % (COUNT + 4);
    if (kind < COUNT) return numbers[kind];
    if (kind == COUNT) return NAN;
    if (kind == COUNT + 1) return INFINITY;
    if (kind == COUNT + 2) return 4 * qm_bytes_take_share(bytes) - 2;
    double value;
    uint8_t bits[sizeof value];
    for (size_t i = 0; i < sizeof bits; i++)
        bits[i] = qm_bytes_take(bytes);
    memcpy(&value, bits, sizeof value);
    return value;
}

/** A tube of half-width `reach` round the z axis, whose section is turned by this angle. */
static void place_on_ring(double u, double across, double up, double turn, double out[3])
{
    double radius = 1 + across * cos(turn) - up * sin(turn);
    out[0] = radius * cos(WHOLE * u);
    out[1] = radius * sin(WHOLE * u);
    out[2] = across * sin(turn) + up * cos(turn);
}

void qm_sheet_at(const qm_sheet_grid *grid, double u, double v, double out[3])
{
    double around = WHOLE * v, half = WHOLE * u / 2;
    out[0] = u;
    out[1] = v;
    out[2] = 0;
    switch (grid->shape) {
    case QM_SHEET_SADDLE:
        out[2] = (2 * u - 1) * (2 * v - 1);
        break;
    case QM_SHEET_TORUS:
        place_on_ring(u, 0.4 * cos(around), 0.4 * sin(around), 0, out);
        break;
    case QM_SHEET_MOEBIUS:
        place_on_ring(u, 0.8 * (v - 0.5), 0, half, out);
        break;
    case QM_SHEET_KLEIN: /* an eight in section, which is turned by half: v then runs the other way */
        place_on_ring(u, 0.4 * sin(around), 0.4 * sin(2 * around), half, out);
        break;
    case QM_SHEET_SPINDLE:
        out[0] = sin(WHOLE * v / 2) * cos(WHOLE * u);
        out[1] = sin(WHOLE * v / 2) * sin(WHOLE * u);
        out[2] = cos(WHOLE * v / 2);
        break;
    case QM_SHEET_FOLDED:
        out[0] = fabs(u - 0.4);
        break;
    case QM_SHEET_POINT:
        out[0] = out[1] = 1;
        break;
    default:
        break;
    }
    for (int k = 0; k < 3; k++)
        out[k] *= grid->scale;
}

uint32_t qm_sheet_number(const qm_sheet_grid *grid, int i, int j)
{
    if (grid->wrap_u && i == grid->columns) {
        i = 0;
        if (grid->is_turned) j = grid->rows - j;
    }
    if (grid->wrap_v && j == grid->rows) j = 0;
    int width = grid->wrap_u ? grid->columns : grid->columns + 1;
    return (uint32_t)(j * width + i);
}

size_t qm_sheet_count(const qm_sheet_grid *grid)
{
    return (size_t)(grid->wrap_u ? grid->columns : grid->columns + 1) *
           (size_t)(grid->wrap_v ? grid->rows : grid->rows + 1);
}

qm_sheet_grid qm_sheet_read_grid(qm_bytes *bytes, int most)
{
    static const double scales[] = {1.0, 1.0, 1.0, 1.0, 1e-160, 1e150, 1e-5, 1e100, 0x1p-1000, 1e6};
    qm_sheet_grid grid = {.shape = (qm_sheet_shape)(qm_bytes_take(bytes) % QM_SHEET_SHAPE_COUNT),
                          .scale = scales[qm_bytes_take(bytes) % (sizeof scales / sizeof *scales)]};
    grid.columns = 1 + qm_bytes_take(bytes) % most;
    grid.rows = 1 + qm_bytes_take(bytes) % most;
    grid.is_turned = grid.shape == QM_SHEET_MOEBIUS || grid.shape == QM_SHEET_KLEIN;
    grid.wrap_u = grid.is_turned || grid.shape == QM_SHEET_TORUS || grid.shape == QM_SHEET_SPINDLE;
    grid.wrap_v = grid.shape == QM_SHEET_TORUS || grid.shape == QM_SHEET_KLEIN;
    return grid;
}

void qm_sheet_make(const qm_sheet_grid *grid, qm_sheet *out)
{
    out->grid = *grid;
    out->mesh = (qm_mesh){.positions = out->positions,
                          .faces = out->faces,
                          .vertex_count = qm_sheet_count(grid),
                          .face_count = (size_t)(grid->columns * grid->rows)};
    for (int j = grid->rows; j >= 0; j--) /* the first of joined points is written last */
        for (int i = grid->columns; i >= 0; i--)
            qm_sheet_at(grid, (double)i / grid->columns, (double)j / grid->rows,
                        out->positions + 3 * qm_sheet_number(grid, i, j));
    uint32_t *face = out->faces;
    for (int j = 0; j < grid->rows; j++)
        for (int i = 0; i < grid->columns; i++, face += 4) {
            face[0] = qm_sheet_number(grid, i, j);
            face[1] = qm_sheet_number(grid, i + 1, j);
            face[2] = qm_sheet_number(grid, i + 1, j + 1);
            face[3] = qm_sheet_number(grid, i, j + 1);
        }
}

static void lose_face(qm_mesh *mesh, uint32_t *face)
{
    memcpy(face, mesh->faces + 4 * --mesh->face_count, 4 * sizeof *face);
}

static void turn_over(uint32_t *face)
{
    uint32_t first = face[0];
    face[0] = face[2];
    face[2] = first;
}

static void merge(qm_mesh *mesh, uint32_t from, uint32_t to)
{
    for (size_t i = 0; i < 4 * mesh->face_count; i++)
        if (mesh->faces[i] == from) mesh->faces[i] = to;
}

void qm_sheet_break(qm_sheet *sheet, qm_bytes *bytes)
{
    qm_mesh *mesh = &sheet->mesh;
    for (int left = qm_bytes_take(bytes) % 24; left > 0 && mesh->face_count > 1; left--) {
        uint8_t way = qm_bytes_take(bytes) % 7;
        uint32_t *face = mesh->faces + 4 * (qm_bytes_take(bytes) % mesh->face_count);
        const uint32_t *other = mesh->faces + 4 * (qm_bytes_take(bytes) % mesh->face_count);
        uint32_t vertex = qm_bytes_take(bytes) % (uint32_t)mesh->vertex_count;
        if (way == 0)
            lose_face(mesh, face);
        else if (way == 1)
            turn_over(face);
        else if (way == 2) /* stands twice */
            memmove(face, other, 4 * sizeof *face);
        else if (way == 3)
            face[3] = QM_NO_INDEX;
        else if (way == 4)
            merge(mesh, vertex, other[0]);
        else if (way == 5)
            face[qm_bytes_take(bytes) % 3] = vertex;
        else
            mesh->positions[3 * vertex + qm_bytes_take(bytes) % 3] = qm_bytes_take_harm(bytes);
    }
}
