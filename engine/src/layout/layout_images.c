/**
 * layout_images.c: which node or curve of a layout is the mirror image of another one, so that an edit can be made on both sides.
 */
#include <string.h>

#include "layout_internal.h"
#include "layout_section.h"
#include "qm/layout_edit.h"

enum { SAMPLES = 9, POINT_SIZE = 3 * sizeof(double) }; /* of a curve, at equal arc length */

uint32_t qm_layout_find_image_node(const qm_layout *layout, const qm_ref_surface *surface,
                                   const double point[3], const double normal[3], uint32_t node,
                                   double radius)
{
    QM_ASSERT(layout && surface && node < layout->node_count);
    double at[3];
    memcpy(at, layout->nodes + 3 * (size_t)node, POINT_SIZE);
    qm_layout_reflect(surface, point, normal, at, 1);
    uint32_t found = QM_NO_INDEX;
    for (uint32_t i = 0; i < layout->node_count; i++) {
        double distance = qm_vec_distance(qm_vec_load(at), qm_vec_load(layout->nodes + 3 * (size_t)i));
        if (distance > radius) continue;
        radius = distance;
        found = i;
    }
    return found;
}

static void take_samples(const qm_curve *curve, double out[SAMPLES][3])
{
    const qm_section line = {curve->points, curve->point_count, curve->point_count};
    double length = qm_section_length(&line);
    for (int k = 0; k < SAMPLES; k++)
        qm_vec_store(out[k], qm_section_at(&line, length * k / (SAMPLES - 1)));
}

/** Reflects samples of a curve. Its chords leave the surface: only their feet are projected on the other side, and the samples lie off
 * these as they did. */
static void reflect_samples(const qm_ref_surface *surface, const double point[3], const double normal[3],
                            double samples[SAMPLES][3])
{
    for (int k = 0; k < SAMPLES; k++) {
        qm_ref_surface_point foot;
        qm_ref_surface_project(surface, samples[k], &foot);
        double off[3];
        qm_vec_store(off, qm_vec_sub(qm_vec_load(samples[k]), qm_vec_load(foot.position)));
        qm_layout_reflect(surface, point, normal, foot.position, 1);
        qm_layout_reflect_direction(normal, off);
        qm_vec_store(samples[k], qm_vec_add(qm_vec_load(foot.position), qm_vec_load(off)));
    }
}

uint32_t qm_layout_find_image_curve(const qm_layout *layout, const qm_ref_surface *surface,
                                    const double point[3], const double normal[3], uint32_t id, double radius,
                                    bool *is_reversed)
{
    QM_ASSERT(layout && surface && is_reversed);
    uint32_t index = qm_layout_find_curve(layout, id), found = QM_NO_INDEX;
    QM_ASSERT(index != QM_NO_INDEX);
    double image[SAMPLES][3], own[SAMPLES][3];
    take_samples(&layout->curves[index], image);
    reflect_samples(surface, point, normal, image);
    *is_reversed = false;
    for (size_t i = 0; i < layout->curve_count; i++) {
        take_samples(&layout->curves[i], own);
        for (int reversed = 0; reversed < 2; reversed++) {
            double farthest = 0.0;
            for (int k = 0; k < SAMPLES && farthest <= radius; k++)
                farthest =
                    qm_max(farthest, qm_vec_distance(qm_vec_load(image[k]),
                                                     qm_vec_load(own[reversed ? SAMPLES - 1 - k : k])));
            if (farthest > radius) continue;
            radius = farthest;
            found = layout->curves[i].id;
            *is_reversed = reversed;
        }
    }
    return found;
}
