/**
 * meshopt.h: decodes EXT_meshopt_compression by the library meshoptimizer, which is loaded when a file needs it: to
 * link it would slow every start of the command line. Its decoders are safe for untrusted data, as their
 * documentation promises; they write no more than the elements that they are to decode.
 * Source: the extension's specification, appendices A (streams) and B (filters).
 */
#ifndef QM_MESHOPT_H
#define QM_MESHOPT_H

#include "gltf.h"

typedef enum qm_meshopt_outcome {
    QM_MESHOPT_DONE,
    QM_MESHOPT_MALFORMED,
    QM_MESHOPT_UNAVAILABLE /* the library is not installed */
} qm_meshopt_outcome;

/** Whether the sizes of an encoded view are possible, before memory is allocated for it: its elements have sizes that
 * the decoder takes, and as few encoded bytes can stand for them. */
bool qm_meshopt_is_possible(const qm_gltf_view *view);

/** Decodes the elements of an encoded view; out has room for view->count elements of view->stride bytes. */
qm_meshopt_outcome qm_meshopt_decode(const qm_gltf_view *view, const uint8_t *encoded, uint8_t *out);

#endif
