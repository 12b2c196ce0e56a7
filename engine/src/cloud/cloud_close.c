/**
 * cloud_close.c: closes small ends of a surface of triangles.
 */
#include "cloud_trim.h"

#include "core/union_find.h"

#define MIN_AREA                                                                                             \
    4.0 /* of the sheet, in areas of a disc with the border's length: a sheet is more than its border */
#define PI 3.141592653589793

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a surface of points");
}

/** What is known of the triangles and their ends. */
typedef struct closer {
    const qm_cloud_triangles *all;
    uint32_t *next;  /* of each side: the other one of its edge */
    uint32_t *sheet; /* of each triangle: union-find of what is connected */
    double *area;    /* of each triangle that stands for a sheet */
    uint32_t *
        border; /* of each vertex: the side without another that starts there, QM_NO_INDEX without, SIDES with several */
} closer;

#define SIDES (QM_NO_INDEX - 1)

static double area_of(const qm_cloud_triangles *all, size_t triangle)
{
    const uint32_t *c = all->corner[triangle];
    qm_vec a = qm_vec_sub(all->position[c[1]], all->position[c[0]]),
           b = qm_vec_sub(all->position[c[2]], all->position[c[0]]);
    return 0.5 * qm_vec_norm(qm_vec_cross(a, b));
}

static void study(closer *c)
{
    for (uint32_t i = 0; i < c->all->count; i++) {
        c->sheet[i] = i;
        c->area[i] = 0.0;
    }
    for (size_t v = 0; v < c->all->vertex_count; v++)
        c->border[v] = QM_NO_INDEX;
    for (uint32_t s = 0; s < 3 * c->all->count; s++) {
        uint32_t *border = &c->border[c->all->corner[s / 3][s % 3]];
        if (c->next[s] != QM_NO_INDEX)
            qm_union_find_join(c->sheet, s / 3, c->next[s] / 3);
        else
            *border = *border == QM_NO_INDEX ? s : SIDES;
    }
    for (uint32_t i = 0; i < c->all->count; i++)
        c->area[qm_union_find_root(c->sheet, i)] += area_of(c->all, i);
}

/** A closed line of sides without others. */
typedef struct loop {
    size_t count;
    double length;
    qm_vec low, high, sum;
} loop;

/** Follows the border from a side. False where it meets itself, or is followed already. */
static bool follow(const closer *c, uint32_t start, loop *out)
{
    *out = (loop){.low = {INFINITY, INFINITY, INFINITY}, .high = {-INFINITY, -INFINITY, -INFINITY}};
    uint32_t side = start;
    do {
        uint32_t to = c->all->corner[side / 3][(side + 1) % 3];
        qm_vec p = c->all->position[c->all->corner[side / 3][side % 3]];
        out->count++;
        out->length += qm_vec_distance(p, c->all->position[to]);
        out->sum = qm_vec_add(out->sum, p);
        out->low = (qm_vec){fmin(out->low.x, p.x), fmin(out->low.y, p.y), fmin(out->low.z, p.z)};
        out->high = (qm_vec){fmax(out->high.x, p.x), fmax(out->high.y, p.y), fmax(out->high.z, p.z)};
        side = c->border[to];
        if (side >= SIDES || out->count > c->all->vertex_count) return false;
    } while (side != start);
    return true;
}

/** Room for one more vertex and count more triangles. */
static bool reserve(qm_context *ctx, qm_cloud_triangles *all, size_t count)
{
    if (all->vertex_count == all->vertex_capacity) {
        size_t capacity = all->vertex_capacity + all->vertex_capacity / 2 + 16;
        qm_vec *position =
            qm_context_resize(ctx, all->position, all->vertex_capacity, capacity, sizeof *position);
        if (!position) return false;
        all->position = position;
        all->vertex_capacity = capacity;
    }
    if (all->count + count > all->capacity) {
        size_t capacity = all->capacity + all->capacity / 2 + count;
        uint32_t(*corner)[3] = qm_context_resize(ctx, all->corner, all->capacity, capacity, sizeof *corner);
        if (!corner) return false;
        all->corner = corner;
        all->capacity = capacity;
    }
    return true;
}

/** Adds a fan over a line, whose sides are not followed again. */
static qm_status add_fan(qm_context *ctx, const closer *c, qm_cloud_triangles *all, uint32_t start,
                         const loop *l)
{
    if (!reserve(ctx, all, l->count)) return no_memory(ctx);
    uint32_t middle = (uint32_t)all->vertex_count, side = start;
    all->position[all->vertex_count++] = qm_vec_scale(1.0 / (double)l->count, l->sum);
    for (size_t i = 0; i < l->count; i++) {
        uint32_t from = all->corner[side / 3][side % 3], to = all->corner[side / 3][(side + 1) % 3];
        uint32_t *row = all->corner[all->count++];
        row[0] = to;
        row[1] = from;
        row[2] = middle;
        c->border[from] = QM_NO_INDEX;
        side = c->border[to];
    }
    return QM_OK;
}

static qm_status close_all(qm_context *ctx, closer *c, qm_cloud_triangles *all, double hole,
                           qm_cloud_record *record)
{
    qm_status status = qm_cloud_link_sides(ctx, all, c->next);
    if (status != QM_OK) return status;
    study(c);
    size_t sides = 3 * all->count;
    for (uint32_t s = 0; s < sides && status == QM_OK; s++) {
        loop l;
        if (c->next[s] != QM_NO_INDEX || c->border[all->corner[s / 3][s % 3]] != s || !follow(c, s, &l))
            continue;
        double disc = l.length * l.length / (4.0 * PI);
        if (qm_vec_distance(l.low, l.high) > hole ||
            c->area[qm_union_find_root(c->sheet, s / 3)] < MIN_AREA * disc)
            continue;
        status = add_fan(ctx, c, all, s, &l);
        record->borders--;
        record->holes_filled++;
    }
    return status;
}

qm_status qm_cloud_close(qm_context *ctx, qm_cloud_triangles *triangles, double hole, qm_cloud_record *record)
{
    if (triangles->count == 0 || record->borders == 0) return QM_OK;
    size_t count = triangles->count, vertices = triangles->vertex_count;
    closer c = {.all = triangles};
    c.next = qm_context_alloc(ctx, 3 * count, sizeof *c.next);
    c.sheet = qm_context_alloc(ctx, count, sizeof *c.sheet);
    c.area = qm_context_alloc(ctx, count, sizeof *c.area);
    c.border = qm_context_alloc(ctx, vertices, sizeof *c.border);
    qm_status status = c.next && c.sheet && c.area && c.border ? close_all(ctx, &c, triangles, hole, record)
                                                               : no_memory(ctx);
    qm_context_free(ctx, c.next, 3 * count, sizeof *c.next);
    qm_context_free(ctx, c.sheet, count, sizeof *c.sheet);
    qm_context_free(ctx, c.area, count, sizeof *c.area);
    qm_context_free(ctx, c.border, vertices, sizeof *c.border);
    return status;
}
