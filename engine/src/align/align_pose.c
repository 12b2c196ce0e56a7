/**
 * align_pose.c: quaternions, and what a pose does.
 */
#include "align_pose.h"

qm_align_matrix qm_align_pose_matrix(const qm_align_pose *pose)
{
    const double w = pose->turn[0], x = pose->turn[1], y = pose->turn[2], z = pose->turn[3];
    qm_align_matrix m = {{{1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)},
                          {2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)},
                          {2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)}}};
    if (pose->is_mirrored) m.column[0] = qm_vec_scale(-1.0, m.column[0]);
    return m;
}

static void normalize(double q[4])
{
    const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; i++)
        q[i] /= length;
}

/* Of the four ways the one that divides by the largest component: Shepperd, Quaternion from rotation matrix, 1978. */
void qm_align_turn_of(const qm_align_matrix *m, double turn[4])
{
    const double a[3][3] = {{m->column[0].x, m->column[1].x, m->column[2].x},
                            {m->column[0].y, m->column[1].y, m->column[2].y},
                            {m->column[0].z, m->column[1].z, m->column[2].z}};
    const double trace = a[0][0] + a[1][1] + a[2][2];
    int largest = 0;
    for (int i = 1; i < 3; i++)
        if (a[i][i] > a[largest][largest]) largest = i;
    if (trace > a[largest][largest]) {
        turn[0] = 1.0 + trace;
        turn[1] = a[2][1] - a[1][2];
        turn[2] = a[0][2] - a[2][0];
        turn[3] = a[1][0] - a[0][1];
    } else {
        const int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;
        turn[0] = a[k][j] - a[j][k];
        turn[1 + i] = 1.0 + a[i][i] - a[j][j] - a[k][k];
        turn[1 + j] = a[j][i] + a[i][j];
        turn[1 + k] = a[k][i] + a[i][k];
    }
    normalize(turn);
}

void qm_align_turn_multiply(const double p[4], const double q[4], double out[4])
{
    const double r[4] = {p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
                         p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
                         p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
                         p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]};
    for (int i = 0; i < 4; i++)
        out[i] = r[i];
    normalize(out);
}

qm_align_pose qm_align_pose_change(const qm_align_pose *pose, qm_vec center, const qm_align_step *step)
{
    const double angle = qm_vec_norm(step->turn);
    const double factor = angle > 0.0 ? sin(0.5 * angle) / angle : 0.5;
    const double turn[4] = {cos(0.5 * angle), factor * step->turn.x, factor * step->turn.y,
                            factor * step->turn.z};
    const double scale = exp(step->scale);
    qm_align_pose change = {.scale = 1.0}, next = *pose;
    qm_align_turn_multiply(turn, (const double[4]){1, 0, 0, 0}, change.turn);
    qm_align_turn_multiply(turn, pose->turn, next.turn);
    const qm_align_matrix m = qm_align_pose_matrix(&change);
    const qm_vec moved = qm_align_multiply(&m, qm_vec_sub(pose->shift, center));
    next.scale = scale * pose->scale;
    next.shift = qm_vec_add(qm_vec_axpy(center, scale, moved), step->shift);
    return next;
}

/** The shift is center of B + unit * shift - M center of A, in which large numbers may cancel: it is summed in extended
 * precision and rounded once. */
void qm_align_pose_transform(const qm_align_frames *frames, const qm_align_pose *pose,
                             double m[QM_TRANSFORM_SIZE])
{
    const qm_align_matrix matrix = qm_align_pose_matrix(pose);
    const double shift[3] = {pose->shift.x, pose->shift.y, pose->shift.z};
    qm_transform_identity(m);
    for (int k = 0; k < 3; k++)
        qm_vec_store(m + 4 * k, qm_vec_scale(pose->scale, matrix.column[k]));
    for (int i = 0; i < 3; i++) {
        long double sum = (long double)frames->center[1][i] + (long double)frames->unit * shift[i];
        for (int k = 0; k < 3; k++)
            sum -= (long double)m[4 * k + i] * frames->center[0][k];
        m[12 + i] = (double)sum;
    }
}
