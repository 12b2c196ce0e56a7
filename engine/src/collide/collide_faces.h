/**
 * collide_faces.h: whether two faces meet, in either reading of quads, and where.
 */
#ifndef QM_COLLIDE_FACES_H
#define QM_COLLIDE_FACES_H

#include "qm/collide.h"

/** A face of each of two meshes, or two of one. */
typedef struct qm_collide_faces {
    const qm_mesh *mesh[2];
    uint32_t face[2];
    bool is_self;
} qm_collide_faces;

/** Whether one of them is a quad, so that the bilinear reading differs from that as triangles. */
bool qm_collide_faces_have_quad(const qm_collide_faces *faces);

/** Whether they meet, or collide, when quads are bilinear patches: qm/collide.h says what the tolerance
 * promises. Writes contact when they do, unless it is NULL. */
bool qm_collide_faces_meet_bilinear(const qm_collide_faces *faces, double tolerance, qm_contact *contact);

/** Whether two triangles meet, or collide. */
bool qm_collide_faces_meet_exactly(const qm_collide_faces *faces);

/** Finds the first pair of faces as stored that makes two input faces meet, and the contact; mesh and is_self
 * are set. False when there is none. */
bool qm_collide_faces_find_contact(qm_collide_faces *faces, const qm_collide_options *options,
                                   qm_face_pair pair, qm_contact *contact);

#endif
