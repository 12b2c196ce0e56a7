/**
 * reconstruct_lattice_untangle.c: repair of folded and inverted quads of a lattice, whose border stays.
 *
 * First each vertex of a folded quad tries positions towards the centroid of its neighbours, and then round
 * itself, and takes those that improve its worst quad. Quads may then still be inverted between their
 * neighbours, for instance where vertices of a row were fitted in the wrong order: no single vertex can move
 * for the better. So a block of vertices round such quads is rebuilt as the Coons patch of the block's
 * border.
 */
#include "reconstruct_internal.h"

#include <string.h>

#define MIN_SINE 0.1      /* the scaled Jacobian at or below which a quad counts as folded */
#define SMOOTH_ROUNDS 12  /* of moving single vertices */
#define UNTANGLE_ROUNDS 3 /* of smoothing, and of rebuilding blocks that smoothing cannot repair */
#define LONGEST_RUN 4     /* of inverted quads side by side; across a ridge all quads are inverted */
#define WIDEST 8          /* quads by which a block extends beyond a run, doubled from 1 on */
#define WIDEST_OUTLIER 2 /* the same round a quad that sticks out: a wider block would cut off a protrusion */
#define REBUILD_ROUNDS 6 /* a block that is rebuilt may make the next one possible */

enum { POINT_SIZE = 3 * sizeof(double), BLOCK_SIDE = LONGEST_RUN + 2 * WIDEST + 1 };

/**
 * Moves a vertex to the projection of a position onto the surface; to the position itself where a point set
 * has no points nearby.
 */
static void move_onto_surface(const qm_ref_surface *surface, const qm_lattice *lattice, uint32_t i,
                              uint32_t j, qm_vec position)
{
    double *vertex = qm_lattice_vertex(lattice, i, j);
    double p[3];
    qm_ref_surface_point projection;
    qm_vec_store(p, position);
    qm_lattice_project(surface, lattice, i, j, p, &projection);
    bool is_near = !surface->is_cloud || projection.distance <= projection.spacing;
    memcpy(vertex, is_near ? projection.position : p, POINT_SIZE);
}

/** The least scaled Jacobian of the four quads round an inner vertex. */
static double worst_sine(const qm_lattice *lattice, uint32_t i, uint32_t j)
{
    return fmin(fmin(qm_lattice_quad_sine(lattice, i - 1, j - 1), qm_lattice_quad_sine(lattice, i, j - 1)),
                fmin(qm_lattice_quad_sine(lattice, i - 1, j), qm_lattice_quad_sine(lattice, i, j)));
}

/** A vertex for which better positions are tried, and the worst of its quads. */
typedef struct vertex_trial {
    const qm_ref_surface *surface;
    const qm_lattice *lattice;
    uint32_t i, j;
    double worst;
    qm_vec centroid;   /* of its neighbours */
    double reach;      /* the greatest distance from there: its own, or that of a neighbour */
    bool is_projected; /* positions are projected onto the surface */
} vertex_trial;

/** A trial of a vertex where it is. */
static vertex_trial start_trial(const qm_ref_surface *surface, const qm_lattice *lattice, uint32_t i,
                                uint32_t j)
{
    const qm_vec neighbour[4] = {qm_lattice_at(lattice, i - 1, j), qm_lattice_at(lattice, i + 1, j),
                                 qm_lattice_at(lattice, i, j - 1), qm_lattice_at(lattice, i, j + 1)};
    qm_vec sum = {0, 0, 0};
    for (int k = 0; k < 4; k++)
        sum = qm_vec_add(sum, neighbour[k]);
    qm_vec centroid = qm_vec_scale(0.25, sum);
    double reach = qm_vec_distance(qm_lattice_at(lattice, i, j), centroid);
    for (int k = 0; k < 4; k++)
        reach = fmax(reach, qm_vec_distance(neighbour[k], centroid));
    return (vertex_trial){surface, lattice, i, j, worst_sine(lattice, i, j), centroid, reach, true};
}

/**
 * Moves the vertex to a position if that improves its worst quad. The projection of a position may lie on another part of the
 * surface: a place beyond all neighbours is refused, or each move would make room for a longer one.
 */
static bool try_position(vertex_trial *t, qm_vec position)
{
    double *vertex = qm_lattice_vertex(t->lattice, t->i, t->j), before[3];
    memcpy(before, vertex, POINT_SIZE);
    if (t->is_projected)
        move_onto_surface(t->surface, t->lattice, t->i, t->j, position);
    else
        qm_vec_store(vertex, position);
    double worst = worst_sine(t->lattice, t->i, t->j);
    if (worst > t->worst && qm_vec_distance(qm_vec_load(vertex), t->centroid) <= t->reach) {
        t->worst = worst;
        return true;
    }
    memcpy(vertex, before, POINT_SIZE);
    return false;
}

/**
 * Tries positions towards the centroid of the neighbours, then in eight directions by falling fractions of
 * the edges: where curves bend sharply the centroid may not help. True if the vertex has moved.
 */
static bool try_positions(vertex_trial *t)
{
    const qm_lattice *lattice = t->lattice;
    qm_vec here = qm_lattice_at(lattice, t->i, t->j);
    qm_vec west = qm_lattice_at(lattice, t->i - 1, t->j), east = qm_lattice_at(lattice, t->i + 1, t->j);
    qm_vec south = qm_lattice_at(lattice, t->i, t->j - 1), north = qm_lattice_at(lattice, t->i, t->j + 1);
    bool has_moved = false;
    for (double fraction = 1.0; fraction >= 0.25; fraction /= 2.0)
        has_moved |= try_position(t, qm_vec_mix(here, t->centroid, fraction));
    if (t->worst > MIN_SINE) return has_moved;
    qm_vec along = qm_vec_sub(east, west), across = qm_vec_sub(north, south);
    for (double fraction = 0.25; fraction > 0.01; fraction /= 2.0) {
        for (int direction = 0; direction < 9; direction++) {
            if (direction == 4) continue;
            double u = fraction * (direction % 3 - 1), v = fraction * (direction / 3 - 1);
            here = qm_lattice_at(lattice, t->i, t->j);
            has_moved |= try_position(t, qm_vec_axpy(qm_vec_axpy(here, u, along), v, across));
        }
    }
    return has_moved;
}

/**
 * Moves a vertex with a folded quad to a better position. A point set may have too few points there to define
 * its surface: the vertex then leaves the surface rather than that its quad stays folded.
 */
static bool smooth_vertex(const qm_ref_surface *surface, const qm_lattice *lattice, uint32_t i, uint32_t j)
{
    vertex_trial t = start_trial(surface, lattice, i, j);
    if (t.worst > MIN_SINE) return false;
    bool has_moved = try_positions(&t);
    if (t.worst > 0.0 || !surface->is_cloud) return has_moved;
    t.is_projected = false;
    return try_positions(&t) || has_moved;
}

void qm_lattice_untangle(const qm_ref_surface *surface, const qm_lattice *lattice)
{
    bool is_changing = true;
    for (int round = 0; round < UNTANGLE_ROUNDS && is_changing; round++) {
        bool is_moving = true;
        for (int smooth_round = 0; smooth_round < SMOOTH_ROUNDS && is_moving; smooth_round++) {
            is_moving = false;
            for (uint32_t j = 1; j < lattice->rows; j++)
                for (uint32_t i = 1; i < lattice->columns; i++)
                    is_moving |= smooth_vertex(surface, lattice, i, j);
        }
        is_changing = qm_lattice_rebuild_inverted(surface, lattice);
    }
}

/*
 * Inverted quads.
 */

static qm_vec quad_normal(const qm_lattice *lattice, uint32_t i, uint32_t j)
{
    const qm_vec corner[4] = {qm_lattice_at(lattice, i, j), qm_lattice_at(lattice, i + 1, j),
                              qm_lattice_at(lattice, i + 1, j + 1), qm_lattice_at(lattice, i, j + 1)};
    return qm_quad_normal(corner);
}

static bool is_folded(const qm_lattice *lattice, uint32_t i, uint32_t j)
{
    return !(qm_lattice_quad_sine(lattice, i, j) > 0.0);
}

/**
 * The length of the run of inverted quads that starts at a quad, along its row or column; 0 for none. The
 * quads before and after a run have normals to one side, which those on both sides of a ridge do not.
 */
static uint32_t run_length(const qm_lattice *lattice, uint32_t i, uint32_t j, bool along_row)
{
    uint32_t index = along_row ? i : j, count = along_row ? lattice->columns : lattice->rows;
    if (index == 0) return 0;
    qm_vec before = along_row ? quad_normal(lattice, i - 1, j) : quad_normal(lattice, i, j - 1);
    qm_vec last = quad_normal(lattice, i, j);
    if (!qm_quad_faces_apart(before, last)) return 0;
    for (uint32_t length = 1; length <= LONGEST_RUN && index + length < count; length++) {
        qm_vec next = along_row ? quad_normal(lattice, i + length, j) : quad_normal(lattice, i, j + length);
        if (qm_quad_faces_apart(last, next)) return qm_vec_dot(before, next) > 0.0 ? length : 0;
        last = next;
    }
    return 0;
}

/**
 * True if the normal of a quad is opposed to those of three or more of its neighbours: on a ridge none is.
 */
static bool sticks_out(const qm_lattice *lattice, uint32_t i, uint32_t j)
{
    qm_vec normal = quad_normal(lattice, i, j);
    int opposed = 0;
    for (int side = 0; side < 4; side++) {
        uint32_t column = side == 0 ? i - 1 : side == 1 ? i + 1 : i; /* i - 1 is out of range if i is 0 */
        uint32_t row = side == 2 ? j - 1 : side == 3 ? j + 1 : j;
        if (column < lattice->columns && row < lattice->rows)
            opposed += qm_quad_faces_apart(normal, quad_normal(lattice, column, row));
    }
    return opposed >= 3;
}

/** A block extended by a margin on each side, within the lattice. */
static qm_vertex_block extend_block(const qm_lattice *lattice, const qm_vertex_block *block, uint32_t margin)
{
    const uint32_t size[2] = {lattice->columns, lattice->rows};
    qm_vertex_block out;
    for (int k = 0; k < 2; k++) {
        out.low[k] = block->low[k] > margin ? block->low[k] - margin : 0;
        out.high[k] = block->high[k] + margin < size[k] ? block->high[k] + margin : size[k];
        QM_ASSERT(out.low[k] < out.high[k]);
    }
    return out;
}

/** Counts the faults of the quads of a block: folded, sticking out, start of an inverted run. */
static size_t count_faults(const qm_lattice *lattice, const qm_vertex_block *b)
{
    size_t faults = 0;
    for (uint32_t j = b->low[1]; j < b->high[1]; j++)
        for (uint32_t i = b->low[0]; i < b->high[0]; i++)
            faults += (size_t)is_folded(lattice, i, j) + (size_t)sticks_out(lattice, i, j) +
                      (size_t)(run_length(lattice, i, j, true) > 0) +
                      (size_t)(run_length(lattice, i, j, false) > 0);
    return faults;
}

/**
 * Rebuilds the inside of a block as a Coons patch, projected onto the surface or not. Keeps it if there are
 * fewer faults then, in the block and round it.
 */
static bool rebuild_block(const qm_ref_surface *surface, const qm_lattice *lattice, const qm_vertex_block *b,
                          bool is_projected)
{
    double saved[BLOCK_SIDE][3 * BLOCK_SIDE];
    size_t width = b->high[0] - b->low[0] - 1;
    QM_ASSERT(width < BLOCK_SIDE && b->high[1] - b->low[1] <= BLOCK_SIDE);
    qm_vertex_block affected = extend_block(lattice, b, LONGEST_RUN + 1);
    size_t before = count_faults(lattice, &affected);
    for (uint32_t j = b->low[1] + 1; j < b->high[1]; j++)
        memcpy(saved[j - b->low[1]], qm_lattice_vertex(lattice, b->low[0] + 1, j), width * POINT_SIZE);
    for (uint32_t j = b->low[1] + 1; j < b->high[1]; j++) {
        for (uint32_t i = b->low[0] + 1; i < b->high[0]; i++) {
            qm_vec position = qm_lattice_coons(lattice, b, i, j);
            if (is_projected)
                move_onto_surface(surface, lattice, i, j, position);
            else
                qm_vec_store(qm_lattice_vertex(lattice, i, j), position);
        }
    }
    if (count_faults(lattice, &affected) < before) return true;
    for (uint32_t j = b->low[1] + 1; j < b->high[1]; j++)
        memcpy(qm_lattice_vertex(lattice, b->low[0] + 1, j), saved[j - b->low[1]], width * POINT_SIZE);
    return false;
}

/** Rebuilds the smallest block round a run that has fewer faults afterwards. False if none has. */
static bool rebuild_round(const qm_ref_surface *surface, const qm_lattice *lattice,
                          const qm_vertex_block *run, uint32_t widest, bool is_projected)
{
    for (uint32_t margin = 1; margin <= widest; margin *= 2) {
        qm_vertex_block b = extend_block(lattice, run, margin);
        if (rebuild_block(surface, lattice, &b, is_projected)) return true;
    }
    return false;
}

/**
 * Rebuilds a block round a folded quad or the start of an inverted run; on a point set also round a quad that
 * sticks out. Points may be too few or too noisy there to define the surface, so that a block may leave it at
 * last.
 */
static bool repair_quad(const qm_ref_surface *surface, const qm_lattice *lattice, uint32_t i, uint32_t j)
{
    uint32_t across = run_length(lattice, i, j, true), down = run_length(lattice, i, j, false);
    bool is_inverted = across > 0 || down > 0 || is_folded(lattice, i, j);
    if (!is_inverted && !(surface->is_cloud && sticks_out(lattice, i, j))) return false;
    qm_vertex_block run = {{i, j}, {i + (across > 0 ? across : 1), j + (down > 0 ? down : 1)}};
    uint32_t widest = is_inverted ? WIDEST : WIDEST_OUTLIER;
    if (rebuild_round(surface, lattice, &run, widest, true)) return true;
    return surface->is_cloud && rebuild_round(surface, lattice, &run, widest, false);
}

bool qm_lattice_rebuild_inverted(const qm_ref_surface *surface, const qm_lattice *lattice)
{
    QM_ASSERT(surface && lattice && lattice->vertices);
    bool has_changed = false, is_changing = true;
    for (int round = 0; round < REBUILD_ROUNDS && is_changing; round++) {
        is_changing = false;
        for (uint32_t j = 0; j < lattice->rows; j++)
            for (uint32_t i = 0; i < lattice->columns; i++)
                is_changing |= repair_quad(surface, lattice, i, j);
        has_changed |= is_changing;
    }
    return has_changed;
}
