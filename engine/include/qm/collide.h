/**
 * collide.h: which faces of two surfaces meet, or of one surface with itself.
 *
 * Surfaces are closed sets, so faces that only touch meet too. With quads as triangles, all is decided by
 * exact signs: the answer doesn't depend on the order of faces or corners, on threads, or on moving
 * everything by the same vector where that is exact in doubles.
 */
#ifndef QM_COLLIDE_H
#define QM_COLLIDE_H

#include "qm/bvh.h"

/** What two faces have in common. */
typedef enum qm_contact_kind { QM_CONTACT_POINT, QM_CONTACT_SEGMENT, QM_CONTACT_AREA } qm_contact_kind;

/** One place where faces meet: two points of it, in the frame of the meshes; the same twice for a point. */
typedef struct qm_contact {
    qm_contact_kind kind;
    double point[2][3];
} qm_contact;

#endif
