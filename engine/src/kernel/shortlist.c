/**
 * shortlist.c: the few facets that matter most for a small piece, side by side in one pack, so that a point
 * is compared with all of them at the price of one pack.
 *
 * The eight least are kept in order in one vector, of keys: a distance as a float, whose bits order like
 * numbers, with the place that it belongs to in its last bits. Inserting takes no branch, where a loop would
 * mispredict most of them.
 */
#include <string.h>

#include "box.h"
#include "kernels.h"

#define PLACE_BITS 8 /* of a key */
#define NO_KEY INT32_MAX

static inline qm_vi keys_min(qm_vi a, qm_vi b)
{
#if defined(__AVX2__)
    return (qm_vi)_mm256_min_epi32((__m256i)a, (__m256i)b);
#else
    qm_vi below = a < b;
    return (a & below) | (b & ~below);
#endif
}

static inline qm_vi keys_max(qm_vi a, qm_vi b)
{
#if defined(__AVX2__)
    return (qm_vi)_mm256_max_epi32((__m256i)a, (__m256i)b);
#else
    qm_vi above = a > b;
    return (a & above) | (b & ~above);
#endif
}

/** Each key moves up when the one below it, or the new one, is greater. */
static inline qm_vi keys_insert(qm_vi keys, int32_t key)
{
    const qm_vi lowest = (qm_vi){0} + INT32_MIN, up = {8, 0, 1, 2, 3, 4, 5, 6};
    qm_vi below = __builtin_shuffle(keys, lowest, up);
    return keys_min(keys, keys_max(below, (qm_vi){0} + key));
}

static inline int32_t key_make(float distance, unsigned place)
{
    int32_t bits;
    memcpy(&bits, &distance, sizeof bits);
    return (int32_t)(((uint32_t)bits & ~((1u << PLACE_BITS) - 1)) | place);
}

static inline unsigned key_place(int32_t key)
{
    return (unsigned)key & ((1u << PLACE_BITS) - 1);
}

/** The eight packs whose boxes are nearest to p. */
static qm_vi nearest_boxes(const qm_near_packs *near, qm_vec p)
{
    qm_box_query query = qm_box_query_point(p);
    qm_vi keys = (qm_vi){0} + NO_KEY;
    for (int first = 0; first < near->count; first += 8) {
        _Alignas(32) float d2[QM_PACK_LANES];
        qm_box_group_within(&near->box[first / 8], &query, 0.0f, d2);
        for (int i = 0; i < 8 && first + i < near->count; i++)
            keys = keys_insert(keys, key_make(d2[i], (unsigned)(first + i)));
    }
    return keys;
}

/** Offers the lanes of the pack at a place of the list. */
static qm_vi offer_lanes(qm_vi keys, const qm_bvh *bvh, uint32_t pack, unsigned place, qm_splat s)
{
    _Alignas(64) double d2[QM_PACK_LANES];
    for (int part = 0; part < QM_PARTS; part++)
        qm_vd_store(d2 + part * QM_WIDTH, qm_pack_part_d2(&bvh->packs[pack], part, s.x, s.y, s.z));
    for (unsigned lane = 0; lane < bvh->lanes[pack].lane_count; lane++)
        keys = keys_insert(keys, key_make((float)d2[lane], place << 3 | lane));
    return keys;
}

void QM_KERNEL(shortlist)(const qm_bvh *bvh, const qm_near_packs *near, qm_vec p, qm_shortlist *list)
{
    qm_splat s = qm_splat_make(p);
    qm_vi boxes = nearest_boxes(near, p), lanes = (qm_vi){0} + NO_KEY;
    for (int i = 0; i < 8 && boxes[i] != NO_KEY; i++) {
        unsigned place = key_place(boxes[i]);
        if (i > 0 && boxes[i] > lanes[QM_PACK_LANES - 1]) break;
        lanes = offer_lanes(lanes, bvh, near->pack[place], place, s);
    }
    const double *from[QM_PACK_LANES];
    for (int j = 0; j < QM_PACK_LANES; j++) {
        unsigned place = key_place(lanes[lanes[j] == NO_KEY ? 0 : j]);
        list->origin[j] = near->pack[place >> 3];
        list->lane[j] = (uint8_t)(place & 7);
        from[j] = &bvh->packs[list->origin[j]].row[0][list->lane[j]];
    }
    for (int r = 0; r < QM_ROW_COUNT; r++)
        for (int j = 0; j < QM_PACK_LANES; j++)
            list->pack.row[r][j] = from[j][r * QM_PACK_LANES];
}
