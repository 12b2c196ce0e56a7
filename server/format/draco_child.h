/**
 * draco_child.h: decodes Draco files in a process of its own, so that a hostile file can crash only that process (the
 * library has open reports of crashes and of unbounded memory).
 *
 * The daemon starts its own program in a mode that reads the file from one descriptor and writes counts and arrays to
 * shared memory in another one, in a sandbox (sandbox.h). The parent validates the results.
 */
#ifndef QM_DRACO_CHILD_H
#define QM_DRACO_CHILD_H

#include "codec_draco.h"

#define QM_DRACO_CHILD_FLAG "--decode-draco"

/** A decoder (codec_draco.h) that runs in a child. QM_DRACO_MALFORMED if the child crashes or returns invalid results. Any
 * thread. */
qm_draco_decode_fn qm_draco_child_decode;

/** The program of the child, "/proc/self/exe" unless set before the first call. */
void qm_draco_child_set_program(const char *path);

/** The main function of the child, for QM_DRACO_CHILD_FLAG: decodes and returns the exit status. */
int qm_draco_child_main(void);

#endif
