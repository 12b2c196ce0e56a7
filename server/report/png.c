/**
 * png.c: calls libspng.
 */
#include "png.h"

#include <dlfcn.h>
#include <nettle/base64.h>
#include <spng.h>
#include <stdlib.h>
#include <string.h>

#include "base/library.h"

/** The functions in use, without the prefix spng_. */
#define QM_PNG_MAP(XX)                                                                                       \
    XX(ctx_new)                                                                                              \
    XX(set_option)                                                                                           \
    XX(set_ihdr)                                                                                             \
    XX(set_plte)                                                                                             \
    XX(set_trns)                                                                                             \
    XX(encode_image)                                                                                         \
    XX(get_png_buffer)                                                                                       \
    XX(ctx_free)

typedef struct spng_library {
#define XX(name) __typeof__(spng_##name) *name;
    QM_PNG_MAP(XX)
#undef XX
} spng_library;

#define LIBRARY "libspng.so.0"

/** Loads the library, which stays loaded; false if it cannot. */
static bool load(spng_library *spng)
{
    void *library = dlopen(LIBRARY, RTLD_LAZY);
#define XX(name) &&qm_library_find(library, "spng_" #name, &spng->name)
    return library QM_PNG_MAP(XX);
#undef XX
}

static bool set_palette(const spng_library *spng, spng_ctx *png, const qm_png *picture)
{
    struct spng_plte colours = {.n_entries = (uint32_t)picture->palette_count};
    struct spng_trns alpha = {.n_type3_entries = 1, .type3_alpha = {0}};
    for (int i = 0; i < picture->palette_count; i++) {
        const uint8_t *colour = picture->palette[i];
        colours.entries[i] = (struct spng_plte_entry){colour[0], colour[1], colour[2], 255};
    }
    return spng->set_plte(png, &colours) == 0 && spng->set_trns(png, &alpha) == 0;
}

static bool encode(const spng_library *spng, spng_ctx *png, const qm_png *picture)
{
    struct spng_ihdr header = {.width = (uint32_t)picture->width,
                               .height = (uint32_t)picture->height,
                               .bit_depth = 8,
                               .color_type =
                                   picture->palette ? SPNG_COLOR_TYPE_INDEXED : SPNG_COLOR_TYPE_TRUECOLOR};
    size_t size = (size_t)picture->width * (size_t)picture->height * (picture->palette ? 1 : 3);
    return spng->set_option(png, SPNG_ENCODE_TO_BUFFER, 1) == 0 && spng->set_ihdr(png, &header) == 0 &&
           (!picture->palette || set_palette(spng, png, picture)) &&
           spng->encode_image(png, picture->pixels, size, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE) == 0;
}

/** The bytes of the file, for free(). */
static qm_png_status make_file(const qm_png *picture, uint8_t **out, size_t *size)
{
    spng_library spng;
    *out = NULL;
    if (!load(&spng)) return QM_PNG_NO_LIBRARY;
    spng_ctx *png = spng.ctx_new(SPNG_CTX_ENCODER);
    int error = 0;
    if (png && encode(&spng, png, picture)) *out = spng.get_png_buffer(png, size, &error);
    spng.ctx_free(png);
    return *out ? QM_PNG_OK : QM_PNG_NO_MEMORY;
}

qm_png_status qm_png_write(qm_text *out, const qm_png *picture)
{
    uint8_t *file;
    size_t size;
    qm_png_status status = make_file(picture, &file, &size);
    if (status == QM_PNG_OK) qm_text_add(out, (const char *)file, size);
    free(file);
    return status;
}

qm_png_status qm_png_write_uri(qm_text *out, const qm_png *picture)
{
    uint8_t *file;
    size_t size;
    qm_png_status status = make_file(picture, &file, &size);
    if (status != QM_PNG_OK) return status;
    char *text = malloc(BASE64_ENCODE_RAW_LENGTH(size));
    if (text) {
        base64_encode_raw(text, size, file);
        qm_text_add_string(out, "data:image/png;base64,");
        qm_text_add(out, text, BASE64_ENCODE_RAW_LENGTH(size));
    } else {
        status = QM_PNG_NO_MEMORY;
    }
    free(text);
    free(file);
    return status;
}
