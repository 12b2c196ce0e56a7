/*
 * libFuzzer target over the JSON requests: the first byte is a letter that names the reader, the rest is the
 * body. What is refused is refused with words and leaves nothing behind; what is taken can be given back.
 */
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "job/json_in.h"
#include "ops/json_checks.h"
#include "ops/json_layout.h"

static const char *text;
static size_t text_size;

static void check(bool taken, const qm_problem *problem)
{
    if (!taken && (!problem->detail[0] || qm_problem_status(problem->code) < 400)) abort();
}

static void read_job(void)
{
    qm_job_request request;
    qm_problem problem = {0};
    bool taken = qm_json_read_job(text, text_size, &request, &problem);
    check(taken, &problem);
    if (taken) qm_job_request_reset(&request);
}

static void read_batch_line(void)
{
    qm_job_request request;
    qm_problem problem = {0};
    qm_text key = {0};
    bool taken = qm_json_read_batch_line(text, text_size, &key, &request, &problem);
    check(taken, &problem);
    qm_json *parsed = key.data ? qm_json_parse(key.data) : NULL;
    if (!parsed) abort(); /* the key is repeated in the answer: it is JSON */
    qm_json_free(parsed);
    qm_text_reset(&key);
    if (taken) qm_job_request_reset(&request);
}

static void read_moved_vertices(void)
{
    qm_moved_vertices moved;
    qm_problem problem = {0};
    bool taken = qm_json_read_moved_vertices(text, text_size, &moved, &problem);
    check(taken, &problem);
    if (taken) qm_json_reset_moved_vertices(&moved);
}

static void read_copy(void)
{
    qm_moved_copy copy;
    qm_problem problem = {0};
    check(qm_json_read_copy(text, text_size, &copy, &problem), &problem);
    free(copy.name);
}

static void read_layout(void)
{
    qm_context ctx = qm_context_make();
    char mesh[QM_ID_SIZE];
    qm_layout_features_options features;
    qm_layout layout;
    bool has_patches;
    qm_problem problem = {0};
    qm_json_quad_layout of_quads;
    check(qm_json_read_quad_layout(text, text_size, &of_quads, &problem), &problem);
    problem = (qm_problem){0};
    bool taken = qm_json_read_layout(&ctx, text, text_size, mesh, &features, &layout, &has_patches, &problem);
    check(taken, &problem);
    if (!taken) return;
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_add_layout(&out, &layout);
    qm_text_add_string(&out, "}");
    qm_layout again;
    if (!qm_json_read_layout(&ctx, out.data, out.size, NULL, NULL, &again, &has_patches, &problem)) abort();
    qm_layout_reset(&ctx, &again);
    qm_text_reset(&out);
    qm_layout_reset(&ctx, &layout);
}

static void read_edit(qm_layout_edit_kind kind)
{
    qm_layout_edit edit;
    qm_problem problem = {0};
    bool taken = qm_json_read_layout_edit(text, text_size, kind, &edit, &problem);
    check(taken, &problem);
    if (taken) qm_layout_edit_reset(&edit);
}

static void read_reconstruction(void)
{
    qm_json_reconstruction out;
    qm_problem problem = {0};
    check(qm_json_read_reconstruction(text, text_size, &out, &problem), &problem);
    check(qm_json_read_layout_choice(text, text_size, &out, &problem), &problem);
}

static void read_manifest(void)
{
    const qm_check_rule rule = qm_check_rule_default();
    qm_check_list list = {0};
    qm_problem problem = {0};
    check(qm_checks_read(text, text_size, "folder/", &rule, &list, &problem), &problem);
    qm_check_list_reset(&list);
}

static void read_as(char letter)
{
    static const char edits[] = "spnrgihxyzqfae"; /* in the order of qm_layout_edit_kind */
    const char *edit = strchr(edits, letter);
    if (letter == 'j')
        read_job();
    else if (letter == 'b')
        read_batch_line();
    else if (letter == 'm')
        read_moved_vertices();
    else if (letter == 'k')
        read_copy();
    else if (letter == 'l')
        read_layout();
    else if (letter == 'c')
        read_reconstruction();
    else if (letter == 'k')
        read_manifest();
    else if (letter && edit)
        read_edit((qm_layout_edit_kind)(edit - edits));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0) return 0;
    /* Bodies have a zero after their end. */
    char *body = malloc(size);
    if (!body) return 0;
    memcpy(body, data + 1, size - 1);
    body[size - 1] = '\0';
    text = body;
    text_size = size - 1;
    read_as((char)data[0]);
    free(body);
    return 0;
}
