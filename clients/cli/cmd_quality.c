/**
 * cmd_quality.c: the shape of the faces of a mesh by metrics of finite elements.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "ops/quality_out.h"
#include "options.h"

#define BLOCK 4096 /* faces */

typedef struct quality_options {
    const char *mesh, *per_face;
    int metric; /* of qm_metric; QM_METRIC_COUNT for all */
    bool as_json;
} quality_options;

static bool read_metric(const char *text, void *target)
{
    int *metric = target;
    for (*metric = 0; qm_metric_names[*metric]; ++*metric)
        if (strcmp(text, qm_metric_names[*metric]) == 0) return true;
    fputs("quadmesh: --metric takes one of", stderr);
    for (int m = 0; m < QM_METRIC_COUNT; m++)
        fprintf(stderr, " %s", qm_metric_names[m]);
    fprintf(stderr, ", got \"%s\"\n", text);
    return false;
}

/** Lines of face and its values, empty where it has none. */
static bool write_lines(FILE *file, const qm_mesh *mesh, int first, int last)
{
    static double values[QM_METRIC_COUNT][BLOCK];
    size_t count = qm_metric_face_count(mesh), place[QM_METRIC_COUNT] = {0};
    fputs("face", file);
    for (int m = first; m < last; m++)
        fprintf(file, ",%s", qm_metric_names[m]);
    fputs("\n", file);
    for (size_t done = 0; done < count; done += BLOCK) {
        size_t rows = count - done < BLOCK ? count - done : BLOCK;
        for (int m = first; m < last; m++)
            qm_metric_measure(mesh, (qm_metric)m, done, rows, &place[m], values[m]);
        for (size_t i = 0; i < rows; i++) {
            char number[QM_NUMBER_SIZE];
            fprintf(file, "%zu", done + i);
            for (int m = first; m < last; m++)
                fprintf(file, ",%s", isnan(values[m][i]) ? "" : qm_text_number(values[m][i], number));
            fputs("\n", file);
        }
    }
    return !ferror(file);
}

static bool write_per_face(const quality_options *o, const qm_mesh *mesh)
{
    bool is_output = strcmp(o->per_face, "-") == 0, is_all = o->metric == QM_METRIC_COUNT;
    FILE *file = is_output ? stdout : fopen(o->per_face, "wb");
    bool is_written =
        file && write_lines(file, mesh, is_all ? 0 : o->metric, is_all ? QM_METRIC_COUNT : o->metric + 1);
    if (file && !is_output && fclose(file) != 0) is_written = false;
    if (!is_written) cli_report_unwritable(o->per_face, o->as_json);
    return is_written;
}

static void print_line(qm_metric metric, const qm_metric_summary *s)
{
    if (s->faces > 0)
        printf("  %-15s %10.5g %10.5g %10.5g %10.5g %10.5g  %zu to %zu", qm_metric_names[metric], s->minimum,
               s->percentile[1], s->percentile[3], s->percentile[5], s->maximum, s->minimum_face,
               s->maximum_face);
    else
        printf("  %-15s %s", qm_metric_names[metric], "-");
    if (s->undefined > 0) printf("  (%zu faces have no value)", s->undefined);
    putchar('\n');
}

static qm_status print_summaries(const quality_options *o, qm_context *ctx, const qm_mesh *mesh)
{
    qm_status status = QM_OK;
    if (!o->as_json)
        puts("                     least        5 %     median       95 %   greatest  faces of least and "
             "greatest");
    for (int m = 0; m < QM_METRIC_COUNT && status == QM_OK; m++) {
        qm_metric_summary summary;
        if (o->metric != QM_METRIC_COUNT && o->metric != m) continue;
        status = qm_metric_summarize(ctx, mesh, (qm_metric)m, &summary);
        if (status == QM_OK) print_line((qm_metric)m, &summary);
    }
    return status;
}

static qm_status print_json(const quality_options *o, qm_context *ctx, const qm_mesh *mesh)
{
    qm_text text = {0};
    qm_status status;
    if (o->metric == QM_METRIC_COUNT) {
        status = qm_quality_write(ctx, mesh, &text);
    } else {
        qm_metric_summary summary;
        status = qm_metric_summarize(ctx, mesh, (qm_metric)o->metric, &summary);
        qm_text_add_string(&text, "{");
        qm_quality_add_summary(&text, (qm_metric)o->metric, &summary);
        qm_text_add_string(&text, "}");
    }
    char *document = qm_text_take(&text);
    if (status == QM_OK) puts(document ? document : "{}");
    free(document);
    return status;
}

static int run(int argc, char **argv)
{
    quality_options o = {.metric = QM_METRIC_COUNT};
    const cli_option options[] = {
        {.name = "metric",
         .value = "NAME",
         .type = CLI_CUSTOM,
         .read = read_metric,
         .target = &o.metric,
         .help = "only this metric"},
        {.name = "per-face",
         .letter = 'o',
         .value = "OUT",
         .type = CLI_TEXT,
         .target = &o.per_face,
         .help = "a line of CSV for each face, by its index in the file, from 0; - is standard output"},
        {.name = "json",
         .letter = 'j',
         .type = CLI_FLAG,
         .target = &o.as_json,
         .help = "the document of the API without values of faces, or the problem document"}};
    int status;
    if (!cli_read_options(&cmd_quality, options, sizeof options / sizeof *options, argc, argv, &o.mesh,
                          &status))
        return status;
    qm_context ctx = qm_host_context();
    const qm_preparation plain = {.has_no_tree = true, .thread_count = 1};
    qm_loaded_mesh mesh;
    if (!cli_load_mesh(&ctx, o.mesh, o.as_json, &plain, &mesh)) return EXIT_BAD_INPUT;
    bool is_done = !o.per_face || write_per_face(&o, &mesh.mesh);
    /* Standard output holds either the values of faces or the summary. */
    if (is_done && !(o.per_face && strcmp(o.per_face, "-") == 0)) {
        qm_status found =
            o.as_json ? print_json(&o, &ctx, &mesh.mesh) : print_summaries(&o, &ctx, &mesh.mesh);
        is_done = found == QM_OK;
        if (!is_done) cli_report_status(o.mesh, found, &ctx, o.as_json);
    }
    qm_loaded_mesh_reset(&ctx, &mesh);
    return is_done ? EXIT_OK : EXIT_BAD_INPUT;
}

const cli_command cmd_quality = {
    .name = "quality",
    .arguments = "FILE [options]",
    .summary = "the shape of the faces of a mesh",
    .takes = "one file",
    .path_count = 1,
    .description =
        "The shape of quads and triangles by the metrics of the Verdict library: scaled_jacobian, "
        "aspect_ratio, skew,\ntaper, warpage, edge_ratio, shape, stretch, minimum_angle, maximum_angle.\n",
    .exit_status = "Exit status: 0 done, 2 bad input or wrong usage.",
    .run = run};
