/**
 * codec_blocks.h: decodes the rows of a large text on several threads. The text is cut into blocks at line ends. A first
 * pass counts the rows of each block, which gives their indices in the mesh; then the format's decoder reads each block
 * with a builder that writes at these indices and has no capacity beyond them.
 *
 * A block that does not match its counts, and all text after it, is left to the decoder's ordinary loop, which alone
 * reports errors and their lines.
 */
#ifndef QM_CODEC_BLOCKS_H
#define QM_CODEC_BLOCKS_H

#include "codec_builder.h"
#include "codec_scan.h"

#define QM_BLOCK_SIZE ((size_t)32 << 10) /* min bytes of a block, which ends with its last line */
#define QM_BLOCKS_BATCH 64               /* max blocks that are counted before they are read */

/** The kind of the rows of a text. */
typedef enum qm_block_rows {
    QM_BLOCK_VERTICES, /* all lines are vertices */
    QM_BLOCK_FACES,    /* all lines are triangles or quads */
    QM_BLOCK_WORDS     /* lines that start with v or f and a blank; others are ignored */
} qm_block_rows;

typedef struct qm_block_reader {
    qm_block_rows rows;
    uint64_t max_lines; /* of these rows; ignored for QM_BLOCK_WORDS */

    /**
     * Reads a block, which is the whole text, into a builder whose vertex indices are those of the file, but whose face
     * indices start at 0. Called on several threads; index is below QM_BLOCKS_BATCH.
     */
    qm_status (*read)(void *user, size_t index, size_t line_count, qm_scan *text, qm_builder *builder);

    /** Called in order for each block that was added to the mesh; may be NULL. */
    void (*take)(void *user, size_t index);
    void *user;
} qm_block_reader;

/**
 * Reads as many complete blocks as possible, and leaves the text at the first row after them. Reads nothing of a short
 * text or with a single thread. QM_OK, QM_E_NO_MEMORY or QM_E_CANCELED.
 */
qm_status qm_blocks_read(qm_builder *builder, qm_scan *text, const qm_block_reader *reader);

#endif
