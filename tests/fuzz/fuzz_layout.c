/*
 * libFuzzer target over drawn layouts: curves over a surface by formula, of which the input then breaks some: points far away
 * or no numbers, curves lost, drawn twice or in hundreds across each other, ends in the middle of others, ids that repeat.
 * They are read as the daemon reads them, as JSON, and reconstructed. What comes of it is a mesh, or words.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz_check.h"
#include "ops/json_layout.h"
#include "sheet.h"

#define LAYOUT_SIDE 4
#define PIECES 4
#define STEPS 3
#define STEP_QUADS 400

/* ---- the drawing ---- */

/** Adds a curve along a straight way in the parameters. */
static void draw(qm_context *ctx, qm_layout *layout, const qm_sheet_grid *grid, uint32_t from, uint32_t to,
                 const double way[4])
{
    double points[3 * (PIECES + 1)];
    for (int i = 0; i <= PIECES; i++) {
        double t = (double)i / PIECES;
        qm_sheet_at(grid, way[0] + t * (way[2] - way[0]), way[1] + t * (way[3] - way[1]), points + 3 * i);
    }
    CHECK(qm_fuzz_succeeded(ctx, qm_layout_add_curve(ctx, layout, from, to, points, PIECES + 1)));
}

static void draw_grid(qm_context *ctx, qm_layout *layout, const qm_sheet_grid *grid)
{
    static qm_sheet sheet;
    qm_sheet_make(grid, &sheet);
    double du = 1.0 / grid->columns, dv = 1.0 / grid->rows;
    for (size_t i = 0; i < sheet.mesh.vertex_count; i++)
        CHECK(qm_fuzz_succeeded(ctx, qm_layout_add_node(ctx, layout, sheet.positions + 3 * i)));
    for (int j = 0; j < grid->rows + !grid->wrap_v; j++)
        for (int i = 0; i < grid->columns; i++)
            draw(ctx, layout, grid, qm_sheet_number(grid, i, j), qm_sheet_number(grid, i + 1, j),
                 (const double[]){i * du, j * dv, (i + 1) * du, j * dv});
    for (int j = 0; j < grid->rows; j++)
        for (int i = 0; i < grid->columns + !grid->wrap_u; i++)
            draw(ctx, layout, grid, qm_sheet_number(grid, i, j), qm_sheet_number(grid, i, j + 1),
                 (const double[]){i * du, j * dv, i * du, (j + 1) * dv});
}

/* ---- what is broken ---- */

static uint32_t take_node(const qm_layout *layout, qm_bytes *bytes)
{
    return qm_bytes_take(bytes) % (uint32_t)layout->node_count;
}

static qm_curve *take_curve(const qm_layout *layout, qm_bytes *bytes)
{
    return &layout->curves[qm_bytes_take(bytes) % layout->curve_count];
}

static void add_straight(qm_context *ctx, qm_layout *layout, uint32_t from, uint32_t to)
{
    double ends[6];
    memcpy(ends, layout->nodes + 3 * (size_t)from, 3 * sizeof *ends);
    memcpy(ends + 3, layout->nodes + 3 * (size_t)to, 3 * sizeof *ends);
    CHECK(qm_fuzz_succeeded(ctx, qm_layout_add_curve(ctx, layout, from, to, ends, 2)));
}

/** Hundreds of curves between places that a sequence names. */
static void scribble(qm_context *ctx, qm_layout *layout, const qm_sheet_grid *grid, qm_bytes *bytes)
{
    uint32_t state = qm_bytes_take(bytes);
    double last[2] = {0.5, 0.5}, place[3];
    qm_sheet_at(grid, 0.5, 0.5, place);
    CHECK(qm_fuzz_succeeded(ctx, qm_layout_add_node(ctx, layout, place)));
    for (int left = 2 * qm_bytes_take(bytes); left > 0; left--) {
        double way[4] = {last[0], last[1]};
        for (int k = 2; k < 4; k++) {
            state = 1664525 * state + 1013904223;
            last[k - 2] = way[k] = (double)(state >> 16) / 65535;
        }
        qm_sheet_at(grid, way[2], way[3], place);
        uint32_t from = (uint32_t)layout->node_count - 1;
        CHECK(qm_fuzz_succeeded(ctx, qm_layout_add_node(ctx, layout, place)));
        draw(ctx, layout, grid, from, from + 1, way);
    }
}

/** A node in the middle of a curve, which goes on through it, with a curve to another node. */
static void add_junction(qm_context *ctx, qm_layout *layout, qm_bytes *bytes)
{
    const qm_curve *curve = take_curve(layout, bytes);
    double place[3];
    memcpy(place, curve->points + 3 * (curve->point_count / 2), sizeof place);
    uint32_t to = take_node(layout, bytes);
    CHECK(qm_fuzz_succeeded(ctx, qm_layout_add_node(ctx, layout, place)));
    add_straight(ctx, layout, (uint32_t)layout->node_count - 1, to);
}

static void lose_curve(qm_context *ctx, qm_layout *layout, qm_bytes *bytes)
{
    qm_curve *curve = take_curve(layout, bytes);
    if (layout->curve_count == 1) return;
    qm_layout_clear_patches(ctx, layout);
    qm_context_free(ctx, curve->points, curve->point_count, 3 * sizeof(double));
    *curve = layout->curves[layout->curve_count - 1];
    /* Arrays know their sizes: the last curve's place is given back. */
    layout->curves = qm_context_resize(ctx, layout->curves, layout->curve_count, layout->curve_count - 1,
                                       sizeof *layout->curves);
    layout->curve_count--;
}

static void break_layout(qm_context *ctx, qm_layout *layout, const qm_sheet_grid *grid, qm_bytes *bytes)
{
    for (int left = qm_bytes_take(bytes) % 16; left > 0; left--) {
        uint8_t way = qm_bytes_take(bytes) % 10;
        qm_curve *curve = take_curve(layout, bytes);
        uint32_t node = take_node(layout, bytes);
        size_t point = qm_bytes_take(bytes) % curve->point_count;
        double *nodes = layout->nodes + 3 * (size_t)node;
        if (way == 0)
            lose_curve(ctx, layout, bytes);
        else if (way == 1)
            nodes[point % 3] = qm_bytes_take_harm(bytes);
        else if (way == 2)
            curve->points[3 * point + node % 3] = qm_bytes_take_harm(bytes);
        else if (way == 3)
            add_straight(ctx, layout, node, take_node(layout, bytes));
        else if (way == 4)
            add_junction(ctx, layout, bytes);
        else if (way == 5)
            curve->id = take_curve(layout, bytes)->id;
        else if (way == 6)
            curve->mark = (qm_curve_mark)(point % QM_CURVE_MARK_COUNT);
        else if (way == 7) /* lies on another curve */
            memcpy(curve->points, take_curve(layout, bytes)->points, 6 * sizeof(double));
        else if (way == 8)
            CHECK(qm_fuzz_succeeded(ctx, qm_layout_set_corner(ctx, layout, node, true)));
        else
            scribble(ctx, layout, grid, bytes);
    }
}

/** Adds patches of any four curves that the input names; those that are not closed are refused. */
static void add_patches(qm_context *ctx, qm_layout *layout, qm_bytes *bytes)
{
    for (int left = qm_bytes_take(bytes) % 8; left > 0; left--) {
        uint32_t id[4];
        for (int k = 0; k < 4; k++)
            id[k] = take_curve(layout, bytes)->id;
        if (qm_bytes_take(bytes) % 2) id[2] = id[0];
        (void)qm_fuzz_succeeded(ctx, qm_layout_add_patch(ctx, layout, id));
    }
}

/* ---- what is made of it ---- */

/** The layout as a request has it. */
static bool read_back(qm_context *ctx, const qm_layout *drawn, qm_layout *out, bool *has_patches)
{
    qm_text text = {0};
    qm_problem problem = {0};
    qm_text_add_string(&text, "{");
    qm_json_add_layout(&text, drawn);
    qm_text_add_string(&text, "}");
    bool taken = qm_json_read_layout(ctx, text.data, text.size, NULL, NULL, out, has_patches, &problem);
    CHECK(taken || (problem.detail[0] && qm_problem_status(problem.code) >= 400));
    qm_text_reset(&text);
    return taken;
}

static void check_issues(const qm_layout *layout, const qm_layout_issues *issues)
{
    for (size_t i = 0; i < issues->count; i++) {
        char text[QM_ISSUE_TEXT];
        qm_layout_issue_text(&issues->items[i], text);
        CHECK(text[0]);
        for (int k = 0; k < 2; k++)
            CHECK(issues->items[i].curve[k] == QM_NO_INDEX ||
                  qm_layout_find_curve(layout, issues->items[i].curve[k]) != QM_NO_INDEX);
    }
}

static void check_mesh(qm_context *ctx, const qm_reconstruction *made)
{
    qm_mesh mesh;
    CHECK(qm_fuzz_succeeded(ctx, qm_reconstruction_mesh(ctx, made, &mesh)));
    CHECK(qm_fuzz_succeeded(ctx, qm_mesh_validate(ctx, &mesh)));
    qm_mesh_reset(ctx, &mesh);
}

static void reconstruct(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout)
{
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *made;
    if (!qm_fuzz_succeeded(ctx, qm_reconstruction_create(ctx, surface, layout, &options, &made))) return;
    for (int step = 0; step < STEPS; step++) {
        qm_reconstruction_record record;
        CHECK(qm_fuzz_succeeded(ctx, qm_reconstruction_step(ctx, made, STEP_QUADS, &record)));
        check_mesh(ctx, made);
        CHECK(record.quads <= STEP_QUADS || record.chords_changed == 0);
    }
    qm_reconstruction_warning warnings[8];
    (void)qm_reconstruction_find_warnings(made, warnings, 8);
    qm_reconstruction_destroy(ctx, made);
}

static void use(qm_context *ctx, const qm_ref_surface *surface, qm_layout *layout, bool has_patches)
{
    qm_layout_issues issues = {0};
    if (!has_patches || layout->patch_count == 0)
        CHECK(qm_fuzz_succeeded(ctx, qm_layout_find_patches(ctx, surface, layout, &issues)));
    check_issues(layout, &issues);
    CHECK(qm_fuzz_succeeded(ctx, qm_layout_find_crossings(ctx, layout, surface, &issues)));
    check_issues(layout, &issues);
    qm_layout_issues_reset(ctx, &issues);
    (void)qm_fuzz_succeeded(ctx, qm_layout_validate(ctx, layout, surface->diagonal, surface));
    reconstruct(ctx, surface, layout);
}

static void ask(qm_context *ctx, const qm_ref_surface *surface, const qm_sheet_grid *grid, qm_bytes *bytes)
{
    qm_sheet_grid own = *grid;
    own.columns = 1 + qm_bytes_take(bytes) % LAYOUT_SIDE;
    own.rows = 1 + qm_bytes_take(bytes) % LAYOUT_SIDE;
    qm_layout drawn = {0}, layout;
    bool has_patches;
    draw_grid(ctx, &drawn, &own);
    break_layout(ctx, &drawn, &own, bytes);
    add_patches(ctx, &drawn, bytes);
    if (read_back(ctx, &drawn, &layout, &has_patches)) {
        use(ctx, surface, &layout, has_patches);
        qm_layout_reset(ctx, &layout);
    }
    qm_layout_reset(ctx, &drawn);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    qm_bytes bytes = {data, size};
    qm_context ctx = qm_context_make();
    static qm_sheet sheet;
    uint8_t choice = qm_bytes_take(&bytes);
    qm_sheet_grid grid = qm_sheet_read_grid(&bytes, QM_SHEET_SIDE);
    qm_sheet_make(&grid, &sheet);
    if (choice % 4 == 0) qm_sheet_break(&sheet, &bytes);
    if (choice % 4 == 1) sheet.mesh.face_count = 0;
    if (qm_mesh_validate(&ctx, &sheet.mesh) != QM_OK) return 0;
    qm_bvh *tree;
    qm_ref_surface surface;
    if (!qm_fuzz_succeeded(&ctx, qm_bvh_build(&ctx, &sheet.mesh, QM_BVH_TARGET, 1, &tree))) return 0;
    if (qm_fuzz_succeeded(&ctx, qm_ref_surface_init(&ctx, tree, &surface)))
        ask(&ctx, &surface, &grid, &bytes);
    qm_bvh_destroy(&ctx, tree);
    return 0;
}
