#include "bvh_rows.h"

#include <threads.h>

#include "bvh_pack.h"

const qm_pack *qm_bvh_make_rows(const qm_bvh *bvh, size_t pack)
{
    qm_pack *rows = &bvh->rows[pack];
    atomic_uchar *state = &bvh->rows_state[pack];
    unsigned char before = QM_ROWS_NONE;
    if (atomic_compare_exchange_strong(state, &before, QM_ROWS_IN_WORK)) {
        qm_pack_corners corners;
        qm_bvh_load_corners(bvh, pack, &corners);
        qm_kernel_get()->fill_pack(rows, corners.at);
        atomic_store_explicit(state, QM_ROWS_MADE, memory_order_release);
    }
    while (atomic_load_explicit(state, memory_order_acquire) != QM_ROWS_MADE)
        thrd_yield();
    return rows;
}
