#include "shapes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void *allocate(size_t count, size_t width)
{
    void *block = calloc(count, width);
    if (!block) {
        fprintf(stderr, "out of memory for a test mesh\n");
        abort();
    }
    return block;
}

void qm_shape_free(qm_mesh *mesh)
{
    free(mesh->grids);
    free(mesh->positions);
    free(mesh->faces);
    free(mesh->face_origin);
    *mesh = (qm_mesh){0};
}

qm_mesh qm_shape_make(size_t vertex_count, size_t face_count)
{
    qm_mesh mesh = {.vertex_count = vertex_count, .face_count = face_count};
    if (vertex_count > 0) mesh.positions = allocate(vertex_count, 3 * sizeof *mesh.positions);
    if (face_count > 0) mesh.faces = allocate(face_count, 4 * sizeof *mesh.faces);
    return mesh;
}

static void set_face(qm_mesh *mesh, size_t face, size_t c0, size_t c1, size_t c2, size_t c3)
{
    uint32_t *corners = mesh->faces + 4 * face;
    corners[0] = (uint32_t)c0;
    corners[1] = (uint32_t)c1;
    corners[2] = (uint32_t)c2;
    corners[3] = (uint32_t)c3;
}

qm_mesh qm_shape_grid(int columns, int rows, bool wrap_u, bool wrap_v, qm_shape_fn *at, const void *user)
{
    size_t nu = (size_t)columns + !wrap_u, nv = (size_t)rows + !wrap_v;
    qm_mesh mesh = qm_shape_make(nu * nv, (size_t)columns * (size_t)rows);
    for (size_t j = 0; j < nv; ++j)
        for (size_t i = 0; i < nu; ++i)
            at(user, (double)i / columns, (double)j / rows, mesh.positions + 3 * (j * nu + i));
    size_t face = 0;
    for (size_t j = 0; j < (size_t)rows; ++j)
        for (size_t i = 0; i < (size_t)columns; ++i) {
            size_t i1 = (i + 1) % nu, j1 = (j + 1) % nv;
            set_face(&mesh, face++, j * nu + i, j * nu + i1, j1 * nu + i1, j1 * nu + i);
        }
    return mesh;
}

static void sphere_at(const void *user, double u, double v, double out[3])
{
    double longitude = 2 * M_PI * u + *(const double *)user, latitude = M_PI * (1 + 48 * v) / 50;
    out[0] = sin(latitude) * cos(longitude);
    out[1] = sin(latitude) * sin(longitude);
    out[2] = cos(latitude);
}

qm_mesh qm_shape_sphere(double turn)
{
    return qm_shape_grid(100, 48, true, false, sphere_at, &turn);
}

static void torus_at(const void *user, double u, double v, double out[3])
{
    const double *radii = user;
    double ring = radii[0] + radii[1] * cos(2 * M_PI * v);
    out[0] = ring * cos(2 * M_PI * u);
    out[1] = ring * sin(2 * M_PI * u);
    out[2] = radii[1] * sin(2 * M_PI * v);
}

qm_mesh qm_shape_torus(int columns, int rows, double major, double minor)
{
    double radii[2] = {major, minor};
    return qm_shape_grid(columns, rows, true, true, torus_at, radii);
}

static void saddle_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    out[0] = 2 * u - 1;
    out[1] = 2 * v - 1;
    out[2] = out[0] * out[1];
}

qm_mesh qm_shape_saddle(int n)
{
    return qm_shape_grid(n, n, false, false, saddle_at, NULL);
}

static void strip_at(const void *user, double u, double v, double out[3])
{
    double angle = *(const double *)user * u;
    out[0] = 4 * u;
    out[1] = (v - 0.5) * cos(angle);
    out[2] = (v - 0.5) * sin(angle);
}

qm_mesh qm_shape_strip(int columns, int rows, double twist)
{
    return qm_shape_grid(columns, rows, false, false, strip_at, &twist);
}

static void plane_at(const void *user, double u, double v, double out[3])
{
    out[0] = u;
    out[1] = v;
    out[2] = *(const double *)user;
}

qm_mesh qm_shape_plane(int n, double height)
{
    return qm_shape_grid(n, n, false, false, plane_at, &height);
}

typedef struct waves {
    double height, turn;
} waves;

static void wave_at(const void *user, double u, double v, double out[3])
{
    const waves *w = user;
    out[0] = u;
    out[1] = v;
    out[2] = w->height * sin(5.0 * u + w->turn) * cos(4.0 * v - w->turn);
}

qm_mesh qm_shape_waves(int n, double height, double turn)
{
    const waves w = {height, turn};
    return qm_shape_grid(n, n, false, false, wave_at, &w);
}

qm_mesh qm_shape_box(double sx, double sy, double sz)
{
    static const uint32_t sides[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                         {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    qm_mesh mesh = qm_shape_make(8, 6);
    memcpy(mesh.faces, sides, sizeof sides);
    for (size_t v = 0; v < 8; ++v) {
        mesh.positions[3 * v] = v & 1 ? sx : 0;
        mesh.positions[3 * v + 1] = v & 2 ? sy : 0;
        mesh.positions[3 * v + 2] = v & 4 ? sz : 0;
    }
    return mesh;
}

qm_mesh qm_shape_cube(double half)
{
    qm_mesh cube = qm_shape_box(2 * half, 2 * half, 2 * half);
    const double shift[3] = {-half, -half, -half};
    qm_shape_move(&cube, 1.0, shift);
    return cube;
}

qm_mesh qm_shape_face(int count, const double corners[][3])
{
    qm_mesh mesh = qm_shape_make((size_t)count, 1);
    memcpy(mesh.positions, corners, (size_t)count * 3 * sizeof(double));
    set_face(&mesh, 0, 0, 1, 2, count == 4 ? 3 : QM_NO_INDEX);
    return mesh;
}

qm_mesh qm_shape_points(qm_random *random, size_t count)
{
    qm_mesh mesh = qm_shape_make(count, 0);
    for (size_t v = 0; v < count; ++v)
        qm_random_point(random, -1, 1, mesh.positions + 3 * v);
    return mesh;
}

qm_mesh qm_shape_copies(size_t count)
{
    static const double corners[3][3] = {{0, 0, 0}, {1, 0, 0.25}, {0, 1, 0.5}};
    qm_mesh mesh = qm_shape_make(3, count);
    memcpy(mesh.positions, corners, sizeof corners);
    for (size_t f = 0; f < count; ++f)
        set_face(&mesh, f, 0, 1, 2, QM_NO_INDEX);
    return mesh;
}

/** A parallelogram of random size and place, its third corner moved by up to twist edge lengths. */
static void place_apart(qm_random *random, double *corners, double twist)
{
    double origin[3], side[2][3], move[3];
    qm_random_point(random, -0.7, 0.7, origin);
    double size = qm_random_range(random, 0.05, 0.6);
    for (int i = 0; i < 2; ++i)
        qm_random_direction(random, side[i]);
    qm_random_direction(random, move);
    double moved = twist * size * qm_random_range(random, 0, 1);
    for (int k = 0; k < 3; ++k) {
        corners[k] = origin[k];
        corners[3 + k] = origin[k] + size * side[0][k];
        corners[6 + k] = origin[k] + size * (side[0][k] + side[1][k]) + moved * move[k];
        corners[9 + k] = origin[k] + size * side[1][k];
    }
}

static void place_pooled(qm_random *random, qm_soup_style style, const double line[2][3], double *out)
{
    qm_random_point(random, -1, 1, out);
    if (style == QM_SOUP_LATTICE)
        for (int k = 0; k < 3; ++k)
            out[k] = round(out[k] * 1.4);
    if (style == QM_SOUP_COPLANAR) out[2] = 0.25 * out[0] - 0.5 * out[1];
    if (style == QM_SOUP_NEEDLES)
        for (int k = 1; k < 3; ++k)
            out[k] *= pow(10, qm_random_range(random, -9, -1));
    if (style == QM_SOUP_DEGENERATE && qm_random_below(random, 2) == 0) {
        double t = (double)qm_random_below(random, 5) / 4;
        for (int k = 0; k < 3; ++k)
            out[k] = line[0][k] + t * (line[1][k] - line[0][k]);
    }
}

/** Indices into the pool: different ones, but for degenerate soups, which may repeat them. */
static void choose_corners(qm_random *random, size_t pool, bool repeat, uint32_t corners[4])
{
    for (int i = 0; i < 4; ++i) {
        bool taken = true;
        while (taken) {
            corners[i] = (uint32_t)qm_random_below(random, pool);
            taken = false;
            for (int j = 0; j < i; ++j)
                taken = taken || (!repeat && corners[j] == corners[i]);
        }
    }
}

qm_mesh qm_shape_soup(qm_random *random, size_t face_count, qm_soup_corners corners, qm_soup_style style,
                      double twist)
{
    size_t pool = style == QM_SOUP_APART ? 4 * face_count : 4 + face_count;
    qm_mesh mesh = qm_shape_make(pool, face_count);
    double line[2][3];
    qm_random_point(random, -1, 1, line[0]);
    qm_random_point(random, -1, 1, line[1]);
    for (size_t v = 0; v < pool && style != QM_SOUP_APART; ++v)
        place_pooled(random, style, line, mesh.positions + 3 * v);
    for (size_t f = 0; f < face_count; ++f) {
        uint32_t *face = mesh.faces + 4 * f;
        if (style == QM_SOUP_APART) {
            place_apart(random, mesh.positions + 12 * f, twist);
            set_face(&mesh, f, 4 * f, 4 * f + 1, 4 * f + 2, 4 * f + 3);
        } else {
            choose_corners(random, pool, style == QM_SOUP_DEGENERATE, face);
        }
        bool triangle =
            corners == QM_SOUP_TRIANGLES || (corners == QM_SOUP_MIXED && qm_random_below(random, 2) == 0);
        if (triangle) face[3] = QM_NO_INDEX;
    }
    return mesh;
}

qm_mesh qm_shape_reversed(const qm_mesh *mesh)
{
    qm_mesh reversed = qm_shape_copy(mesh);
    size_t count = mesh->face_count > 0 ? mesh->face_count : mesh->vertex_count;
    for (size_t i = 0; i < count; i++) {
        if (mesh->face_count > 0)
            memcpy(reversed.faces + 4 * i, mesh->faces + 4 * (count - 1 - i), 4 * sizeof *mesh->faces);
        else
            memcpy(reversed.positions + 3 * i, mesh->positions + 3 * (count - 1 - i),
                   3 * sizeof *mesh->positions);
    }
    return reversed;
}

qm_mesh qm_shape_copy(const qm_mesh *mesh)
{
    qm_mesh copy = qm_shape_make(mesh->vertex_count, mesh->face_count);
    if (mesh->vertex_count > 0)
        memcpy(copy.positions, mesh->positions, 3 * mesh->vertex_count * sizeof *copy.positions);
    if (mesh->face_count > 0) memcpy(copy.faces, mesh->faces, 4 * mesh->face_count * sizeof *copy.faces);
    if (mesh->face_origin) {
        copy.face_origin = allocate(mesh->face_count, sizeof *copy.face_origin);
        memcpy(copy.face_origin, mesh->face_origin, mesh->face_count * sizeof *copy.face_origin);
    }
    copy.polygon_count = mesh->polygon_count;
    return copy;
}

qm_mesh qm_shape_triangulated(const qm_mesh *mesh)
{
    qm_mesh out = qm_shape_make(mesh->vertex_count, 2 * mesh->face_count);
    memcpy(out.positions, mesh->positions, 3 * mesh->vertex_count * sizeof *out.positions);
    out.face_count = 0;
    for (size_t f = 0; f < mesh->face_count; ++f) {
        const uint32_t *face = mesh->faces + 4 * f;
        set_face(&out, out.face_count++, face[0], face[1], face[2], QM_NO_INDEX);
        if (face[3] != QM_NO_INDEX) set_face(&out, out.face_count++, face[0], face[2], face[3], QM_NO_INDEX);
    }
    return out;
}

/** The vertex in the middle of an edge, which is added unless a face before had that edge. */
static uint32_t midpoint(qm_mesh *mesh, size_t first, uint32_t (*edge)[2], uint32_t a, uint32_t b)
{
    uint32_t low = a < b ? a : b, high = a < b ? b : a;
    for (size_t v = first; v < mesh->vertex_count; ++v)
        if (edge[v - first][0] == low && edge[v - first][1] == high) return (uint32_t)v;
    for (size_t k = 0; k < 3; ++k)
        mesh->positions[3 * mesh->vertex_count + k] =
            0.5 * (mesh->positions[3 * low + k] + mesh->positions[3 * high + k]);
    edge[mesh->vertex_count - first][0] = low;
    edge[mesh->vertex_count - first][1] = high;
    return (uint32_t)mesh->vertex_count++;
}

qm_mesh qm_shape_refined(const qm_mesh *mesh)
{
    qm_mesh out = qm_shape_make(mesh->vertex_count + 3 * mesh->face_count, 4 * mesh->face_count);
    uint32_t(*edge)[2] = allocate(3 * mesh->face_count, sizeof *edge);
    memcpy(out.positions, mesh->positions, 3 * mesh->vertex_count * sizeof *out.positions);
    out.vertex_count = mesh->vertex_count;
    for (size_t f = 0; f < mesh->face_count; ++f) {
        const uint32_t *c = mesh->faces + 4 * f;
        uint32_t m[3];
        for (int i = 0; i < 3; ++i)
            m[i] = midpoint(&out, mesh->vertex_count, edge, c[i], c[(i + 1) % 3]);
        for (size_t i = 0; i < 3; ++i)
            set_face(&out, 4 * f + i, c[i], m[i], m[(i + 2) % 3], QM_NO_INDEX);
        set_face(&out, 4 * f + 3, m[0], m[1], m[2], QM_NO_INDEX);
    }
    free(edge);
    return out;
}

qm_mesh qm_shape_cube_grid(int n)
{
    size_t side = (size_t)n + 1, total = side * side * side;
    uint32_t *number = allocate(total, sizeof *number), count = 0;
    for (size_t i = 0; i < total; i++) {
        size_t x = i % side, y = i / side % side, z = i / side / side, last = side - 1;
        bool is_outer = x == 0 || y == 0 || z == 0 || x == last || y == last || z == last;
        number[i] = is_outer ? count++ : QM_NO_INDEX;
    }
    qm_mesh m = qm_shape_make(count, 6 * (size_t)n * (size_t)n);
    for (size_t i = 0; i < total; i++) {
        if (number[i] == QM_NO_INDEX) continue;
        double *p = m.positions + 3 * (size_t)number[i];
        p[0] = 2.0 * (double)(i % side) / n - 1.0;
        p[1] = 2.0 * (double)(i / side % side) / n - 1.0;
        p[2] = 2.0 * (double)(i / side / side) / n - 1.0;
    }
    const size_t stride[3] = {1, side, side * side};
    uint32_t *face = m.faces;
    for (int axis = 0; axis < 3; axis++) {
        for (int end = 0; end < 2; end++) {
            size_t u = stride[(axis + 1) % 3], v = stride[(axis + 2) % 3],
                   base = (size_t)end * (side - 1) * stride[axis];
            for (size_t j = 0; j < side - 1; j++) {
                for (size_t i = 0; i < side - 1; i++, face += 4) {
                    size_t at = base + i * u + j * v;
                    face[0] = number[at], face[2] = number[at + u + v];
                    face[end ? 1 : 3] = number[at + u], face[end ? 3 : 1] = number[at + v];
                }
            }
        }
    }
    free(number);
    return m;
}

qm_mesh qm_shape_joined(const qm_mesh *a, const qm_mesh *b)
{
    qm_mesh out = qm_shape_make(a->vertex_count + b->vertex_count, a->face_count + b->face_count);
    memcpy(out.positions, a->positions, 3 * a->vertex_count * sizeof *out.positions);
    memcpy(out.positions + 3 * a->vertex_count, b->positions, 3 * b->vertex_count * sizeof *out.positions);
    memcpy(out.faces, a->faces, 4 * a->face_count * sizeof *out.faces);
    for (size_t i = 0; i < 4 * b->face_count; ++i) {
        uint32_t corner = b->faces[i];
        out.faces[4 * a->face_count + i] =
            corner == QM_NO_INDEX ? corner : corner + (uint32_t)a->vertex_count;
    }
    return out;
}

qm_mesh qm_shape_with_unused(const qm_mesh *mesh, size_t count, const double position[3])
{
    qm_mesh out = qm_shape_make(mesh->vertex_count + 2 * count, mesh->face_count);
    for (size_t v = 0; v < out.vertex_count; ++v)
        memcpy(out.positions + 3 * v, position, 3 * sizeof *position);
    memcpy(out.positions + 3 * count, mesh->positions, 3 * mesh->vertex_count * sizeof *out.positions);
    for (size_t i = 0; i < 4 * mesh->face_count; ++i) {
        uint32_t corner = mesh->faces[i];
        out.faces[i] = corner == QM_NO_INDEX ? corner : corner + (uint32_t)count;
    }
    return out;
}

void qm_shape_move(qm_mesh *mesh, double scale, const double shift[3])
{
    for (size_t i = 0; i < 3 * mesh->vertex_count; ++i)
        mesh->positions[i] = scale * mesh->positions[i] + shift[i % 3];
}

void qm_shape_shake(qm_mesh *mesh, qm_random *random, double amplitude)
{
    for (size_t i = 0; i < 3 * mesh->vertex_count; ++i)
        mesh->positions[i] += qm_random_range(random, -amplitude, amplitude);
}
