/**
 * quads.c: quads of a surface, component by component.
 */
#include "qm/quads.h"

#include <string.h>

#include "mesh/quad_shape.h"
#include "quads/quads_internal.h"

#define MOST_PIECES 1000.0 /* a triangle is cut into, in the mean over triangles and wanted quads */
#define TRIANGLE_SIDE 0.9  /* of the triangles on which fields are found, in sides of a quad */
#define LARGEST                                                                                              \
    1e75 /* diagonal of a surface: squares of areas would not be finite beyond 1e77, nor normal below 1e-77 */
/* Length of a boundary that is filled, in sides of a quad: four quads round it would have no shape. */
#define SMALL_HOLE 2.0
#define LEAST_QUADS 24    /* of a component */
#define WANTED_OFF 0.04   /* number of quads from the wanted one, as a share */
#define FAR_TOO_SMALL 0.8 /* of the area of a surface: quads that cover less have lost parts of it */
#define FAR_OFF 0.1
#define ATTEMPTS 3
#define MOST_ATTEMPTS                                                                                        \
    6 /* while the number is far off, or below FEW_QUADS, where they are fast and a row is a large share */
#define FEW_QUADS 1000
/* Irregular vertices beyond those of the field: with more, no grid follows it, and a field as it was smoothed is tried as well. */
#define MOST_ADDED 8

qm_quads_options qm_quads_options_default(void)
{
    return (qm_quads_options){.quads = 5000, .crease_angle = 40.0, .thread_count = 1};
}

double qm_quads_area(const double *positions, const uint32_t (*corner)[3], size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        qm_vec p[3];
        for (int k = 0; k < 3; k++)
            p[k] = qm_vec_load(positions + 3 * (size_t)corner[i][k]);
        sum += 0.5 * qm_vec_norm(qm_vec_cross(qm_vec_sub(p[1], p[0]), qm_vec_sub(p[2], p[0])));
    }
    return sum;
}

double qm_quads_mesh_area(const qm_mesh *m)
{
    double sum = 0.0;
    for (size_t f = 0; f < m->face_count; f++) {
        qm_vec corner[4];
        for (size_t k = 0; k < 4; k++)
            corner[k] = qm_vec_load(m->positions + 3 * (size_t)m->faces[4 * f + k]);
        sum += 0.5 * qm_vec_norm(qm_quad_normal(corner));
    }
    return sum;
}

/*
 * One component.
 */

/** The quads of a component, and its features as pairs of points. */
typedef struct part {
    qm_quads_result quads; /* without features */
    qm_quads_segment *segments;
    size_t segment_count;
} part;

void qm_quads_result_reset(qm_context *ctx, qm_quads_result *r)
{
    qm_context_free(ctx, r->is_fixed, r->mesh.vertex_count, 1);
    qm_context_free(ctx, r->is_feature, r->mesh.face_count, 4);
    qm_context_free(ctx, r->feature_normal, r->features.face_count, sizeof *r->feature_normal);
    qm_mesh_reset(ctx, &r->mesh);
    qm_mesh_reset(ctx, &r->features);
    *r = (qm_quads_result){0};
}

static void reset_part(qm_context *ctx, part *p)
{
    qm_quads_result_reset(ctx, &p->quads);
    qm_context_free(ctx, p->segments, p->segment_count, sizeof *p->segments);
    *p = (part){0};
}

/** The mean of the normals on both sides. */
static qm_vec normal_between(const qm_trimesh *m, uint32_t h)
{
    uint32_t t = m->twin[h];
    qm_vec a = qm_trimesh_normal(m, h / 3), b = t == QM_NO_INDEX ? a : qm_trimesh_normal(m, t / 3);
    double length_a = qm_vec_norm(a), length_b = qm_vec_norm(b);
    if (!(length_a > 0.0 && length_b > 0.0)) return (qm_vec){0, 0, 0};
    qm_vec sum = qm_vec_add(qm_vec_scale(1.0 / length_a, a), qm_vec_scale(1.0 / length_b, b));
    double length = qm_vec_norm(sum);
    return length > 1e-3 ? qm_vec_scale(1.0 / length, sum) : (qm_vec){0, 0, 0};
}

qm_status qm_quads_list_features(qm_context *ctx, const qm_trimesh *m, qm_quads_segment **segments,
                                 size_t *out)
{
    size_t count = 0;
    *segments = NULL;
    *out = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        count += m->is_feature[h] && (m->twin[h] == QM_NO_INDEX || m->twin[h] > h);
    if (count == 0) return QM_OK;
    *segments = qm_context_alloc(ctx, count, sizeof **segments);
    if (!*segments) return QM_E_NO_MEMORY;
    *out = count;
    qm_quads_segment *row = *segments;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        if (!m->is_feature[h] || (m->twin[h] != QM_NO_INDEX && m->twin[h] < h)) continue;
        *row++ = (qm_quads_segment){{m->position[m->from[h]], m->position[qm_trimesh_to(m, h)]},
                                    normal_between(m, h)};
    }
    return QM_OK;
}

qm_status qm_quads_set_features(qm_context *ctx, const qm_quads_segment *segments, size_t count,
                                qm_quads_result *r)
{
    qm_mesh *out = &r->features;
    *out = (qm_mesh){.vertex_count = 2 * count, .face_count = count};
    if (count == 0) return QM_OK;
    out->positions = qm_context_alloc(ctx, count, 6 * sizeof *out->positions);
    out->faces = qm_context_alloc(ctx, count, 4 * sizeof *out->faces);
    r->feature_normal = qm_context_alloc(ctx, count, sizeof *r->feature_normal);
    if (!out->positions || !out->faces || !r->feature_normal) return QM_E_NO_MEMORY;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t *c = out->faces + 4 * (size_t)i; /* a face that repeats a corner is a segment */
        c[0] = 2 * i, c[1] = c[2] = 2 * i + 1, c[3] = QM_NO_INDEX;
        qm_vec_store(out->positions + 6 * (size_t)i, segments[i].end[0]);
        qm_vec_store(out->positions + 6 * (size_t)i + 3, segments[i].end[1]);
        r->feature_normal[i] = segments[i].normal;
    }
    return QM_OK;
}

/** One way to lay quads out on a component. */
typedef struct attempt {
    qm_quads_result quads;
    qm_quads_record record;
    double off;       /* how far the number of quads is from the wanted one, as a share */
    size_t irregular; /* vertices */
} attempt;

static void add_record(qm_quads_record *sum, const qm_quads_record *own)
{
    sum->crosses_turned += own->crosses_turned;
    sum->steps_inconsistent += own->steps_inconsistent;
    sum->steps_open += own->steps_open;
    sum->steps_folded += own->steps_folded;
    sum->unmatched += own->unmatched;
    sum->halved += own->halved;
}

/** Quads of a side of size; the triangles are used up. */
static qm_status lay_out(qm_context *ctx, qm_trimesh *m, const qm_vec *cross, qm_quads_map *map, double size,
                         attempt *out)
{
    qm_status status = qm_quads_map_close(ctx, m, map, size);
    if (status == QM_OK) status = qm_quads_find_steps(ctx, m, cross, map, size, &out->record);
    qm_quads_result *r = &out->quads;
    if (status == QM_OK)
        status = qm_quads_extract(ctx, m, size, &r->mesh, &r->is_fixed, &r->is_feature, &out->record);
    return status == QM_OK ? qm_quads_tidy(ctx, r, &out->irregular) : status;
}

/** Numbers of quads that are near enough count as equal; then fewer irregular vertices are better. */
static bool is_better(const attempt *a, const attempt *b)
{
    if (!b->quads.mesh.faces) return true;
    double off_a = qm_max(a->off, WANTED_OFF), off_b = qm_max(b->off, WANTED_OFF);
    return off_a != off_b ? off_a < off_b : a->irregular < b->irregular;
}

/** Keeps the better attempt, and frees the other. True if it is the new one. */
static bool keep_better(qm_context *ctx, attempt *now, attempt *best)
{
    bool is_kept = is_better(now, best);
    qm_quads_result_reset(ctx, is_kept ? &best->quads : &now->quads);
    if (is_kept) *best = *now;
    return is_kept;
}

/** Sizes tried that gave too few quads, and too many; 0: none yet. */
typedef struct size_range {
    double few, many;         /* sizes */
    double few_off, many_off; /* logarithms of the ratios of the numbers to the wanted one */
} size_range;

/** The next size to try: between both, where the number would be right if it went smoothly. Rows come and go at once on both sides of a box. */
static double next_size(size_range *range, double size, double ratio)
{
    double off = log(ratio);
    if (ratio < 1.0 && (range->few == 0.0 || size < range->few)) range->few = size, range->few_off = off;
    if (ratio >= 1.0 && size > range->many) range->many = size, range->many_off = off;
    if (!(range->few > range->many && range->many > 0.0)) return size * qm_min(qm_max(sqrt(ratio), 0.5), 1.5);
    double share = range->many_off / (range->many_off - range->few_off);
    return range->many * pow(range->few / range->many, qm_min(qm_max(share, 0.2), 0.8));
}

/** Lays quads out until there are about as many as wanted: rows that the flow takes away or adds are made up for by their size. */
static qm_status lay_out_counted(qm_context *ctx, const qm_trimesh *m, const qm_vec *cross, qm_quads_map *map,
                                 double size, double wanted, attempt *best)
{
    qm_status status = QM_OK;
    int vain = 0;
    size_range range = {0};
    for (int k = 0; k < MOST_ATTEMPTS && vain < 3 && status == QM_OK; k++) {
        if (k >= ATTEMPTS && wanted >= FEW_QUADS && best->off <= FAR_OFF) break;
        qm_trimesh copy;
        attempt now = {0};
        status = qm_trimesh_copy(ctx, m, &copy);
        if (status == QM_OK) status = lay_out(ctx, &copy, cross, map, size, &now);
        qm_trimesh_reset(ctx, &copy);
        double ratio = (double)now.quads.mesh.face_count / wanted;
        now.off = fabs(ratio - 1.0);
        if (status != QM_OK)
            qm_quads_result_reset(ctx, &now.quads);
        else
            vain = keep_better(ctx, &now, best) ? 0 : vain + 1;
        if (best->off <= WANTED_OFF) break;
        size = next_size(&range, size, qm_max(ratio, 1e-3));
    }
    return status;
}

/** A component, and how its quads are wanted. */
typedef struct part_job {
    const qm_bvh *bvh;
    const uint32_t (*corner)[3];
    size_t count;
    double area, wanted, size;
    int thread_count;
    bool keeps_pairs;
} part_job;

/** Makes the quads of a component along its creases above an angle. *has_creases tells if there are any. */
static qm_status make_part_along(qm_context *ctx, const part_job *job, double crease_angle, attempt *best,
                                 part *out, bool *has_creases)
{
    const qm_mesh *surface = qm_bvh_mesh(job->bvh);
    double size = job->size;
    qm_trimesh m;
    qm_quads_corners corners = {0};
    qm_quads_map map = {0};
    qm_vec *cross = NULL;
    qm_status status =
        qm_trimesh_build(ctx, surface->positions, surface->vertex_count, job->corner, job->count, &m);
    if (status == QM_OK) status = qm_trimesh_split_doubles(ctx, &m);
    if (status == QM_OK) qm_quads_drop_slivers(&m);
    if (status == QM_OK) status = qm_trimesh_fill_holes(ctx, &m, SMALL_HOLE * size);
    if (status == QM_OK) status = qm_quads_find_features(ctx, &m, crease_angle, size, true);
    for (uint32_t h = 0; status == QM_OK && h < 3 * m.face_count; h++)
        *has_creases |= m.is_feature[h] && m.twin[h] != QM_NO_INDEX;
    if (status == QM_OK) status = qm_quads_list_features(ctx, &m, &out->segments, &out->segment_count);
    if (status == QM_OK) status = qm_quads_hold_tips(ctx, &m, size);
    if (status == QM_OK) status = qm_quads_remesh(ctx, &m, job->bvh, TRIANGLE_SIDE * size, job->thread_count);
    if (status == QM_OK) qm_quads_release_tips(&m);
    if (status == QM_OK) status = qm_quads_separate_features(ctx, &m);
    if (status == QM_OK) status = qm_quads_open_corners(ctx, &m, size, &corners);
    size_t faces = m.face_count;
    if (status == QM_OK) {
        cross = qm_context_alloc(ctx, faces, sizeof *cross);
        if (!cross) status = QM_E_NO_MEMORY;
    }
    bool is_done = false, keeps_pairs = job->keeps_pairs;
    while (!is_done && status == QM_OK) {
        attempt now = {0};
        status = qm_quads_find_crosses(ctx, &m, !keeps_pairs, cross);
        if (status == QM_OK) status = qm_quads_map_build(ctx, &m, cross, &corners, size, &map);
        if (status == QM_OK) status = lay_out_counted(ctx, &m, cross, &map, size, job->wanted, &now);
        qm_quads_map_reset(ctx, &map);
        is_done =
            keeps_pairs || (now.off <= FAR_OFF && now.irregular <= now.record.crosses_turned + MOST_ADDED);
        keeps_pairs = true;
        if (status == QM_OK)
            (void)keep_better(ctx, &now, best);
        else
            qm_quads_result_reset(ctx, &now.quads);
    }
    qm_context_free(ctx, cross, faces, sizeof *cross);
    qm_quads_corners_reset(ctx, &corners);
    qm_trimesh_reset(ctx, &m);
    return status;
}

/** Makes the quads of a component; without its creases where much of the surface is lost along these: where one runs into a
 * boundary at a small angle, as a thread does, there is no row of quads between them, nor is there one beyond. */
static qm_status make_part(qm_context *ctx, const part_job *job, double crease_angle, part *out,
                           qm_quads_record *record)
{
    attempt best = {0}, plain = {0};
    bool has_creases = false;
    qm_status status = make_part_along(ctx, job, crease_angle, &best, out, &has_creases);
    out->quads = best.quads;
    if (status == QM_OK && has_creases && qm_quads_mesh_area(&best.quads.mesh) < FAR_TOO_SMALL * job->area) {
        part other = {0};
        status = make_part_along(ctx, job, 0.0, &plain, &other, &has_creases);
        other.quads = plain.quads;
        if (status == QM_OK && qm_quads_mesh_area(&plain.quads.mesh) > qm_quads_mesh_area(&best.quads.mesh)) {
            part worse = *out;
            *out = other;
            other = worse;
            best = plain;
        }
        reset_part(ctx, &other);
    }
    if (status == QM_OK) add_record(record, &best.record);
    return status;
}

/*
 * All components.
 */

/** The least size of quads of a component. A needle that is n triangles long is cut into n to the power of log2(3): halving
 * both of its long edges makes three of it. One that is far longer than its area tells would not fit into memory. */
static double least_size(const double *positions, const uint32_t (*corner)[3], size_t count, double wanted)
{
    const double power = log2(3.0);
    double sum = 0.0;
    for (size_t f = 0; f < count; f++) {
        qm_vec p[3];
        for (int k = 0; k < 3; k++)
            p[k] = qm_vec_load(positions + 3 * (size_t)corner[f][k]);
        sum += pow(qm_max(qm_max(qm_vec_distance(p[0], p[1]), qm_vec_distance(p[1], p[2])),
                          qm_vec_distance(p[2], p[0])),
                   power);
    }
    return pow(sum / (MOST_PIECES * ((double)count + wanted)), 1.0 / power) / TRIANGLE_SIDE;
}

static qm_status make_parts(qm_context *ctx, const qm_bvh *bvh, const qm_quads_triangles *t,
                            const qm_quads_options *options, part *parts, qm_quads_record *record)
{
    const double *positions = qm_bvh_mesh(bvh)->positions;
    const uint32_t(*corner)[3] = (const uint32_t(*)[3])t->corner;
    double area = qm_quads_area(positions, corner, t->count);
    if (!(area > 0.0)) return qm_context_fail(ctx, QM_E_EMPTY, "the surface has no area");
    record->size = sqrt(area / (double)options->quads);
    qm_status status = QM_OK;
    for (size_t first = 0, last; first < t->count && status == QM_OK; first = last) {
        uint32_t k = t->component[first];
        for (last = first; last < t->count && t->component[last] == k;)
            last++;
        double own = qm_quads_area(positions, corner + first, last - first);
        /* points and segments have no area, and no quads */
        if (!(own > 1e-12 * area)) continue;
        double wanted = qm_max((double)options->quads * own / area, LEAST_QUADS);
        double size = qm_max(sqrt(own / wanted), least_size(positions, corner + first, last - first, wanted));
        const part_job job = {bvh,    corner + first, last - first,          own,
                              wanted, size,           options->thread_count, options->keeps_pairs};
        status = make_part(ctx, &job, options->crease_angle, &parts[k], record);
    }
    return status;
}

static qm_status join_parts(qm_context *ctx, const part *parts, size_t count, qm_quads_result *r)
{
    size_t vertices = 0, faces = 0, segments = 0;
    for (size_t k = 0; k < count; k++) {
        vertices += parts[k].quads.mesh.vertex_count;
        faces += parts[k].quads.mesh.face_count;
        segments += parts[k].segment_count;
    }
    r->mesh.positions = qm_context_alloc(ctx, vertices, 3 * sizeof *r->mesh.positions);
    r->mesh.faces = qm_context_alloc(ctx, faces, 4 * sizeof *r->mesh.faces);
    r->mesh.vertex_count = vertices, r->mesh.face_count = faces;
    r->is_fixed = qm_context_alloc(ctx, vertices, 1);
    r->is_feature = qm_context_alloc(ctx, faces, 4);
    qm_quads_segment *all = qm_context_alloc(ctx, segments, sizeof *all);
    qm_status status =
        r->mesh.positions && r->mesh.faces && r->is_fixed && r->is_feature && (all || segments == 0)
            ? QM_OK
            : QM_E_NO_MEMORY;
    size_t vertex = 0, face = 0, segment = 0;
    for (size_t k = 0; k < count && status == QM_OK; k++) {
        const part *p = &parts[k];
        const qm_mesh *own = &p->quads.mesh;
        if (own->face_count > 0) {
            memcpy(r->mesh.positions + 3 * vertex, own->positions, 3 * own->vertex_count * sizeof(double));
            memcpy(r->is_fixed + vertex, p->quads.is_fixed, own->vertex_count);
            memcpy(r->is_feature + 4 * face, p->quads.is_feature, 4 * own->face_count);
            for (size_t c = 0; c < 4 * own->face_count; c++)
                r->mesh.faces[4 * face + c] = (uint32_t)vertex + own->faces[c];
        }
        if (p->segment_count > 0) memcpy(all + segment, p->segments, p->segment_count * sizeof *all);
        vertex += own->vertex_count;
        face += own->face_count;
        segment += p->segment_count;
    }
    if (status == QM_OK) status = qm_quads_set_features(ctx, all, segments, r);
    qm_context_free(ctx, all, segments, sizeof *all);
    return status;
}

static qm_status make(qm_context *ctx, const qm_bvh *bvh, qm_quads_triangles *t,
                      const qm_quads_options *options, qm_quads_result *r, qm_quads_record *record)
{
    const qm_mesh *surface = qm_bvh_mesh(bvh);
    qm_status status = qm_quads_list_triangles(ctx, surface, t);
    if (status != QM_OK) return status;
    record->components = t->component_count;
    part *parts = qm_context_alloc(ctx, t->component_count, sizeof *parts);
    if (!parts) return QM_E_NO_MEMORY;
    memset(parts, 0, t->component_count * sizeof *parts);
    status = make_parts(ctx, bvh, t, options, parts, record);
    if (status == QM_OK) status = join_parts(ctx, parts, t->component_count, r);
    for (size_t k = 0; k < t->component_count; k++)
        reset_part(ctx, &parts[k]);
    qm_context_free(ctx, parts, t->component_count, sizeof *parts);
    size_t opened;
    if (status == QM_OK) status = qm_quads_open_lone(ctx, r, &opened);
    if (status == QM_OK) status = qm_quads_polish(ctx, r, bvh, options->thread_count);
    size_t moves = qm_quads_untangle_moves(r);
    if (status == QM_OK) status = qm_quads_untangle(ctx, r, bvh, false, &moves, options->thread_count);
    /* contractions may have left more of them */
    if (status == QM_OK) status = qm_quads_open_lone(ctx, r, &opened);
    if (status == QM_OK && opened > 0)
        status = qm_quads_untangle(ctx, r, bvh, false, &moves, options->thread_count);
    if (status == QM_OK) status = qm_quads_choose_diagonals(ctx, r, bvh, options->thread_count);
    if (status == QM_OK) status = qm_quads_fit(ctx, r, bvh, false, options->thread_count);
    return status == QM_OK ? qm_quads_choose_diagonals(ctx, r, bvh, options->thread_count) : status;
}

/** A byte for each face, of the four of its sides. */
static qm_status pack_creases(qm_context *ctx, const qm_quads_result *r, uint8_t **creases)
{
    *creases = qm_context_alloc(ctx, r->mesh.face_count, 1);
    if (!*creases)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the creases of %zu quads",
                               r->mesh.face_count);
    for (size_t f = 0; f < r->mesh.face_count; f++) {
        const uint8_t *side = r->is_feature + 4 * f;
        (*creases)[f] = (uint8_t)(side[0] | side[1] << 1 | side[2] << 2 | side[3] << 3);
    }
    return QM_OK;
}

qm_status qm_quads_make_with_creases(qm_context *ctx, const qm_bvh *bvh, const qm_quads_options *options,
                                     qm_mesh *out, uint8_t **creases, qm_quads_record *record)
{
    QM_ASSERT(ctx && bvh && options && out);
    *out = (qm_mesh){0};
    if (creases) *creases = NULL;
    const qm_mesh *surface = qm_bvh_mesh(bvh);
    if (options->quads == 0 || options->quads > QM_QUADS_MOST)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the number of quads is not from 1 to %d", QM_QUADS_MOST);
    if (!(options->crease_angle >= 0.0 && options->crease_angle <= 180.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the crease angle is not from 0 to 180 degrees");
    if (surface->face_count == 0)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a point set has no faces to be remeshed");
    const qm_box box = qm_mesh_bounding_box(surface);
    double diagonal = qm_mesh_box_diagonal(&box);
    if (diagonal > LARGEST || (diagonal > 0.0 && diagonal < 1.0 / LARGEST))
        return qm_context_fail(ctx, QM_E_SCALE,
                               "areas of a surface of diagonal %.3g are beyond double precision", diagonal);
    qm_quads_record own = {0};
    if (!record) record = &own;
    *record = (qm_quads_record){0};
    qm_quads_triangles t;
    qm_quads_result r = {0};
    qm_status status = make(ctx, bvh, &t, options, &r, record);
    if (status == QM_E_NO_MEMORY)
        qm_context_fail(ctx, status, "out of memory for %zu quads of %zu triangles", options->quads, t.count);
    qm_quads_triangles_reset(ctx, &t);
    if (status == QM_OK && creases) status = pack_creases(ctx, &r, creases);
    if (status == QM_OK) {
        *out = r.mesh;
        r.mesh.positions = NULL, r.mesh.faces = NULL;
    }
    qm_quads_result_reset(ctx, &r);
    return status;
}

qm_status qm_quads_make(qm_context *ctx, const qm_bvh *bvh, const qm_quads_options *options, qm_mesh *out,
                        qm_quads_record *record)
{
    return qm_quads_make_with_creases(ctx, bvh, options, out, NULL, record);
}
