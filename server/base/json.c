/**
 * json.c: members and values of JSON documents, appended to a text; checks and parses JSON text, and finds members of
 * parsed documents.
 */
#include "json.h"

#include <cjson/cJSON.h>
#include <malloc.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "host.h"
#include "qm/base.h"

#define TREE_SHARE 4                  /* of the budget, a quarter: trees cannot push out all meshes */
#define BLOCK_HEAD 8                  /* bytes of malloc before a block */
#define LARGE_TREE ((size_t)16 << 20) /* bytes */
#define LARGE_TEXT ((size_t)1 << 20)  /* bytes */

/* ---- writing ---- */

void qm_json_add_comma(qm_text *out)
{
    QM_ASSERT(out->failed || out->size == 0 || out->data);
    if (out->size > 0 && !strchr("{[:,", out->data[out->size - 1])) qm_text_add_string(out, ",");
}

void qm_json_add_quoted(qm_text *out, const char *string)
{
    qm_text_add_string(out, "\"");
    for (size_t left = strlen(string); left > 0;) {
        size_t length = qm_text_utf8_length(string, left);
        if (length == 0)
            qm_text_add_string(out, "\xef\xbf\xbd");
        else if (*string == '"' || *string == '\\')
            qm_text_printf(out, "\\%c", *string);
        else if ((unsigned char)*string < 0x20)
            qm_text_printf(out, "\\u%04x", (unsigned)*string);
        else
            qm_text_add(out, string, length);
        string += length > 0 ? length : 1;
        left -= length > 0 ? length : 1;
    }
    qm_text_add_string(out, "\"");
}

void qm_json_add_name(qm_text *out, const char *name)
{
    qm_json_add_comma(out);
    qm_json_add_quoted(out, name);
    qm_text_add_string(out, ":");
}

void qm_json_open(qm_text *out, const char *name, const char *bracket)
{
    QM_ASSERT(bracket[0] == '{' || bracket[0] == '[');
    qm_json_add_name(out, name);
    qm_text_add_string(out, bracket);
}

void qm_json_add_string(qm_text *out, const char *name, const char *value)
{
    qm_json_add_name(out, name);
    qm_json_add_quoted(out, value);
}

void qm_json_add_word(qm_text *out, const char *name, const char *word)
{
    qm_json_add_name(out, name);
    qm_text_add_string(out, word);
}

void qm_json_add_bool(qm_text *out, const char *name, bool value)
{
    qm_json_add_word(out, name, value ? "true" : "false");
}

void qm_json_add_number(qm_text *out, const char *name, double value)
{
    char text[QM_NUMBER_SIZE];
    qm_json_add_word(out, name, qm_text_number(value, text));
}

void qm_json_add_ms(qm_text *out, const char *name, double ms)
{
    qm_json_add_number(out, name, rint(1e3 * ms) / 1e3);
}

void qm_json_add_count(qm_text *out, const char *name, uint64_t value)
{
    qm_json_add_name(out, name);
    qm_text_printf(out, "%llu", (unsigned long long)value);
}

void qm_json_add_array(qm_text *out, const double *values, int count)
{
    char text[QM_NUMBER_SIZE];
    qm_json_add_comma(out);
    qm_text_add_string(out, "[");
    for (int i = 0; i < count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, qm_text_number(values[i], text));
    }
    qm_text_add_string(out, "]");
}

void qm_json_add_numbers(qm_text *out, const char *name, const double *values, int count)
{
    qm_json_add_name(out, name);
    qm_json_add_array(out, values, count);
}

void qm_json_add_members(qm_text *out, const char *object)
{
    size_t size = strlen(object);
    QM_ASSERT(size >= 2 && object[0] == '{' && object[size - 1] == '}');
    if (size > 2) qm_json_add_comma(out);
    qm_text_add(out, object + 1, size - 2);
}

/* ---- checks before the parser sees the text ---- */

/** The offset at which nesting gets too deep, or size. Brackets inside strings do not count. */
static size_t find_deep_nesting(const char *text, size_t size)
{
    int depth = 0;
    bool in_string = false;
    for (size_t i = 0; i < size; i++) {
        char c = text[i];
        if (in_string) {
            if (c == '\\') i++;
            if (c == '"') in_string = false;
        } else if (c == '"') {
            in_string = true;
        } else if (c == '{' || c == '[') {
            if (++depth > QM_JSON_MAX_DEPTH) return i;
        } else if (c == '}' || c == ']') {
            depth--;
        }
    }
    return size;
}

/** The offset of the first byte that is not UTF-8, or size. */
static size_t find_invalid_utf8(const char *text, size_t size)
{
    for (size_t i = 0; i < size;) {
        size_t length = qm_text_utf8_length(text + i, size - i);
        if (length == 0) return i;
        i += length;
    }
    return size;
}

/** The offset of an escaped NUL, or size. */
static size_t find_escaped_nul(const char *text, size_t size)
{
    for (size_t i = 0; i + 1 < size; i++) {
        if (text[i] != '\\') continue;
        if (size - i >= 6 && memcmp(text + i, "\\u0000", 6) == 0) return i;
        i++;
    }
    return size;
}

bool qm_json_check_text(const char *text, size_t size, size_t *offset, const char **message)
{
    if ((*offset = find_invalid_utf8(text, size)) < size)
        *message = "the body is not UTF-8";
    else if ((*offset = find_deep_nesting(text, size)) < size)
        *message = "the JSON is nested too deep";
    else if ((*offset = find_escaped_nul(text, size)) < size)
        *message = "a string holds a NUL character";
    else
        return true;
    return false;
}

/* ---- parsing ---- */

/** cJSON returns NULL for bad text and for failed allocations alike; this records the latter. */
static _Thread_local bool allocation_failed;

/* A tree is many small blocks of malloc. Their sizes count, with malloc's head of each. */
static qm_budget *tree_budget;
static atomic_size_t tree_bytes, tree_peak; /* all trees; the most since there was none */

static size_t measure_block(void *block)
{
    return malloc_usable_size(block) + BLOCK_HEAD;
}

static void deallocate(void *block)
{
    if (!block) return;
    size_t size = measure_block(block);
    free(block);
    if (tree_budget) qm_host_budget_release(tree_budget, size);
    if (atomic_fetch_sub(&tree_bytes, size) != size) return;
    /* malloc keeps small blocks that were freed: after a large tree the system gets their pages back. */
    if (atomic_exchange(&tree_peak, 0) >= LARGE_TREE) malloc_trim(0);
}

static void *allocate(size_t size)
{
    void *block = malloc(size);
    if (!block) {
        allocation_failed = true;
        return NULL;
    }
    size_t counted = measure_block(block), used = atomic_fetch_add(&tree_bytes, counted) + counted;
    for (size_t peak = atomic_load(&tree_peak); used > peak;)
        if (atomic_compare_exchange_weak(&tree_peak, &peak, used)) break;
    if (!tree_budget ||
        (used <= tree_budget->limit / TREE_SHARE && qm_host_budget_reserve(tree_budget, counted)))
        return block;
    allocation_failed = true;
    atomic_fetch_sub(&tree_bytes, counted);
    free(block);
    return NULL;
}

/** The number of values of a JSON text, or somewhat less: those after a comma that is in no string. */
static size_t count_values(const char *text, size_t size)
{
    size_t count = 0;
    bool is_string = false;
    for (size_t i = 0; i < size; i++) {
        if (text[i] == '"') is_string = !is_string;
        if (is_string && text[i] == '\\') i++;
        count += !is_string && text[i] == ',';
    }
    return count;
}

/** Whether the budget has room for the tree of a text; others lose their memory for it only if it has. */
static bool make_room_for(const char *text, size_t size)
{
    if (!tree_budget || size < LARGE_TEXT) return true;
    size_t needed = count_values(text, size) * (sizeof(cJSON) + BLOCK_HEAD);
    return atomic_load(&tree_bytes) + needed <= tree_budget->limit / TREE_SHARE &&
           qm_host_budget_make_room(tree_budget, needed);
}

static void set_hooks(void)
{
    cJSON_InitHooks(&(cJSON_Hooks){allocate, deallocate});
}

void qm_json_set_budget(qm_budget *budget)
{
    QM_ASSERT(qm_json_measure() == 0);
    tree_budget = budget;
}

size_t qm_json_measure(void)
{
    return atomic_load(&tree_bytes);
}

cJSON *qm_json_parse_tree(const char *text, size_t size, const char **end, bool *no_memory)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, set_hooks);
    allocation_failed = false;
    *end = text;
    *no_memory = !make_room_for(text, size);
    if (*no_memory) return NULL;
    cJSON *tree = cJSON_ParseWithLengthOpts(text, size, end, false);
    *no_memory = !tree && allocation_failed;
    return tree;
}

/* ---- members by name ---- */

qm_json *qm_json_parse(const char *text)
{
    const char *end;
    bool no_memory;
    return (qm_json *)qm_json_parse_tree(text, strlen(text), &end, &no_memory);
}

void qm_json_free(qm_json *json)
{
    cJSON_Delete((cJSON *)json);
}

static const cJSON *find(const qm_json *json, const char *path)
{
    const cJSON *at = (const cJSON *)json;
    while (at && *path) {
        char name[64];
        size_t length = strcspn(path, ".");
        if (length >= sizeof name) return NULL;
        memcpy(name, path, length);
        name[length] = '\0';
        bool is_index = cJSON_IsArray(at) && name[0] >= '0' && name[0] <= '9';
        if (is_index) {
            at = cJSON_GetArrayItem(at, atoi(name));
        } else {
            if (cJSON_IsArray(at)) at = at->child;
            at = cJSON_GetObjectItemCaseSensitive(at, name);
        }
        path += length + (path[length] == '.');
    }
    return at;
}

double qm_json_get_number(const qm_json *json, const char *path)
{
    const cJSON *found = find(json, path);
    return cJSON_IsNumber(found) ? found->valuedouble : NAN;
}

const char *qm_json_get_string(const qm_json *json, const char *path)
{
    return cJSON_GetStringValue(find(json, path));
}

bool qm_json_is_true(const qm_json *json, const char *path)
{
    return cJSON_IsTrue(find(json, path));
}

bool qm_json_has(const qm_json *json, const char *path)
{
    const cJSON *found = find(json, path);
    return found && !cJSON_IsNull(found);
}
