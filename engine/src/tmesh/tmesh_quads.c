/**
 * tmesh_quads.c: makes a mesh ready: divides it into quads, separates what is not manifold, finds features and
 * required vertices.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/face_ring.h"
#include "core/union_find.h"
#include "core/vec.h"
#include "tmesh/tmesh.h"

/* A feature that ends freely after less than this share of the diagonal is noise. So is a turn of a feature by less
 * than SHARP_TURN degrees. */
#define SHORTEST_SPUR 0.1
#define SHARP_TURN 50

/** A side of a face with its vertices in order, for sorting. */
typedef struct sided_pair {
    uint32_t low, high, side;
} sided_pair;

static int compare_pairs(const void *a, const void *b)
{
    const sided_pair *one = a, *other = b;
    if (one->low != other->low) return one->low < other->low ? -1 : 1;
    if (one->high != other->high) return one->high < other->high ? -1 : 1;
    return one->side < other->side ? -1 : one->side > other->side;
}

/** The sides of all faces, sorted by their vertices. sides has 4 a face; corners with NO_INDEX have none. */
static size_t sort_sides(const uint32_t *faces, size_t face_count, sided_pair *pairs)
{
    size_t count = 0;
    for (size_t f = 0; f < face_count; f++) {
        const uint32_t *face = faces + 4 * f;
        int corners = qm_face_corners(face);
        for (int s = 0; s < corners; s++) {
            uint32_t a = face[s], b = face[(s + 1) % corners];
            pairs[count++] = (sided_pair){a < b ? a : b, a < b ? b : a, (uint32_t)(4 * f) + (uint32_t)s};
        }
    }
    qsort(pairs, count, sizeof *pairs, compare_pairs);
    return count;
}

static size_t run_end(const sided_pair *pairs, size_t count, size_t i)
{
    size_t end = i + 1;
    while (end < count && pairs[end].low == pairs[i].low && pairs[end].high == pairs[i].high)
        end++;
    return end;
}

/* ---- quads alone ---- */

typedef struct quads_maker {
    qm_arena *arena;
    uint32_t *faces; /* with 3 or 4 different corners each, then with 4 */
    size_t face_count;
    uint8_t *creases; /* of the faces; NULL: not given */
    double *positions;
    size_t vertex_count;
    sided_pair *pairs;
    size_t pair_count;
} quads_maker;

static bool take_faces(quads_maker *maker, const qm_mesh *mesh, bool *has_triangles)
{
    maker->faces = qm_arena_alloc(maker->arena, 4 * mesh->face_count, sizeof *maker->faces);
    if (!maker->faces) return false;
    *has_triangles = false;
    for (size_t f = 0; f < mesh->face_count; f++) {
        uint32_t ring[4];
        int corners = qm_face_ring(mesh->faces + 4 * f, ring);
        if (corners == 0) continue;
        if (corners == 3) ring[3] = QM_NO_INDEX;
        *has_triangles |= corners == 3;
        memcpy(maker->faces + 4 * maker->face_count++, ring, sizeof ring);
    }
    maker->positions = mesh->positions;
    maker->vertex_count = mesh->vertex_count;
    return true;
}

static bool sort_pairs(quads_maker *maker)
{
    maker->pairs = qm_arena_alloc(maker->arena, 4 * maker->face_count, sizeof *maker->pairs);
    if (!maker->pairs) return false;
    maker->pair_count = sort_sides(maker->faces, maker->face_count, maker->pairs);
    return true;
}

/** The corner of a face at a vertex; 4: none. */
static uint32_t corner_at(const uint32_t *face, uint32_t vertex)
{
    uint32_t k = 0;
    while (k < 4 && face[k] != vertex)
        k++;
    return k;
}

static bool is_crease(const quads_maker *maker, uint32_t face, uint32_t side)
{
    return maker->creases && maker->creases[face] >> (side & 3) & 1;
}

static void set_crease(quads_maker *maker, uint32_t face, uint32_t side, bool is_one)
{
    if (!maker->creases) return;
    uint8_t bit = (uint8_t)(1u << (side & 3));
    maker->creases[face] = (uint8_t)(is_one ? maker->creases[face] | bit : maker->creases[face] & ~bit);
}

/** True if a line from a over v to b turns by more than SHARP_TURN. */
static bool turns_sharply(const double *positions, uint32_t a, uint32_t v, uint32_t b)
{
    qm_vec at = qm_vec_load(positions + 3 * (size_t)v),
           from = qm_vec_sub(at, qm_vec_load(positions + 3 * (size_t)a)),
           to = qm_vec_sub(qm_vec_load(positions + 3 * (size_t)b), at);
    return qm_vec_angle(from, to) > SHARP_TURN * QM_DEGREE;
}

/** Makes one quad of two that a vertex inside has alone: (v a x b) and (v b y a) become (y a x b), in place of the first. The second
 * is left without corners. A crease between them stays only where it has a corner: where it goes on or ends, both quads would
 * be flat triangles. */
static bool merge_doublet(quads_maker *maker, uint32_t vertex, uint32_t face, uint32_t other)
{
    uint32_t *one = maker->faces + 4 * (size_t)face, *two = maker->faces + 4 * (size_t)other;
    uint32_t i = corner_at(one, vertex), j = corner_at(two, vertex);
    if (i == 4 || j == 4 || one[(i + 1) & 3] != two[(j + 3) & 3] || one[(i + 3) & 3] != two[(j + 1) & 3] ||
        one[(i + 2) & 3] == two[(j + 2) & 3])
        return false;
    if (is_crease(maker, face, i) && is_crease(maker, face, i + 3) &&
        turns_sharply(maker->positions, one[(i + 1) & 3], vertex, one[(i + 3) & 3]))
        return false;
    one[i] = two[(j + 2) & 3];
    set_crease(maker, face, i, is_crease(maker, other, j + 2));
    set_crease(maker, face, i + 3, is_crease(maker, other, j + 1));
    for (int k = 0; k < 4; k++)
        two[k] = QM_NO_INDEX;
    return true;
}

/** Merges the quads at vertices of two until there are none. Returns false when out of memory. */
static bool merge_doublets(quads_maker *maker)
{
    uint32_t *valence = qm_arena_alloc(maker->arena, maker->vertex_count, sizeof *valence);
    uint32_t(*face)[2] = qm_arena_alloc(maker->arena, maker->vertex_count, sizeof *face);
    if (!valence || !face) return false;
    for (bool is_changing = true; is_changing;) {
        memset(valence, 0, maker->vertex_count * sizeof *valence);
        for (size_t c = 0; c < 4 * maker->face_count; c++) {
            uint32_t v = maker->faces[c];
            if (valence[v] < 2) face[v][valence[v]] = (uint32_t)(c / 4);
            valence[v]++;
        }
        is_changing = false;
        for (uint32_t v = 0; v < maker->vertex_count; v++)
            if (valence[v] == 2) is_changing |= merge_doublet(maker, v, face[v][0], face[v][1]);
        size_t count = 0;
        for (size_t f = 0; f < maker->face_count; f++) {
            if (maker->faces[4 * f] == QM_NO_INDEX) continue;
            memmove(maker->faces + 4 * count, maker->faces + 4 * f, 4 * sizeof *maker->faces);
            if (maker->creases) maker->creases[count] = maker->creases[f];
            count++;
        }
        maker->face_count = count;
    }
    return true;
}

/** Divides every face of n corners into n quads. */
static bool divide_faces(quads_maker *maker)
{
    size_t old_faces = maker->face_count, old_vertices = maker->vertex_count;
    uint32_t *middle = qm_arena_alloc(maker->arena, 4 * old_faces, sizeof *middle);
    if (!sort_pairs(maker) || !middle) return false;
    size_t edges = 0;
    for (size_t i = 0; i < maker->pair_count; i = run_end(maker->pairs, maker->pair_count, i))
        edges++;
    size_t vertices = old_vertices + edges + old_faces;
    double *positions = qm_arena_alloc(maker->arena, 3 * vertices, sizeof *positions);
    uint32_t *faces = qm_arena_alloc(maker->arena, 4 * maker->pair_count, sizeof *faces);
    if (!positions || !faces) return false;
    memcpy(positions, maker->positions, 3 * old_vertices * sizeof *positions);
    size_t next = old_vertices;
    for (size_t i = 0, end; i < maker->pair_count; i = end, next++) {
        end = run_end(maker->pairs, maker->pair_count, i);
        qm_vec_store(positions + 3 * next,
                     qm_vec_mix(qm_vec_load(positions + 3 * (size_t)maker->pairs[i].low),
                                qm_vec_load(positions + 3 * (size_t)maker->pairs[i].high), 0.5));
        for (size_t j = i; j < end; j++)
            middle[maker->pairs[j].side] = (uint32_t)next;
    }
    size_t count = 0;
    for (size_t f = 0; f < old_faces; f++, next++) {
        const uint32_t *face = maker->faces + 4 * f;
        int corners = qm_face_corners(face);
        qm_vec corner[4];
        for (int s = 0; s < corners; s++)
            corner[s] = qm_vec_load(positions + 3 * (size_t)face[s]);
        qm_vec_store(positions + 3 * next, qm_vec_centroid(corner, corners));
        for (int s = 0; s < corners; s++) {
            uint32_t *quad = faces + 4 * count++;
            quad[0] = face[s];
            quad[1] = middle[4 * f + (size_t)s];
            quad[2] = (uint32_t)next;
            quad[3] = middle[4 * f + (size_t)((s + corners - 1) % corners)];
        }
    }
    maker->faces = faces;
    maker->face_count = count;
    maker->positions = positions;
    maker->vertex_count = vertices;
    return true;
}

/* ---- manifold: one vertex for each fan ---- */

/** Numbers the vertices anew: corners are one vertex when edges of two faces lead from one to the other. */
static bool separate_fans(quads_maker *maker)
{
    size_t corners = 4 * maker->face_count;
    uint32_t *parent = qm_arena_alloc(maker->arena, corners, sizeof *parent);
    uint32_t *number = qm_arena_alloc(maker->arena, corners, sizeof *number);
    double *positions = qm_arena_alloc(maker->arena, 3 * corners, sizeof *positions);
    uint32_t *faces = qm_arena_alloc(maker->arena, corners, sizeof *faces);
    if (!sort_pairs(maker) || !parent || !number || !positions || !faces) return false;
    for (size_t c = 0; c < corners; c++)
        parent[c] = (uint32_t)c;
    for (size_t i = 0, end; i < maker->pair_count; i = end) {
        end = run_end(maker->pairs, maker->pair_count, i);
        if (end - i != 2) continue;
        uint32_t one = maker->pairs[i].side, other = maker->pairs[i + 1].side;
        uint32_t one_end = (one & ~3u) | ((one + 1) & 3), other_end = (other & ~3u) | ((other + 1) & 3);
        bool same_way = maker->faces[one] == maker->faces[other];
        qm_union_find_join(parent, one, same_way ? other : other_end);
        qm_union_find_join(parent, one_end, same_way ? other_end : other);
    }
    size_t count = 0;
    for (size_t c = 0; c < corners; c++) {
        uint32_t root = qm_union_find_root(parent, (uint32_t)c);
        if (root == c) {
            memcpy(positions + 3 * count, maker->positions + 3 * (size_t)maker->faces[c],
                   3 * sizeof *positions);
            number[c] = (uint32_t)count++;
        }
        faces[c] = number[root];
    }
    maker->faces = faces;
    maker->positions = positions;
    maker->vertex_count = count;
    return true;
}

/* ---- edges and features ---- */

static bool find_edges(quads_maker *maker, qm_tmesh_quads *out)
{
    out->side_edge = qm_arena_alloc(maker->arena, 4 * maker->face_count, sizeof *out->side_edge);
    out->edges = qm_arena_alloc(maker->arena, 4 * maker->face_count, sizeof *out->edges);
    out->creases = qm_arena_zeroed(maker->arena, maker->face_count, sizeof *out->creases);
    out->is_required = qm_arena_zeroed(maker->arena, maker->vertex_count, sizeof *out->is_required);
    out->is_on_feature = qm_arena_zeroed(maker->arena, maker->vertex_count, sizeof *out->is_on_feature);
    if (!sort_pairs(maker) || !out->side_edge || !out->edges || !out->creases || !out->is_required ||
        !out->is_on_feature)
        return false;
    for (size_t i = 0, end; i < maker->pair_count; i = end) {
        end = run_end(maker->pairs, maker->pair_count, i);
        size_t shared = end - i == 2 ? 2 : 1;
        for (size_t j = i; j < end; j += shared) { /* one edge for each side when they are not two */
            const sided_pair *pair = &maker->pairs[j];
            qm_tmesh_edge *edge = &out->edges[out->edge_count];
            *edge = (qm_tmesh_edge){{pair->low, pair->high}, {pair->side / 4, QM_NO_INDEX}, shared == 1};
            out->side_edge[pair->side] = (uint32_t)out->edge_count;
            if (shared == 2) {
                edge->face[1] = pair[1].side / 4;
                out->side_edge[pair[1].side] = (uint32_t)out->edge_count;
            }
            out->edge_count++;
        }
    }
    return true;
}

static qm_vec face_normal(const qm_mesh *mesh, uint32_t face)
{
    const uint32_t *corner = mesh->faces + 4 * (size_t)face;
    qm_vec p[4];
    for (int i = 0; i < 4; i++)
        p[i] = qm_vec_load(mesh->positions + 3 * (size_t)corner[i]);
    return qm_vec_cross(qm_vec_sub(p[2], p[0]), qm_vec_sub(p[3], p[1]));
}

static bool same_way(const qm_mesh *mesh, const qm_tmesh_edge *edge)
{
    bool way[2] = {false, false};
    for (int i = 0; i < 2; i++)
        for (int s = 0; s < 4; s++) {
            const uint32_t *face = mesh->faces + 4 * (size_t)edge->face[i];
            if (face[s] == edge->vertex[0] && face[(s + 1) & 3] == edge->vertex[1]) way[i] = true;
        }
    return way[0] == way[1];
}

static void mark_sharp(qm_tmesh_quads *quads, double crease_angle)
{
    for (size_t e = 0; e < quads->edge_count; e++) {
        qm_tmesh_edge *edge = &quads->edges[e];
        if (edge->face[1] == QM_NO_INDEX) continue;
        qm_vec a = face_normal(&quads->mesh, edge->face[0]), b = face_normal(&quads->mesh, edge->face[1]);
        if (same_way(&quads->mesh, edge)) b = qm_vec_scale(-1, b);
        edge->is_feature = qm_vec_angle(a, b) > crease_angle * QM_DEGREE;
    }
}

/** The feature edges of each vertex: starts, and edges. */
typedef struct feature_stars {
    uint32_t *start;
    uint32_t *edge;
} feature_stars;

static bool find_stars(qm_arena *arena, const qm_tmesh_quads *quads, feature_stars *stars)
{
    size_t vertices = quads->mesh.vertex_count;
    stars->start = qm_arena_zeroed(arena, vertices + 1, sizeof *stars->start);
    stars->edge = qm_arena_alloc(arena, 2 * quads->edge_count, sizeof *stars->edge);
    if (!stars->start || !stars->edge) return false;
    for (size_t e = 0; e < quads->edge_count; e++)
        for (int i = 0; i < 2 && quads->edges[e].is_feature; i++)
            stars->start[quads->edges[e].vertex[i]]++;
    uint32_t sum = 0;
    for (size_t v = 0; v <= vertices; v++)
        sum = stars->start[v] += sum;
    for (size_t e = quads->edge_count; e-- > 0;)
        for (int i = 0; i < 2 && quads->edges[e].is_feature; i++)
            stars->edge[--stars->start[quads->edges[e].vertex[i]]] = (uint32_t)e;
    return true;
}

static uint32_t other_end(const qm_tmesh_edge *edge, uint32_t vertex)
{
    return edge->vertex[0] == vertex ? edge->vertex[1] : edge->vertex[0];
}

static double edge_length(const qm_tmesh_quads *quads, uint32_t edge)
{
    const uint32_t *v = quads->edges[edge].vertex;
    return qm_vec_distance(qm_vec_load(quads->mesh.positions + 3 * (size_t)v[0]),
                           qm_vec_load(quads->mesh.positions + 3 * (size_t)v[1]));
}

static uint32_t star_size(const feature_stars *stars, uint32_t vertex)
{
    return stars->start[vertex + 1] - stars->start[vertex];
}

/** Walks a feature from a vertex over an edge to where it ends or meets others; clears it when told. Returns its
 * length; *last is the vertex at its end. */
static double walk_feature(qm_tmesh_quads *quads, const feature_stars *stars, uint32_t vertex, uint32_t edge,
                           bool clear, uint32_t *last)
{
    double length = 0;
    uint32_t at = vertex;
    for (;;) {
        length += edge_length(quads, edge);
        if (clear) quads->edges[edge].is_feature = false;
        at = other_end(&quads->edges[edge], at);
        if (at == vertex || star_size(stars, at) != 2) break;
        const uint32_t *pair = stars->edge + stars->start[at];
        edge = pair[0] == edge ? pair[1] : pair[0];
    }
    *last = at;
    return length;
}

/** Removes short creases that end freely, until there are none. */
static bool prune_creases(qm_arena *arena, qm_tmesh_quads *quads, double shortest)
{
    for (bool removed = true; removed;) {
        removed = false;
        feature_stars stars;
        if (!find_stars(arena, quads, &stars)) return false;
        for (uint32_t v = 0; v < quads->mesh.vertex_count; v++) {
            uint32_t size = star_size(&stars, v), last;
            if (size != 1) continue;
            uint32_t edge = stars.edge[stars.start[v]];
            if (!quads->edges[edge].is_feature || quads->edges[edge].face[1] == QM_NO_INDEX) continue;
            if (walk_feature(quads, &stars, v, edge, false, &last) >= shortest) continue;
            walk_feature(quads, &stars, v, edge, true, &last);
            removed = true;
        }
        for (uint32_t v = 0; v < quads->mesh.vertex_count; v++) { /* small loops */
            uint32_t last;
            if (star_size(&stars, v) != 2) continue;
            uint32_t edge = stars.edge[stars.start[v]];
            if (!quads->edges[edge].is_feature || quads->edges[edge].face[1] == QM_NO_INDEX) continue;
            if (walk_feature(quads, &stars, v, edge, false, &last) >= shortest || last != v) continue;
            walk_feature(quads, &stars, v, edge, true, &last);
        }
    }
    return true;
}

/** True when both feature edges of a vertex belong to one of its faces. */
static bool share_face(const qm_tmesh_edge *a, const qm_tmesh_edge *b)
{
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            if (a->face[i] != QM_NO_INDEX && a->face[i] == b->face[j]) return true;
    return false;
}

static bool is_required(const qm_tmesh_quads *quads, const feature_stars *stars, uint32_t v, uint32_t valence)
{
    uint32_t size = star_size(stars, v);
    if (size == 0) return valence != 4;
    if (size != 2) return true;
    const uint32_t *pair = stars->edge + stars->start[v];
    bool on_boundary = quads->edges[pair[0]].face[1] == QM_NO_INDEX;
    if (on_boundary ? valence != 2
                    : valence != 4 || share_face(&quads->edges[pair[0]], &quads->edges[pair[1]]))
        return true;
    return turns_sharply(quads->mesh.positions, other_end(&quads->edges[pair[0]], v), v,
                         other_end(&quads->edges[pair[1]], v));
}

/** Marks the edges of given sides. */
static void mark_given(qm_tmesh_quads *quads, const uint8_t *creases)
{
    for (size_t c = 0; c < 4 * quads->mesh.face_count; c++)
        if (creases[c / 4] >> c % 4 & 1) quads->edges[quads->side_edge[c]].is_feature = true;
}

static bool find_features(qm_arena *arena, const qm_quad_layout_options *options, qm_tmesh_quads *out)
{
    qm_box box = qm_mesh_bounding_box(&out->mesh);
    if (options->creases)
        mark_given(out, options->creases);
    else if (options->crease_angle > 0)
        mark_sharp(out, options->crease_angle);
    if (!prune_creases(arena, out, SHORTEST_SPUR * qm_mesh_box_diagonal(&box))) return false;
    feature_stars stars;
    uint32_t *valence = qm_arena_zeroed(arena, out->mesh.vertex_count, sizeof *valence);
    if (!find_stars(arena, out, &stars) || !valence) return false;
    for (size_t c = 0; c < 4 * out->mesh.face_count; c++) {
        valence[out->mesh.faces[c]]++;
        const qm_tmesh_edge *edge = &out->edges[out->side_edge[c]];
        if (edge->is_feature) out->creases[c / 4] |= (uint8_t)(1u << c % 4);
    }
    for (uint32_t v = 0; v < out->mesh.vertex_count; v++) {
        out->is_on_feature[v] = star_size(&stars, v) > 0;
        out->is_required[v] = is_required(out, &stars, v, valence[v]);
        out->required_count += out->is_required[v];
    }
    return true;
}

qm_status qm_tmesh_quads_make(qm_arena *arena, const qm_mesh *mesh, const qm_quad_layout_options *options,
                              qm_tmesh_quads *out)
{
    *out = (qm_tmesh_quads){0};
    if (mesh->face_count >= (size_t)1 << 27)
        return qm_context_fail(arena->ctx, QM_E_TOO_LARGE, "a layout needs a mesh of fewer than 2^27 faces");
    quads_maker maker = {.arena = arena};
    bool has_triangles = false;
    bool has_memory = take_faces(&maker, mesh, &has_triangles);
    qm_quad_layout_options wanted = *options;
    if (has_triangles || maker.face_count < mesh->face_count)
        wanted.creases = NULL; /* faces have other places */
    if (has_memory && wanted.creases) {
        maker.creases = qm_arena_alloc(arena, maker.face_count, sizeof *maker.creases);
        has_memory = maker.creases != NULL;
        if (has_memory) memcpy(maker.creases, wanted.creases, maker.face_count);
        wanted.creases = maker.creases;
    }
    if (has_memory && wanted.merges_doublets && !has_triangles) has_memory = merge_doublets(&maker);
    if (has_memory && maker.face_count == 0)
        return qm_context_fail(arena->ctx, QM_E_EMPTY, "no face of the quad mesh has an area");
    has_memory = has_memory && (!has_triangles || divide_faces(&maker)) && separate_fans(&maker);
    if (has_memory) {
        out->mesh = (qm_mesh){.positions = maker.positions,
                              .vertex_count = maker.vertex_count,
                              .faces = maker.faces,
                              .face_count = maker.face_count};
        has_memory = find_edges(&maker, out) && find_features(arena, &wanted, out);
    }
    if (has_memory) return QM_OK;
    return qm_context_fail(arena->ctx, QM_E_NO_MEMORY, "out of memory for the edges of %zu quads",
                           mesh->face_count);
}
