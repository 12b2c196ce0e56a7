/**
 * split_search.h: a long Hausdorff search in parts that the store keeps: one owner and any number of helpers run them,
 * and whoever dies loses one round.
 *
 * The owner runs the search whole at first, and nearly every search ends there. One that goes on is exported: its
 * queue becomes parts. From then on owner and helpers do rounds: claim parts, run them with the lower bound known so far, and
 * finish them. After a restart the owner goes on with the parts that are there.
 *
 * Bounds. Let L, D and u(p) be as in store_parts.h, and m the margin of the engine, which depends on the two meshes
 * alone. At every moment max(0, L - m) <= h <= max(L, D, max u(p)) + m:
 *   - Export: what the call on all of the sources has left, and discarded, covers them (qm/hausdorff.h).
 *   - Round: what a call on some entries of the claimed parts has left and discarded, and the entries that it did not run,
 *     cover the claimed parts. One step of the store puts them in place of these.
 *   - An entry of the rest lies within the entries that were run: its upper bound is at most the largest of theirs.
 *   - m is added once, to the sums, and never to what is stored.
 * While the owner runs a round, its upper bound is the maximum of its own call's, which is about the entries that it
 * runs, and of the bounds of all others as of its claim; they only fall.
 *
 * Entries mean the same only for trees with the same fingerprints (qm_bvh_fingerprint): who has others takes no part, and
 * an owner with others begins anew.
 *
 * A round is one call of the engine about the parts that it has claimed, and takes QM_SPLIT_ROUND_MS at most: so much is lost
 * with a process. A call that is cut off leaves its queue as it is, pieces of faces too, so that nothing is done again, and each
 * call gets on, however much a single face takes. Of very many pieces their packs are kept, to bound what is stored; the limit of work
 * ends a search that this keeps from its end.
 */
#ifndef QM_SPLIT_SEARCH_H
#define QM_SPLIT_SEARCH_H

#include "qm/hausdorff.h"
#include "store/store_parts.h"

#define QM_SPLIT_WHOLE_MS 3000.0
#define QM_SPLIT_ROUND_MS 2000.0
#define QM_SPLIT_MOST_PIECES ((size_t)1 << 20) /* that a call leaves: of more, their packs are kept */

typedef struct qm_split {
    qm_store *store;
    const char *job;
    int64_t restarts;          /* of the run of the job; of the owner */
    double whole_ms, round_ms; /* the times above, unless a test has others, */
    size_t most_pieces;        /* as this number */
    /* Set before each report of progress, for the owner: parts that are left, and nodes that run some; 0 while the search is whole. */
    size_t parts, nodes;
    bool is_lost; /* written, for the owner: another process has the job, or it is over */
} qm_split;

/**
 * Runs a search to its end as qm_hausdorff_measure does, with the same options and result, whose counts are those of all calls
 * that have counted; work, memory and cancelation end it as they end a whole one. Without memory for the parts, or with a
 * store that does not take them, it ends early or runs whole. QM_STOP_CANCELED also when the job is lost (is_lost).
 * A qm_job_search with a qm_split as its user.
 */
qm_status qm_split_measure(void *user, qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                           const qm_hausdorff_options *options, qm_hausdorff_result *out);

/**
 * Does rounds of a search that another process owns, until no part is free, stops() is true, or the context is canceled.
 * False when this process cannot help: other trees, or too little memory for a part.
 */
bool qm_split_help(qm_split *split, qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                   const qm_hausdorff_options *options, bool (*stops)(void *user), void *user);

#endif
