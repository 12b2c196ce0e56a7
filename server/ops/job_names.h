/**
 * job_names.h: what the values of some fields of jobs are called, in the order of their enums, with NULL
 * after the last.
 */
#ifndef QM_JOB_NAMES_H
#define QM_JOB_NAMES_H

extern const char *const qm_direction_names[];      /* qm_direction */
extern const char *const qm_quads_names[];          /* qm_quad_reading */
extern const char *const qm_accelerator_names[];    /* qm_accelerator */
extern const char *const qm_bounds_names[];         /* qm_bounds */
extern const char *const qm_collide_mode_names[];   /* qm_collide_mode */
extern const char *const qm_tolerance_unit_names[]; /* of a tolerance: whether it is absolute */

#endif
