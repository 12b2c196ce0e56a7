/**
 * deviation_piece.c: what the bounds of all pieces share; the shape of a piece: its corners, its distance
 * from its flat triangle, and the density of its area; and how a piece is bounded and split.
 */
#include "deviation_piece.h"
#include "deviation_integral.h"

#include "bvh/bvh_demand.h"
#include "bvh/nearest.h"
#include "bvh/surface.h"
#include "core/rounding.h"
#include "prim/bilinear.h"

#define FOOT_ERROR 1e-13      /* local: of a witness's foot */
#define PIECE_ROUNDINGS 128.0 /* of the greatest coordinate, besides those of a distance: see the header */
#define MIN_SPREAD 0x1p-40    /* flat_spread until a refinement sets it */
#define HALVED_LEVELS 4 /* every fourth level halves each piece, so that it becomes small in all directions */

/**
 * A vector along a face is off by at most 40 u S, S the greatest local coordinate. An edge: both corners by u
 * S each as they enter the frame, the difference by 2 u S, in each of three coordinates: 7 u S. Q_s = e1 + t
 * w: corners give 2 + 4 u S, e1 2 u S, w = (c0 - c1) + (c2 - c3) 2 + 2 + 4 u S, t w 4 u S, the sum 2 u S,
 * each coordinate: 22 sqrt(3) u S = 38 u S. A cross product adds 6 u, its length 3 u of the product of
 * lengths.
 */
#define CROSS_ROUNDINGS 40.0

/** Of a determinant of parameters: each of four differences by u, both products and their difference. */
#define PARAMETER_ROUNDINGS 4.0

#define WIDE 4.0        /* of what a cut is worth: halves with wider bounds are halved again */
#define POOR_WIDTH 0.25 /* of the radius: bounds of a small piece are far narrower */

#define OUTSIDE 0x1p-20 /* relative: corners of pieces may lie outside of the face by far less */

/** Bounds the rounding error of a cross product of two edges. */
static double cross_error(const qm_deviation_setup *setup, qm_vec a, qm_vec b)
{
    double la = qm_vec_norm(a), lb = qm_vec_norm(b);
    return CROSS_ROUNDINGS * QM_UNIT_ROUNDING * (la * lb + setup->extent * (la + lb));
}

/* ---- faces ---- */

/** How much the triangles of a patch differ from it, for the common normal of the diagonals: g, and 2 k, in
 * which the factor covers rounding. INFINITY where rounding leaves open whether the view is convex. */
static void compare_triangles(const qm_deviation_setup *setup, const qm_vec c[4], double *slack,
                              double *spread)
{
    *slack = *spread = INFINITY;
    qm_vec normal = qm_vec_cross(qm_vec_sub(c[2], c[0]), qm_vec_sub(c[3], c[1]));
    double length = qm_vec_norm(normal), min = INFINITY, longest = 0.0;
    if (!(length > QM_MIN_LENGTH)) return;
    normal = qm_vec_scale(1.0 / length, normal);
    for (int i = 0; i < 4; i++) {
        qm_vec on = qm_vec_sub(c[(i + 1) % 4], c[i]), after = qm_vec_sub(c[(i + 2) % 4], c[(i + 1) % 4]);
        double turn = qm_vec_dot(normal, qm_vec_cross(on, after)) - 2.0 * cross_error(setup, on, after);
        min = fmin(min, turn);
        longest = fmax(longest, qm_vec_norm(on));
    }
    if (!(min > 0.0)) return;
    *slack = qm_bilinear_hull_width(c, normal);
    double aside = 2.0 * *slack * longest / min;
    *spread = aside * aside;
}

/** Loads the corners of a face; false for a triangle, which has three. */
static bool load_corners(const qm_deviation_setup *setup, uint32_t face, qm_vec corner[4])
{
    const qm_mesh *mesh = &setup->source->mesh;
    const uint32_t *index = mesh->faces + 4 * (size_t)face;
    bool is_quad = index[3] != QM_NO_INDEX;
    for (int i = 0; i < (is_quad ? 4 : 3); i++)
        corner[i] = qm_frame_local(&setup->target->frame, mesh->positions + 3 * (size_t)index[i]);
    return is_quad;
}

/** True when the parameters of a patch bound its distance from a target nearby better than its triangles,
 * whose points are up to |w| / 4 beside those of the patch: over a patch that is twisted against them,
 * heights differ there by more than base_margin. Farther away than that they
 * change sign nowhere, and differ less. */
static bool is_over_twist(const qm_deviation_setup *setup, const qm_vec corner[4])
{
    qm_bilinear patch = qm_bilinear_make(corner);
    double size = qm_min(qm_vec_norm(patch.e1), qm_vec_norm(patch.e2)), w = qm_vec_norm(patch.w);
    if (!setup->target_patches || !(w > setup->base_margin)) return false;
    qm_hit hit = {.d2 = INFINITY, .pack = 0};
    setup->kernel->closest(setup->target, qm_bilinear_at(&patch, 0.5, 0.5), &hit);
    double twist = (double)qm_bvh_twists(setup->target, hit.pack)[hit.lane];
    return twist * w > setup->base_margin * size && 16.0 * hit.d2 < w * w;
}

bool qm_deviation_face_is_flat(const qm_deviation_setup *setup, uint32_t face)
{
    qm_vec corner[4];
    double slack, spread;
    if (!setup->source_patches || !load_corners(setup, face, corner)) return true;
    compare_triangles(setup, corner, &slack, &spread);
    return slack <= setup->flat_error && spread <= setup->flat_spread && !is_over_twist(setup, corner);
}

qm_deviation_face qm_deviation_face_load(const qm_deviation_setup *setup, const qm_deviation_piece *piece)
{
    qm_deviation_face face = {.is_patch = !piece->is_flat};
    bool is_quad = load_corners(setup, piece->face, face.corner);
    if (face.is_patch) face.patch = qm_bilinear_make(face.corner);
    if (face.is_patch || !is_quad) return face;
    if (setup->source_patches) compare_triangles(setup, face.corner, &face.slack, &face.spread);
    if (piece->second) {
        face.corner[1] = face.corner[2];
        face.corner[2] = face.corner[3];
    }
    return face;
}

/* ---- pieces ---- */

static qm_vec flat_point(const qm_vec corner[3], double u, double v)
{
    return qm_vec_axpy(qm_vec_axpy(qm_vec_scale(1.0 - u - v, corner[0]), u, corner[1]), v, corner[2]);
}

qm_vec qm_deviation_face_at(const qm_deviation_face *face, double u, double v)
{
    return face->is_patch ? qm_bilinear_at(&face->patch, u, v) : flat_point(face->corner, u, v);
}

void qm_deviation_piece_coefficients(const qm_deviation_face *face, const qm_deviation_piece *piece,
                                     qm_vec at[6])
{
    for (int k = 0; k < 6; k++) {
        int i = k % 3, j = k < 3 ? i : (i + 1) % 3;
        const double a[2] = {piece->u[i], piece->v[i]}, b[2] = {piece->u[j], piece->v[j]};
        at[k] = face->is_patch ? qm_bilinear_polar(&face->patch, a, b)
                               : flat_point(face->corner, 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]));
    }
}

double qm_deviation_parameter_area2(const qm_deviation_piece *piece, double *error)
{
    double du1 = piece->u[1] - piece->u[0], dv1 = piece->v[1] - piece->v[0];
    double du2 = piece->u[2] - piece->u[0], dv2 = piece->v[2] - piece->v[0];
    *error = PARAMETER_ROUNDINGS * QM_UNIT_ROUNDING * (fabs(du1 * dv2) + fabs(du2 * dv1));
    return du1 * dv2 - du2 * dv1;
}

/** Areas that the piece would have at densities of its face, from below and above. */
static void set_spread(qm_deviation_shape *shape, const qm_deviation_setup *setup,
                       const qm_deviation_piece *piece, const double low[3], const double high[3],
                       double rounding)
{
    double error, doubled = fabs(qm_deviation_parameter_area2(piece, &error));
    double min = 0.5 * setup->area_unit * fmax(0.0, doubled - error);
    double max = 0.5 * setup->area_unit * (doubled + error);
    for (int i = 0; i < 3; i++) {
        shape->low[i] = min * low[i];
        shape->high[i] = max * high[i];
    }
    shape->rounding = max * rounding;
}

static double spread(const double x[3])
{
    return fmax(x[0], fmax(x[1], x[2])) - fmin(x[0], fmin(x[1], x[2]));
}

static void spread_flat(qm_deviation_shape *shape, const qm_deviation_setup *setup,
                        const qm_deviation_face *face, const qm_deviation_piece *piece)
{
    const qm_vec *corner = face->corner;
    qm_vec a = qm_vec_sub(corner[1], corner[0]), b = qm_vec_sub(corner[2], corner[0]);
    double doubled = qm_vec_norm(qm_vec_cross(a, b)), error = cross_error(setup, a, b);
    double max_factor = 1.0 + face->spread;
    double min = fmax(0.0, doubled - error) / max_factor, max = (doubled + error) * max_factor;
    set_spread(shape, setup, piece, (const double[]){min, min, min}, (const double[]){max, max, max}, error);
    shape->slack = face->slack;
    shape->is_uniform = true;
}

/** Q_s x Q_t = e1 x e2 + s e1 x w + t w x e2 is linear in s and t: its length is convex. */
static qm_vec patch_normal(const qm_deviation_setup *setup, const qm_bilinear *patch, double s, double t,
                           double *error)
{
    qm_vec along_s = qm_vec_axpy(patch->e1, t, patch->w), along_t = qm_vec_axpy(patch->e2, s, patch->w);
    *error = cross_error(setup, along_s, along_t);
    return qm_vec_cross(along_s, along_t);
}

static void spread_patch(qm_deviation_shape *shape, const qm_deviation_setup *setup,
                         const qm_deviation_face *face, const qm_deviation_piece *piece)
{
    const qm_bilinear *patch = &face->patch;
    qm_vec normal[3], sum = {0, 0, 0};
    double low[3], high[3], error = 0.0;
    for (int i = 0; i < 3; i++) {
        double here;
        normal[i] = patch_normal(setup, patch, piece->u[i], piece->v[i], &here);
        sum = qm_vec_add(sum, normal[i]);
        error = fmax(error, here);
    }
    double length = qm_vec_norm(sum);
    qm_vec unit = length > 0.0 ? qm_vec_scale(1.0 / length, sum) : (qm_vec){0, 0, 0};
    for (int i = 0; i < 3; i++) {
        low[i] = qm_vec_dot(unit, normal[i]) - error;
        high[i] = qm_vec_norm(normal[i]) + error;
    }
    /* Clamped values are no linear function below the length any more. */
    if (low[0] <= 0.0 || low[1] <= 0.0 || low[2] <= 0.0) low[0] = low[1] = low[2] = 0.0;
    set_spread(shape, setup, piece, low, high, error);
    shape->slack = 0.25 * qm_vec_norm(patch->w) * spread(piece->u) * spread(piece->v);
    shape->is_uniform = qm_vec_norm2(patch->w) == 0.0;
}

double qm_deviation_face_density(const qm_deviation_setup *setup, const qm_deviation_face *face)
{
    double max = 0.0;
    if (!face->is_patch) {
        qm_vec a = qm_vec_sub(face->corner[1], face->corner[0]);
        qm_vec b = qm_vec_sub(face->corner[2], face->corner[0]);
        max = qm_vec_norm(qm_vec_cross(a, b)) + cross_error(setup, a, b);
    }
    for (int i = 0; i < 4 && face->is_patch; i++) {
        double error;
        qm_vec normal = patch_normal(setup, &face->patch, i & 1 ? 1.0 : 0.0, i & 2 ? 1.0 : 0.0, &error);
        max = fmax(max, qm_vec_norm(normal) + error);
    }
    return setup->area_unit * max * (1.0 + face->spread) * (1.0 + OUTSIDE);
}

qm_deviation_shape qm_deviation_shape_make(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                           const qm_deviation_piece *piece)
{
    qm_deviation_shape shape = {.radius = 0.0};
    for (int i = 0; i < 3; i++)
        shape.corner[i] = qm_deviation_face_at(face, piece->u[i], piece->v[i]);
    if (face->is_patch)
        spread_patch(&shape, setup, face, piece);
    else
        spread_flat(&shape, setup, face, piece);
    qm_vec sum = qm_vec_add(qm_vec_add(shape.corner[0], shape.corner[1]), shape.corner[2]);
    shape.centroid = qm_vec_scale(1.0 / 3.0, sum);
    for (int i = 0; i < 3; i++) {
        shape.radius = fmax(shape.radius, qm_vec_distance(shape.corner[i], shape.centroid));
        shape.longest2 =
            fmax(shape.longest2, qm_vec_norm2(qm_vec_sub(shape.corner[i], shape.corner[(i + 1) % 3])));
    }
    return shape;
}

/* ---- the calls ---- */

/** A bound of the local coordinates that a search can meet: those of either surface. */
static double find_extent(const qm_bvh *a, const qm_bvh *b)
{
    qm_vec shift = qm_vec_scale(b->frame.scale, qm_vec_sub(a->frame.origin, b->frame.origin));
    double offset = fmax(fabs(shift.x), fmax(fabs(shift.y), fabs(shift.z)));
    return fmax(b->reach, offset + a->frame.inverse_scale * b->frame.scale * a->reach);
}

qm_status qm_deviation_setup_init(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, qm_quad_reading reading,
                                  qm_deviation_setup *setup)
{
    QM_ASSERT(ctx && a && b && setup);
    bool bilinear = reading == QM_QUADS_BILINEAR;
    double extent = find_extent(a, b), factor = a->frame.inverse_scale * b->frame.scale;
    if (!(extent <= QM_MAX_SCALE_RATIO && factor >= 1.0 / QM_MAX_SCALE_RATIO))
        return qm_context_fail(ctx, QM_E_SCALE,
                               "the sizes or positions of the meshes differ by more than 2^300");
    if (!qm_bvh_is_target(b, reading))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the tree of B was built without the data of a target");
    double eta = (QM_POINT_ROUNDINGS + PIECE_ROUNDINGS) * QM_UNIT_ROUNDING * extent;
    int exponent;
    frexp(fmax(1.0, extent), &exponent);
    *setup = (qm_deviation_setup){.source = a,
                                  .target = b,
                                  .kernel = qm_kernel_get(),
                                  .source_patches = bilinear && a->has_quads,
                                  .target_patches = bilinear && qm_bvh_has_twists(b),
                                  .extent = extent,
                                  .eta = eta,
                                  .area_unit = ldexp(1.0, -2 * exponent),
                                  .patch_error = 4.0 * eta,
                                  .base_margin = 4.0 * eta,
                                  .bend_error = 4.0 * eta,
                                  .flat_error = 4.0 * eta,
                                  .flat_spread = MIN_SPREAD,
                                  .worth = 4.0 * eta,
                                  .part_limit = QM_DEVIATION_PARTS};
    return QM_OK;
}

qm_deviation_piece qm_deviation_piece_first(const qm_deviation_setup *setup, uint32_t face, bool second)
{
    bool is_flat = qm_deviation_face_is_flat(setup, face);
    qm_deviation_piece piece = {.face = face, .second = second && is_flat, .is_flat = is_flat};
    if (is_flat)
        piece.u[1] = piece.v[2] = 1.0;
    else if (!second)
        piece.u[1] = piece.u[2] = piece.v[2] = 1.0;
    else
        piece.u[1] = piece.v[1] = piece.v[2] = 1.0;
    return piece;
}

void qm_deviation_piece_parameters(const qm_deviation_setup *setup, const qm_deviation_piece *piece, double u,
                                   double v, double uv[2])
{
    bool is_quad = setup->source->mesh.faces[4 * (size_t)piece->face + 3] != QM_NO_INDEX;
    bool is_half = is_quad && piece->is_flat;
    uv[0] = qm_clamp(is_half && !piece->second ? u + v : u, 0.0, 1.0);
    uv[1] = qm_clamp(is_half && piece->second ? u + v : v, 0.0, 1.0);
}

qm_vec qm_deviation_piece_point(const qm_deviation_setup *setup, const qm_deviation_piece *piece, double u,
                                double v, qm_surface_point *out)
{
    qm_deviation_face face = qm_deviation_face_load(setup, piece);
    qm_vec p = qm_deviation_face_at(&face, u, v);
    out->face = piece->face;
    qm_deviation_piece_parameters(setup, piece, u, v, out->uv);
    qm_vec_store(out->position, qm_frame_world(&setup->target->frame, p));
    return p;
}

qm_surface_point qm_deviation_foot(const qm_deviation_setup *setup, qm_quad_reading quads, qm_vec p)
{
    uint32_t hint = 0;
    const qm_locator locator = {.bvh = setup->target};
    qm_tie tie = qm_nearest_face(setup->kernel, &locator, quads, p, &hint);
    return qm_surface_face_foot(setup->target, quads, tie.face, p, FOOT_ERROR);
}

double qm_deviation_piece_area_rounding(const qm_deviation_setup *setup, const qm_deviation_piece *piece)
{
    qm_deviation_face face = qm_deviation_face_load(setup, piece);
    return qm_deviation_shape_make(setup, &face, piece).rounding;
}

void qm_deviation_piece_bound(const qm_deviation_setup *setup, const qm_deviation_piece *piece,
                              qm_deviation_workspace *workspace, qm_deviation_bounds *out)
{
    qm_deviation_face face = qm_deviation_face_load(setup, piece);
    qm_deviation_shape shape = qm_deviation_shape_make(setup, &face, piece);
    qm_deviation_list_facets(setup, &shape, false, workspace);
    qm_deviation_piece_bound_near(setup, &face, piece, &shape, workspace, out);
}

/** True when the listed facets have borders to cut a piece along: those of patches that bend much come from
 * cutting and have none. */
static bool has_borders(const qm_deviation_facets *near)
{
    for (int i = 0; i < near->rectangle_count; i++)
        if (!near->rectangle[i].is_mild) return false;
    return true;
}

/** Bounds parts again for which the matches with mild rectangles are poor, beside an edge or a tip of a patch, by a
 * list on which these are cut as well. */
static void bound_by_cut_patches(const qm_deviation_setup *setup, const qm_deviation_face *face, int count,
                                 const qm_deviation_piece part[QM_DEVIATION_PARTS],
                                 qm_deviation_workspace *workspace,
                                 qm_deviation_bounds bounds[QM_DEVIATION_PARTS])
{
    for (int i = 0; i < count; i++) {
        qm_deviation_bounds by_cut;
        qm_deviation_shape here = qm_deviation_shape_make(setup, face, &part[i]);
        double width = bounds[i].mean_high - bounds[i].mean_low;
        if (!(width > POOR_WIDTH * here.radius * bounds[i].area_high)) continue;
        qm_deviation_list_facets(setup, &here, true, workspace);
        qm_deviation_piece_bound_near(setup, face, &part[i], &here, workspace, &by_cut);
        qm_deviation_bounds_combine(&bounds[i], &by_cut);
    }
}

/** Bounds a part of a piece, by the list of the piece or, without one that is complete, by its own. */
static void bound_part(const qm_deviation_setup *setup, const qm_deviation_face *face,
                       const qm_deviation_piece *part, bool has_list, qm_deviation_workspace *workspace,
                       qm_deviation_bounds *bounds)
{
    qm_deviation_shape here = qm_deviation_shape_make(setup, face, part);
    if (!has_list) qm_deviation_list_facets(setup, &here, false, workspace);
    qm_deviation_piece_bound_near(setup, face, part, &here, workspace, bounds);
}

/** Halves both halves of a piece once more where their bounds are far too wide: the list, which costs most where
 * patches bend, serves for all of them. Returns how many parts there are; adds to *leak. */
static int halve_wide_parts(const qm_deviation_setup *setup, const qm_deviation_face *face,
                            qm_deviation_piece part[QM_DEVIATION_PARTS], qm_deviation_workspace *workspace,
                            qm_deviation_bounds bounds[QM_DEVIATION_PARTS], double *leak)
{
    int count = 2;
    for (int i = 0; i < 2; i++) {
        double width = bounds[i].mean_high - bounds[i].mean_low;
        if (part[i].depth == QM_DEVIATION_DEPTH || !(width > WIDE * setup->worth * bounds[i].area_high))
            continue;
        qm_deviation_shape whole = qm_deviation_shape_make(setup, face, &part[i]);
        qm_deviation_piece half[2];
        qm_deviation_piece_halve(&whole, &part[i], half, leak);
        part[i] = half[0];
        part[count] = half[1];
        bound_part(setup, face, &part[i], true, workspace, &bounds[i]);
        bound_part(setup, face, &part[count], true, workspace, &bounds[count]);
        count++;
    }
    return count;
}

int qm_deviation_piece_split(const qm_deviation_setup *setup, const qm_deviation_piece *piece,
                             qm_deviation_workspace *workspace, qm_deviation_piece part[QM_DEVIATION_PARTS],
                             qm_deviation_bounds bounds[QM_DEVIATION_PARTS], double *leak)
{
    qm_deviation_face face = qm_deviation_face_load(setup, piece);
    qm_deviation_shape shape = qm_deviation_shape_make(setup, &face, piece);
    qm_deviation_list_facets(setup, &shape, false, workspace);
    QM_ASSERT(piece->depth < QM_DEVIATION_DEPTH);
    bool is_complete = workspace->near.is_complete, has_cuts = has_borders(&workspace->near);
    int count = 1;
    *leak = 0.0;
    if (is_complete && has_cuts && piece->depth % HALVED_LEVELS != HALVED_LEVELS - 1)
        count = qm_deviation_piece_cut(setup, &face, piece, &workspace->near, part, leak);
    if (count == 1) {
        qm_deviation_piece_halve(&shape, piece, part, leak);
        count = 2;
    }
    for (int i = 0; i < count; i++)
        bound_part(setup, &face, &part[i], is_complete, workspace, &bounds[i]);
    if (is_complete && !has_cuts && setup->part_limit >= 4)
        count = halve_wide_parts(setup, &face, part, workspace, bounds, leak);
    QM_ASSERT(count >= 2 && count <= QM_DEVIATION_PARTS);
    *leak *= qm_deviation_face_density(setup, &face);
    if (setup->target_patches) bound_by_cut_patches(setup, &face, count, part, workspace, bounds);
    return count;
}

qm_deviation_bounds qm_deviation_point_bound(const qm_deviation_setup *setup, const double position[3],
                                             double distance)
{
    double certain = distance;
    if (setup->target_patches) {
        qm_deviation_workspace workspace;
        workspace.hint = 0;
        workspace.searches = 0;
        qm_deviation_search(setup, &workspace, qm_frame_local(&setup->target->frame, position), &certain);
    }
    double low = certain - setup->eta, high = distance + setup->eta, sure = fmax(0.0, low);
    return (qm_deviation_bounds){
        .low = {low, low, low},
        .high = {high, high, high},
        .least = sure,
        .most = high,
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
