/**
 * codec_drc.h: the internal header of the Draco decoder.
 */
#ifndef QM_CODEC_DRC_H
#define QM_CODEC_DRC_H

#include "codec_build.h"
#include "codec_draco.h"

/** Checks the counts in the header of a file against the limits, because a few bytes may specify a mesh that exhausts
 * memory. */
qm_status qm_drc_check_head(qm_builder *builder, const uint8_t *bytes, size_t size);

/** Adds the faces that the triangles were cut from, or the triangles themselves if their marks are inconsistent. */
qm_status qm_drc_join_triangles(qm_builder *builder, const qm_draco_facts *facts,
                                const qm_draco_arrays *arrays);

#endif
