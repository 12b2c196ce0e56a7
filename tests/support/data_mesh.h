/**
 * data_mesh.h: real meshes from a data folder, which need not be there: QM_TEST_DATA, or ../shared/data.
 */
#ifndef QM_DATA_MESH_H
#define QM_DATA_MESH_H

#include "qm/mesh.h"

const char *qm_data_folder(void);

/** True when the folder can be read. */
bool qm_data_is_there(void);

/**
 * Runs a group of tests that need the folder, or skips it with qm_data_skip_tests. Returns the number of failed
 * tests.
 */
#define qm_data_run_group_tests(tests)                                                                       \
    (qm_data_is_there() ? cmocka_run_group_tests(tests, NULL, NULL)                                          \
                        : qm_data_skip_tests(sizeof(tests) / sizeof *(tests)))

/** Prints "NOT RUN count", which tests/run.sh adds up. Returns the tests that failed by that: all where
 * QM_REQUIRE_DATA is set, else none. */
int qm_data_skip_tests(size_t count);

/** Reads a mesh by its name in the folder, e.g. "pairs/spot/tri.obj"; a fault ends the test. The mesh is the
 * context's, for qm_mesh_reset. */
void qm_data_mesh_read(qm_context *ctx, const char *name, qm_mesh *mesh);

#endif
