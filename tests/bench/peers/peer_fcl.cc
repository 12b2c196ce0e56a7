/*
 * peer_fcl: FCL's answers for the benchmark.
 *
 *   peer_fcl collide A B   all pairs of triangles that meet
 *   peer_fcl version
 *
 * A and B are prefixes of arrays (arrays.h).
 */
#include "arrays.h"
#include "measure.h"
#include "pair_print.h"

#include <fcl/config.h>
#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/math/bv/OBBRSS.h>
#include <fcl/narrowphase/collision.h>

#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <vector>

using Model = fcl::BVHModel<fcl::OBBRSSd>;

struct Arrays {
    std::vector<fcl::Vector3d> vertices;
    std::vector<fcl::Triangle> triangles;
};

static Arrays read_arrays(const char *prefix)
{
    std::size_t vertex_count, triangle_count;
    auto *position = static_cast<double *>(qm_bench_read_part(prefix, "vertices", 24, &vertex_count));
    auto *corner = static_cast<std::uint32_t *>(qm_bench_read_part(prefix, "triangles", 12, &triangle_count));
    Arrays arrays;
    for (std::size_t i = 0; i < vertex_count; i++)
        arrays.vertices.emplace_back(position[3 * i], position[3 * i + 1], position[3 * i + 2]);
    for (std::size_t i = 0; i < triangle_count; i++)
        arrays.triangles.emplace_back(corner[3 * i], corner[3 * i + 1], corner[3 * i + 2]);
    std::free(position);
    std::free(corner);
    return arrays;
}

static std::shared_ptr<Model> build(const Arrays &arrays)
{
    auto model = std::make_shared<Model>();
    model->beginModel();
    model->addSubModel(arrays.vertices, arrays.triangles);
    model->endModel();
    return model;
}

static void measure_collision(const char *a_prefix, const char *b_prefix)
{
    const Arrays a = read_arrays(a_prefix), b = read_arrays(b_prefix);
    const long resting_kb = qm_bench_rest();
    qm_bench_times times = {};
    std::vector<std::uint64_t> pairs;
    do {
        const double start = qm_bench_now_ms();
        const auto model_a = build(a), model_b = build(b);
        const double built = qm_bench_now_ms();
        fcl::CollisionRequestd request(std::numeric_limits<std::size_t>::max());
        fcl::CollisionResultd result;
        fcl::collide(model_a.get(), fcl::Transform3d::Identity(), model_b.get(), fcl::Transform3d::Identity(),
                     request, result);
        pairs.clear();
        for (std::size_t i = 0; i < result.numContacts(); i++)
            pairs.push_back(qm_bench_pair(static_cast<std::uint32_t>(result.getContact(i).b1),
                                          static_cast<std::uint32_t>(result.getContact(i).b2)));
        qm_bench_add(&times, built - start, qm_bench_now_ms() - built);
    } while (qm_bench_wants_more(&times));
    qm_bench_print_times(&times, resting_kb);
    std::printf(", ");
    qm_bench_print_pairs(pairs.data(), pairs.size());
    std::printf("}\n");
}

int main(int argc, char **argv)
{
    if (argc == 4 && std::strcmp(argv[1], "collide") == 0)
        measure_collision(argv[2], argv[3]);
    else if (argc == 2 && std::strcmp(argv[1], "version") == 0)
        std::printf("{\"version\": \"%s\"}\n", FCL_VERSION);
    else {
        std::fputs("usage: peer_fcl collide A B | version\n", stderr);
        return 2;
    }
    return EXIT_SUCCESS;
}
