/**
 * align_start.c: where the search starts, and which start leads to the best pose.
 *
 * All starts take some steps over few points; the best ones that lie apart go on over more. The turns of the principal
 * axes form the group of the cube; those of the icosahedron that are not among them are 48 more, so that no turn is farther than
 * 45 degrees from one (the vertices of the 600-cell reach all of the sphere of quaternions within 22.3 degrees). They are turns between the axes of the two meshes: where A lies changes nothing.
 */
#include "align_work.h"

#include "core/linear.h"

#define CUBE_TURNS 24
#define MAX_STARTS 160
#define FEW_POINTS 300
#define FEW_STEPS 12
#define MORE_POINTS 1024
#define MORE_STEPS 30
#define SECOND_STEPS 30 /* over all points, enough to compare the two best */
#define LAST_STEPS 200
#define FINALISTS 6
#define WIDER 2      /* times as many steps and finalists where the first ones leave it open */
#define CLEAR 0.25   /* of the second best root mean square: a smaller best one is clear */
#define NOTHING 1e-9 /* a smaller one is 0 */
#define APART                                                                                                \
    0.02 /* poses that move points of A by more, as a fraction of the unit, are others while few points are measured */
#define ELSEWHERE 1e-3 /* the same at the end */

typedef struct start_list {
    qm_align_found found[MAX_STARTS];
    int count;
} start_list;

static void add_start(start_list *list, const qm_align_pose *pose)
{
    QM_ASSERT(list->count < MAX_STARTS);
    list->found[list->count++] = (qm_align_found){.pose = *pose};
}

/** A pose with this turn and scale that brings a point of A's frame to one of B's. */
static qm_align_pose pose_with(const double turn[4], bool is_mirrored, double scale, qm_vec from, qm_vec to)
{
    qm_align_pose pose = {
        .scale = scale, .turn = {turn[0], turn[1], turn[2], turn[3]}, .is_mirrored = is_mirrored};
    const qm_align_matrix m = qm_align_pose_matrix(&pose);
    pose.shift = qm_vec_axpy(to, -scale, qm_align_multiply(&m, from));
    return pose;
}

/* ---- identity and centroids ---- */

static const double no_turn[4] = {1.0, 0.0, 0.0, 0.0};

static qm_align_pose identity(const qm_align_work *work)
{
    const qm_align_frames *frames = &work->frames;
    qm_align_pose pose = {.scale = 1.0, .turn = {1.0, 0.0, 0.0, 0.0}};
    pose.shift = qm_align_local(frames, 1, frames->center[0]);
    return pose;
}

/* ---- principal axes ---- */

/** Centroid, root mean square of the distance from it, and principal axes of points on a surface. */
typedef struct moments {
    qm_vec center;
    double size;
    qm_align_matrix axes; /* right-handed */
} moments;

static moments find_moments(const qm_align_points *points)
{
    moments out = {.center = qm_align_points_center(points)};
    double sum[6] = {0}, value[3];
    for (size_t i = 0; i < points->count; i++) {
        const qm_vec d = qm_vec_sub(points->point[i], out.center);
        const double product[6] = {d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z};
        for (int k = 0; k < 6; k++)
            sum[k] += product[k] / (double)points->count;
    }
    out.size = sqrt(sum[0] + sum[3] + sum[5]);
    qm_linear_eigen(sum, value, out.axes.column);
    out.axes.column[2] = qm_vec_cross(out.axes.column[0], out.axes.column[1]);
    return out;
}

/** The turns of a cube onto itself: a permutation of the axes with signs whose determinant is 1. */
static void list_cube_turns(double turn[CUBE_TURNS][4])
{
    static const int orders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    int count = 0;
    for (int order = 0; order < 6; order++)
        for (int signs = 0; signs < 4; signs++) {
            double column[3][3] = {{0}};
            for (int k = 0; k < 2; k++)
                column[k][orders[order][k]] = signs >> k & 1 ? -1.0 : 1.0;
            qm_align_matrix m = {{qm_vec_load(column[0]), qm_vec_load(column[1]), {0, 0, 0}}};
            m.column[2] = qm_vec_cross(m.column[0], m.column[1]);
            qm_align_turn_of(&m, turn[count++]);
        }
}

#define ICOSAHEDRON_TURNS 48

/** The turns of an icosahedron onto itself that are none of a cube: even permutations of (phi, 1, 1 / phi, 0) / 2 with any
 * signs, of which q and -q are one turn. */
static void list_icosahedron_turns(double turn[ICOSAHEDRON_TURNS][4])
{
    static const int orders[12][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2}, {1, 0, 3, 2},
                                      {1, 2, 0, 3}, {1, 3, 2, 0}, {2, 0, 1, 3}, {2, 1, 3, 0},
                                      {2, 3, 0, 1}, {3, 0, 2, 1}, {3, 1, 0, 2}, {3, 2, 1, 0}};
    const double golden = 0.5 * (1.0 + sqrt(5.0)), part[3] = {0.5 * golden, 0.5, 0.5 / golden};
    int count = 0;
    for (int order = 0; order < 12; order++)
        for (int signs = 0; signs < 4; signs++) {
            double *q = turn[count++];
            q[orders[order][3]] = 0.0;
            q[orders[order][0]] = part[0];
            q[orders[order][1]] = signs & 1 ? -part[1] : part[1];
            q[orders[order][2]] = signs & 2 ? -part[2] : part[2];
        }
}

/** The pose that brings the axes of A onto those of B, turned between them. */
static qm_align_pose between_axes(const moments m[2], const double turn[4], bool is_mirrored, double scale)
{
    const qm_align_pose turned = {.scale = 1.0, .turn = {turn[0], turn[1], turn[2], turn[3]}};
    const qm_align_matrix middle = qm_align_pose_matrix(&turned);
    qm_align_matrix from = m[0].axes, whole;
    if (is_mirrored) { /* the axes of the mirror image, made right-handed */
        for (int k = 0; k < 3; k++)
            from.column[k].x = -from.column[k].x;
        from.column[2] = qm_vec_scale(-1.0, from.column[2]);
    }
    /* whole = axes of B * middle * transposed axes of A, column by column */
    for (int k = 0; k < 3; k++) {
        const qm_vec row = {k == 0, k == 1, k == 2};
        const qm_vec inner = qm_align_multiply(&middle, qm_align_multiply_back(&from, row));
        whole.column[k] = qm_align_multiply(&m[1].axes, inner);
    }
    double q[4];
    qm_align_turn_of(&whole, q);
    return pose_with(q, is_mirrored, scale, m[0].center, m[1].center);
}

static void add_principal(const moments m[2], bool is_mirrored, double scale, start_list *list)
{
    double cube[CUBE_TURNS][4], icosahedron[ICOSAHEDRON_TURNS][4];
    list_cube_turns(cube);
    list_icosahedron_turns(icosahedron);
    for (int i = 0; i < CUBE_TURNS + ICOSAHEDRON_TURNS; i++) {
        const double *turn = i < CUBE_TURNS ? cube[i] : icosahedron[i - CUBE_TURNS];
        const qm_align_pose pose = between_axes(m, turn, is_mirrored, scale);
        add_start(list, &pose);
    }
}

/* ---- landmarks ---- */

/** The largest eigenvector of a symmetric 4 x 4 matrix, by Jacobi rotations. */
static void largest_eigenvector(double a[4][4], double out[4])
{
    double v[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    for (int sweep = 0; sweep < 24; sweep++)
        for (int p = 0; p < 3; p++)
            for (int q = p + 1; q < 4; q++) {
                if (a[p][q] == 0.0) continue;
                const double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                const double t = copysign(1.0, theta) / (fabs(theta) + sqrt(theta * theta + 1.0));
                const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < 4; k++) {
                    const double kp = a[k][p], kq = a[k][q];
                    a[k][p] = c * kp - s * kq;
                    a[k][q] = s * kp + c * kq;
                }
                for (int k = 0; k < 4; k++) {
                    const double pk = a[p][k], qk = a[q][k], vp = v[k][p], vq = v[k][q];
                    a[p][k] = c * pk - s * qk;
                    a[q][k] = s * pk + c * qk;
                    v[k][p] = c * vp - s * vq;
                    v[k][q] = s * vp + c * vq;
                }
            }
    int best = 0;
    for (int i = 1; i < 4; i++)
        if (a[i][i] > a[best][best]) best = i;
    for (int k = 0; k < 4; k++)
        out[k] = v[k][best];
}

/** Sums over landmarks around their centers. */
typedef struct landmark_sums {
    qm_vec center[2];
    double cross[3][3]; /* of a times b */
    double square[2];
    double across; /* the second eigenvalue of A's, as a fraction of the first: 0 on a line */
} landmark_sums;

static landmark_sums sum_landmarks(const qm_align_work *work, bool is_mirrored)
{
    const qm_align_options *options = work->options;
    landmark_sums sums = {.across = 0.0};
    const double share = 1.0 / (double)options->landmark_count;
    double spread[6] = {0}, value[3];
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < options->landmark_count; i++) {
            qm_vec a = qm_align_local(&work->frames, 0, options->landmarks[i].a);
            qm_vec b = qm_align_local(&work->frames, 1, options->landmarks[i].b);
            if (pass == 0) {
                sums.center[0] = qm_vec_axpy(sums.center[0], share, a);
                sums.center[1] = qm_vec_axpy(sums.center[1], share, b);
                continue;
            }
            a = qm_vec_sub(a, sums.center[0]);
            b = qm_vec_sub(b, sums.center[1]);
            if (is_mirrored) a.x = -a.x;
            const double p[3] = {a.x, a.y, a.z}, q[3] = {b.x, b.y, b.z};
            for (int r = 0, k = 0; r < 3; r++)
                for (int s = 0; s < 3; s++) {
                    sums.cross[r][s] += p[r] * q[s];
                    if (s >= r) spread[k++] += p[r] * p[s];
                }
            sums.square[0] += qm_vec_norm2(a);
            sums.square[1] += qm_vec_norm2(b);
        }
    qm_vec axes[3];
    qm_linear_eigen(spread, value, axes);
    sums.across = value[2] > 0.0 ? value[1] / value[2] : 0.0;
    return sums;
}

static qm_status add_landmarks(qm_align_work *work, bool is_mirrored, start_list *list)
{
    const qm_align_options *options = work->options;
    const landmark_sums sums = sum_landmarks(work, is_mirrored);
    double turn[4] = {1.0, 0.0, 0.0, 0.0};
    if (options->motion != QM_ALIGN_TRANSLATION) {
        if (options->landmark_count < 3 || sums.across < 1e-12)
            return qm_context_fail(work->ctx, QM_E_ARGUMENT,
                                   "a turn needs three landmarks of A that are not on one line");
        const double(*s)[3] = sums.cross;
        double n[4][4] = {
            {s[0][0] + s[1][1] + s[2][2], s[1][2] - s[2][1], s[2][0] - s[0][2], s[0][1] - s[1][0]},
            {0, s[0][0] - s[1][1] - s[2][2], s[0][1] + s[1][0], s[2][0] + s[0][2]},
            {0, 0, -s[0][0] + s[1][1] - s[2][2], s[1][2] + s[2][1]},
            {0, 0, 0, -s[0][0] - s[1][1] + s[2][2]}};
        for (int i = 1; i < 4; i++)
            for (int j = 0; j < i; j++)
                n[i][j] = n[j][i];
        largest_eigenvector(n, turn);
    }
    const bool scales = options->motion == QM_ALIGN_RIGID_SCALE && sums.square[1] > 0.0;
    const qm_align_pose pose =
        pose_with(turn, is_mirrored, scales ? sqrt(sums.square[1] / sums.square[0]) : 1.0, sums.center[0],
                  sums.center[1]);
    add_start(list, &pose);
    return QM_OK;
}

/* ---- all of them ---- */

static qm_status list_starts(qm_align_work *work, const moments m[2], start_list *list)
{
    const qm_align_options *options = work->options;
    const bool turns = options->motion != QM_ALIGN_TRANSLATION;
    const double scale = options->motion == QM_ALIGN_RIGID_SCALE && m[0].size > 0.0 && m[1].size > 0.0
                             ? m[1].size / m[0].size
                             : 1.0;
    for (int is_mirrored = 0; is_mirrored <= options->may_mirror; is_mirrored++) {
        qm_status status = QM_OK;
        if (options->start == QM_ALIGN_LANDMARKS) status = add_landmarks(work, is_mirrored, list);
        if (status != QM_OK) return status;
        if (options->start == QM_ALIGN_PRINCIPAL && turns) add_principal(m, is_mirrored, scale, list);
        if (options->start == QM_ALIGN_PRINCIPAL || options->start == QM_ALIGN_CENTROIDS) {
            const qm_align_pose pose = pose_with(no_turn, is_mirrored, scale, m[0].center, m[1].center);
            add_start(list, &pose);
        }
        if (options->start == QM_ALIGN_PRINCIPAL || options->start == QM_ALIGN_IDENTITY) {
            qm_align_pose pose = identity(work);
            pose.is_mirrored = is_mirrored; /* about the middle of A's box */
            add_start(list, &pose);
        }
    }
    return QM_OK;
}

/** Root mean square of how far two poses move points of A apart. */
static double distance_of_poses(const qm_align_work *work, const qm_align_pose *p, const qm_align_pose *q)
{
    const qm_align_matrix m = qm_align_pose_matrix(p), n = qm_align_pose_matrix(q);
    const qm_align_points *points = &work->points[0];
    const size_t count = points->count < FEW_POINTS ? points->count : FEW_POINTS;
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        const qm_vec x = points->point[i];
        const qm_vec a = qm_vec_axpy(p->shift, p->scale, qm_align_multiply(&m, x));
        const qm_vec b = qm_vec_axpy(q->shift, q->scale, qm_align_multiply(&n, x));
        sum += qm_vec_norm2(qm_vec_sub(a, b));
    }
    return sqrt(sum / (double)count);
}

/** Sorts by the distance, stably, and keeps the first ones that lie apart. */
static void keep_best(const qm_align_work *work, start_list *list, int most, double apart)
{
    for (int i = 1; i < list->count; i++)
        for (int j = i; j > 0 && list->found[j].rms < list->found[j - 1].rms; j--) {
            const qm_align_found swap = list->found[j];
            list->found[j] = list->found[j - 1];
            list->found[j - 1] = swap;
        }
    int kept = 0;
    for (int i = 0; i < list->count && kept < most; i++) {
        bool is_new = true;
        for (int k = 0; k < kept && is_new; k++)
            is_new = distance_of_poses(work, &list->found[i].pose, &list->found[k].pose) > apart;
        if (is_new) list->found[kept++] = list->found[i];
    }
    list->count = kept;
}

static qm_status improve_all(qm_align_work *work, start_list *list, size_t points, int steps)
{
    const qm_align_effort effort = {.count = points, .max_steps = steps};
    qm_status status = QM_OK;
    for (int i = 0; i < list->count && status == QM_OK; i++) {
        const qm_align_pose pose = list->found[i].pose;
        status = qm_align_improve(work, &pose, &effort, &list->found[i]);
    }
    return status;
}

/** Over all points: the best one, and the second only as long as it may become that. */
static qm_status improve_two(qm_align_work *work, start_list *list)
{
    qm_align_effort effort = {
        .count = work->options->sample_count, .max_steps = SECOND_STEPS, .is_last = true};
    qm_status status = QM_OK;
    for (int i = 0; i < list->count && status == QM_OK; i++) {
        const qm_align_pose pose = list->found[i].pose;
        status = qm_align_improve(work, &pose, &effort, &list->found[i]);
        effort.rival = qm_max(list->found[0].rms, NOTHING);
    }
    return status;
}

/** The two best placements, from all starts; effort is how many times the least steps and finalists are taken. */
static qm_status find_finalists(qm_align_work *work, const moments m[2], int effort, start_list *list)
{
    list->count = 0;
    qm_status status = list_starts(work, m, list);
    const bool has_many = list->count > 2;
    if (status == QM_OK && has_many) status = improve_all(work, list, FEW_POINTS, effort * FEW_STEPS);
    if (status == QM_OK && has_many) keep_best(work, list, effort * FINALISTS, APART);
    if (status == QM_OK) status = improve_all(work, list, MORE_POINTS, MORE_STEPS);
    if (status == QM_OK) keep_best(work, list, 2, APART);
    return status;
}

/** Whether one placement is much better than all others, or exact. */
static bool is_clear(const start_list *list)
{
    return list->count < 2 || list->found[0].rms <= qm_max(CLEAR * list->found[1].rms, NOTHING);
}

qm_status qm_align_search_starts(qm_align_work *work, qm_align_ranking *out)
{
    start_list *list = qm_context_alloc(work->ctx, 1, sizeof *list);
    if (!list) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the alignment");
    const moments m[2] = {find_moments(&work->points[0]), find_moments(&work->points[1])};
    qm_status status = find_finalists(work, m, 1, list);
    if (status == QM_OK && work->options->start == QM_ALIGN_PRINCIPAL && !is_clear(list))
        status = find_finalists(work, m, WIDER, list);
    if (status == QM_OK) status = improve_two(work, list);
    if (status == QM_OK) {
        keep_best(work, list, 2, ELSEWHERE);
        const qm_align_pose pose = list->found[0].pose;
        const qm_align_effort last = {
            .count = work->options->sample_count, .max_steps = LAST_STEPS, .is_last = true};
        if (!list->found[0].is_converged) status = qm_align_improve(work, &pose, &last, &list->found[0]);
    }
    if (status == QM_OK) {
        *out = (qm_align_ranking){.best = list->found[0], .has_second = list->count > 1};
        if (out->has_second) out->second = list->found[1];
    }
    qm_context_free(work->ctx, list, 1, sizeof *list);
    return status;
}
