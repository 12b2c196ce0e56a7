/**
 * store_postgres_query.c: parameters of statements, and rows that they return.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "store_postgres.h"

/* ---- parameters ---- */

static int add(qm_postgres_query *query, const char *value)
{
    QM_ASSERT(query->count < QM_POSTGRES_PARAMETERS);
    if (query->count >= QM_POSTGRES_PARAMETERS) abort();
    query->values[query->count] = value;
    return query->count++;
}

void qm_postgres_add_text(qm_postgres_query *query, const char *text)
{
    add(query, text);
}

void qm_postgres_add_integer(qm_postgres_query *query, int64_t number)
{
    char *text = query->numbers[query->count];
    snprintf(text, QM_NUMBER_SIZE, "%" PRId64, number);
    add(query, text);
}

void qm_postgres_add_real(qm_postgres_query *query, double number)
{
    char *text = query->numbers[query->count];
    if (isfinite(number))
        qm_text_number(number, text);
    else
        snprintf(text, QM_NUMBER_SIZE, "%s", isnan(number) ? "NaN" : number > 0.0 ? "Infinity" : "-Infinity");
    add(query, text);
}

void qm_postgres_add_bool(qm_postgres_query *query, bool value)
{
    add(query, value ? "true" : "false");
}

void qm_postgres_add_bytes(qm_postgres_query *query, const void *bytes, size_t size)
{
    QM_ASSERT(size <= INT32_MAX);
    int index = add(query, size > 0 ? bytes : "");
    query->sizes[index] = (int)size;
    query->formats[index] = 1;
}

void qm_postgres_add_now(qm_postgres_query *query)
{
    char *text = query->numbers[query->count];
    _Static_assert(QM_TIME_SIZE <= QM_NUMBER_SIZE, "a time fits");
    qm_clock_format_steady(0.0, text);
    add(query, text);
}

void qm_postgres_add_repeated(qm_postgres_query *query)
{
    query->repeated_parameter = add(query, "false");
}

void qm_postgres_write_text(qm_text *array, const char *text)
{
    qm_text_add_string(array, array->size > 0 ? "," : "{");
    if (!text) {
        qm_text_add_string(array, "NULL");
        return;
    }
    qm_text_add_string(array, "\"");
    for (size_t length; *text; text += length) {
        length = strcspn(text, "\"\\");
        qm_text_add(array, text, length);
        if (!text[length]) break;
        qm_text_add_string(array, "\\");
        qm_text_add(array, text + length++, 1);
    }
    qm_text_add_string(array, "\"");
}

void qm_postgres_write_subjects(qm_text *array, const char *subjects)
{
    char subject[QM_ID_SIZE];
    while (qm_store_next_subject(&subjects, subject))
        qm_postgres_write_text(array, subject);
}

void qm_postgres_write_integer(qm_text *array, int64_t number)
{
    qm_text_printf(array, "%c%" PRId64, array->size > 0 ? ',' : '{', number);
}

void qm_postgres_add_array(qm_postgres_query *query, qm_text *array)
{
    if (array->size > 0) qm_text_add_string(array, "}");
    query->failed = query->failed || array->failed;
    add(query, array->size > 0 ? array->data : "{}");
}

/* ---- rows ---- */

void qm_postgres_free(qm_postgres_rows *rows)
{
    if (rows->result) qm_pq.clear(rows->result);
    *rows = (qm_postgres_rows){0};
}

const char *qm_postgres_text(const qm_postgres_rows *rows, int row, int column)
{
    QM_ASSERT(row < rows->count);
    return qm_pq.getisnull(rows->result, row, column) ? NULL : qm_pq.getvalue(rows->result, row, column);
}

int64_t qm_postgres_integer(const qm_postgres_rows *rows, int row, int column)
{
    const char *text = qm_postgres_text(rows, row, column);
    return text ? strtoll(text, NULL, 10) : 0;
}

double qm_postgres_real(const qm_postgres_rows *rows, int row, int column)
{
    const char *text = qm_postgres_text(rows, row, column);
    return text ? strtod(text, NULL) : 0.0;
}

bool qm_postgres_bool(const qm_postgres_rows *rows, int row, int column)
{
    const char *text = qm_postgres_text(rows, row, column);
    return text && text[0] == 't';
}

size_t qm_postgres_size(const qm_postgres_rows *rows, int row, int column)
{
    return (size_t)qm_pq.getlength(rows->result, row, column);
}

bool qm_postgres_copy(const qm_postgres_rows *rows, int row, int column, char **out)
{
    const char *text = qm_postgres_text(rows, row, column);
    *out = text ? strdup(text) : NULL;
    return *out || !text;
}

void qm_postgres_read(const qm_postgres_rows *rows, int row, int column, char *out, size_t size)
{
    const char *text = qm_postgres_text(rows, row, column);
    snprintf(out, size, "%s", text ? text : "");
}

qm_stored qm_postgres_find_row(qm_store *store, qm_postgres_query *query, const qm_postgres_table *table,
                               void *out)
{
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, query, &rows);
    if (status == QM_STORED && rows.count == 0) status = QM_STORED_NONE;
    if (status == QM_STORED && !table->read(&rows, 0, out)) status = QM_STORED_NO_MEMORY;
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_find_row_by(qm_store *store, const char *sql, const char *text,
                                  const qm_postgres_table *table, void *out)
{
    qm_postgres_query query = {.sql = sql};
    qm_postgres_add_text(&query, text);
    return qm_postgres_find_row(store, &query, table, out);
}

/** The statement for a page; NULL: out of memory. Its numbers are no parameters, as its plan depends on them. */
static char *print_page(const qm_postgres_listing *listing, const qm_store_page *page)
{
    qm_text sql = {0};
    int index = 1;
    /* From the last one down, when no row came before. */
    int64_t after = page->newest_first && page->after == 0 ? INT64_MAX : page->after;
    qm_text_printf(&sql, "%s WHERE %s %c %" PRId64, listing->select, listing->sequence,
                   page->newest_first ? '<' : '>', after);
    for (int i = 0; i < QM_POSTGRES_CONDITIONS; i++) {
        if (!listing->values[i]) continue;
        const char *condition = listing->conditions[i], *rest = strchr(condition, '$') + 1;
        qm_text_printf(&sql, " AND %.*s%d::text%s", (int)(rest - condition), condition, index++, rest);
    }
    if (listing->condition) qm_text_printf(&sql, " AND %s", listing->condition);
    qm_text_printf(&sql, " ORDER BY %s %s LIMIT %zu", listing->sequence, page->newest_first ? "DESC" : "ASC",
                   page->limit);
    return qm_text_take(&sql);
}

qm_stored qm_postgres_list_rows(qm_store *store, const qm_postgres_listing *listing,
                                const qm_store_page *page, const qm_postgres_table *table, void *out,
                                size_t *count)
{
    *count = 0;
    char *sql = print_page(listing, page);
    if (!sql) return QM_STORED_NO_MEMORY;
    qm_postgres_query query = {.sql = sql, .is_made = true};
    for (int i = 0; i < QM_POSTGRES_CONDITIONS; i++)
        if (listing->values[i]) qm_postgres_add_text(&query, listing->values[i]);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    for (int i = 0; status == QM_STORED && i < rows.count; i++) {
        if (table->read(&rows, i, (char *)out + *count * table->size))
            ++*count;
        else
            status = QM_STORED_NO_MEMORY;
    }
    while (status != QM_STORED && *count > 0)
        table->reset((char *)out + --*count * table->size);
    qm_postgres_free(&rows);
    free(sql);
    return status;
}

qm_stored qm_postgres_change_row(qm_store *store, qm_postgres_query *query)
{
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, query, &rows);
    if (status == QM_STORED && rows.count == 0) status = QM_STORED_NONE;
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_create_row(qm_store *store, qm_postgres_query *query, const char *find, const char *id)
{
    qm_stored status = qm_postgres_change_row(store, query);
    if (status != QM_STORED_NONE && status != QM_STORED_TAKEN) return status;
    qm_postgres_query look = {.sql = find};
    qm_postgres_add_text(&look, id);
    status = qm_postgres_change_row(store, &look);
    if (status == QM_STORED_NONE) status = QM_STORED_TAKEN;
    return status == QM_STORED || status == QM_STORED_TAKEN ? qm_postgres_confirm(store, status) : status;
}

qm_stored qm_postgres_delete_row(qm_store *store, const char *sql, const char *id)
{
    qm_postgres_query query = {.sql = sql};
    qm_postgres_add_text(&query, id);
    qm_stored status = qm_postgres_change_row(store, &query);
    if (status != QM_STORED_NONE) return status;
    /* The first of two attempts may have found it. */
    return qm_postgres_confirm(store, query.is_repeated ? QM_STORED : QM_STORED_NONE);
}

static bool read_record(const qm_postgres_rows *rows, int row, void *out)
{
    qm_store_idempotency_record *record = out;
    qm_postgres_read(rows, row, 0, record->id, sizeof record->id);
    qm_postgres_read(rows, row, 1, record->request, sizeof record->request);
    return true;
}

qm_stored qm_postgres_find_record(qm_store *store, const char *sql, const char *key,
                                  qm_store_idempotency_record *out)
{
    static const qm_postgres_table table = {sizeof(qm_store_idempotency_record), read_record, NULL};
    qm_stored status = qm_postgres_find_row_by(store, sql, key, &table, out);
    return status == QM_STORED ? qm_postgres_confirm(store, status) : status;
}
