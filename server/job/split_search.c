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

#define ROUND_SHARE 0.5  /* of a round: one that ends its parts sooner claims twice as many the next time */
#define PART_ENTRIES 256 /* of an exported part, unless there are too many of these */
#define FEWEST_PARTS 256 /* exported, when there are so many entries */
#define MOST_PARTS 4096
#define PART_SHARE 4   /* a round claims up to one of so many parts, so that others find some */
#define WAIT_MS 50     /* while others run the parts that are left, or the store is away */
#define MOST_FAULTS 20 /* of the store, one after the other */
#define ENTRY_HEAD                                                                                           \
    19 /* bytes of a stored entry before its piece: upper, index, hint, side, level, size of the piece */

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
    size_t merge_at; /* entries of it at which they are merged */
    size_t claims;   /* parts that a round claims */
    size_t max_queue;
    int faults;
    double start_ms;
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

/**
 * Makes one of the entries of a node, with the largest of their bounds; it stands for pieces of it, too. Where there are too many
 * pieces to store, their packs do. The bounds are at most `cap`; sorts by them.
 */
static void merge_entries(entry_list *list, double cap, size_t most_pieces)
{
    size_t kept = 0, pieces = 0;
    if (list->count == 0) return;
    qsort(list->at, list->count, sizeof *list->at, compare_nodes);
    for (size_t i = 0; i < list->count; i++) {
        list->at[i].upper = fmin(list->at[i].upper, cap);
        pieces += list->at[i].piece_size > 0;
    }
    for (size_t i = 0, end; i < list->count; i = end) {
        qm_hausdorff_part whole = list->at[i];
        bool is_whole = pieces > most_pieces;
        for (end = i; end < list->count && compare_nodes(&whole, &list->at[end]) == 0; end++) {
            is_whole |= list->at[end].piece_size == 0;
            whole.upper = fmax(whole.upper, list->at[end].upper);
        }
        whole.piece_size = 0;
        for (size_t k = i; k < end && !is_whole; k++)
            list->at[kept++] = list->at[k];
        if (is_whole) list->at[kept++] = whole;
    }
    list->count = kept;
    qsort(list->at, list->count, sizeof *list->at, compare_uppers);
}

/** Keeps what a call has left, in the memory of so many pieces as are stored. */
static void keep_rest(void *user, const qm_hausdorff_part *part)
{
    search *s = user;
    add_entry(&s->rest, part);
    if (s->rest.count < s->merge_at) return;
    merge_entries(&s->rest, INFINITY, s->split->most_pieces);
    s->merge_at = 2 * (s->rest.count > s->merge_at / 2 ? s->rest.count : s->merge_at / 2);
}

/** Bytes of an entry as it is stored. */
static size_t size_of(const qm_hausdorff_part *entry)
{
    return ENTRY_HEAD + entry->piece_size;
}

static void write_entry(unsigned char *out, const qm_hausdorff_part *entry)
{
    memcpy(out, &entry->upper, 8);
    memcpy(out + 8, &entry->index, 4);
    memcpy(out + 12, &entry->hint, 4);
    out[16] = entry->side;
    out[17] = entry->level;
    out[18] = entry->piece_size;
    memcpy(out + ENTRY_HEAD, entry->piece, entry->piece_size);
}

/** Reads an entry; false when it is not among so many bytes. */
static bool read_entry(const unsigned char *in, size_t size, qm_hausdorff_part *out)
{
    if (size < ENTRY_HEAD) return false;
    *out = (qm_hausdorff_part){.side = in[16], .level = in[17], .piece_size = in[18]};
    memcpy(&out->upper, in, 8);
    memcpy(&out->index, in + 8, 4);
    memcpy(&out->hint, in + 12, 4);
    if (out->piece_size > QM_HAUSDORFF_PIECE_SIZE || size < size_of(out)) return false;
    memcpy(out->piece, in + ENTRY_HEAD, out->piece_size);
    return true;
}

/** Makes stored parts of sorted entries: `count` of them, of as many entries each. False: out of memory. */
static bool make_parts(const entry_list *list, size_t count, qm_store_part *out)
{
    for (size_t i = 0; i < count; i++) {
        size_t first = list->count * i / count, end = list->count * (i + 1) / count, size = 0;
        for (size_t k = first; k < end; k++)
            size += size_of(&list->at[k]);
        out[i] = (qm_store_part){.upper = list->at[first].upper, .size = size, .entries = malloc(size)};
        unsigned char *at = out[i].entries;
        for (size_t k = first; at && k < end; at += size_of(&list->at[k]), k++)
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

/** Iterations that all calls may have together: those of a whole search. */
static uint64_t work_of(const search *s)
{
    const qm_hausdorff_options *options = s->options;
    return options->work_limit > 0 ? options->work_limit
                                   : qm_hausdorff_default_work(s->a, s->b, options->direction);
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
    uint64_t work = work_of(s), done = s->known.iterations;
    if (done > 0) options.work_limit = done < work ? work - done : 1;
    options.parts = &parts;
    options.progress = on_progress;
    options.progress_user = s;
    s->rest.count = 0;
    s->rest.failed = false;
    s->merge_at = 2 * s->split->most_pieces + 1;
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
    snprintf(out, QM_STORE_ENGINE_SIZE, QM_VERSION " pieces %016" PRIx64 " %016" PRIx64,
             qm_bvh_fingerprint(s->a), qm_bvh_fingerprint(s->b));
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
    if (parts && make_parts(&s->rest, count, parts)) {
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

/** Joins the entries of claimed parts, those with the greatest bounds first. False: out of memory, or bytes that are none. */
static bool join_parts(const qm_store_part *parts, size_t count, entry_list *out)
{
    for (size_t i = 0; i < count; i++) {
        qm_hausdorff_part entry;
        for (size_t at = 0; at < parts[i].size; at += size_of(&entry)) {
            if (!read_entry((const unsigned char *)parts[i].entries + at, parts[i].size - at, &entry))
                return false;
            add_entry(out, &entry);
        }
    }
    merge_entries(out, INFINITY, SIZE_MAX);
    return !out->failed;
}

/** Adapts the number of parts of a round to its time. */
static void adapt_claims(search *s, size_t count, double start_ms, bool has_ended)
{
    double share = (qm_clock_now_ms() - start_ms) / s->split->round_ms;
    if (!has_ended)
        s->claims = count >= 2 ? count / 2 : 1;
    else if (count == s->claims && share < ROUND_SHARE && s->claims < QM_STORE_PART_CLAIMS)
        s->claims *= 2;
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

/** Replaces the claimed parts by what the round has left of them. */
static qm_stored replace_parts(search *s, const qm_store_part *claimed, size_t count,
                               const qm_store_bounds *found)
{
    qm_store_part rest[QM_STORE_REST_PARTS];
    size_t parts = s->rest.count < QM_STORE_REST_PARTS ? s->rest.count : QM_STORE_REST_PARTS;
    if (s->rest.failed || !make_parts(&s->rest, parts, rest)) return QM_STORED_NO_MEMORY;
    qm_stored stored = finish_round(s, claimed, count, found, rest, parts);
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

/** Runs claimed parts and finishes them. ROUND_FAILED: *status is the engine's. */
static round_end run_parts(search *s, const qm_store_part *claimed, size_t count, bool is_owner,
                           qm_status *status)
{
    double start_ms = qm_clock_now_ms(), upper = 0.0;
    entry_list entries = {0};
    qm_hausdorff_result result = {.stop = QM_STOP_MEMORY};
    *status = QM_OK;
    s->others = fmax(s->known.lower, fmax(s->known.discarded, s->known.others));
    if (join_parts(claimed, count, &entries)) {
        upper = entries.at[0].upper;
        *status = call(s, entries.at, entries.count, s->split->round_ms, &result);
    }
    free_entries(&entries);
    if (*status != QM_OK) return ROUND_FAILED;
    if (result.stop == QM_STOP_MEMORY && !is_owner) {
        give_back(s, claimed, count);
        return ROUND_NO_MEMORY;
    }
    if (result.stop == QM_STOP_MEMORY && result.iterations == 0) return ROUND_NO_MEMORY;
    const qm_store_bounds found = found_by(&result);
    join_bounds(&s->known, &found);
    merge_entries(&s->rest, upper, s->split->most_pieces);
    adapt_claims(s, count, start_ms, s->rest.count == 0);
    qm_stored stored = replace_parts(s, claimed, count, &found);
    if (stored == QM_STORED_NO_MEMORY || result.stop == QM_STOP_MEMORY) return ROUND_NO_MEMORY;
    return stored == QM_STORED || stored == QM_STORED_LOST ? ROUND_DONE : ROUND_FAULT;
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
    merge_entries(&s->rest, INFINITY, s->split->most_pieces);
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
