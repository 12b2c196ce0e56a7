/**
 * reconstruct_warnings.c: whether a layout lies where its surface does, and what the mesh does not show by itself.
 */
#include "reconstruct_internal.h"

#include "bvh/bvh_tree.h"

#define MAX_OUTSIDE 1.0    /* diagonals by which a point of a curve may lie outside the box of the surface */
#define MAX_SIZE 3.0       /* times the surface: a larger layout is in another unit */
#define MIN_SIZE 0.1       /* times the surface: a smaller layout beside it is in another unit */
#define MIN_UNCOVERED 0.01 /* of the samples: fewer uncovered ones are outliers */
#define MIN_BEYOND                                                                                           \
    0.25 /* of a quad's edge: its middle is half of one beyond a boundary on which its corners lie */

/** The box of all points of the curves. */
static qm_box layout_box(const qm_layout *layout)
{
    qm_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t c = 0; c < layout->curve_count; c++)
        for (size_t i = 0; i < 3 * layout->curves[c].point_count; i++) {
            box.min[i % 3] = fmin(box.min[i % 3], layout->curves[c].points[i]);
            box.max[i % 3] = fmax(box.max[i % 3], layout->curves[c].points[i]);
        }
    return box;
}

/** The distance of a point from a box. */
static double box_distance(const qm_box *box, const double p[3])
{
    double away[3];
    for (int k = 0; k < 3; k++)
        away[k] = fmax(0.0, fmax(box->min[k] - p[k], p[k] - box->max[k]));
    return hypot(hypot(away[0], away[1]), away[2]);
}

/** True if most points of the curves are farther from the surface than a distance. */
static bool is_far(const qm_ref_surface *surface, const qm_layout *layout, double distance)
{
    size_t far = 0, count = 0;
    for (size_t c = 0; c < layout->curve_count; c++) {
        for (size_t i = 0; i < layout->curves[c].point_count; i++, count++) {
            qm_ref_surface_point projection;
            qm_ref_surface_project(surface, layout->curves[c].points + 3 * i, &projection);
            far += projection.distance > distance;
        }
    }
    return 2 * far > count;
}

qm_status qm_reconstruction_check_place(qm_context *ctx, const qm_ref_surface *surface,
                                        const qm_layout *layout, double cover_distance)
{
    qm_box box = qm_mesh_bounding_box(&surface->bvh->mesh), drawn = layout_box(layout);
    double size = qm_mesh_box_diagonal(&drawn) / surface->diagonal;
    if (!isfinite(size)) return QM_OK; /* qm_layout_validate names the point */
    size_t outside = 0, count = 0;
    const double *farthest = NULL;
    uint32_t curve = 0;
    double most = 0.0;
    for (size_t c = 0; c < layout->curve_count; c++) {
        for (size_t i = 0; i < layout->curves[c].point_count; i++, count++) {
            const double *p = layout->curves[c].points + 3 * i;
            double away = box_distance(&box, p) / surface->diagonal;
            outside += away > MAX_OUTSIDE;
            if (away <= most) continue;
            most = away;
            farthest = p;
            curve = layout->curves[c].id;
        }
    }
    if (size > MAX_SIZE && 2 * outside > count)
        return qm_context_fail(ctx, QM_E_LAYOUT,
                               "the layout is %.3g times as large as the surface: is it in another unit?",
                               size);
    if (most > MAX_OUTSIDE)
        return qm_context_fail(
            ctx, QM_E_LAYOUT,
            "curve %u has a point at %g %g %g, %.3g diagonals of the surface outside its box", curve,
            farthest[0], farthest[1], farthest[2], most);
    if (size < MIN_SIZE && is_far(surface, layout, cover_distance))
        return qm_context_fail(
            ctx, QM_E_LAYOUT,
            "the layout is %.3g times as large as the surface, and not on it: is it in another unit?", size);
    return QM_OK;
}

/** The number of patches that a curve is a side of, and whether two of them run along it the same way. */
static int count_owners(const qm_reconstruction *r, size_t curve, bool *is_same_way)
{
    int owners = 0;
    bool against = false;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        for (int k = 0; k < 4; k++) {
            if (r->layout.patches[p].side[k] != curve) continue;
            *is_same_way |= owners > 0 && against == r->layout.patches[p].against[k];
            against = r->layout.patches[p].against[k];
            owners++;
        }
    return owners;
}

/** Six times the volume that the lattices enclose. */
static double enclosed_volume(const qm_reconstruction *r)
{
    double sum = 0.0;
    qm_vec origin = qm_lattice_at(&r->lattices[0], 0, 0);
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const qm_lattice *lattice = &r->lattices[p];
        for (uint32_t j = 0; j < lattice->rows; j++)
            for (uint32_t i = 0; i < lattice->columns; i++) {
                qm_vec a = qm_vec_sub(qm_lattice_at(lattice, i, j), origin);
                qm_vec b = qm_vec_sub(qm_lattice_at(lattice, i + 1, j), origin);
                qm_vec c = qm_vec_sub(qm_lattice_at(lattice, i + 1, j + 1), origin);
                qm_vec d = qm_vec_sub(qm_lattice_at(lattice, i, j + 1), origin);
                sum += qm_vec_dot(a, qm_vec_add(qm_vec_cross(b, c), qm_vec_cross(c, d)));
            }
    }
    return sum;
}

/** The share of the inner vertices that lie in holes of a point set, but those of patches that span one as a whole. */
static double share_in_holes(const qm_reconstruction *r)
{
    size_t count = 0, in_holes = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const qm_lattice *lattice = &r->lattices[p];
        size_t vertices = qm_lattice_vertex_count(lattice);
        count += vertices;
        for (size_t k = 0; k < vertices && !lattice->spans_hole; k++)
            in_holes += qm_cloud_is_in_gap(r->surface.bvh, lattice->vertices + 3 * k);
    }
    return (double)in_holes / (double)count;
}

/** True if the middle of a quad lies beyond the boundary of a mesh. usual: an edge of its patch; a sliver at the rim tells nothing. */
static bool is_beyond_boundary(const qm_ref_surface *mesh, const qm_vec corner[4], double usual)
{
    double edge = usual, middle[3];
    for (int k = 0; k < 4; k++)
        edge = fmax(edge, qm_vec_distance(corner[k], corner[(k + 1) % 4]));
    qm_vec_store(middle, qm_vec_mix(qm_vec_mix(corner[0], corner[2], 0.5),
                                    qm_vec_mix(corner[1], corner[3], 0.5), 0.5));
    qm_ref_surface_point foot;
    qm_ref_surface_project(mesh, middle, &foot);
    return foot.distance > MIN_BEYOND * edge && qm_ref_surface_ends_at(mesh, middle);
}

/** The share of the area that lies in holes of a mesh or beyond its boundary, but that of patches that span a hole as a whole. */
static double share_beyond_boundary(const qm_reconstruction *r)
{
    double total = 0.0, beyond = 0.0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const qm_lattice *lattice = &r->lattices[p];
        double usual = qm_lattice_mean_edge(lattice);
        total += usual * usual * lattice->columns * lattice->rows;
        for (uint32_t j = 0; j < lattice->rows && !lattice->spans_hole; j++)
            for (uint32_t i = 0; i < lattice->columns; i++) {
                qm_vec corner[4];
                qm_lattice_quad(lattice, i, j, corner);
                if (is_beyond_boundary(&r->surface, corner, usual))
                    beyond += qm_lattice_quad_area(lattice, i, j);
            }
    }
    return total > 0.0 ? beyond / total : 0.0;
}

/** What of the surface is not as it was given: noise, outliers, normals, holes. Adds to the count of warnings. */
static size_t find_surface_warnings(const qm_reconstruction *r, qm_reconstruction_warning *out,
                                    size_t capacity, size_t count)
{
    double in_holes = r->surface.is_cloud ? share_in_holes(r) : share_beyond_boundary(r);
    const qm_reconstruction_warning found[] = {
        {.kind = QM_RECONSTRUCTION_NOISE, .share = qm_reconstruction_noise(r) / r->given.diagonal},
        {.kind = QM_RECONSTRUCTION_OUTLIERS, .share = r->outlier_share},
        {.kind = QM_RECONSTRUCTION_NORMALS, .share = r->given.is_cloud && !r->has_sides ? 1.0 : 0.0},
        {.kind = QM_RECONSTRUCTION_FILLS_HOLE, .share = in_holes}};
    for (size_t i = 0; i < sizeof found / sizeof *found; i++)
        if (found[i].share > 0.0 && count++ < capacity) out[count - 1] = found[i];
    return count;
}

size_t qm_reconstruction_find_warnings(const qm_reconstruction *r, qm_reconstruction_warning *out,
                                       size_t capacity)
{
    QM_ASSERT(r && (out || capacity == 0));
    size_t count = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        if (!r->lattices[p].spans_hole) continue;
        if (count < capacity)
            out[count] = (qm_reconstruction_warning){.kind = QM_RECONSTRUCTION_SPANS_HOLE, .patch = p};
        count++;
    }
    double uncovered = (double)r->uncovered_count / (double)r->point_count;
    if (uncovered > MIN_UNCOVERED && count++ < capacity)
        out[count - 1] = (qm_reconstruction_warning){.kind = QM_RECONSTRUCTION_UNCOVERED, .share = uncovered};
    bool is_one_sided = false, is_closed = true;
    for (size_t c = 0; c < r->layout.curve_count; c++) {
        int owners = count_owners(r, c, &is_one_sided);
        is_closed &= owners == 0 || owners == 2;
    }
    if (is_one_sided && count++ < capacity)
        out[count - 1] = (qm_reconstruction_warning){.kind = QM_RECONSTRUCTION_ONE_SIDED};
    if (is_closed && !is_one_sided && enclosed_volume(r) < 0.0 && count++ < capacity)
        out[count - 1] = (qm_reconstruction_warning){.kind = QM_RECONSTRUCTION_INSIDE_OUT};
    return find_surface_warnings(r, out, capacity, count);
}
