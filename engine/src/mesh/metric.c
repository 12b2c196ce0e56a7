/**
 * metric.c: shape metrics of faces, and their distribution over a mesh.
 */
#include "qm/metric.h"

#include "core/face_ring.h"
#include "core/vec.h"

#define CANCEL_STRIDE 65536
#define DEGREES 57.29577951308232 /* of a radian */
#define ROOT_3 1.7320508075688772
#define ROOT_2 1.4142135623730951

const char *const qm_metric_names[] = {
#define XX(suffix, name) #name,
    QM_METRIC_MAP(XX)
#undef XX
        NULL};

const double qm_metric_percents[QM_METRIC_PERCENTILES] = {1, 5, 25, 50, 75, 95, 99};

bool qm_metric_has_triangles(qm_metric metric)
{
    return metric != QM_METRIC_SKEW && metric != QM_METRIC_TAPER && metric != QM_METRIC_WARPAGE &&
           metric != QM_METRIC_STRETCH;
}

/* ---- one face ---- */

/** The edges of a face, in a unit near its size, so that no product overflows or underflows. */
typedef struct face_edges {
    int count;
    qm_vec edge[4]; /* from a corner to the next one */
    double length[4], shortest, longest, sum, squares;
} face_edges;

static face_edges measure_edges(const double corners[][3], int count)
{
    face_edges out = {.count = count, .shortest = INFINITY};
    double largest = 0.0;
    for (int i = 1; i < count; i++)
        for (int k = 0; k < 3; k++)
            largest = qm_max(largest, fabs(corners[i][k] - corners[0][k]));
    int exponent = 0;
    frexp(largest, &exponent);
    /* In two steps, as the unit of the largest and smallest faces is beyond the range of doubles. */
    const double half = ldexp(1.0, -exponent / 2), rest = ldexp(1.0, -exponent - -exponent / 2);
    for (int i = 0; i < count; i++) {
        const double *from = corners[i], *to = corners[(i + 1) % count];
        qm_vec edge = {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
        out.edge[i] = qm_vec_scale(rest, qm_vec_scale(half, edge));
        out.length[i] = qm_vec_norm(out.edge[i]);
        out.shortest = qm_min(out.shortest, out.length[i]);
        out.longest = qm_max(out.longest, out.length[i]);
        out.sum += out.length[i];
        out.squares += qm_vec_norm2(out.edge[i]);
    }
    return out;
}

static double divided(double a, double b)
{
    return b > 0.0 ? a / b : NAN;
}

/** The angle between the edges at corner i, in degrees. */
static double angle_at(const face_edges *face, int i)
{
    qm_vec before = face->edge[(i + face->count - 1) % face->count], after = face->edge[i];
    return 180.0 - DEGREES * qm_vec_angle(before, after);
}

static double extreme_angle(const face_edges *face, bool is_largest)
{
    if (!(face->shortest > 0.0)) return NAN;
    double angle = angle_at(face, 0);
    for (int i = 1; i < face->count; i++)
        angle = is_largest ? qm_max(angle, angle_at(face, i)) : qm_min(angle, angle_at(face, i));
    return angle;
}

static double triangle_metric(qm_metric metric, const face_edges *face)
{
    double twice_area = qm_vec_norm(qm_vec_cross(face->edge[0], face->edge[1]));
    const double *l = face->length;
    switch (metric) {
    case QM_METRIC_SCALED_JACOBIAN: {
        double product = qm_max(l[0] * l[1], qm_max(l[1] * l[2], l[2] * l[0]));
        return product > 0.0 ? 2.0 / ROOT_3 * twice_area / product : 0.0;
    }
    case QM_METRIC_ASPECT_RATIO:
        return divided(face->longest * face->sum, 2.0 * ROOT_3 * twice_area);
    case QM_METRIC_EDGE_RATIO:
        return divided(face->longest, face->shortest);
    case QM_METRIC_SHAPE:
        return face->squares > 0.0 ? 2.0 * ROOT_3 * twice_area / face->squares : 0.0;
    case QM_METRIC_MINIMUM_ANGLE:
    case QM_METRIC_MAXIMUM_ANGLE:
        return extreme_angle(face, metric == QM_METRIC_MAXIMUM_ANGLE);
    default:
        return NAN;
    }
}

/** Of the signed areas of the corners, each divided by a scale of its two edges: the least one. */
static double least_corner(const face_edges *face, bool by_squares)
{
    const qm_vec *e = face->edge;
    const qm_vec normal = qm_vec_cross(qm_vec_sub(e[0], e[2]), qm_vec_sub(e[1], e[3]));
    const double size = qm_vec_norm(normal);
    if (!(size > 0.0) || !(face->shortest > 0.0)) return 0.0;
    double least = INFINITY;
    for (int i = 0; i < 4; i++) {
        int before = (i + 3) % 4;
        double a = face->length[before], b = face->length[i];
        double scale = by_squares ? 0.5 * (a * a + b * b) : a * b;
        double area = qm_vec_dot(qm_vec_cross(e[before], e[i]), normal) / size;
        least = qm_min(least, area / scale);
    }
    return least;
}

/** One minus the cube of the least cosine between the normals of opposite corners. */
static double warpage(const face_edges *face)
{
    qm_vec normal[4];
    double size[4];
    for (int i = 0; i < 4; i++) {
        normal[i] = qm_vec_cross(face->edge[(i + 3) % 4], face->edge[i]);
        size[i] = qm_vec_norm(normal[i]);
        if (!(size[i] > 0.0)) return NAN;
    }
    double cosine = qm_min(qm_vec_dot(normal[0], normal[2]) / size[0] / size[2],
                           qm_vec_dot(normal[1], normal[3]) / size[1] / size[3]);
    cosine = qm_clamp(cosine, -1.0, 1.0);
    return 1.0 - cosine * cosine * cosine;
}

static double quad_metric(qm_metric metric, const face_edges *face)
{
    const qm_vec *e = face->edge;
    const qm_vec axis[2] = {qm_vec_sub(e[0], e[2]), qm_vec_sub(e[1], e[3])};
    const double length[2] = {qm_vec_norm(axis[0]), qm_vec_norm(axis[1])};
    switch (metric) {
    case QM_METRIC_SCALED_JACOBIAN:
        return least_corner(face, false);
    case QM_METRIC_ASPECT_RATIO: {
        double areas = qm_vec_norm(qm_vec_cross(e[0], e[1])) + qm_vec_norm(qm_vec_cross(e[2], e[3]));
        return divided(face->longest * face->sum, 2.0 * areas);
    }
    case QM_METRIC_SKEW: {
        double lengths = length[0] * length[1];
        return lengths > 0.0 ? qm_min(fabs(qm_vec_dot(axis[0], axis[1])) / lengths, 1.0) : 0.0;
    }
    case QM_METRIC_TAPER:
        return divided(qm_vec_norm(qm_vec_add(e[0], e[2])), qm_min(length[0], length[1]));
    case QM_METRIC_WARPAGE:
        return warpage(face);
    case QM_METRIC_EDGE_RATIO:
        return divided(face->longest, face->shortest);
    case QM_METRIC_SHAPE:
        return qm_max(least_corner(face, true), 0.0);
    case QM_METRIC_STRETCH: {
        double first = qm_vec_norm(qm_vec_add(e[0], e[1])), second = qm_vec_norm(qm_vec_add(e[1], e[2]));
        return divided(ROOT_2 * face->shortest, qm_max(first, second));
    }
    case QM_METRIC_MINIMUM_ANGLE:
        return extreme_angle(face, false);
    case QM_METRIC_MAXIMUM_ANGLE: {
        double angle = extreme_angle(face, true);
        return least_corner(face, false) < 0.0 ? 360.0 - angle : angle;
    }
    case QM_METRIC_COUNT:
        break;
    }
    return NAN;
}

double qm_metric_of_corners(qm_metric metric, const double corners[][3], int count)
{
    QM_ASSERT(metric < QM_METRIC_COUNT && (count == 3 || count == 4));
    const face_edges face = measure_edges(corners, count);
    return count == 3 ? triangle_metric(metric, &face) : quad_metric(metric, &face);
}

/* ---- a mesh ---- */

size_t qm_metric_face_count(const qm_mesh *mesh)
{
    bool has_origin = mesh->face_origin && mesh->face_count > 0;
    return has_origin ? (size_t)mesh->face_origin[mesh->face_count - 1] + 1 : mesh->face_count;
}

static double value_of(const qm_mesh *mesh, size_t face, qm_metric metric)
{
    double corners[4][3];
    const uint32_t *index = mesh->faces + 4 * face;
    int count = qm_face_corners(index);
    for (int i = 0; i < count; i++)
        memcpy(corners[i], mesh->positions + 3 * (size_t)index[i], sizeof corners[i]);
    return qm_metric_of_corners(metric, (const double(*)[3])corners, count);
}

void qm_metric_measure(const qm_mesh *mesh, qm_metric metric, size_t first, size_t count, size_t *place,
                       double *values)
{
    for (size_t i = 0; i < count; i++) {
        size_t face = *place;
        QM_ASSERT(face < mesh->face_count && qm_mesh_input_face(mesh, (uint32_t)face) >= first + i);
        values[i] = NAN;
        if (qm_mesh_input_face(mesh, (uint32_t)face) != first + i)
            continue; /* the input's face has no part */
        if (!qm_face_is_fan_part(mesh, face)) values[i] = value_of(mesh, face, metric);
        while (*place < mesh->face_count && qm_mesh_input_face(mesh, (uint32_t)*place) == first + i)
            ++*place;
    }
}

/** The k-th least of some numbers, counted from 0, which it reorders: all before it are not greater, all after it not
 * less. Pivots are taken at random places, so that no order of the input is a bad one. */
static double select_least(double *values, size_t count, size_t k)
{
    uint64_t random = 0x9e3779b97f4a7c15u ^ count;
    size_t low = 0, high = count;
    while (high - low > 1) {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        double pivot = values[low + random % (high - low)];
        size_t less = low, equal = low, greater = high;
        while (equal < greater) {
            double value = values[equal];
            if (value < pivot) {
                values[equal++] = values[less];
                values[less++] = value;
            } else if (value > pivot) {
                values[equal] = values[--greater];
                values[greater] = value;
            } else {
                equal++;
            }
        }
        if (k < less)
            high = less;
        else if (k >= greater)
            low = greater;
        else
            return pivot;
    }
    return values[low];
}

static void find_percentiles(double *values, size_t count, qm_metric_summary *out)
{
    size_t done = 0;
    for (int i = 0; i < QM_METRIC_PERCENTILES && count > 0; i++) {
        /* The least rank that this share of the values does not exceed. */
        size_t rank = (size_t)ceil(qm_metric_percents[i] / 100.0 * (double)count);
        size_t k = rank > 0 ? rank - 1 : 0;
        if (k >= count) k = count - 1;
        out->percentile[i] = select_least(values + done, count - done, k - done);
        done = k;
    }
}

qm_status qm_metric_summarize(qm_context *ctx, const qm_mesh *mesh, qm_metric metric, qm_metric_summary *out)
{
    QM_ASSERT(ctx && mesh && out);
    *out = (qm_metric_summary){0};
    if (mesh->face_count == 0) return QM_OK;
    double *values = qm_context_alloc(ctx, mesh->face_count, sizeof *values), sum = 0.0;
    if (!values) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the values of faces");
    qm_status status = QM_OK;
    for (size_t f = 0; f < mesh->face_count && status == QM_OK; f++) {
        if (f % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            status = qm_context_fail(ctx, QM_E_CANCELED, "canceled while the faces were measured");
        bool is_quad = qm_face_corners(mesh->faces + 4 * f) == 4;
        if (qm_face_is_fan_part(mesh, f) || !(is_quad || qm_metric_has_triangles(metric))) continue;
        double value = value_of(mesh, f, metric);
        out->undefined += isnan(value) ? 1 : 0;
        if (isnan(value)) continue;
        if (out->faces == 0 || value < out->minimum) {
            out->minimum = value;
            out->minimum_face = qm_mesh_input_face(mesh, (uint32_t)f);
        }
        if (out->faces == 0 || value > out->maximum) {
            out->maximum = value;
            out->maximum_face = qm_mesh_input_face(mesh, (uint32_t)f);
        }
        sum += value;
        values[out->faces++] = value;
    }
    if (out->faces > 0) out->mean = sum / (double)out->faces;
    if (status == QM_OK) find_percentiles(values, out->faces, out);
    qm_context_free(ctx, values, mesh->face_count, sizeof *values);
    return status;
}
