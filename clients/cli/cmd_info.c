#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/host.h"
#include "cli.h"

static const char usage[] = "usage: quadmesh info FILE [--json]\n"
                            "\n"
                            "  --json   the mesh resource of the API, or the problem document\n";

static void print_words(const char *path, const qm_loaded_mesh *mesh)
{
    const qm_mesh_facts *facts = &mesh->facts;
    printf("%s: %s, %s\n", path, qm_format_name(mesh->format), qm_loaded_mesh_kind(mesh));
    printf("  vertices   %zu\n", mesh->mesh.vertex_count);
    printf("  faces      %zu triangles, %zu quads, %zu polygons\n", facts->triangles, facts->quads,
           facts->polygons);
    printf("  topology   %zu components, %zu boundary edges, %zu irregular vertices, %s\n", facts->components,
           facts->boundary_edges, facts->irregular_vertices, facts->manifold ? "manifold" : "not manifold");
    if (mesh->patches.patch_count > 0) {
        qm_regular_patch largest = qm_loaded_mesh_largest_patch(mesh);
        printf("  patches    %zu regular ones, the largest %u x %u\n", mesh->patches.patch_count,
               largest.rows, largest.columns);
    }
    printf("  box        %.9g %.9g %.9g to %.9g %.9g %.9g, diagonal %.9g\n", mesh->box.min[0],
           mesh->box.min[1], mesh->box.min[2], mesh->box.max[0], mesh->box.max[1], mesh->box.max[2],
           mesh->diagonal);
    printf("  prepared   in %.1f ms: %.1f reading, %.1f topology, %.1f patches, %.1f tree; %.1f MB\n",
           mesh->parse_ms + mesh->topology_ms + mesh->patches_ms + mesh->bvh_ms, mesh->parse_ms,
           mesh->topology_ms, mesh->patches_ms, mesh->bvh_ms,
           1e-6 * (double)qm_loaded_mesh_memory_size(mesh));
    for (size_t i = 0; i < mesh->warning_count; i++)
        printf("  warning    %s\n", mesh->warnings[i]);
}

static void print_json(const char *path, const qm_loaded_mesh *mesh)
{
    qm_mesh_label label = {.name = cli_base_name(path)};
    qm_text text = {0};
    qm_json_write_mesh(&text, &label, mesh);
    char *document = qm_text_take(&text);
    puts(document ? document : "{}");
    free(document);
}

int cmd_info(int argc, char **argv)
{
    static const struct option options[] = {
        {"json", no_argument, NULL, 'j'}, {"help", no_argument, NULL, 'h'}, {0}};
    bool as_json = false;
    for (int option; (option = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (option == 'h') return fputs(usage, stdout), EXIT_OK;
        if (option != 'j') return fputs(usage, stderr), EXIT_USAGE;
        as_json = true;
    }
    if (argc - optind != 1) {
        fprintf(stderr, "quadmesh: info takes one file, got %d\n\n", argc - optind);
        return fputs(usage, stderr), EXIT_USAGE;
    }
    qm_context ctx = qm_host_context();
    const qm_preparation all = {
        .has_facts = true, .has_patches = true, .parts = QM_BVH_ALL, .thread_count = cli_count_threads(0)};
    qm_loaded_mesh mesh;
    if (!cli_load_mesh(&ctx, argv[optind], as_json, &all, &mesh)) return EXIT_BAD_INPUT;
    if (as_json)
        print_json(argv[optind], &mesh);
    else
        print_words(argv[optind], &mesh);
    qm_loaded_mesh_reset(&ctx, &mesh);
    return EXIT_OK;
}
