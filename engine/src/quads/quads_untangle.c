/**
 * quads_untangle.c: bad quads become better. Round each of them vertices move along the surface, down a sum over corners that
 * grows without bound where a corner closes, and is finite and steep beyond: so folds open, and none comes back. What stays bad
 * has neighbours that leave no room: local changes of the mesh are tried, each with vertices moved after it, and the best is kept.
 *
 * The sum: with sides a and b of a corner, and D the area of the parallelogram on them as seen along the normal of its neighbourhood,
 * (|a|^2 + |b|^2) / 2 chi(D) - 1, which is 0 in a square; chi(D) = (D + sqrt(D^2 + e^2)) / 2 is D with its negative part bent up to 0.
 *
 * Source: the sum: J. M. Escobar et al., Simultaneous untangling and smoothing of tetrahedral meshes, 2003; V. Garanzha et al.,
 * Foldover-free maps in 50 lines of code, 2021; changes of the mesh with geometry in the loop: M. Tarini et al., Practical quad
 * mesh simplification, 2010.
 */
#include <string.h>

#include "mesh/quad_shape.h"
#include "qm/project.h"
#include "quads/quads_sides.h"

#define BAD_SINE 0.3   /* quads below it are worked on */
#define POOR_SINE 0.22 /* where one is below it after that, the mesh is changed */
#define BEND 0.03      /* e, in squares of the mean side */
#define SWEEPS 20
#define TRIAL_SWEEPS 8
#define ENOUGH 0.8 /* of the sum before, for a change of the mesh to be kept */
#define IRREGULAR_COST 3.0
#define RINGS 2 /* of a patch round a bad quad */
#define ROUNDS 3
#define RELEASED_ROUNDS 2
#define FIRST_STEEP 1       /* round from which the terms of the sum are squared where no quad is folded */
#define FIRST_LIFT 4        /* round from which vertices may leave the surface, */
#define MOST_LIFT 0.25      /* of the mean edge at them */
#define MOVES_EACH 20       /* of each vertex, */
#define MOVES_BESIDES 20000 /* and for small meshes */
#define MOST_PATCH 160      /* vertices */

typedef struct untangle {
    qm_context *ctx;
    qm_quads_sides sides;
    qm_quads_snapshot before, best;
    const qm_bvh *surface, *features; /* features is NULL if there are none */
    qm_vec *normal;                   /* of each face, mean with its neighbours */
    uint32_t patch[MOST_PATCH];       /* vertices */
    size_t patch_count;
    uint32_t move_count;
    uint32_t *moved;            /* of each vertex: the number of its last move */
    uint32_t tried[MOST_PATCH]; /* of a vertex of the patch: how many moves there were before */
    double area;                /* of a quad of the patch, mean */
    size_t moves_left;          /* of vertices */
    bool keeps_faces;
    bool is_steep; /* the terms of the sum are squared, for the worst quads */
    bool lifts;    /* vertices off the surface where those on it do not open quads */
} untangle;

static void corners_of(const qm_quads_sides *t, uint32_t face, qm_vec out[4])
{
    for (uint32_t k = 0; k < 4; k++)
        out[k] = qm_quads_at(t, qm_quads_from(t, 4 * face + k));
}

/** Scaled Jacobian of a face; negative where it looks away from its neighbours. */
static double face_sine(const untangle *u, uint32_t face)
{
    qm_vec corner[4];
    corners_of(&u->sides, face, corner);
    double sine = qm_quad_min_sine(corner);
    return qm_vec_dot(qm_quad_normal(corner), u->normal[face]) < 0.0 ? -fabs(sine) : sine;
}

static qm_vec unit_normal(const qm_quads_sides *t, uint32_t face)
{
    qm_vec corner[4];
    corners_of(t, face, corner);
    qm_vec normal = qm_quad_normal(corner);
    double length = qm_vec_norm(normal);
    return length > QM_MIN_LENGTH ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
}

/** The mean of a face's own normal and those of its neighbours; where these cancel, as on thin parts, its own. */
static void find_normal(untangle *u, uint32_t face)
{
    const qm_quads_sides *t = &u->sides;
    qm_vec own = unit_normal(t, face), sum = own;
    for (uint32_t s = 4 * face; s < 4 * face + 4; s++)
        if (t->twin[s] != QM_NO_INDEX && !t->r->is_feature[s])
            sum = qm_vec_add(sum, unit_normal(t, t->twin[s] / 4));
    double length = qm_vec_norm(sum);
    u->normal[face] = length > 0.5 ? qm_vec_scale(1.0 / length, sum) : own;
}

/** The sum over the corners of a quad. */
static double face_cost(const qm_vec corner[4], qm_vec normal, double area, bool is_steep)
{
    double sum = 0.0, bend = BEND * area;
    for (int k = 0; k < 4; k++) {
        qm_vec on = qm_vec_sub(corner[(k + 1) % 4], corner[k]),
               back = qm_vec_sub(corner[(k + 3) % 4], corner[k]);
        double seen = qm_vec_dot(qm_vec_cross(on, back), normal);
        double bent = 0.5 * (seen + sqrt(seen * seen + bend * bend));
        double term = 0.5 * (qm_vec_norm2(on) + qm_vec_norm2(back)) / qm_max(bent, QM_MIN_LENGTH) - 1.0;
        sum += is_steep ? term * term : term;
    }
    return sum;
}

/** Of the quads round a vertex, if it lay at a point. */
static double cost_at(const untangle *u, uint32_t v, qm_vec point)
{
    const qm_quads_sides *t = &u->sides;
    double sum = 0.0;
    uint32_t first = qm_quads_first_side(t, v), s = first;
    do {
        qm_vec corner[4];
        corners_of(t, s / 4, corner);
        corner[s % 4] = point;
        sum += face_cost(corner, u->normal[s / 4], u->area, u->is_steep);
        s = qm_quads_around(t, s);
    } while (s != QM_NO_INDEX && s != first);
    return sum;
}

static double mean_edge(const qm_quads_sides *t, uint32_t v)
{
    double sum = 0.0, count = 0.0;
    qm_vec here = qm_quads_at(t, v);
    uint32_t first = qm_quads_first_side(t, v), s = first;
    do {
        for (uint32_t k = qm_quads_next(s); k != s; k = qm_quads_next(k))
            sum += qm_vec_distance(here, qm_quads_at(t, qm_quads_from(t, k))), count += 1.0;
        s = qm_quads_around(t, s);
    } while (s != QM_NO_INDEX && s != first);
    return sum / count;
}

/** The directions in which a vertex may move: two of a free one, one along a feature. */
static int find_directions(const untangle *u, uint32_t v, qm_vec out[2])
{
    const qm_quads_sides *t = &u->sides;
    if (t->kind[v] == QM_TRIMESH_FREE) {
        qm_vec normal = {0, 0, 0};
        uint32_t first = qm_quads_first_side(t, v), s = first;
        do {
            normal = qm_vec_add(normal, u->normal[s / 4]);
            s = qm_quads_around(t, s);
        } while (s != first);
        double height = qm_vec_norm(normal);
        if (!(height > 1e-3)) return 0;
        normal = qm_vec_scale(1.0 / height, normal);
        qm_vec a = qm_vec_perpendicular(normal);
        out[0] = qm_vec_scale(1.0 / qm_vec_norm(a), a);
        out[1] = qm_vec_cross(normal, out[0]);
        return 2;
    }
    if (t->kind[v] == QM_TRIMESH_CORNER || !u->features) return 0;
    qm_vec end[2] = {qm_quads_at(t, v), qm_quads_at(t, v)};
    int count = 0;
    uint32_t first = qm_quads_first_side(t, v), s = first;
    do {
        uint32_t back = qm_quads_prev(s);
        if (t->r->is_feature[s] && count < 2)
            end[count++] = qm_quads_at(t, qm_quads_from(t, qm_quads_next(s)));
        if (t->twin[back] == QM_NO_INDEX && count < 2) end[count++] = qm_quads_at(t, qm_quads_from(t, back));
        s = qm_quads_around(t, s);
    } while (s != QM_NO_INDEX && s != first);
    qm_vec line = qm_vec_sub(end[1], end[0]);
    double length = qm_vec_norm(line);
    if (!(length > 0.0)) return 0;
    out[0] = qm_vec_scale(1.0 / length, line);
    return 1;
}

/** Moves a vertex down the slope of the sum, as far as that falls. *has_moved is left alone where it does not. */
static qm_status move_vertex(untangle *u, uint32_t v, bool *has_moved)
{
    qm_quads_sides *t = &u->sides;
    qm_vec axis[2], here = qm_quads_at(t, v), slope = {0, 0, 0};
    int count = find_directions(u, v, axis);
    double now = cost_at(u, v, here), edge = qm_max(mean_edge(t, v), 0.1 * sqrt(u->area)), tiny = 1e-4 * edge;
    if (count == 0 || !(edge > 0.0)) return QM_OK;
    for (int k = 0; k < count; k++) {
        double rise = cost_at(u, v, qm_vec_axpy(here, tiny, axis[k])) -
                      cost_at(u, v, qm_vec_axpy(here, -tiny, axis[k]));
        slope = qm_vec_axpy(slope, -rise, axis[k]);
    }
    double length = qm_vec_norm(slope);
    if (!(length > 0.0)) return QM_OK;
    const qm_bvh *onto = t->kind[v] == QM_TRIMESH_FREE ? u->surface : u->features;
    for (double step = 0.4; step > 0.01; step /= 2.0) {
        double point[3], nearest[3];
        qm_vec_store(point, qm_vec_axpy(here, step * edge / length, slope));
        const qm_projection out = {.position = nearest};
        qm_status status = qm_project_points(u->ctx, onto, QM_QUADS_TRIANGLES, point, 1, 1, &out);
        if (status != QM_OK) return status;
        bool falls = cost_at(u, v, qm_vec_load(nearest)) < now * (1.0 - 1e-4);
        if (!falls && u->lifts && onto == u->surface) {
            qm_vec to = qm_vec_load(nearest), off = qm_vec_sub(qm_vec_load(point), to);
            double height = qm_vec_norm(off), most = MOST_LIFT * edge;
            if (height > most) off = qm_vec_scale(most / height, off);
            qm_vec_store(nearest, qm_vec_add(to, off));
            falls = cost_at(u, v, qm_vec_load(nearest)) < now * (1.0 - 1e-4);
        }
        if (!falls) continue;
        memcpy(t->r->mesh.positions + 3 * (size_t)v, nearest, sizeof nearest);
        *has_moved = true;
        return QM_OK;
    }
    return QM_OK;
}

/** True if a vertex of the quads round one has moved since a move of that number. */
static bool has_moved_round(const untangle *u, uint32_t v, uint32_t since)
{
    const qm_quads_sides *t = &u->sides;
    uint32_t first = qm_quads_first_side(t, v), s = first;
    do {
        for (uint32_t k = 0; k < 4; k++)
            if (u->moved[qm_quads_from(t, s / 4 * 4 + k)] > since) return true;
        s = qm_quads_around(t, s);
    } while (s != QM_NO_INDEX && s != first);
    return false;
}

static void add_to_patch(untangle *u, uint32_t v)
{
    if (u->sides.stamp[v] == u->sides.stamp_value || u->patch_count == MOST_PATCH) return;
    u->sides.stamp[v] = u->sides.stamp_value;
    u->patch[u->patch_count++] = v;
}

/** The vertices of a face and of some rings round it. */
static void find_patch(untangle *u, uint32_t face, int rings)
{
    const qm_quads_sides *t = &u->sides;
    u->sides.stamp_value++;
    u->patch_count = 0;
    for (uint32_t k = 0; k < 4; k++)
        add_to_patch(u, qm_quads_from(t, 4 * face + k));
    size_t begin = 0;
    for (int ring = 0; ring < rings; ring++) {
        size_t end = u->patch_count;
        for (; begin < end; begin++) {
            uint32_t first = qm_quads_first_side(t, u->patch[begin]), s = first;
            do {
                for (uint32_t k = qm_quads_next(s); k != s; k = qm_quads_next(k))
                    add_to_patch(u, qm_quads_from(t, k));
                s = qm_quads_around(t, s);
            } while (s != QM_NO_INDEX && s != first);
        }
    }
}

/** The state of the quads round the vertices of the patch that are still there. */
typedef struct patch_state {
    double sine; /* the least */
    double
        cost; /* the sum over their corners, each as often as its quad has vertices here, and over irregular vertices */
} patch_state;

static patch_state look_at_patch(const untangle *u)
{
    const qm_quads_sides *t = &u->sides;
    patch_state state = {1.0, 0.0};
    for (size_t i = 0; i < u->patch_count; i++) {
        uint32_t v = u->patch[i];
        if (t->out[v] == QM_NO_INDEX) continue;
        uint32_t first = qm_quads_first_side(t, v), s = first;
        do {
            state.sine = qm_min(state.sine, face_sine(u, s / 4));
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
        state.cost += cost_at(u, v, qm_quads_at(t, v));
        if (t->kind[v] != QM_TRIMESH_FREE) continue;
        double off = qm_quads_sector_at(t, first).quads - 4;
        state.cost += IRREGULAR_COST * off * off;
    }
    return state;
}

/** Finds the normals of the patch, and the mean area of its quads. */
static void start_patch(untangle *u)
{
    const qm_quads_sides *t = &u->sides;
    double sum = 0.0, count = 0.0;
    for (size_t i = 0; i < u->patch_count; i++) {
        uint32_t v = u->patch[i];
        if (t->out[v] == QM_NO_INDEX) continue;
        uint32_t first = qm_quads_first_side(t, v), s = first;
        do {
            qm_vec corner[4];
            corners_of(t, s / 4, corner);
            sum += 0.5 * qm_vec_norm(qm_quad_normal(corner)), count += 1.0;
            find_normal(u, s / 4);
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
    }
    u->area = count > 0.0 ? qm_max(sum / count, QM_MIN_LENGTH) : 1.0;
}

static qm_status relax_patch(untangle *u, int sweeps)
{
    qm_status status = QM_OK;
    start_patch(u);
    bool is_moving = true;
    for (int sweep = 0; sweep < sweeps && is_moving && u->moves_left > 0 && status == QM_OK; sweep++) {
        u->moves_left -= u->patch_count < u->moves_left ? u->patch_count : u->moves_left;
        is_moving = false;
        for (size_t i = 0; i < u->patch_count && status == QM_OK; i++) {
            uint32_t v = u->patch[i];
            if (u->sides.out[v] == QM_NO_INDEX) continue;
            /* one that stayed would stay again while all round it do */
            if (sweep > 0 && !has_moved_round(u, v, u->tried[i])) continue;
            bool has_moved = false;
            status = move_vertex(u, v, &has_moved);
            u->tried[i] = u->move_count;
            if (has_moved) u->moved[v] = ++u->move_count;
            is_moving |= has_moved;
        }
        if (sweep % 4 == 3 && look_at_patch(u).sine >= BAD_SINE) break;
    }
    return status;
}

/*
 * Changes of the mesh.
 */

/** Change number n of a face: contractions from its corners, then turns of its sides. False: there is no such change. */
static bool apply_change(qm_quads_sides *t, uint32_t face, uint32_t n)
{
    if (n < 4) {
        uint32_t side = 4 * face + n;
        if (!qm_quads_can_contract(t, side)) return false;
        for (uint32_t k = 1; k < 4;
             k += 2) /* a corner that would be left without a quad, or with a single one */
            if (qm_quads_sector_at(t, 4 * face + (n + k) % 4).quads < 2) return false;
        if (qm_quads_sector_at(t, side).quads + qm_quads_sector_at(t, 4 * face + (n + 2) % 4).quads < 4)
            return false;
        qm_quads_contract(t, side);
        return true;
    }
    qm_quads_hexagon x;
    int k = n % 2 == 0 ? 1 : 2;
    if (!qm_quads_find_hexagon(t, 4 * face + (n - 4) / 2, &x) || !qm_quads_can_turn(t, &x, k)) return false;
    qm_quads_turn(t, &x, k);
    return true;
}

enum { CHANGES = 12 };

/** Contracts quads at free vertices of two, which have no shape, and at those that this leaves. */
static void remove_doublets(untangle *u)
{
    qm_quads_sides *t = &u->sides;
    bool is_changing = true;
    while (is_changing) {
        is_changing = false;
        for (size_t i = 0; i < u->patch_count; i++) {
            uint32_t v = u->patch[i];
            if (t->out[v] == QM_NO_INDEX || t->kind[v] != QM_TRIMESH_FREE) continue;
            uint32_t side = t->out[v];
            if (qm_quads_sector_at(t, side).quads != 2 || !qm_quads_can_contract(t, side)) continue;
            qm_quads_contract(t, side);
            is_changing = true;
        }
    }
}

/** Tries the changes of a face, and keeps the best if the quads round it become better. */
static qm_status change_face(untangle *u, uint32_t face)
{
    qm_quads_sides *t = &u->sides;
    patch_state now = look_at_patch(u);
    double best = ENOUGH * now.cost;
    bool has_best = false;
    qm_status status = QM_OK;
    qm_quads_snapshot_take(t, &u->before);
    for (uint32_t n = 0; n < CHANGES && u->moves_left > 0 && status == QM_OK; n++) {
        if (!apply_change(t, face, n)) continue;
        remove_doublets(u);
        status = relax_patch(u, TRIAL_SWEEPS);
        patch_state then = look_at_patch(u);
        if (then.cost < best && then.sine > qm_min(now.sine, POOR_SINE)) {
            best = then.cost;
            has_best = true;
            qm_quads_snapshot_take(t, &u->best);
        }
        qm_quads_snapshot_restore(t, &u->before);
    }
    if (has_best) qm_quads_snapshot_restore(t, &u->best);
    start_patch(u);
    return status;
}

/** Lets go of the features round a face, unless they are kept: they hold vertices where there is no room for them. */
static void release_features(untangle *u, uint32_t face)
{
    qm_quads_sides *t = &u->sides;
    find_patch(u, face, 1);
    for (size_t i = 0; i < u->patch_count; i++) {
        uint32_t first = qm_quads_first_side(t, u->patch[i]), s = first;
        do {
            uint32_t to = qm_quads_from(t, qm_quads_next(s)), twin = t->twin[s];
            if (twin != QM_NO_INDEX && t->stamp[to] == t->stamp_value &&
                !(t->r->is_feature[s] & QM_QUADS_KEPT))
                t->r->is_feature[s] = t->r->is_feature[twin] = false;
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
    }
    for (size_t i = 0; i < u->patch_count; i++) {
        uint32_t v = u->patch[i], first = qm_quads_first_side(t, v), s = first;
        int features = 0;
        do {
            features += (t->r->is_feature[s] != 0) + (t->twin[qm_quads_prev(s)] == QM_NO_INDEX);
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
        if (t->r->is_fixed[v] & QM_QUADS_KEPT) continue;
        if (features == 0) {
            t->kind[v] = QM_TRIMESH_FREE;
            t->r->is_fixed[v] = false;
        } else if (features == 1) {
            t->kind[v] = QM_TRIMESH_CORNER;
        }
    }
}

/** Where the mesh stays as it is, patches grow from round to round instead. */
static qm_status improve_face(untangle *u, uint32_t face, int round)
{
    find_patch(u, face, u->keeps_faces ? RINGS + round : RINGS);
    u->is_steep = false;
    if (u->keeps_faces && round >= FIRST_STEEP) {
        start_patch(u);
        u->is_steep = look_at_patch(u).sine > 0.0;
    }
    qm_status status = relax_patch(u, SWEEPS);
    if (status == QM_OK && !u->keeps_faces && face_sine(u, face) < POOR_SINE) status = change_face(u, face);
    return status == QM_OK && qm_context_canceled(u->ctx) ? QM_E_CANCELED : status;
}

/** One round over all bad quads; *is_bad tells if there were any. Those of no shape are let go of by their features in the last
 * rounds. */
static qm_status improve_all(untangle *u, int round, bool *is_bad)
{
    qm_quads_sides *t = &u->sides;
    qm_status status = QM_OK;
    bool releases = round >= ROUNDS;
    *is_bad = false;
    u->lifts = round >= FIRST_LIFT;
    for (uint32_t f = 0; f < t->face_count && u->moves_left > 0 && status == QM_OK; f++) {
        double sine = t->is_gone[f] ? 1.0 : face_sine(u, f);
        if (sine >= BAD_SINE) continue;
        *is_bad = true;
        if (releases && sine < POOR_SINE) {
            release_features(u, f);
            if (!u->keeps_faces) remove_doublets(u);
            if (t->is_gone[f]) continue;
        }
        status = improve_face(u, f, round);
    }
    return status;
}

static qm_status run(untangle *u)
{
    qm_status status = QM_OK;
    for (uint32_t f = 0; f < u->sides.face_count; f++)
        find_normal(u, f);
    bool is_bad = true;
    for (int round = 0; round < ROUNDS + RELEASED_ROUNDS && is_bad && status == QM_OK; round++)
        status = improve_all(u, round, &is_bad);
    return status;
}

size_t qm_quads_untangle_moves(const qm_quads_result *r)
{
    return MOVES_EACH * r->mesh.vertex_count + MOVES_BESIDES;
}

qm_status qm_quads_untangle(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, bool keeps_faces,
                            size_t *moves, int thread_count)
{
    untangle u = {.ctx = ctx, .surface = surface, .moves_left = *moves, .keeps_faces = keeps_faces};
    qm_bvh *features = NULL;
    qm_status status = qm_quads_sides_build(ctx, r, &u.sides);
    if (status == QM_OK && r->features.face_count > 0)
        status = qm_bvh_build(ctx, &r->features, QM_BVH_TARGET, thread_count, &features);
    u.features = features;
    size_t faces = u.sides.face_count;
    size_t vertices = u.sides.vertex_count;
    u.normal = qm_context_alloc(ctx, faces, sizeof *u.normal);
    u.moved = qm_context_alloc(ctx, vertices, sizeof *u.moved);
    if (status == QM_OK && (!u.normal || !u.moved)) status = QM_E_NO_MEMORY;
    if (u.moved) memset(u.moved, 0, vertices * sizeof *u.moved);
    if (status == QM_OK) status = qm_quads_snapshot_alloc(&u.sides, &u.before);
    if (status == QM_OK) status = qm_quads_snapshot_alloc(&u.sides, &u.best);
    if (status == QM_OK) status = run(&u);
    *moves = u.moves_left;
    qm_context_free(ctx, u.normal, faces, sizeof *u.normal);
    qm_context_free(ctx, u.moved, vertices, sizeof *u.moved);
    qm_quads_snapshot_reset(&u.sides, &u.before);
    qm_quads_snapshot_reset(&u.sides, &u.best);
    if (status == QM_OK && !keeps_faces) status = qm_quads_sides_compact(&u.sides);
    qm_quads_sides_reset(&u.sides);
    qm_bvh_destroy(ctx, features);
    return status;
}
