/*
 * peer_cgal: CGAL's answers for the benchmark.
 *
 *   peer_cgal hausdorff A B TOLERANCE   within TOLERANCE (in the unit of the meshes) of the distance from A
 * to B
 *   peer_cgal project MESH POINTS       nearest points
 *   peer_cgal collide A B               all pairs of triangles that meet
 *   peer_cgal self MESH                 the same of one mesh, but for what neighbours share
 *   peer_cgal version
 *
 * A, B and MESH are prefixes of arrays (arrays.h). Reading and making the mesh structure is not timed.
 */
#include "arrays.h"
#include "measure.h"
#include "pair_print.h"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/distance.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/box_intersection_d.h>
#include <CGAL/version.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Primitive = CGAL::AABB_face_graph_triangle_primitive<Mesh>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

/** A face that repeats a corner or would make the surface non-manifold gets corners of its own: the same
 * surface, as a soup. */
static void add_face(Mesh &mesh, const Mesh::Vertex_index corner[3])
{
    const bool is_triangle = corner[0] != corner[1] && corner[1] != corner[2] && corner[2] != corner[0];
    if (is_triangle && mesh.add_face(corner[0], corner[1], corner[2]) != Mesh::null_face()) return;
    Mesh::Vertex_index own[3];
    for (int k = 0; k < 3; k++)
        own[k] = mesh.add_vertex(mesh.point(corner[k]));
    mesh.add_face(own[0], own[1], own[2]);
}

static Mesh read_mesh(const char *prefix)
{
    std::size_t vertex_count, triangle_count;
    auto *position = static_cast<double *>(qm_bench_read_part(prefix, "vertices", 24, &vertex_count));
    auto *triangle =
        static_cast<std::uint32_t *>(qm_bench_read_part(prefix, "triangles", 12, &triangle_count));
    Mesh mesh;
    for (std::size_t i = 0; i < vertex_count; i++)
        mesh.add_vertex({position[3 * i], position[3 * i + 1], position[3 * i + 2]});
    for (std::size_t i = 0; i < triangle_count; i++) {
        const std::uint32_t *t = triangle + 3 * i;
        const Mesh::Vertex_index corner[3] = {Mesh::Vertex_index(t[0]), Mesh::Vertex_index(t[1]),
                                              Mesh::Vertex_index(t[2])};
        add_face(mesh, corner);
    }
    std::free(position);
    std::free(triangle);
    return mesh;
}

static void measure_hausdorff(const char *a_prefix, const char *b_prefix, double tolerance)
{
    const Mesh a = read_mesh(a_prefix), b = read_mesh(b_prefix);
    const long resting_kb = qm_bench_rest();
    qm_bench_times times = {};
    double distance;
    do {
        const double start = qm_bench_now_ms();
        distance = CGAL::Polygon_mesh_processing::bounded_error_Hausdorff_distance<CGAL::Sequential_tag>(
            a, b, tolerance);
        qm_bench_add(&times, 0.0, qm_bench_now_ms() - start);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    std::printf(", \"lower\": %.17g, \"upper\": %.17g}\n", std::fmax(distance - tolerance, 0.0),
                distance + tolerance);
}

static void measure_projection(const char *prefix, const char *points_path)
{
    const Mesh mesh = read_mesh(prefix);
    std::size_t count;
    auto *point = static_cast<double *>(qm_bench_read_rows(points_path, 24, &count));
    std::vector<double> distance(count);
    const long resting_kb = qm_bench_rest();
    qm_bench_times times = {};
    do {
        const double start = qm_bench_now_ms();
        Tree tree(faces(mesh).begin(), faces(mesh).end(), mesh);
        tree.build();
        tree.accelerate_distance_queries();
        const double built = qm_bench_now_ms();
        for (std::size_t i = 0; i < count; i++) {
            const Kernel::Point_3 p(point[3 * i], point[3 * i + 1], point[3 * i + 2]);
            const auto nearest = tree.closest_point_and_primitive(p);
            distance[i] = std::sqrt(CGAL::squared_distance(p, nearest.first));
        }
        qm_bench_add(&times, built - start, qm_bench_now_ms() - built);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    std::printf(", ");
    qm_bench_print_checks(distance.data(), count);
    std::printf("}\n");
    std::free(point);
}

static void print_pairs(const qm_bench_times &times, long resting_kb, std::vector<std::uint64_t> &pairs)
{
    qm_bench_print_times(&times, resting_kb);
    std::printf(", ");
    qm_bench_print_pairs(pairs.data(), pairs.size());
    std::printf("}\n");
}

/** Whether a face got corners of its own: they come after the vertices of the file. */
static bool has_own_corners(const Mesh &mesh, std::size_t vertex_count, Mesh::Face_index face)
{
    return mesh.source(mesh.halfedge(face)) >= vertex_count;
}

/** Faces that have a corner at the same place and, one of them having its own, no common vertex. */
static bool are_torn_apart(const Mesh &mesh, std::size_t vertex_count, Mesh::Face_index a, Mesh::Face_index b)
{
    if (!has_own_corners(mesh, vertex_count, a) && !has_own_corners(mesh, vertex_count, b)) return false;
    bool has_common_place = false;
    for (const Mesh::Vertex_index x : mesh.vertices_around_face(mesh.halfedge(a))) {
        for (const Mesh::Vertex_index y : mesh.vertices_around_face(mesh.halfedge(b))) {
            if (x == y) return false;
            has_common_place |= mesh.point(x) == mesh.point(y);
        }
    }
    return has_common_place;
}

static void measure_self(const char *prefix)
{
    std::size_t vertex_count;
    std::free(qm_bench_read_part(prefix, "vertices", 24, &vertex_count));
    const Mesh mesh = read_mesh(prefix);
    const long resting_kb = qm_bench_rest();
    qm_bench_times times = {};
    std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> found;
    do {
        found.clear();
        const double start = qm_bench_now_ms();
        CGAL::Polygon_mesh_processing::self_intersections<CGAL::Sequential_tag>(faces(mesh), mesh,
                                                                                std::back_inserter(found));
        qm_bench_add(&times, 0.0, qm_bench_now_ms() - start);
    } while (qm_bench_wants_more(&times));
    /* Faces that had to get corners of their own meet their neighbours in them, which is no contact. */
    std::vector<std::uint64_t> pairs;
    std::size_t undecided = 0;
    for (const auto &pair : found) {
        if (are_torn_apart(mesh, vertex_count, pair.first, pair.second))
            undecided++;
        else
            pairs.push_back(
                qm_bench_pair(std::min(pair.first, pair.second), std::max(pair.first, pair.second)));
    }
    qm_bench_print_times(&times, resting_kb);
    std::printf(", \"undecided\": %zu, ", undecided);
    qm_bench_print_pairs(pairs.data(), pairs.size());
    std::printf("}\n");
}

using Triangles = std::vector<Kernel::Triangle_3>;
using Box = CGAL::Box_intersection_d::Box_with_handle_d<double, 3, Triangles::const_iterator>;

static Triangles take_triangles(const Mesh &mesh)
{
    Triangles triangles;
    for (const Mesh::Face_index face : faces(mesh)) {
        const auto corner = mesh.halfedge(face);
        triangles.emplace_back(mesh.point(mesh.source(corner)), mesh.point(mesh.target(corner)),
                               mesh.point(mesh.target(mesh.next(corner))));
    }
    return triangles;
}

static std::vector<Box> take_boxes(const Triangles &triangles)
{
    std::vector<Box> boxes;
    for (auto it = triangles.begin(); it != triangles.end(); ++it)
        boxes.emplace_back(it->bbox(), it);
    return boxes;
}

static void measure_collision(const char *a_prefix, const char *b_prefix)
{
    const Triangles a = take_triangles(read_mesh(a_prefix)), b = take_triangles(read_mesh(b_prefix));
    const long resting_kb = qm_bench_rest();
    qm_bench_times times = {};
    std::vector<std::uint64_t> pairs;
    do {
        pairs.clear();
        const double start = qm_bench_now_ms();
        std::vector<Box> boxes_a = take_boxes(a), boxes_b = take_boxes(b);
        const double built = qm_bench_now_ms();
        const auto take = [&](const Box &x, const Box &y) {
            if (CGAL::do_intersect(*x.handle(), *y.handle()))
                pairs.push_back(qm_bench_pair(static_cast<std::uint32_t>(x.handle() - a.begin()),
                                              static_cast<std::uint32_t>(y.handle() - b.begin())));
        };
        CGAL::box_intersection_d(boxes_a.begin(), boxes_a.end(), boxes_b.begin(), boxes_b.end(), take);
        qm_bench_add(&times, built - start, qm_bench_now_ms() - built);
    } while (qm_bench_wants_more(&times));
    print_pairs(times, resting_kb, pairs);
}

int main(int argc, char **argv)
{
    if (argc == 5 && std::strcmp(argv[1], "hausdorff") == 0)
        measure_hausdorff(argv[2], argv[3], std::atof(argv[4]));
    else if (argc == 4 && std::strcmp(argv[1], "project") == 0)
        measure_projection(argv[2], argv[3]);
    else if (argc == 4 && std::strcmp(argv[1], "collide") == 0)
        measure_collision(argv[2], argv[3]);
    else if (argc == 3 && std::strcmp(argv[1], "self") == 0)
        measure_self(argv[2]);
    else if (argc == 2 && std::strcmp(argv[1], "version") == 0)
        std::printf("{\"version\": \"%s\"}\n", CGAL_VERSION_STR);
    else {
        std::fputs(
            "usage: peer_cgal hausdorff A B TOLERANCE | project MESH POINTS | collide A B | self MESH | "
            "version\n",
            stderr);
        return 2;
    }
    return EXIT_SUCCESS;
}
