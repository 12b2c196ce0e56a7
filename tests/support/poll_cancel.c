#include "poll_cancel.h"

static void count_poll(void *user)
{
    qm_poll_cancel *state = user;
    if (state->polls++ == state->at) atomic_store(&state->is_canceled, true);
}

qm_context qm_poll_cancel_context(qm_poll_cancel *state, size_t at)
{
    state->at = at;
    state->polls = 0;
    atomic_store(&state->is_watched, true);
    atomic_store(&state->is_canceled, false);
    qm_context ctx = qm_context_make();
    ctx.cancel = &state->is_canceled;
    ctx.pause = &state->is_watched;
    ctx.wait = count_poll;
    ctx.wait_user = state;
    return ctx;
}
