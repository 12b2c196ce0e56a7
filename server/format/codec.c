/**
 * codec.c: the table of formats, detection of a format by the first bytes, and the call of its decoder.
 */
#include "codec.h"

#include <stdio.h>
#include <strings.h>

#include "codec_builder.h"
#include "codec_scan.h"

typedef struct format_facts {
    const char *name, *media_type, *magic;
    qm_decoder *decode;
} format_facts;

#define FORMAT_COUNT (sizeof formats / sizeof *formats)

static const format_facts formats[] = {
    [QM_FORMAT_UNKNOWN] = {"unknown", "application/octet-stream", "", NULL},
#define XX(number, suffix, name, media, magic)                                                               \
    [QM_FORMAT_##suffix] = {#name, media, magic, qm_codec_decode_##name},
    QM_FORMAT_MAP(XX)
#undef XX
};

qm_format qm_format_from_name(const char *name)
{
    for (size_t i = 1; i < FORMAT_COUNT; ++i)
        if (strcasecmp(name, formats[i].name) == 0) return (qm_format)i;
    return QM_FORMAT_UNKNOWN;
}

qm_format qm_format_from_path(const char *path)
{
    const char *end = path + strlen(path), *const packed = ".gz";
    if ((size_t)(end - path) >= strlen(packed) && strcasecmp(end - strlen(packed), packed) == 0)
        end -= strlen(packed);
    const char *dot = memrchr(path, '.', (size_t)(end - path));
    char name[8];
    if (!dot || (size_t)(end - dot) > sizeof name) return QM_FORMAT_UNKNOWN;
    snprintf(name, sizeof name, "%.*s", (int)(end - dot - 1), dot + 1);
    if (strcasecmp(name, "gltf") == 0) return QM_FORMAT_GLB; /* its text form */
    return qm_format_from_name(name);
}

qm_format qm_format_from_media_type(const char *media_type)
{
    size_t length = strcspn(media_type, "; \t");
    static const char gltf_text[] = "model/gltf+json";
    if (length == strlen(gltf_text) && strncasecmp(media_type, gltf_text, length) == 0) return QM_FORMAT_GLB;
    for (size_t i = 1; i < FORMAT_COUNT; ++i)
        if (strlen(formats[i].media_type) == length &&
            strncasecmp(media_type, formats[i].media_type, length) == 0)
            return (qm_format)i;
    return QM_FORMAT_UNKNOWN;
}

const char *qm_format_name(qm_format format)
{
    return formats[format].name;
}

const char *qm_format_media_type(qm_format format)
{
    return formats[format].media_type;
}

static bool has_prefix(const uint8_t *bytes, size_t size, const char *prefix)
{
    size_t length = strlen(prefix);
    return size >= length && memcmp(bytes, prefix, length) == 0;
}

/** The number of columns of a row of numbers, and whether all are digits only; 0 for other rows. */
static int count_columns(qm_scan text, bool *only_digits)
{
    double number;
    int count = 0;
    *only_digits = true;
    for (;; ++count) {
        qm_scan_skip_blanks(&text);
        if (count > 0 && text.at < text.end && *text.at == ',') ++text.at;
        qm_scan_skip_blanks(&text);
        if (qm_scan_at_row_end(&text)) return count;
        const uint8_t *from = text.at;
        if (qm_scan_read_number(&text, &number) != QM_OK) return 0;
        for (; from < text.at; ++from)
            *only_digits &= *from >= '0' && *from <= '9';
    }
}

/** A row of three integers followed by other numbers may be a point, or an OFF file without its keyword: ambiguous, so
 * it is neither. */
static qm_format sniff_numbers(qm_scan text)
{
    bool first_is_digits, second_is_digits;
    if (count_columns(text, &first_is_digits) < 3) return QM_FORMAT_UNKNOWN;
    qm_scan_skip_line(&text);
    if (first_is_digits && qm_scan_find_row(&text) &&
        (count_columns(text, &second_is_digits) < 3 || !second_is_digits))
        return QM_FORMAT_UNKNOWN;
    return QM_FORMAT_XYZ;
}

qm_format qm_format_sniff(const uint8_t *bytes, size_t size)
{
    for (size_t i = 1; i < FORMAT_COUNT; ++i)
        if (formats[i].magic[0] && has_prefix(bytes, size, formats[i].magic)) return (qm_format)i;
    if (qm_codec_is_binary_stl(bytes, size)) return QM_FORMAT_STL;
    if (qm_codec_is_gltf_text(bytes, size)) return QM_FORMAT_GLB;
    static const char *const obj_words[] = {"v", "vt", "vn", "f", "o", "g", "s", "mtllib", "usemtl"};
    qm_codec_report ignored;
    qm_scan text = {.at = bytes, .end = bytes + size, .line = 1, .has_comma = true, .report = &ignored};
    const uint8_t *word;
    size_t word_size;
    qm_scan_skip_mark(&text);
    if (!qm_scan_find_row(&text)) return QM_FORMAT_UNKNOWN;
    qm_scan row = text;
    qm_scan_read_word(&text, &word, &word_size);
    for (size_t i = 0; i < sizeof obj_words / sizeof *obj_words; ++i)
        if (qm_scan_word_is(word, word_size, obj_words[i])) return QM_FORMAT_OBJ;
    if (qm_scan_word_is(word, word_size, "ply")) return QM_FORMAT_PLY;
    if (qm_scan_word_is(word, word_size, "solid")) return QM_FORMAT_STL;
    if (word_size >= 3 && qm_scan_word_is(word + word_size - 3, 3, "off")) return QM_FORMAT_OFF;
    if (qm_scan_word_is(word, word_size, "version") && qm_scan_find_next_row(&text))
        qm_scan_read_word(&text, &word, &word_size); /* only a PCD file goes on as follows */
    if (qm_scan_word_is(word, word_size, "fields") || qm_scan_word_is(word, word_size, "columns"))
        return QM_FORMAT_PCD;
    return sniff_numbers(row);
}

/** Formats of meshes and scenes that are not read, by the first bytes after blanks. */
static const struct {
    const char *magic, *name;
} other_formats[] = {
    {"# vtk DataFile", "VTK"},
    {"$MeshFormat", "Gmsh (MSH)"},
    {"ISO-10303-21", "STEP"},
    {"Kaydara FBX Binary", "FBX"},
    {"; FBX", "FBX"},
    {"<VTKFile", "VTK"},
    {"<COLLADA", "COLLADA"},
    {"<X3D", "X3D"},
    {"#VRML", "VRML"},
    {"#X3D", "X3D"},
    {"PXR-USDC", "USD"},
    {"#usda", "USD"},
    {"BLENDER", "Blender"},
    {"3D Geometry File Format", "Rhino (3DM)"},
    {"ASTM-E57", "E57"},
    {"LASF", "LAS"},
    {"MeshVersionFormatted", "Medit (mesh)"},
    {"\x89HDF", "HDF5"},
    {"\x89PNG", "PNG"},
    {"\xff\xd8\xff", "JPEG"},
    {"%PDF", "PDF"},
    {"<!DOCTYPE html", "HTML"},
    {"<html", "HTML"},
    {"7z\xbc\xaf", "7-Zip"},
    {"Rar!", "RAR"},
    {"BZh", "bzip2"},
    {"\xfd"
     "7zXZ",
     "xz"},
    {"\x28\xb5\x2f\xfd", "Zstandard"},
};

static const uint8_t *skip_blanks(const uint8_t *at, const uint8_t *end)
{
    while (at < end && (*at == ' ' || *at == '\t' || *at == '\r' || *at == '\n'))
        at++;
    return at;
}

/** The name of the format that a file seems to have; NULL when that is not known. */
static const char *find_other_format(const uint8_t *bytes, size_t size)
{
    const uint8_t *end = bytes + size;
    const uint8_t *at = skip_blanks(bytes + (has_prefix(bytes, size, "\xef\xbb\xbf") ? 3 : 0), end);
    bool is_xml = has_prefix(at, (size_t)(end - at), "<?xml");
    const uint8_t *declared = is_xml ? memmem(at, (size_t)(end - at), "?>", 2) : NULL;
    if (declared) at = skip_blanks(declared + 2, end);
    for (size_t i = 0; i < sizeof other_formats / sizeof *other_formats; i++)
        if (has_prefix(at, (size_t)(end - at), other_formats[i].magic)) return other_formats[i].name;
    return is_xml ? "XML" : NULL;
}

/** Checks what concerns all formats, and decodes the file into the builder. */
static qm_status decode(qm_builder *builder, qm_format format, const uint8_t *bytes, size_t size)
{
    qm_codec_report *report = builder->report;
    report->line = report->offset = QM_NO_LOCATION;
    report->detail[0] = 0;
    report->warning_count = 0;
    if (size == 0) {
        bool is_text = !formats[format].magic[0];
        *(is_text ? &report->line : &report->offset) = is_text;
        return qm_codec_fail(report, QM_E_EMPTY, "the file is empty");
    }
    if ((unsigned)format >= FORMAT_COUNT || !formats[format].decode) {
        const char *name = find_other_format(bytes, size);
        report->offset = 0;
        return name ? qm_codec_fail(
                          report, QM_E_UNSUPPORTED,
                          "the file seems to be %s, which is not read; formats that are:" QM_FORMAT_NAMES,
                          name)
                    : qm_codec_fail(
                          report, QM_E_UNSUPPORTED,
                          "the format of the file is unknown; formats that are read:" QM_FORMAT_NAMES);
    }

    bool is_utf16 = has_prefix(bytes, size, "\xff\xfe") || has_prefix(bytes, size, "\xfe\xff");
    if (is_utf16 && !formats[format].magic[0] && !qm_codec_is_binary_stl(bytes, size)) {
        report->line = 1;
        return qm_codec_fail(report, QM_E_UNSUPPORTED,
                             "the text is UTF-16; only UTF-8 and ASCII are supported");
    }

    return formats[format].decode(builder, bytes, size);
}

/** Frees the builder, and completes the report. */
static qm_status end(qm_builder *builder, qm_status status)
{
    qm_codec_report *report = builder->report;
    qm_builder_free(builder);
    if (status == QM_OK)
        report->line = report->offset = QM_NO_LOCATION;
    else if (!report->detail[0])
        qm_codec_fail(report, status, "%s", qm_status_text(status));
    return status;
}

qm_status qm_codec_decode(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                          const qm_codec_limits *limits, qm_mesh *out, qm_codec_report *report)
{
    QM_ASSERT(ctx && limits && out && report && (bytes || size == 0));
    *out = (qm_mesh){0};
    qm_builder builder = {.ctx = ctx, .limits = limits, .report = report};
    qm_status status = decode(&builder, format, bytes, size);
    if (status == QM_OK) status = qm_builder_finish(&builder, out);
    return end(&builder, status);
}

qm_status qm_codec_count(qm_context *ctx, qm_format format, const uint8_t *bytes, size_t size,
                         const qm_codec_limits *limits, qm_codec_counts *out, qm_codec_report *report)
{
    QM_ASSERT(ctx && limits && out && report && (bytes || size == 0));
    qm_builder builder = {.ctx = ctx, .limits = limits, .report = report, .only_counts = true};
    qm_status status = decode(&builder, format, bytes, size);
    *out = (qm_codec_counts){.vertices = builder.vertex_count,
                             .faces = builder.face_count,
                             .quads = builder.quad_count,
                             .is_exact = !builder.counts_are_low};
    return end(&builder, status);
}
