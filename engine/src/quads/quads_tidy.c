/**
 * quads_tidy.c: fewer irregular vertices by local changes of a quad mesh that keep its topology: a quad is contracted along a
 * diagonal, or the edge between two quads is turned. The irregularity of a vertex is the difference between the number of its
 * quads and the number that its angle has room for: 4 inside, on each side of a feature what is nearest to its angle.
 */
#include "quads/quads_sides.h"

#include <stdlib.h>

#define ROUNDS 8
#define STRAIGHT_COST 6
#define OFF_COST 3

/** Less is better; one vertex that is off by much is better than many that are off by one. A corner that would have to
 * open to 180 degrees, such as one of two inside or a single one on a straight feature, has no shape at all. */
static int irregularity(qm_quads_sector s, int change)
{
    int quads = s.quads + change, off = quads - s.wanted;
    return (off != 0 ? OFF_COST + abs(off) : 0) + (2 * quads <= s.wanted ? STRAIGHT_COST : 0);
}

static int contraction_gain(qm_quads_sides *t, uint32_t side)
{
    uint32_t s1 = qm_quads_next(side), s2 = qm_quads_next(s1), s3 = qm_quads_next(s2);
    qm_quads_sector a = qm_quads_sector_at(t, side), b = qm_quads_sector_at(t, s1),
                    c = qm_quads_sector_at(t, s2), d = qm_quads_sector_at(t, s3);
    /* a vertex of one quad at a feature, or none at all, would be left */
    if (b.quads < 2 || d.quads < 2 || c.quads + a.quads - 2 < 1) return 0;
    if (b.wanted == 4 && b.quads == 2 && a.quads != 2) return 0;
    int before = irregularity(a, 0) + irregularity(b, 0) + irregularity(c, 0) + irregularity(d, 0);
    return before - irregularity(c, a.quads - 2) - irregularity(b, -1) - irregularity(d, -1);
}

static bool try_turn(qm_quads_sides *t, uint32_t side)
{
    qm_quads_hexagon x;
    if (!qm_quads_find_hexagon(t, side, &x)) return false;
    int best = 0, best_gain = 0;
    for (int k = 1; k < 3; k++) {
        int gain = 0;
        for (int end = 0; end < 6; end += 3) {
            gain += irregularity(x.sector[end], 0) - irregularity(x.sector[end], -1);
            gain += irregularity(x.sector[k + end], 0) - irregularity(x.sector[k + end], 1);
        }
        if (gain > best_gain && qm_quads_can_turn(t, &x, k)) best = k, best_gain = gain;
    }
    if (best_gain == 0) return false;
    qm_quads_turn(t, &x, best);
    return true;
}

static bool try_contraction(qm_quads_sides *t, uint32_t face)
{
    for (uint32_t side = 4 * face; side < 4 * face + 4; side++) {
        if (!qm_quads_can_contract(t, side) || contraction_gain(t, side) <= 0) continue;
        qm_quads_contract(t, side);
        return true;
    }
    return false;
}

static size_t count_irregular(const qm_quads_sides *t)
{
    size_t count = 0;
    for (uint32_t v = 0; v < t->vertex_count; v++)
        count += t->out[v] != QM_NO_INDEX && t->kind[v] == QM_TRIMESH_FREE &&
                 qm_quads_sector_at(t, t->out[v]).quads != 4;
    return count;
}

static qm_status run(qm_quads_sides *t)
{
    bool is_changing = true;
    for (int round = 0; round < ROUNDS && is_changing; round++) {
        is_changing = false;
        for (uint32_t f = 0; f < t->face_count; f++) {
            if (t->is_gone[f]) continue;
            if (try_contraction(t, f)) {
                is_changing = true;
                continue;
            }
            for (uint32_t side = 4 * f; side < 4 * f + 4; side++)
                is_changing |= try_turn(t, side);
        }
        if (qm_context_canceled(t->ctx)) return QM_E_CANCELED;
    }
    return QM_OK;
}

qm_status qm_quads_tidy(qm_context *ctx, qm_quads_result *r, size_t *irregular)
{
    qm_quads_sides sides;
    qm_status status = qm_quads_sides_build(ctx, r, &sides);
    if (status == QM_OK) status = run(&sides);
    if (status == QM_OK) {
        *irregular = count_irregular(&sides);
        status = qm_quads_sides_compact(&sides);
    }
    qm_quads_sides_reset(&sides);
    return status;
}
