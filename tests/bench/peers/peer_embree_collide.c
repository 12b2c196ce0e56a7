/*
 * peer_embree_collide: pairs of triangles by Embree's rtcCollide for the benchmark.
 *
 *   peer_embree_collide collide A B   all pairs of triangles that meet
 *   peer_embree_collide self MESH     the same of one mesh: pairs without a common corner
 *   peer_embree_collide version
 *
 * A, B and MESH are prefixes of arrays (arrays.h). Embree finds pairs of boxes and hands them over; whether
 * the triangles meet is for the caller to decide: here by the signs of tetrahedra in doubles, without exactness.
 */
#include "arrays.h"
#include "measure.h"
#include "pair_print.h"

#include <embree3/rtcore.h>
#include <string.h>

typedef struct mesh {
    double (*vertices)[3];
    uint32_t (*triangles)[3];
    size_t vertex_count, triangle_count;
} mesh;

typedef struct search {
    const mesh *a, *b;
    bool is_self;
    uint64_t *pairs;
    size_t count, capacity;
} search;

static void bound_triangle(const struct RTCBoundsFunctionArguments *arguments)
{
    const mesh *given = arguments->geometryUserPtr;
    const uint32_t *corner = given->triangles[arguments->primID];
    float low[3], high[3];
    for (int k = 0; k < 3; k++) {
        double least = given->vertices[corner[0]][k], most = least;
        for (int i = 1; i < 3; i++) {
            double x = given->vertices[corner[i]][k];
            least = x < least ? x : least;
            most = x > most ? x : most;
        }
        low[k] = (float)least - 1e-7f;
        high[k] = (float)most + 1e-7f;
    }
    *arguments->bounds_o = (struct RTCBounds){.lower_x = low[0],
                                              .lower_y = low[1],
                                              .lower_z = low[2],
                                              .upper_x = high[0],
                                              .upper_y = high[1],
                                              .upper_z = high[2]};
}

static double volume(const double *a, const double *b, const double *c, const double *d)
{
    double u[3], v[3], w[3];
    for (int k = 0; k < 3; k++) {
        u[k] = b[k] - a[k];
        v[k] = c[k] - a[k];
        w[k] = d[k] - a[k];
    }
    return w[0] * (u[1] * v[2] - u[2] * v[1]) + w[1] * (u[2] * v[0] - u[0] * v[2]) +
           w[2] * (u[0] * v[1] - u[1] * v[0]);
}

/** An edge p q through the triangle t. */
static bool edge_meets(const double *p, const double *q, const double *const t[3])
{
    double at_p = volume(t[0], t[1], t[2], p), at_q = volume(t[0], t[1], t[2], q);
    if (at_p * at_q > 0.0) return false;
    double x = volume(p, q, t[0], t[1]), y = volume(p, q, t[1], t[2]), z = volume(p, q, t[2], t[0]);
    return (x >= 0.0 && y >= 0.0 && z >= 0.0) || (x <= 0.0 && y <= 0.0 && z <= 0.0);
}

static bool triangles_meet(const double *const a[3], const double *const b[3])
{
    for (int i = 0; i < 3; i++)
        if (edge_meets(a[i], a[(i + 1) % 3], b) || edge_meets(b[i], b[(i + 1) % 3], a)) return true;
    return false;
}

static bool share_corner(const uint32_t a[3], const uint32_t b[3])
{
    for (int i = 0; i < 9; i++)
        if (a[i / 3] == b[i % 3]) return true;
    return false;
}

static void take_pairs(void *user, struct RTCCollision *found, unsigned count)
{
    search *s = user;
    for (unsigned i = 0; i < count; i++) {
        unsigned x = found[i].primID0, y = found[i].primID1;
        const uint32_t *a = s->a->triangles[x], *b = s->b->triangles[y];
        if (s->is_self && (x >= y || share_corner(a, b))) continue;
        const double *const p[3] = {s->a->vertices[a[0]], s->a->vertices[a[1]], s->a->vertices[a[2]]};
        const double *const q[3] = {s->b->vertices[b[0]], s->b->vertices[b[1]], s->b->vertices[b[2]]};
        if (!triangles_meet(p, q)) continue;
        if (s->count == s->capacity) {
            s->capacity = s->capacity > 0 ? 2 * s->capacity : 1024;
            s->pairs = realloc(s->pairs, s->capacity * sizeof *s->pairs);
            if (!s->pairs) exit(EXIT_FAILURE);
        }
        s->pairs[s->count++] = qm_bench_pair(x, y);
    }
}

static mesh read_mesh(const char *prefix)
{
    mesh read;
    read.vertices = qm_bench_read_part(prefix, "vertices", sizeof *read.vertices, &read.vertex_count);
    read.triangles = qm_bench_read_part(prefix, "triangles", sizeof *read.triangles, &read.triangle_count);
    return read;
}

static RTCScene build_scene(RTCDevice device, mesh *given)
{
    RTCScene scene = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    rtcSetGeometryUserPrimitiveCount(geometry, (unsigned)given->triangle_count);
    rtcSetGeometryUserData(geometry, given);
    rtcSetGeometryBoundsFunction(geometry, bound_triangle, NULL);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

/** b is NULL for a mesh with itself. */
static void measure_collision(mesh *a, mesh *b)
{
    RTCDevice device = rtcNewDevice("threads=1");
    search s = {.a = a, .b = b ? b : a, .is_self = !b};
    long resting_kb = qm_bench_rest();
    qm_bench_times times = {0};
    do {
        s.count = 0;
        double start = qm_bench_now_ms();
        RTCScene scene_a = build_scene(device, a), scene_b = b ? build_scene(device, b) : scene_a;
        double built = qm_bench_now_ms();
        rtcCollide(scene_a, scene_b, take_pairs, &s);
        qm_bench_add(&times, built - start, qm_bench_now_ms() - built);
        if (b) rtcReleaseScene(scene_b);
        rtcReleaseScene(scene_a);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    printf(", ");
    qm_bench_print_pairs(s.pairs, s.count);
    printf("}\n");
    rtcReleaseDevice(device);
    free(s.pairs);
}

int main(int argc, char **argv)
{
    if (argc == 4 && strcmp(argv[1], "collide") == 0) {
        mesh a = read_mesh(argv[2]), b = read_mesh(argv[3]);
        measure_collision(&a, &b);
    } else if (argc == 3 && strcmp(argv[1], "self") == 0) {
        mesh a = read_mesh(argv[2]);
        measure_collision(&a, NULL);
    } else if (argc == 2 && strcmp(argv[1], "version") == 0) {
        printf("{\"version\": \"%s\"}\n", RTC_VERSION_STRING);
    } else {
        fputs("usage: peer_embree_collide collide A B | self MESH | version\n", stderr);
        return 2;
    }
    return EXIT_SUCCESS;
}
