/**
 * ref_sheets.c: which sheets of a mesh are connected near a place, and where they end. Parts of a surface that touch or pass through
 * each other, as the handle of a pot that was put through its wall, are near in space and far along the surface.
 */
#include "qm/source.h"

#include "bvh/nearest.h"
#include "core/union_find.h"
#include "prim/triangle.h"

enum { MOST_TRIANGLES = 256 };

#define ON_SIDE                                                                                              \
    1e-9 /* of the frame, in which a surface has a size of about 1: what rounding moves a foot off its side */

typedef struct sheets {
    qm_vec corner[MOST_TRIANGLES][3];
    uint32_t parent[MOST_TRIANGLES];
    size_t count;
    qm_vec middle;
    double reach2;
} sheets;

/** The squared distance of a segment from a point. */
static double segment_distance2(qm_vec from, qm_vec to, qm_vec p)
{
    qm_vec along = qm_vec_sub(to, from);
    double length2 = qm_vec_norm2(along);
    double t = length2 > 0.0 ? qm_clamp(qm_vec_dot(qm_vec_sub(p, from), along) / length2, 0.0, 1.0) : 0.0;
    return qm_vec_norm2(qm_vec_sub(p, qm_vec_axpy(from, t, along)));
}

/** True if two triangles have a corner in the ball in common, or a side through it. */
static bool are_linked(const sheets *s, size_t i, size_t j)
{
    qm_vec shared[3];
    int count = 0;
    for (int k = 0; k < 3; k++)
        for (int l = 0; l < 3; l++)
            if (qm_vec_equal(s->corner[i][k], s->corner[j][l]) && count < 3)
                shared[count++] = s->corner[i][k];
    for (int k = 0; k < count; k++)
        if (qm_vec_norm2(qm_vec_sub(shared[k], s->middle)) <= s->reach2) return true;
    return count >= 2 && segment_distance2(shared[0], shared[1], s->middle) <= s->reach2;
}

static uint32_t nearest_sheet(sheets *s, qm_vec p)
{
    double least = INFINITY;
    uint32_t nearest = 0;
    for (uint32_t i = 0; i < s->count; i++) {
        qm_triangle triangle = qm_triangle_make(s->corner[i][0], s->corner[i][1], s->corner[i][2]);
        double d2 = qm_triangle_distance2(&triangle, p);
        if (d2 >= least) continue;
        least = d2;
        nearest = i;
    }
    return qm_union_find_root(s->parent, nearest);
}

bool qm_ref_surface_connects(const qm_ref_surface *surface, const double a[3], const double b[3],
                             const double middle[3], double reach)
{
    QM_ASSERT(surface && surface->bvh && !surface->is_cloud && a && b && middle);
    const qm_frame *frame = &surface->bvh->frame;
    sheets s = {.middle = qm_frame_local(frame, middle)};
    double local = reach * frame->scale;
    s.reach2 = local * local;
    s.count = qm_near_triangles(surface->bvh, s.middle, local, s.corner, MOST_TRIANGLES);
    if (s.count == 0 || s.count > MOST_TRIANGLES) return true;
    for (uint32_t i = 0; i < s.count; i++)
        s.parent[i] = i;
    for (uint32_t i = 0; i < s.count; i++)
        for (uint32_t j = 0; j < i; j++)
            if (are_linked(&s, i, j)) qm_union_find_join(s.parent, i, j);
    return nearest_sheet(&s, qm_frame_local(frame, a)) == nearest_sheet(&s, qm_frame_local(frame, b));
}

/** True if a side of a triangle, from corner k on, is one of another triangle, too, or has no length. */
static bool is_shared(const sheets *s, size_t triangle, int k)
{
    qm_vec from = s->corner[triangle][k], to = s->corner[triangle][(k + 1) % 3];
    if (qm_vec_equal(from, to)) return true;
    for (size_t j = 0; j < s->count; j++) {
        int ends = 0;
        for (int l = 0; l < 3 && j != triangle; l++)
            ends += qm_vec_equal(s->corner[j][l], from) || qm_vec_equal(s->corner[j][l], to);
        if (ends >= 2) return true;
    }
    return false;
}

bool qm_ref_surface_ends_at(const qm_ref_surface *surface, const double p[3])
{
    QM_ASSERT(surface && surface->bvh && !surface->is_cloud && p);
    qm_ref_surface_point foot;
    qm_ref_surface_project(surface, p, &foot);
    sheets s = {.middle = qm_frame_local(&surface->bvh->frame, foot.position), .reach2 = ON_SIDE * ON_SIDE};
    s.count = qm_near_triangles(surface->bvh, s.middle, ON_SIDE, s.corner, MOST_TRIANGLES);
    if (s.count > MOST_TRIANGLES) return false;
    for (size_t i = 0; i < s.count; i++)
        for (int k = 0; k < 3; k++) {
            double d2 = segment_distance2(s.corner[i][k], s.corner[i][(k + 1) % 3], s.middle);
            if (d2 <= s.reach2 && !is_shared(&s, i, k)) return true;
        }
    return false;
}
