/**
 * reconstruct_bending.c: the curvatures of which the bending energy is made.
 *
 * The energy is that of a thin plate: the integral of the squares of the curvatures along rows and columns and twice that of the
 * twist, kappa_uu^2 + kappa_vv^2 + 2 kappa_uv^2, which does not depend on the directions of the lines. Lines run on across the
 * borders of patches, through all vertices of four quads, so that a border is as smooth as the inside. Round other vertices half the
 * square of the sum of both curvatures stands for it: by the mean of the neighbours less the vertex.
 *
 * Moves are along the normals, and curvatures linear in them: of a line with edges of length a and b from x to y and z,
 * kappa = 2 / (a + b) ((y - x) / a + (z - x) / b) . n. The minimum of the energy alone is then not a plane but what has no
 * variation of curvature: the gradient is the fourth derivative of the moves plus the second one of the curvatures, which is 0
 * on planes and spheres, and of second order on others. A line that turns sharply is a crease, and not faired.
 */
#include "reconstruct_bending.h"

#include <math.h>

#define CREASE_COSINE 0.6 /* of the angle by which a line turns: 53 degrees */
#define MIN_LENGTH 0.2    /* of the mean edge: shorter ones count as this long */

enum { MAX_RING = QM_BEND_VERTICES - 1 };

/** The corners at each vertex: face and corner as 4 face + corner. */
typedef struct corner_lists {
    size_t *start;
    uint32_t *corner;
} corner_lists;

static uint32_t turn(const qm_mesh *mesh, uint32_t corner, uint32_t by)
{
    return mesh->faces[(corner & ~3u) + ((corner + by) & 3u)];
}

static qm_vec at(const qm_mesh *mesh, uint32_t vertex)
{
    return qm_vec_load(mesh->positions + 3 * (size_t)vertex);
}

static double face_area(const qm_mesh *mesh, size_t face)
{
    const uint32_t *v = mesh->faces + 4 * face;
    return 0.5 * qm_vec_norm(qm_vec_cross(qm_vec_sub(at(mesh, v[2]), at(mesh, v[0])),
                                          qm_vec_sub(at(mesh, v[3]), at(mesh, v[1]))));
}

/** The corners round a vertex in order, anticlockwise. Returns their number, 0 where they are no fan; is_closed if the fan is. */
static int order_corners(const qm_mesh *mesh, const corner_lists *lists, uint32_t vertex,
                         uint32_t out[MAX_RING], bool *is_closed)
{
    const uint32_t *list = lists->corner + lists->start[vertex];
    size_t count = lists->start[vertex + 1] - lists->start[vertex];
    if (count == 0 || count > MAX_RING) return 0;
    /* The first corner is one that none precedes, if there is such a one. */
    uint32_t first = list[0];
    *is_closed = true;
    for (size_t i = 0; i < count; i++) {
        bool is_preceded = false;
        for (size_t k = 0; k < count; k++)
            is_preceded |= turn(mesh, list[k], 3) == turn(mesh, list[i], 1);
        if (is_preceded) continue;
        first = list[i];
        *is_closed = false;
    }
    out[0] = first;
    for (size_t i = 1; i < count; i++) {
        uint32_t next = QM_NO_INDEX;
        for (size_t k = 0; k < count; k++)
            if (turn(mesh, list[k], 1) == turn(mesh, out[i - 1], 3)) next = list[k];
        if (next == QM_NO_INDEX || next == first) return 0;
        out[i] = next;
    }
    return (int)count;
}

static void add_bend(qm_bending *bending, const qm_mesh *mesh, qm_vec normal, double weight, qm_bend bend)
{
    QM_ASSERT(bending->count < bending->capacity);
    qm_vec origin = at(mesh, bend.vertex[0]); /* the factors sum to 0 */
    bend.curvature = 0.0;
    bend.weight = weight;
    for (int k = 0; k < bend.count; k++)
        bend.curvature += bend.factor[k] * qm_vec_dot(qm_vec_sub(at(mesh, bend.vertex[k]), origin), normal);
    bending->bends[bending->count++] = bend;
}

/** Adds the curvature of a line through three vertices, unless it is a crease. */
static void add_line(qm_bending *bending, const qm_mesh *mesh, const qm_vec *normal, uint32_t before,
                     uint32_t here, uint32_t after, double weight, double shortest)
{
    qm_vec back = qm_vec_sub(at(mesh, before), at(mesh, here)),
           on = qm_vec_sub(at(mesh, after), at(mesh, here));
    double a = fmax(qm_vec_norm(back), shortest), b = fmax(qm_vec_norm(on), shortest);
    if (-qm_vec_dot(back, on) < CREASE_COSINE * a * b) return;
    double f = 2.0 / (a + b);
    add_bend(bending, mesh, normal[here], weight,
             (qm_bend){3, {here, before, after}, {-f * (1.0 / a + 1.0 / b), f / a, f / b}, 0.0, 0.0});
}

/** Adds the curvatures at a vertex with a share of the area. */
static void add_vertex(qm_bending *bending, const qm_mesh *mesh, const qm_vec *normal,
                       const corner_lists *lists, uint32_t vertex, double area, double shortest)
{
    uint32_t corner[MAX_RING];
    bool is_closed;
    int count = order_corners(mesh, lists, vertex, corner, &is_closed);
    if (count == 4 && is_closed) {
        add_line(bending, mesh, normal, turn(mesh, corner[0], 1), vertex, turn(mesh, corner[1], 3), area,
                 shortest);
        add_line(bending, mesh, normal, turn(mesh, corner[0], 3), vertex, turn(mesh, corner[2], 3), area,
                 shortest);
    } else if (count == 2 && !is_closed) {
        add_line(bending, mesh, normal, turn(mesh, corner[0], 1), vertex, turn(mesh, corner[1], 3), area,
                 shortest);
    } else if (count >= 3 && is_closed) {
        double mean = 0.0;
        for (int k = 0; k < count; k++)
            mean += qm_vec_distance(at(mesh, turn(mesh, corner[k], 1)), at(mesh, vertex)) / count;
        double f = 4.0 / (fmax(mean, shortest) * fmax(mean, shortest));
        qm_bend bend = {.count = count + 1, .vertex = {vertex}, .factor = {-f}};
        for (int k = 0; k < count; k++) {
            bend.vertex[k + 1] = turn(mesh, corner[k], 1);
            bend.factor[k + 1] = f / count;
        }
        add_bend(bending, mesh, normal[vertex], 0.5 * area, bend);
    }
}

/** Adds the twist of a quad. */
static void add_twist(qm_bending *bending, const qm_mesh *mesh, const qm_vec *normal, size_t face,
                      double area, double shortest)
{
    const uint32_t *v = mesh->faces + 4 * face;
    double edge[4];
    qm_vec mean = {0, 0, 0};
    for (int k = 0; k < 4; k++) {
        edge[k] = qm_vec_distance(at(mesh, v[k]), at(mesh, v[(k + 1) % 4]));
        mean = qm_vec_add(mean, normal[v[k]]);
    }
    double length = qm_vec_norm(mean);
    if (!(length > 0.0)) return;
    double f = 4.0 / (fmax(edge[0] + edge[2], 2.0 * shortest) * fmax(edge[1] + edge[3], 2.0 * shortest));
    add_bend(bending, mesh, qm_vec_scale(1.0 / length, mean), 2.0 * area,
             (qm_bend){4, {v[0], v[1], v[2], v[3]}, {f, -f, f, -f}, 0.0, 0.0});
}

static qm_status list_corners(qm_context *ctx, const qm_mesh *mesh, corner_lists *out)
{
    size_t vertices = mesh->vertex_count, corners = 4 * mesh->face_count;
    out->start = qm_context_alloc(ctx, vertices + 2, sizeof *out->start);
    out->corner = qm_context_alloc(ctx, corners, sizeof *out->corner);
    if (!out->start || !out->corner)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the bending");
    for (size_t i = 0; i <= vertices + 1; i++)
        out->start[i] = 0;
    for (size_t c = 0; c < corners; c++)
        out->start[mesh->faces[c] + 2]++;
    for (size_t i = 2; i <= vertices + 1; i++)
        out->start[i] += out->start[i - 1];
    for (size_t c = 0; c < corners; c++)
        out->corner[out->start[mesh->faces[c] + 1]++] = (uint32_t)c;
    return QM_OK;
}

qm_status qm_bending_create(qm_context *ctx, const qm_mesh *mesh, const qm_vec *normal, qm_bending *out)
{
    QM_ASSERT(ctx && mesh && normal && out);
    size_t vertices = mesh->vertex_count, corners = 4 * mesh->face_count;
    *out = (qm_bending){.capacity = 2 * vertices + mesh->face_count};
    corner_lists lists = {0};
    qm_status status = list_corners(ctx, mesh, &lists);
    out->bends = qm_context_alloc(ctx, out->capacity, sizeof *out->bends);
    if (status == QM_OK && !out->bends)
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the bending");
    if (status == QM_OK) {
        double length = 0.0;
        for (size_t c = 0; c < corners; c++)
            length += qm_vec_distance(at(mesh, mesh->faces[c]), at(mesh, turn(mesh, (uint32_t)c, 1)));
        double shortest = MIN_LENGTH * length / (double)corners;
        for (size_t face = 0; face < mesh->face_count; face++) {
            double area = face_area(mesh, face);
            out->area += area;
            if (shortest > 0.0) add_twist(out, mesh, normal, face, area, shortest);
        }
        for (uint32_t v = 0; v < (uint32_t)vertices && shortest > 0.0; v++) {
            double area = 0.0;
            for (size_t k = lists.start[v]; k < lists.start[v + 1]; k++)
                area += 0.25 * face_area(mesh, lists.corner[k] / 4);
            add_vertex(out, mesh, normal, &lists, v, area, shortest);
        }
    }
    qm_context_free(ctx, lists.start, vertices + 2, sizeof *lists.start);
    qm_context_free(ctx, lists.corner, corners, sizeof *lists.corner);
    if (status != QM_OK) qm_bending_reset(ctx, out);
    return status;
}

void qm_bending_reset(qm_context *ctx, qm_bending *bending)
{
    qm_context_free(ctx, bending->bends, bending->capacity, sizeof *bending->bends);
    *bending = (qm_bending){0};
}
