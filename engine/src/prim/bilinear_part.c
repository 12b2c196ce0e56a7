#include "bilinear_part.h"

#include "bilinear_point.h"
#include "tri_distance.h"
#include "tri_point.h"
#include "tri_tri.h"

/* Off a plane: far more than its corners are by rounding */
#define STRICTLY (1024.0 * QM_BILINEAR_PART_ERROR)

static const double corner_uv[2][4][2] = {{{0, 0}, {1, 0}, {0, 1}, {0, 1}}, {{0, 0}, {1, 0}, {1, 1}, {0, 1}}};

static void set_twist(qm_bilinear_part *part)
{
    part->twist = part->count == 4 ? qm_bilinear_twist(part->corner) : 0.0;
}

qm_bilinear_part qm_bilinear_part_make(const qm_face_shape *face)
{
    qm_bilinear_part part = {.count = face->count};
    for (int i = 0; i < face->count; i++) {
        part.corner[i] = face->corner[i];
        for (int k = 0; k < 2; k++)
            part.uv[i][k] = corner_uv[face->count - 3][i][k];
    }
    set_twist(&part);
    return part;
}

static int find_vertex(const qm_face_shape *face, uint32_t vertex)
{
    for (int i = 0; i < face->count; i++)
        if (face->vertex[i] == vertex) return i;
    return -1;
}

/** An edge of one face from a corner to the next is an edge of the other. */
static bool has_edge(const qm_face_shape *face, uint32_t from, uint32_t to)
{
    for (int i = 0; i < face->count; i++) {
        uint32_t here = face->vertex[i], next = face->vertex[(i + 1) % face->count];
        if ((here == from && next == to) || (here == to && next == from)) return true;
    }
    return false;
}

static int mark_shared(const qm_face_shape *face, const qm_face_shape *other, qm_bilinear_part *part)
{
    int count = 0;
    for (int i = 0; i < face->count; i++) {
        part->is_shared[i] = find_vertex(other, face->vertex[i]) >= 0;
        part->is_shared_edge[i] = has_edge(other, face->vertex[i], face->vertex[(i + 1) % face->count]);
        count += part->is_shared[i];
    }
    return count;
}

int qm_bilinear_part_share(const qm_face_shape *a, const qm_face_shape *b, qm_bilinear_part *part_a,
                           qm_bilinear_part *part_b)
{
    mark_shared(b, a, part_b);
    return mark_shared(a, b, part_a);
}

/* ---- cutting ---- */

/** Sets a corner of a part to the corner of the whole. */
static void copy_corner(qm_bilinear_part *to, int at, const qm_bilinear_part *from, int i)
{
    to->corner[at] = from->corner[i];
    to->uv[at][0] = from->uv[i][0];
    to->uv[at][1] = from->uv[i][1];
    to->is_shared[at] = from->is_shared[i];
}

/** Sets a corner of a part to the middle of edge i of the whole. */
static void copy_middle(qm_bilinear_part *to, int at, const qm_bilinear_part *from, int i)
{
    int k = (i + 1) % from->count;
    to->corner[at] = qm_vec_scale(0.5, qm_vec_add(from->corner[i], from->corner[k]));
    to->uv[at][0] = 0.5 * (from->uv[i][0] + from->uv[k][0]);
    to->uv[at][1] = 0.5 * (from->uv[i][1] + from->uv[k][1]);
    to->is_shared[at] = from->is_shared_edge[i];
}

static void set_centre(qm_bilinear_part *to, int at, const qm_bilinear_part *from)
{
    qm_vec sum = qm_vec_add(qm_vec_add(from->corner[0], from->corner[2]),
                            qm_vec_add(from->corner[1], from->corner[3]));
    to->corner[at] = qm_vec_scale(0.25, sum);
    for (int k = 0; k < 2; k++)
        to->uv[at][k] = 0.25 * (from->uv[0][k] + from->uv[1][k] + from->uv[2][k] + from->uv[3][k]);
    to->is_shared[at] = false;
}

qm_bilinear_part qm_bilinear_part_quarter(const qm_bilinear_part *part, int i)
{
    qm_bilinear_part quarter = {.count = part->count};
    if (part->count == 3 && i == 3) {
        for (int k = 0; k < 3; k++)
            copy_middle(&quarter, k, part, k);
        return quarter;
    }
    int last = (i + part->count - 1) % part->count;
    copy_corner(&quarter, 0, part, i);
    copy_middle(&quarter, 1, part, i);
    if (part->count == 4) set_centre(&quarter, 2, part);
    copy_middle(&quarter, part->count - 1, part, last);
    quarter.is_shared_edge[0] = part->is_shared_edge[i];
    quarter.is_shared_edge[part->count - 1] = part->is_shared_edge[last];
    set_twist(&quarter);
    return quarter;
}

double qm_bilinear_part_size(const qm_bilinear_part *part)
{
    qm_box box = qm_vec_box(part->corner, part->count);
    return fmax(box.max[0] - box.min[0], fmax(box.max[1] - box.min[1], box.max[2] - box.min[2]));
}

void qm_bilinear_part_uv(const qm_bilinear_part *part, const double local[2], double uv[2])
{
    const double(*corner)[2] = part->uv;
    for (int k = 0; k < 2; k++)
        uv[k] = corner[0][k] + local[0] * (corner[1][k] - corner[0][k]) +
                local[1] * (corner[part->count - 1][k] - corner[0][k]);
}

qm_vec qm_bilinear_part_at(const qm_bilinear_part *whole, const double uv[2])
{
    if (whole->count == 4) {
        qm_bilinear patch = qm_bilinear_make(whole->corner);
        return qm_bilinear_at(&patch, uv[0], uv[1]);
    }
    const double weight[3] = {1.0 - uv[0] - uv[1], uv[0], uv[1]};
    return qm_tri_at(whole->corner, weight);
}

/* ---- distance ---- */

double qm_bilinear_part_box_distance(const qm_bilinear_part *p, const qm_bilinear_part *q)
{
    qm_box a = qm_vec_box(p->corner, p->count), b = qm_vec_box(q->corner, q->count);
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        double gap = fmax(fmax(a.min[k] - b.max[k], b.min[k] - a.max[k]), 0.0);
        sum += gap * gap;
    }
    return fmax(sqrt(sum) - QM_BILINEAR_PART_ERROR, 0.0);
}

/** Triangle t of a part: (c0 c1 c2), or (c0 c2 c3). */
static void part_triangle(const qm_bilinear_part *part, int t, qm_vec corner[3])
{
    corner[0] = part->corner[0];
    corner[1] = part->corner[1 + t];
    corner[2] = part->corner[2 + t];
}

static void local_uv(const qm_bilinear_part *part, int t, const double weight[3], double uv[2])
{
    bool is_quad = part->count == 4;
    uv[0] = !is_quad ? weight[1] : t == 0 ? weight[1] + weight[2] : weight[1];
    uv[1] = !is_quad || t == 0 ? weight[2] : weight[1] + weight[2];
}

/** Weights of the nearest point of a triangle. */
static void find_weights(const qm_vec corner[3], qm_vec point, double weight[3])
{
    qm_triangle triangle = qm_triangle_make(corner[0], corner[1], corner[2]);
    qm_triangle_footpoint(&triangle, point, weight);
}

static qm_tri_gap triangle_gap(const qm_vec a[3], const qm_vec b[3])
{
    qm_contact contact;
    if (!qm_tri_tri_meet(a, b)) return qm_tri_tri_distance(a, b);
    qm_tri_gap gap = {.distance = 0.0};
    qm_tri_tri_contact(a, b, &contact);
    qm_vec middle = qm_vec_mix(qm_vec_load(contact.point[0]), qm_vec_load(contact.point[1]), 0.5);
    find_weights(a, middle, gap.weight[0]);
    find_weights(b, middle, gap.weight[1]);
    return gap;
}

qm_bilinear_part_gap qm_part_distance(const qm_bilinear_part *p, const qm_bilinear_part *q)
{
    qm_bilinear_part_gap least = {.distance = INFINITY};
    for (int i = 0; i < p->count - 2; i++) {
        for (int k = 0; k < q->count - 2; k++) {
            qm_vec a[3], b[3];
            part_triangle(p, i, a);
            part_triangle(q, k, b);
            qm_tri_gap gap = triangle_gap(a, b);
            if (!(gap.distance < least.distance)) continue;
            least.distance = gap.distance;
            local_uv(p, i, gap.weight[0], least.uv[0]);
            local_uv(q, k, gap.weight[1], least.uv[1]);
        }
    }
    return least;
}

/* ---- what is shared ---- */

static double segment_distance(qm_vec a, qm_vec b, qm_vec p)
{
    qm_vec along = qm_vec_sub(b, a), from = qm_vec_sub(p, a);
    double size = qm_vec_norm2(along);
    double t = size > 0.0 ? qm_clamp(qm_vec_dot(from, along) / size, 0.0, 1.0) : 0.0;
    return qm_vec_norm(qm_vec_sub(from, qm_vec_scale(t, along)));
}

bool qm_part_near_shared(const qm_bilinear_part *const whole[2], qm_vec point, double distance)
{
    const qm_bilinear_part *p = whole[0];
    for (int i = 0; i < p->count; i++) {
        if (p->is_shared[i] && qm_vec_distance(p->corner[i], point) <= distance) return true;
        if (p->is_shared_edge[i] &&
            segment_distance(p->corner[i], p->corner[(i + 1) % p->count], point) <= distance)
            return true;
    }
    return false;
}

/** The shared corner of a part that is farthest from a point; its distance, -1 when it has none. */
static double farthest_shared(const qm_bilinear_part *part, qm_vec from, qm_vec *out)
{
    double farthest = -1.0;
    for (int i = 0; i < part->count; i++) {
        if (!part->is_shared[i]) continue;
        double distance = qm_vec_distance(from, part->corner[i]);
        if (!(distance > farthest)) continue;
        farthest = distance;
        *out = part->corner[i];
    }
    return farthest;
}

/** A vector's part at a right angle to a direction of length 1 (or 0). */
static qm_vec across(qm_vec v, qm_vec direction)
{
    return qm_vec_axpy(v, -qm_vec_dot(v, direction), direction);
}

static qm_vec unit(qm_vec v)
{
    double size = qm_vec_norm(v);
    return size > 0.0 ? qm_vec_scale(1.0 / size, v) : v;
}

/** The mean direction in which a part leaves the line of what is shared; false when none of it does. */
static bool leaving_direction(const qm_bilinear_part *part, qm_vec origin, qm_vec line, qm_vec *out)
{
    qm_vec sum = {0};
    int count = 0;
    for (int i = 0; i < part->count; i++) {
        if (part->is_shared[i]) continue;
        sum = qm_vec_add(sum, unit(across(qm_vec_sub(part->corner[i], origin), line)));
        count++;
    }
    *out = unit(sum);
    return count > 0;
}

/** Shared corners lie in the plane, all others strictly beyond it. */
static bool lies_beyond(const qm_bilinear_part *part, qm_vec origin, qm_vec normal)
{
    for (int i = 0; i < part->count; i++) {
        double height = qm_vec_dot(normal, qm_vec_sub(part->corner[i], origin));
        if (part->is_shared[i] ? fabs(height) > QM_BILINEAR_PART_ERROR : height <= STRICTLY) return false;
    }
    return true;
}

bool qm_part_parted(const qm_bilinear_part *p, const qm_bilinear_part *q)
{
    qm_vec origin, end_p = {0}, end_q = {0}, up_p, up_q;
    if (farthest_shared(p, p->corner[0], &origin) < 0.0) return false;
    double in_p = farthest_shared(p, origin, &end_p), in_q = farthest_shared(q, origin, &end_q);
    if (in_q < 0.0) return false;
    qm_vec line = unit(qm_vec_sub(in_p > in_q ? end_p : end_q, origin));
    if (!leaving_direction(p, origin, line, &up_p) || !leaving_direction(q, origin, line, &up_q))
        return false;
    qm_vec normal = unit(across(qm_vec_sub(up_p, up_q), line));
    return lies_beyond(p, origin, normal) && lies_beyond(q, origin, qm_vec_scale(-1.0, normal));
}
