/*
 * peer_embree: Embree's answers for the benchmark, in single precision, as Embree is.
 *
 *   peer_embree project MESH POINTS   nearest points; MESH is a prefix of arrays (arrays.h)
 *   peer_embree version
 *
 * Embree walks its tree and hands over each triangle in reach; the nearest point of a triangle is the
 * caller's to find. Source of that: Ericson, Real-Time Collision Detection, 2005, section 5.1.5.
 */
#include "arrays.h"
#include "measure.h"

#include <embree3/rtcore.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

typedef struct vec3 {
    float x, y, z;
} vec3;

typedef struct mesh {
    vec3 *vertices;
    uint32_t (*triangles)[3];
    size_t vertex_count, triangle_count;
} mesh;

typedef struct nearest {
    const mesh *mesh;
    unsigned triangle;
} nearest;

static inline vec3 subtract(vec3 a, vec3 b)
{
    return (vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline float dot(vec3 a, vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

/** p less s times a less t times b, its square. */
static inline float square_of_rest(vec3 p, vec3 a, float s, vec3 b, float t)
{
    vec3 rest = {p.x - s * a.x - t * b.x, p.y - s * a.y - t * b.y, p.z - s * a.z - t * b.z};
    return dot(rest, rest);
}

static float square_distance(vec3 p, vec3 a, vec3 b, vec3 c)
{
    vec3 ab = subtract(b, a), ac = subtract(c, a), ap = subtract(p, a);
    float d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0.0f && d2 <= 0.0f) return dot(ap, ap);
    vec3 bp = subtract(p, b);
    float d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0.0f && d4 <= d3) return dot(bp, bp);
    vec3 cp = subtract(p, c);
    float d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0.0f && d5 <= d6) return dot(cp, cp);
    float vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0f && d1 >= 0.0f && d3 <= 0.0f) return square_of_rest(ap, ab, d1 / (d1 - d3), ac, 0.0f);
    float vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0f && d2 >= 0.0f && d6 <= 0.0f) return square_of_rest(ap, ab, 0.0f, ac, d2 / (d2 - d6));
    float va = d3 * d6 - d5 * d4;
    if (va <= 0.0f && d4 >= d3 && d5 >= d6) {
        float t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return square_of_rest(ap, ab, 1.0f - t, ac, t);
    }
    float scale = 1.0f / (va + vb + vc);
    return square_of_rest(ap, ab, vb * scale, ac, vc * scale);
}

static bool visit_triangle(struct RTCPointQueryFunctionArguments *arguments)
{
    nearest *best = arguments->userPtr;
    const struct RTCPointQuery *query = arguments->query;
    const uint32_t *corner = best->mesh->triangles[arguments->primID];
    const vec3 *v = best->mesh->vertices;
    vec3 p = {query->x, query->y, query->z};
    float distance = sqrtf(square_distance(p, v[corner[0]], v[corner[1]], v[corner[2]]));
    if (!(distance < query->radius)) return false;
    arguments->query->radius = distance;
    best->triangle = arguments->primID;
    return true;
}

static mesh read_mesh(const char *prefix)
{
    mesh read;
    double *position = qm_bench_read_part(prefix, "vertices", 3 * sizeof *position, &read.vertex_count);
    read.triangles = qm_bench_read_part(prefix, "triangles", sizeof *read.triangles, &read.triangle_count);
    /* Embree loads 16 bytes from the start of the last vertex. */
    read.vertices = calloc(read.vertex_count + 1, sizeof *read.vertices);
    for (size_t i = 0; read.vertices && i < read.vertex_count; i++)
        read.vertices[i] =
            (vec3){(float)position[3 * i], (float)position[3 * i + 1], (float)position[3 * i + 2]};
    free(position);
    return read;
}

static RTCScene build_scene(RTCDevice device, const mesh *given)
{
    RTCScene scene = rtcNewScene(device);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_HIGH);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, given->vertices, 0,
                               sizeof *given->vertices, given->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, given->triangles, 0,
                               sizeof *given->triangles, given->triangle_count);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    rtcCommitScene(scene);
    return scene;
}

static void project(RTCScene scene, const mesh *given, const vec3 *points, size_t count, double *distances,
                    unsigned *faces)
{
    struct RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    for (size_t i = 0; i < count; i++) {
        struct RTCPointQuery query = {points[i].x, points[i].y, points[i].z, 0.0f, INFINITY};
        nearest best = {given, RTC_INVALID_GEOMETRY_ID};
        rtcPointQuery(scene, &query, &context, visit_triangle, &best);
        distances[i] = (double)query.radius;
        faces[i] = best.triangle;
    }
}

static void measure_projection(const char *prefix, const char *points_path)
{
    mesh given = read_mesh(prefix);
    size_t count;
    double *wide = qm_bench_read_rows(points_path, 3 * sizeof *wide, &count);
    vec3 *points = malloc(count * sizeof *points);
    double *distances = malloc(count * sizeof *distances);
    unsigned *faces = malloc(count * sizeof *faces);
    RTCDevice device = rtcNewDevice("threads=1");
    if (!given.vertices || !points || !distances || !faces || !device) {
        fputs("peer_embree: not enough memory\n", stderr);
        exit(EXIT_FAILURE);
    }
    for (size_t i = 0; i < count; i++)
        points[i] = (vec3){(float)wide[3 * i], (float)wide[3 * i + 1], (float)wide[3 * i + 2]};
    free(wide);

    long resting_kb = qm_bench_rest();
    qm_bench_times times = {0};
    do {
        double start = qm_bench_now_ms();
        RTCScene scene = build_scene(device, &given);
        double built = qm_bench_now_ms();
        project(scene, &given, points, count, distances, faces);
        qm_bench_add(&times, built - start, qm_bench_now_ms() - built);
        rtcReleaseScene(scene);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    printf(", ");
    qm_bench_print_checks(distances, count);
    printf("}\n");
    rtcReleaseDevice(device);
    free(faces);
    free(distances);
    free(points);
    free(given.vertices);
    free(given.triangles);
}

int main(int argc, char **argv)
{
    if (argc == 4 && strcmp(argv[1], "project") == 0) {
        measure_projection(argv[2], argv[3]);
        return EXIT_SUCCESS;
    }
    if (argc == 2 && strcmp(argv[1], "version") == 0) {
        printf("{\"version\": \"%s\"}\n", RTC_VERSION_STRING);
        return EXIT_SUCCESS;
    }
    fputs("usage: peer_embree project MESH POINTS | version\n", stderr);
    return 2;
}
