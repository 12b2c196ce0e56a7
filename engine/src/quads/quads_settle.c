/**
 * quads_settle.c: a mesh of quads whose faces stay, such as one in rows and columns: its vertices are centred, bad quads open, and
 * all come nearer to the surface. Sides that run along features of the surface are found first, and brought onto these; those that
 * are marked as sharp stay on their lines, however little the surface bends there.
 */
#include <string.h>

#include "core/union_find.h"
#include "mesh/quad_shape.h"
#include "qm/project.h"
#include "quads/quads_sides.h"

#define CORNER_COSINE                                                                                        \
    -0.7 /* of the angle between two sides along features: less bent, they are one feature */
#define ALONG                                                                                                \
    0.2 /* of a side: its ends and its middle are no farther than this from a feature that it runs along */

#define ON_FEATURE 1e-6 /* of the diagonal: a line no farther from a feature lies on it */
#define BAD_SINE 0.3    /* quads below it count as bad, */
#define FOLDED 1.0      /* folded ones for so much more */
#define FIRST_CENTRED                                                                                        \
    3 /* rings of vertices round folded quads that are centred; then twice as many, and so on */
#define LAST_CENTRED 12
#define CENTRED_ROUNDS 5 /* for each ring */
#define MORE_MOVES 2     /* times as many, where only bad quads are left */
/* Where vertices are spread once, bad quads open by this part of the moves before others are centred, and by half of it after that. */
#define ONCE_PART 2
#define ONCE_POOR 4   /* where vertices move once and more quads are poor then, settling ends */
#define MOST_RINGS 16 /* of vertices that go back round quads that were folded */
#define FREE_RINGS                                                                                           \
    2 /* round quads that are folded from the start, whose vertices come into order through worse states */

typedef struct settle {
    qm_context *ctx;
    const qm_bvh *surface;
    const qm_quads_options *options;
    qm_quads_settling how;
    const qm_quads_marks *marks; /* NULL if there are none */
    qm_quads_result r;
    qm_bvh *features; /* NULL if there are none */
} settle;

static qm_status build_features(settle *w)
{
    if (w->r.features.face_count == 0) return QM_OK;
    return qm_bvh_build(w->ctx, &w->r.features, QM_BVH_TARGET, w->options->thread_count, &w->features);
}

/** The normal of a segment of a sharp line: of the feature that it lies on, else of the surface under it. */
static qm_status find_line_normal(const settle *w, qm_quads_segment *line)
{
    const qm_mesh *surface = qm_bvh_mesh(w->surface);
    const qm_box box = qm_mesh_bounding_box(surface);
    double at[3], distance = INFINITY;
    uint32_t face = 0;
    const qm_projection out = {.distance = &distance, .face = &face};
    qm_status status = QM_OK;
    qm_vec_store(at, qm_vec_mix(line->end[0], line->end[1], 0.5));
    if (w->features) status = qm_project_points(w->ctx, w->features, QM_QUADS_TRIANGLES, at, 1, 1, &out);
    if (status != QM_OK) return status;
    if (distance <= ON_FEATURE * qm_mesh_box_diagonal(&box)) {
        line->normal = w->r.feature_normal[face];
        return QM_OK;
    }
    status = qm_project_points(w->ctx, w->surface, QM_QUADS_TRIANGLES, at, 1, 1, &out);
    if (status != QM_OK) return status;
    const uint32_t *c = surface->faces + 4 * (size_t)face;
    qm_vec corner[4];
    for (int k = 0; k < 4; k++)
        corner[k] = qm_vec_load(surface->positions + 3 * (size_t)c[c[k] == QM_NO_INDEX ? 0 : k]);
    qm_vec normal = qm_quad_normal(corner);
    double length = qm_vec_norm(normal);
    line->normal = length > QM_MIN_LENGTH ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
    return QM_OK;
}

/** Adds the sharp lines to the features, whose tree is built: its normals are theirs. */
static qm_status add_lines(settle *w, const qm_quads_segment *features, size_t count)
{
    size_t lines = w->marks->line_count;
    qm_quads_segment *all = qm_context_alloc(w->ctx, count + lines, sizeof *all);
    qm_status status = all ? QM_OK : QM_E_NO_MEMORY;
    if (all && count > 0) memcpy(all, features, count * sizeof *all);
    for (size_t i = 0; i < lines && status == QM_OK; i++) {
        const double *row = w->marks->lines + 6 * i;
        all[count + i] = (qm_quads_segment){.end = {qm_vec_load(row), qm_vec_load(row + 3)}};
        status = find_line_normal(w, &all[count + i]);
    }
    qm_bvh_destroy(w->ctx, w->features);
    w->features = NULL;
    qm_context_free(w->ctx, w->r.feature_normal, count, sizeof *w->r.feature_normal);
    w->r.feature_normal = NULL;
    qm_mesh_reset(w->ctx, &w->r.features);
    if (status == QM_OK) status = qm_quads_set_features(w->ctx, all, count + lines, &w->r);
    if (status == QM_OK) status = build_features(w);
    qm_context_free(w->ctx, all, count + lines, sizeof *all);
    return status;
}

/** Makes segments of the surface's features that are lines at the size of a quad, and of the sharp lines. */
static qm_status find_features(settle *w)
{
    const qm_mesh *surface = qm_bvh_mesh(w->surface);
    qm_quads_triangles t;
    qm_trimesh m = {0};
    qm_quads_segment *segments = NULL;
    size_t count = 0;
    qm_status status = qm_quads_list_triangles(w->ctx, surface, &t);
    if (status == QM_OK)
        status = qm_trimesh_build(w->ctx, surface->positions, surface->vertex_count,
                                  (const uint32_t(*)[3])t.corner, t.count, &m);
    if (status == QM_OK) {
        double area = qm_quads_area(surface->positions, (const uint32_t(*)[3])t.corner, t.count);
        status = qm_quads_find_features(w->ctx, &m, w->options->crease_angle,
                                        sqrt(area / (double)w->r.mesh.face_count), false);
    }
    if (status == QM_OK) status = qm_quads_list_features(w->ctx, &m, &segments, &count);
    if (status == QM_OK) status = qm_quads_set_features(w->ctx, segments, count, &w->r);
    if (status == QM_OK) status = build_features(w);
    if (status == QM_OK && w->marks && w->marks->line_count > 0) status = add_lines(w, segments, count);
    qm_context_free(w->ctx, segments, count, sizeof *segments);
    qm_trimesh_reset(w->ctx, &m);
    qm_quads_triangles_reset(w->ctx, &t);
    return status;
}

/** True if sides are paired one to one, and every vertex has one fan of quads. */
static bool is_manifold(qm_quads_sides *t)
{
    for (uint32_t s = 0; s < 4 * t->face_count; s++)
        if (t->twin[s] != QM_NO_INDEX && t->twin[t->twin[s]] != s) return false;
    memset(t->stamp, 0, t->vertex_count * sizeof *t->stamp);
    for (uint32_t s = 0; s < 4 * t->face_count; s++)
        t->stamp[qm_quads_from(t, s)]++;
    for (uint32_t v = 0; v < t->vertex_count; v++) {
        if (t->out[v] == QM_NO_INDEX) continue;
        uint32_t first = qm_quads_first_side(t, v), s = first, count = 0;
        do {
            count++;
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
        if (count < t->stamp[v]) return false;
    }
    return true;
}

static double distance_to(const qm_vec *p, const qm_bvh *bvh, qm_context *ctx, qm_vec *nearest,
                          qm_status *status)
{
    double at[3], to[3], distance = INFINITY;
    const qm_projection out = {.position = to, .distance = &distance};
    qm_vec_store(at, *p);
    if (*status == QM_OK) *status = qm_project_points(ctx, bvh, QM_QUADS_TRIANGLES, at, 1, 1, &out);
    if (*status == QM_OK) *nearest = qm_vec_load(to);
    return distance;
}

/** True if a side lies along a feature. */
static bool is_along(const settle *w, const qm_quads_sides *t, uint32_t side, qm_status *status)
{
    qm_vec a = qm_quads_at(t, qm_quads_from(t, side)),
           b = qm_quads_at(t, qm_quads_from(t, qm_quads_next(side)));
    qm_vec near, middle = qm_vec_mix(a, b, 0.5);
    double reach = ALONG * qm_vec_distance(a, b);
    return distance_to(&a, w->features, w->ctx, &near, status) <= reach &&
           distance_to(&b, w->features, w->ctx, &near, status) <= reach &&
           distance_to(&middle, w->features, w->ctx, &near, status) <= reach;
}

/** Marks a side if it lies along a feature; fixes its ends if it is another boundary. */
static qm_status mark_side(settle *w, const qm_quads_sides *t, uint32_t side)
{
    qm_status status = QM_OK;
    uint32_t twin = t->twin[side];
    bool is_one = w->r.is_feature[side] & QM_QUADS_KEPT || (w->features && is_along(w, t, side, &status));
    w->r.is_feature[side] |= is_one || twin == QM_NO_INDEX;
    if (twin != QM_NO_INDEX) {
        w->r.is_feature[twin] |= is_one;
    } else if (!is_one) {
        w->r.is_fixed[qm_quads_from(t, side)] |= QM_QUADS_HELD;
        w->r.is_fixed[qm_quads_from(t, qm_quads_next(side))] |= QM_QUADS_HELD;
    }
    return status;
}

/** What is marked is kept from the start. */
static void take_marks(settle *w, const qm_quads_sides *t)
{
    const qm_quads_marks *marks = w->marks;
    for (size_t v = 0; v < w->r.mesh.vertex_count && marks->stays; v++)
        if (marks->stays[v]) w->r.is_fixed[v] = QM_QUADS_KEPT;
    for (uint32_t s = 0; s < 4 * w->r.mesh.face_count && marks->sharp; s++) {
        if (!(marks->sharp[s / 4] >> s % 4 & 1)) continue;
        w->r.is_feature[s] = QM_QUADS_KEPT;
        if (t->twin[s] != QM_NO_INDEX) w->r.is_feature[t->twin[s]] = QM_QUADS_KEPT;
    }
}

/** Marks sides along features: those of blocks of rows and columns, if there are such, since only layouts are drawn along features. */
static qm_status mark_sides(settle *w, const qm_quads_sides *t)
{
    const qm_mesh *m = &w->r.mesh;
    qm_status status = QM_OK;
    for (uint32_t side = 0; side < 4 * m->face_count && m->grid_count == 0 && status == QM_OK; side++)
        status = mark_side(w, t, side);
    uint32_t face = 0;
    for (size_t g = 0; g < m->grid_count; g++) {
        uint32_t rows = m->grids[g].rows, columns = m->grids[g].columns;
        for (uint32_t j = 0; j < rows; j++)
            for (uint32_t i = 0; i < columns; i++, face++) {
                const bool is_border[4] = {j == 0, i + 1 == columns, j + 1 == rows, i == 0};
                for (uint32_t k = 0; k < 4 && status == QM_OK; k++)
                    if (is_border[k]) status = mark_side(w, t, 4 * face + k);
            }
    }
    return status;
}

static double face_sine(const qm_mesh *m, size_t face)
{
    qm_vec corner[4];
    for (int k = 0; k < 4; k++)
        corner[k] = qm_vec_load(m->positions + 3 * (size_t)m->faces[4 * face + (size_t)k]);
    return qm_quad_min_sine(corner);
}

static bool is_folded(const qm_mesh *m, size_t face)
{
    return !(face_sine(m, face) > 0.0);
}

static size_t count_folded(const qm_mesh *m)
{
    size_t count = 0;
    for (size_t f = 0; f < m->face_count; f++)
        count += is_folded(m, f);
    return count;
}

size_t qm_quads_count_poor(const qm_mesh *mesh)
{
    size_t count = 0;
    for (size_t f = 0; f < mesh->face_count; f++)
        count += !(face_sine(mesh, f) >= QM_QUADS_POOR_SINE);
    return count;
}

/** The mesh before it moves, and which vertices go back to it. */
typedef struct unmoved {
    double *positions, *before;
    uint8_t *is_feature, *is_fixed;
    uint8_t *goes_back; /* of each vertex */
    size_t folded;      /* quads */
    uint32_t *cluster;  /* of vertices round folded quads: union-find */
    double *badness;    /* of each cluster, by its root: after less before */
} unmoved;

static qm_status take_note(settle *w, unmoved *u)
{
    const qm_mesh *m = &w->r.mesh;
    size_t size = 3 * m->vertex_count;
    u->positions = qm_context_alloc(w->ctx, size, sizeof *u->positions);
    u->is_feature = qm_context_alloc(w->ctx, m->face_count, 4);
    u->is_fixed = qm_context_alloc(w->ctx, m->vertex_count, 1);
    u->goes_back = qm_context_alloc(w->ctx, m->vertex_count, 1);
    u->before = qm_context_alloc(w->ctx, size, sizeof *u->before);
    u->cluster = qm_context_alloc(w->ctx, m->vertex_count, sizeof *u->cluster);
    u->badness = qm_context_alloc(w->ctx, m->vertex_count, sizeof *u->badness);
    if (!u->before || !u->cluster || !u->badness || !u->positions || !u->is_feature || !u->is_fixed ||
        !u->goes_back)
        return QM_E_NO_MEMORY;
    memcpy(u->positions, m->positions, size * sizeof *u->positions);
    memcpy(u->is_feature, w->r.is_feature, 4 * m->face_count);
    memcpy(u->is_fixed, w->r.is_fixed, m->vertex_count);
    u->folded = count_folded(m);
    return QM_OK;
}

static void free_note(settle *w, unmoved *u)
{
    const qm_mesh *m = &w->r.mesh;
    qm_context_free(w->ctx, u->positions, 3 * m->vertex_count, sizeof *u->positions);
    qm_context_free(w->ctx, u->before, 3 * m->vertex_count, sizeof *u->before);
    qm_context_free(w->ctx, u->cluster, m->vertex_count, sizeof *u->cluster);
    qm_context_free(w->ctx, u->badness, m->vertex_count, sizeof *u->badness);
    qm_context_free(w->ctx, u->is_feature, m->face_count, 4);
    qm_context_free(w->ctx, u->is_fixed, m->vertex_count, 1);
    qm_context_free(w->ctx, u->goes_back, m->vertex_count, 1);
}

/** Marks the vertices of faces that are folded, or have a marked one. */
static void mark_faces(const qm_mesh *m, bool are_folded, uint8_t *mark, uint8_t value)
{
    for (size_t f = 0; f < m->face_count; f++) {
        const uint32_t *c = m->faces + 4 * f;
        bool is_marked = are_folded && is_folded(m, f);
        for (int k = 0; k < 4 && !are_folded && !is_marked; k++)
            is_marked = mark[c[k]] && mark[c[k]] < value;
        for (int k = 0; k < 4 && is_marked; k++)
            if (!mark[c[k]]) mark[c[k]] = value;
    }
}

/** Marks the vertices of folded quads, and some rings round these and round what is marked. */
static void mark_round_folded(const qm_mesh *m, int rings, uint8_t *mark)
{
    mark_faces(m, true, mark, 1);
    for (int ring = 0; ring < rings; ring++)
        mark_faces(m, false, mark, (uint8_t)(ring + 2));
}

/** Where quads are folded, the vertices of some rings go back. */
static void go_back(settle *w, const unmoved *u, int rings)
{
    qm_mesh *m = &w->r.mesh;
    for (size_t v = 0; v < m->vertex_count; v++)
        u->goes_back[v] = u->goes_back[v] != 0;
    mark_round_folded(m, rings, u->goes_back);
    for (size_t v = 0; v < m->vertex_count; v++)
        if (u->goes_back[v]) memcpy(m->positions + 3 * v, u->positions + 3 * v, 3 * sizeof(double));
}

/** Marks vertices of some rings round folded quads, and joins those that marked faces connect. */
static void find_clusters(const qm_mesh *m, const unmoved *u, int rings)
{
    memset(u->goes_back, 0, m->vertex_count);
    mark_round_folded(m, rings, u->goes_back);
    for (size_t v = 0; v < m->vertex_count; v++)
        u->cluster[v] = (uint32_t)v;
    for (size_t f = 0; f < m->face_count; f++) {
        const uint32_t *c = m->faces + 4 * f;
        for (int k = 0; k < 4; k++)
            if (u->goes_back[c[k]] && u->goes_back[c[(k + 1) % 4]])
                qm_union_find_join(u->cluster, c[k], c[(k + 1) % 4]);
    }
}

/** Adds up for each cluster how bad its quads are, times a sign. */
static void add_badness(const qm_mesh *m, const unmoved *u, double sign)
{
    for (size_t f = 0; f < m->face_count; f++) {
        const uint32_t *c = m->faces + 4 * f;
        double sine = face_sine(m, f), bad = sine > 0.0 ? qm_max(BAD_SINE - sine, 0.0) : FOLDED - sine;
        for (int k = 0; k < 4 && bad > 0.0; k++)
            if (u->goes_back[c[k]]) {
                u->badness[qm_union_find_root(u->cluster, c[k])] += sign * bad;
                break;
            }
    }
}

/**
 * Where quads stay bad, vertices lie in the wrong order over a part that is wider than what untangling moves. There the vertices of some
 * rings are centred with equal weights, which puts them in order, and bad quads open again. Clusters that are not better then go back.
 */
static qm_status centre_bad(settle *w, const unmoved *u, int rings, size_t *moves)
{
    qm_mesh *m = &w->r.mesh;
    int threads = w->options->thread_count;
    find_clusters(m, u, rings);
    memset(u->badness, 0, m->vertex_count * sizeof *u->badness);
    add_badness(m, u, -1.0);
    bool is_any = false;
    for (size_t v = 0; v < m->vertex_count; v++)
        is_any |= u->badness[v] < 0.0;
    if (!is_any) return QM_OK;
    memcpy(u->before, m->positions, 3 * m->vertex_count * sizeof *m->positions);
    qm_status status =
        qm_quads_centre(w->ctx, &w->r, w->surface, u->goes_back, CENTRED_ROUNDS * rings, threads);
    if (status == QM_OK) status = qm_quads_untangle(w->ctx, &w->r, w->surface, true, moves, threads);
    add_badness(m, u, 1.0);
    for (uint32_t v = 0; v < m->vertex_count; v++)
        if (u->goes_back[v] && u->badness[qm_union_find_root(u->cluster, v)] >= 0.0)
            memcpy(m->positions + 3 * (size_t)v, u->before + 3 * (size_t)v, 3 * sizeof(double));
    return status;
}

/** Moves them one way; *is_hopeless: it was given up, since bad quads did not open. */
static qm_status move_vertices(settle *w, qm_quads_settling how, const unmoved *u, bool *is_hopeless)
{
    int threads = w->options->thread_count;
    qm_status status = QM_OK;
    const bool is_once = how == QM_QUADS_SPREAD_ONCE;
    memset(u->goes_back, 0, w->r.mesh.vertex_count);
    if (how == QM_QUADS_SPREAD) mark_round_folded(&w->r.mesh, FREE_RINGS, u->goes_back);
    if (is_once || how == QM_QUADS_SPREAD)
        status = qm_quads_spread(w->ctx, &w->r, w->surface, u->goes_back, threads);
    else if (how != QM_QUADS_STAY)
        status = qm_quads_polish(w->ctx, &w->r, w->surface, threads);
    size_t moves = qm_quads_untangle_moves(&w->r), moves_again = moves / 2; /* of all rounds together */
    size_t later = is_once ? moves / ONCE_PART : 0;
    moves -= later;
    if (status == QM_OK) status = qm_quads_untangle(w->ctx, &w->r, w->surface, true, &moves, threads);
    if (later > 0) moves = later / 2;
    *is_hopeless = is_once && qm_quads_count_poor(&w->r.mesh) > ONCE_POOR;
    if (status != QM_OK || *is_hopeless) return status;
    if (moves == 0 && count_folded(&w->r.mesh) == 0) {
        /* Many bad quads along creases use up the moves: more of them open all, where those of folded quads may be hopeless. */
        moves = MORE_MOVES * qm_quads_untangle_moves(&w->r);
        status = qm_quads_untangle(w->ctx, &w->r, w->surface, true, &moves, threads);
    }
    for (int rings = FIRST_CENTRED; rings <= LAST_CENTRED && status == QM_OK; rings *= 2)
        status = centre_bad(w, u, rings, &moves);
    if (status == QM_OK) status = qm_quads_fit(w->ctx, &w->r, w->surface, true, threads);
    memset(u->goes_back, 0, w->r.mesh.vertex_count);
    for (int rings = 1; rings <= MOST_RINGS && status == QM_OK && count_folded(&w->r.mesh) > u->folded;
         rings *= 2) {
        go_back(w, u, rings);
        status = qm_quads_untangle(w->ctx, &w->r, w->surface, true, &moves_again, threads);
    }
    return status;
}

/** Moves the vertices, but not into folds: then another way is tried, or they stay. */
static qm_status move_well(settle *w)
{
    qm_mesh *m = &w->r.mesh;
    unmoved u = {0};
    qm_status status = take_note(w, &u);
    for (int how = (int)w->how; how <= (int)QM_QUADS_STAY && status == QM_OK; how++) {
        bool is_hopeless;
        status = move_vertices(w, (qm_quads_settling)how, &u, &is_hopeless);
        if (status != QM_OK || (!is_hopeless && count_folded(m) <= u.folded)) break;
        memcpy(m->positions, u.positions, 3 * m->vertex_count * sizeof *u.positions);
        memcpy(w->r.is_feature, u.is_feature, 4 * m->face_count); /* untangling may have let go of some */
        memcpy(w->r.is_fixed, u.is_fixed, m->vertex_count);
        if (how == (int)QM_QUADS_SPREAD_ONCE) break;
    }
    free_note(w, &u);
    return status;
}

/** Fixes the vertices at which features bend as round a corner. */
static void fix_corners(settle *w, const qm_quads_sides *t)
{
    for (uint32_t v = 0; v < t->vertex_count; v++) {
        if (t->out[v] == QM_NO_INDEX) continue;
        qm_vec here = qm_quads_at(t, v), way[2];
        uint32_t first = qm_quads_first_side(t, v), s = first, count = 0;
        do {
            uint32_t back = qm_quads_prev(s);
            if (w->r.is_feature[s] && count < 2)
                way[count++] = qm_vec_sub(qm_quads_at(t, qm_quads_from(t, qm_quads_next(s))), here);
            if (t->twin[back] == QM_NO_INDEX && count < 2)
                way[count++] = qm_vec_sub(qm_quads_at(t, qm_quads_from(t, back)), here);
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
        if (count < 2) continue;
        double lengths = qm_vec_norm(way[0]) * qm_vec_norm(way[1]);
        if (!(qm_vec_dot(way[0], way[1]) <= CORNER_COSINE * lengths)) w->r.is_fixed[v] |= QM_QUADS_HELD;
    }
}

static qm_status run(settle *w)
{
    qm_quads_sides sides;
    qm_status status = qm_quads_sides_build(w->ctx, &w->r, &sides);
    bool is_one = status == QM_OK && is_manifold(&sides);
    if (is_one) status = find_features(w);
    if (is_one && status == QM_OK && w->marks) take_marks(w, &sides);
    if (is_one && status == QM_OK) status = mark_sides(w, &sides);
    if (is_one && status == QM_OK) fix_corners(w, &sides);
    qm_quads_sides_reset(&sides);
    if (status != QM_OK || !is_one) return status;
    status = move_well(w);
    if (status != QM_OK || (w->how == QM_QUADS_SPREAD_ONCE && qm_quads_count_poor(&w->r.mesh) > 0))
        return status;
    return qm_quads_fit(w->ctx, &w->r, w->surface, true, w->options->thread_count);
}

void qm_quads_marks_reset(qm_context *ctx, qm_quads_marks *marks)
{
    qm_context_free(ctx, marks->stays, marks->vertex_count, 1);
    qm_context_free(ctx, marks->sharp, marks->face_count, 1);
    qm_context_free(ctx, marks->lines, marks->line_count, 6 * sizeof *marks->lines);
    *marks = (qm_quads_marks){0};
}

qm_status qm_quads_settle(qm_context *ctx, const qm_bvh *bvh, const qm_quads_options *options,
                          qm_quads_settling how, const qm_quads_marks *marks, qm_mesh *mesh)
{
    QM_ASSERT(ctx && bvh && options && mesh);
    QM_ASSERT(!marks || !marks->stays || marks->vertex_count == mesh->vertex_count);
    QM_ASSERT(!marks || !marks->sharp || marks->face_count == mesh->face_count);
    if (qm_bvh_mesh(bvh)->face_count == 0)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a point set has no faces to lie on");
    for (size_t f = 0; f < mesh->face_count; f++)
        if (mesh->faces[4 * f + 3] == QM_NO_INDEX)
            return qm_context_fail(ctx, QM_E_ARGUMENT, "face %zu is a triangle, not a quad", f);
    settle w = {.ctx = ctx, .surface = bvh, .options = options, .how = how, .marks = marks};
    size_t vertices = mesh->vertex_count, faces = mesh->face_count;
    w.r.is_fixed = qm_context_alloc(ctx, vertices, 1);
    w.r.is_feature = qm_context_alloc(ctx, faces, 4);
    qm_status status = w.r.is_fixed && w.r.is_feature ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        memset(w.r.is_fixed, 0, vertices);
        memset(w.r.is_feature, 0, 4 * faces);
        w.r.mesh = *mesh;
        status = run(&w);
        w.r.mesh = (qm_mesh){0};
    }
    qm_bvh_destroy(ctx, w.features);
    w.r.mesh.vertex_count = vertices, w.r.mesh.face_count = faces; /* of the arrays of marks */
    qm_quads_result_reset(ctx, &w.r);
    if (status == QM_E_NO_MEMORY) return qm_context_fail(ctx, status, "out of memory for %zu quads", faces);
    return status;
}
