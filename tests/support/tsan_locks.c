/*
 * The locks of <threads.h> by those of <pthread.h>, for programs under ThreadSanitizer: gcc 12's does not see
 * the former and takes what they guard for races. In the C library both are the same object. Other programs
 * get nothing.
 */
#ifdef __SANITIZE_THREAD__

#include <pthread.h>
#include <threads.h>

_Static_assert(sizeof(mtx_t) >= sizeof(pthread_mutex_t) && _Alignof(mtx_t) >= _Alignof(pthread_mutex_t),
               "a lock of one kind has room for one of the other");

static pthread_mutex_t *inside(mtx_t *lock)
{
    return (pthread_mutex_t *)(void *)lock;
}

int mtx_init(mtx_t *lock, int type)
{
    return type == mtx_plain && pthread_mutex_init(inside(lock), NULL) == 0 ? thrd_success : thrd_error;
}

int mtx_lock(mtx_t *lock)
{
    return pthread_mutex_lock(inside(lock)) == 0 ? thrd_success : thrd_error;
}

int mtx_unlock(mtx_t *lock)
{
    return pthread_mutex_unlock(inside(lock)) == 0 ? thrd_success : thrd_error;
}

void mtx_destroy(mtx_t *lock)
{
    pthread_mutex_destroy(inside(lock));
}

#else

typedef int qm_tsan_locks_are_not_needed;

#endif
