/**
 * parallel.c: a team of helper threads that outlive a call. The engine goes through many short parallel parts
 * one after the other, and to make a thread for each costs more than some of them take. A helper without work
 * looks out for more for a moment, giving its processor to whoever wants it, and then sleeps. A task that its
 * helper has not begun by the time that the caller is through with its own goes back to the caller: where the
 * processors are busy, or a helper takes long to wake up, no one waits for it.
 */
#include "parallel.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>

#define MAX_THREADS 256
#define LOOKS 256      /* for a change of state before the wait goes to sleep, */
#define LOOK_PAUSES 32 /* each so long: on the whole a fraction of a millisecond */

enum { HELPER_DONE, HELPER_GIVEN, HELPER_AT_WORK };

typedef struct helper {
    struct helper *next; /* in the list of idle helpers, or of those of a call */
    void (*task)(void *data, int worker);
    void *data;
    int worker;
    atomic_int state;
    atomic_int sleepers; /* threads that wait for the state to change and no longer look */
    pthread_mutex_t lock;
    pthread_cond_t changed;
} helper;

/** Helpers that no call holds; they stay until the process ends. */
static struct {
    pthread_mutex_t lock;
    helper *idle;
    int count; /* all helpers */
} team = {.lock = PTHREAD_MUTEX_INITIALIZER};

static void pause_a_little(void)
{
    for (int i = 0; i < LOOK_PAUSES; i++) {
#if defined(__x86_64__) || defined(__i386__)
        __builtin_ia32_pause();
#else
        atomic_signal_fence(memory_order_seq_cst);
#endif
    }
}

static bool change_state(helper *h, int from, int to)
{
    return atomic_compare_exchange_strong(&h->state, &from, to);
}

static void set_state(helper *h, int state)
{
    atomic_store(&h->state, state);
    if (atomic_load(&h->sleepers) == 0) return;
    pthread_mutex_lock(&h->lock);
    pthread_cond_broadcast(&h->changed);
    pthread_mutex_unlock(&h->lock);
}

static bool look_out(helper *h, int state)
{
    for (int i = 0; i < LOOKS; i++) {
        if (atomic_load(&h->state) == state) return true;
        pause_a_little();
        sched_yield();
    }
    return false;
}

/** After each sleep it looks out again: what it was woken up for may be gone, and more to come. */
static void await_state(helper *h, int state)
{
    while (!look_out(h, state)) {
        pthread_mutex_lock(&h->lock);
        atomic_fetch_add(&h->sleepers, 1);
        if (atomic_load(&h->state) != state) pthread_cond_wait(&h->changed, &h->lock);
        atomic_fetch_sub(&h->sleepers, 1);
        pthread_mutex_unlock(&h->lock);
    }
}

static void *help(void *argument)
{
    helper *h = argument;
    for (;;) {
        await_state(h, HELPER_GIVEN);
        if (!change_state(h, HELPER_GIVEN, HELPER_AT_WORK)) continue;
        h->task(h->data, h->worker);
        set_state(h, HELPER_DONE);
    }
    return NULL;
}

/** A new helper, or NULL where there is no thread or no memory for one. */
static helper *make_helper(void)
{
    helper *h = calloc(1, sizeof *h);
    if (!h) return NULL;
    pthread_mutex_init(&h->lock, NULL);
    pthread_cond_init(&h->changed, NULL);
    pthread_t thread;
    if (pthread_create(&thread, NULL, help, h) == 0) {
        pthread_detach(thread);
        return h;
    }
    pthread_cond_destroy(&h->changed);
    pthread_mutex_destroy(&h->lock);
    free(h);
    return NULL;
}

static helper *take_helper(void)
{
    pthread_mutex_lock(&team.lock);
    helper *h = team.idle;
    if (h)
        team.idle = h->next;
    else if (team.count < MAX_THREADS && (h = make_helper()))
        team.count++;
    pthread_mutex_unlock(&team.lock);
    return h;
}

static void give_back(helper *h)
{
    pthread_mutex_lock(&team.lock);
    h->next = team.idle;
    team.idle = h;
    pthread_mutex_unlock(&team.lock);
}

void qm_parallel_run(void *user, int worker_count, void (*task)(void *data, int worker), void *data)
{
    (void)user;
    helper *mine = NULL;
    int started = 0;
    while (started + 1 < worker_count) {
        helper *h = take_helper();
        if (!h) break;
        h->task = task;
        h->data = data;
        h->worker = ++started;
        h->next = mine;
        mine = h;
        set_state(h, HELPER_GIVEN);
    }
    task(data, 0);
    for (int worker = started + 1; worker < worker_count; worker++)
        task(data, worker);
    for (helper *h = mine; h; h = h->next)
        if (change_state(h, HELPER_GIVEN, HELPER_DONE)) task(data, h->worker);
    while (mine) {
        helper *h = mine;
        mine = h->next;
        await_state(h, HELPER_DONE);
        give_back(h);
    }
}

int qm_parallel_available(void)
{
    cpu_set_t set;
    int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return count < 1 ? 1 : count > MAX_THREADS ? MAX_THREADS : count;
}
