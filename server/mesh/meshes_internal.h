/**
 * meshes_internal.h: what the files of the mesh table share: meshes.c (table, loading, budget),
 * meshes_add.c (uploads) and meshes_deform.c (revisions).
 */
#ifndef QM_MESHES_INTERNAL_H
#define QM_MESHES_INTERNAL_H

#include <uv.h>

#include "base/budget.h"
#include "meshes.h"

/** An entry lives while it is in the list or anybody holds a reference. */
struct qm_mesh_ref {
    char id[QM_ID_SIZE];
    qm_loaded_mesh mesh;
    enum { QM_MESH_LOADING, QM_MESH_READY, QM_MESH_BROKEN } state; /* loading, or being changed in place */
    int references;                                                /* the list counts as one */
    bool listed;
    qm_problem problem; /* when broken */
    qm_meshes *meshes;
    qm_mesh_ref *next;
};

/**
 * lock guards the list, which has the most recently used mesh first, references and states; changed signals a
 * new state. A mesh that is READY is never written. store_lock is taken before lock, by threads that add,
 * change or remove a mesh in the store: no two rows have equal content and options, no blob is removed that a
 * row is about to name, and list and store agree.
 */
struct qm_meshes {
    qm_store *store;
    qm_codec_limits limits;
    qm_budget budget;
    int threads; /* that prepare a mesh */
    uv_mutex_t store_lock;
    uv_mutex_t lock;
    uv_cond_t changed;
    qm_mesh_ref *first;
};

/** True while any thread holds the mutex; for assertions of functions whose caller holds it. */
static inline bool qm_meshes_is_locked(uv_mutex_t *mutex)
{
    if (uv_mutex_trylock(mutex) != 0) return true;
    uv_mutex_unlock(mutex);
    return false;
}

/** A file in memory. */
typedef struct qm_mapped_bytes {
    const uint8_t *bytes;
    size_t size;
} qm_mapped_bytes;

/** Decodes the bytes of a file and prepares the mesh; positions are a revision's, or empty. False with a
 * problem. */
bool qm_meshes_load_bytes(qm_meshes *meshes, qm_mapped_bytes file, qm_mapped_bytes positions,
                          qm_format format, qm_loaded_mesh *out, qm_problem *problem);

/** The structures that a mesh of the table is prepared with. */
qm_preparation qm_meshes_preparation(const qm_meshes *meshes);

/** The row of a mesh, which must be among the entity tags of if_match, unless that is NULL: false with a
 * problem. store_lock is held, so that it stays so. */
bool qm_meshes_find_row(qm_meshes *meshes, const char *id, const char *if_match, qm_store_mesh *out,
                        qm_problem *problem);

/** The document of a mesh; NULL: out of memory. */
char *qm_meshes_make_document(const qm_store_mesh *row, const qm_loaded_mesh *mesh);

/** A new entry of a mesh in the list, which holds its one reference; NULL: out of memory. The lock is held,
 * as for the two below. */
qm_mesh_ref *qm_meshes_list(qm_meshes *meshes, const char *id);
void qm_meshes_unlist(qm_meshes *meshes, qm_mesh_ref *ref);
void qm_meshes_drop_reference(qm_mesh_ref *ref);

#endif
