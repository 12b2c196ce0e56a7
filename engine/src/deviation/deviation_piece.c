#include "deviation_piece.h"

#include "core/rounding.h"
#include "deviation_bound.h"
#include "deviation_cut.h"

#define PIECE_ROUNDINGS 128.0 /* of the greatest coordinate, besides those of a distance: see the header */
#define LEAST_SPREAD 0x1p-40  /* flat_spread until a refinement sets it */
#define HALVED_LEVELS 4       /* on the last of so many levels each piece is halved */

/** The greatest local coordinate that a search can meet. */
static double find_reach(const qm_bvh *a, const qm_bvh *b)
{
    qm_box box = qm_mesh_bounding_box(&a->mesh);
    qm_vec low = qm_frame_local(&b->frame, box.min), high = qm_frame_local(&b->frame, box.max);
    double reach = b->reach;
    const double ends[6] = {low.x, low.y, low.z, high.x, high.y, high.z};
    for (int i = 0; i < 6; i++)
        reach = fmax(reach, fabs(ends[i]));
    return reach;
}

qm_status qm_piece_maker_init(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, qm_quad_reading reading,
                              qm_piece_maker *maker)
{
    bool bilinear = reading == QM_QUADS_BILINEAR;
    double reach = find_reach(a, b), factor = a->frame.inverse_scale * b->frame.scale;
    if (!(reach <= QM_MAX_SCALE_RATIO && factor >= 1.0 / QM_MAX_SCALE_RATIO))
        return qm_context_fail(ctx, QM_E_SCALE, "the meshes' sizes or places differ by more than 2^300");
    if (!qm_bvh_is_target(b, reading))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the tree of B was built without what this takes");
    double eta = (QM_POINT_ROUNDINGS + PIECE_ROUNDINGS) * QM_UNIT_ROUNDING * reach;
    int exponent;
    frexp(fmax(1.0, reach), &exponent);
    *maker = (qm_piece_maker){.source = a,
                              .target = b,
                              .kernel = qm_kernel_get(),
                              .source_patches = bilinear && a->has_quads,
                              .target_patches = bilinear && qm_bvh_has_twists(b),
                              .reach = reach,
                              .eta = eta,
                              .area_unit = ldexp(1.0, -2 * exponent),
                              .patch_error = 4.0 * eta,
                              .stray_error = 4.0 * eta,
                              .bend_error = 4.0 * eta,
                              .flat_error = 4.0 * eta,
                              .flat_spread = LEAST_SPREAD,
                              .worth = 4.0 * eta,
                              .part_limit = QM_PIECE_PARTS};
    return QM_OK;
}

qm_source_piece qm_piece_first(const qm_piece_maker *maker, uint32_t face, bool second)
{
    bool is_flat = qm_piece_face_is_flat(maker, face);
    qm_source_piece piece = {.face = face, .second = second && is_flat, .is_flat = is_flat};
    if (is_flat)
        piece.u[1] = piece.v[2] = 1.0;
    else if (!second)
        piece.u[1] = piece.u[2] = piece.v[2] = 1.0;
    else
        piece.u[1] = piece.v[1] = piece.v[2] = 1.0;
    return piece;
}

double qm_piece_area_rounding(const qm_piece_maker *maker, const qm_source_piece *piece)
{
    qm_piece_face face = qm_piece_face_load(maker, piece);
    return qm_piece_shape_make(maker, &face, piece).rounding;
}

void qm_piece_bound(const qm_piece_maker *maker, const qm_source_piece *piece, qm_piece_desk *desk,
                    qm_piece_bounds *out)
{
    qm_piece_face face = qm_piece_face_load(maker, piece);
    qm_piece_shape shape = qm_piece_shape_make(maker, &face, piece);
    qm_piece_list_near(maker, &shape, desk);
    qm_piece_bound_near(maker, &face, piece, &shape, desk, out);
}

/** True when the listed facets have borders to cut a piece along: those of patches that bend much come from
 * cutting and have none. */
static bool has_borders(const qm_near_facets *near)
{
    for (int i = 0; i < near->rectangle_count; i++)
        if (!near->rectangle[i].is_mild) return false;
    return true;
}

int qm_piece_split(const qm_piece_maker *maker, const qm_source_piece *piece, qm_piece_desk *desk,
                   qm_source_piece part[QM_PIECE_PARTS], qm_piece_bounds bounds[QM_PIECE_PARTS], double *leak)
{
    qm_piece_face face = qm_piece_face_load(maker, piece);
    qm_piece_shape shape = qm_piece_shape_make(maker, &face, piece);
    qm_piece_list_near(maker, &shape, desk);
    bool is_complete = desk->near.is_complete;
    int count = 1;
    *leak = 0.0;
    if (is_complete && has_borders(&desk->near) && piece->depth % HALVED_LEVELS != HALVED_LEVELS - 1)
        count = qm_piece_cut_by_facets(maker, &face, piece, &desk->near, part, leak);
    if (count == 1) {
        qm_piece_halve(&shape, piece, part, leak);
        count = 2;
    }
    *leak *= qm_piece_face_density(maker, &face);
    for (int i = 0; i < count; i++) {
        qm_piece_shape here = qm_piece_shape_make(maker, &face, &part[i]);
        if (!is_complete) qm_piece_list_near(maker, &here, desk);
        qm_piece_bound_near(maker, &face, &part[i], &here, desk, &bounds[i]);
    }
    return count;
}

qm_piece_bounds qm_piece_bound_point(const qm_piece_maker *maker, const double position[3], double distance)
{
    double certain = distance;
    if (maker->target_patches) {
        qm_piece_desk desk;
        desk.hint = 0;
        desk.searches = 0;
        qm_piece_search(maker, &desk, qm_frame_local(&maker->target->frame, position), &certain);
    }
    double low = certain - maker->eta, high = distance + maker->eta, sure = fmax(0.0, low);
    return (qm_piece_bounds){
        .low = {low, low, low},
        .high = {high, high, high},
        .area_low = 1.0,
        .area_high = 1.0,
        .density_low = 1.0,
        .density_high = 1.0,
        .mean_low = sure,
        .mean_high = high,
        .square_low = sure * sure,
        .square_high = high * high,
        .blur = high - sure,
    };
}
