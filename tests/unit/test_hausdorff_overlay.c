/* Faces of a source over facets of a target: what is settled by them must be near enough everywhere, whatever
 * the target is like; and the vertical distances are those that clipping one by the other in turn gives. */
#include "check.h"

#include "hausdorff/hausdorff_overlay.h"
#include "measured.h"
#include "random.h"
#include "regridded.h"
#include "shapes.h"
#include "slow_twin.h"
#include "target.h"

#include <math.h>
#include <string.h>

enum { TARGETS = 240, TRIES = 12, SAMPLES = 60, COLUMNS = 12, PAIRS = 4000, SOURCES = 4, SHEETS = 12 };
enum { MAX_PARTS = 200, GRIDS = 700, GRID_SAMPLES = 6, MIN_SETTLED = 3 };

/** How a target departs from a whole sheet. */
enum { WHOLE, HOLES, TORN, DOUBLED, FOLDED, SHAKEN, SOLID, FLAWS };

/** Faces at random lose an edge that they had in common: they get corners of their own, at the same place. */
static qm_mesh tear(const qm_mesh *mesh, qm_random *random)
{
    qm_mesh torn = qm_shape_make(mesh->vertex_count + 4, mesh->face_count);
    memcpy(torn.positions, mesh->positions, 3 * mesh->vertex_count * sizeof *mesh->positions);
    memcpy(torn.faces, mesh->faces, 4 * mesh->face_count * sizeof *mesh->faces);
    uint32_t *face = torn.faces + 4 * qm_random_below(random, mesh->face_count);
    for (uint32_t i = 0; i < 4; i++) {
        uint32_t vertex = (uint32_t)mesh->vertex_count + i;
        memcpy(torn.positions + 3 * vertex, mesh->positions + 3 * (size_t)face[i],
               3 * sizeof *mesh->positions);
        face[i] = vertex;
    }
    return torn;
}

/** A sheared box over [0, 1]^2, some of whose ridges are acute, and the same with its faces cut. */
static void draw_solid(qm_random *random, qm_mesh *coarse, qm_mesh *fine)
{
    qm_mesh box = qm_shape_box(1.0, 1.0, qm_random_range(random, 0.05, 1.0));
    double shear[2] = {qm_random_range(random, -2.0, 2.0), qm_random_range(random, -2.0, 2.0)};
    if (qm_random_below(random, 3) == 0) shear[0] = shear[1] = 0.0;
    for (size_t v = 0; v < box.vertex_count; v++)
        for (int k = 0; k < 2; k++)
            box.positions[3 * v + (size_t)k] += shear[k] * box.positions[3 * v + 2];
    *coarse = qm_shape_triangulated(&box);
    *fine = qm_shape_refined(coarse);
    if (qm_random_below(random, 2) == 0) {
        qm_mesh finer = qm_shape_refined(fine);
        qm_shape_free(fine);
        *fine = finer;
    }
    qm_shape_free(&box);
}

static qm_mesh draw_target(qm_random *random, int flaw)
{
    if (flaw == SOLID) {
        qm_mesh coarse, fine;
        draw_solid(random, &coarse, &fine);
        qm_shape_free(&coarse);
        return fine;
    }
    double height = qm_random_range(random, 0.0, 0.1), turn = qm_random_range(random, 0.0, 3.0);
    qm_mesh sheet = qm_shape_waves(COLUMNS, height, turn), out = {0};
    size_t some = 1 + qm_random_below(random, 6);
    switch (flaw) {
    case HOLES: /* a face over another: one hole, and a place that is covered twice */
        for (size_t i = 0; i < some; i++)
            memcpy(sheet.faces + 4 * qm_random_below(random, sheet.face_count),
                   sheet.faces + 4 * qm_random_below(random, sheet.face_count), 4 * sizeof *sheet.faces);
        return sheet;
    case TORN:
        out = tear(&sheet, random);
        break;
    case DOUBLED: {
        qm_mesh above = qm_shape_copy(&sheet);
        qm_shape_move(&above, 1.0, (const double[3]){0.0, 0.0, qm_random_range(random, 0.0, 0.05)});
        out = qm_shape_joined(&sheet, &above);
        qm_shape_free(&above);
        break;
    }
    case FOLDED: /* vertices that lie over other faces */
        for (size_t i = 0; i < some; i++)
            qm_random_point(random, 0.0, 1.0,
                            sheet.positions + 3 * qm_random_below(random, sheet.vertex_count));
        return sheet;
    case SHAKEN:
        qm_shape_shake(&sheet, random, qm_random_range(random, 0.0, 0.05));
        return sheet;
    default:
        return sheet;
    }
    qm_shape_free(&sheet);
    return out;
}

/** Triangles beside a target, about as large as its facets or several times that. */
static qm_overlay_source draw_source(qm_random *random, const qm_bvh *target)
{
    qm_overlay_source source = {.count = 1 + (int)qm_random_below(random, QM_OVERLAY_FACES)};
    double size = pow(2.0, qm_random_range(random, -2.0, 2.0)) / COLUMNS;
    double away = pow(10.0, qm_random_range(random, -4.0, -1.0));
    qm_vec middle[3];
    qm_bvh_load_triangle(target, (uint32_t)qm_random_below(random, target->pack_count), 0, middle);
    for (int i = 0; i < source.count; i++) {
        qm_vec at = {middle[0].x + size * qm_random_range(random, -2.0, 2.0),
                     middle[0].y + size * qm_random_range(random, -2.0, 2.0), middle[0].z};
        for (int c = 0; c < 3; c++)
            source.corner[i][c] = (qm_vec){at.x + size * qm_random_range(random, -1.0, 1.0),
                                           at.y + size * qm_random_range(random, -1.0, 1.0),
                                           at.z + away * qm_random_range(random, -1.0, 1.0)};
    }
    return source;
}

static void check_settled(const qm_bvh *target, const qm_vec corner[3], double cutoff, qm_random *random,
                          unsigned long long seed, int flaw)
{
    for (int i = 0; i < SAMPLES; i++) {
        double u = qm_random_range(random, 0.0, 1.0), v = qm_random_range(random, 0.0, 1.0);
        if (i < 3) {
            u = i == 1;
            v = i == 2;
        } else if (u + v > 1.0) {
            u = 1.0 - u;
            v = 1.0 - v;
        }
        qm_vec p = qm_vec_axpy(qm_vec_axpy(corner[0], u, qm_vec_sub(corner[1], corner[0])), v,
                               qm_vec_sub(corner[2], corner[0]));
        double distance = qm_target_distance(target, p);
        QM_CHECK(distance <= cutoff + 1e-14, "seed %llu, flaw %d: settled at %.17g, but %.17g away", seed,
                 flaw, cutoff, distance);
    }
}

/** Sets one overlay for all of some sources, with packs this near to them; false when there is none. */
static bool set_overlay(qm_worker *worker, const qm_side *side, const qm_overlay_source *source, int count,
                        double reach, qm_overlay *out)
{
    qm_vec point[SOURCES * 3 * QM_OVERLAY_FACES] = {{0}}, normal = {0, 0, 0};
    int points = 0;
    for (int i = 0; i < count; i++) {
        memcpy(point + points, source[i].corner, (size_t)source[i].count * sizeof source[i].corner[0]);
        points += 3 * source[i].count;
        normal = qm_vec_add(normal, qm_overlay_normal(&source[i]));
    }
    qm_near_packs near;
    qm_box box = qm_vec_box(point, points);
    worker->search->kernel->gather(side->target, &box, reach, &near);
    return qm_overlay_set(worker, side, normal, point, points, &near, out);
}

/** Whether a face is settled by an overlay of its own. */
static bool settles_alone(qm_worker *worker, const qm_side *side, const qm_vec corner[3], double reach)
{
    qm_near_packs near;
    qm_box box = qm_vec_box(corner, 3);
    worker->search->kernel->gather(side->target, &box, reach, &near);
    return qm_overlay_test_face(worker, side, corner, 0.0, &near);
}

static void settled_faces_are_near(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 0);
    qm_context ctx = qm_context_make();
    long settled_count[FLAWS] = {0}, alone_count[FLAWS] = {0};
    for (int i = 0; i < TARGETS; i++) {
        int flaw = i % FLAWS;
        qm_mesh mesh = draw_target(&random, flaw);
        qm_bvh *target;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &target), QM_OK);
        for (int k = 0; k < TRIES; k++) {
            double cutoff = pow(10.0, qm_random_range(&random, -3.0, -0.5));
            qm_search search;
            qm_side side;
            qm_target_search(&search, &side, target, cutoff);
            qm_overlay_source source[SOURCES];
            int source_count = 1 + (int)qm_random_below(&random, SOURCES);
            for (int j = 0; j < source_count; j++)
                source[j] = draw_source(&random, target);
            qm_worker worker = {.search = &search};
            double reach = cutoff * qm_random_range(&random, 0.3, 1.5);
            qm_overlay overlay;
            if (!set_overlay(&worker, &side, source, source_count, reach, &overlay)) continue;
            for (int j = 0; j < source_count; j++) {
                unsigned settled = qm_overlay_test(&worker, &side, &overlay, &source[j]);
                for (int face = 0; face < source[j].count; face++) {
                    bool is_alone = settles_alone(&worker, &side, source[j].corner[face], reach);
                    alone_count[flaw] += is_alone;
                    if (!is_alone && !(settled >> face & 1)) continue;
                    settled_count[flaw]++;
                    check_settled(target, source[j].corner[face], cutoff, &random, (unsigned long long)seed,
                                  flaw);
                }
            }
        }
        qm_bvh_destroy(&ctx, target);
        qm_shape_free(&mesh);
    }
    for (int flaw = 0; flaw < FLAWS; flaw++)
        QM_CHECK(settled_count[flaw] > TARGETS / FLAWS && alone_count[flaw] > TARGETS / FLAWS,
                 "seed %llu: flaw %d: hardly anything was settled: %ld, %ld alone", (unsigned long long)seed,
                 flaw, settled_count[flaw], alone_count[flaw]);
}

/** A triangle of the source's, mostly in its grid, else with corners on any of its patches. */
static void draw_over_grid(qm_random *random, const qm_mesh *mesh, const qm_bvh *target, qm_vec corner[3])
{
    size_t face = qm_random_below(random, mesh->face_count);
    bool is_in_grid = qm_random_below(random, 4) > 0, is_second = qm_random_below(random, 2);
    const double cell[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    for (int i = 0; i < 3; i++) {
        double at[3], uv[2] = {qm_random_range(random, 0, 1), qm_random_range(random, 0, 1)};
        if (is_in_grid) memcpy(uv, cell[i + (i > 0 && is_second)], sizeof uv);
        if (!is_in_grid && qm_random_below(random, 4) == 0) face = qm_random_below(random, mesh->face_count);
        qm_slow_position(mesh, face, QM_QUADS_BILINEAR, uv, at);
        corner[i] = qm_frame_local(&target->frame, at);
    }
}

/** No sample of a triangle is farther from the target's patches than the cutoff; local. */
static void check_over_patches(const qm_mesh *mesh, const qm_bvh *target, const qm_vec corner[3],
                               double cutoff, qm_random *random, unsigned long long seed, int grid)
{
    for (int i = 0; i < GRID_SAMPLES; i++) {
        qm_vec on_side = qm_vec_mix(corner[0], corner[1], qm_random_range(random, 0.0, 1.0));
        qm_vec p = qm_vec_mix(corner[2], on_side, sqrt(qm_random_range(random, 0.0, 1.0)));
        double world[3];
        qm_vec_store(world, qm_frame_world(&target->frame, p));
        double distance =
            qm_slow_distance(mesh, QM_QUADS_BILINEAR, world, 1e-3 * cutoff).lower * target->frame.scale;
        QM_CHECK(distance <= cutoff + 1e-14, "seed %llu, grid %d: settled at %.17g, but %.17g away", seed,
                 grid, cutoff, distance);
    }
}

/** Triangles over folded patches that nearly coincide with them, one by one and together. */
static void faces_over_folded_patches_are_near(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 6);
    qm_context ctx = qm_context_make();
    long settled_count[QM_FOLD_COUNT] = {0};
    for (int i = 0; i < GRIDS; i++) {
        int fold = i % QM_FOLD_COUNT;
        qm_regridded_pair pair = qm_regridded_draw(&random, (qm_fold)fold, QM_REGRIDDED_NOISY);
        qm_bvh *target;
        assert_int_equal(qm_bvh_build(&ctx, &pair.b, QM_BVH_ALL, 1, &target), QM_OK);
        double cutoff = pow(pair.noise, qm_random_range(&random, 0.2, 1.05)) * target->frame.scale;
        qm_search search;
        qm_side side;
        qm_target_search(&search, &side, target, cutoff);
        side.target_patches = true;
        qm_worker worker = {.search = &search};
        qm_overlay_source source = {.count = QM_OVERLAY_FACES};
        for (int k = 0; k < source.count; k++)
            draw_over_grid(&random, &pair.a, target, source.corner[k]);
        qm_overlay overlay;
        bool is_set = set_overlay(&worker, &side, &source, 1, cutoff, &overlay);
        unsigned settled = is_set ? qm_overlay_test(&worker, &side, &overlay, &source) : 0;
        for (int k = 0; k < source.count; k++) {
            if (!(settled >> k & 1) && !settles_alone(&worker, &side, source.corner[k], cutoff)) continue;
            settled_count[fold]++;
            check_over_patches(&pair.b, target, source.corner[k], cutoff, &random, (unsigned long long)seed,
                               i);
        }
        qm_bvh_destroy(&ctx, target);
        qm_shape_free(&pair.a);
        qm_shape_free(&pair.b);
    }
    /* The halves of a patch that is folded over its diagonal are over each other: an even number. */
    for (int fold = 0; fold < QM_FOLD_COUNT; fold++)
        QM_CHECK(fold == QM_FOLD_DIAGONAL || settled_count[fold] > MIN_SETTLED,
                 "seed %llu: fold %d: hardly anything was settled: %ld", (unsigned long long)seed, fold,
                 settled_count[fold]);
}

/** Overlays count as work, which a search's limit looks at. */
static void overlays_count_as_work(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_plane(8, 0.0);
    qm_bvh *target;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &target), QM_OK);
    qm_search search;
    qm_side side;
    qm_target_search(&search, &side, target, 0.1);
    qm_worker worker = {.search = &search};
    qm_random random = qm_random_make(qm_check_seed(), 3);
    qm_overlay_source source = draw_source(&random, target);
    uint64_t before = 0;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < TRIES; k++) {
            qm_overlay overlay;
            if (set_overlay(&worker, &side, &source, 1, 0.1, &overlay))
                qm_overlay_test(&worker, &side, &overlay, &source);
        }
        assert_true(worker.iterations > before);
        before = worker.iterations;
    }
    qm_bvh_destroy(&ctx, target);
    qm_shape_free(&mesh);
}

/** Two sheets of one formula, the source the finer one or the target: no sampled point of the source is
 * beyond the upper bound, the witness is no nearer than the lower one, and the bracket is as narrow as requested
 * for. */
static void near_sheets_are_bracketed(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 2);
    qm_context ctx = qm_context_make();
    for (int i = 0; i < SHEETS; i++) {
        double height = qm_random_range(&random, 0.02, 0.1), turn = qm_random_range(&random, 0.0, 3.0);
        int fine = 60 + (int)qm_random_below(&random, 60), coarse = 15 + (int)qm_random_below(&random, 25);
        int columns = i % 2 ? coarse : fine, others = i % 2 ? fine : coarse;
        qm_mesh a = qm_shape_waves(columns, height, turn), b = qm_shape_waves(others, height, turn);
        qm_bvh *source, *target;
        assert_int_equal(qm_bvh_build(&ctx, &a, QM_BVH_SOURCE, 1, &source), QM_OK);
        assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_ALL, 1, &target), QM_OK);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.direction = QM_A_TO_B;
        options.tolerance = pow(10.0, qm_random_range(&random, -8.0, -4.0));
        qm_hausdorff_result result;
        assert_int_equal(qm_hausdorff_measure(&ctx, source, target, &options, &result), QM_OK);
        assert_int_equal(result.stop, QM_STOP_CONVERGED);
        assert_true(result.upper - result.lower <= options.tolerance);
        for (int k = 0; k < SAMPLES; k++) {
            qm_vec corner[3];
            uint32_t pack = (uint32_t)qm_random_below(&random, source->pack_count);
            qm_bvh_load_triangle(source, pack,
                                 (uint32_t)qm_random_below(&random, source->lanes[pack].lane_count), corner);
            qm_vec p = qm_vec_mix(qm_vec_mix(corner[0], corner[1], qm_random_range(&random, 0.0, 1.0)),
                                  corner[2], qm_random_range(&random, 0.0, 1.0));
            double world[3];
            qm_vec_store(world, qm_frame_world(&source->frame, p));
            double distance = qm_target_distance(target, qm_frame_local(&target->frame, world)) *
                              target->frame.inverse_scale;
            QM_CHECK(distance <= result.upper + 1e-14, "seed %llu, sheets %d: %.17g away, upper bound %.17g",
                     (unsigned long long)seed, i, distance, result.upper);
        }
        double least = qm_target_distance(target, qm_frame_local(&target->frame, result.from.position)) *
                       target->frame.inverse_scale;
        QM_CHECK(result.lower <= least + 1e-14, "seed %llu, sheets %d: lower bound %.17g, witness %.17g",
                 (unsigned long long)seed, i, result.lower, least);
        qm_bvh_destroy(&ctx, source);
        qm_bvh_destroy(&ctx, target);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/** The faces of a solid are settled by those that they were cut into, alone, whatever their ridges are. */
static void faces_of_solids_are_settled(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 4);
    qm_context ctx = qm_context_make();
    for (int i = 0; i < TARGETS; i++) {
        qm_mesh coarse, fine;
        draw_solid(&random, &coarse, &fine);
        qm_bvh *target;
        assert_int_equal(qm_bvh_build(&ctx, &fine, QM_BVH_ALL, 1, &target), QM_OK);
        qm_search search;
        qm_side side;
        qm_target_search(&search, &side, target, 1e-8);
        qm_worker worker = {.search = &search};
        for (size_t f = 0; f < coarse.face_count; f++) {
            qm_vec corner[3];
            for (size_t c = 0; c < 3; c++)
                corner[c] =
                    qm_frame_local(&target->frame, coarse.positions + 3 * (size_t)coarse.faces[4 * f + c]);
            QM_CHECK(settles_alone(&worker, &side, corner, 1e-8), "seed %llu, solid %d: face %zu is left",
                     (unsigned long long)seed, i, f);
        }
        qm_bvh_destroy(&ctx, target);
        qm_shape_free(&coarse);
        qm_shape_free(&fine);
    }
}

/** A solid against what its faces were cut into: their distance is 0, at any tolerance, and no face has to be
 * cut for it. */
static void solids_are_compared_with_few_parts(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 5);
    for (int i = 0; i < TARGETS; i++) {
        qm_mesh coarse, fine;
        draw_solid(&random, &coarse, &fine);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.tolerance = 1e-9;
        qm_hausdorff_result found = qm_measured(&coarse, &fine, &options);
        QM_CHECK(found.stop == QM_STOP_CONVERGED && found.lower == 0.0, "seed %llu, solid %d: [%.17g, %.17g]",
                 (unsigned long long)seed, i, found.lower, found.upper);
        QM_CHECK(found.iterations < MAX_PARTS, "seed %llu, solid %d: %llu parts", (unsigned long long)seed, i,
                 (unsigned long long)found.iterations);
        qm_shape_free(&coarse);
        qm_shape_free(&fine);
    }
}

/** A face at a height over a plane is settled by just that; over a hole it is not, nor where two cover it. */
static void gaps_over_a_plane_are_exact(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    for (int flaw = WHOLE; flaw <= HOLES; flaw++) {
        qm_mesh mesh = qm_shape_plane(8, 0.0);
        if (flaw == HOLES) memcpy(mesh.faces + 4 * 27, mesh.faces, 4 * sizeof *mesh.faces);
        qm_bvh *target;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &target), QM_OK);
        qm_overlay_source source = {.count = 1};
        const double at[3][3] = {{0.31, 0.29, 0.001}, {0.63, 0.33, 0.001}, {0.39, 0.71, 0.001}};
        for (int c = 0; c < 3; c++)
            source.corner[0][c] = qm_frame_local(&target->frame, at[c]);
        double height = 0.001 * target->frame.scale;
        const struct {
            double cutoff;
            bool is_enough;
        } cases[] = {{height * (1.0 + 1e-6), true}, {height * (1.0 - 1e-9), false}};
        for (int i = 0; i < 2; i++) {
            qm_search search;
            qm_side side;
            qm_target_search(&search, &side, target, cases[i].cutoff);
            qm_worker worker = {.search = &search};
            qm_overlay overlay;
            bool is_settled = set_overlay(&worker, &side, &source, 1, 2.0 * height, &overlay) &&
                              qm_overlay_test(&worker, &side, &overlay, &source) != 0;
            assert_int_equal(is_settled, flaw == WHOLE && cases[i].is_enough);
        }
        qm_bvh_destroy(&ctx, target);
        qm_shape_free(&mesh);
    }
}

/** A polygon in the plane with its vertical distances. */
typedef struct clipped {
    int count;
    long double at[8][3];
} clipped;

/** Keeps what lies on the left of the edge from a to b, or on the right where turn is -1. */
static void clip(clipped *p, const double a[3], const double b[3], long double turn)
{
    clipped kept = {0};
    long double d[8];
    for (int i = 0; i < p->count; i++)
        d[i] = turn * (((long double)b[0] - a[0]) * (p->at[i][1] - a[1]) -
                       ((long double)b[1] - a[1]) * (p->at[i][0] - a[0]));
    for (int i = 0; i < p->count; i++) {
        int next = (i + 1) % p->count;
        if (d[i] >= 0.0L) memcpy(kept.at[kept.count++], p->at[i], sizeof p->at[i]);
        if ((d[i] >= 0.0L) == (d[next] >= 0.0L)) continue;
        long double t = d[i] / (d[i] - d[next]);
        for (int k = 0; k < 3; k++)
            kept.at[kept.count][k] = p->at[i][k] + t * (p->at[next][k] - p->at[i][k]);
        kept.count++;
    }
    *p = kept;
}

static long double turn_of(const double corner[3][3])
{
    long double area =
        ((long double)corner[1][0] - corner[0][0]) * ((long double)corner[2][1] - corner[0][1]) -
        ((long double)corner[1][1] - corner[0][1]) * ((long double)corner[2][0] - corner[0][0]);
    return area < 0.0L ? -1.0L : 1.0L;
}

/** The greatest vertical distance over what a facet and a face have in common, or -1. */
static double slow_gap(const double facet[3][3], const qm_overlay_face *face)
{
    clipped p = {.count = 3};
    for (int i = 0; i < 3; i++) {
        p.at[i][0] = facet[i][0];
        p.at[i][1] = facet[i][1];
        p.at[i][2] = facet[i][2] - ((long double)face->plane[0] * facet[i][0] +
                                    (long double)face->plane[1] * facet[i][1] + face->plane[2]);
    }
    long double turn = turn_of(face->corner), greatest = -1.0L;
    for (int k = 0; k < 3; k++)
        clip(&p, face->corner[k], face->corner[(k + 1) % 3], turn);
    for (int i = 0; i < p.count; i++)
        greatest = fmaxl(greatest, fabsl(p.at[i][2]));
    return (double)greatest;
}

/** The greatest vertical distance of a facet's corners and the opposite one from the plane of a face. */
static double slow_patch_gap(const double facet[3][3], const double opposite[3], const qm_overlay_face *face)
{
    long double greatest = 0.0L;
    for (int i = 0; i < 4; i++) {
        const double *at = i < 3 ? facet[i] : opposite;
        long double height = (long double)face->plane[0] * at[0] + (long double)face->plane[1] * at[1];
        greatest = fmaxl(greatest, fabsl(at[2] - height - face->plane[2]));
    }
    return (double)greatest;
}

static void draw_triangle(qm_random *random, double corner[3][3])
{
    double size = pow(2.0, qm_random_range(random, -3.0, 0.0));
    double at[3];
    qm_random_point(random, -0.5, 0.5, at);
    for (int i = 0; i < 3; i++) {
        qm_random_point(random, -size, size, corner[i]);
        for (int k = 0; k < 2; k++)
            corner[i][k] += at[k];
    }
}

static void gaps_are_those_of_clipped_facets(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 1);
    long over = 0;
    for (int i = 0; i < PAIRS; i++) {
        qm_overlay_face face;
        draw_triangle(&random, face.corner);
        if (!isfinite(qm_overlay_set_face(&face, 2.0))) continue;
        qm_overlay_facets facets = {.size = 2.0};
        facets.count = 1 + (int)qm_random_below(&random, 3 * QM_PACK_LANES);
        facets.has_patches = i % 2;
        double enough = 0.5 * (double)(i % 3) - 0.1, first = NAN;
        /* The least that the gap may be, of each facet and of all, and the largest. */
        double expected = -1.0, most = -1.0, slow[3 * QM_PACK_LANES];
        for (int j = 0; j < facets.count; j++) {
            double corner[3][3];
            draw_triangle(&random, corner);
            for (int c = 0; c < 9; c++)
                facets.group[j / 8].at[c / 3][c % 3][j % 8] = corner[c / 3][c % 3];
            slow[j] = slow_gap(corner, &face);
            double largest = slow[j];
            if (facets.has_patches) {
                double opposite[3], twist = qm_random_range(&random, 0.0, 0.5);
                qm_random_point(&random, -0.5, 0.5, opposite);
                if (qm_random_below(&random, 4) == 0) opposite[2] = INFINITY;
                facets.group[j / 8].twist[j % 8] = twist;
                for (int k = 0; k < 3; k++)
                    facets.group[j / 8].opposite[k][j % 8] = opposite[k];
                double patch = slow_patch_gap(corner, opposite, &face);
                if (slow[j] >= 0.0) {
                    largest = patch <= enough ? patch : slow[j] + twist;
                    slow[j] = fmin(slow[j] + twist, patch);
                }
            }
            expected = fmax(expected, slow[j]);
            most = fmax(most, largest);
        }
        over += expected >= 0.0;
        int first_count = 0;
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
            (*kernel)->overlay_close(&facets);
            uint8_t far[QM_OVERLAY_GROUPS] = {0};
            double gap = (*kernel)->overlay_gap(&facets, &face, enough, far);
            for (int j = 0; j < facets.count; j++) {
                bool is_far = far[j / QM_PACK_LANES] >> j % QM_PACK_LANES & 1;
                QM_CHECK(is_far ? slow[j] > enough - 1e-6 : slow[j] < enough + 1e-12,
                         "seed %llu, pair %d: %s: facet %d is %.17g away, enough %.17g",
                         (unsigned long long)seed, i, (*kernel)->name, j, slow[j], enough);
            }
            int count = (*kernel)->overlay_count(&facets, &face);
            if (kernel == qm_kernel_list()) {
                first = gap;
                first_count = count;
            }
            QM_CHECK(gap >= expected - 1e-12 && gap <= fmax(fmax(most, enough), 0.0) + 1e-6,
                     "seed %llu, pair %d: %.17g, not %.17g", (unsigned long long)seed, i, gap, expected);
            QM_CHECK(gap == first && count == first_count, "seed %llu, pair %d: %s differs",
                     (unsigned long long)seed, i, (*kernel)->name);
        }
    }
    QM_CHECK(over > PAIRS / 4, "seed %llu: only %ld lay over each other", (unsigned long long)seed, over);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(settled_faces_are_near),      cmocka_unit_test(faces_over_folded_patches_are_near),
        cmocka_unit_test(faces_of_solids_are_settled), cmocka_unit_test(solids_are_compared_with_few_parts),
        cmocka_unit_test(gaps_over_a_plane_are_exact), cmocka_unit_test(overlays_count_as_work),
        cmocka_unit_test(near_sheets_are_bracketed),   cmocka_unit_test(gaps_are_those_of_clipped_facets),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
