/**
 * collide_faces.h: whether two whole faces meet, in either reading, and where.
 */
#ifndef QM_COLLIDE_FACES_H
#define QM_COLLIDE_FACES_H

#include "qm/collide.h"

/** Two faces of two meshes, or of one. */
typedef struct qm_faces {
    const qm_mesh *mesh[2];
    uint32_t face[2];
    bool is_self;
} qm_faces;

/** Whether one of them is a quad, so that the bilinear reading differs from that as triangles. */
bool qm_faces_have_quad(const qm_faces *faces);

/** Whether they meet, or collide, when quads are bilinear patches: see collide.h for the tolerance. contact
 * is written when they do; NULL for none. */
bool qm_faces_meet_bilinear(const qm_faces *faces, double tolerance, qm_contact *contact);

/** Whether two triangles meet, or collide. */
bool qm_faces_meet_exactly(const qm_faces *faces);

/** The largest place where they have a point in common as triangles; false when they have none. */
bool qm_faces_find_contact(const qm_faces *faces, qm_contact *contact);

/** Finds the faces as stored that make a pair of faces of the input meet, and where; mesh and is_self are
 * set. False when there are none. */
bool qm_faces_find_pair(qm_faces *faces, const qm_collide_options *options, qm_face_pair pair,
                        qm_contact *contact);

#endif
