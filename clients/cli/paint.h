/**
 * paint.h: a mesh with a number at each vertex as a PLY file with a colour at each vertex.
 */
#ifndef QM_PAINT_H
#define QM_PAINT_H

#include <stdio.h>

#include "qm/mesh.h"

/**
 * Writes binary PLY: positions in double, red green blue from dark blue (0) through green to yellow (the
 * greatest value), and the value itself as the property "quality". Quads stay quads. False when it could not
 * be written.
 */
bool cli_paint(FILE *file, const qm_mesh *mesh, const double *value);

#endif
