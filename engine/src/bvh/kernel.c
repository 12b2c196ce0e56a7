#include "kernel.h"

#define DECLARE(isa)                                                                                         \
    void qm_share_corners_##isa(qm_pack_lanes *lanes, const uint32_t vertex[3 * QM_PACK_LANES]);             \
    void qm_fit_box_##isa(qm_bvh *bvh, size_t pack, const uint32_t *vertices, size_t count);                 \
    void qm_fit_groups_##isa(qm_bvh *bvh, const qm_deformer *deformer, size_t begin, size_t end);            \
    void qm_load_corners_##isa(const qm_bvh *bvh, size_t pack, qm_pack_corners *out);                        \
    void qm_fit_corners_##isa(qm_bvh *bvh, size_t pack, qm_pack_corners *out);                               \
    void qm_fill_pack_##isa(qm_pack *pack, const double corner[3][3][QM_PACK_LANES]);                        \
    void qm_pack_distances_##isa(const qm_pack *pack, qm_vec p, double d2[QM_PACK_LANES]);                   \
    void qm_closest_##isa(const qm_bvh *bvh, qm_vec p, qm_hit *hit);                                         \
    void qm_closest_patch_##isa(const qm_bvh *bvh, qm_vec p, uint32_t start, double error,                   \
                                qm_bilinear_hit *hit);                                                       \
    void qm_closest_ties_##isa(const qm_bvh *bvh, qm_vec p, uint32_t start, qm_ties *ties);                  \
    void qm_fill_float_##isa(qm_float_pack *pack, const double corner[3][3][QM_PACK_LANES]);                 \
    double qm_float_upper_##isa(const qm_float_pack *pack, const float *twist, qm_vec p);                    \
    void qm_float_reach_##isa(const qm_float_pack *pack, const float *twist, double allowed,                 \
                              const qm_vec *point, unsigned wanted, qm_float_bits *bits);                    \
    void qm_float_closest_##isa(const qm_bvh *bvh, qm_vec p, double enough, qm_float_hit *hit);              \
    void qm_grid_closest_##isa(const qm_grid *grid, qm_vec p, qm_hit *hit);                                  \
    void qm_grid_closest_patch_##isa(const qm_grid *grid, qm_vec p, uint32_t start, double error,            \
                                     qm_bilinear_hit *hit);                                                  \
    void qm_grid_closest_ties_##isa(const qm_grid *grid, qm_vec p, uint32_t start, qm_ties *ties);           \
    void qm_tetra_closest_##isa(const qm_tetra *tetra, qm_vec p, qm_hit *hit);                               \
    void qm_tetra_closest_patch_##isa(const qm_tetra *tetra, qm_vec p, uint32_t start, double error,         \
                                      qm_bilinear_hit *hit);                                                 \
    void qm_tetra_closest_ties_##isa(const qm_tetra *tetra, qm_vec p, uint32_t start, qm_ties *ties);        \
    size_t qm_tetra_fit_##isa(qm_tetra *tetra, size_t patch, const uint64_t *changed);                       \
    void qm_gather_##isa(const qm_bvh *bvh, const qm_box *box, double reach, qm_near_packs *near);           \
    int qm_narrow_##isa(const qm_near_packs *near, const qm_box *box, double reach, int capacity,            \
                        uint32_t *packs);                                                                    \
    uint64_t qm_in_reach_##isa(const qm_candidates *candidates, qm_vec p);                                   \
    void qm_shortlist_##isa(const qm_bvh *bvh, const qm_near_packs *near, qm_vec p, qm_shortlist *list);     \
    double qm_hull_upper_##isa(const qm_candidates *candidates, const qm_vec *point, int count, int *place); \
    void qm_shortlist_rows_##isa(const qm_bvh *bvh, const qm_shortlist *list, qm_pack *rows);                \
    void qm_shortlist_floats_##isa(const qm_bvh *bvh, const qm_shortlist *list, qm_float_pack *rows);        \
    bool qm_cover_##isa(const qm_candidates *candidates, qm_polygon *polygon, bool *moved);                  \
    qm_float_verdict qm_float_cover_##isa(const qm_float_pack *pack, const float *twist, double allowed,     \
                                          qm_polygon *polygon, bool *moved);                                 \
    unsigned qm_overlay_add_##isa(qm_overlay_facets *facets, const qm_overlay_frame *frame,                  \
                                  const qm_bvh *bvh, uint32_t pack, const float *twist,                      \
                                  qm_overlay_vertices *vertices);                                            \
    void qm_overlay_close_##isa(qm_overlay_facets *facets);                                                  \
    bool qm_overlay_is_clear_##isa(const qm_overlay_facets *facets, const qm_overlay_face *face);            \
    double qm_overlay_gap_##isa(const qm_overlay_facets *facets, const qm_overlay_face *face, double enough, \
                                uint8_t *far);                                                               \
    int qm_overlay_count_##isa(const qm_overlay_facets *facets, const qm_overlay_face *face);                \
    unsigned qm_node_distances_##isa(const qm_descent *descent, const qm_node *a, const qm_node *b,          \
                                     bool splits_a, float d2[QM_PACK_LANES]);                                \
    bool qm_descend_##isa(const qm_descent *descent, const qm_node *a, const qm_node *b);                    \
    void qm_fill_leaf_##isa(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind, uint32_t pack,   \
                            qm_leaf *leaf);                                                                  \
    void qm_add_lane_pairs_##isa(const qm_leaf *p, const qm_leaf *q, bool seeks_alike, qm_lane_pairs *pairs, \
                                 qm_near_lanes *out);                                                        \
    void qm_decide_lane_pairs_##isa(const qm_lane_pairs *pairs, unsigned first, qm_pair_verdicts *out);      \
    bool qm_compare_leaves_##isa(const qm_leaf *p, const qm_leaf *q, qm_collide_kind kind, unsigned moved_p, \
                                 unsigned moved_q, qm_near_lanes *out);                                      \
    void qm_hilbert_keys_##isa(const qm_hilbert_cells *cells, int count, int bits, uint64_t *keys);          \
    void qm_vertices_on_sides_##isa(const double *positions, size_t count, const qm_box *box,                \
                                    uint32_t vertex[QM_BOX_SIDES]);                                          \
    bool qm_faces_below_##isa(const uint32_t *faces, size_t count, uint32_t vertex_count);                   \
    bool qm_faces_name_##isa(const uint32_t *faces, size_t count, const uint32_t vertex[QM_BOX_SIDES]);      \
    void qm_vertex_box_##isa(const double *positions, size_t count, qm_box *box);                            \
    void qm_vertex_cells_##isa(const qm_cell_grid *grid, const double *positions, size_t count,              \
                               qm_cell *cells);                                                              \
    void qm_vertex_fine_##isa(const double origin[3], double scale, const double *positions, size_t count,   \
                              uint64_t *fine);                                                               \
    unsigned qm_cell_boxes_##isa(const qm_cell_grid *grid, const uint32_t *faces, const qm_cell *cells,      \
                                 qm_cell_boxes *out);                                                        \
    unsigned qm_cells_marked_##isa(const qm_cell_grid *grid, const qm_cell_marks *marks,                     \
                                   const qm_cell_boxes *boxes, unsigned *large);                             \
    void qm_keep_cells_##isa(const qm_cell_boxes *boxes, uint32_t first, unsigned faces,                     \
                             qm_cell_list *list);                                                            \
    void qm_sort_few_##isa(uint64_t *numbers, int count);                                                    \
    static const qm_kernel kernel_##isa = {                                                                  \
        .name = #isa,                                                                                        \
        .share_corners = qm_share_corners_##isa,                                                             \
        .fit_box = qm_fit_box_##isa,                                                                         \
        .fit_groups = qm_fit_groups_##isa,                                                                   \
        .load_corners = qm_load_corners_##isa,                                                               \
        .fit_corners = qm_fit_corners_##isa,                                                                 \
        .fill_pack = qm_fill_pack_##isa,                                                                     \
        .pack_distances = qm_pack_distances_##isa,                                                           \
        .closest = qm_closest_##isa,                                                                         \
        .closest_patch = qm_closest_patch_##isa,                                                             \
        .closest_ties = qm_closest_ties_##isa,                                                               \
        .fill_float = qm_fill_float_##isa,                                                                   \
        .float_upper = qm_float_upper_##isa,                                                                 \
        .float_reach = qm_float_reach_##isa,                                                                 \
        .float_closest = qm_float_closest_##isa,                                                             \
        .grid_closest = qm_grid_closest_##isa,                                                               \
        .grid_closest_patch = qm_grid_closest_patch_##isa,                                                   \
        .grid_closest_ties = qm_grid_closest_ties_##isa,                                                     \
        .tetra_closest = qm_tetra_closest_##isa,                                                             \
        .tetra_closest_patch = qm_tetra_closest_patch_##isa,                                                 \
        .tetra_closest_ties = qm_tetra_closest_ties_##isa,                                                   \
        .tetra_fit = qm_tetra_fit_##isa,                                                                     \
        .gather = qm_gather_##isa,                                                                           \
        .narrow = qm_narrow_##isa,                                                                           \
        .in_reach = qm_in_reach_##isa,                                                                       \
        .shortlist = qm_shortlist_##isa,                                                                     \
        .hull_upper = qm_hull_upper_##isa,                                                                   \
        .shortlist_rows = qm_shortlist_rows_##isa,                                                           \
        .shortlist_floats = qm_shortlist_floats_##isa,                                                       \
        .cover = qm_cover_##isa,                                                                             \
        .float_cover = qm_float_cover_##isa,                                                                 \
        .overlay_add = qm_overlay_add_##isa,                                                                 \
        .overlay_close = qm_overlay_close_##isa,                                                             \
        .overlay_is_clear = qm_overlay_is_clear_##isa,                                                       \
        .overlay_gap = qm_overlay_gap_##isa,                                                                 \
        .overlay_count = qm_overlay_count_##isa,                                                             \
        .node_distances = qm_node_distances_##isa,                                                           \
        .descend = qm_descend_##isa,                                                                         \
        .fill_leaf = qm_fill_leaf_##isa,                                                                     \
        .add_lane_pairs = qm_add_lane_pairs_##isa,                                                           \
        .decide_lane_pairs = qm_decide_lane_pairs_##isa,                                                     \
        .compare_leaves = qm_compare_leaves_##isa,                                                           \
        .hilbert_keys = qm_hilbert_keys_##isa,                                                               \
        .vertices_on_sides = qm_vertices_on_sides_##isa,                                                     \
        .faces_below = qm_faces_below_##isa,                                                                 \
        .faces_name = qm_faces_name_##isa,                                                                   \
        .vertex_box = qm_vertex_box_##isa,                                                                   \
        .vertex_fine = qm_vertex_fine_##isa,                                                                 \
        .vertex_cells = qm_vertex_cells_##isa,                                                               \
        .cell_boxes = qm_cell_boxes_##isa,                                                                   \
        .cells_marked = qm_cells_marked_##isa,                                                               \
        .keep_cells = qm_keep_cells_##isa,                                                                   \
        .sort_few = qm_sort_few_##isa,                                                                       \
    }

DECLARE(avx512);
DECLARE(avx2);
DECLARE(portable);

static const qm_kernel *const with_avx512[] = {&kernel_avx512, &kernel_avx2, &kernel_portable, NULL};
static const qm_kernel *const with_avx2[] = {&kernel_avx2, &kernel_portable, NULL};
static const qm_kernel *const with_none[] = {&kernel_portable, NULL};

const qm_kernel *const *qm_kernel_list(void)
{
    bool has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2");
    bool has_avx512 = has_avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
    return has_avx512 ? with_avx512 : has_avx2 ? with_avx2 : with_none;
}

const qm_kernel *qm_kernel_get(void)
{
    return qm_kernel_list()[0];
}

const char *qm_kernel_name(void)
{
    return qm_kernel_get()->name;
}
