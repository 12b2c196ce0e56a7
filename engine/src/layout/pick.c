#include "qm/pick.h"

#include <string.h>

#include "bvh/bvh_tree.h"
#include "pick_work.h"

#define DISC_RADII 5.0 /* of the drawn discs: how far candidates reach by default */

/** c = a b, both row by row. */
static void multiply(const double a[16], const double b[16], double c[16])
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            c[4 * i + j] = 0.0;
            for (int k = 0; k < 4; k++)
                c[4 * i + j] += a[4 * i + k] * b[4 * k + j];
        }
}

static void transpose(const double a[16], double out[16])
{
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            out[4 * i + j] = a[4 * j + i];
}

/** Gauss and Jordan with the greatest pivot of each column. False without an inverse. */
static bool invert(const double matrix[16], double out[16])
{
    double a[4][8];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 8; j++)
            a[i][j] = j < 4 ? matrix[4 * i + j] : (double)(j - 4 == i);
    for (int k = 0; k < 4; k++) {
        int pivot = k;
        for (int i = k + 1; i < 4; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k])) pivot = i;
        if (!(fabs(a[pivot][k]) > 0.0)) return false;
        for (int j = 0; j < 8; j++) {
            double swap = a[k][j];
            a[k][j] = a[pivot][j];
            a[pivot][j] = swap;
        }
        for (int i = 0; i < 4; i++) {
            double factor = a[i][k] / a[k][k];
            for (int j = 0; j < 8 && i != k; j++)
                a[i][j] -= factor * a[k][j];
        }
    }
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            out[4 * i + j] = a[i][j + 4] / a[i][i];
    return true;
}

static bool all_finite(const double *values, int count)
{
    for (int i = 0; i < count; i++)
        if (!isfinite(values[i])) return false;
    return true;
}

/** Pixels that a length at the middle of the surface measures in the window, about. */
static double pixels_of(const qm_view *view, double local_length)
{
    const qm_vec middle = {0, 0, 0};
    double w = qm_view_row(view->clip, 3, middle);
    if (!(w > 0.0)) return 0.0;
    double longest = 0.0;
    for (int k = 0; k < 3; k++)
        longest =
            fmax(longest, hypot(view->clip[k] * view->viewport[2], view->clip[4 + k] * view->viewport[3]));
    return 0.5 * longest * local_length / w;
}

static void set_candidates(const qm_pick_options *options, qm_view *view)
{
    double length = DISC_RADII * qm_mesh_disc_radius(&view->source->bvh->mesh);
    view->reach = options->depth > 0.0 ? options->depth : length;
    view->radius_px = options->radius_px;
    if (view->radius_px > 0.0) return;
    double pixels = pixels_of(view, length * view->source->bvh->frame.scale);
    view->radius_px = qm_clamp(pixels, 2.0, 200.0);
}

qm_status qm_view_init(qm_context *ctx, const qm_source *source, const qm_camera *camera,
                       const qm_pick_options *options, qm_view *out)
{
    if (!all_finite(camera->view, 16) || !all_finite(camera->projection, 16) ||
        !all_finite(camera->viewport, 4))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the camera holds a number that is not finite");
    if (!(camera->viewport[2] > 0.0 && camera->viewport[3] > 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the viewport has no size");
    if (!(options->radius_px >= 0.0) || !(options->depth >= 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the radius and depth of candidates are 0 or more");
    *out = (qm_view){.source = source};
    memcpy(out->viewport, camera->viewport, sizeof out->viewport);
    const qm_frame *frame = &source->bvh->frame;
    double s = frame->inverse_scale;
    const double world[16] = {s, 0, 0, frame->origin.x, 0, s, 0, frame->origin.y,
                              0, 0, s, frame->origin.z, 0, 0, 0, 1};
    double view[16], projection[16], eye[16];
    transpose(camera->view, view);
    transpose(camera->projection, projection);
    multiply(view, world, eye);
    multiply(projection, eye, out->clip);
    for (int k = 0; k < 4; k++)
        out->depth[k] = -eye[8 + k];
    if (!invert(out->clip, out->inverse) || !all_finite(out->inverse, 16))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the camera's matrices have no inverse");
    set_candidates(options, out);
    return QM_OK;
}

qm_vec qm_view_unproject(const qm_view *view, double x, double y, double z)
{
    const qm_vec at = {x, y, z};
    double w = qm_view_row(view->inverse, 3, at);
    return qm_vec_scale(1.0 / w,
                        (qm_vec){qm_view_row(view->inverse, 0, at), qm_view_row(view->inverse, 1, at),
                                 qm_view_row(view->inverse, 2, at)});
}

qm_status qm_view_pick(qm_context *ctx, const qm_view *view, const double window[2], double position[3],
                       bool *found)
{
    *found = false;
    if (!isfinite(window[0]) || !isfinite(window[1])) return QM_OK;
    qm_vec at;
    if (!view->source->is_cloud) {
        *found = qm_pick_mesh(view, window, &at);
    } else {
        qm_status status = qm_pick_cloud(ctx, view, window, &at, found);
        if (status != QM_OK) return status;
    }
    if (*found) qm_vec_store(position, qm_frame_world(&view->source->bvh->frame, at));
    *found = *found && all_finite(position, 3);
    return QM_OK;
}

qm_status qm_view_stroke(qm_context *ctx, const qm_view *view, const double *window, size_t point_count,
                         double *positions, size_t *count, size_t *missed)
{
    *count = *missed = 0;
    for (size_t i = 0; i < point_count; i++) {
        double at[3];
        bool found;
        qm_status status = qm_view_pick(ctx, view, window + 2 * i, at, &found);
        if (status != QM_OK) return status;
        if (!found) {
            ++*missed;
        } else if (*count == 0 || memcmp(positions + 3 * (*count - 1), at, sizeof at) != 0) {
            memcpy(positions + 3 * (*count)++, at, sizeof at);
        }
    }
    return QM_OK;
}
