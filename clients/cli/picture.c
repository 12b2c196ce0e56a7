/**
 * picture.c: the picture of a mesh, shaded in grey, with the edges of its faces.
 */
#include "cli.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "report/png.h"
#include "report/raster.h"

enum { WIDTH = 1000, HEIGHT = 800, PIXELS_SIZE = 3 * WIDTH * HEIGHT };

#define EDGE_LIFT 0.004 /* edges are drawn over faces nearer by up to this fraction of the mesh's diagonal */

/** Looks along the shortest side of the box, a little from above and from the side. */
static qm_view choose_view(const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    int shortest = 0, tallest = 1;
    for (int k = 0; k < 3; k++) {
        if (box.max[k] - box.min[k] < box.max[shortest] - box.min[shortest]) shortest = k;
    }
    if (shortest == 1) tallest = 2;
    double towards[3], up[3];
    for (int k = 0; k < 3; k++) {
        towards[k] = k == shortest ? 1.0 : k == tallest ? 0.35 : 0.45;
        up[k] = k == tallest;
    }
    return qm_raster_view(&box, towards, up, WIDTH, HEIGHT);
}

static void paint_faces(const qm_raster *raster, const qm_mesh *mesh, uint8_t *pixels)
{
    static const double base[3] = {215, 225, 245};
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) {
        if (raster->face[i] == QM_NO_INDEX) continue;
        double normal[3];
        qm_raster_normal(mesh, QM_QUADS_TRIANGLES, raster->face[i], raster->uv + 2 * i, normal);
        double shine = qm_raster_shine(&raster->view, normal);
        for (int k = 0; k < 3; k++)
            pixels[3 * i + (size_t)k] = (uint8_t)(shine * base[k]);
    }
}

static void paint_edge(const qm_raster *raster, const double *a, const double *b, uint8_t *pixels)
{
    static const uint8_t ink[3] = {30, 40, 70};
    const double lift = EDGE_LIFT * raster->view.scale;
    double from[3], to[3];
    qm_raster_project(&raster->view, a, from);
    qm_raster_project(&raster->view, b, to);
    int steps = (int)fmax(fabs(to[0] - from[0]), fabs(to[1] - from[1])) + 1;
    for (int k = 0; k <= steps; k++) {
        double t = (double)k / steps, at[3];
        for (int i = 0; i < 3; i++)
            at[i] = from[i] + t * (to[i] - from[i]);
        /* The view has the whole mesh, with a margin. */
        QM_ASSERT(at[0] >= 0.0 && at[0] < WIDTH && at[1] >= 0.0 && at[1] < HEIGHT);
        size_t pixel = (size_t)at[1] * WIDTH + (size_t)at[0];
        if (at[2] + lift >= raster->depth[pixel]) memcpy(pixels + 3 * pixel, ink, sizeof ink);
    }
}

static void paint_edges(const qm_raster *raster, const qm_mesh *mesh, uint8_t *pixels)
{
    for (size_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *corner = mesh->faces + 4 * f;
        int count = corner[3] == QM_NO_INDEX ? 3 : 4;
        for (int k = 0; k < count; k++)
            paint_edge(raster, mesh->positions + 3 * (size_t)corner[k],
                       mesh->positions + 3 * (size_t)corner[(k + 1) % count], pixels);
    }
}

static bool write_file(const char *path, const uint8_t *pixels)
{
    qm_text file = {0};
    const qm_png picture = {.width = WIDTH, .height = HEIGHT, .pixels = pixels};
    qm_png_status status = qm_png_write(&file, &picture);
    if (status == QM_PNG_OK && file.failed) status = QM_PNG_NO_MEMORY;
    bool is_written = status == QM_PNG_OK && cli_write_file(path, file.data, file.size);
    if (status != QM_PNG_OK) errno = status == QM_PNG_NO_LIBRARY ? ELIBACC : ENOMEM;
    qm_text_reset(&file);
    return is_written;
}

bool cli_write_picture(const char *path, const qm_mesh *mesh)
{
    qm_context ctx = qm_host_context();
    const qm_view view = choose_view(mesh);
    qm_raster raster;
    uint8_t *pixels = malloc(PIXELS_SIZE);
    bool is_ready = pixels && qm_raster_init(&ctx, &view, &raster), is_written = false;
    if (is_ready) {
        memset(pixels, 255, PIXELS_SIZE);
        qm_raster_draw(&raster, mesh, QM_QUADS_TRIANGLES);
        paint_faces(&raster, mesh, pixels);
        paint_edges(&raster, mesh, pixels);
        is_written = write_file(path, pixels);
        qm_raster_reset(&ctx, &raster);
    } else {
        errno = ENOMEM;
    }
    free(pixels);
    return is_written;
}
