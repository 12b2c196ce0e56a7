/**
 * cmd_info.c: `quadmesh info FILE`: what a file holds, as the daemon would tell it.
 */
#include <getopt.h>
#include <stdio.h>
#include <string.h>

#include "cli.h"
#include "json_out.h"

static const char help[] = "usage: quadmesh info [--json] FILE\n\n"
                           "Tells what a mesh file holds. FILE is OBJ, PLY, STL, OFF, glTF binary, Draco or "
                           "XYZ; - is standard input.\n\n"
                           "  --json   the mesh resource of the service, or its problem document\n"
                           "  --help   this text\n\n"
                           "Exit status: 0; 1 the file is at fault; 2 usage.\n";

/** "min x y z" with digits that read back to the same numbers. */
static void add_point(qm_text *out, const char *label, const double point[3])
{
    qm_text_printf(out, "%s", label);
    for (int i = 0; i < 3; i++) {
        char number[QM_JSON_NUMBER_SIZE];
        qm_text_printf(out, " %s", qm_json_number(point[i], number));
    }
}

static void write_words(qm_text *out, const char *path, const qm_loaded_mesh *mesh)
{
    char diagonal[QM_JSON_NUMBER_SIZE];
    const qm_mesh_facts *facts = &mesh->facts;
    qm_text_printf(out, "%s: %s\n", path, qm_loaded_mesh_kind(mesh));
    qm_text_printf(out, "  vertices    %zu", mesh->mesh.vertex_count);
    qm_text_printf(out, "\n  faces       %zu triangles, %zu quads, %zu polygons", facts->triangles,
                   facts->quads, facts->polygons);
    add_point(out, "\n  box         min", mesh->box.min);
    add_point(out, ", max", mesh->box.max);
    qm_text_printf(out, ", diagonal %s", qm_json_number(mesh->diagonal, diagonal));
    qm_text_printf(
        out, "\n  topology    %zu components, %zu boundary edges, %zu irregular vertices, %smanifold",
        facts->components, facts->boundary_edges, facts->irregular_vertices, facts->manifold ? "" : "not ");
    qm_text_printf(out, "\n  file        %s, %zu bytes; %zu bytes in memory", qm_format_name(mesh->format),
                   mesh->file_size, qm_loaded_mesh_memory_size(mesh));
    qm_text_printf(out, "\n  prepared    in %.1f ms: parse %.1f, topology %.1f, bvh %.1f",
                   mesh->parse_ms + mesh->topology_ms + mesh->bvh_ms, mesh->parse_ms, mesh->topology_ms,
                   mesh->bvh_ms);
    for (size_t i = 0; i < mesh->warning_count; i++)
        qm_text_printf(out, "\n  warning     %s", mesh->warnings[i]);
}

static qm_exit show(const char *path, bool as_json)
{
    qm_context ctx = qm_context_make();
    qm_loaded_mesh mesh;
    qm_problem problem;
    if (!qm_cli_load(&ctx, path, &mesh, &problem)) return qm_cli_fail(&problem, as_json);
    const char *slash = strrchr(path, '/');
    qm_text out = {0};
    if (as_json)
        qm_json_write_mesh(&out, &(qm_mesh_label){.name = slash ? slash + 1 : path}, &mesh);
    else
        write_words(&out, path, &mesh);
    qm_loaded_mesh_reset(&ctx, &mesh);
    return qm_cli_print(&out) ? QM_EXIT_OK : QM_EXIT_INPUT;
}

qm_exit qm_cli_info(int argc, char **argv)
{
    static const struct option options[] = {
        {"json", no_argument, NULL, 'j'}, {"help", no_argument, NULL, 'h'}, {NULL, 0, NULL, 0}};
    bool as_json = false;
    for (int option; (option = getopt_long(argc, argv, "jh", options, NULL)) != -1;) {
        if (option == 'h') return fputs(help, stdout), QM_EXIT_OK;
        if (option != 'j') return fputs(help, stderr), QM_EXIT_USAGE;
        as_json = true;
    }
    if (optind + 1 != argc) {
        fprintf(stderr, "%s: one FILE is needed\n%s", argv[0], help);
        return QM_EXIT_USAGE;
    }
    return show(argv[optind], as_json);
}
