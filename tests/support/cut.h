/**
 * cut.h: a TCP proxy that a test can make fail, in a thread of its own.
 */
#ifndef QM_CUT_H
#define QM_CUT_H

typedef struct qm_cut qm_cut;

typedef enum qm_cut_mode {
    QM_CUT_NOTHING,
    QM_CUT_ANSWER, /* the next bytes of the server are lost, with their connection; then nothing */
    QM_CUT_HOLD,   /* bytes of the server wait */
    QM_CUT_ALL     /* there are no connections, and no new ones */
} qm_cut_mode;

/** A proxy before a server; without one the test program ends. */
qm_cut *qm_cut_open(const char *host, int port);
int qm_cut_port(const qm_cut *cut);

/** Changes the mode; it holds when this returns. */
void qm_cut_set(qm_cut *cut, qm_cut_mode mode);
void qm_cut_close(qm_cut *cut);

#endif
