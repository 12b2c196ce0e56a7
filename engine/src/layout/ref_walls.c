/**
 * ref_walls.c: projection onto one wall of a surface where several are near.
 *
 * The walls of a thin sheet or narrow gap are told apart by the surface's normals, as are the two sides of a sharp
 * edge. On a mesh the nearest point decides unless its face looks the wrong way. A set of points is fitted by a smooth
 * surface, which would run between two walls and round an edge off: where the normals round a point are those of
 * two or three walls, or opposed, the points of one wall are fitted.
 */
#include "ref_points.h"

#include "bvh/bvh_demand.h"

#define MIN_WALL_POINTS 6  /* of a wall; fewer define no surface */
#define MIN_OPPOSED 0.7    /* of the cosine between normals, or of a normal and the way across a gap */
#define MAX_CREASE 0.5     /* of the cosine between the normals of two walls that meet */
#define MIN_CONE 0.9       /* of the cosine between the normals of one wall */
#define MIN_SHARE 0.8      /* of the points whose normals are those of walls, where there are walls */
#define MIN_LAYER_GAP 0.04 /* of the radius of the points: a narrower gap separates no layers */
#define WALL_REACH 0.05    /* of the diagonal: points of a wall are sought no farther away */
#define SPACINGS 2.5     /* the radius of QM_FIT_POINTS points of a plane, in mean spacings: sqrt(20 / pi) */
#define CORNER_RATIO 1.5 /* times as far as the nearest crease: a corner that is meant */

enum { MAX_WALLS = 3 };

static qm_vec normal_of(const qm_ref_surface *surface, uint32_t point)
{
    const float *row = surface->bvh->mesh.normals + 3 * (size_t)point;
    qm_vec normal = {row[0], row[1], row[2]};
    double length = qm_vec_norm(normal);
    return length > 0.0 ? qm_vec_scale(1.0 / length, normal) : normal;
}

/** Unit normals of the walls round a point. */
typedef struct wall_normals {
    int count;
    qm_vec normal[MAX_WALLS];
} wall_normals;

/** The greatest cosine, by absolute value, between a normal and those of the walls; *wall is that one's number. */
static double nearest_wall(const wall_normals *walls, qm_vec normal, int *wall)
{
    double best = -1.0;
    for (int k = 0; k < walls->count; k++) {
        double cosine = fabs(qm_vec_dot(walls->normal[k], normal));
        if (cosine <= best) continue;
        best = cosine;
        *wall = k;
    }
    return best;
}

/**
 * Finds the walls of the points near a place, the nearest point's first. False where they are one smooth surface:
 * normals of one wall, all to one side, or too many directions.
 */
static bool find_walls(const qm_ref_surface *surface, const qm_nearest_points *near, wall_normals *out)
{
    int wall = 0, in_cones = 0, opposed = 0;
    *out = (wall_normals){.count = 1, .normal = {normal_of(surface, near->index[0])}};
    while (out->count < MAX_WALLS) {
        double least = MAX_CREASE;
        qm_vec next = {0, 0, 0};
        for (int i = 0; i < near->count; i++) {
            qm_vec normal = normal_of(surface, near->index[i]);
            double cosine = nearest_wall(out, normal, &wall);
            if (cosine >= least || qm_vec_norm2(normal) == 0.0) continue;
            least = cosine;
            next = normal;
        }
        if (least == MAX_CREASE) break;
        out->normal[out->count++] = next;
    }
    for (int i = 0; i < near->count; i++) {
        qm_vec normal = normal_of(surface, near->index[i]);
        if (nearest_wall(out, normal, &wall) < MIN_CONE) continue;
        in_cones++;
        opposed += qm_vec_dot(normal, out->normal[wall]) < 0.0;
    }
    return in_cones >= MIN_SHARE * near->count && (out->count > 1 || opposed > 0);
}

/**
 * Keeps the points of one layer: where the offsets of points along a normal from p have one wide gap, those on p's side
 * of it. Two sheets may have walls that look the same way.
 */
static void keep_layer(qm_nearest_points *near, qm_vec p, qm_vec normal)
{
    double offset[QM_FIT_POINTS], sorted[QM_FIT_POINTS], widest = 0.0, split = 0.0;
    for (int i = 0; i < near->count; i++) {
        offset[i] = qm_vec_dot(qm_vec_sub(near->position[i], p), normal);
        int slot = i;
        for (; slot > 0 && sorted[slot - 1] > offset[i]; slot--)
            sorted[slot] = sorted[slot - 1];
        sorted[slot] = offset[i];
    }
    for (int i = 1; i < near->count; i++) {
        if (sorted[i] - sorted[i - 1] <= widest) continue;
        widest = sorted[i] - sorted[i - 1];
        split = 0.5 * (sorted[i] + sorted[i - 1]);
    }
    double range = sorted[near->count - 1] - sorted[0], radius = sqrt(near->d2[near->count - 1]);
    if (widest <= 0.5 * range || widest <= MIN_LAYER_GAP * radius) return;
    int kept = 0;
    for (int i = 0; i < near->count; i++) {
        if ((offset[i] < split) != (split > 0.0)) continue;
        near->index[kept] = near->index[i];
        near->d2[kept] = near->d2[i];
        near->position[kept++] = near->position[i];
    }
    near->count = kept;
}

/** Projects p, local, onto the points of a wall. False if they are too few within the reach, local. */
static bool project_to_wall(const qm_ref_surface *surface, qm_vec p, qm_vec normal, double reach,
                            qm_ref_surface_point *out)
{
    qm_nearest_points near;
    qm_nearest_points_find_toward(surface->bvh, p, QM_FIT_POINTS, normal, reach, &near);
    if (near.count > 0) keep_layer(&near, p, normal);
    if (near.count < MIN_WALL_POINTS) return false;
    qm_ref_surface_project_to_points(surface, p, &near, out);
    return true;
}

/** The part of qm_ref_surface_project_toward for points with normals. */
static bool project_points_toward(const qm_ref_surface *surface, qm_vec p, qm_vec toward, double reach,
                                  qm_ref_surface_point *out)
{
    qm_nearest_points near;
    wall_normals walls;
    qm_nearest_points_find(surface->bvh, p, QM_FIT_POINTS, &near);
    if (find_walls(surface, &near, &walls)) {
        if (project_to_wall(surface, p, toward, reach, out)) return true;
        qm_ref_surface_project_to_points(surface, p, &near, out);
        return false;
    }
    qm_ref_surface_project_to_points(surface, p, &near, out);
    return near.d2[0] <= reach * reach && qm_vec_dot(normal_of(surface, near.index[0]), toward) > 0.0;
}

bool qm_ref_surface_project_toward(const qm_ref_surface *surface, const double p[3],
                                   const double direction[3], double reach, qm_ref_surface_point *out)
{
    QM_ASSERT(surface && surface->bvh && p && direction && reach > 0.0 && out);
    const qm_bvh *bvh = surface->bvh;
    qm_vec local = qm_ref_surface_local(surface, p), toward = qm_vec_load(direction);
    double length = qm_vec_norm(toward), local_reach = reach * bvh->frame.scale;
    if (length > 0.0 && surface->is_cloud && bvh->mesh.normals)
        return project_points_toward(surface, local, qm_vec_scale(1.0 / length, toward), local_reach, out);
    qm_ref_surface_project(surface, p, out);
    if (surface->is_cloud) return false;
    if (out->distance <= reach && qm_vec_dot(qm_vec_load(out->normal), toward) > 0.0) return true;
    qm_facing_point facing;
    if (!qm_nearest_facing(bvh, local, toward, local_reach, &facing)) return false;
    qm_ref_surface_set_point(surface, local, facing.position, facing.normal, out);
    return true;
}

/** A plane: of the points x with normal . x = height, local. */
typedef struct wall_plane {
    qm_vec normal;
    double height;
} wall_plane;

/** Finds the plane of a wall at p, local: of the two sides of a normal the nearer one. False without points. */
static bool find_plane(const qm_ref_surface *surface, qm_vec p, qm_vec normal, wall_plane *out)
{
    double reach = WALL_REACH * surface->diagonal * surface->bvh->frame.scale, nearest = INFINITY;
    for (int side = 0; side < 2; side++) {
        qm_ref_surface_point projection;
        qm_vec toward = qm_vec_scale(side == 0 ? 1.0 : -1.0, normal);
        if (!project_to_wall(surface, p, toward, reach, &projection)) continue;
        if (projection.distance >= nearest || qm_vec_norm2(qm_vec_load(projection.normal)) == 0.0) continue;
        nearest = projection.distance;
        out->normal = qm_vec_load(projection.normal);
        out->height = qm_vec_dot(out->normal, qm_frame_local(&surface->bvh->frame, projection.position));
    }
    return nearest < INFINITY;
}

/** The point of the line of two planes that is nearest to p. */
static qm_vec meet_two(const wall_plane *a, const wall_plane *b, qm_vec p)
{
    double cosine = qm_vec_dot(a->normal, b->normal), det = 1.0 - cosine * cosine;
    double da = a->height - qm_vec_dot(a->normal, p), db = b->height - qm_vec_dot(b->normal, p);
    qm_vec moved = qm_vec_axpy(p, (da - cosine * db) / det, a->normal);
    return qm_vec_axpy(moved, (db - cosine * da) / det, b->normal);
}

/** The point of three planes. */
static qm_vec meet_three(const wall_plane plane[3])
{
    qm_vec bc = qm_vec_cross(plane[1].normal, plane[2].normal),
           ca = qm_vec_cross(plane[2].normal, plane[0].normal),
           ab = qm_vec_cross(plane[0].normal, plane[1].normal);
    qm_vec sum =
        qm_vec_axpy(qm_vec_axpy(qm_vec_scale(plane[0].height, bc), plane[1].height, ca), plane[2].height, ab);
    return qm_vec_scale(1.0 / qm_vec_dot(plane[0].normal, bc), sum);
}

/** The nearest of p's positions on the creases of planes, or on their corner; INFINITY away when there are none. */
static double find_feature(const wall_plane *plane, int count, qm_vec p, qm_vec *out)
{
    double nearest = INFINITY;
    for (int a = 0; a < count; a++) {
        for (int b = a + 1; b < count; b++) {
            if (fabs(qm_vec_dot(plane[a].normal, plane[b].normal)) > MIN_OPPOSED) continue;
            qm_vec at = meet_two(&plane[a], &plane[b], p);
            if (qm_vec_distance(at, p) >= nearest) continue;
            nearest = qm_vec_distance(at, p);
            *out = at;
        }
    }
    if (count < 3 || nearest == INFINITY) return nearest;
    double volume = qm_vec_dot(plane[0].normal, qm_vec_cross(plane[1].normal, plane[2].normal));
    if (fabs(volume) < 1.0 - MIN_OPPOSED) return nearest;
    qm_vec corner = meet_three(plane);
    if (qm_vec_distance(corner, p) > CORNER_RATIO * nearest) return nearest;
    *out = corner;
    return qm_vec_distance(corner, p);
}

void qm_ref_surface_project_curve(const qm_ref_surface *surface, const double p[3], double reach,
                                  qm_ref_surface_point *out)
{
    QM_ASSERT(surface && surface->bvh && p && reach >= 0.0 && out);
    const qm_bvh *bvh = surface->bvh;
    qm_ref_surface_project(surface, p, out);
    if (!surface->is_cloud || !bvh->mesh.normals) return;
    qm_vec local = qm_ref_surface_local(surface, p), feature;
    qm_nearest_points near;
    wall_normals walls;
    wall_plane plane[MAX_WALLS];
    int count = 0;
    qm_nearest_points_find(bvh, local, QM_FIT_POINTS, &near);
    if (!find_walls(surface, &near, &walls)) return;
    for (int k = 0; k < walls.count; k++)
        count += find_plane(surface, local, walls.normal[k], &plane[count]);
    if (count == 0) return;
    double limit = fmin(out->spacing / SPACINGS, reach) * bvh->frame.scale, move = INFINITY;
    int nearest = 0;
    for (int k = 0; k < count; k++) {
        double height = plane[k].height - qm_vec_dot(plane[k].normal, local);
        if (fabs(height) >= fabs(move)) continue;
        move = height;
        nearest = k;
    }
    /* Where no wall is near, one of too few points may be: the point stays. */
    qm_vec normal = plane[nearest].normal;
    qm_vec on_plane = fabs(move) <= limit ? qm_vec_axpy(local, move, normal) : local;
    bool is_on_feature = find_feature(plane, count, local, &feature) <= limit;
    qm_ref_surface_set_point(surface, local, is_on_feature ? feature : on_plane, normal, out);
}

/** The mean distance along a direction from p, local, of the points near it whose normals have that sign along it.
 * False if there are none. */
static bool mean_wall(const qm_ref_surface *surface, const qm_nearest_points *near, qm_vec p, qm_vec along,
                      double sign, double *out)
{
    double sum = 0.0;
    int count = 0;
    for (int i = 0; i < near->count; i++) {
        if (!(sign * qm_vec_dot(normal_of(surface, near->index[i]), along) > MIN_OPPOSED)) continue;
        sum += qm_vec_dot(qm_vec_sub(near->position[i], p), along);
        count++;
    }
    *out = count > 0 ? sum / count : 0.0;
    return count > 0;
}

bool qm_ref_surface_is_between_walls(const qm_ref_surface *surface, const double a[3], const double b[3])
{
    QM_ASSERT(surface && surface->bvh && a && b);
    const qm_bvh *bvh = surface->bvh;
    if (!surface->is_cloud) {
        qm_ref_surface_point on_a, on_b;
        qm_ref_surface_project(surface, a, &on_a);
        qm_ref_surface_project(surface, b, &on_b);
        return qm_vec_dot(qm_vec_load(on_a.normal), qm_vec_load(on_b.normal)) < -MIN_OPPOSED;
    }
    qm_vec from = qm_ref_surface_local(surface, a),
           across = qm_vec_sub(qm_ref_surface_local(surface, b), from);
    double gap = qm_vec_norm(across), back, front;
    if (!bvh->mesh.normals || !(gap > 0.0)) return false;
    qm_nearest_points near;
    qm_nearest_points_find(bvh, qm_vec_axpy(from, 0.5, across), QM_FIT_POINTS, &near);
    qm_vec along = qm_vec_scale(1.0 / gap, across);
    if (!mean_wall(surface, &near, from, along, -1.0, &back) ||
        !mean_wall(surface, &near, from, along, 1.0, &front))
        return false;
    return fabs(fabs(front - back) - gap) <= 0.5 * gap;
}
