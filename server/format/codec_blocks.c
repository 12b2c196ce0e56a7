/**
 * codec_blocks.c: cuts a text into blocks, counts their lines, and decodes them on several threads.
 */
#include "codec_blocks.h"

#define WORKER_BLOCKS 4 /* min blocks of a thread: a tenth of a millisecond, what it takes to start one */

typedef struct text_block {
    const uint8_t *at, *end;
    size_t line; /* of its start */
    size_t line_count, vertex_count, face_count;
    size_t first_vertex, first_face;
    size_t repeated_count;
    bool is_read; /* and matches its counts */
} text_block;

/** A batch of blocks that are counted, and then read, in parallel. */
typedef struct block_round {
    const qm_block_reader *reader;
    const qm_builder *builder; /* of the mesh */
    size_t count;
    text_block blocks[QM_BLOCKS_BATCH];
} block_round;

/** The end of the first line that ends at or after at and is not joined to the next one by a backslash; NULL if there
 * is none. */
static const uint8_t *find_cut(const uint8_t *at, const uint8_t *end)
{
    while ((at = memchr(at, '\n', (size_t)(end - at)))) {
        const uint8_t *before = at - 1;
        if (*before == '\r') --before;
        ++at;
        if (*before != '\\') return at;
    }
    return NULL;
}

/** Cuts the next part of the text into blocks. */
static void cut_blocks(block_round *round, const qm_scan *text)
{
    const uint8_t *at = text->at;
    for (round->count = 0; round->count < QM_BLOCKS_BATCH; ++round->count) {
        const uint8_t *end = NULL;
        if ((size_t)(text->end - at) > QM_BLOCK_SIZE) end = find_cut(at + QM_BLOCK_SIZE, text->end);
        if (!end) return;
        round->blocks[round->count] = (text_block){.at = at, .end = end};
        at = end;
    }
}

/** Numbers of lines, and of lines of vertices and of faces. */
typedef struct line_counts {
    uint8_t lines, vertices, faces;
} line_counts;

#define BYTES_BATCH 128 /* their counts fit 8 bits, so that vectors hold many of them */

/** Counts in size bytes; the two after the last one are readable. */
static inline line_counts count_some(const uint8_t *at, size_t size)
{
    line_counts counts = {0};
    for (size_t i = 0; i < size; ++i) {
        const uint8_t ends = at[i] == '\n', starts = ends & (at[i + 2] == ' ');
        counts.lines = (uint8_t)(counts.lines + ends);
        counts.vertices = (uint8_t)(counts.vertices + (starts & (at[i + 1] == 'v')));
        counts.faces = (uint8_t)(counts.faces + (starts & (at[i + 1] == 'f')));
    }
    return counts;
}

static void count_block(void *data, int worker, size_t index)
{
    block_round *round = data;
    text_block *block = &round->blocks[index];
    (void)worker;
    /* The last two bytes cannot start a line, and the first line has no line end before it. */
    const uint8_t *at = block->at, *end = block->end - 2;
    const bool has_word = end - at > 0 && at[1] == ' ';
    block->vertex_count = has_word && at[0] == 'v';
    block->face_count = has_word && at[0] == 'f';
    block->line_count = 1 + (*end == '\n');
    for (size_t size; at < end; at += size) {
        line_counts counts;
        size = (size_t)(end - at);
        if (size >= BYTES_BATCH) {
            size = BYTES_BATCH;
            counts = count_some(at, BYTES_BATCH);
        } else {
            counts = count_some(at, size);
        }
        block->line_count += counts.lines;
        block->vertex_count += counts.vertices;
        block->face_count += counts.faces;
    }
    if (round->reader->rows == QM_BLOCK_WORDS) return;
    block->vertex_count = round->reader->rows == QM_BLOCK_VERTICES ? block->line_count : 0;
    block->face_count = round->reader->rows == QM_BLOCK_FACES ? block->line_count : 0;
}

/** Assigns indices in the mesh to the blocks, and drops those beyond its limits. */
static void place_blocks(block_round *round, size_t line, uint64_t max_lines)
{
    const qm_builder *builder = round->builder;
    size_t vertex = builder->vertex_count, face = builder->face_count;
    uint64_t lines = 0;
    for (size_t i = 0; i < round->count; ++i) {
        text_block *block = &round->blocks[i];
        lines += block->line_count;
        bool has_room = block->vertex_count <= builder->limits->max_vertices - vertex &&
                        block->face_count <= builder->limits->max_faces - face;
        if (!has_room || (round->reader->rows != QM_BLOCK_WORDS && lines > max_lines)) {
            round->count = i;
            return;
        }
        block->line = line;
        block->first_vertex = vertex;
        block->first_face = face;
        line += block->line_count;
        vertex += block->vertex_count;
        face += block->face_count;
    }
}

/** The builder of a block writes at the block's indices in the arrays of the mesh. Its limits are the block's counts, so
 * that it never grows them. */
static void read_block(void *data, int worker, size_t index)
{
    block_round *round = data;
    text_block *block = &round->blocks[index];
    const qm_codec_limits limits = {.max_vertices = block->first_vertex + block->vertex_count,
                                    .max_faces = block->face_count};
    (void)worker;
    qm_context ctx = *round->builder->ctx;
    qm_codec_report report;
    report.detail[0] = 0;
    report.warning_count = 0;
    qm_builder builder = {.ctx = &ctx,
                          .limits = &limits,
                          .report = &report,
                          .positions = round->builder->positions,
                          .vertex_count = block->first_vertex,
                          .vertex_capacity = limits.max_vertices,
                          .faces =
                              block->face_count > 0 ? round->builder->faces + 4 * block->first_face : NULL,
                          .face_capacity = limits.max_faces};
    qm_scan text = {.at = block->at, .end = block->end, .line = block->line, .report = &report};
    const qm_block_reader *reader = round->reader;
    qm_status status = reader->read(reader->user, index, block->line_count, &text, &builder);
    block->repeated_count = builder.repeated_count;
    block->is_read = status == QM_OK && text.at == block->end &&
                     text.line == block->line + block->line_count &&
                     builder.vertex_count == limits.max_vertices && builder.face_count == limits.max_faces &&
                     !builder.face_origin && !builder.normals && report.warning_count == 0;
    QM_ASSERT(builder.vertex_count <= limits.max_vertices && builder.face_count <= limits.max_faces);
    builder.positions = NULL;
    builder.faces = NULL;
    qm_builder_free(&builder);
}

/** Adds the blocks before the first one that does not match its counts. */
static void take_blocks(const block_round *round, qm_builder *builder, qm_scan *text)
{
    for (size_t i = 0; i < round->count && round->blocks[i].is_read; ++i) {
        const text_block *block = &round->blocks[i];
        builder->vertex_count += block->vertex_count;
        builder->face_count += block->face_count;
        builder->input_face_count += block->face_count;
        builder->repeated_count += block->repeated_count;
        text->at = block->end;
        text->line += block->line_count;
        if (round->reader->take) round->reader->take(round->reader->user, i);
    }
}

/** Reads a batch; *goes_on is false if the ordinary loop must read the remainder. */
static qm_status read_round(block_round *round, qm_builder *builder, qm_scan *text, uint64_t max_lines,
                            bool *goes_on)
{
    *goes_on = false;
    cut_blocks(round, text);
    const int max_workers = (int)(round->count / WORKER_BLOCKS), threads = builder->limits->thread_count;
    const int workers = threads < max_workers ? threads : max_workers;
    if (workers < 2) return QM_OK;
    qm_context_parallel_for(builder->ctx, workers, round->count, count_block, round);
    place_blocks(round, text->line, max_lines);
    if (round->count == 0) return QM_OK;
    const text_block *last = &round->blocks[round->count - 1];
    size_t vertices = last->first_vertex + last->vertex_count - builder->vertex_count;
    size_t faces = last->first_face + last->face_count - builder->face_count;
    qm_status status = qm_builder_reserve_vertices(builder, vertices);
    if (status == QM_OK) status = qm_builder_reserve_faces(builder, faces);
    if (status != QM_OK) return status;
    qm_context_parallel_for(builder->ctx, workers, round->count, read_block, round);
    take_blocks(round, builder, text);
    *goes_on = text->at == round->blocks[round->count - 1].end;
    return qm_context_canceled(builder->ctx) ? QM_E_CANCELED : QM_OK;
}

qm_status qm_blocks_read(qm_builder *builder, qm_scan *text, const qm_block_reader *reader)
{
    block_round round = {.reader = reader, .builder = builder};
    const size_t first_line = text->line;
    qm_status status = QM_OK;
    /* After a polygon the index of a face is not the number of rows before it. */
    bool goes_on = builder->limits->thread_count > 1 && !builder->face_origin && !builder->only_counts;
    while (status == QM_OK && goes_on)
        status = read_round(&round, builder, text, reader->max_lines - (text->line - first_line), &goes_on);
    return status;
}
