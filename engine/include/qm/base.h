/**
 * base.h: the version, the list of status codes, the assertion, the allocator hook, checked sizes and intervals.
 *
 * Conditions that only a programmer can break (a NULL argument) are asserted. Conditions that data can break
 * (a face index out of range) are reported as a qm_status, with a sentence in the context's message.
 */
#ifndef QM_BASE_H
#define QM_BASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define QM_VERSION "0.1.0"

/** Every outcome of a call: XX(suffix, stable code, sentence). The server maps each one to an HTTP status. */
#define QM_STATUS_MAP(XX)                                                                                    \
    XX(OK, "ok", "success")                                                                                  \
    XX(E_ARGUMENT, "invalid_argument", "an argument is outside its range")                                   \
    XX(E_NO_MEMORY, "out_of_memory", "not enough memory")                                                    \
    XX(E_CANCELED, "canceled", "the call was canceled")                                                      \
    XX(E_NOT_FINITE, "not_finite", "a coordinate is not a finite number")                                    \
    XX(E_EMPTY, "empty_mesh", "the mesh holds no surface and no point")                                      \
    XX(E_INDEX, "index_out_of_range", "a face refers to a vertex that does not exist")                       \
    XX(E_FORMAT, "malformed_file", "the file does not follow its format")                                    \
    XX(E_UNSUPPORTED, "unsupported_feature", "the file uses a feature that is not supported")                \
    XX(E_TOO_LARGE, "too_large", "the input is larger than a limit allows")                                  \
    XX(E_SCALE, "scale_out_of_range", "the sizes of the inputs differ beyond double precision")              \
    XX(E_LAYOUT, "invalid_layout", "the layout does not bound patches of four sides")                        \
    XX(E_NOT_CLOSED, "not_closed", "the mesh does not bound a solid")

typedef enum qm_status {
#define XX(suffix, code, text) QM_##suffix,
    QM_STATUS_MAP(XX)
#undef XX
        QM_STATUS_COUNT
} qm_status;

/** The stable machine-readable code of a status, e.g. "empty_mesh". Static storage; never NULL. */
const char *qm_status_code(qm_status status);

/** The sentence that belongs to a status. Static storage; never NULL. */
const char *qm_status_text(qm_status status);

/**
 * Memory hook. resize(user, NULL, 0, n) allocates, resize(user, p, old, 0) frees and returns NULL, any other
 * call resizes; NULL for n > 0 means out of memory and leaves p alive. The old size lets a host keep a budget
 * without headers of its own.
 */
typedef struct qm_allocator {
    void *(*resize)(void *user, void *block, size_t old_size, size_t new_size);
    void *user;
} qm_allocator;

/** The allocator on malloc, realloc and free. */
extern const qm_allocator qm_allocator_default;

/** Writes count * width to *size; false when the product does not fit a size_t. */
static inline bool qm_array_size(size_t count, size_t width, size_t *size)
{
    return !__builtin_mul_overflow(count, width, size);
}

/** An interval that contains a true value. */
typedef struct qm_interval {
    double lower, upper;
} qm_interval;

/** Called when an assertion fails: prints to stderr and aborts. */
_Noreturn void qm_core_abort(const char *condition, const char *file, int line);

#ifdef NDEBUG
#define QM_ASSERT(condition) ((void)0)
#else
#define QM_ASSERT(condition) ((condition) ? (void)0 : qm_core_abort(#condition, __FILE__, __LINE__))
#endif

#endif
