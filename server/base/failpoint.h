/**
 * failpoint.h: points at which a test has the process fail, by name. Only builds with QM_FAILPOINTS have them; in others
 * the macros are nothing.
 *
 * A point is named STEP.PLACE: the step that the thread is in, as a verb of the store, and where in it. The environment names
 * one point, what happens there, and perhaps a file without which nothing happens:
 *
 *     QM_FAILPOINT=revise_mesh.before:kill
 *     QM_FAILPOINT=revise_mesh.after:drop@/tmp/armed
 *
 * kill: as by kill -9. stop: as by SIGSTOP. sleep: the thread waits for QM_FAILPOINT_SLEEP_S. drop: an answer is taken for lost, at
 * the places that ask for it. It happens once in a process.
 *
 * Places of each step that stores something: before, the commit; after, it was done, and nothing else; reply, the step has
 * returned, and nobody was told.
 */
#ifndef QM_FAILPOINT_H
#define QM_FAILPOINT_H

#ifdef QM_FAILPOINTS

#include <stdbool.h>

#define QM_FAILPOINT_SLEEP_S 2

/** The step of this thread, a literal, until it ends. */
void qm_failpoint_begin(const char *step);
void qm_failpoint_end(void);

/** Does what is asked for at this place of the step. True: an answer is to be dropped. */
bool qm_failpoint_meet(const char *place);

#define QM_FAILPOINT_BEGIN(step) qm_failpoint_begin(step)
#define QM_FAILPOINT_END() qm_failpoint_end()
#define QM_FAILPOINT(place) ((void)qm_failpoint_meet(place))
#define QM_FAILPOINT_DROPS(place) qm_failpoint_meet(place)

#else

#define QM_FAILPOINT_BEGIN(step) ((void)0)
#define QM_FAILPOINT_END() ((void)0)
#define QM_FAILPOINT(place) ((void)0)
#define QM_FAILPOINT_DROPS(place) false

#endif
#endif
