/**
 * codec_blocks.h: the rows of a large text read by several threads. The text is cut at line ends into blocks.
 * The rows of each block are counted first, so that the mesh has room for them at the place where they
 * belong; then each block is read by the rows' own decoder, with a builder that writes there and has no more
 * room.
 *
 * A block that does not turn out as counted, for whatever reason, is left to the decoder's ordinary loop, and
 * with it all that follows: that loop alone says what is wrong with a file, and where.
 */
#ifndef QM_CODEC_BLOCKS_H
#define QM_CODEC_BLOCKS_H

#include "codec_build.h"
#include "codec_scan.h"

#define QM_BLOCK_SIZE ((size_t)32 << 10) /* bytes of text, and the rest of the last line */
#define QM_BLOCKS_TOGETHER 64            /* that are counted before the first of them is read */

/** What the rows of a text are. */
typedef enum qm_block_rows {
    QM_BLOCK_VERTICES, /* all lines are vertices */
    QM_BLOCK_FACES,    /* all lines are triangles or quads */
    QM_BLOCK_WORDS     /* lines that start with v or f and a blank are; others are something else */
} qm_block_rows;

typedef struct qm_block_reader {
    qm_block_rows rows;
    uint64_t most_lines; /* after which the text goes on with something else; of QM_BLOCK_WORDS any number */

    /**
     * Reads a block to its end, which is that of the text, into a builder that counts vertices, but not
     * faces, from the start of the file. Called on several threads at once; index is below
     * QM_BLOCKS_TOGETHER.
     */
    qm_status (*read)(void *user, size_t index, size_t line_count, qm_scan *text, qm_builder *builder);

    /** Called for each block that the mesh has taken over, in their order; NULL: nothing is to be done. */
    void (*take)(void *user, size_t index);
    void *user;
} qm_block_reader;

/**
 * Reads as many whole blocks as it can, and leaves the text at the first row that is still to be read. Reads
 * none of a short text, and none with a single thread. QM_OK, QM_E_NO_MEMORY or QM_E_CANCELED.
 */
qm_status qm_blocks_read(qm_builder *builder, qm_scan *text, const qm_block_reader *reader);

#endif
