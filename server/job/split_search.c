/**
 * split_search.c: the whole search, its export, and rounds.
 */
#include "split_search.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <uv.h>

#include "base/clock.h"

#define FIRST_SHARE 8 /* entries of the first call of a round */
#define MOST_SHARE 1048576
#define CALL_TIME 0.05 /* of a round: that a call is to take, */
#define CALL_LIMIT 0.5 /* and is cut off after, unless it is about one entry */
#define LEAST_LIMIT 0.01
#define LAST_CALL 0.5    /* of a round: no call begins later */
#define CALLS 4          /* that a part of the rest is to keep busy */
#define PART_ENTRIES 256 /* of an exported part, unless there are too many of these */
#define FEWEST_PARTS 256 /* exported, when there are so many entries */
#define MOST_PARTS 4096
#define PART_SHARE 4   /* a round claims up to one of so many parts, so that others find some */
#define WORK_FACTOR 4  /* of the work limit of a whole search */
#define TRY_BITS 2     /* a pack alone that did not end gets four times as long */
#define MOST_TRIES 10  /* that give it more time */
#define WAIT_MS 50     /* while others run the parts that are left, or the store is away */
#define MOST_FAULTS 20 /* of the store, one after the other */
#define ENTRY_SIZE 18  /* bytes of a stored entry: upper, index, hint, side, level */

typedef struct entry_list {
    qm_hausdorff_part *at;
    size_t count, capacity;
    bool failed; /* there was no memory for an entry */
} entry_list;

/** A search as one process sees it. */
typedef struct search {
    qm_split *split;
    qm_context *ctx;
    const qm_bvh *a, *b;
    const qm_hausdorff_options *options;
    qm_store_bounds known; /* as last read */
    double margin;
    entry_list rest; /* of the last call */
    size_t share;    /* entries that a call runs */
    bool was_cut;    /* a call was cut off: the share grows more slowly since */
    size_t claims;   /* parts that a round claims */
    size_t max_queue;
    int faults;
    double start_ms, call_ms;      /* of the search and the last call */
    double others;                 /* without the margin: no point that the call is not about is farther */
    double told_lower, told_upper; /* of the progress so far */
} search;

/* ---- entries ---- */

static void add_entry(entry_list *list, const qm_hausdorff_part *entry)
{
    if (list->count == list->capacity) {
        size_t capacity = list->capacity > 0 ? 2 * list->capacity : 256;
        qm_hausdorff_part *at = realloc(list->at, capacity * sizeof *at);
        if (!at) {
            list->failed = true;
            return;
        }
        list->at = at;
        list->capacity = capacity;
    }
    list->at[list->count++] = *entry;
}

static void keep_rest(void *user, const qm_hausdorff_part *part)
{
    add_entry(&((search *)user)->rest, part);
}

static void free_entries(entry_list *list)
{
    free(list->at);
    *list = (entry_list){0};
}

static int compare_nodes(const void *a, const void *b)
{
    const qm_hausdorff_part *p = a, *q = b;
    if (p->side != q->side) return p->side < q->side ? -1 : 1;
    if (p->level != q->level) return p->level < q->level ? -1 : 1;
    return (p->index > q->index) - (p->index < q->index);
}

/** The greatest bounds first; of equal ones, neighbors together. */
static int compare_uppers(const void *a, const void *b)
{
    const qm_hausdorff_part *p = a, *q = b;
    if (p->upper != q->upper) return p->upper > q->upper ? -1 : 1;
    return compare_nodes(a, b);
}

/** Makes one of the entries of a node, with the largest of their bounds, which are at most `cap`; sorts by bounds. */
static void merge_entries(entry_list *list, double cap)
{
    size_t kept = 0;
    if (list->count == 0) return;
    qsort(list->at, list->count, sizeof *list->at, compare_nodes);
    for (size_t i = 0; i < list->count; i++) {
        qm_hausdorff_part entry = list->at[i];
        entry.upper = fmin(entry.upper, cap);
        if (kept > 0 && compare_nodes(&list->at[kept - 1], &entry) == 0)
            list->at[kept - 1].upper = fmax(list->at[kept - 1].upper, entry.upper);
        else
            list->at[kept++] = entry;
    }
    list->count = kept;
    qsort(list->at, list->count, sizeof *list->at, compare_uppers);
}

static void write_entry(unsigned char out[ENTRY_SIZE], const qm_hausdorff_part *entry)
{
    memcpy(out, &entry->upper, 8);
    memcpy(out + 8, &entry->index, 4);
    memcpy(out + 12, &entry->hint, 4);
    out[16] = entry->side;
    out[17] = entry->level;
}

static qm_hausdorff_part read_entry(const unsigned char in[ENTRY_SIZE])
{
    qm_hausdorff_part entry = {.side = in[16], .level = in[17]};
    memcpy(&entry.upper, in, 8);
    memcpy(&entry.index, in + 8, 4);
    memcpy(&entry.hint, in + 12, 4);
    return entry;
}

/** Makes stored parts of sorted entries: `count` of them, of equal size. False: out of memory. */
static bool make_parts(const entry_list *list, size_t count, int64_t tries, qm_store_part *out)
{
    for (size_t i = 0; i < count; i++) {
        size_t first = list->count * i / count, end = list->count * (i + 1) / count;
        out[i] = (qm_store_part){.tries = tries,
                                 .upper = list->at[first].upper,
                                 .size = (end - first) * ENTRY_SIZE,
                                 .entries = malloc((end - first) * ENTRY_SIZE)};
        unsigned char *at = out[i].entries;
        for (size_t k = first; at && k < end; k++, at += ENTRY_SIZE)
            write_entry(at, &list->at[k]);
        if (out[i].entries) continue;
        qm_store_parts_reset(out, i);
        return false;
    }
    return true;
}

/* ---- witnesses ---- */

static int print_point(char *out, size_t size, const qm_surface_point *p)
{
    return snprintf(out, size, " %" PRIu32 " %.17g %.17g %.17g %.17g %.17g", p->face, p->uv[0], p->uv[1],
                    p->position[0], p->position[1], p->position[2]);
}

static void write_witness(const qm_hausdorff_result *result, char out[QM_STORE_WITNESS_SIZE])
{
    int used = snprintf(out, QM_STORE_WITNESS_SIZE, "%d", (int)result->from_side);
    used += print_point(out + used, QM_STORE_WITNESS_SIZE - (size_t)used, &result->from);
    print_point(out + used, QM_STORE_WITNESS_SIZE - (size_t)used, &result->to);
}

static bool read_point(const char **text, qm_surface_point *out)
{
    int used = 0;
    bool is_read = sscanf(*text, " %" SCNu32 " %lg %lg %lg %lg %lg%n", &out->face, &out->uv[0], &out->uv[1],
                          &out->position[0], &out->position[1], &out->position[2], &used) == 6;
    *text += used;
    return is_read;
}

static void read_witness(const char *text, qm_hausdorff_result *out)
{
    out->has_witness = text[0] == '0' || text[0] == '1';
    if (!out->has_witness) return;
    out->from_side = text[0] == '1' ? QM_HAUSDORFF_FROM_B : QM_HAUSDORFF_FROM_A;
    text++;
    out->has_witness = read_point(&text, &out->from) && read_point(&text, &out->to);
}

/* ---- bounds ---- */

static double lower_of(const search *s)
{
    return fmax(s->told_lower, s->known.lower - s->margin);
}

static double upper_of(const search *s)
{
    double upper = fmax(s->known.lower, fmax(s->known.discarded, s->known.upper));
    return fmin(s->told_upper, upper + s->margin);
}

static void tell(search *s, qm_hausdorff_progress progress)
{
    s->told_lower = progress.lower = fmax(s->told_lower, progress.lower);
    s->told_upper = progress.upper = fmin(s->told_upper, progress.upper);
    progress.elapsed_ms = qm_clock_now_ms() - s->start_ms;
    s->split->parts = s->known.parts;
    s->split->nodes = s->known.nodes;
    if (s->options->progress) s->options->progress(s->options->progress_user, &progress);
}

/** Progress of a call, to which the bounds of all that it is not about are added. */
static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    search *s = user;
    qm_hausdorff_progress all = *progress;
    all.upper = fmax(all.upper, s->others + s->margin);
    all.iterations += s->known.iterations;
    all.projections += s->known.projections;
    tell(s, all);
}

static void tell_known(search *s)
{
    tell(s, (qm_hausdorff_progress){.lower = lower_of(s),
                                    .upper = upper_of(s),
                                    .iterations = s->known.iterations,
                                    .projections = s->known.projections,
                                    .queue_count = s->known.parts});
}

static double elapsed_ms(const search *s)
{
    return qm_clock_now_ms() - s->start_ms;
}

/** Iterations that all calls may have: more than those of a whole search, as some work is done again. */
static uint64_t work_of(const search *s)
{
    const qm_hausdorff_options *options = s->options;
    return options->work_limit > 0 ? options->work_limit
                                   : WORK_FACTOR * qm_hausdorff_default_work(s->a, s->b, options->direction);
}

/** Why the search is over; false while it is not. */
static bool is_over(const search *s, qm_hausdorff_stop *stop)
{
    const qm_hausdorff_options *options = s->options;
    double lower = lower_of(s), upper = upper_of(s);
    if (upper - lower <= options->tolerance)
        *stop = QM_STOP_CONVERGED;
    else if (lower > options->threshold || upper <= options->threshold)
        *stop = QM_STOP_THRESHOLD;
    else if (s->known.parts == 0)
        *stop = QM_STOP_PRECISION;
    else if (qm_context_canceled(s->ctx))
        *stop = QM_STOP_CANCELED;
    else if (options->deadline_ms > 0.0 && elapsed_ms(s) >= options->deadline_ms)
        *stop = QM_STOP_DEADLINE;
    else if (s->known.iterations >= work_of(s))
        *stop = options->work_limit > 0 ? QM_STOP_DEADLINE : QM_STOP_WORK;
    else
        return false;
    return true;
}

/** The result of a search that has ended. */
static void conclude(const search *s, qm_hausdorff_stop stop, qm_hausdorff_result *out)
{
    *out = (qm_hausdorff_result){.lower = lower_of(s),
                                 .upper = upper_of(s),
                                 .found_lower = -1.0,
                                 .discarded = s->known.discarded,
                                 .margin = s->margin,
                                 .iterations = s->known.iterations,
                                 .projections = s->known.projections,
                                 .max_queue = s->max_queue,
                                 .elapsed_ms = elapsed_ms(s),
                                 .stop = stop};
    read_witness(s->known.witness, out);
    if (out->has_witness) out->found_lower = s->known.lower;
    if (out->lower > s->options->threshold) out->verdict = QM_VERDICT_ABOVE;
    if (out->upper <= s->options->threshold) out->verdict = QM_VERDICT_BELOW;
}

/* ---- calls of the engine ---- */

/** Runs some entries, or all of the sources for NULL, for a time at most (INFINITY: any). Entries that are left join s->rest. */
static qm_status call(search *s, const qm_hausdorff_part *begin, size_t count, double limit_ms,
                      qm_hausdorff_result *out)
{
    const qm_hausdorff_parts parts = {
        .begin = begin, .count = count, .known_lower = s->known.lower, .rest = keep_rest, .user = s};
    qm_hausdorff_options options = *s->options;
    if (options.deadline_ms > 0.0) limit_ms = fmin(limit_ms, fmax(options.deadline_ms - elapsed_ms(s), 1.0));
    options.deadline_ms = isinf(limit_ms) ? 0.0 : limit_ms;
    options.parts = &parts;
    options.progress = on_progress;
    options.progress_user = s;
    s->rest.count = 0;
    s->rest.failed = false;
    s->call_ms = qm_clock_now_ms();
    qm_status status = qm_hausdorff_measure(s->ctx, s->a, s->b, &options, out);
    if (status != QM_OK) return status;
    s->margin = out->margin;
    if (out->max_queue > s->max_queue) s->max_queue = out->max_queue;
    return QM_OK;
}

/** What a call has found, as it joins the bounds. */
static qm_store_bounds found_by(const qm_hausdorff_result *result)
{
    qm_store_bounds found = {
        .discarded = result->discarded, .iterations = result->iterations, .projections = result->projections};
    if (!result->has_witness || result->found_lower <= 0.0) return found;
    found.lower = result->found_lower;
    write_witness(result, found.witness);
    return found;
}

/** Adds bounds that a call has found; the lower one comes with its witness. */
static void join_bounds(qm_store_bounds *to, const qm_store_bounds *found)
{
    if (found->lower > to->lower) {
        to->lower = found->lower;
        memcpy(to->witness, found->witness, sizeof to->witness);
    }
    to->discarded = fmax(to->discarded, found->discarded);
    to->iterations += found->iterations;
    to->projections += found->projections;
}

/** The margin of these trees: a call without entries computes it. */
static qm_status find_margin(search *s)
{
    qm_hausdorff_result result;
    const qm_hausdorff_part none = {0};
    const qm_hausdorff_parts parts = {.begin = &none, .count = 0};
    qm_hausdorff_options options = *s->options;
    options.parts = &parts;
    options.progress = NULL;
    qm_status status = qm_hausdorff_measure(s->ctx, s->a, s->b, &options, &result);
    s->margin = status == QM_OK ? result.margin : INFINITY;
    return status;
}

/* ---- the export ---- */

static void write_engine(const search *s, char out[QM_STORE_ENGINE_SIZE])
{
    snprintf(out, QM_STORE_ENGINE_SIZE, QM_VERSION " %016" PRIx64 " %016" PRIx64, qm_bvh_fingerprint(s->a),
             qm_bvh_fingerprint(s->b));
}

/** Waits until the store may be asked again; false when the search is to end. */
static bool wait_for_store(const search *s)
{
    uv_sleep(WAIT_MS);
    return !qm_context_canceled(s->ctx);
}

/** Keeps what the whole search has left in the store. */
static qm_stored export(search *s)
{
    size_t count = (s->rest.count + PART_ENTRIES - 1) / PART_ENTRIES;
    if (count < FEWEST_PARTS) count = s->rest.count < FEWEST_PARTS ? s->rest.count : FEWEST_PARTS;
    if (count > MOST_PARTS) count = MOST_PARTS;
    qm_store_part *parts = malloc(count * sizeof *parts);
    qm_stored stored = QM_STORED_NO_MEMORY;
    if (parts && make_parts(&s->rest, count, 0, parts)) {
        write_engine(s, s->known.engine);
        do
            stored = qm_store_open_parts(s->split->store, s->split->job, s->split->restarts, &s->known, parts,
                                         count);
        while (stored == QM_STORED_AWAY && wait_for_store(s));
        qm_store_parts_reset(parts, count);
    }
    free(parts);
    return stored;
}

/* ---- rounds ---- */

/** Joins the entries of claimed parts, those with the greatest bounds first. False: out of memory. */
static bool join_parts(const qm_store_part *parts, size_t count, entry_list *out)
{
    for (size_t i = 0; i < count; i++)
        for (size_t at = 0; at + ENTRY_SIZE <= parts[i].size; at += ENTRY_SIZE) {
            const qm_hausdorff_part entry = read_entry((const unsigned char *)parts[i].entries + at);
            add_entry(out, &entry);
        }
    merge_entries(out, INFINITY);
    return !out->failed;
}

/** Adapts the number of entries of a call to its time. */
static void adapt_share(search *s, size_t run, bool has_ended)
{
    double share_of_round = (qm_clock_now_ms() - s->call_ms) / s->split->round_ms;
    s->was_cut = s->was_cut || !has_ended;
    if (!has_ended)
        s->share = run >= 4 ? run / 4 : 1;
    else if (run == s->share && share_of_round < CALL_TIME && s->share < MOST_SHARE)
        s->share += s->was_cut ? s->share / 4 + 1 : s->share;
    else if (share_of_round > 2.0 * CALL_TIME)
        s->share = run >= 2 ? run / 2 : 1;
}

/** Stores the end of a round; a fact that it has found is kept also when its parts are another's by now. */
static qm_stored finish_round(search *s, const qm_store_part *claimed, size_t count,
                              const qm_store_bounds *found, const qm_store_part *rest, size_t rest_count)
{
    qm_split *split = s->split;
    qm_stored stored;
    do
        stored = qm_store_finish_parts(split->store, split->job, claimed, count, found, rest, rest_count);
    while (stored == QM_STORED_AWAY && wait_for_store(s));
    if (stored == QM_STORED_LOST && found->lower > 0.0)
        qm_store_raise_lower(split->store, split->job, found->lower, found->witness);
    return stored;
}

/** A round on its way: entries of the claimed parts, what its calls have found, and what they have left. */
typedef struct search_round {
    entry_list entries;
    size_t begun; /* the first ones */
    entry_list left;
    qm_store_bounds found;
    int64_t tries; /* of a pack alone that did not end: one more than before */
    double start_ms;
} search_round;

/** Replaces the claimed parts by what is left of them. */
static qm_stored replace_parts(search *s, const qm_store_part *claimed, size_t count, search_round *r)
{
    for (size_t i = r->begun; i < r->entries.count; i++)
        add_entry(&r->left, &r->entries.at[i]);
    merge_entries(&r->left, INFINITY);
    qm_store_part rest[QM_STORE_REST_PARTS];
    size_t size = CALLS * s->share, parts = (r->left.count + size - 1) / size;
    if (parts > QM_STORE_REST_PARTS) parts = QM_STORE_REST_PARTS;
    if (r->left.failed || !make_parts(&r->left, parts, r->left.count == 1 ? r->tries : 0, rest))
        return QM_STORED_NO_MEMORY;
    qm_stored stored = finish_round(s, claimed, count, &r->found, rest, parts);
    qm_store_parts_reset(rest, parts);
    return stored;
}

/** Gives parts back as they were. */
static void give_back(search *s, const qm_store_part *claimed, size_t count)
{
    const qm_store_bounds nothing = {0};
    for (size_t i = 0; i < count; i++)
        finish_round(s, &claimed[i], 1, &nothing, &claimed[i], 1);
}

/** How a round ended. */
typedef enum round_end { ROUND_DONE, ROUND_FAULT, ROUND_NO_MEMORY, ROUND_FAILED } round_end;

/** What a call has found joins the round and what this process knows; what it has left joins the round. */
static void join_call(search *s, search_round *r, const qm_hausdorff_result *result)
{
    const qm_store_bounds found = found_by(result);
    join_bounds(&r->found, &found);
    join_bounds(&s->known, &found);
    for (size_t i = 0; i < s->rest.count; i++)
        add_entry(&r->left, &s->rest.at[i]);
    r->left.failed |= s->rest.failed;
}

/** The time that the next call may take: all that is left of the round for one entry, and more for a pack that had no
 * end before. */
static double call_limit(const search *s, const search_round *r, size_t run, int64_t tries)
{
    double round_ms = s->split->round_ms, left_ms = round_ms - (qm_clock_now_ms() - r->start_ms);
    if (run == 1 && r->begun == 0) return ldexp(round_ms, TRY_BITS * (int)tries);
    return fmax(run == 1 ? left_ms : fmin(CALL_LIMIT * round_ms, left_ms), LEAST_LIMIT * round_ms);
}

/** Runs the next entries of a round; *has_ended: nothing of them is left. */
static qm_status run_next(search *s, search_round *r, int64_t tries, qm_hausdorff_stop *stop, bool *has_ended)
{
    size_t left = r->entries.count - r->begun, run = left < s->share ? left : s->share;
    const qm_hausdorff_part *first = &r->entries.at[r->begun];
    s->others = fmax(s->known.lower, fmax(s->known.discarded, s->known.others));
    if (run < left) s->others = fmax(s->others, first[run].upper);
    for (size_t i = 0; i < r->left.count; i++)
        s->others = fmax(s->others, r->left.at[i].upper);
    qm_hausdorff_result result;
    qm_status status = call(s, first, run, call_limit(s, r, run, tries), &result);
    if (status != QM_OK) return status;
    *has_ended = s->rest.count == 0;
    *stop = result.stop;
    if (run == 1 && first->level == 0 && !*has_ended) r->tries = tries < MOST_TRIES ? tries + 1 : tries;
    merge_entries(&s->rest, first->upper);
    join_call(s, r, &result);
    adapt_share(s, run, *has_ended);
    r->begun += run;
    return QM_OK;
}

/** Runs claimed parts and finishes them. ROUND_FAILED: *status is the engine's. */
static round_end run_parts(search *s, const qm_store_part *claimed, size_t count, bool is_owner,
                           qm_status *status)
{
    search_round r = {.start_ms = qm_clock_now_ms()};
    round_end end = join_parts(claimed, count, &r.entries) ? ROUND_DONE : ROUND_NO_MEMORY;
    bool goes_on = end == ROUND_DONE;
    while (goes_on && r.begun < r.entries.count) {
        qm_hausdorff_stop stop;
        bool has_ended;
        *status = run_next(s, &r, claimed[0].tries, &stop, &has_ended);
        if (*status != QM_OK)
            end = ROUND_FAILED;
        else if (stop == QM_STOP_MEMORY)
            end = ROUND_NO_MEMORY;
        bool is_in_time = qm_clock_now_ms() - r.start_ms < LAST_CALL * s->split->round_ms;
        goes_on = end == ROUND_DONE && is_in_time && !qm_context_canceled(s->ctx) &&
                  !(s->known.lower - s->margin > s->options->threshold);
    }
    s->claims = CALLS * s->share / (r.entries.count / count + 1) + 1;
    if (end == ROUND_NO_MEMORY && !is_owner) {
        give_back(s, claimed, count);
    } else if (end != ROUND_FAILED && r.begun > 0) {
        qm_stored stored = replace_parts(s, claimed, count, &r);
        if (stored == QM_STORED_NO_MEMORY) end = ROUND_NO_MEMORY;
        if (stored != QM_STORED && stored != QM_STORED_LOST && end == ROUND_DONE) end = ROUND_FAULT;
    }
    free_entries(&r.entries);
    free_entries(&r.left);
    return end;
}

/** Claims parts, at most a share of those that are left, and reads the bounds as of then. */
static qm_stored claim_parts(search *s, qm_store_part claimed[QM_STORE_PART_CLAIMS], size_t *count)
{
    qm_split *split = s->split;
    size_t limit = s->known.parts / PART_SHARE + 1;
    if (limit > s->claims) limit = s->claims;
    if (limit > QM_STORE_PART_CLAIMS) limit = QM_STORE_PART_CLAIMS;
    qm_store_bounds bounds;
    qm_stored stored = qm_store_claim_parts(split->store, split->job, limit, claimed, count);
    if (stored == QM_STORED)
        stored = qm_store_read_bounds(split->store, split->job, claimed, *count, &bounds);
    if (stored == QM_STORED) {
        s->known = bounds;
        s->faults = 0;
    } else {
        qm_store_parts_reset(claimed, *count);
        *count = 0;
    }
    return stored;
}

/** Does rounds until the search is over. */
static qm_status run_rounds(search *s, qm_hausdorff_result *out)
{
    qm_status status = QM_OK;
    qm_hausdorff_stop stop = QM_STOP_CANCELED;
    bool goes_on = true;
    while (goes_on) {
        qm_store_part claimed[QM_STORE_PART_CLAIMS];
        size_t count;
        qm_stored stored = claim_parts(s, claimed, &count);
        if (stored == QM_STORED_NONE) { /* the job is another node's, and over */
            s->split->is_lost = true;
            break;
        }
        if (stored != QM_STORED) {
            goes_on = wait_for_store(s);
            if (stored != QM_STORED_AWAY && ++s->faults > MOST_FAULTS) {
                status = qm_context_fail(s->ctx, QM_E_NO_MEMORY, "the store fails to keep the search");
                goes_on = false;
            }
            continue;
        }
        tell_known(s);
        round_end end = ROUND_DONE;
        if (is_over(s, &stop)) {
            goes_on = false;
        } else if (count == 0) {
            uv_sleep(WAIT_MS);
        } else {
            end = run_parts(s, claimed, count, true, &status);
        }
        qm_store_parts_reset(claimed, count);
        if (end == ROUND_FAULT && ++s->faults > MOST_FAULTS)
            status = qm_context_fail(s->ctx, QM_E_NO_MEMORY, "the store fails to keep the search");
        if (end == ROUND_NO_MEMORY) stop = QM_STOP_MEMORY;
        goes_on = goes_on && status == QM_OK && end != ROUND_NO_MEMORY;
    }
    if (status == QM_OK && stop == QM_STOP_MEMORY) {
        qm_store_bounds bounds;
        if (qm_store_read_bounds(s->split->store, s->split->job, NULL, 0, &bounds) == QM_STORED)
            s->known = bounds;
    }
    if (status == QM_OK) conclude(s, stop, out);
    return status;
}

/* ---- the owner ---- */

static search start_search(qm_split *split, qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                           const qm_hausdorff_options *options)
{
    return (search){.split = split,
                    .ctx = ctx,
                    .a = a,
                    .b = b,
                    .options = options,
                    .share = FIRST_SHARE,
                    .claims = 1,
                    .start_ms = qm_clock_now_ms(),
                    .others = -INFINITY,
                    .told_upper = INFINITY};
}

/** Reads the bounds of an earlier run; false when there are none for these trees. */
static bool resume(search *s)
{
    char engine[QM_STORE_ENGINE_SIZE];
    qm_store_bounds bounds;
    qm_stored stored;
    do
        stored = qm_store_read_bounds(s->split->store, s->split->job, NULL, 0, &bounds);
    while (stored == QM_STORED_AWAY && wait_for_store(s));
    if (stored != QM_STORED) return false;
    write_engine(s, engine);
    if (strcmp(bounds.engine, engine) != 0) return false;
    s->known = bounds;
    return true;
}

/** Goes on in memory with what the whole search has left, as the store does not take it. */
static qm_status run_in_memory(search *s, qm_hausdorff_result *out)
{
    entry_list left = s->rest;
    s->rest = (entry_list){0};
    s->others = fmax(s->known.lower, s->known.discarded);
    qm_hausdorff_result result;
    qm_status status = call(s, left.at, left.count, INFINITY, &result);
    free_entries(&left);
    if (status != QM_OK) return status;
    const qm_store_bounds found = found_by(&result);
    qm_store_bounds *known = &s->known;
    join_bounds(known, &found);
    known->parts = s->rest.count;
    known->upper = 0.0;
    for (size_t i = 0; i < s->rest.count; i++)
        known->upper = fmax(known->upper, s->rest.at[i].upper);
    if (s->rest.failed) known->upper = INFINITY;
    qm_hausdorff_stop stop;
    if (!is_over(s, &stop)) stop = result.stop;
    conclude(s, stop, out);
    return QM_OK;
}

/** What the whole search has found and left, before its export. */
static void keep_whole(search *s, const qm_hausdorff_result *result)
{
    merge_entries(&s->rest, INFINITY);
    s->known = found_by(result);
    s->known.parts = s->rest.count;
    s->known.upper = s->rest.at[0].upper;
}

qm_status qm_split_measure(void *user, qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                           const qm_hausdorff_options *options, qm_hausdorff_result *out)
{
    QM_ASSERT(user && ctx && a && b && options && out && !options->parts);
    search s = start_search(user, ctx, a, b, options);
    qm_status status;
    if (s.split->restarts > 0 && resume(&s)) {
        status = find_margin(&s);
        if (status == QM_OK) status = run_rounds(&s, out);
        free_entries(&s.rest);
        return status;
    }
    status = call(&s, NULL, 0, s.split->whole_ms, out);
    bool is_limited = status == QM_OK && out->stop == QM_STOP_DEADLINE && s.rest.count > 0 &&
                      !s.rest.failed &&
                      !(options->work_limit > 0 && out->iterations >= options->work_limit) &&
                      !(options->deadline_ms > 0.0 && elapsed_ms(&s) >= options->deadline_ms);
    if (is_limited) {
        keep_whole(&s, out);
        qm_stored stored = export(&s);
        if (stored == QM_STORED)
            status = run_rounds(&s, out);
        else if (stored == QM_STORED_LOST) {
            s.split->is_lost = true;
            out->stop = QM_STOP_CANCELED;
        } else
            status = run_in_memory(&s, out);
    }
    free_entries(&s.rest);
    return status;
}

/* ---- helpers ---- */

bool qm_split_help(qm_split *split, qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                   const qm_hausdorff_options *options, bool (*stops)(void *user), void *user)
{
    QM_ASSERT(split && ctx && a && b && options && stops);
    search s = start_search(split, ctx, a, b, options);
    if (!resume(&s)) return false;
    bool helps = true;
    while (helps && !stops(user) && !qm_context_canceled(ctx)) {
        qm_store_part claimed[QM_STORE_PART_CLAIMS];
        size_t count;
        qm_status status;
        if (claim_parts(&s, claimed, &count) != QM_STORED || count == 0) break;
        round_end end = run_parts(&s, claimed, count, false, &status);
        qm_store_parts_reset(claimed, count);
        helps = end == ROUND_DONE;
    }
    free_entries(&s.rest);
    return helps;
}
