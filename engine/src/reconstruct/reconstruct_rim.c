/**
 * reconstruct_rim.c: the rim of all patches together, made of the curves that one patch alone has. What lies
 * beyond it was not drawn.
 */
#include "reconstruct_work.h"

#include <string.h>

#define ON_SIDE 1e-9 /* of a quad's side: parameters that are so near to it lie on it */

enum { ROW = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the rim of the patches");
}

/** How many sides of patches each curve is. */
static uint32_t *count_uses(qm_context *ctx, const qm_layout *layout)
{
    uint32_t *uses = qm_context_alloc(ctx, layout->curve_count, sizeof *uses);
    if (!uses) return NULL;
    memset(uses, 0, layout->curve_count * sizeof *uses);
    for (size_t p = 0; p < layout->patch_count; p++)
        for (int k = 0; k < 4; k++)
            uses[layout->patches[p].side[k]]++;
    return uses;
}

qm_status qm_reconstruction_rim(qm_context *ctx, const qm_reconstruction *r, double **points, size_t *count)
{
    *points = NULL;
    *count = 0;
    uint32_t *uses = count_uses(ctx, &r->layout);
    if (!uses) return no_memory(ctx);
    size_t curves = r->layout.curve_count, done = 0;
    for (size_t c = 0; c < curves; c++)
        if (uses[c] == 1) *count += r->tracks[c].point_count;
    if (*count > 0) *points = qm_context_alloc(ctx, *count, ROW);
    for (size_t c = 0; c < curves && *points; c++) {
        if (uses[c] != 1) continue;
        memcpy(*points + 3 * done, r->tracks[c].points, r->tracks[c].point_count * ROW);
        done += r->tracks[c].point_count;
    }
    qm_context_free(ctx, uses, curves, sizeof *uses);
    return *count > 0 && !*points ? no_memory(ctx) : QM_OK;
}

/** True when a place of a patch, by a face of its own, lies on a side that one patch alone has. */
static bool is_on_rim(const qm_reconstruction *r, size_t p, const uint32_t *uses, size_t face,
                      const double uv[2])
{
    size_t columns = qm_patch_chord(r, p, 0)->edges, rows = qm_patch_chord(r, p, 1)->edges;
    size_t column = face % columns, row = face / columns;
    const bool is_on[4] = {row == 0 && uv[1] <= ON_SIDE, column + 1 == columns && uv[0] >= 1.0 - ON_SIDE,
                           row + 1 == rows && uv[1] >= 1.0 - ON_SIDE, column == 0 && uv[0] <= ON_SIDE};
    for (int k = 0; k < 4; k++)
        if (is_on[k] && uses[r->layout.patches[p].side[k]] == 1) return true;
    return false;
}

qm_status qm_reconstruction_find_rim(qm_context *ctx, const qm_reconstruction *r, const uint32_t *faces,
                                     const double *uv, size_t count, bool *on_rim)
{
    size_t patches = r->layout.patch_count;
    uint32_t *uses = count_uses(ctx, &r->layout);
    size_t *first = qm_context_alloc(ctx, patches, sizeof *first), face_count = 0;
    qm_status status = uses && first ? QM_OK : no_memory(ctx);
    for (size_t p = 0; p < patches && status == QM_OK; p++) {
        first[p] = face_count;
        face_count += (size_t)qm_patch_chord(r, p, 0)->edges * qm_patch_chord(r, p, 1)->edges;
    }
    for (size_t i = 0; i < count && status == QM_OK; i++) {
        size_t p = qm_patch_of_face(first, patches, faces[i]);
        on_rim[i] = is_on_rim(r, p, uses, faces[i] - first[p], uv + 2 * i);
    }
    qm_context_free(ctx, uses, r->layout.curve_count, sizeof *uses);
    qm_context_free(ctx, first, patches, sizeof *first);
    return status;
}
