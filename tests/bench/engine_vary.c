/* Variants of a mesh for the benchmark: coarser by clusters of vertices, finer by midpoints, written as a
 * file. */
#include "engine.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/** Something of a mesh, such as a vertex in a cell or an edge of a face, by a key that its like share. */
typedef struct keyed {
    uint64_t key[2];
    size_t item;
} keyed;

static int compare_keys(const void *left, const void *right)
{
    const keyed *a = left, *b = right;
    int order = memcmp(a->key, b->key, sizeof a->key);
    return order != 0 ? order : (a->item > b->item) - (a->item < b->item);
}

/** Numbers the different keys: number[item], for every item. Returns how many there are. */
static uint32_t number_keys(keyed *list, size_t count, uint32_t *number)
{
    uint32_t last = QM_NO_INDEX;
    qsort(list, count, sizeof *list, compare_keys);
    for (size_t i = 0; i < count; i++) {
        if (i == 0 || memcmp(list[i].key, list[i - 1].key, sizeof list->key) != 0) last++;
        number[list[i].item] = last;
    }
    return last + 1;
}

static size_t corner_count(const uint32_t *face)
{
    return face[3] == QM_NO_INDEX ? 3 : 4;
}

static double edge_length(const qm_mesh *mesh, const uint32_t *face, size_t k)
{
    const double *a = mesh->positions + 3 * (size_t)face[k];
    const double *b = mesh->positions + 3 * (size_t)face[(k + 1) % corner_count(face)];
    return hypot(hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
}

static double mean_edge(const qm_mesh *mesh)
{
    double sum = 0.0, count = 0.0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *face = mesh->faces + 4 * f;
        for (size_t k = 0; k < corner_count(face); k++, count++)
            sum += edge_length(mesh, face, k);
    }
    return sum / count;
}

/** Puts a face of other corners in its place: without neighbours that fell together, and not at all when two
 * corners or fewer are left. */
static size_t put_face(uint32_t *faces, size_t place, const uint32_t *corner, size_t count)
{
    uint32_t kept[4] = {0, 0, 0, QM_NO_INDEX};
    size_t left = 0;
    for (size_t k = 0; k < count; k++)
        if (corner[k] != corner[(k + 1) % count]) kept[left++] = corner[k];
    if (left < 3 || (left == 4 && (kept[0] == kept[2] || kept[1] == kept[3]))) return place;
    memcpy(faces + 4 * place, kept, sizeof kept);
    return place + 1;
}

void bench_coarsen(qm_mesh *mesh, double cell)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    double side = cell * mean_edge(mesh);
    keyed *list = bench_alloc(mesh->vertex_count, sizeof *list);
    uint32_t *number = bench_alloc(mesh->vertex_count, sizeof *number);
    double *sum = bench_alloc(mesh->vertex_count, 4 * sizeof *sum);
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        const double *p = mesh->positions + 3 * v;
        uint64_t at[3];
        for (int k = 0; k < 3; k++)
            at[k] = (uint64_t)fmax(0.0, (p[k] - box.min[k]) / side);
        list[v] = (keyed){{at[0] << 32 | at[1], at[2]}, v};
    }
    size_t count = number_keys(list, mesh->vertex_count, number), faces = 0;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        double *into = sum + 4 * (size_t)number[v];
        for (int k = 0; k < 3; k++)
            into[k] += mesh->positions[3 * v + (size_t)k];
        into[3] += 1.0;
    }
    for (size_t v = 0; v < count; v++)
        for (size_t k = 0; k < 3; k++)
            mesh->positions[3 * v + k] = sum[4 * v + k] / sum[4 * v + 3];
    for (size_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *face = mesh->faces + 4 * f;
        uint32_t corner[4];
        for (size_t k = 0; k < corner_count(face); k++)
            corner[k] = number[face[k]];
        faces = put_face(mesh->faces, faces, corner, corner_count(face));
    }
    mesh->vertex_count = count;
    mesh->face_count = faces;
    free(sum);
    free(number);
    free(list);
}

/** Numbers of the edges: edge[4 f + k] begins at corner k of face f. Returns how many there are. */
static uint32_t number_edges(const qm_mesh *mesh, uint32_t *edge)
{
    keyed *list = bench_alloc(mesh->face_count, 4 * sizeof *list);
    size_t count = 0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *face = mesh->faces + 4 * f;
        for (size_t k = 0; k < corner_count(face); k++) {
            uint32_t a = face[k], b = face[(k + 1) % corner_count(face)];
            list[count++] = (keyed){{a < b ? a : b, a < b ? b : a}, 4 * f + k};
        }
    }
    uint32_t edges = number_keys(list, count, edge);
    free(list);
    return edges;
}

/** Four faces for each: a triangle's corners and its middle, or a quad's corners. */
static void split_face(const uint32_t *face, const uint32_t *middle, uint32_t centre, uint32_t *out)
{
    size_t count = corner_count(face);
    for (size_t k = 0; k < count; k++) {
        uint32_t before = middle[(k + count - 1) % count];
        const uint32_t part[4] = {face[k], middle[k], count == 4 ? centre : before,
                                  count == 4 ? before : QM_NO_INDEX};
        memcpy(out + 4 * k, part, sizeof part);
    }
    if (count == 4) return;
    const uint32_t inner[4] = {middle[0], middle[1], middle[2], QM_NO_INDEX};
    memcpy(out + 12, inner, sizeof inner);
}

static void set_mean(qm_mesh *mesh, size_t vertex, const uint32_t *of, size_t count)
{
    for (size_t k = 0; k < 3; k++) {
        double sum = 0.0;
        for (size_t i = 0; i < count; i++)
            sum += mesh->positions[3 * (size_t)of[i] + k];
        mesh->positions[3 * vertex + k] = sum / (double)count;
    }
}

void bench_refine(qm_context *ctx, qm_mesh *mesh)
{
    uint32_t *edge = bench_alloc(mesh->face_count, 4 * sizeof *edge);
    uint32_t *faces = qm_context_alloc(ctx, mesh->face_count, 16 * sizeof *faces);
    size_t first_edge = mesh->vertex_count, centre = first_edge + number_edges(mesh, edge);
    mesh->positions = qm_context_resize(ctx, mesh->positions, 3 * mesh->vertex_count,
                                        3 * (centre + mesh->face_count), sizeof(double));
    if (!faces || !mesh->positions) bench_fail("memory", "there is not enough");
    for (size_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *face = mesh->faces + 4 * f;
        size_t count = corner_count(face);
        uint32_t middle[4];
        for (size_t k = 0; k < count; k++) {
            middle[k] = (uint32_t)first_edge + edge[4 * f + k];
            set_mean(mesh, middle[k], (const uint32_t[2]){face[k], face[(k + 1) % count]}, 2);
        }
        if (count == 4) set_mean(mesh, centre, face, 4);
        split_face(face, middle, (uint32_t)centre, faces + 16 * f);
        centre += count == 4;
    }
    qm_context_free(ctx, mesh->faces, mesh->face_count, 4 * sizeof *mesh->faces);
    mesh->vertex_count = centre;
    mesh->faces = faces;
    mesh->face_count *= 4;
    free(edge);
}

void bench_vary(const char *path, const bench_change *change, const char *out)
{
    qm_context ctx = qm_context_make();
    qm_mesh mesh = bench_read_mesh(&ctx, path, change);
    FILE *file = fopen(out, "w");
    if (!file) bench_fail(out, "cannot be written");
    fprintf(file, "OFF\n%zu %zu 0\n", mesh.vertex_count, mesh.face_count);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        const double *p = mesh.positions + 3 * v;
        fprintf(file, "%.17g %.17g %.17g\n", p[0], p[1], p[2]);
    }
    for (size_t f = 0; f < mesh.face_count; f++) {
        const uint32_t *face = mesh.faces + 4 * f;
        fprintf(file, "%zu", corner_count(face));
        for (size_t k = 0; k < corner_count(face); k++)
            fprintf(file, " %u", face[k]);
        fprintf(file, "\n");
    }
    if (fclose(file) != 0) bench_fail(out, "cannot be written");
    printf("{\"vertices\": %zu, \"faces\": %zu}\n", mesh.vertex_count, mesh.face_count);
    qm_mesh_reset(&ctx, &mesh);
}
