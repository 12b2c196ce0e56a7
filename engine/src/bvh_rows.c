#include "bvh_rows.h"

#include <threads.h>

#include "bvh_pack.h"

static void make_rows(const qm_bvh *bvh, size_t pack, unsigned place)
{
    qm_pack_corners corners;
    qm_bvh_load_corners(bvh, pack, &corners);
    qm_kernel_get()->fill_pack(&bvh->rows[place], corners.at);
    atomic_store_explicit(&bvh->rows_place[pack], place, memory_order_release);
}

const qm_pack *qm_bvh_make_rows(const qm_bvh *bvh, size_t pack)
{
    for (;;) {
        unsigned place = atomic_load_explicit(&bvh->rows_place[pack], memory_order_acquire);
        if (place < QM_ROWS_STALE) return &bvh->rows[place];
        if (place == QM_ROWS_IN_WORK ||
            !atomic_compare_exchange_strong(&bvh->rows_place[pack], &place, QM_ROWS_IN_WORK)) {
            thrd_yield();
            continue;
        }
        bool is_new = place == QM_ROWS_NONE;
        make_rows(bvh, pack, is_new ? atomic_fetch_add(bvh->rows_used, 1) : place & ~QM_ROWS_STALE);
    }
}
