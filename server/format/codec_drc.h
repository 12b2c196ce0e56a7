/**
 * codec_drc.h: what the files of the Draco decoder share.
 */
#ifndef QM_CODEC_DRC_H
#define QM_CODEC_DRC_H

#include "codec_build.h"
#include "codec_draco.h"

/** Holds the counts in the head of a file against the limits, as a few bytes may announce a mesh that fills
 * the memory. */
qm_status qm_drc_check_head(qm_builder *builder, const uint8_t *bytes, size_t size);

/** Adds the faces that the triangles were cut from; the triangles themselves where their marks make no
 * sense. */
qm_status qm_drc_join_triangles(qm_builder *builder, const qm_draco_facts *facts,
                                const qm_draco_arrays *arrays);

#endif
