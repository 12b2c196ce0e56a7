/**
 * cut.c: one thread polls all sockets, and looks at the mode between two polls.
 */
#include "cut.h"

#include <arpa/inet.h>
#include <poll.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define PAIRS 128
#define POLL_MS 5

struct qm_cut {
    struct sockaddr_in server;
    int listener, port;
    int clients[PAIRS], servers[PAIRS];
    int pair_count;
    pthread_t thread;
    pthread_mutex_t lock;   /* guards what follows */
    pthread_cond_t changed; /* the thread has seen the mode */
    qm_cut_mode mode;
    bool is_seen, is_closing;
};

static void close_pair(qm_cut *cut, int i)
{
    close(cut->clients[i]);
    close(cut->servers[i]);
    cut->pair_count--;
    cut->clients[i] = cut->clients[cut->pair_count];
    cut->servers[i] = cut->servers[cut->pair_count];
}

static void accept_pair(qm_cut *cut, qm_cut_mode mode)
{
    int client = accept(cut->listener, NULL, NULL);
    if (client < 0) return;
    int server = socket(AF_INET, SOCK_STREAM, 0);
    bool is_wanted = mode != QM_CUT_ALL && cut->pair_count < PAIRS;
    if (is_wanted && server >= 0 &&
        connect(server, (struct sockaddr *)&cut->server, sizeof cut->server) == 0) {
        cut->clients[cut->pair_count] = client;
        cut->servers[cut->pair_count++] = server;
        return;
    }
    close(client);
    if (server >= 0) close(server);
}

/** Sends on what there is to read; false at the end. */
static bool pump(int from, int to)
{
    char bytes[65536];
    ssize_t size = recv(from, bytes, sizeof bytes, MSG_DONTWAIT);
    if (size <= 0) return false;
    for (ssize_t done = 0; done < size;) {
        ssize_t sent = send(to, bytes + done, (size_t)(size - done), MSG_NOSIGNAL);
        if (sent <= 0) return false;
        done += sent;
    }
    return true;
}

/** The mode, which the thread that has set it waits for. */
static qm_cut_mode see_mode(qm_cut *cut, bool *is_closing)
{
    pthread_mutex_lock(&cut->lock);
    qm_cut_mode mode = cut->mode;
    *is_closing = cut->is_closing;
    while (mode == QM_CUT_ALL && cut->pair_count > 0)
        close_pair(cut, 0);
    cut->is_seen = true;
    pthread_cond_broadcast(&cut->changed);
    pthread_mutex_unlock(&cut->lock);
    return mode;
}

static void heal(qm_cut *cut)
{
    pthread_mutex_lock(&cut->lock);
    cut->mode = QM_CUT_NOTHING;
    pthread_mutex_unlock(&cut->lock);
}

static void *run(void *user)
{
    qm_cut *cut = user;
    bool is_closing;
    for (qm_cut_mode mode; mode = see_mode(cut, &is_closing), !is_closing;) {
        struct pollfd sockets[1 + 2 * PAIRS] = {{.fd = cut->listener, .events = POLLIN}};
        int count = cut->pair_count;
        for (int i = 0; i < count; i++) {
            sockets[1 + 2 * i] = (struct pollfd){.fd = cut->clients[i], .events = POLLIN};
            sockets[2 + 2 * i] =
                (struct pollfd){.fd = mode == QM_CUT_HOLD ? -1 : cut->servers[i], .events = POLLIN};
        }
        poll(sockets, (nfds_t)(1 + 2 * count), POLL_MS);
        for (int i = count - 1; i >= 0; i--) { /* the last one takes the place of one that is closed */
            bool is_good = true;
            if (sockets[1 + 2 * i].revents) is_good = pump(cut->clients[i], cut->servers[i]);
            if (is_good && sockets[2 + 2 * i].revents && mode == QM_CUT_ANSWER) {
                heal(cut);
                mode = QM_CUT_NOTHING;
                is_good = false;
            } else if (is_good && sockets[2 + 2 * i].revents) {
                is_good = pump(cut->servers[i], cut->clients[i]);
            }
            if (!is_good) close_pair(cut, i);
        }
        if (sockets[0].revents) accept_pair(cut, mode);
    }
    while (cut->pair_count > 0)
        close_pair(cut, 0);
    return NULL;
}

qm_cut *qm_cut_open(const char *host, int port)
{
    qm_cut *cut = calloc(1, sizeof *cut);
    if (!cut) abort();
    cut->server = (struct sockaddr_in){.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    struct sockaddr_in own = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof own;
    cut->listener = socket(AF_INET, SOCK_STREAM, 0);
    pthread_mutex_init(&cut->lock, NULL);
    pthread_cond_init(&cut->changed, NULL);
    if (inet_pton(AF_INET, strcmp(host, "localhost") == 0 ? "127.0.0.1" : host, &cut->server.sin_addr) != 1 ||
        bind(cut->listener, (struct sockaddr *)&own, sizeof own) != 0 || listen(cut->listener, 64) != 0 ||
        getsockname(cut->listener, (struct sockaddr *)&own, &size) != 0 ||
        pthread_create(&cut->thread, NULL, run, cut) != 0)
        abort();
    cut->port = ntohs(own.sin_port);
    return cut;
}

int qm_cut_port(const qm_cut *cut)
{
    return cut->port;
}

void qm_cut_set(qm_cut *cut, qm_cut_mode mode)
{
    pthread_mutex_lock(&cut->lock);
    cut->mode = mode;
    cut->is_seen = false;
    while (!cut->is_seen)
        pthread_cond_wait(&cut->changed, &cut->lock);
    pthread_mutex_unlock(&cut->lock);
}

void qm_cut_close(qm_cut *cut)
{
    pthread_mutex_lock(&cut->lock);
    cut->is_closing = true;
    pthread_mutex_unlock(&cut->lock);
    pthread_join(cut->thread, NULL);
    close(cut->listener);
    pthread_mutex_destroy(&cut->lock);
    pthread_cond_destroy(&cut->changed);
    free(cut);
}
