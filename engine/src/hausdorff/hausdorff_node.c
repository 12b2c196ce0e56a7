/**
 * hausdorff_node.c: the upper stage of the search: nodes of the source's bounding volume hierarchy, down to
 * its leaves, the packs. A node is discarded when the ball round its box is within the cutoff: the distance
 * is 1-Lipschitz, so no point of the ball is farther than its centre by more than the radius.
 */
#include "hausdorff_sample.h"

/** The ball round the box of a child, in local space. */
static double child_ball(const qm_side *side, const qm_box_node *node, int index, qm_vec *centre)
{
    double mid[3], half2 = 0.0;
    for (int k = 0; k < 3; k++) {
        double low = (double)node->low[k][index], high = (double)node->high[k][index];
        mid[k] = 0.5 * (low + high);
        half2 += 0.25 * (high - low) * (high - low);
    }
    *centre = qm_vec_axpy(side->shift, side->factor, qm_vec_load(mid));
    return side->factor * sqrt(half2);
}

/** Upper bound (local) of a node by the ball round its box; one search where the hint is too far. */
static double bound_node(qm_worker *worker, const qm_side *side, qm_vec centre, double radius, uint32_t *hint)
{
    double lower = qm_search_local_lower(worker->search, side);
    double reach = qm_search_cutoff(worker->search) * side->scale - radius;
    double enough = fmax(reach, QM_CLOSE_SHARE * lower);
    worker->projections++;
    return qm_sample_known_upper(worker, side, centre, enough, reach, hint) + radius;
}

/**
 * Upper bound (local) of a pack by a ball round a point of its surface. That is searched for only when it may
 * raise the lower bound: neighbours on the curve are mostly within the cutoff of one hint's pack.
 */
static double bound_pack(qm_worker *worker, const qm_side *side, const qm_box_node *node, int index,
                         uint32_t pack, uint32_t *hint)
{
    uint32_t face;
    qm_vec p = qm_sample_pack_centre(side, pack, &face);
    double far2 = 0.0; /* of the ball round p that holds the box */
    const double shift[3] = {side->shift.x, side->shift.y, side->shift.z}, point[3] = {p.x, p.y, p.z};
    for (int k = 0; k < 3; k++) {
        double low = point[k] - (shift[k] + side->factor * (double)node->low[k][index]);
        double high = shift[k] + side->factor * (double)node->high[k][index] - point[k];
        double far = low > high ? low : high;
        far2 += far * far;
    }
    double radius = sqrt(far2);
    /* A seed: this point is measured already, at least as closely. */
    if (side->seeds && pack % side->seed_step == 0) {
        qm_seed seed = side->seeds[pack / side->seed_step];
        *hint = seed.hint;
        return seed.distance + radius;
    }
    double upper = qm_sample_pack_upper(worker->search->kernel, side, *hint, p);
    double lower = qm_search_local_lower(worker->search, side);
    if (upper <= QM_CLOSE_SHARE * lower) return upper + radius;
    double enough = qm_search_cutoff(worker->search) * side->scale - radius;
    enough = fmin(fmax(enough, QM_CLOSE_SHARE * lower), lower);
    return qm_sample_point(worker, side, p, 0.0, face, enough, hint) + radius;
}

void qm_node_visit(qm_worker *worker, qm_entry entry)
{
    QM_ASSERT(worker && entry.kind == QM_ENTRY_NODE);
    QM_ASSERT(entry.level >= 1);
    const qm_search *search = worker->search;
    const qm_side *side = &search->side[entry.side];
    const qm_box_node *node = &side->source->boxes.groups[entry.level][entry.index];
    int children = qm_box_tree_child_count(&side->source->boxes, entry.level, entry.index);
    QM_ASSERT(children > 0 && children <= QM_PACK_LANES);
    qm_entry child[QM_PACK_LANES];
    uint32_t hint = entry.hint;
    for (int m = 0; m < children; m++) {
        if (entry.level == 1 &&
            m + 1 < children) { /* the next pack's vertices, which are far apart in memory */
            const qm_pack_lanes *lanes = &side->source->lanes[8 * entry.index + (uint32_t)m + 1];
            for (int i = 0; i < lanes->vertex_count; i++)
                __builtin_prefetch(side->source->mesh.positions + 3 * (size_t)lanes->vertex[i]);
        }
        qm_vec centre;
        double radius = child_ball(side, node, m, &centre);
        /* A ball larger than the cutoff cannot be discarded, wherever its centre is. */
        bool is_small = radius * side->inverse_scale <= qm_search_cutoff(search);
        double upper =
            is_small ? qm_sample_pack_upper(search->kernel, side, hint, centre) + radius : INFINITY;
        if (upper * side->inverse_scale > qm_search_cutoff(search) && !qm_worker_must_stop(worker)) {
            double nearer = entry.level > 1
                                ? bound_node(worker, side, centre, radius, &hint)
                                : bound_pack(worker, side, node, m, 8 * entry.index + (uint32_t)m, &hint);
            upper = fmin(upper, nearer);
        }
        child[m] = entry;
        child[m].upper = fmin(entry.upper, upper * side->inverse_scale);
        child[m].index = 8 * entry.index + (uint32_t)m;
        child[m].hint = hint;
        child[m].level = (uint8_t)(entry.level - 1);
    }
    /* Packs are visited at once, but after all eight have been bounded, which may raise the lower bound.
     * Nodes of packs are visited at once as well, in the order of the curve, while hints and vertices are in
     * cache. */
    int open_count = 0;
    for (int m = 0; m < children; m++) {
        if (entry.level > 2 || child[m].upper <= qm_search_cutoff(search) || qm_worker_must_stop(worker)) {
            qm_worker_push(worker, child[m], NULL);
        } else if (entry.level == 2) {
            worker->iterations++; /* counted as an entry of the queue is: reports and limits come as often */
            qm_node_visit(worker, child[m]);
        } else {
            child[open_count++] = child[m];
        }
    }
    if (open_count > 0) qm_pack_visit_all(worker, child, open_count);
}
