/**
 * deviation_regions.c: which pieces touch, found through a tree of their boxes; their components; and what is told of each.
 */
#include "deviation_regions.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "bvh/box_tree.h"
#include "core/rounding.h"
#include "deviation_sum.h"

#define SETTLE_ROUNDS 8        /* in which pieces of regions of which nothing is sure are cut */
#define JOINT_CRACKS 16.0      /* pieces that are nearer than that touch */
#define JOINT_PARAMETERS 1e-11 /* of the parameters of a face: a crack is 1.2e-12 */
#define NEAR_ROUNDINGS 16.0    /* etas: pieces whose distances differ by less are not cut */
#define CANCEL_STRIDE 0x400

/** A piece that may be beyond the limit. */
typedef struct region_piece {
    uint32_t index;   /* of the piece */
    uint32_t key;     /* its place in space, for the order in the tree */
    bool is_sure;     /* all of it is beyond */
    uint32_t link;    /* towards the first piece of the region */
    uint32_t part;    /* towards the first piece of the part that is surely beyond */
    uint32_t face;    /* in the numbering of the input */
    qm_vec corner[3]; /* local, by the extent */
} region_piece;

typedef struct region_work {
    qm_refinement *pieces;
    const qm_deviation_options *options;
    qm_deviation *out;
    double limit, joint; /* local; joint is by the extent too */
    double crack, width; /* local; pieces whose distances differ by no more than the width are not cut */
    region_piece *piece; /* count of them, in the order of the tree */
    size_t count;
    qm_box_tree tree;
} region_work;

/* ---- cuts ---- */

/** The area of a piece on both sides of the limit, as a share of all. */
static double find_open(const void *user, size_t i)
{
    const region_work *work = user;
    const qm_deviation_bounds *piece = &work->pieces->bounds[i];
    bool is_open =
        piece->least <= work->limit && piece->most > work->limit && piece->most - piece->least > work->width;
    return is_open ? piece->area_high / work->pieces->survey.area.upper : QM_NOT_OPEN;
}

/* ---- pieces and their tree ---- */

static uint32_t spread_bits(uint32_t x)
{
    x = (x | x << 16) & 0x030000ff;
    x = (x | x << 8) & 0x0300f00f;
    x = (x | x << 4) & 0x030c30c3;
    return (x | x << 2) & 0x09249249;
}

/** The place of a point with coordinates from -1 to 1 on a curve through space. */
static uint32_t curve_key(qm_vec p)
{
    uint32_t x = (uint32_t)(511.5 * qm_clamp(p.x + 1.0, 0.0, 2.0)),
             y = (uint32_t)(511.5 * qm_clamp(p.y + 1.0, 0.0, 2.0)),
             z = (uint32_t)(511.5 * qm_clamp(p.z + 1.0, 0.0, 2.0));
    return spread_bits(x) | spread_bits(y) << 1 | spread_bits(z) << 2;
}

static int compare_places(const void *a, const void *b)
{
    const region_piece *x = a, *y = b;
    if (x->key != y->key) return x->key < y->key ? -1 : 1;
    return (x->index > y->index) - (x->index < y->index);
}

/** Lists the pieces that may be beyond the limit. */
static qm_status list_pieces(region_work *work)
{
    const qm_refinement *pieces = work->pieces;
    const qm_deviation_setup *setup = &pieces->setup;
    size_t count = 0;
    for (size_t i = 0; i < pieces->count; i++)
        count += pieces->bounds[i].most + work->crack > work->limit;
    if (count == 0) return QM_OK;
    work->piece = qm_context_alloc(pieces->ctx, count, sizeof *work->piece);
    if (!work->piece) return qm_context_fail(pieces->ctx, QM_E_NO_MEMORY, "out of memory for the regions");
    double inverse = 1.0 / qm_max(setup->extent, 1.0);
    for (size_t i = 0; i < pieces->count; i++) {
        if (!(pieces->bounds[i].most + work->crack > work->limit)) continue;
        qm_deviation_face face = qm_deviation_face_load(setup, &pieces->piece[i]);
        region_piece *piece = &work->piece[work->count++];
        *piece = (region_piece){.index = (uint32_t)i,
                                .is_sure = pieces->bounds[i].least > work->limit + JOINT_CRACKS * work->crack,
                                .face = qm_mesh_input_face(&setup->source->mesh, pieces->piece[i].face)};
        qm_vec sum = {0, 0, 0};
        for (int k = 0; k < 3; k++) {
            piece->corner[k] = qm_vec_scale(
                inverse, qm_deviation_face_at(&face, pieces->piece[i].u[k], pieces->piece[i].v[k]));
            sum = qm_vec_add(sum, piece->corner[k]);
        }
        piece->key = curve_key(qm_vec_scale(1.0 / 3.0, sum));
    }
    qsort(work->piece, count, sizeof *work->piece, compare_places);
    for (size_t i = 0; i < count; i++)
        work->piece[i].link = work->piece[i].part = (uint32_t)i;
    if (!qm_box_tree_init(pieces->ctx, count, &work->tree))
        return qm_context_fail(pieces->ctx, QM_E_NO_MEMORY, "out of memory for the regions");
    for (size_t i = 0; i < count; i++) {
        qm_box box = qm_vec_box(work->piece[i].corner, 3);
        qm_box_tree_set(&work->tree, i, &box);
    }
    qm_box_tree_fill(&work->tree, 2);
    return QM_OK;
}

/* ---- touching ---- */

/** True when the corners of two triangles of parameters lie on different sides of an edge of the first, a joint apart. */
static bool is_split_by_edge(const qm_deviation_piece *a, const qm_deviation_piece *b)
{
    for (int i = 0; i < 3; i++) {
        int k = (i + 1) % 3;
        double du = a->u[k] - a->u[i], dv = a->v[k] - a->v[i], length = sqrt(du * du + dv * dv);
        double own[2] = {INFINITY, -INFINITY}, other[2] = {INFINITY, -INFINITY};
        for (int m = 0; m < 3; m++) {
            double here = du * (a->v[m] - a->v[i]) - dv * (a->u[m] - a->u[i]);
            double there = du * (b->v[m] - a->v[i]) - dv * (b->u[m] - a->u[i]);
            own[0] = fmin(own[0], here);
            own[1] = fmax(own[1], here);
            other[0] = fmin(other[0], there);
            other[1] = fmax(other[1], there);
        }
        if (qm_max(other[0] - own[1], own[0] - other[1]) > JOINT_PARAMETERS * length) return true;
    }
    return false;
}

/** True when two faces of the source have a corner at one position. */
static bool share_corner(const qm_mesh *mesh, uint32_t face, uint32_t other)
{
    const uint32_t *a = mesh->faces + 4 * (size_t)face, *b = mesh->faces + 4 * (size_t)other;
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++) {
            if (a[i] == QM_NO_INDEX || b[k] == QM_NO_INDEX) continue;
            if (a[i] == b[k] || qm_vec_equal(qm_vec_load(mesh->positions + 3 * (size_t)a[i]),
                                             qm_vec_load(mesh->positions + 3 * (size_t)b[k])))
                return true;
        }
    return false;
}

static bool do_touch(const region_work *work, const region_piece *a, const region_piece *b)
{
    const qm_deviation_piece *p = &work->pieces->piece[a->index], *q = &work->pieces->piece[b->index];
    if (p->face == q->face && p->second == q->second && p->is_flat == q->is_flat)
        return !is_split_by_edge(p, q) && !is_split_by_edge(q, p);
    if (!share_corner(&work->pieces->setup.source->mesh, p->face, q->face)) return false;
    return qm_triangle_find_gap(a->corner, b->corner).distance <= work->joint;
}

static uint32_t find_first(const region_work *work, uint32_t i)
{
    region_piece *piece = work->piece;
    while (piece[i].link != i)
        i = piece[i].link = piece[piece[i].link].link;
    return i;
}

static uint32_t find_part(const region_work *work, uint32_t i)
{
    region_piece *piece = work->piece;
    while (piece[i].part != i)
        i = piece[i].part = piece[piece[i].part].part;
    return i;
}

/** Joins two pieces if they touch, and their parts if both are surely beyond. */
static void join_pieces(const region_work *work, uint32_t i, uint32_t k)
{
    region_piece *piece = work->piece;
    uint32_t first = find_first(work, i), other = find_first(work, k);
    bool are_sure = piece[i].is_sure && piece[k].is_sure;
    if (first == other && (!are_sure || find_part(work, i) == find_part(work, k))) return;
    if (!do_touch(work, &piece[i], &piece[k])) return;
    piece[first > other ? first : other].link = first > other ? other : first;
    if (!are_sure) return;
    uint32_t part = find_part(work, i), other_part = find_part(work, k);
    piece[part > other_part ? part : other_part].part = part > other_part ? other_part : part;
}

/** Joins a piece with those after it below a node whose boxes meet its own. */
static void join_below(const region_work *work, uint32_t i, const qm_box *box, int level, size_t node)
{
    const qm_box_node *boxes = &work->tree.groups[level][node];
    int count = qm_box_tree_child_count(&work->tree, level, node);
    for (int k = 0; k < count; k++) {
        bool meets = true;
        for (int axis = 0; axis < 3; axis++)
            meets = meets && (double)boxes->low[axis][k] <= box->max[axis] &&
                    (double)boxes->high[axis][k] >= box->min[axis];
        size_t child = 8 * node + (size_t)k, last = (child + 1) << (3 * (level - 1));
        if (!meets || last <= (size_t)i + 1) continue;
        if (level > 1)
            join_below(work, i, box, level - 1, child);
        else
            join_pieces(work, i, (uint32_t)child);
    }
}

static qm_status join_all(const region_work *work)
{
    for (size_t i = 0; i < work->count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(work->pieces->ctx))
            return qm_context_fail(work->pieces->ctx, QM_E_CANCELED, "deviation canceled");
        qm_box box = qm_vec_box(work->piece[i].corner, 3);
        join_below(work, (uint32_t)i, &box, work->tree.level_count, 0);
    }
    return QM_OK;
}

/* ---- figures ---- */

/** Sums over the pieces of a region. */
typedef struct region_sums {
    long double beyond[2], area;
    qm_vec moment; /* of their centroids, by area */
    qm_interval max;
    uint32_t witness; /* the piece with max.lower, and its corner */
    int corner;
    qm_vec low, high;
} region_sums;

/** The area of a piece beyond the limit: at least, and at most. The share of a piece on both sides of it is off by roundings that are
 * small beside the piece, not beside what is beyond. */
static qm_status find_beyond(const region_work *work, size_t i, long double beyond[2])
{
    const qm_deviation_bounds *bounds = &work->pieces->bounds[i];
    double error = bounds->least > work->limit ? 0.0 : qm_deviation_share_error(1) * bounds->area_high;
    long double rows[2 * QM_SHARE_ROWS];
    qm_deviation_areas areas;
    const qm_deviation_piece_list one = {bounds, 1, 0.0, work->pieces->farthest};
    qm_status status =
        qm_deviation_find_areas(work->pieces->ctx, one, NULL, 0, &work->limit, 1, rows, &areas);
    if (status == QM_OK) {
        beyond[0] = fmaxl(0, areas.least_beyond - (long double)error);
        beyond[1] = fminl((long double)bounds->area_high, areas.most_beyond + (long double)error);
    }
    return status;
}

static qm_status add_piece(const region_work *work, const region_piece *piece, region_sums *sums)
{
    const qm_deviation_bounds *bounds = &work->pieces->bounds[piece->index];
    const qm_deviation_setup *setup = &work->pieces->setup;
    qm_deviation_face face = qm_deviation_face_load(setup, &work->pieces->piece[piece->index]);
    qm_deviation_shape shape = qm_deviation_shape_make(setup, &face, &work->pieces->piece[piece->index]);
    long double beyond[2];
    qm_status status = find_beyond(work, piece->index, beyond);
    if (status != QM_OK) return status;
    sums->beyond[0] += beyond[0];
    sums->beyond[1] += beyond[1];
    sums->area += (long double)bounds->area_high;
    sums->moment = qm_vec_axpy(sums->moment, bounds->area_high, shape.centroid);
    for (int k = 0; k < 3; k++) {
        double room = shape.slack + work->crack;
        const qm_vec c = shape.corner[k], open = {room, room, room};
        qm_vec low = qm_vec_sub(c, open), high = qm_vec_add(c, open);
        sums->low = (qm_vec){fmin(sums->low.x, low.x), fmin(sums->low.y, low.y), fmin(sums->low.z, low.z)};
        sums->high =
            (qm_vec){fmax(sums->high.x, high.x), fmax(sums->high.y, high.y), fmax(sums->high.z, high.z)};
        double here = bounds->invalid_low > 0.0 ? bounds->least : qm_deviation_bounds_corner_least(bounds, k);
        here -= face.slack + setup->eta;
        if (!(here > sums->max.lower)) continue;
        sums->max.lower = here;
        sums->witness = piece->index;
        sums->corner = k;
    }
    sums->max.upper = fmax(sums->max.upper, bounds->most);
    return QM_OK;
}

/** The witness, as parameters of its face, and its foot. */
static void set_witness(const region_work *work, const region_sums *sums, qm_deviation_region *out)
{
    const qm_deviation_setup *setup = &work->pieces->setup;
    const qm_deviation_piece *piece = &work->pieces->piece[sums->witness];
    out->has_witness = sums->max.lower > 0.0;
    if (!out->has_witness) return;
    qm_vec p =
        qm_deviation_piece_point(setup, piece, piece->u[sums->corner], piece->v[sums->corner], &out->from);
    out->to = qm_deviation_foot(setup, work->options->quads, p);
}

/** An area in square units of the meshes, rounded outward by far more than the sums are. */
static double to_area(const region_work *work, long double area, bool is_lower)
{
    const qm_deviation_setup *setup = &work->pieces->setup;
    double error = qm_deviation_sum_error(work->count) * (is_lower ? -1.0 : 1.0);
    double leak = is_lower ? -work->pieces->leak : work->pieces->leak;
    return qm_deviation_unit_area(setup, fmax(0.0, (double)area * (1.0 + error) + leak), is_lower);
}

static void set_region(const region_work *work, const region_sums *sums, qm_deviation_region *out)
{
    const qm_frame *frame = &work->pieces->setup.target->frame;
    out->area = (qm_interval){to_area(work, sums->beyond[0], true), to_area(work, sums->beyond[1], false)};
    out->max = (qm_interval){
        fmin(fmax(0.0, sums->max.lower) * frame->inverse_scale, work->out->max.upper),
        fmin((sums->max.upper + work->crack) * frame->inverse_scale + DBL_MIN, work->out->max.upper)};
    double area = (double)sums->area;
    qm_vec centroid =
        area > 0.0 ? qm_vec_scale(1.0 / area, sums->moment) : qm_vec_mix(sums->low, sums->high, 0.5);
    qm_vec_store(out->centroid, qm_frame_world(frame, centroid));
    qm_vec_store(out->box.min, qm_frame_world(frame, sums->low));
    qm_vec_store(out->box.max, qm_frame_world(frame, sums->high));
    for (int k = 0; k < 3; k++) {
        out->box.min[k] = nextafter(out->box.min[k], -INFINITY);
        out->box.max[k] = nextafter(out->box.max[k], INFINITY);
    }
    set_witness(work, sums, out);
}

/* ---- the list ---- */

/** A face that a region is on. */
typedef struct region_face {
    uint32_t region, face;
} region_face;

static int compare_faces(const void *a, const void *b)
{
    const region_face *x = a, *y = b;
    if (x->region != y->region) return x->region < y->region ? -1 : 1;
    return (x->face > y->face) - (x->face < y->face);
}

/** Numbers the regions by their first pieces: link becomes the number. Returns how many there are. */
static size_t number_regions(region_work *work)
{
    size_t count = 0;
    /* A first piece comes before all others of its region, so that its number is known when they ask for it. */
    for (uint32_t i = 0; i < work->count; i++) {
        uint32_t first = work->piece[i].link;
        work->piece[i].link = first == i ? (uint32_t)count++ : work->piece[first].link;
    }
    return count;
}

/** Shortens all links to one step. */
static void shorten_links(const region_work *work)
{
    for (uint32_t i = 0; i < work->count; i++)
        work->piece[i].link = find_first(work, i);
}

static qm_status sum_up(const region_work *work, region_sums *sums)
{
    qm_status status = QM_OK;
    for (size_t r = 0; r < work->out->region_count; r++)
        sums[r] = (region_sums){.max = {-INFINITY, 0.0},
                                .low = {INFINITY, INFINITY, INFINITY},
                                .high = {-INFINITY, -INFINITY, -INFINITY}};
    for (uint32_t i = 0; status == QM_OK && i < work->count; i++) {
        const region_piece *piece = &work->piece[i];
        qm_deviation_region *region = &work->out->region[piece->link];
        region->parts += piece->is_sure && find_part(work, i) == i;
        status = add_piece(work, piece, &sums[piece->link]);
    }
    for (size_t r = 0; status == QM_OK && r < work->out->region_count; r++)
        set_region(work, &sums[r], &work->out->region[r]);
    return status;
}

/** Lists the faces of all regions; faces has room for one of each piece. */
static qm_status list_faces(const region_work *work, region_face *faces)
{
    qm_deviation *out = work->out;
    size_t listed = 0;
    for (size_t i = 0; i < work->count; i++)
        faces[i] = (region_face){work->piece[i].link, work->piece[i].face};
    qsort(faces, work->count, sizeof *faces, compare_faces);
    for (int pass = 0; pass < 2; pass++) {
        listed = 0;
        for (size_t i = 0; i < work->count; i++) {
            qm_deviation_region *region = &out->region[faces[i].region];
            if (i == 0 || faces[i - 1].region != faces[i].region) {
                region->first_face = listed;
                region->face_count = region->listed_faces = 0;
            } else if (faces[i - 1].face == faces[i].face) {
                continue;
            }
            if (region->face_count++ >= work->options->face_limit) continue;
            if (pass == 1) out->region_face[listed] = faces[i].face;
            region->listed_faces++;
            listed++;
        }
        if (pass == 1 || listed == 0) continue;
        out->region_face = qm_context_alloc(work->pieces->ctx, listed, sizeof *out->region_face);
        if (!out->region_face)
            return qm_context_fail(work->pieces->ctx, QM_E_NO_MEMORY, "out of memory for the regions");
        out->region_face_count = listed;
    }
    return QM_OK;
}

/** The farthest first; of equally far ones the largest, then that of the lower face. */
static int compare_regions(const void *a, const void *b)
{
    const qm_deviation_region *x = a, *y = b;
    if (x->max.lower != y->max.lower) return x->max.lower > y->max.lower ? -1 : 1;
    if (x->area.upper != y->area.upper) return x->area.upper > y->area.upper ? -1 : 1;
    return (x->first_face > y->first_face) - (x->first_face < y->first_face);
}

static qm_status tell_regions(region_work *work)
{
    qm_context *ctx = work->pieces->ctx;
    qm_deviation *out = work->out;
    shorten_links(work);
    size_t count = number_regions(work);
    out->region = qm_context_alloc(ctx, count, sizeof *out->region);
    region_sums *sums = qm_context_alloc(ctx, count, sizeof *sums);
    region_face *faces = qm_context_alloc(ctx, work->count, sizeof *faces);
    qm_status status = out->region && sums && faces
                           ? QM_OK
                           : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the regions");
    if (out->region) {
        memset(out->region, 0, count * sizeof *out->region);
        out->region_count = count;
    }
    if (status == QM_OK) status = sum_up(work, sums);
    if (status == QM_OK) status = list_faces(work, faces);
    if (status == QM_OK) qsort(out->region, count, sizeof *out->region, compare_regions);
    qm_context_free(ctx, sums, count, sizeof *sums);
    qm_context_free(ctx, faces, work->count, sizeof *faces);
    return status;
}

/* ---- the call ---- */

/** Forgets the pieces and what they touch. */
static void forget_pieces(region_work *work)
{
    qm_context *ctx = work->pieces->ctx;
    qm_context_free(ctx, work->piece, work->count, sizeof *work->piece);
    qm_box_tree_reset(ctx, &work->tree);
    work->piece = NULL;
    work->count = 0;
    work->tree = (qm_box_tree){0};
}

/** Marks the pieces of regions of which no piece is surely beyond. Returns how many. */
static size_t mark_unsure(const region_work *work, uint8_t *marks, uint8_t *is_sure)
{
    size_t marked = 0;
    memset(marks, 0, work->pieces->count);
    memset(is_sure, 0, work->count);
    for (uint32_t i = 0; i < work->count; i++)
        if (work->piece[i].is_sure) is_sure[find_first(work, i)] = 1;
    for (uint32_t i = 0; i < work->count; i++) {
        const qm_deviation_bounds *bounds = &work->pieces->bounds[work->piece[i].index];
        if (is_sure[find_first(work, i)] || !(bounds->most - bounds->least > work->width)) continue;
        marks[work->piece[i].index] = 1;
        marked++;
    }
    return marked;
}

/** Cuts the pieces of regions of which nothing is sure; *cut is how many. */
static qm_status cut_unsure(const region_work *work, size_t *cut)
{
    qm_refinement *pieces = work->pieces;
    size_t count = pieces->count;
    uint8_t *marks = qm_context_alloc(pieces->ctx, count, 1),
            *is_sure = qm_context_alloc(pieces->ctx, work->count, 1);
    qm_status status = marks && is_sure
                           ? QM_OK
                           : qm_context_fail(pieces->ctx, QM_E_NO_MEMORY, "out of memory for the regions");
    *cut = 0;
    if (status == QM_OK && mark_unsure(work, marks, is_sure) > 0)
        status = qm_refinement_cut(pieces, marks, cut);
    qm_context_free(pieces->ctx, marks, count, 1);
    qm_context_free(pieces->ctx, is_sure, work->count, 1);
    return status;
}

/** Finds which pieces touch. Regions of which nothing is sure are mostly gone when their pieces are smaller. */
static qm_status find_components(region_work *work)
{
    for (int round = 0;; round++) {
        size_t cut = 0;
        qm_status status = list_pieces(work);
        if (status == QM_OK && work->count > 0) status = join_all(work);
        if (status != QM_OK || work->count == 0 || round == SETTLE_ROUNDS) return status;
        status = cut_unsure(work, &cut);
        if (status != QM_OK || cut == 0) return status;
        forget_pieces(work);
    }
}

qm_status qm_deviation_regions_find(qm_refinement *pieces, const qm_deviation_options *options,
                                    qm_deviation *out)
{
    double crack = QM_CRACK_ROUNDINGS * QM_UNIT_ROUNDING * pieces->setup.extent;
    region_work work = {.pieces = pieces,
                        .options = options,
                        .out = out,
                        .limit = options->region_limit * pieces->setup.target->frame.scale,
                        .joint = JOINT_CRACKS * crack / qm_max(pieces->setup.extent, 1.0),
                        .crack = crack,
                        .width = qm_max(NEAR_ROUNDINGS * pieces->setup.eta,
                                        options->tolerance * pieces->setup.target->frame.scale)};
    qm_status status = qm_refinement_cut_open(pieces, find_open, NULL, &work);
    if (status == QM_OK) status = find_components(&work);
    if (status == QM_OK) status = qm_refinement_survey(pieces);
    if (status == QM_OK && work.count > 0) status = tell_regions(&work);
    out->has_regions = status == QM_OK;
    forget_pieces(&work);
    return status;
}
