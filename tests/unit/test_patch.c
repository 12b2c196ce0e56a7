/* qm_patch_set: known shapes, every edge of the promise checked by plain rules, awkward and random meshes. */
#include "check.h"

#include "core/face_ring.h"
#include "data_mesh.h"
#include "qm/patch.h"
#include "shapes.h"

#include <stdio.h>
#include <string.h>

static qm_patch_set find(const qm_mesh *mesh)
{
    qm_context ctx = qm_context_make();
    qm_patch_set set;
    assert_int_equal(qm_patch_set_find(&ctx, mesh, &set), QM_OK);
    return set;
}

static void drop(qm_patch_set *set)
{
    qm_context ctx = qm_context_make();
    qm_patch_set_reset(&ctx, set);
}

/** Every face is in one patch, once; and the faces of a patch have its vertices at their corners. */
static void check_cover(const qm_mesh *mesh, const qm_patch_set *set)
{
    assert_int_equal(set->face_count, mesh->face_count);
    bool *seen = calloc(mesh->face_count, sizeof *seen);
    assert_non_null(seen);
    size_t next = 0;
    for (size_t i = 0; i < set->patch_count; i++) {
        const qm_regular_patch *patch = &set->patches[i];
        QM_CHECK(patch->first == next, "patch %zu begins at %zu, not %zu", i, patch->first, next);
        QM_CHECK(patch->rows > 0 && patch->columns > 0, "patch %zu is empty", i);
        next += (size_t)patch->rows * patch->columns;
    }
    assert_int_equal(next, mesh->face_count);
    for (size_t i = 0; i < set->face_count; i++) {
        QM_CHECK(!seen[set->faces[i]], "face %u is there twice", set->faces[i]);
        seen[set->faces[i]] = true;
    }
    free(seen);
}

static void check_corners(const qm_mesh *mesh, const qm_patch_set *set, size_t index)
{
    const qm_regular_patch *patch = &set->patches[index];
    const uint32_t *lone = mesh->faces + 4 * (size_t)set->faces[patch->first];
    if (lone[3] == QM_NO_INDEX) {
        assert_int_equal(patch->rows * patch->columns, 1);
        return;
    }
    for (uint32_t r = 0; r < patch->rows; r++) {
        for (uint32_t c = 0; c < patch->columns; c++) {
            size_t place = patch->first + (size_t)r * patch->columns + c;
            const uint32_t *face = mesh->faces + 4 * (size_t)set->faces[place];
            const uint32_t rows[4] = {r, r, r + 1, r + 1}, columns[4] = {c, c + 1, c + 1, c};
            for (unsigned k = 0; k < 4; k++)
                QM_CHECK(face[qm_patch_corner(set->turns[place], k)] ==
                             qm_patch_vertex(set, mesh, index, rows[k], columns[k]),
                         "patch %zu, row %u, column %u: corner %u lies elsewhere", index, r, c, k);
        }
    }
}

/** Faces with both vertices at neighbouring corners of what is left of them. */
static size_t faces_on_edge(const qm_mesh *mesh, uint32_t a, uint32_t b)
{
    size_t count = 0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        uint32_t ring[4];
        int corners = qm_face_ring(mesh->faces + 4 * f, ring);
        for (int i = 0; i < corners; i++) {
            uint32_t from = ring[i], to = ring[(i + 1) % corners];
            count += (from == a && to == b) || (from == b && to == a);
        }
    }
    return count;
}

/** Edges inside a patch have two faces. Slow: for small meshes. */
static void check_inner_edges(const qm_mesh *mesh, const qm_patch_set *set, size_t index)
{
    const qm_regular_patch *patch = &set->patches[index];
    for (uint32_t r = 0; r + 1 < patch->rows; r++)
        for (uint32_t c = 0; c < patch->columns; c++)
            QM_CHECK(faces_on_edge(mesh, qm_patch_vertex(set, mesh, index, r + 1, c),
                                   qm_patch_vertex(set, mesh, index, r + 1, c + 1)) == 2,
                     "patch %zu: the edge after row %u, column %u has not two faces", index, r, c);
    for (uint32_t r = 0; r < patch->rows; r++)
        for (uint32_t c = 0; c + 1 < patch->columns; c++)
            QM_CHECK(faces_on_edge(mesh, qm_patch_vertex(set, mesh, index, r, c + 1),
                                   qm_patch_vertex(set, mesh, index, r + 1, c + 1)) == 2,
                     "patch %zu: the edge after column %u, row %u has not two faces", index, c, r);
}

static void check(const qm_mesh *mesh, const qm_patch_set *set)
{
    check_cover(mesh, set);
    for (size_t i = 0; i < set->patch_count; i++) {
        check_corners(mesh, set, i);
        if (mesh->face_count <= 2000) check_inner_edges(mesh, set, i);
    }
}

/** Checks a mesh, frees it, and returns how many patches it has; *largest is given for the first of the
 * largest. */
static size_t count_patches(qm_mesh mesh, uint32_t *rows, uint32_t *columns)
{
    qm_patch_set set = find(&mesh);
    check(&mesh, &set);
    size_t most = 0;
    for (size_t i = 0; i < set.patch_count; i++) {
        size_t faces = (size_t)set.patches[i].rows * set.patches[i].columns;
        if (faces <= most) continue;
        most = faces;
        *rows = set.patches[i].rows;
        *columns = set.patches[i].columns;
    }
    size_t count = set.patch_count;
    drop(&set);
    qm_shape_free(&mesh);
    return count;
}

static void check_one(qm_mesh mesh, uint32_t one, uint32_t other)
{
    uint32_t rows, columns;
    assert_int_equal(count_patches(mesh, &rows, &columns), 1);
    QM_CHECK((rows == one && columns == other) || (rows == other && columns == one),
             "%u x %u instead of %u x %u", rows, columns, one, other);
}

static void grids_are_one_patch(void **state)
{
    (void)state;
    check_one(qm_shape_plane(1, 0.0), 1, 1);
    check_one(qm_shape_plane(7, 0.0), 7, 7);
    check_one(qm_shape_strip(9, 4, 2.0), 9, 4);
    check_one(qm_shape_sphere(0.0), 48, 100);
    check_one(qm_shape_torus(96, 48, 2.0, 0.5), 96, 48);
    check_one(qm_shape_torus(3, 3, 2.0, 0.5), 3, 3);
}

/** The number of patches of a plane of 6 x 6 quads with these grids. */
static size_t count_told(qm_mesh_grid *grids, size_t count, uint32_t *first_rows)
{
    qm_mesh mesh = qm_shape_plane(6, 0.0);
    mesh.grids = grids;
    mesh.grid_count = count;
    qm_patch_set set = find(&mesh);
    check(&mesh, &set);
    size_t found = set.patch_count;
    *first_rows = set.patches[0].rows;
    drop(&set);
    mesh.grids = NULL;
    qm_shape_free(&mesh);
    return found;
}

static void grids_that_a_mesh_tells_are_its_patches(void **state)
{
    (void)state;
    uint32_t rows;
    assert_int_equal(count_told((qm_mesh_grid[]){{2, 6}, {1, 6}, {3, 6}}, 3, &rows), 3);
    assert_int_equal(rows, 2);
    assert_int_equal(count_told((qm_mesh_grid[]){{6, 6}}, 1, &rows), 1);
    /* What the faces do not bear out is not believed: the wrong shape, too few, too many, none, overflow. */
    assert_int_equal(count_told((qm_mesh_grid[]){{4, 9}}, 1, &rows), 1);
    assert_int_equal(rows, 6);
    assert_int_equal(count_told((qm_mesh_grid[]){{3, 6}, {2, 6}}, 2, &rows), 1);
    assert_int_equal(count_told((qm_mesh_grid[]){{3, 6}, {4, 6}}, 2, &rows), 1);
    assert_int_equal(count_told((qm_mesh_grid[]){{6, 6}, {0, 6}}, 2, &rows), 1);
    assert_int_equal(count_told((qm_mesh_grid[]){{UINT32_MAX, UINT32_MAX}}, 1, &rows), 1);
}

/** A band of columns x rows whose ends are joined with a shift, after turning the end over when flip is
 * set. */
static qm_mesh joined_band(uint32_t columns, uint32_t rows, bool flip)
{
    qm_mesh mesh = qm_shape_make((size_t)columns * (rows + 1), (size_t)columns * rows);
    for (uint32_t c = 0; c < columns; c++) {
        for (uint32_t r = 0; r < rows; r++) {
            uint32_t next = (c + 1) % columns;
            bool turned = flip && c + 1 == columns;
            uint32_t low = turned ? rows - r : r, high = turned ? rows - r - 1 : r + 1;
            const uint32_t face[4] = {c * (rows + 1) + r, next * (rows + 1) + low, next * (rows + 1) + high,
                                      c * (rows + 1) + r + 1};
            memcpy(mesh.faces + 4 * ((size_t)c * rows + r), face, sizeof face);
        }
    }
    return mesh;
}

static void bands_are_opened_by_one_cut(void **state)
{
    (void)state;
    check_one(joined_band(9, 4, false), 9, 4);
    check_one(joined_band(9, 1, false), 9, 1);
    check_one(joined_band(9, 4, true), 9, 4);
    check_one(joined_band(9, 5, true), 9, 5);
    check_one(joined_band(3, 1, true), 3, 1);
}

/** A torus of columns x rows, the last column joined to the first one shift rows on. */
static qm_mesh twisted_torus(uint32_t columns, uint32_t rows, uint32_t shift, bool flip)
{
    qm_mesh mesh = qm_shape_make((size_t)columns * rows, (size_t)columns * rows);
    for (uint32_t c = 0; c < columns; c++) {
        for (uint32_t r = 0; r < rows; r++) {
            bool is_last = c + 1 == columns;
            uint32_t next = is_last ? 0 : c + 1, low = r, high = r + 1;
            if (is_last) {
                low = (flip ? 2 * rows - r : r + shift) % rows;
                high = (flip ? 2 * rows - r - 1 : r + shift + 1) % rows;
            }
            const uint32_t face[4] = {c * rows + r, next * rows + low % rows, next * rows + high % rows,
                                      c * rows + (r + 1) % rows};
            memcpy(mesh.faces + 4 * ((size_t)c * rows + r), face, sizeof face);
        }
    }
    return mesh;
}

static void closed_surfaces_without_irregular_vertices_need_few(void **state)
{
    (void)state;
    uint32_t rows = 0, columns = 0;
    check_one(twisted_torus(12, 7, 0, false), 12, 7);
    for (uint32_t shift = 1; shift < 7; shift++)
        assert_true(count_patches(twisted_torus(12, 7, shift, false), &rows, &columns) <= 3);
    assert_true(count_patches(twisted_torus(12, 7, 0, true), &rows, &columns) <= 3);
}

static void irregular_vertices_part_patches(void **state)
{
    (void)state;
    uint32_t rows = 0, columns = 0;
    size_t count = count_patches(qm_shape_box(1, 1, 1), &rows, &columns);
    assert_in_range(count, 2, 3);
    qm_mesh plane = qm_shape_plane(5, 0.0), ell = qm_shape_plane(5, 0.0);
    /* An L: the quads of one corner are taken away, which leaves a corner of three quads. */
    size_t kept = 0;
    for (size_t f = 0; f < ell.face_count; f++) {
        if (f % 5 >= 3 && f / 5 >= 2) continue;
        memcpy(ell.faces + 4 * kept++, plane.faces + 4 * f, 4 * sizeof *ell.faces);
    }
    ell.face_count = kept;
    assert_int_equal(count_patches(ell, &rows, &columns), 2);
    qm_shape_free(&plane);
}

static void triangles_and_spoiled_quads_stand_alone(void **state)
{
    (void)state;
    uint32_t rows = 0, columns = 0;
    qm_mesh plane = qm_shape_plane(5, 0.0);
    plane.faces[4 * 12 + 3] = QM_NO_INDEX; /* the middle */
    qm_patch_set set = find(&plane);
    check(&plane, &set);
    size_t alone = 0;
    for (size_t i = 0; i < set.patch_count; i++)
        alone += set.faces[set.patches[i].first] == 12 && set.patches[i].rows * set.patches[i].columns == 1;
    assert_int_equal(alone, 1);
    assert_true(set.patch_count <= 5);
    drop(&set);
    plane.faces[4 * 12 + 3] = plane.faces[4 * 12];
    assert_true(count_patches(plane, &rows, &columns) <= 5);

    qm_mesh torus = qm_shape_torus(5, 5, 2.0, 0.5), triangles = qm_shape_triangulated(&torus);
    set = find(&triangles);
    assert_int_equal(set.patch_count, 50);
    assert_int_equal(set.quad_count, 0);
    check(&triangles, &set);
    drop(&set);
    qm_shape_free(&triangles);
    qm_shape_free(&torus);
}

static void faces_that_wind_both_ways_make_one_patch(void **state)
{
    (void)state;
    for (uint64_t stream = 0; stream < 20; stream++) {
        qm_random random = qm_random_make(qm_check_seed(), stream);
        qm_mesh mesh = qm_shape_plane(6, 0.0);
        for (size_t f = 0; f < mesh.face_count; f++) {
            uint32_t *face = mesh.faces + 4 * f, turned[4];
            uint64_t turn = qm_random_below(&random, 4), flip = qm_random_below(&random, 2);
            for (uint64_t k = 0; k < 4; k++)
                turned[k] = face[(flip ? turn + 4 - k : turn + k) % 4];
            memcpy(face, turned, sizeof turned);
        }
        check_one(mesh, 6, 6);
    }
}

static void random_soups_hold_the_promise(void **state)
{
    (void)state;
    for (uint64_t stream = 0; stream < 600; stream++) {
        qm_random random = qm_random_make(qm_check_seed(), 100 + stream);
        size_t faces = 1 + qm_random_below(&random, 60);
        qm_soup_corners corners = stream % 2 ? QM_SOUP_QUADS : QM_SOUP_MIXED;
        qm_mesh mesh =
            qm_shape_soup(&random, faces, corners, (qm_soup_style)(stream % QM_SOUP_STYLE_COUNT), 0.5);
        qm_patch_set set = find(&mesh);
        check(&mesh, &set);
        drop(&set);
        qm_shape_free(&mesh);
    }
}

/** A grid from which random quads are taken or of which random vertices are joined: open, torn and
 * pinched. */
static void torn_grids_hold_the_promise(void **state)
{
    (void)state;
    for (uint64_t stream = 0; stream < 200; stream++) {
        qm_random random = qm_random_make(qm_check_seed(), 1000 + stream);
        qm_mesh mesh = stream % 2 ? qm_shape_torus(12, 9, 2.0, 0.5) : qm_shape_plane(10, 0.0);
        size_t taken = qm_random_below(&random, 20), joined = qm_random_below(&random, 4);
        for (size_t i = 0; i < taken; i++) {
            size_t f = qm_random_below(&random, mesh.face_count--);
            memmove(mesh.faces + 4 * f, mesh.faces + 4 * mesh.face_count, 4 * sizeof *mesh.faces);
        }
        for (size_t i = 0; i < joined; i++) {
            uint32_t from = (uint32_t)qm_random_below(&random, mesh.vertex_count);
            uint32_t to = (uint32_t)qm_random_below(&random, mesh.vertex_count);
            for (size_t k = 0; k < 4 * mesh.face_count; k++)
                if (mesh.faces[k] == from) mesh.faces[k] = to;
        }
        qm_patch_set set = find(&mesh);
        check(&mesh, &set);
        drop(&set);
        qm_shape_free(&mesh);
    }
}

static void real_meshes_hold_the_promise(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        size_t most; /* patches */
    } meshes[] = {
        {"grids/torus_96x48_quads.obj", 1},
        {"grids/saddle_32x32_quads.obj", 1},
        {"nasty/helical_torus.obj", 4},
        {"nasty/helical_torus_separatrices.obj", 40},
        {"nasty/moebius.obj", 1},
        {"nasty/klein_figure8.obj", 4},
        {"pairs/bunny/quad_semiregular.off", 0},
        {"pairs/bunny/quad_qf.obj", 0},
        {"nasty/mixed_faces.obj", 0},
    };
    for (size_t i = 0; i < sizeof meshes / sizeof *meshes; i++) {
        qm_context ctx = qm_context_make();
        qm_mesh mesh;
        qm_data_mesh_read(&ctx, meshes[i].name, &mesh);
        qm_patch_set set = find(&mesh);
        check(&mesh, &set);
        if (getenv("QM_TEST_VERBOSE"))
            printf("%s: %zu faces, %zu patches\n", meshes[i].name, mesh.face_count, set.patch_count);
        if (meshes[i].most)
            QM_CHECK(set.patch_count <= meshes[i].most, "%s: %zu patches", meshes[i].name, set.patch_count);
        drop(&set);
        qm_mesh_reset(&ctx, &mesh);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(grids_are_one_patch),
        cmocka_unit_test(grids_that_a_mesh_tells_are_its_patches),
        cmocka_unit_test(bands_are_opened_by_one_cut),
        cmocka_unit_test(closed_surfaces_without_irregular_vertices_need_few),
        cmocka_unit_test(irregular_vertices_part_patches),
        cmocka_unit_test(triangles_and_spoiled_quads_stand_alone),
        cmocka_unit_test(faces_that_wind_both_ways_make_one_patch),
        cmocka_unit_test(random_soups_hold_the_promise),
        cmocka_unit_test(torn_grids_hold_the_promise),
    };
    const struct CMUnitTest data_tests[] = {
        cmocka_unit_test(real_meshes_hold_the_promise),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + qm_data_run_group_tests(data_tests);
}
