/**
 * scheduler.c: one list of clients, their tasks, and the choice of the next one.
 *
 * Times are in ms. The virtual time of a flow is the time that its tasks have used divided by the flow's weight; the flow
 * with the least goes first. The clock of a client advances by the time used divided by the weights of all its flows, as
 * it would if all were served at once; a flow begins at the clock.
 */
#include "scheduler.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>
#include <uv.h>

#include "clock.h"
#include "qm/base.h"

#define SLICE_MS 20.0      /* a task that has run so long is paused when another one waits */
#define SHORT_SLICE_MS 5.0 /* the same of a task that was paused before, when the other one has not begun */
#define CREDIT_MS 40.0     /* what an idle client or flow begins ahead of the others */
#define LATE_MS 5.0        /* a task that has not paused so long after its flag rose is late */
#define TICK_NS 2000000    /* between looks at the slices, while a task waits */
#define ALONE_NS 100000000 /* between looks while tasks wait for nothing but the time of a suspect */

static const double weight_of[] = {
    [QM_PRIORITY_LOW] = 1.0, [QM_PRIORITY_NORMAL] = 4.0, [QM_PRIORITY_HIGH] = 16.0};
#define FRESH_WEIGHT 4.0 /* of the flow of tasks that have not been paused */

typedef enum turn_state {
    TURN_WAITING, /* has not begun */
    TURN_RUNNING, /* holds a worker */
    TURN_PAUSED,  /* has begun and waits for a worker */
    TURN_AWAY     /* goes on without a worker */
} turn_state;

typedef struct client client;

struct qm_turn {
    qm_task task;
    qm_scheduler *scheduler;
    client *client;
    turn_state state;
    bool was_paused;  /* it is a flow of its own */
    bool hurries;     /* it is never paused any more */
    bool is_late;     /* its worker is lent to another task meanwhile */
    double granted;   /* when it got its worker */
    double charged;   /* up to when its time is in the accounts */
    double raised;    /* when its flag rose */
    double used;      /* virtual time; before the first pause, what its first slice took too long */
    atomic_bool flag; /* raised when it is to pause */
    uv_cond_t resumed;
    qm_turn
        *next; /* in a list of waiting turns, the client's of paused ones, or the granted or running ones */
};

typedef struct turn_list {
    qm_turn *first, *last;
} turn_list;

/** A client is kept while it has tasks, or while its account is ahead of the others. */
struct client {
    char name[QM_CLIENT_SIZE];
    double used;         /* time of all its tasks */
    double fresh_used;   /* virtual time of the flow of tasks that have not been paused */
    double clock;        /* virtual time of the client */
    double weights;      /* of the tasks that were paused and have not ended */
    size_t turns, begun; /* that have not ended */
    turn_list waiting[QM_PRIORITY_HIGH + 1];
    turn_list paused; /* begun tasks that wait for a worker; those of the fresh flow too */
    client *next;
};

struct qm_scheduler {
    uv_mutex_t lock;
    uv_cond_t granted_one; /* for idle threads */
    uv_cond_t contended;   /* for the ticker */
    client *clients;
    turn_list suspects;   /* that have not begun; other waiting turns are in the lists of their clients */
    const qm_turn *alone; /* the suspect that began last, until it ends */
    double last_begun;    /* when a turn began last */
    turn_list granted;    /* that no thread has begun yet */
    turn_list running;
    size_t workers, max_begun;
    size_t held; /* workers; more than there are while a task hurries or is late */
    size_t late;
    size_t begun, waiting, paused;
    size_t idle; /* threads, less those that a granted turn is for */
    bool closing;
    int niceness;
    bool has_ticker;
    uv_thread_t ticker;
    size_t thread_count;
    uv_thread_t threads[];
};

/* ---- lists ---- */

static void append(turn_list *list, qm_turn *turn)
{
    turn->next = NULL;
    if (list->last)
        list->last->next = turn;
    else
        list->first = turn;
    list->last = turn;
}

static void take(turn_list *list, qm_turn *turn)
{
    qm_turn *before = NULL;
    for (qm_turn *at = list->first; at != turn; at = at->next)
        before = at;
    if (before)
        before->next = turn->next;
    else
        list->first = turn->next;
    if (list->last == turn) list->last = before;
    turn->next = NULL;
}

static qm_turn *first_waiting(const client *c)
{
    for (int priority = QM_PRIORITY_HIGH; priority >= 0; priority--)
        if (c->waiting[priority].first) return c->waiting[priority].first;
    return NULL;
}

/* ---- accounts ---- */

/** Charges the time since the last look to all running tasks. */
static void settle(qm_scheduler *s)
{
    double now = qm_clock_now_ms();
    for (qm_turn *turn = s->running.first; turn; turn = turn->next) {
        client *c = turn->client;
        double time = fmax(now - turn->charged, 0.0) * turn->task.threads;
        c->used += time;
        double weights = c->weights;
        if (turn->was_paused) {
            turn->used += time / weight_of[turn->task.priority];
            if (first_waiting(c)) weights += FRESH_WEIGHT;
        } else {
            /* The flow pays for a slice of each task, the task for the rest. */
            double over = fmin(now - turn->granted - SLICE_MS, now - turn->charged) * turn->task.threads;
            over = fmax(over, 0.0);
            c->fresh_used += (time - over) / FRESH_WEIGHT;
            turn->used += over / weight_of[turn->task.priority];
            weights += FRESH_WEIGHT;
        }
        turn->charged = now;
        c->clock += time / weights;
    }
}

/** The least time used of all clients that have tasks; INFINITY when none has. */
static double least_used(const qm_scheduler *s)
{
    double least = INFINITY;
    for (const client *c = s->clients; c; c = c->next)
        if (c->turns > 0) least = fmin(least, c->used);
    return least;
}

/** Forgets idle clients whose account is not ahead of the others any more. */
static void forget_clients(qm_scheduler *s)
{
    double least = least_used(s);
    for (client **link = &s->clients; *link;) {
        client *c = *link;
        if (c->turns > 0 || c->used > least - CREDIT_MS) {
            link = &c->next;
            continue;
        }
        *link = c->next;
        free(c);
    }
}

static client *find_client(qm_scheduler *s, const char *name)
{
    for (client *c = s->clients; c; c = c->next)
        if (strncmp(c->name, name, QM_CLIENT_SIZE - 1) == 0) return c;
    client *c = calloc(1, sizeof *c);
    if (!c) return NULL;
    snprintf(c->name, sizeof c->name, "%s", name);
    c->next = s->clients;
    s->clients = c;
    return c;
}

/* ---- the choice ---- */

/** The list in which a turn waits for its beginning. */
static turn_list *waiting_list(qm_scheduler *s, const qm_turn *turn)
{
    return turn->task.alone_ms > 0.0 ? &s->suspects : &turn->client->waiting[turn->task.priority];
}

/** True while a suspect has begun too lately for another turn to begin, or waits until it may begin alone. */
static bool is_blocked(const qm_scheduler *s, double now)
{
    return s->suspects.first || (s->alone && now < s->last_begun + s->alone->task.alone_ms);
}

/** The suspect that is to begin, or NULL. */
static qm_turn *choose_suspect(const qm_scheduler *s, double now)
{
    qm_turn *first = s->suspects.first;
    if (!first || s->begun >= s->max_begun) return NULL;
    double quiet = s->alone ? fmax(first->task.alone_ms, s->alone->task.alone_ms) : first->task.alone_ms;
    return s->begun == 0 || now >= s->last_begun + quiet ? first : NULL;
}

static bool may_begin(const qm_scheduler *s, const client *c, size_t active)
{
    return s->begun < s->max_begun && (c->begun == 0 || c->begun < s->max_begun / (active + 1));
}

/** The turn that is to have the next worker, or NULL. */
static qm_turn *choose(const qm_scheduler *s)
{
    double now = qm_clock_now_ms();
    qm_turn *suspect = choose_suspect(s, now);
    if (suspect) return suspect;
    bool blocked = is_blocked(s, now);
    size_t active = 0;
    for (const client *c = s->clients; c; c = c->next)
        active += c->turns > 0;
    const client *best = NULL;
    for (const client *c = s->clients; c; c = c->next)
        if ((c->paused.first || (!blocked && first_waiting(c) && may_begin(s, c, active))) &&
            (!best || c->used < best->used))
            best = c;
    if (!best) return NULL;
    qm_turn *chosen = !blocked && may_begin(s, best, active) ? first_waiting(best) : NULL;
    double least = best->fresh_used;
    for (qm_turn *turn = best->paused.first; turn; turn = turn->next) {
        double used = turn->was_paused ? turn->used : best->fresh_used;
        /* In the fresh flow, a task that has begun goes before one that has not. */
        bool is_first =
            used < least || (chosen && used == least && chosen->state == TURN_WAITING && !turn->was_paused);
        if (chosen && !is_first) continue;
        chosen = turn;
        least = used;
    }
    return chosen;
}

static void run_turns(void *scheduler);

/** Makes sure that an idle thread is there for one more task; without it no further task begins. */
static bool reserve_thread(qm_scheduler *s)
{
    if (s->idle > 0) return true;
    if (s->thread_count < s->max_begun && uv_thread_create(&s->threads[s->thread_count], run_turns, s) == 0) {
        s->thread_count++;
        s->idle++;
        return true;
    }
    s->max_begun = s->thread_count;
    return false;
}

static void hold_worker(qm_scheduler *s, qm_turn *turn)
{
    turn->state = TURN_RUNNING;
    turn->granted = turn->charged = qm_clock_now_ms();
    atomic_store(&turn->flag, false);
    append(&s->running, turn);
    s->held++;
}

static void return_worker(qm_scheduler *s, qm_turn *turn)
{
    QM_ASSERT(turn->state == TURN_RUNNING && s->held > 0);
    settle(s);
    take(&s->running, turn);
    s->held--;
    s->late -= turn->is_late;
    turn->is_late = false;
}

static void resume(qm_scheduler *s, qm_turn *turn)
{
    take(&turn->client->paused, turn);
    s->paused--;
    hold_worker(s, turn);
    uv_cond_broadcast(&turn->resumed);
}

/** Hands a waiting turn with a worker to an idle thread; false when there is no thread. */
static bool begin(qm_scheduler *s, qm_turn *turn)
{
    if (!reserve_thread(s)) return false;
    take(waiting_list(s, turn), turn);
    s->waiting--;
    s->begun++;
    s->last_begun = qm_clock_now_ms();
    if (turn->task.alone_ms > 0.0) s->alone = turn;
    turn->client->begun++;
    s->idle--;
    turn->state = TURN_RUNNING;
    append(&s->granted, turn);
    s->held++;
    uv_cond_signal(&s->granted_one);
    return true;
}

/** Gives free workers to the turns that are next. */
static void dispatch(qm_scheduler *s)
{
    settle(s);
    qm_turn *turn;
    while ((turn = choose(s)) &&
           (s->held < s->workers || (!turn->was_paused && s->held < s->workers + s->late))) {
        if (turn->state == TURN_PAUSED) {
            resume(s, turn);
            continue;
        }
        begin(s, turn); /* false: a paused one is chosen now, or none */
    }
    if (s->waiting + s->paused > 0) uv_cond_signal(&s->contended);
}

/* ---- threads ---- */

static void end_turn(qm_scheduler *s, qm_turn *turn)
{
    client *c = turn->client;
    if (turn->state == TURN_RUNNING) return_worker(s, turn);
    if (turn->was_paused) c->weights -= weight_of[turn->task.priority];
    if (s->alone == turn) s->alone = NULL;
    s->begun--;
    c->begun--;
    c->turns--;
    s->idle++;
    uv_cond_destroy(&turn->resumed);
    free(turn);
    forget_clients(s);
    dispatch(s);
}

static void run_turns(void *data)
{
    qm_scheduler *s = data;
    if (s->niceness > 0) setpriority(PRIO_PROCESS, (id_t)gettid(), s->niceness);
    uv_mutex_lock(&s->lock);
    for (;;) {
        while (!s->granted.first && !(s->closing && s->begun + s->waiting == 0))
            uv_cond_wait(&s->granted_one, &s->lock);
        qm_turn *turn = s->granted.first;
        if (!turn) break;
        take(&s->granted, turn);
        s->held--; /* which hold_worker counts again, from this moment */
        hold_worker(s, turn);
        qm_task task = turn->task;
        uv_mutex_unlock(&s->lock);
        task.run(task.data);
        uv_mutex_lock(&s->lock);
        end_turn(s, turn);
        if (s->closing && s->begun + s->waiting == 0) {
            uv_cond_broadcast(&s->granted_one);
            uv_cond_signal(&s->contended);
        }
    }
    uv_mutex_unlock(&s->lock);
}

/** Raises the flags of tasks whose slice is over, while another task waits that may run. */
static void tick(void *data)
{
    qm_scheduler *s = data;
    uv_mutex_lock(&s->lock);
    while (!(s->closing && s->begun + s->waiting == 0)) {
        const qm_turn *next = s->waiting + s->paused > 0 ? choose(s) : NULL;
        if (!next && s->waiting > 0 && is_blocked(s, qm_clock_now_ms())) {
            uv_cond_timedwait(&s->contended, &s->lock, ALONE_NS);
            dispatch(s);
            continue;
        }
        if (!next) {
            uv_cond_wait(&s->contended, &s->lock);
            continue;
        }
        double now = qm_clock_now_ms();
        for (qm_turn *turn = s->running.first; turn; turn = turn->next) {
            double slice = turn->was_paused && !next->was_paused ? SHORT_SLICE_MS : SLICE_MS;
            bool is_raised = atomic_load(&turn->flag);
            if (turn->hurries || now - turn->granted < slice) continue;
            if (!is_raised) {
                atomic_store(&turn->flag, true);
                turn->raised = now;
            } else if (!turn->is_late && now - turn->raised >= LATE_MS) {
                turn->is_late = true;
                s->late++;
            }
        }
        dispatch(s);
        uv_cond_timedwait(&s->contended, &s->lock, TICK_NS);
    }
    uv_mutex_unlock(&s->lock);
}

/* ---- calls ---- */

qm_scheduler *qm_scheduler_create(int workers, size_t max_begun, int niceness)
{
    QM_ASSERT(workers >= 1 && max_begun >= (size_t)workers);
    qm_scheduler *s = calloc(1, sizeof *s + max_begun * sizeof s->threads[0]);
    if (!s) return NULL;
    s->workers = (size_t)workers;
    s->max_begun = max_begun;
    s->niceness = niceness;
    uv_mutex_init(&s->lock);
    uv_cond_init(&s->granted_one);
    uv_cond_init(&s->contended);
    s->has_ticker = uv_thread_create(&s->ticker, tick, s) == 0;
    uv_mutex_lock(&s->lock);
    bool has_thread = s->has_ticker && reserve_thread(s);
    uv_mutex_unlock(&s->lock);
    if (has_thread) return s;
    qm_scheduler_destroy(s);
    return NULL;
}

bool qm_scheduler_submit(qm_scheduler *s, const qm_task *task, qm_turn **out)
{
    QM_ASSERT(task->run && task->threads >= 1 && task->priority <= QM_PRIORITY_HIGH && task->client);
    qm_turn *turn = calloc(1, sizeof *turn);
    if (!turn) return false;
    *turn = (qm_turn){.task = *task, .scheduler = s};
    turn->task.client = NULL; /* the name is the caller's; the client has a copy */
    uv_cond_init(&turn->resumed);
    uv_mutex_lock(&s->lock);
    client *c = s->closing ? NULL : find_client(s, task->client);
    if (c) {
        settle(s);
        double least = least_used(s);
        if (c->turns == 0 && isfinite(least)) c->used = fmax(c->used, least - CREDIT_MS);
        if (!first_waiting(c))
            c->fresh_used = fmin(fmax(c->fresh_used, c->clock - CREDIT_MS), c->clock + CREDIT_MS);
        c->turns++;
        turn->client = c;
        append(waiting_list(s, turn), turn);
        s->waiting++;
        *out = turn;
        dispatch(s);
    }
    uv_mutex_unlock(&s->lock);
    if (c) return true;
    uv_cond_destroy(&turn->resumed);
    free(turn);
    return false;
}

void qm_scheduler_close(qm_scheduler *s)
{
    uv_mutex_lock(&s->lock);
    s->closing = true;
    uv_cond_broadcast(&s->granted_one);
    uv_cond_signal(&s->contended);
    uv_mutex_unlock(&s->lock);
    if (s->has_ticker) uv_thread_join(&s->ticker);
    s->has_ticker = false;
    /* No task is left when the ticker has ended: no thread is added any more. */
    for (size_t i = 0; i < s->thread_count; i++)
        uv_thread_join(&s->threads[i]);
    s->thread_count = 0;
}

void qm_scheduler_destroy(qm_scheduler *s)
{
    if (!s) return;
    qm_scheduler_close(s);
    while (s->clients) {
        client *c = s->clients;
        s->clients = c->next;
        free(c);
    }
    uv_cond_destroy(&s->contended);
    uv_cond_destroy(&s->granted_one);
    uv_mutex_destroy(&s->lock);
    free(s);
}

size_t qm_scheduler_count_paused(qm_scheduler *s)
{
    uv_mutex_lock(&s->lock);
    size_t paused = s->paused;
    uv_mutex_unlock(&s->lock);
    return paused;
}

const atomic_bool *qm_scheduler_flag(const qm_turn *turn)
{
    return &turn->flag;
}

static void wait_for_worker(qm_scheduler *s, qm_turn *turn)
{
    turn->state = TURN_PAUSED;
    append(&turn->client->paused, turn);
    s->paused++;
    dispatch(s);
}

void qm_scheduler_pause(void *data)
{
    qm_turn *turn = data;
    qm_scheduler *s = turn->scheduler;
    uv_mutex_lock(&s->lock);
    if (turn->state == TURN_RUNNING && atomic_load(&turn->flag) && !turn->hurries) {
        return_worker(s, turn);
        if (!turn->was_paused) { /* it is a flow of its own from now on */
            turn->was_paused = true;
            turn->used += turn->client->clock;
            turn->client->weights += weight_of[turn->task.priority];
        }
        wait_for_worker(s, turn);
    }
    while (turn->state == TURN_PAUSED)
        uv_cond_wait(&turn->resumed, &s->lock);
    uv_mutex_unlock(&s->lock);
}

void qm_scheduler_hurry(qm_turn *turn)
{
    qm_scheduler *s = turn->scheduler;
    uv_mutex_lock(&s->lock);
    turn->hurries = true;
    atomic_store(&turn->flag, false);
    if (turn->state == TURN_PAUSED) resume(s, turn);
    if (turn->state == TURN_WAITING) begin(s, turn);
    uv_mutex_unlock(&s->lock);
}

void qm_scheduler_leave(qm_turn *turn)
{
    qm_scheduler *s = turn->scheduler;
    uv_mutex_lock(&s->lock);
    return_worker(s, turn);
    turn->state = TURN_AWAY;
    dispatch(s);
    uv_mutex_unlock(&s->lock);
}

void qm_scheduler_return(qm_turn *turn)
{
    qm_scheduler *s = turn->scheduler;
    uv_mutex_lock(&s->lock);
    QM_ASSERT(turn->state == TURN_AWAY);
    if (turn->hurries)
        hold_worker(s, turn);
    else
        wait_for_worker(s, turn);
    while (turn->state == TURN_PAUSED)
        uv_cond_wait(&turn->resumed, &s->lock);
    uv_mutex_unlock(&s->lock);
}
