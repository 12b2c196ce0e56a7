/**
 * kernels.h: prototypes of the kernel functions of one instruction set, named by QM_KERNEL.
 */
#ifndef QM_KERNEL_KERNELS_H
#define QM_KERNEL_KERNELS_H

#include "pack.h"

void QM_KERNEL(share_corners)(qm_pack_lanes *lanes, const uint32_t vertex[3 * QM_PACK_LANES]);
void QM_KERNEL(fit_box)(qm_bvh *bvh, size_t pack, const uint32_t *vertices, size_t count);
void QM_KERNEL(fit_groups)(qm_bvh *bvh, const qm_deformer *deformer, size_t begin, size_t end);
void QM_KERNEL(load_corners)(const qm_bvh *bvh, size_t pack, qm_pack_corners *out);
void QM_KERNEL(fit_corners)(qm_bvh *bvh, size_t pack, qm_pack_corners *out);
void QM_KERNEL(fill_pack)(qm_pack *pack, const double corner[3][3][QM_PACK_LANES]);
void QM_KERNEL(pack_distances)(const qm_pack *pack, qm_vec p, double d2[QM_PACK_LANES]);
void QM_KERNEL(closest)(const qm_bvh *bvh, qm_vec p, qm_hit *hit);
void QM_KERNEL(closest_patch)(const qm_bvh *bvh, qm_vec p, uint32_t start, double error,
                              qm_bilinear_hit *hit);
void QM_KERNEL(closest_ties)(const qm_bvh *bvh, qm_vec p, uint32_t start, qm_ties *ties);
void QM_KERNEL(fill_float)(qm_float_pack *pack, const double corner[3][3][QM_PACK_LANES]);
double QM_KERNEL(float_upper)(const qm_float_pack *pack, const float *twist, qm_vec p);
void QM_KERNEL(float_reach)(const qm_float_pack *pack, const float *twist, double cutoff, const qm_vec *point,
                            unsigned wanted, qm_float_bits *bits);
void QM_KERNEL(float_closest)(const qm_bvh *bvh, qm_vec p, double enough, qm_float_hit *hit);
void QM_KERNEL(grid_closest)(const qm_grid *grid, qm_vec p, qm_hit *hit);
void QM_KERNEL(grid_closest_patch)(const qm_grid *grid, qm_vec p, uint32_t start, double error,
                                   qm_bilinear_hit *hit);
void QM_KERNEL(grid_closest_ties)(const qm_grid *grid, qm_vec p, uint32_t start, qm_ties *ties);
void QM_KERNEL(tetra_closest)(const qm_tetra *tetra, qm_vec p, qm_hit *hit);
void QM_KERNEL(tetra_closest_patch)(const qm_tetra *tetra, qm_vec p, uint32_t start, double error,
                                    qm_bilinear_hit *hit);
void QM_KERNEL(tetra_closest_ties)(const qm_tetra *tetra, qm_vec p, uint32_t start, qm_ties *ties);
size_t QM_KERNEL(tetra_fit)(qm_tetra *tetra, size_t patch, const uint64_t *changed);
void QM_KERNEL(gather)(const qm_bvh *bvh, const qm_box *box, double reach, qm_near_packs *near);
int QM_KERNEL(narrow)(const qm_near_packs *near, const qm_box *box, double reach, int capacity,
                      uint32_t *packs);
uint64_t QM_KERNEL(in_reach)(const qm_candidates *candidates, qm_vec p);
void QM_KERNEL(shortlist)(const qm_bvh *bvh, const qm_near_packs *near, qm_vec p, qm_shortlist *list);
double QM_KERNEL(hull_upper)(const qm_candidates *candidates, const qm_vec *point, int count, int *place);
void QM_KERNEL(shortlist_rows)(const qm_bvh *bvh, const qm_shortlist *list, qm_pack *rows);
void QM_KERNEL(shortlist_floats)(const qm_bvh *bvh, const qm_shortlist *list, qm_float_pack *rows);
bool QM_KERNEL(cover)(const qm_candidates *candidates, qm_polygon *polygon, bool *moved);
qm_float_verdict QM_KERNEL(float_cover)(const qm_float_pack *pack, const float *twist, double cutoff,
                                        qm_polygon *polygon, bool *moved);
unsigned QM_KERNEL(overlay_add)(qm_overlay_facets *facets, const qm_overlay_frame *frame, const qm_bvh *bvh,
                                uint32_t pack, const float *twist, qm_overlay_vertices *vertices);
void QM_KERNEL(overlay_close)(qm_overlay_facets *facets);
bool QM_KERNEL(overlay_is_clear)(const qm_overlay_facets *facets, const qm_overlay_face *face);
double QM_KERNEL(overlay_gap)(const qm_overlay_facets *facets, const qm_overlay_face *face, double enough,
                              uint8_t *far);
int QM_KERNEL(overlay_count)(const qm_overlay_facets *facets, const qm_overlay_face *face);
unsigned QM_KERNEL(node_distances)(const qm_descent *descent, const qm_node *a, const qm_node *b,
                                   bool splits_a, float d2[QM_PACK_LANES]);
bool QM_KERNEL(descend)(const qm_descent *descent, const qm_node *a, const qm_node *b);
void QM_KERNEL(fill_leaf)(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind, uint32_t pack,
                          qm_leaf *leaf);
void QM_KERNEL(add_lane_pairs)(const qm_leaf *p, const qm_leaf *q, bool seeks_alike, qm_lane_pairs *pairs,
                               qm_near_lanes *out);
void QM_KERNEL(decide_lane_pairs)(const qm_lane_pairs *pairs, unsigned first, qm_pair_verdicts *out);
bool QM_KERNEL(compare_leaves)(const qm_leaf *p, const qm_leaf *q, qm_collide_kind kind, unsigned moved_p,
                               unsigned moved_q, qm_near_lanes *out);
void QM_KERNEL(hilbert_keys)(const qm_hilbert_cells *cells, int count, int bits, uint64_t *keys);
void QM_KERNEL(vertices_on_sides)(const double *positions, size_t count, const qm_box *box,
                                  uint32_t vertex[QM_BOX_SIDES]);
bool QM_KERNEL(faces_below)(const uint32_t *faces, size_t count, uint32_t vertex_count);
bool QM_KERNEL(faces_name)(const uint32_t *faces, size_t count, const uint32_t vertex[QM_BOX_SIDES]);
void QM_KERNEL(vertex_box)(const double *positions, size_t count, qm_box *box);
void QM_KERNEL(vertex_cells)(const qm_cell_grid *grid, const double *positions, size_t count, qm_cell *cells);
void QM_KERNEL(vertex_fine)(const double origin[3], double scale, const double *positions, size_t count,
                            uint64_t *fine);
unsigned QM_KERNEL(cell_boxes)(const qm_cell_grid *grid, const uint32_t *faces, const qm_cell *cells,
                               qm_cell_boxes *out);
unsigned QM_KERNEL(cells_marked)(const qm_cell_grid *grid, const qm_cell_marks *marks,
                                 const qm_cell_boxes *boxes, unsigned *large);
void QM_KERNEL(keep_cells)(const qm_cell_boxes *boxes, uint32_t first, unsigned faces, qm_cell_list *list);
void QM_KERNEL(sort_few)(uint64_t *numbers, int count);

#endif
