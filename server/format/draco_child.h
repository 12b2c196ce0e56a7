/**
 * draco_child.h: Draco files decoded in a process of their own, which a file made to hurt can take down alone
 * (there are open reports of crashes and of endless memory in the library).
 *
 * The daemon starts its own program again in a mode that reads bytes from one descriptor and leaves counts
 * and arrays in the shared memory of another, in a sandbox (sandbox.h). Whatever comes back is checked again.
 */
#ifndef QM_DRACO_CHILD_H
#define QM_DRACO_CHILD_H

#include "codec_draco.h"

#define QM_DRACO_CHILD_FLAG "--decode-draco"

/** A decoder (codec_draco.h) that runs in a child; a child that dies or says nonsense is QM_DRACO_MALFORMED.
 * Any thread. */
qm_draco_decode_fn qm_draco_child_decode;

/** The program of the child, "/proc/self/exe" unless set before the first call. */
void qm_draco_child_set_program(const char *path);

/** What the program does with QM_DRACO_CHILD_FLAG: decodes and returns the exit status. */
int qm_draco_child_main(void);

#endif
