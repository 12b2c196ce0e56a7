/**
 * picture.h: a picture of a mesh as a PNG file, drawn in software.
 */
#ifndef QM_PICTURE_H
#define QM_PICTURE_H

#include "qm/mesh.h"

/** Draws the mesh shaded, with its edges, from the side that shows most of it. False with errno if the file cannot be
 * written or memory runs out. */
bool picture_write(const char *path, const qm_mesh *mesh);

#endif
