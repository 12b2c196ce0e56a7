/**
 * check_report.c: what machines read of checks: JUnit, the commands of GitHub's workflows, JSON.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "check.h"

cli_outcome cli_count_outcomes(const qm_check_list *list, const cli_verdict *verdicts, size_t count[4])
{
    cli_outcome all = CLI_WITHIN;
    memset(count, 0, 4 * sizeof *count);
    for (size_t i = 0; i < list->count; i++) {
        count[verdicts[i].outcome]++;
        if (verdicts[i].outcome > all) all = verdicts[i].outcome;
    }
    return all;
}

/* ---- JUnit ---- */

/** Adds text to XML: what XML has no characters for becomes U+FFFD. */
static void add_xml(qm_text *out, const char *text)
{
    for (size_t size = strlen(text); size > 0;) {
        size_t length = qm_text_utf8_length(text, size);
        const char *special = strchr("&<>\"", *text);
        bool is_control = (unsigned char)*text < 0x20 || *text == 0x7f;
        /* U+FFFE and U+FFFF are no characters of XML. */
        bool is_none = length == 3 && memcmp(text, "\xef\xbf", 2) == 0 && (unsigned char)text[2] >= 0xbe;
        if (length == 0 || is_control || is_none)
            qm_text_add_string(out, *text == '\n' || *text == '\t' ? " " : "\xef\xbf\xbd");
        else if (special)
            qm_text_printf(out, "&#%d;", *special);
        else
            qm_text_add(out, text, length);
        if (length == 0) length = 1;
        text += length;
        size -= length;
    }
}

static void add_case(qm_text *out, const qm_check *check, const cli_verdict *verdict)
{
    qm_text_add_string(out, "    <testcase classname=\"quadmesh.check\" name=\"");
    add_xml(out, check->name);
    qm_text_printf(out, "\" time=\"%.3f\"", verdict->elapsed_ms / 1e3);
    if (verdict->outcome == CLI_WITHIN) {
        qm_text_add_string(out, "/>\n");
        return;
    }
    const char *element = verdict->outcome == CLI_TROUBLE ? "error" : "failure";
    qm_text_printf(out, ">\n      <%s type=\"%s\" message=\"", element, cli_outcome_names[verdict->outcome]);
    add_xml(out, verdict->detail);
    qm_text_add_string(out, "\">");
    for (int i = 0; i < 2; i++) {
        qm_text_add_string(out, i == 0 ? "new: " : "golden: ");
        add_xml(out, check->path[i] ? check->path[i] : "none");
        qm_text_add_string(out, "\n");
    }
    add_xml(out, verdict->detail);
    qm_text_printf(out, "</%s>\n    </testcase>\n", element);
}

bool cli_write_junit(const char *path, const qm_check_list *list, const cli_verdict *verdicts)
{
    size_t count[4];
    double elapsed_ms = 0.0;
    cli_count_outcomes(list, verdicts, count);
    for (size_t i = 0; i < list->count; i++)
        elapsed_ms += verdicts[i].elapsed_ms;
    qm_text text = {0};
    qm_text_add_string(&text, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    static const char *const elements[] = {"<testsuites", "  <testsuite"};
    for (int i = 0; i < 2; i++)
        qm_text_printf(
            &text,
            "%s name=\"quadmesh check\" tests=\"%zu\" failures=\"%zu\" errors=\"%zu\" time=\"%.3f\">\n",
            elements[i], list->count, count[CLI_BEYOND] + count[CLI_UNDECIDED], count[CLI_TROUBLE],
            elapsed_ms / 1e3);
    for (size_t i = 0; i < list->count; i++)
        add_case(&text, &list->checks[i], &verdicts[i]);
    qm_text_add_string(&text, "  </testsuite>\n</testsuites>\n");
    size_t size = text.size;
    char *document = qm_text_take(&text);
    FILE *file = document ? (strcmp(path, "-") == 0 ? stdout : fopen(path, "wb")) : NULL;
    bool is_written = file && fwrite(document, 1, size, file) == size;
    if (file && file != stdout) is_written &= fclose(file) == 0;
    free(document);
    return is_written;
}

/* ---- GitHub ---- */

/** Prints text of a workflow command; that of a property also without commas and colons. */
static void print_escaped(FILE *file, const char *text, bool is_property)
{
    for (; *text; text++) {
        bool is_special = strchr("%\r\n", *text) || (is_property && strchr(",:", *text));
        if (is_special)
            fprintf(file, "%%%02X", (unsigned char)*text);
        else
            fputc(*text, file);
    }
}

void cli_print_github(FILE *file, const qm_check_list *list, const cli_verdict *verdicts)
{
    for (size_t i = 0; i < list->count; i++) {
        if (verdicts[i].outcome == CLI_WITHIN) continue;
        const qm_check *check = &list->checks[i];
        fputs("::error file=", file);
        print_escaped(file, check->path[0] ? check->path[0] : check->path[1], true);
        fputs(",title=", file);
        print_escaped(file, check->name, true);
        fprintf(file, " is %s", verdicts[i].outcome == CLI_TROUBLE ? "in " : "");
        fprintf(file, "%s::", cli_outcome_names[verdicts[i].outcome]);
        print_escaped(file, verdicts[i].detail, false);
        fputc('\n', file);
    }
}

/* ---- JSON ---- */

static void add_interval(qm_text *out, const char *name, qm_interval interval)
{
    if (isnan(interval.upper)) return;
    qm_json_open(out, name, "{");
    qm_json_add_number(out, "lower", interval.lower);
    qm_json_add_number(out, "upper", interval.upper);
    qm_text_add_string(out, "}");
}

static void add_check(qm_text *out, const qm_check *check, const cli_verdict *verdict)
{
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    qm_json_add_string(out, "name", check->name);
    if (check->path[0]) qm_json_add_string(out, "new", check->path[0]);
    if (check->path[1]) qm_json_add_string(out, "golden", check->path[1]);
    qm_json_add_string(out, "outcome", cli_outcome_names[verdict->outcome]);
    qm_json_add_string(out, "detail", verdict->detail);
    if (!isnan(check->rule.limit)) {
        qm_json_add_number(out, "limit", check->rule.limit);
        qm_json_add_number(out, "percent", check->rule.percent);
        qm_json_add_string(out, "direction", qm_direction_names[check->rule.direction]);
    }
    if (!isnan(check->rule.limit_in)) qm_json_add_number(out, "limit_in", check->rule.limit_in);
    if (!isnan(check->rule.limit_out)) qm_json_add_number(out, "limit_out", check->rule.limit_out);
    add_interval(out, "inside", verdict->inside);
    add_interval(out, "outside", verdict->outside);
    qm_json_add_string(out, "quads", qm_quads_names[check->rule.quads]);
    add_interval(out, "hausdorff", verdict->distance);
    add_interval(out, "of_true", verdict->of_true);
    add_interval(out, "share_of_new", verdict->share[0]);
    add_interval(out, "share_of_golden", verdict->share[1]);
    if (verdict->collides >= 0) qm_json_add_bool(out, "collides", verdict->collides == 1);
    if (verdict->self_collides >= 0) qm_json_add_bool(out, "self_collides", verdict->self_collides == 1);
    qm_json_add_ms(out, "elapsed_ms", verdict->elapsed_ms);
    qm_text_add_string(out, "}");
}

void cli_print_checks(const qm_check_list *list, const cli_verdict *verdicts)
{
    size_t count[4];
    qm_text text = {0};
    cli_outcome all = cli_count_outcomes(list, verdicts, count);
    qm_text_add_string(&text, "{");
    qm_json_add_string(&text, "outcome", cli_outcome_names[all]);
    qm_json_open(&text, "counts", "{");
    for (int i = 0; i < 4; i++)
        qm_json_add_count(&text, cli_outcome_names[i], count[i]);
    qm_text_add_string(&text, "}");
    qm_json_open(&text, "checks", "[");
    for (size_t i = 0; i < list->count; i++)
        add_check(&text, &list->checks[i], &verdicts[i]);
    qm_text_add_string(&text, "]}");
    char *document = qm_text_take(&text);
    puts(document ? document : "{}");
    free(document);
}
