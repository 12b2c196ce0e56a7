/**
 * codec_xyz.c: XYZ: a point a line, three numbers set apart by blanks or commas; further columns are left out. A file with
 * decimal commas must not pass as one with comma columns, so both gaps of a line have to look alike.
 */
#include "codec_builder.h"
#include "codec_scan.h"
#include "encoder_internal.h"

/** What separates two columns. */
typedef struct column_gap {
    bool has_comma, has_blank;
} column_gap;

static qm_status read_points(qm_builder *builder, qm_scan *text)
{
    while (qm_scan_find_row(text)) {
        double position[3];
        column_gap gaps[2];
        qm_status status = qm_scan_read_number(text, position);
        for (int i = 0; status == QM_OK && i < 2; ++i) {
            const uint8_t *from = text->at;
            qm_scan_skip_blanks(text);
            gaps[i].has_comma = text->at < text->end && *text->at == ',';
            if (gaps[i].has_comma) ++text->at;
            qm_scan_skip_blanks(text);
            gaps[i].has_blank = text->at > from + gaps[i].has_comma;
            status = qm_scan_read_number(text, position + i + 1);
        }
        if (status != QM_OK) return status;
        if (gaps[0].has_comma != gaps[1].has_comma || gaps[0].has_blank != gaps[1].has_blank)
            return qm_codec_fail(text->report, QM_E_FORMAT,
                                 "columns are separated in different ways; are these decimal commas?");
        status = qm_builder_add_vertex(builder, position);
        if (status != QM_OK) return status;
        qm_scan_skip_line(text);
    }
    return QM_OK;
}

qm_status qm_codec_decode_xyz(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    qm_scan text;
    qm_status status = qm_scan_open(&text, bytes, size, builder->report);
    text.has_comma = true;
    if (status == QM_OK) status = read_points(builder, &text);
    builder->report->line = text.line;
    return status;
}

/* ---- encoding ---- */

static qm_status prepare_xyz(qm_encoder *encoder)
{
    if (encoder->mesh->face_count == 0) return QM_OK;
    return qm_context_fail(encoder->ctx, QM_E_UNSUPPORTED, "xyz holds points only, and the mesh has faces");
}

static void add_xyz_head(const qm_encoder *encoder, qm_text *out)
{
    (void)encoder, (void)out;
}

const qm_encoder_format qm_encoder_xyz = {prepare_xyz, add_xyz_head, qm_encoder_add_vertex_row, NULL, false};
