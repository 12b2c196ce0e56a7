#include "reconstruct_atlas.h"

#include <string.h>

#define NODE_SPACING 0.8 /* of that of the samples */
#define MOST_NODES 2000  /* a curve */

enum { ROW = 3 * sizeof(double) };

static double track_length(const qm_track *track)
{
    return track->arc[track->point_count - 1];
}

/** About how far the samples are from one another: patches as rectangles, shared out evenly. */
static double sample_spacing(const qm_reconstruction *r, size_t sample_count)
{
    double area = 0.0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const uint32_t *side = r->layout.patches[p].side;
        area += 0.25 * (track_length(&r->tracks[side[0]]) + track_length(&r->tracks[side[2]])) *
                (track_length(&r->tracks[side[1]]) + track_length(&r->tracks[side[3]]));
    }
    return sqrt(area / (double)sample_count);
}

static size_t curve_nodes(const qm_track *track, double spacing)
{
    if (track->chord == QM_NO_INDEX) return 0;
    double wanted = ceil(track_length(track) / spacing);
    return wanted < 1.0 ? 1 : wanted < MOST_NODES ? (size_t)wanted : MOST_NODES;
}

static void fill_nodes(const qm_reconstruction *r, double spacing, qm_atlas_nodes *out)
{
    size_t next = out->sample_count;
    for (size_t i = 0; i < r->layout.node_count; i++, next++) {
        out->fixed[next - out->sample_count] = (qm_fixed_node){.curve = QM_NO_INDEX, .corner = (uint32_t)i};
        memcpy(out->positions + 3 * next, r->layout.nodes + 3 * i, ROW);
    }
    for (size_t c = 0; c < r->layout.curve_count; c++) {
        size_t count = curve_nodes(&r->tracks[c], spacing);
        for (size_t k = 0; k < count; k++, next++) {
            qm_fixed_node *node = &out->fixed[next - out->sample_count];
            *node = (qm_fixed_node){.curve = (uint32_t)c, .t = ((double)k + 0.5) / (double)count};
            qm_track_at(&r->tracks[c], node->t, out->positions + 3 * next, &node->tangent);
        }
    }
}

qm_status qm_atlas_nodes_create(qm_context *ctx, const qm_reconstruction *r, const qm_samples *samples,
                                qm_atlas_nodes *out)
{
    double spacing = NODE_SPACING * sample_spacing(r, samples->count);
    *out = (qm_atlas_nodes){.sample_count = samples->count, .count = samples->count + r->layout.node_count};
    for (size_t c = 0; c < r->layout.curve_count; c++)
        out->count += curve_nodes(&r->tracks[c], spacing);
    out->positions = qm_context_alloc(ctx, out->count, ROW);
    out->fixed = qm_context_alloc(ctx, out->count - out->sample_count, sizeof *out->fixed);
    if (!out->positions || !out->fixed) {
        qm_atlas_nodes_reset(ctx, out);
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for nodes on the curves");
    }
    memcpy(out->positions, samples->positions, samples->count * ROW);
    fill_nodes(r, spacing, out);
    return QM_OK;
}

void qm_atlas_nodes_reset(qm_context *ctx, qm_atlas_nodes *nodes)
{
    qm_context_free(ctx, nodes->positions, nodes->count, ROW);
    qm_context_free(ctx, nodes->fixed, nodes->count - nodes->sample_count, sizeof *nodes->fixed);
    *nodes = (qm_atlas_nodes){0};
}

/** The same patch the other way round, from the same first corner. */
static void turn_patch(qm_layout_patch *patch)
{
    qm_layout_patch old = *patch;
    for (int k = 0; k < 4; k++) {
        patch->side[k] = old.side[3 - k];
        patch->against[k] = !old.against[3 - k];
    }
}

/** Up to two patches that each curve bounds. */
typedef struct curve_owners {
    size_t count;
    uint32_t patch[2];
} curve_owners;

/** Turns the neighbours of a patch that go along a shared curve in the same way, and queues them. */
static size_t join_neighbours(qm_reconstruction *r, const curve_owners *owners, uint32_t p, uint32_t part,
                              bool *is_joined, uint32_t *queue, size_t queued)
{
    qm_layout_patch *patches = r->layout.patches;
    for (int k = 0; k < 4; k++) {
        const curve_owners *shared = &owners[patches[p].side[k]];
        for (size_t s = 0; s < shared->count; s++) {
            uint32_t other = shared->patch[s];
            if (is_joined[other]) continue;
            for (int m = 0; m < 4; m++) {
                if (patches[other].side[m] != patches[p].side[k]) continue;
                if (patches[other].against[m] == patches[p].against[k]) turn_patch(&patches[other]);
                break;
            }
            is_joined[other] = true;
            r->grids[other].part = part;
            queue[queued++] = other;
        }
    }
    return queued;
}

static void join_all(qm_reconstruction *r, curve_owners *owners, bool *is_joined, uint32_t *queue)
{
    size_t patches = r->layout.patch_count;
    for (size_t p = 0; p < patches; p++)
        for (int k = 0; k < 4; k++) {
            curve_owners *of = &owners[r->layout.patches[p].side[k]];
            if (of->count < 2) of->patch[of->count++] = (uint32_t)p;
        }
    uint32_t part = 0;
    for (size_t start = 0; start < patches; start++) {
        if (is_joined[start]) continue;
        size_t queued = 0;
        is_joined[start] = true;
        r->grids[start].part = part;
        queue[queued++] = (uint32_t)start;
        for (size_t next = 0; next < queued; next++)
            queued = join_neighbours(r, owners, queue[next], part, is_joined, queue, queued);
        part++;
    }
}

qm_status qm_atlas_join_patches(qm_context *ctx, qm_reconstruction *r)
{
    size_t patches = r->layout.patch_count, curves = r->layout.curve_count;
    curve_owners *owners = qm_context_alloc(ctx, curves, sizeof *owners);
    bool *is_joined = qm_context_alloc(ctx, patches, sizeof *is_joined);
    uint32_t *queue = qm_context_alloc(ctx, patches, sizeof *queue);
    bool has_memory = owners && is_joined && queue;
    if (has_memory) {
        memset(owners, 0, curves * sizeof *owners);
        memset(is_joined, 0, patches * sizeof *is_joined);
        join_all(r, owners, is_joined, queue);
    }
    qm_context_free(ctx, owners, curves, sizeof *owners);
    qm_context_free(ctx, is_joined, patches, sizeof *is_joined);
    qm_context_free(ctx, queue, patches, sizeof *queue);
    return has_memory ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
}

/** Twice the area of the outline of a patch as a vector, whose direction is about the patch's normal. */
static qm_vec outline_area(const qm_reconstruction *r, const qm_layout_patch *patch)
{
    qm_vec area = {0, 0, 0}, origin = qm_vec_load(r->tracks[patch->side[0]].points);
    for (int k = 0; k < 4; k++) {
        const qm_track *track = &r->tracks[patch->side[k]];
        double sign = patch->against[k] ? -1.0 : 1.0;
        for (size_t i = 1; i < track->point_count; i++) {
            qm_vec a = qm_vec_sub(qm_vec_load(track->points + 3 * i - 3), origin);
            qm_vec b = qm_vec_sub(qm_vec_load(track->points + 3 * i), origin);
            area = qm_vec_axpy(area, sign, qm_vec_cross(a, b));
        }
    }
    return area;
}

/** How much the patches of a part turn about the surface's normals, which are summed up along their
 * curves. */
static double part_turn(const qm_reconstruction *r, uint32_t part, const qm_vec *curve_normal)
{
    double turn = 0.0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const qm_layout_patch *patch = &r->layout.patches[p];
        if (r->grids[p].part != part) continue;
        qm_vec normal = {0, 0, 0};
        for (int k = 0; k < 4; k++)
            normal = qm_vec_add(normal, curve_normal[patch->side[k]]);
        turn += qm_vec_dot(outline_area(r, patch), normal);
    }
    return turn;
}

qm_status qm_atlas_turn_patches(qm_context *ctx, qm_reconstruction *r, const qm_atlas_nodes *nodes,
                                const qm_surface_graph *graph)
{
    size_t curves = r->layout.curve_count;
    qm_vec *curve_normal = qm_context_alloc(ctx, curves, sizeof *curve_normal);
    if (!curve_normal) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
    memset(curve_normal, 0, curves * sizeof *curve_normal);
    for (size_t i = nodes->sample_count; i < nodes->count; i++) {
        uint32_t curve = nodes->fixed[i - nodes->sample_count].curve;
        if (curve != QM_NO_INDEX) curve_normal[curve] = qm_vec_add(curve_normal[curve], graph->normal[i]);
    }
    uint32_t parts = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        if (r->grids[p].part >= parts) parts = r->grids[p].part + 1;
    for (uint32_t part = 0; part < parts; part++) {
        if (part_turn(r, part, curve_normal) >= 0.0) continue;
        for (size_t p = 0; p < r->layout.patch_count; p++)
            if (r->grids[p].part == part) turn_patch(&r->layout.patches[p]);
    }
    qm_context_free(ctx, curve_normal, curves, sizeof *curve_normal);
    return QM_OK;
}
