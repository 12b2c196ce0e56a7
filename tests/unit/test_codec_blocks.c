/* Texts read in blocks: what the generator wrote, and the same as by the ordinary loop of the decoder, also
 * of files with oddities and faults. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "decode.h"
#include "format/codec_blocks.h"
#include "random.h"

#define TEXT_SIZE ((size_t)640 << 10)
#define VERTEX_COUNT 6000
#define FACE_COUNT 6000

/** A text, and what it says. */
typedef struct sample {
    char *text;
    size_t size;
    double positions[VERTEX_COUNT][3];
    uint32_t faces[FACE_COUNT][4];
} sample;

static sample *make_sample(void)
{
    sample *s = calloc(1, sizeof *s);
    assert_non_null(s);
    s->text = malloc(TEXT_SIZE);
    assert_non_null(s->text);
    return s;
}

static void free_sample(sample *s)
{
    free(s->text);
    free(s);
}

#define ADD(s, ...)                                                                                          \
    ((s)->size += (size_t)snprintf((s)->text + (s)->size, TEXT_SIZE - (s)->size, __VA_ARGS__),               \
     assert_true((s)->size < TEXT_SIZE))

static void add_vertex(sample *s, qm_random *random, size_t i, const char *word)
{
    char number[3][32];
    for (int k = 0; k < 3; k++) {
        snprintf(number[k], sizeof number[k], "%.*f", (int)qm_random_below(random, 9) + 3,
                 qm_random_range(random, -20.0, 20.0));
        s->positions[i][k] = strtod(number[k], NULL);
    }
    ADD(s, "%s%s %s %s", word, number[0], number[1], number[2]);
}

/** Corners among the first vertices so many; base is the index of the first one in the file. */
static void add_face(sample *s, qm_random *random, size_t i, size_t vertices, bool has_count, unsigned base)
{
    const bool is_quad = qm_random_below(random, 2) == 0;
    if (has_count)
        ADD(s, "%d", is_quad ? 4 : 3);
    else
        ADD(s, "f");
    s->faces[i][3] = QM_NO_INDEX;
    for (int k = 0; k < (is_quad ? 4 : 3); k++) {
        s->faces[i][k] = (uint32_t)qm_random_below(random, vertices);
        ADD(s, " %" PRIu32, s->faces[i][k] + base);
    }
}

/** A statement that an OBJ may have between others. */
static const char *const obj_extras[] = {"# a comment",    "vn 0.0 1.0 0.0", "g piece", "",
                                         "vt 0.25 .75",    "s off",          "l 1 2",   "usemtl v",
                                         "#v 1.0 2.0 3.0", "vp 1.0 2.0",     "f_ 1 2"};

static void write_obj(sample *s, qm_random *random, const char *line_end, bool has_extras, bool is_mixed)
{
    size_t vertices = 0, faces = 0;
    while (vertices < VERTEX_COUNT || faces < FACE_COUNT) {
        if (has_extras && qm_random_below(random, 20) == 0) {
            ADD(s, "%s%s", obj_extras[qm_random_below(random, sizeof obj_extras / sizeof *obj_extras)],
                line_end);
        }
        bool is_face = vertices == VERTEX_COUNT ||
                       (is_mixed && vertices > 2 && faces < FACE_COUNT && qm_random_below(random, 2) == 0);
        if (is_face) {
            add_face(s, random, faces++, vertices, false, 1);
            if (has_extras && qm_random_below(random, 9) == 0) ADD(s, " # face");
        } else {
            add_vertex(s, random, vertices++, "v ");
        }
        ADD(s, "%s", line_end);
    }
}

static void write_rows(sample *s, qm_random *random, const char *line_end, const char *further_columns)
{
    for (size_t i = 0; i < VERTEX_COUNT; i++) {
        add_vertex(s, random, i, "");
        ADD(s, "%s%s", further_columns, line_end);
    }
    for (size_t i = 0; i < FACE_COUNT; i++) {
        add_face(s, random, i, VERTEX_COUNT, true, 0);
        ADD(s, "%s", line_end);
    }
}

static void write_sample(sample *s, qm_random *random, qm_format format, bool has_extras)
{
    const char *line_end = qm_random_below(random, 4) == 0 ? "\r\n" : "\n";
    s->size = 0;
    if (format == QM_FORMAT_OBJ) {
        write_obj(s, random, line_end, has_extras, qm_random_below(random, 2) == 0);
    } else if (format == QM_FORMAT_OFF) {
        ADD(s, "OFF%s%d %d 0%s", line_end, VERTEX_COUNT, FACE_COUNT, line_end);
        write_rows(s, random, line_end, has_extras ? " 1 0 0" : "");
    } else {
        ADD(s, "ply%sformat ascii 1.0%selement vertex %d%s", line_end, line_end, VERTEX_COUNT, line_end);
        ADD(s, "property double x%sproperty double y%sproperty double z%s", line_end, line_end, line_end);
        if (has_extras) ADD(s, "property uchar red%s", line_end);
        ADD(s, "element face %d%sproperty list uchar int vertex_indices%send_header%s", FACE_COUNT, line_end,
            line_end, line_end);
        write_rows(s, random, line_end, has_extras ? " 255" : "");
    }
}

static qm_decoded decode(const sample *s, qm_format format, int thread_count, size_t most)
{
    return qm_decode_limited(format, s->text, s->size, (qm_codec_limits){most, most, thread_count, 0, NULL});
}

static void plain_texts_give_what_was_written(void **state)
{
    static const qm_format formats[] = {QM_FORMAT_OBJ, QM_FORMAT_OFF, QM_FORMAT_PLY};
    (void)state;
    sample *s = make_sample();
    for (uint64_t i = 0; i < 24; i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        const qm_format format = formats[i % 3];
        write_sample(s, &random, format, i % 2 == 1);
        qm_decoded decoded = decode(s, format, 2 + (int)(i % 3), 1000000);
        const qm_mesh *mesh = &decoded.mesh;
        QM_CHECK(decoded.status == QM_OK && mesh->vertex_count == VERTEX_COUNT &&
                     mesh->face_count == FACE_COUNT,
                 "case %" PRIu64 ", seed %" PRIu64 ": %s", i, qm_check_seed(), decoded.report.detail);
        assert_memory_equal(mesh->positions, s->positions, sizeof s->positions);
        assert_memory_equal(mesh->faces, s->faces, sizeof s->faces);
        qm_decoded_free(&decoded);
    }
    free_sample(s);
}

/** What may stand in a file in place of some bytes: all that blocks have to leave to the ordinary loop. */
static const char *const oddities[] = {
    "\n",
    "\r",
    "\\\n",
    "\\\r\n",
    "\nf 1 2 3 4 5\n",
    "\nf -1 -2 -3\n",
    "\nf 1/2 2/2 3/4\n",
    "\n5 1 2 3 4 5\n",
    "\n# here\n",
    "\n  v 1.5 2.5 3.5\n",
    "\nv 1 2 3\n",
    "\nf 6000 1 2\n",
    "\nf 5999 1 7000\n",
    "\n3 1 2 6000\n",
    " ",
    "\t",
    "x",
    "nan",
    "1e999",
    "9",
    "-",
    ".",
    "\nf 1 1 2\n",
    "\n3 1 1 2\n",
    "\nv\t1.0 2.0 3.0\n",
    "\nf 1 2 \\\n3\n",
    "\n1.0 2.0 3.0\n",
    "",
    "# ",
    "\n\n\n",
};

static void put_oddity(sample *s, qm_random *random)
{
    const char *oddity = oddities[qm_random_below(random, sizeof oddities / sizeof *oddities)];
    const size_t length = strlen(oddity), cut = qm_random_below(random, 3);
    size_t at = qm_random_below(random, s->size - cut);
    if (qm_random_below(random, 2) == 0) {
        const char *line_end = memchr(s->text + at, '\n', s->size - cut - at);
        if (line_end) at = (size_t)(line_end - s->text);
    }
    assert_true(s->size + length < TEXT_SIZE);
    memmove(s->text + at + length, s->text + at + cut, s->size - at - cut);
    memcpy(s->text + at, oddity, length);
    s->size += length - cut;
}

static void check_same(const qm_decoded *found, const qm_decoded *expected, uint64_t number)
{
    const qm_mesh *mesh = &found->mesh, *other = &expected->mesh;
    QM_CHECK(found->status == expected->status && found->report.line == expected->report.line &&
                 strcmp(found->report.detail, expected->report.detail) == 0,
             "case %" PRIu64 ", seed %" PRIu64 ": %s at %zu instead of %s at %zu", number, qm_check_seed(),
             found->report.detail, found->report.line, expected->report.detail, expected->report.line);
    QM_CHECK(found->report.warning_count == expected->report.warning_count, "case %" PRIu64, number);
    for (size_t i = 0; i < found->report.warning_count; i++)
        assert_string_equal(found->report.warnings[i], expected->report.warnings[i]);
    QM_CHECK(mesh->vertex_count == other->vertex_count && mesh->face_count == other->face_count &&
                 mesh->polygon_count == other->polygon_count,
             "case %" PRIu64 ", seed %" PRIu64, number, qm_check_seed());
    if (mesh->vertex_count > 0)
        assert_memory_equal(mesh->positions, other->positions, 24 * mesh->vertex_count);
    if (mesh->face_count > 0) assert_memory_equal(mesh->faces, other->faces, 16 * mesh->face_count);
    assert_true(!mesh->face_origin == !other->face_origin);
    if (mesh->face_origin) assert_memory_equal(mesh->face_origin, other->face_origin, 4 * mesh->face_count);
}

static void odd_texts_give_what_the_ordinary_loop_gives(void **state)
{
    static const qm_format formats[] = {QM_FORMAT_OBJ, QM_FORMAT_OFF, QM_FORMAT_PLY};
    (void)state;
    sample *s = make_sample();
    const uint64_t count = qm_check_long() ? 6000 : 240;
    size_t good = 0;
    for (uint64_t i = 0; i < count; i++) {
        qm_random random = qm_random_make(qm_check_seed(), 1000 + i);
        const qm_format format = formats[i % 3];
        const size_t most =
            qm_random_below(&random, 8) == 0 ? 4000 + qm_random_below(&random, 2500) : 1000000;
        write_sample(s, &random, format, qm_random_below(&random, 2) == 0);
        for (size_t k = qm_random_below(&random, 4); k > 0; k--)
            put_oddity(s, &random);
        if (qm_random_below(&random, 10) == 0) s->size -= qm_random_below(&random, s->size / 2);
        qm_decoded found = decode(s, format, 3, most), expected = decode(s, format, 1, most);
        check_same(&found, &expected, i);
        good += found.status == QM_OK;
        qm_decoded_free(&found);
        qm_decoded_free(&expected);
    }
    QM_CHECK(good > count / 8 && good < count, "%zu of %" PRIu64 " files are good", good, count);
    free_sample(s);
}

/** No cut may part what a backslash joins, nor take the second half for a statement of its own. */
static void joined_lines_are_not_parted(void **state)
{
    (void)state;
    sample *s = make_sample();
    qm_random random = qm_random_make(qm_check_seed(), 0);
    for (size_t i = 0; i < VERTEX_COUNT; i++) {
        add_vertex(s, &random, i, "v ");
        ADD(s, "\n");
    }
    for (size_t i = 0; i < FACE_COUNT; i++)
        ADD(s, "f 1 2 %zu %*s\\%s\n%zu\n", i % 100 + 10, 40, "", i % 2 ? "\r" : "", i % 100 + 9);
    qm_decoded decoded = decode(s, QM_FORMAT_OBJ, 2, 1000000);
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.report.warning_count, 0);
    assert_int_equal(decoded.mesh.face_count, FACE_COUNT);
    for (size_t i = 0; i < FACE_COUNT; i++)
        assert_int_equal(decoded.mesh.faces[4 * i + 3], i % 100 + 8);
    qm_decoded_free(&decoded);
    free_sample(s);
}

/** A reader that takes each line for a vertex of its own number. */
static qm_status read_numbers(void *user, size_t index, size_t line_count, qm_scan *text, qm_builder *builder)
{
    (void)user, (void)index, (void)line_count;
    while (text->at < text->end) {
        const double number[3] = {(double)text->line, 0.0, 0.0};
        qm_status status = qm_builder_add_vertex(builder, number);
        if (status != QM_OK) return status;
        qm_scan_skip_line(text);
    }
    return QM_OK;
}

static void count_block(void *user, size_t index)
{
    (void)index;
    ++*(size_t *)user;
}

static void all_but_the_end_of_a_text_is_read_in_blocks(void **state)
{
    const size_t size = 80 * QM_BLOCK_SIZE;
    (void)state;
    uint8_t *bytes = malloc(size);
    assert_non_null(bytes);
    size_t blocks = 0, lines = 0;
    for (size_t i = 0; i < size; i++)
        bytes[i] = i % 7 == 6 ? '\n' : '1';
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    const qm_codec_limits limits = {1000000, 1000000, 2, 0, NULL};
    qm_codec_report report;
    qm_builder builder = {.ctx = &ctx, .limits = &limits, .report = &report};
    qm_scan text;
    assert_int_equal(qm_scan_open(&text, bytes, size, &report), QM_OK);
    const qm_block_reader reader = {.rows = QM_BLOCK_VERTICES,
                                    .max_lines = UINT64_MAX,
                                    .read = read_numbers,
                                    .take = count_block,
                                    .user = &blocks};
    assert_int_equal(qm_blocks_read(&builder, &text, &reader), QM_OK);
    lines = (size_t)(text.at - bytes) / 7;
    assert_true(blocks > 70 && (size_t)(text.end - text.at) < 9 * QM_BLOCK_SIZE);
    assert_true(text.line == lines + 1 && builder.vertex_count == lines && text.at[-1] == '\n');
    for (size_t i = 0; i < lines; i++)
        assert_true(builder.positions[3 * i] == (double)(i + 1));
    qm_builder_free(&builder);
    free(bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_texts_give_what_was_written),
        cmocka_unit_test(odd_texts_give_what_the_ordinary_loop_gives),
        cmocka_unit_test(joined_lines_are_not_parted),
        cmocka_unit_test(all_but_the_end_of_a_text_is_read_in_blocks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
