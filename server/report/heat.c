/**
 * heat.c: what is seen by raster.h, how far it is by one call of the engine for all pixels, and its colour by the scale.
 */
#include "heat.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A byte for each pixel: nothing, the line of the limit, or a band in a brightness. */
enum { NOTHING, LINE, FIRST_BAND, SHADES = 14, COLOURS = FIRST_BAND + (QM_SCALE_BANDS + 1) * SHADES };
_Static_assert(COLOURS <= 256, "a palette has 256 colours");

/* Colours keep most of their lightness, so that they are told apart as in the legend. */
#define DARKEST 0.62

static size_t count_pixels(const qm_heat *heat)
{
    return (size_t)heat->raster.view.width * (size_t)heat->raster.view.height;
}

/** Writes the points that are seen, three numbers each, and returns their count. */
static size_t find_points(const qm_heat *heat, const qm_mesh *mesh, qm_quad_reading quads, double *points)
{
    size_t seen = 0;
    for (size_t i = 0; i < count_pixels(heat); i++) {
        uint32_t face = heat->raster.face[i];
        if (face == QM_NO_INDEX) continue;
        double normal[3];
        qm_raster_position(mesh, quads, face, heat->raster.uv + 2 * i, points + 3 * seen++);
        qm_raster_normal(mesh, quads, face, heat->raster.uv + 2 * i, normal);
        heat->shine[i] = mesh->face_count > 0 ? qm_raster_shine(&heat->raster.view, normal) : 1.0;
    }
    return seen;
}

static qm_status measure(qm_context *ctx, qm_heat *heat, const qm_mesh *mesh, const qm_bvh *target,
                         qm_quad_reading quads, int thread_count)
{
    size_t count = count_pixels(heat), seen = 0;
    double *points = qm_context_alloc(ctx, count, 4 * sizeof *points);
    if (!points) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a picture");
    double *distance = points + 3 * count;
    size_t point_count = find_points(heat, mesh, quads, points);
    qm_status status = qm_project_points(ctx, target, quads, points, point_count, thread_count,
                                         &(qm_projection){.distance = distance});
    for (size_t i = 0; status == QM_OK && i < count; i++)
        heat->distance[i] = heat->raster.face[i] == QM_NO_INDEX ? (double)NAN : distance[seen++];
    qm_context_free(ctx, points, count, 4 * sizeof *points);
    return status;
}

qm_status qm_heat_draw(qm_context *ctx, const qm_view *view, const qm_mesh *mesh, const qm_bvh *target,
                       qm_quad_reading quads, int thread_count, qm_heat *out)
{
    *out = (qm_heat){.distance = NULL};
    if (!qm_raster_init(ctx, view, &out->raster))
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a picture");
    out->distance = qm_context_alloc(ctx, count_pixels(out), sizeof *out->distance);
    out->shine = qm_context_alloc(ctx, count_pixels(out), sizeof *out->shine);
    qm_status status = QM_E_NO_MEMORY;
    if (out->distance && out->shine) {
        qm_raster_draw(&out->raster, mesh, quads);
        status = measure(ctx, out, mesh, target, quads, thread_count);
    } else {
        qm_context_fail(ctx, status, "out of memory for a picture");
    }
    if (status != QM_OK) qm_heat_reset(ctx, out);
    return status;
}

void qm_heat_reset(qm_context *ctx, qm_heat *heat)
{
    size_t count = count_pixels(heat);
    qm_context_free(ctx, heat->shine, count, sizeof *heat->shine);
    qm_context_free(ctx, heat->distance, count, sizeof *heat->distance);
    qm_raster_reset(ctx, &heat->raster);
    heat->shine = heat->distance = NULL;
}

bool qm_heat_shows(const qm_heat *heat, const double point[3])
{
    const qm_view *view = &heat->raster.view;
    double at[3];
    qm_raster_project(view, point, at);
    if (!(at[0] >= 0.0 && at[0] < view->width && at[1] >= 0.0 && at[1] < view->height)) return false;
    /* The pixel has the depth of its middle, and its neighbours tell how steep the surface is there. */
    for (int y = (int)at[1] - 1; y <= (int)at[1] + 1; y++) {
        for (int x = (int)at[0] - 1; x <= (int)at[0] + 1; x++) {
            bool is_inside = x >= 0 && x < view->width && y >= 0 && y < view->height;
            if (is_inside && heat->raster.depth[(size_t)y * (size_t)view->width + (size_t)x] <= at[2] + 1.0)
                return true;
        }
    }
    return false;
}

/* ---- colours ---- */

static void make_palette(const qm_scale *scale, uint8_t palette[COLOURS][3])
{
    memset(palette[NOTHING], 255, 3);
    memset(palette[LINE], 0, 3);
    for (int band = 0; band <= QM_SCALE_BANDS; band++) {
        uint8_t colour[3];
        qm_scale_colour(scale, band, colour);
        for (int shade = 0; shade < SHADES; shade++) {
            double bright = DARKEST + (1.0 - DARKEST) * shade / (SHADES - 1);
            for (int k = 0; k < 3; k++)
                palette[FIRST_BAND + band * SHADES + shade][k] = (uint8_t)lround(bright * colour[k]);
        }
    }
}

static bool is_beyond(const qm_scale *scale, double distance)
{
    return qm_scale_band(scale, distance) >= scale->within;
}

/** Whether the limit lies between a pixel and its neighbour to the right or below. */
static bool crosses(const qm_heat *heat, const qm_scale *scale, size_t i)
{
    size_t width = (size_t)heat->raster.view.width;
    bool beyond = is_beyond(scale, heat->distance[i]);
    size_t next[2] = {(i + 1) % width != 0 ? i + 1 : i, i + width < count_pixels(heat) ? i + width : i};
    for (int k = 0; k < 2; k++) {
        double distance = heat->distance[next[k]];
        if (!isnan(distance) && is_beyond(scale, distance) != beyond) return true;
    }
    return false;
}

/** The brightness of a pixel: by a pattern of 4 x 4 pixels one of the two next to it, as steps of brightness would look like
 * bands of distance. */
static int choose_shade(const qm_heat *heat, size_t i)
{
    static const double pattern[4][4] = {{0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}};
    size_t width = (size_t)heat->raster.view.width;
    double shade = (heat->shine[i] - 0.25) / 0.75 * (SHADES - 1);
    int chosen = (int)(shade + (pattern[i / width % 4][i % width % 4] + 0.5) / 16.0);
    return chosen < SHADES ? chosen : SHADES - 1;
}

qm_png_status qm_heat_write(const qm_heat *heat, const qm_scale *scale, qm_text *out)
{
    uint8_t palette[COLOURS][3], *pixels = calloc(count_pixels(heat), 1);
    if (!pixels) return QM_PNG_NO_MEMORY;
    make_palette(scale, palette);
    for (size_t i = 0; i < count_pixels(heat); i++) {
        if (isnan(heat->distance[i])) continue;
        int shade = choose_shade(heat, i);
        pixels[i] = scale->within > 0 && crosses(heat, scale, i)
                        ? LINE
                        : (uint8_t)(FIRST_BAND + qm_scale_band(scale, heat->distance[i]) * SHADES + shade);
    }
    const qm_png picture = {.width = heat->raster.view.width,
                            .height = heat->raster.view.height,
                            .pixels = pixels,
                            .palette = (const uint8_t(*)[3])palette,
                            .palette_count = COLOURS};
    qm_png_status status = qm_png_write_uri(out, &picture);
    free(pixels);
    return status;
}
