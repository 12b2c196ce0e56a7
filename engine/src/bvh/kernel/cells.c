/**
 * cells.c: the cells of a grid that eight faces reach into, which of these faces reach into a marked cell,
 * and lists of faces with their cells.
 */
#include <string.h>

#include "box.h"
#include "bvh/cell_grid.h"
#include "kernels.h"

typedef uint8_t qm_vb __attribute__((vector_size(32)));
typedef uint8_t qm_vs __attribute__((vector_size(16)));
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

/** Min and max of half as many bytes. */
static inline qm_vs half_min(qm_vs a, qm_vs b)
{
#if defined(__AVX2__)
    return (qm_vs)_mm_min_epu8((__m128i)a, (__m128i)b);
#else
    qm_vs below = (qm_vs)(a < b);
    return (a & below) | (b & ~below);
#endif
}

static inline qm_vs half_max(qm_vs a, qm_vs b)
{
#if defined(__AVX2__)
    return (qm_vs)_mm_max_epu8((__m128i)a, (__m128i)b);
#else
    qm_vs above = (qm_vs)(a > b);
    return (a & above) | (b & ~above);
#endif
}

static inline qm_vs cell_bytes(const qm_cell *cells, uint32_t vertex)
{
    typedef uint32_t four __attribute__((vector_size(16)));
    return (qm_vs)(four){cells[vertex]};
}

/** Lanes in which each byte of a is at max that of b. */
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

/** The cells that the box of a face reaches into, in the first lanes. */
typedef struct one_box {
    qm_vs low, high;
} one_box;

/** Bounds one face at a time: vertices lie anywhere in memory, and a gather loads them no faster. */
static inline one_box box_of_face(const qm_cell *cells, const uint32_t *face)
{
    qm_vs a = cell_bytes(cells, face[0]), b = cell_bytes(cells, face[1]), c = cell_bytes(cells, face[2]);
    one_box box = {half_min(a, half_min(b, c)), half_max(a, half_max(b, c))};
    if (face[3] != QM_NO_INDEX) {
        qm_vs d = cell_bytes(cells, face[3]);
        box = (one_box){half_min(box.low, d), half_max(box.high, d)};
    }
    return box;
}

/** Joins the first lanes of eight vectors. */
static inline qm_vb join_first(const qm_vs one[QM_CELL_FACES])
{
    typedef uint32_t four __attribute__((vector_size(16)));
    four pair[QM_CELL_FACES / 2], half[2];
    for (int i = 0; i < QM_CELL_FACES / 2; i++)
        pair[i] = __builtin_shufflevector((four)one[2 * i], (four)one[2 * i + 1], 0, 4, 1, 5);
    for (int i = 0; i < 2; i++)
        half[i] = __builtin_shufflevector(pair[2 * i], pair[2 * i + 1], 0, 1, 4, 5);
    return (qm_vb)__builtin_shufflevector(half[0], half[1], 0, 1, 2, 3, 4, 5, 6, 7);
}

unsigned QM_KERNEL(cell_boxes)(const qm_cell_grid *grid, const uint32_t *faces, const qm_cell *cells,
                               qm_cell_boxes *out)
{
    qm_vs lows[QM_CELL_FACES], highs[QM_CELL_FACES];
#pragma GCC unroll 8
    for (int i = 0; i < QM_CELL_FACES; i++) {
        one_box box = box_of_face(cells, faces + 4 * i);
        lows[i] = box.low;
        highs[i] = box.high;
    }
    qm_vb low = join_first(lows), high = join_first(highs);
    store(out->low, low);
    store(out->high, high);
    const qm_cell first = 1 << QM_CELL_X | 1 << QM_CELL_Y | 1 << QM_CELL_Z;
    const qm_cell last =
        grid->count[0] << QM_CELL_X | grid->count[1] << QM_CELL_Y | grid->count[2] << QM_CELL_Z;
    const qm_vu zero = {0};
    return qm_vi_bits(at_most((qm_vb)(zero + first), high) & at_most(low, (qm_vb)(zero + last)));
}

/** Loads 32 marks of a word, from the byte that holds z. */
static inline qm_vu marks_of(const qm_cell_marks *marks, qm_vu word, qm_vu z)
{
#if defined(__AVX2__)
    qm_vu byte = word * (uint32_t)sizeof(qm_cell_row) + (z >> 3);
    return (qm_vu)_mm256_i32gather_epi32((const int *)(const void *)marks, (__m256i)byte, 1);
#else
    qm_vu out;
    for (int i = 0; i < QM_CELL_FACES; i++)
        out[i] = (uint32_t)(marks[word[i] / 4].over[word[i] % 4] >> (z[i] & ~7u));
    return out;
#endif
}

unsigned QM_KERNEL(cells_marked)(const qm_cell_grid *grid, const qm_cell_marks *marks,
                                 const qm_cell_boxes *boxes, unsigned *large)
{
    const qm_vu zero = {0}, low = load(boxes->low), span = load(boxes->high) - low;
    const qm_cell max = 1 << QM_CELL_X | 1 << QM_CELL_Y | QM_CELL_SPAN << QM_CELL_Z;
    qm_vi is_small = at_most((qm_vb)span, (qm_vb)(zero + max));
    qm_vu row = (low >> QM_CELL_X) * qm_cell_stride(grid) + (low >> QM_CELL_Y & 0xff), z = low & 0xff;
    qm_vu more = (span >> (QM_CELL_X - 1) & 2) | (span >> QM_CELL_Y & 1);
    qm_vu found = marks_of(marks, 4 * row + more, z);
    qm_vu wanted = (((zero + 2) << (span & 31)) - 1) << (z & 7);
    *large = ~qm_vi_bits(is_small) & 0xff;
    return qm_vi_bits((qm_vi)((found & wanted) != zero) & is_small);
}

/** The indices of the marked lanes in ascending order; the remaining lanes are arbitrary. */
static inline qm_vu compress_lanes(unsigned marked)
{
#if defined(__AVX2__)
    uint64_t bytes = _pdep_u64(marked, 0x0101010101010101) * 0xff;
    return (qm_vu)_mm256_cvtepu8_epi32(_mm_cvtsi64_si128((int64_t)_pext_u64(0x0706050403020100, bytes)));
#else
    qm_vu lanes = {0};
    for (unsigned i = 0, n = 0; i < QM_CELL_FACES; i++) {
        lanes[n] = i;
        n += marked >> i & 1;
    }
    return lanes;
#endif
}

static inline qm_vu permute(qm_vu a, qm_vu lanes)
{
#if defined(__AVX2__)
    return (qm_vu)_mm256_permutevar8x32_epi32((__m256i)a, (__m256i)lanes);
#else
    qm_vu out;
    for (int i = 0; i < QM_CELL_FACES; i++)
        out[i] = a[lanes[i]];
    return out;
#endif
}

void QM_KERNEL(append_cells)(const qm_cell_boxes *boxes, uint32_t first, unsigned faces, qm_cell_list *list)
{
    QM_ASSERT(list->count <= QM_CELL_LIST);
    qm_vu lanes = compress_lanes(faces), face = lanes + first, low = permute(load(boxes->low), lanes),
          high = permute(load(boxes->high), lanes);
    memcpy(list->face + list->count, &face, sizeof face);
    memcpy(list->low + list->count, &low, sizeof low);
    memcpy(list->high + list->count, &high, sizeof high);
    list->count += (unsigned)__builtin_popcount(faces);
}
