/**
 * align_points.c: points on a surface without chance, and their nearest points on the other one.
 *
 * Point i of n lies in the face that holds the share frac(i g) of the area, faces in their order, g the golden ratio's
 * fraction: every first part of the sequence is spread over the area as evenly as n points can be but for a factor
 * (Weyl's sequence with the number that is hardest to approximate). Its place in the face comes from the R2 sequence of the plane's
 * generalised golden ratio. Both follow faces and areas alone, so that points move with the mesh.
 */
#include "align_work.h"

#define GOLDEN 0.6180339887498949
#define PLASTIC_1 0.7548776662466927 /* 1 / p and 1 / p^2 of the root p of p^3 = p + 1 */
#define PLASTIC_2 0.5698402909980532

static double fraction(double x)
{
    return x - floor(x);
}

static qm_vec corner(const qm_align_work *work, int side, uint32_t vertex)
{
    return qm_align_local(&work->frames, side, qm_bvh_mesh(work->tree[side])->positions + 3 * (size_t)vertex);
}

static double face_area(const qm_align_work *work, int side, size_t face)
{
    const uint32_t *c = qm_bvh_mesh(work->tree[side])->faces + 4 * face;
    const qm_vec p = corner(work, side, c[0]), d = qm_vec_sub(corner(work, side, c[2]), p);
    const qm_vec e = qm_vec_sub(corner(work, side, c[1]), p);
    double area = 0.5 * qm_vec_norm(qm_vec_cross(e, d));
    if (c[3] != QM_NO_INDEX)
        area += 0.5 * qm_vec_norm(qm_vec_cross(d, qm_vec_sub(corner(work, side, c[3]), p)));
    return area;
}

/** The point at parameters of the unit square, which a triangle takes folded over. */
static qm_vec face_point(const qm_align_work *work, int side, size_t face, double u, double v)
{
    const uint32_t *c = qm_bvh_mesh(work->tree[side])->faces + 4 * face;
    const qm_vec p = corner(work, side, c[0]), q = corner(work, side, c[1]), r = corner(work, side, c[2]);
    if (c[3] == QM_NO_INDEX) {
        if (u + v > 1.0) {
            u = 1.0 - u;
            v = 1.0 - v;
        }
        return qm_vec_axpy(qm_vec_axpy(p, u, qm_vec_sub(q, p)), v, qm_vec_sub(r, p));
    }
    const qm_vec s = corner(work, side, c[3]);
    if (work->options->quads == QM_QUADS_BILINEAR)
        return qm_vec_mix(qm_vec_mix(p, q, u), qm_vec_mix(s, r, u), v);
    /* The triangle p q r has u >= v, p r s has v >= u. */
    return u >= v ? qm_vec_axpy(qm_vec_axpy(p, u, qm_vec_sub(q, p)), v, qm_vec_sub(r, q))
                  : qm_vec_axpy(qm_vec_axpy(p, v, qm_vec_sub(s, p)), u, qm_vec_sub(r, s));
}

/** The first face whose sum of areas is above this one. */
static size_t find_face(const double *sum, size_t count, double area)
{
    size_t low = 0, high = count - 1;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (sum[middle] > area)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/** All vertices of the faces when a surface has no area, as that of a curve. */
static void add_corners(qm_align_work *work, int side, size_t count)
{
    const qm_mesh *mesh = qm_bvh_mesh(work->tree[side]);
    qm_align_points *points = &work->points[side];
    for (size_t i = 0; i < count; i++) {
        const uint32_t *c =
            mesh->faces + 4 * (size_t)(fraction((double)i * GOLDEN) * (double)mesh->face_count);
        points->point[points->count++] = corner(work, side, c[i % 3]);
    }
}

static bool add_on_faces(qm_align_work *work, int side, size_t count)
{
    const qm_mesh *mesh = qm_bvh_mesh(work->tree[side]);
    qm_align_points *points = &work->points[side];
    double *sum = qm_context_alloc(work->ctx, mesh->face_count, sizeof *sum), total = 0.0;
    if (!sum) return false;
    for (size_t i = 0; i < mesh->face_count; i++)
        sum[i] = total += face_area(work, side, i);
    for (size_t i = 0; i < count && total > 0.0; i++) {
        const double share = fraction(0.5 + (double)i * GOLDEN), n = (double)i + 1.0;
        const size_t face = find_face(sum, mesh->face_count, share * total);
        points->point[points->count++] =
            face_point(work, side, face, fraction(n * PLASTIC_1), fraction(n * PLASTIC_2));
    }
    qm_context_free(work->ctx, sum, mesh->face_count, sizeof *sum);
    if (!(total > 0.0)) add_corners(work, side, count);
    return true;
}

bool qm_align_points_make(qm_align_work *work, int side, size_t count)
{
    const qm_mesh *mesh = qm_bvh_mesh(work->tree[side]);
    qm_align_points *points = &work->points[side];
    points->point = qm_context_alloc(work->ctx, count, sizeof *points->point);
    points->capacity = count;
    if (!points->point) return false;
    if (mesh->face_count > 0) return add_on_faces(work, side, count);
    /* Points of a set, in the order of the sequence; all of them in turn when there are fewer. */
    for (size_t i = 0; i < count; i++) {
        const size_t vertex = mesh->vertex_count <= count
                                  ? i % mesh->vertex_count
                                  : (size_t)(fraction((double)i * GOLDEN) * (double)mesh->vertex_count);
        points->point[points->count++] = corner(work, side, (uint32_t)vertex);
    }
    return true;
}

qm_vec qm_align_points_center(const qm_align_points *points)
{
    qm_vec sum = {0, 0, 0};
    for (size_t i = 0; i < points->count; i++)
        sum = qm_vec_add(sum, points->point[i]);
    return qm_vec_scale(1.0 / (double)points->count, sum);
}

/* ---- distances under a pose ---- */

/** The unit normal of a face at a point of it; 0 where there is none. */
static qm_vec normal_at(const qm_align_work *work, int side, uint32_t face, const double uv[2])
{
    const qm_mesh *mesh = qm_bvh_mesh(work->tree[side]);
    if (mesh->face_count == 0) return (qm_vec){0, 0, 0};
    const uint32_t *c = mesh->faces + 4 * (size_t)face;
    const qm_vec p = corner(work, side, c[0]), q = corner(work, side, c[1]), r = corner(work, side, c[2]);
    qm_vec along_u = qm_vec_sub(q, p), along_v = qm_vec_sub(r, p);
    if (c[3] != QM_NO_INDEX) {
        const qm_vec s = corner(work, side, c[3]);
        if (work->options->quads == QM_QUADS_BILINEAR) {
            along_u = qm_vec_mix(along_u, qm_vec_sub(r, s), uv[1]);
            along_v = qm_vec_mix(qm_vec_sub(s, p), qm_vec_sub(r, q), uv[0]);
        } else if (uv[1] > uv[0]) {
            along_u = qm_vec_sub(r, p);
            along_v = qm_vec_sub(s, p);
        }
    }
    const qm_vec normal = qm_vec_cross(along_u, along_v);
    const double length = qm_vec_norm(normal);
    return length > QM_MIN_LENGTH ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
}

/** The foot of a point, as a pair. `m` is the matrix of the pose. */
static void make_pair(const qm_align_work *work, const qm_align_pose *pose, const qm_align_matrix *m,
                      int side, qm_vec point, size_t i, qm_align_pair *pair)
{
    const qm_vec foot = qm_align_local(&work->frames, 1 - side, work->feet + 3 * i);
    pair->side = side;
    pair->x = side == 0 ? point : foot;
    pair->y = side == 0 ? foot : point;
    pair->moved = qm_vec_axpy(pose->shift, pose->scale, qm_align_multiply(m, pair->x));
    const qm_vec difference = qm_vec_sub(pair->moved, pair->y);
    pair->distance = qm_vec_norm(difference);
    if (pair->distance > work->noise) {
        pair->direction = qm_vec_scale(1.0 / pair->distance, difference);
    } else {
        pair->direction = normal_at(work, 1 - side, work->faces[i], work->uv + 2 * i);
        if (side == 1) pair->direction = qm_align_multiply(m, pair->direction);
    }
    pair->offset = qm_vec_dot(difference, pair->direction);
}

/** Feet of points of one side, from the place `first` of the pairs on. */
static qm_status measure_side(qm_align_work *work, const qm_align_pose *pose, int side, const qm_vec *point,
                              size_t stride, size_t count, size_t first)
{
    if (count == 0) return QM_OK;
    const qm_align_matrix m = qm_align_pose_matrix(pose);
    for (size_t i = 0; i < count; i++) {
        const qm_vec p = *(const qm_vec *)(const void *)((const char *)point + i * stride);
        const qm_vec back =
            qm_vec_scale(1.0 / pose->scale, qm_align_multiply_back(&m, qm_vec_sub(p, pose->shift)));
        const qm_vec there =
            side == 0 ? qm_vec_axpy(pose->shift, pose->scale, qm_align_multiply(&m, p)) : back;
        qm_align_global(&work->frames, 1 - side, there, work->numbers + 3 * i);
    }
    const qm_projection out = {work->distances, work->feet, work->faces, work->uv};
    const qm_align_options *options = work->options;
    qm_status status = qm_project_points(work->ctx, work->tree[1 - side], options->quads, work->numbers,
                                         count, options->thread_count, &out);
    for (size_t i = 0; status == QM_OK && i < count; i++) {
        const qm_vec p = *(const qm_vec *)(const void *)((const char *)point + i * stride);
        make_pair(work, pose, &m, side, p, i, &work->pairs[first + i]);
    }
    return status;
}

qm_status qm_align_measure(qm_align_work *work, const qm_align_pose *pose, size_t count,
                           const qm_align_extra *extra, size_t extra_count)
{
    qm_status status = QM_OK;
    work->pair_count = 0;
    for (int side = 0; side < 2 && status == QM_OK; side++) {
        const qm_align_points *points = &work->points[side];
        const size_t most = points->count < count ? points->count : count,
                     taken = work->counts[side] ? most : 0;
        status =
            measure_side(work, pose, side, points->point, sizeof *points->point, taken, work->pair_count);
        work->pair_count += taken;
    }
    for (size_t i = 0, next; i < extra_count && status == QM_OK; i = next) {
        /* Those of one side that follow each other, as many as there is room for feet. */
        next = i + 1;
        while (next < extra_count && extra[next].side == extra[i].side &&
               next - i < work->options->sample_count)
            next++;
        QM_ASSERT(work->pair_count + (next - i) <= work->pair_capacity);
        status = measure_side(work, pose, extra[i].side, &extra[i].point, sizeof extra[i], next - i,
                              work->pair_count);
        work->pair_count += next - i;
    }
    return status;
}

/* ---- steps ---- */

/* A step moves z = x - center by turn x z + shift + scale z, so the distance along the unit vector d by
 * turn . (z x d) + shift . d + scale (z . d). */
void qm_align_row(const qm_align_pair *pair, qm_vec center, double row[QM_ALIGN_UNKNOWNS])
{
    const qm_vec z = qm_vec_sub(pair->moved, center);
    qm_vec_store(row, qm_vec_cross(z, pair->direction));
    qm_vec_store(row + 3, pair->direction);
    row[6] = qm_vec_dot(z, pair->direction);
}

int qm_align_unknowns(qm_align_motion motion, int index[QM_ALIGN_UNKNOWNS])
{
    const int first = motion == QM_ALIGN_TRANSLATION ? 3 : 0, end = motion == QM_ALIGN_RIGID_SCALE ? 7 : 6;
    for (int i = first; i < end; i++)
        index[i - first] = i;
    return end - first;
}

qm_align_step qm_align_step_of(const double x[QM_ALIGN_UNKNOWNS])
{
    return (qm_align_step){{x[0], x[1], x[2]}, {x[3], x[4], x[5]}, x[6]};
}
