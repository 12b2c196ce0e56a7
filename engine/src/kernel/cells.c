/**
 * cells.c: the cells of a grid that eight faces reach into, and whether any of those is marked.
 */
#include "../collide_cells.h"
#include "box.h"
#include "kernels.h"

typedef uint8_t qm_vb __attribute__((vector_size(32)));
typedef uint32_t qm_vu __attribute__((vector_size(32)));

static inline qm_vb bytes_min(qm_vb a, qm_vb b)
{
#if defined(__AVX2__)
    return (qm_vb)_mm256_min_epu8((__m256i)a, (__m256i)b);
#else
    qm_vb below = (qm_vb)(a < b);
    return (a & below) | (b & ~below);
#endif
}

static inline qm_vb bytes_max(qm_vb a, qm_vb b)
{
#if defined(__AVX2__)
    return (qm_vb)_mm256_max_epu8((__m256i)a, (__m256i)b);
#else
    qm_vb above = (qm_vb)(a > b);
    return (a & above) | (b & ~above);
#endif
}

/** Lanes in which no byte of a is greater than that of b. */
static inline qm_vi at_most(qm_vb a, qm_vb b)
{
    return (qm_vi)(bytes_max(a, b) == b) == -1;
}

static inline qm_vu load(const uint32_t *p)
{
    return *(const qm_vu *)(const void *)p;
}

static inline void store(uint32_t *p, qm_vb a)
{
    *(qm_vb *)(void *)p = a;
}

/** The corners of eight faces by corner; a triangle has its third one twice. */
static inline void load_corners(const uint32_t *faces, qm_vu corner[4])
{
    typedef uint32_t four __attribute__((vector_size(16), aligned(4)));
    qm_vu row[4]; /* i and i + 4 */
    for (int i = 0; i < 4; i++) {
        four low = *(const four *)(const void *)(faces + 4 * i),
             high = *(const four *)(const void *)(faces + 4 * (i + 4));
        row[i] = __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
    }
    qm_vu first01 = __builtin_shufflevector(row[0], row[1], 0, 8, 1, 9, 4, 12, 5, 13),
          first23 = __builtin_shufflevector(row[2], row[3], 0, 8, 1, 9, 4, 12, 5, 13),
          last01 = __builtin_shufflevector(row[0], row[1], 2, 10, 3, 11, 6, 14, 7, 15),
          last23 = __builtin_shufflevector(row[2], row[3], 2, 10, 3, 11, 6, 14, 7, 15);
    corner[0] = __builtin_shufflevector(first01, first23, 0, 1, 8, 9, 4, 5, 12, 13);
    corner[1] = __builtin_shufflevector(first01, first23, 2, 3, 10, 11, 6, 7, 14, 15);
    corner[2] = __builtin_shufflevector(last01, last23, 0, 1, 8, 9, 4, 5, 12, 13);
    corner[3] = __builtin_shufflevector(last01, last23, 2, 3, 10, 11, 6, 7, 14, 15);
    qm_vi is_missing = (qm_vi)(corner[3] == QM_NO_INDEX);
    corner[3] = (qm_vu)qm_vi_select(is_missing, (qm_vi)corner[2], (qm_vi)corner[3]);
}

static inline qm_vb cells_of(const qm_cell *cells, qm_vu vertex)
{
#if defined(__AVX2__)
    return (qm_vb)_mm256_i32gather_epi32((const int *)cells, (__m256i)vertex, sizeof *cells);
#else
    qm_vu out;
    for (int i = 0; i < QM_CELL_FACES; i++)
        out[i] = cells[vertex[i]];
    return (qm_vb)out;
#endif
}

unsigned QM_KERNEL(cell_boxes)(const qm_cell_grid *grid, const uint32_t *faces, const qm_cell *cells,
                               qm_cell_boxes *out)
{
    qm_vu corner[4];
    load_corners(faces, corner);
    qm_vb low = cells_of(cells, corner[0]), high = low;
    for (int i = 1; i < 4; i++) {
        qm_vb cell = cells_of(cells, corner[i]);
        low = bytes_min(low, cell);
        high = bytes_max(high, cell);
    }
    store(out->low, low);
    store(out->high, high);
    const qm_cell first = 1 << QM_CELL_X | 1 << QM_CELL_Y | 1 << QM_CELL_Z;
    const qm_cell last =
        grid->count[0] << QM_CELL_X | grid->count[1] << QM_CELL_Y | grid->count[2] << QM_CELL_Z;
    const qm_vu zero = {0};
    return qm_vi_bits(at_most((qm_vb)(zero + first), high) & at_most(low, (qm_vb)(zero + last)));
}

/** 32 marks of a row from the byte on that z lies in. */
static inline qm_vu marks_of(const qm_cell_row *marks, qm_vu row, qm_vu z)
{
#if defined(__AVX2__)
    qm_vu byte = row * (uint32_t)sizeof *marks + (z >> 3);
    return (qm_vu)_mm256_i32gather_epi32((const int *)(const void *)marks, (__m256i)byte, 1);
#else
    qm_vu out;
    for (int i = 0; i < QM_CELL_FACES; i++)
        out[i] = (uint32_t)(marks[row[i]] >> (z[i] & ~7u));
    return out;
#endif
}

unsigned QM_KERNEL(cells_marked)(const qm_cell_grid *grid, const qm_cell_row *marks,
                                 const qm_cell_boxes *boxes, unsigned *large)
{
    const qm_vu zero = {0}, low = load(boxes->low), high = load(boxes->high), span = high - low;
    const qm_cell most = 1 << QM_CELL_X | 1 << QM_CELL_Y | QM_CELL_SPAN << QM_CELL_Z;
    qm_vi is_small = at_most((qm_vb)span, (qm_vb)(zero + most));
    uint32_t stride = qm_cell_stride(grid);
    qm_vu x[2] = {(low >> QM_CELL_X) * stride, (high >> QM_CELL_X) * stride},
          y[2] = {low >> QM_CELL_Y & 0xff, high >> QM_CELL_Y & 0xff}, z = low & 0xff;
    qm_vu found = marks_of(marks, x[0] + y[0], z) | marks_of(marks, x[0] + y[1], z) |
                  marks_of(marks, x[1] + y[0], z) | marks_of(marks, x[1] + y[1], z);
    qm_vu wanted = (((zero + 2) << (span & 31)) - 1) << (z & 7);
    *large = ~qm_vi_bits(is_small) & 0xff;
    return qm_vi_bits((qm_vi)((found & wanted) != zero) & is_small);
}
