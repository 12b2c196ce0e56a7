/**
 * picture.c: draws triangles into a depth buffer and the edges of faces over them; libspng writes the file.
 * The library, and zlib, which it needs, are loaded when a picture is written: all other runs start faster without them.
 */
#include "cli.h"

#include <dlfcn.h>
#include <errno.h>
#include <float.h>
#include <math.h>
#include <spng.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/library.h"

enum { WIDTH = 1000, HEIGHT = 800, PIXELS_SIZE = 3 * WIDTH * HEIGHT };

#define MARGIN 0.92     /* fraction of the picture that the mesh fills */
#define EDGE_LIFT 0.004 /* edges are drawn over faces nearer by up to this fraction of the mesh's diagonal */

typedef struct canvas {
    double right[3], up[3], towards[3]; /* axes of the view */
    double centre[3], scale;            /* pixels per length */
    double lift;
    uint8_t *pixels; /* HEIGHT lines of WIDTH colours */
    double *depth;
} canvas;

typedef struct screen_point {
    double x, y, z;
} screen_point;

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void normalise(double v[3])
{
    double length = sqrt(dot(v, v));
    for (int k = 0; k < 3 && length > 0.0; k++)
        v[k] /= length;
}

static screen_point project(const canvas *c, const double *p)
{
    const double d[3] = {p[0] - c->centre[0], p[1] - c->centre[1], p[2] - c->centre[2]};
    return (screen_point){0.5 * WIDTH + c->scale * dot(d, c->right), 0.5 * HEIGHT - c->scale * dot(d, c->up),
                          c->scale * dot(d, c->towards)};
}

/** Looks along the shortest side of the box, a little from above and from the side. */
static void set_view(canvas *c, const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    int shortest = 0, tallest = 1;
    for (int k = 0; k < 3; k++) {
        c->centre[k] = 0.5 * (box.min[k] + box.max[k]);
        if (box.max[k] - box.min[k] < box.max[shortest] - box.min[shortest]) shortest = k;
    }
    if (shortest == 1) tallest = 2;
    for (int k = 0; k < 3; k++) {
        c->towards[k] = k == shortest ? 1.0 : k == tallest ? 0.35 : 0.45;
        c->up[k] = k == tallest;
    }
    normalise(c->towards);
    cross(c->up, c->towards, c->right);
    normalise(c->right);
    cross(c->towards, c->right, c->up);
    double wide = 0.0, high = 0.0;
    c->scale = 1.0;
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        screen_point s = project(c, mesh->positions + 3 * i);
        wide = fmax(wide, fabs(s.x - 0.5 * WIDTH));
        high = fmax(high, fabs(s.y - 0.5 * HEIGHT));
    }
    c->scale = MARGIN * fmin(0.5 * WIDTH / fmax(wide, DBL_MIN), 0.5 * HEIGHT / fmax(high, DBL_MIN));
    c->lift = EDGE_LIFT * c->scale * qm_mesh_box_diagonal(&box);
}

static void put(canvas *c, int x, int y, const uint8_t colour[3])
{
    QM_ASSERT(x >= 0 && x < WIDTH && y >= 0 && y < HEIGHT);
    memcpy(c->pixels + 3 * ((size_t)y * WIDTH + (size_t)x), colour, 3);
}

static int clamp(double x, int max)
{
    return x < 0.0 ? 0 : x > max ? max : (int)x;
}

static void fill_triangle(canvas *c, const screen_point *a, const screen_point *b, const screen_point *d,
                          const uint8_t colour[3])
{
    double area = (b->x - a->x) * (d->y - a->y) - (d->x - a->x) * (b->y - a->y);
    if (area == 0.0) return;
    int left = clamp(floor(fmin(a->x, fmin(b->x, d->x))), WIDTH - 1),
        right = clamp(ceil(fmax(a->x, fmax(b->x, d->x))), WIDTH - 1),
        top = clamp(floor(fmin(a->y, fmin(b->y, d->y))), HEIGHT - 1),
        bottom = clamp(ceil(fmax(a->y, fmax(b->y, d->y))), HEIGHT - 1);
    for (int y = top; y <= bottom; y++) {
        for (int x = left; x <= right; x++) {
            double v = ((x - a->x) * (d->y - a->y) - (d->x - a->x) * (y - a->y)) / area;
            double w = ((b->x - a->x) * (y - a->y) - (x - a->x) * (b->y - a->y)) / area;
            double z = a->z + v * (b->z - a->z) + w * (d->z - a->z);
            size_t at = (size_t)y * WIDTH + (size_t)x;
            if (v < 0.0 || w < 0.0 || v + w > 1.0 || z <= c->depth[at]) continue;
            c->depth[at] = z;
            put(c, x, y, colour);
        }
    }
}

static void draw_edge(canvas *c, const screen_point *a, const screen_point *b)
{
    static const uint8_t ink[3] = {30, 40, 70};
    int steps = (int)fmax(fabs(b->x - a->x), fabs(b->y - a->y)) + 1;
    for (int k = 0; k <= steps; k++) {
        double t = (double)k / steps;
        int x = clamp(a->x + t * (b->x - a->x), WIDTH - 1), y = clamp(a->y + t * (b->y - a->y), HEIGHT - 1);
        if (a->z + t * (b->z - a->z) + c->lift >= c->depth[(size_t)y * WIDTH + (size_t)x]) put(c, x, y, ink);
    }
}

/** Grey by the angle to a light beside the viewer; both sides of a face look the same. */
static void shade(const canvas *c, const double *a, const double *b, const double *d, uint8_t colour[3])
{
    double e[3], f[3], normal[3], light[3];
    for (int k = 0; k < 3; k++) {
        e[k] = b[k] - a[k];
        f[k] = d[k] - a[k];
        light[k] = c->towards[k] + 0.4 * c->up[k] - 0.3 * c->right[k];
    }
    cross(e, f, normal);
    normalise(normal);
    normalise(light);
    double shine = 0.25 + 0.75 * fabs(dot(normal, light));
    const double base[3] = {215, 225, 245};
    for (int k = 0; k < 3; k++)
        colour[k] = (uint8_t)(shine * base[k]);
}

static void draw(canvas *c, const qm_mesh *mesh)
{
    for (int edges = 0; edges < 2; edges++) {
        for (size_t f = 0; f < mesh->face_count; f++) {
            const uint32_t *index = mesh->faces + 4 * f;
            int count = index[3] == QM_NO_INDEX ? 3 : 4;
            screen_point at[4];
            for (int k = 0; k < count; k++)
                at[k] = project(c, mesh->positions + 3 * (size_t)index[k]);
            for (int k = 0; edges && k < count; k++)
                draw_edge(c, &at[k], &at[(k + 1) % count]);
            for (int k = 1; !edges && k + 1 < count; k++) {
                uint8_t colour[3];
                shade(c, mesh->positions + 3 * (size_t)index[0], mesh->positions + 3 * (size_t)index[k],
                      mesh->positions + 3 * (size_t)index[k + 1], colour);
                fill_triangle(c, &at[0], &at[k], &at[k + 1], colour);
            }
        }
    }
}

/** The functions in use, without the prefix spng_. */
#define CLI_SPNG_MAP(XX)                                                                                     \
    XX(ctx_new)                                                                                              \
    XX(set_png_file)                                                                                         \
    XX(set_ihdr)                                                                                             \
    XX(encode_image)                                                                                         \
    XX(ctx_free)

typedef struct spng_library {
#define XX(name) __typeof__(spng_##name) *name;
    CLI_SPNG_MAP(XX)
#undef XX
} spng_library;

#define LIBRARY "libspng.so.0"

/** Loads the library, which stays loaded; false with errno if it cannot. */
static bool load_spng(spng_library *spng)
{
    void *library = dlopen(LIBRARY, RTLD_LAZY);
#define XX(name) &&qm_library_find(library, "spng_" #name, &spng->name)
    const bool is_loaded = library CLI_SPNG_MAP(XX);
#undef XX
    if (!is_loaded) errno = ELIBACC;
    return is_loaded;
}

static bool write_png(const char *path, const uint8_t *pixels)
{
    spng_library spng;
    if (!load_spng(&spng)) return false;
    FILE *file = fopen(path, "wb");
    if (!file) return false;
    struct spng_ihdr header = {
        .width = WIDTH, .height = HEIGHT, .bit_depth = 8, .color_type = SPNG_COLOR_TYPE_TRUECOLOR};
    spng_ctx *png = spng.ctx_new(SPNG_CTX_ENCODER);
    if (!png) errno = ENOMEM;
    bool is_written = png && spng.set_png_file(png, file) == 0 && spng.set_ihdr(png, &header) == 0 &&
                      spng.encode_image(png, pixels, PIXELS_SIZE, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE) == 0;
    spng.ctx_free(png);
    return fclose(file) == 0 && is_written;
}

bool cli_write_picture(const char *path, const qm_mesh *mesh)
{
    canvas c = {.pixels = malloc(PIXELS_SIZE), .depth = malloc((size_t)WIDTH * HEIGHT * sizeof(double))};
    bool is_written = c.pixels && c.depth;
    if (is_written) {
        memset(c.pixels, 255, PIXELS_SIZE);
        for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++)
            c.depth[i] = -DBL_MAX;
        set_view(&c, mesh);
        draw(&c, mesh);
        is_written = write_png(path, c.pixels);
    } else {
        errno = ENOMEM;
    }
    free(c.pixels);
    free(c.depth);
    return is_written;
}
