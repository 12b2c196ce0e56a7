/**
 * cmd_info.c: the contents of a mesh file.
 */
#include <stdio.h>
#include <stdlib.h>

#include "base/host.h"
#include "options.h"

/** One figure, or both where quads have another one as patches. */
static void print_extent(const char *name, const qm_interval by_reading[2], bool has_quads)
{
    char low[CLI_BOUND_SIZE], high[CLI_BOUND_SIZE];
    for (int reading = 0; reading < (has_quads ? 2 : 1); reading++)
        printf("%s%s to %s%s", reading == 0 ? name : ", ",
               cli_format_bound(by_reading[reading].lower, false, low),
               cli_format_bound(by_reading[reading].upper, true, high),
               !has_quads     ? ""
               : reading == 0 ? " of triangles"
                              : " of bilinear quads");
    putchar('\n');
}

/** Whether the surface is closed, which way its faces run, and how large it is. */
static void print_surface(const qm_loaded_mesh *mesh)
{
    const qm_mesh_facts *facts = &mesh->facts;
    printf("  surface    %s, %s, Euler number %td", facts->watertight ? "closed" : "not closed",
           facts->winding_consistent ? "consistently oriented" : "not consistently oriented",
           facts->euler_number);
    if (facts->genus != QM_NO_GENUS) printf(", genus %zu", facts->genus);
    if (facts->boundary_loops > 0) printf(", %zu boundary loops", facts->boundary_loops);
    printf("\n  doubtful   %zu faces without area, %zu duplicate faces\n", mesh->extent.degenerate_faces,
           facts->duplicate_faces);
    print_extent("  area       ", mesh->extent.area, facts->quads > 0);
    if (facts->watertight && facts->winding_consistent)
        print_extent("  volume     ", mesh->extent.volume, facts->quads > 0);
}

static int run(int argc, char **argv)
{
    bool as_json = false;
    const cli_option options[] = {{.name = "json",
                                   .letter = 'j',
                                   .type = CLI_FLAG,
                                   .target = &as_json,
                                   .help = "the mesh resource of the API, or the problem document"}};
    const char *path;
    int status;
    if (!cli_read_options(&cmd_info, options, 1, argc, argv, &path, &status)) return status;
    qm_context ctx = qm_host_context();
    const qm_preparation all = {.has_facts = true,
                                .has_extent = true,
                                .has_patches = true,
                                .parts = QM_BVH_ALL,
                                .thread_count = cli_count_threads(0)};
    qm_loaded_mesh mesh;
    if (!cli_load_mesh(&ctx, path, as_json, &all, &mesh)) return EXIT_BAD_INPUT;
    if (as_json) {
        qm_mesh_label label = {.name = cli_base_name(path)};
        qm_text text = {0};
        qm_json_write_mesh(&text, &label, &mesh);
        char *document = qm_text_take(&text);
        puts(document ? document : "{}");
        free(document);
    } else {
        const qm_mesh_facts *facts = &mesh.facts;
        printf("%s: %s, %s\n", path, qm_format_name(mesh.format), qm_loaded_mesh_kind(&mesh));
        printf("  vertices   %zu\n", mesh.mesh.vertex_count);
        printf("  faces      %zu triangles, %zu quads, %zu polygons\n", facts->triangles, facts->quads,
               facts->polygons);
        printf("  topology   %zu components, %zu boundary edges, %zu irregular vertices, %s\n",
               facts->components, facts->boundary_edges, facts->irregular_vertices,
               facts->manifold ? "manifold" : "not manifold");
        if (mesh.mesh.face_count > 0) print_surface(&mesh);
        if (mesh.patches.patch_count > 0) {
            qm_regular_patch largest = qm_loaded_mesh_largest_patch(&mesh);
            printf("  patches    %zu regular ones, the largest %u x %u\n", mesh.patches.patch_count,
                   largest.rows, largest.columns);
        }
        printf("  box        %.9g %.9g %.9g to %.9g %.9g %.9g, diagonal %.9g\n", mesh.box.min[0],
               mesh.box.min[1], mesh.box.min[2], mesh.box.max[0], mesh.box.max[1], mesh.box.max[2],
               mesh.diagonal);
        printf("  prepared   in %.1f ms: %.1f reading, %.1f topology, %.1f patches, %.1f tree; %.1f MB\n",
               mesh.parse_ms + mesh.topology_ms + mesh.patches_ms + mesh.bvh_ms, mesh.parse_ms,
               mesh.topology_ms, mesh.patches_ms, mesh.bvh_ms,
               1e-6 * (double)qm_loaded_mesh_memory_size(&mesh));
        for (size_t i = 0; i < mesh.warning_count; i++)
            printf("  warning    %s\n", mesh.warnings[i]);
    }
    qm_loaded_mesh_reset(&ctx, &mesh);
    return EXIT_OK;
}

const cli_command cmd_info = {.name = "info",
                              .arguments = "FILE [--json]",
                              .summary = "what a mesh file holds: counts, box, area, volume, faults",
                              .takes = "one file",
                              .path_count = 1,
                              .description =
                                  "What a mesh file holds: counts, topology, box, area and volume, and what "
                                  "is doubtful about it.\nFor the shape of its faces: quality.\n",
                              .exit_status = "Exit status: 0 done, 2 bad input or wrong usage.",
                              .run = run};
