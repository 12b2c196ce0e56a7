#include "json_out.h"

#include <stdio.h>

#include "base/json_write.h"

/* ---- meshes ---- */

static void add_faces(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_json_open(out, "faces", "{");
    qm_json_add_count(out, "triangles", mesh->facts.triangles);
    qm_json_add_count(out, "quads", mesh->facts.quads);
    qm_json_add_count(out, "polygons", mesh->facts.polygons);
    qm_text_add_string(out, "}");
}

static void add_largest_patch(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_regular_patch largest = qm_loaded_mesh_largest_patch(mesh);
    if (largest.rows == 0) {
        qm_json_add_word(out, "largest_patch", "null");
        return;
    }
    qm_json_open(out, "largest_patch", "{");
    qm_json_add_count(out, "rows", largest.rows);
    qm_json_add_count(out, "columns", largest.columns);
    qm_text_add_string(out, "}");
}

static void add_box(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_json_open(out, "bounding_box", "{");
    qm_json_add_numbers(out, "min", mesh->box.min, 3);
    qm_json_add_numbers(out, "max", mesh->box.max, 3);
    qm_json_add_number(out, "diagonal", mesh->diagonal);
    qm_text_add_string(out, "}");
}

static void add_times(qm_text *out, const qm_loaded_mesh *mesh)
{
    qm_json_open(out, "prepare_ms", "{");
    qm_json_add_number(out, "parse", mesh->parse_ms);
    qm_json_add_number(out, "topology", mesh->topology_ms);
    qm_json_add_number(out, "patches", mesh->patches_ms);
    qm_json_add_number(out, "bvh", mesh->bvh_ms);
    qm_text_add_string(out, "}");
}

void qm_json_write_mesh(qm_text *out, const qm_mesh_label *label, const qm_loaded_mesh *mesh)
{
    qm_text_add_string(out, "{");
    if (label->id) qm_json_add_string(out, "id", label->id);
    qm_json_add_string(out, "name", label->name);
    qm_json_add_string(out, "kind", qm_loaded_mesh_kind(mesh));
    qm_json_add_count(out, "vertices", mesh->mesh.vertex_count);
    add_faces(out, mesh);
    qm_json_add_count(out, "irregular_vertices", mesh->facts.irregular_vertices);
    qm_json_add_count(out, "patches", mesh->patches.patch_count);
    add_largest_patch(out, mesh);
    qm_json_add_count(out, "boundary_edges", mesh->facts.boundary_edges);
    qm_json_add_count(out, "components", mesh->facts.components);
    qm_json_add_bool(out, "manifold", mesh->facts.manifold);
    add_box(out, mesh);
    if (mesh->mesh.face_count == 0) {
        qm_json_add_bool(out, "has_normals", mesh->mesh.normals != NULL);
        qm_json_add_number(out, "disc_radius", qm_mesh_disc_radius(&mesh->mesh));
    }
    qm_json_add_string(out, "format", qm_format_name(mesh->format));
    qm_json_add_count(out, "size_bytes", mesh->file_size);
    qm_json_add_count(out, "memory_bytes", qm_loaded_mesh_memory_size(mesh));
    add_times(out, mesh);
    qm_json_add_count(out, "revision", label->revision);
    if (label->content_hash) qm_json_add_string(out, "content_hash", label->content_hash);
    if (label->created) qm_json_add_string(out, "created", label->created);
    qm_json_open(out, "warnings", "[");
    for (size_t i = 0; i < mesh->warning_count; i++) {
        qm_json_add_comma(out);
        qm_json_add_quoted(out, mesh->warnings[i]);
    }
    qm_text_add_string(out, "]}");
}

/* ---- problems ---- */

static void add_error(qm_text *out, const qm_problem_error *error)
{
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    if (error->pointer[0]) qm_json_add_string(out, "pointer", error->pointer);
    if (error->line != QM_NO_PLACE) qm_json_add_count(out, "line", error->line);
    if (error->offset != QM_NO_PLACE) qm_json_add_count(out, "offset", error->offset);
    qm_json_add_string(out, "detail", error->detail);
    qm_text_add_string(out, "}");
}

void qm_json_write_problem(qm_text *out, const qm_problem *problem)
{
    char type[96];
    snprintf(type, sizeof type, "/problems/%s", qm_problem_name(problem->code));
    qm_text_add_string(out, "{");
    qm_json_add_string(out, "type", type);
    qm_json_add_string(out, "title", qm_problem_title(problem->code));
    qm_json_add_count(out, "status", (uint64_t)qm_problem_status(problem->code));
    qm_json_add_string(out, "detail", problem->detail);
    qm_json_add_string(out, "code", qm_problem_name(problem->code));
    if (problem->error_count > 0) {
        qm_json_open(out, "errors", "[");
        for (size_t i = 0; i < problem->error_count; i++)
            add_error(out, &problem->errors[i]);
        qm_text_add_string(out, "]");
    }
    qm_text_add_string(out, "}");
}
