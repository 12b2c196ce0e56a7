/**
 * multipart.h: the parts of a body of multipart/form-data, as browsers and curl send files (RFC 7578, on RFC 2046, section 5.1).
 */
#ifndef QM_MULTIPART_H
#define QM_MULTIPART_H

#include "ops/problem.h"

#define QM_MULTIPART_BOUNDARY_SIZE 71 /* 70 characters and a 0 (RFC 2046, section 5.1.1) */
#define QM_MULTIPART_NAME_SIZE 200

/** A part. Its bytes are those of the body. */
typedef struct qm_multipart_part {
    char name[QM_MULTIPART_NAME_SIZE];
    char file_name[QM_MULTIPART_NAME_SIZE]; /* "" when it has none */
    char type[QM_MULTIPART_NAME_SIZE];      /* its Content-Type, or "" */
    size_t offset;                          /* of its content in the body */
    size_t size;
} qm_multipart_part;

/** Reads the boundary from a Content-Type; false when that is another type or has none. */
bool qm_multipart_read_boundary(const char *content_type, char out[QM_MULTIPART_BOUNDARY_SIZE]);

/** Splits a body, which may be NULL when size is 0. False with a problem, at a byte of the body, when it does not follow the form or has more than `room`
 * parts. */
bool qm_multipart_split(const uint8_t *body, size_t size, const char *boundary, qm_multipart_part *out,
                        size_t room, size_t *count, qm_problem *problem);

#endif
