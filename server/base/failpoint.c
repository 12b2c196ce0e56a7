/**
 * failpoint.c: reads the point of the environment, and fails there.
 */
#include "failpoint.h"

#ifdef QM_FAILPOINTS

#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef enum { KILL, STOP, SLEEP, DROP, ACTIONS } failure;

static const char *const action_names[ACTIONS] = {"kill", "stop", "sleep", "drop"};

/** What the environment asks for; an empty name: nothing. */
static struct {
    char name[64];
    failure action;
    char file[4096];
} wanted;

static atomic_bool is_over;
static _Thread_local const char *current; /* step */

/** A point that nobody would meet makes a test that tests nothing. */
static void refuse(const char *text)
{
    fprintf(stderr, "QM_FAILPOINT=%s: not STEP.PLACE:kill|stop|sleep|drop[@FILE]\n", text);
    abort();
}

static void read_environment(void)
{
    const char *text = getenv("QM_FAILPOINT");
    if (!text || !text[0]) return;
    char asked[16] = "";
    int fields = sscanf(text, "%63[a-z_.]:%15[a-z]@%4095s", wanted.name, asked, wanted.file);
    while (wanted.action < ACTIONS && strcmp(asked, action_names[wanted.action]) != 0)
        wanted.action++;
    if (fields < 2 || !strchr(wanted.name, '.') || wanted.action == ACTIONS) refuse(text);
}

void qm_failpoint_begin(const char *step)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, read_environment);
    current = step;
}

void qm_failpoint_end(void)
{
    qm_failpoint_meet("reply");
    current = NULL;
}

static bool is_wanted(const char *place)
{
    size_t length = strlen(current);
    return strncmp(wanted.name, current, length) == 0 && wanted.name[length] == '.' &&
           strcmp(wanted.name + length + 1, place) == 0 &&
           (!wanted.file[0] || access(wanted.file, F_OK) == 0);
}

bool qm_failpoint_meet(const char *place)
{
    if (!current || !is_wanted(place) || atomic_exchange(&is_over, true)) return false;
    fprintf(stderr, "failpoint %s: %s\n", wanted.name, action_names[wanted.action]);
    if (wanted.action == KILL) raise(SIGKILL);
    if (wanted.action == STOP) raise(SIGSTOP);
    if (wanted.action == SLEEP) sleep(QM_FAILPOINT_SLEEP_S);
    return wanted.action == DROP;
}

#endif
