/**
 * tmesh_guides.c: how the curves of a layout could run in the quads without meeting.
 *
 * What falls on one point is a tree of arcs without length and lines across patches without width (tmesh_classes.c). One point of it is its
 * node, and the curves that end elsewhere in it follow the tree to there.
 */
#include <math.h>
#include <string.h>

#include "tmesh/tmesh.h"

#define REACH 0.1 /* of the diagonal: how far from the surface a node may be */

enum { LINE = 3 }; /* inner points of a line across a patch */

/** A part of a tree: an arc, or a line across a patch. */
typedef struct tree_link {
    uint32_t point[2], arc; /* QM_NO_INDEX: a line */
    qm_vec line[LINE];
} tree_link;

typedef struct guide_finder {
    qm_arena *arena;
    const qm_tmesh_quads *quads;
    const qm_tmesh *tmesh;
    const uint32_t *length;
    const qm_tmesh_classes *classes;
    const qm_tmesh_source *source;
    tree_link *links;
    size_t link_count;
    uint32_t *link_first, *link_at; /* by point: of link_at */
    uint32_t *back;                 /* by point: the link towards the node of its class; QM_NO_INDEX at it */
    qm_tmesh_place *place;          /* by point */
    uint32_t *node;                 /* by lowest point: the node of the class */
    qm_vec *points;
    size_t count, capacity;
} guide_finder;

static uint32_t arc_point(const guide_finder *f, uint32_t arc, uint32_t step)
{
    if (step == 0) return f->tmesh->arcs[arc].from;
    return step == f->length[arc] ? f->tmesh->arcs[arc].to : f->classes->first_point[arc] + step - 1;
}

static bool place_points(guide_finder *f)
{
    const qm_tmesh *tmesh = f->tmesh;
    f->place = qm_arena_alloc(f->arena, f->classes->point_count, sizeof *f->place);
    if (!f->place) return false;
    for (uint32_t n = 0; n < tmesh->node_count; n++)
        f->place[n] = qm_tmesh_source_point(f->source, f->source->node_points[n]);
    for (uint32_t a = 0; a < tmesh->arc_count; a++)
        for (uint32_t i = 1; i < f->length[a]; i++)
            f->place[arc_point(f, a, i)] = qm_tmesh_source_on_arc(f->source, a, (double)i / f->length[a]);
    return true;
}

/** Adds the lines across a patch without width, along an axis. */
static void add_lines(guide_finder *f, size_t p, int axis)
{
    const qm_tmesh_classes *classes = f->classes;
    uint32_t height = qm_tmesh_side_steps(classes, p, axis + 1);
    int one = axis + 1, other = (axis + 3) & 3;
    double size = qm_tmesh_side_length(f->tmesh, f->source->arc_cells, p, axis),
           far = qm_tmesh_side_length(f->tmesh, f->source->arc_cells, p, axis + 1);
    for (uint32_t i = 1; i < height; i++) {
        tree_link *link = &f->links[f->link_count++];
        *link = (tree_link){.point = {qm_tmesh_side_point(classes, p, one, i),
                                      qm_tmesh_side_point(classes, p, other, height - i)},
                            .arc = QM_NO_INDEX};
        double high = qm_tmesh_source_on_side(f->source, f->tmesh, f->length, p, one, i),
               low = qm_tmesh_source_on_side(f->source, f->tmesh, f->length, p, other, height - i);
        /* side 1 and side 0 run up, sides 2 and 3 down */
        double start = one == 1 ? high : far - high, end = other == 0 ? low : far - low;
        for (int k = 0; k < LINE; k++) {
            double share = (k + 1.0) / (LINE + 1), across = size * (1 - share),
                   along = start + share * (end - start);
            link->line[k] = qm_tmesh_source_in_patch(f->source, f->tmesh, p, axis == 0 ? across : along,
                                                     axis == 0 ? along : across)
                                .at;
        }
    }
}

static bool list_links(guide_finder *f)
{
    const qm_tmesh *tmesh = f->tmesh;
    const qm_tmesh_classes *classes = f->classes;
    size_t capacity = tmesh->arc_count + classes->first_side[4 * tmesh->patch_count];
    f->links = qm_arena_alloc(f->arena, capacity, sizeof *f->links);
    f->link_first = qm_arena_zeroed(f->arena, classes->point_count + 1, sizeof *f->link_first);
    f->link_at = qm_arena_alloc(f->arena, 2 * capacity, sizeof *f->link_at);
    if (!f->links || !f->link_first || !f->link_at) return false;
    for (uint32_t a = 0; a < tmesh->arc_count; a++)
        if (f->length[a] == 0)
            f->links[f->link_count++] =
                (tree_link){.point = {tmesh->arcs[a].from, tmesh->arcs[a].to}, .arc = a};
    for (size_t p = 0; p < tmesh->patch_count; p++)
        for (int axis = 0; axis < 2; axis++)
            if (qm_tmesh_side_steps(classes, p, axis) == 0) add_lines(f, p, axis);
    for (size_t i = 0; i < 2 * f->link_count; i++)
        f->link_first[f->links[i / 2].point[i % 2]]++;
    uint32_t sum = 0;
    for (size_t i = 0; i <= classes->point_count; i++)
        sum = f->link_first[i] += sum;
    for (size_t i = 2 * f->link_count; i-- > 0;)
        f->link_at[--f->link_first[f->links[i / 2].point[i % 2]]] = (uint32_t)(i / 2);
    return true;
}

/** Chooses the node of each class: the point that must be one, or else that nearest to the middle of all. */
static bool choose_nodes(guide_finder *f)
{
    const qm_tmesh_classes *classes = f->classes;
    qm_vec *sum = qm_arena_zeroed(f->arena, classes->point_count, sizeof *sum);
    uint32_t *count = qm_arena_zeroed(f->arena, classes->point_count, sizeof *count);
    uint8_t *rank = qm_arena_zeroed(f->arena, classes->point_count, 1);
    f->node = qm_arena_alloc(f->arena, classes->point_count, sizeof *f->node);
    if (!sum || !count || !rank || !f->node) return false;
    for (uint32_t i = 0; i < classes->point_count; i++) {
        uint32_t root = classes->point_class[i];
        sum[root] = qm_vec_add(sum[root], f->place[i].at);
        count[root]++;
    }
    for (uint32_t i = 0; i < classes->point_count; i++) {
        uint32_t root = classes->point_class[i];
        uint8_t own = 1;
        if (i < f->tmesh->node_count) {
            uint32_t vertex = f->tmesh->node_vertex[i];
            own = f->quads->is_required[vertex] ? 3 : f->quads->is_on_feature[vertex] ? 2 : 1;
        }
        qm_vec middle = qm_vec_scale(1.0 / count[root], sum[root]);
        bool is_nearer = rank[root] == own && qm_vec_distance(f->place[i].at, middle) <
                                                  qm_vec_distance(f->place[f->node[root]].at, middle);
        if (own > rank[root] || is_nearer) {
            rank[root] = own;
            f->node[root] = i;
        }
    }
    return true;
}

/** Grows the tree of each class from its node. */
static bool grow_trees(guide_finder *f)
{
    const qm_tmesh_classes *classes = f->classes;
    uint32_t *queue = qm_arena_alloc(f->arena, classes->point_count, sizeof *queue);
    bool *is_reached = qm_arena_zeroed(f->arena, classes->point_count, sizeof *is_reached);
    f->back = qm_arena_alloc(f->arena, classes->point_count, sizeof *f->back);
    if (!queue || !is_reached || !f->back) return false;
    size_t count = 0;
    for (uint32_t i = 0; i < classes->point_count; i++) {
        f->back[i] = QM_NO_INDEX;
        if (classes->point_class[i] != i) continue;
        is_reached[f->node[i]] = true;
        queue[count++] = f->node[i];
    }
    for (size_t head = 0; head < count; head++)
        for (uint32_t i = f->link_first[queue[head]]; i < f->link_first[queue[head] + 1]; i++) {
            const tree_link *link = &f->links[f->link_at[i]];
            uint32_t next = link->point[link->point[0] == queue[head]];
            if (is_reached[next]) continue;
            is_reached[next] = true;
            f->back[next] = f->link_at[i];
            queue[count++] = next;
        }
    return true;
}

static bool add_point(guide_finder *f, qm_vec at)
{
    if (f->count == f->capacity) {
        size_t capacity = 2 * f->capacity + 1024;
        qm_vec *grown = qm_arena_alloc(f->arena, capacity, sizeof *grown);
        if (!grown) return false;
        if (f->count > 0) memcpy(grown, f->points, f->count * sizeof *grown);
        f->points = grown;
        f->capacity = capacity;
    }
    f->points[f->count++] = at;
    return true;
}

/** Adds the path from a point to the node of its class, without the point itself. */
static bool add_path(guide_finder *f, uint32_t at)
{
    while (f->back[at] != QM_NO_INDEX) {
        const tree_link *link = &f->links[f->back[at]];
        bool is_forward = link->point[0] == at;
        uint32_t inner = link->arc == QM_NO_INDEX ? LINE : f->source->arc_cells[link->arc] - 1;
        if (link->arc != QM_NO_INDEX && f->source->arc_cells[link->arc] == 0) inner = 0;
        for (uint32_t k = 0; k < inner; k++) {
            uint32_t i = is_forward ? k : inner - 1 - k;
            qm_vec to = link->arc == QM_NO_INDEX
                            ? link->line[i]
                            : qm_tmesh_source_on_arc(f->source, link->arc, (i + 1.0) / (inner + 1.0)).at;
            if (!add_point(f, to)) return false;
        }
        at = link->point[is_forward];
        if (!add_point(f, f->place[at].at)) return false;
    }
    return true;
}

static void reverse(qm_vec *points, size_t count)
{
    for (size_t i = 0; 2 * i + 1 < count; i++) {
        qm_vec spare = points[i];
        points[i] = points[count - 1 - i];
        points[count - 1 - i] = spare;
    }
}

/** Puts the nodes onto the wall of the surface that they belong to. */
static void project_nodes(guide_finder *f, const qm_ref_surface *surface)
{
    for (uint32_t i = 0; i < f->classes->point_count && f->source->is_oriented; i++) {
        if (f->classes->point_class[i] != i) continue;
        qm_tmesh_place *place = &f->place[f->node[i]];
        double at[3], normal[3];
        qm_ref_surface_point on;
        qm_vec_store(at, place->at);
        qm_vec_store(normal, place->normal);
        if (qm_vec_norm2(place->normal) > 0 &&
            qm_ref_surface_project_toward(surface, at, normal, REACH * surface->diagonal, &on))
            place->at = qm_vec_load(on.position);
    }
}

static bool find_guide(guide_finder *f, uint32_t arc, uint32_t step)
{
    size_t start = f->count;
    uint32_t from = arc_point(f, arc, step), to = arc_point(f, arc, step + 1);
    double cells = f->source->arc_cells[arc];
    if (!add_point(f, f->place[from].at) || !add_path(f, from)) return false;
    reverse(f->points + start, f->count - start);
    double low = cells * step / f->length[arc], high = cells * (step + 1) / f->length[arc];
    for (double at = floor(low) + 1; at < high; at++)
        if (!add_point(f, qm_tmesh_source_on_arc(f->source, arc, at / cells).at)) return false;
    return add_point(f, f->place[to].at) && add_path(f, to);
}

/** A corner of the faces of a patch, and the point that it is on a side; QM_NO_INDEX inside. */
static qm_vec patch_corner(const guide_finder *f, size_t p, double column, double row, uint32_t *point)
{
    const qm_tmesh_classes *classes = f->classes;
    uint32_t width = qm_tmesh_side_steps(classes, p, 0), height = qm_tmesh_side_steps(classes, p, 1),
             c = (uint32_t)column, r = (uint32_t)row;
    *point = QM_NO_INDEX;
    if (column == c && row == r) {
        if (r == 0)
            *point = qm_tmesh_side_point(classes, p, 0, c);
        else if (c == width)
            *point = qm_tmesh_side_point(classes, p, 1, r);
        else if (r == height)
            *point = qm_tmesh_side_point(classes, p, 2, width - c);
        else if (c == 0)
            *point = qm_tmesh_side_point(classes, p, 3, height - r);
    }
    if (*point != QM_NO_INDEX) return f->place[*point].at;
    double size[2] = {qm_tmesh_side_length(f->tmesh, f->source->arc_cells, p, 0),
                      qm_tmesh_side_length(f->tmesh, f->source->arc_cells, p, 1)},
           bottom = qm_tmesh_source_on_side(f->source, f->tmesh, f->length, p, 0, column),
           top = size[0] - qm_tmesh_source_on_side(f->source, f->tmesh, f->length, p, 2, width - column),
           left = size[1] - qm_tmesh_source_on_side(f->source, f->tmesh, f->length, p, 3, height - row),
           right = qm_tmesh_source_on_side(f->source, f->tmesh, f->length, p, 1, row);
    return qm_tmesh_source_in_patch(f->source, f->tmesh, p, bottom + row / height * (top - bottom),
                                    left + column / width * (right - left))
        .at;
}

/** The guide of a line between faces of one patch, from a corner of them to the next. */
static bool find_inner(guide_finder *f, size_t p, uint32_t column, uint32_t row, bool is_up)
{
    size_t start = f->count;
    uint32_t from, to, inner;
    qm_vec at = patch_corner(f, p, column, row, &from);
    if (!add_point(f, at) || (from != QM_NO_INDEX && !add_path(f, from))) return false;
    reverse(f->points + start, f->count - start);
    for (int k = 1; k <= LINE; k++) {
        double share = k / (LINE + 1.0);
        at = patch_corner(f, p, column + (is_up ? 0 : share), row + (is_up ? share : 0), &inner);
        if (!add_point(f, at)) return false;
    }
    at = patch_corner(f, p, column + !is_up, row + is_up, &to);
    return add_point(f, at) && (to == QM_NO_INDEX || add_path(f, to));
}

static size_t count_inner(const guide_finder *f)
{
    size_t count = 0;
    for (size_t p = 0; p < f->tmesh->patch_count; p++) {
        size_t width = qm_tmesh_side_steps(f->classes, p, 0), height = qm_tmesh_side_steps(f->classes, p, 1);
        if (width > 0 && height > 0) count += width * (height - 1) + height * (width - 1);
    }
    return count;
}

bool qm_tmesh_guides_find(qm_arena *arena, const qm_tmesh_quads *quads, const qm_tmesh *tmesh,
                          const uint32_t *length, const qm_tmesh_classes *classes,
                          const qm_tmesh_source *source, const qm_ref_surface *surface, qm_tmesh_guides *out)
{
    guide_finder f = {.arena = arena,
                      .quads = quads,
                      .tmesh = tmesh,
                      .length = length,
                      .classes = classes,
                      .source = source};
    *out = (qm_tmesh_guides){.count = classes->segment_count + count_inner(&f)};
    out->first = qm_arena_alloc(arena, out->count + 1, sizeof *out->first);
    out->from_class = qm_arena_zeroed(arena, classes->segment_count, sizeof *out->from_class);
    if (!out->first || !out->from_class || !place_points(&f) || !list_links(&f) || !choose_nodes(&f) ||
        !grow_trees(&f))
        return false;
    project_nodes(&f, surface);
    for (uint32_t a = 0, segment = 0; a < tmesh->arc_count; a++)
        for (uint32_t i = 0; i < length[a]; i++, segment++) {
            out->first[segment] = f.count;
            out->from_class[segment] = classes->point_class[arc_point(&f, a, i)];
            if (classes->segment_class[segment] == segment && !find_guide(&f, a, i)) return false;
        }
    size_t next = classes->segment_count;
    for (size_t p = 0; p < tmesh->patch_count; p++) {
        uint32_t width = qm_tmesh_side_steps(classes, p, 0), height = qm_tmesh_side_steps(classes, p, 1);
        for (uint32_t row = 0; row < height; row++)
            for (uint32_t column = 0; column < width; column++)
                for (int is_up = 0; is_up < 2; is_up++) {
                    if (is_up ? column == 0 : row == 0) continue;
                    out->first[next++] = f.count;
                    if (!find_inner(&f, p, column, row, is_up)) return false;
                }
    }
    out->first[next] = f.count;
    out->points = f.points;
    return true;
}
