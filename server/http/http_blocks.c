/**
 * http_blocks.c: replies that are made while they are sent, a block at a time.
 *
 * The first block is made by the handler's thread; often it is all there is. For the others the connection is
 * suspended while they are made on the long pool, and then resumed. The next block is made when the last one
 * was sent: a slow client costs one block of memory, and a closed connection is noticed at the next write.
 * While a block is made no other thread touches the reply, as the library ends no suspended connection.
 */
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "http_internal.h"

#define PIECE_SIZE 65536 /* bytes that the library asks for at a time */

typedef struct block_reply {
    qm_app *app;
    struct MHD_Connection *connection;
    qm_block_source source;
    qm_text block;
    size_t sent; /* of block */
    qm_block state;
} block_reply;

/** The source's next block; QM_BLOCK_FAILED also when the block is out of memory. */
static qm_block next_block(qm_block_source source, qm_text *out, qm_problem *problem)
{
    qm_block state = source.next(source.user, out, problem);
    if (!out->failed) return state;
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply");
    return QM_BLOCK_FAILED;
}

static void make_block(void *user)
{
    block_reply *reply = user;
    qm_problem problem;
    reply->state = next_block(reply->source, &reply->block, &problem);
    if (reply->state == QM_BLOCK_FAILED) qm_log(QM_LOG_ERROR, "a reply is cut: %s", problem.detail);
    MHD_resume_connection(reply->connection);
}

/** Cuts the reply when the pool is closed because the daemon stops. */
static void ask_for_block(block_reply *reply)
{
    reply->block.size = 0;
    reply->sent = 0;
    MHD_suspend_connection(reply->connection);
    if (qm_pool_submit(reply->app->long_pool, make_block, reply)) return;
    reply->state = QM_BLOCK_FAILED;
    MHD_resume_connection(reply->connection);
}

static ssize_t read_block(void *user, uint64_t position, char *buffer, size_t size)
{
    (void)position;
    block_reply *reply = user;
    size_t rest = reply->block.size - reply->sent, count = rest < size ? rest : size;
    if (reply->state == QM_BLOCK_FAILED) return MHD_CONTENT_READER_END_WITH_ERROR;
    if (rest == 0 && reply->state == QM_BLOCK_LAST) return MHD_CONTENT_READER_END_OF_STREAM;
    if (rest == 0) {
        ask_for_block(reply);
        return 0;
    }
    memcpy(buffer, reply->block.data + reply->sent, count);
    reply->sent += count;
    return (ssize_t)count;
}

static void free_blocks(void *user)
{
    block_reply *reply = user;
    reply->source.end(reply->source.user);
    qm_request_return_stream_slot(reply->app);
    qm_text_reset(&reply->block);
    free(reply);
}

/** Makes the first block, whose failure can still be the reply. */
static void reply_whole(qm_request *request, int status, const char *content_type, const qm_problem *problem,
                        qm_text *body)
{
    if (problem) {
        qm_text_reset(body);
        request->reply.header_count = 0; /* they describe the failed reply */
        qm_reply_problem(request, problem);
        return;
    }
    size_t size = body->size;
    qm_request_set_buffer(request, status, qm_text_take(body), size);
    qm_reply_header(request, "Content-Type", "%s", content_type);
}

void qm_reply_blocks(qm_request *request, int status, const char *content_type, uint64_t size,
                     qm_block_source source)
{
    qm_app *app = request->app;
    qm_text first = {0};
    qm_block state = QM_BLOCK_MORE;
    qm_problem problem;
    if (strcmp(request->method, "HEAD") != 0) state = next_block(source, &first, &problem);
    if (state != QM_BLOCK_MORE) {
        source.end(source.user);
        reply_whole(request, status, content_type, state == QM_BLOCK_FAILED ? &problem : NULL, &first);
        return;
    }
    block_reply *reply = qm_request_take_stream_slot(app) ? calloc(1, sizeof *reply) : NULL;
    if (!reply) {
        qm_text_reset(&first);
        source.end(source.user);
        qm_request_refuse_stream_slot(request);
        return;
    }
    *reply = (block_reply){
        .app = app, .connection = request->connection, .source = source, .block = first, .state = state};
    qm_request_set_reader(request, status, size == QM_SIZE_UNKNOWN ? MHD_SIZE_UNKNOWN : size, PIECE_SIZE,
                          read_block, reply, free_blocks);
    qm_reply_header(request, "Content-Type", "%s", content_type);
    qm_reply_header(request, "X-Accel-Buffering", "no");
}
