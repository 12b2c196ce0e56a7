"""Regular patches of quad meshes in the API."""
import shapes
from conftest import check_problem


def patches(client, mesh):
    reply = client.get(f"/v1/meshes/{mesh}/patches")
    assert reply.status_code == 200, reply.text
    return reply.json()


def check_cover(answer, faces):
    found = [face for patch in answer["patches"] for face in patch["faces"]]
    assert sorted(found) == list(range(faces))
    assert answer["patch_count"] == len(answer["patches"])
    for patch in answer["patches"]:
        assert len(patch["faces"]) == patch["rows"] * patch["columns"]


def test_a_band_is_one_patch(client, spheres):
    facts = client.get(f"/v1/meshes/{spheres[0]}").json()
    assert facts["patches"] == 1
    assert sorted(facts["largest_patch"].values()) == [48, 100]
    assert facts["irregular_vertices"] == 0
    answer = patches(client, spheres[0])
    check_cover(answer, 4800)
    assert answer["patch_count"] == 1


def test_a_saddle_tells_rows_and_columns(client):
    mesh = client.upload(shapes.saddle(5), name="saddle")["id"]
    answer = patches(client, mesh)
    check_cover(answer, 25)
    # Neighbours in a row are neighbours in the mesh: they share two corners.
    faces = shapes.saddle(5)[1]
    row = answer["patches"][0]["faces"][:5]
    for one, other in zip(row, row[1:]):
        assert len(set(faces[one]) & set(faces[other])) == 2


def test_a_cube_has_irregular_corners(client):
    mesh = client.upload(shapes.cube(), name="cube of patches")["id"]
    answer = patches(client, mesh)
    check_cover(answer, 6)
    assert answer["irregular_vertices"] == 8
    assert 2 <= answer["patch_count"] <= 3


def test_polygons_count_as_in_the_file(client):
    mesh = ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (3, 1, 0), (2, 2, 0)],
            [(0, 1, 2, 3), (1, 4, 5, 6, 2)])
    answer = patches(client, client.upload(shapes.obj(mesh), format="obj")["id"])
    assert {face for patch in answer["patches"] for face in patch["faces"]} == {0, 1}


def test_a_mesh_of_triangles_has_none(client):
    mesh = client.upload(shapes.triangles(shapes.saddle(4)), name="triangles")
    assert mesh["patches"] == 0 and mesh["largest_patch"] is None
    assert patches(client, mesh["id"]) == {"patch_count": 0, "irregular_vertices": 0, "patches": []}


def test_an_unchanged_answer_is_not_sent_again(client, spheres):
    tag = client.get(f"/v1/meshes/{spheres[0]}/patches").headers["ETag"]
    reply = client.get(f"/v1/meshes/{spheres[0]}/patches", headers={"If-None-Match": tag})
    assert reply.status_code == 304 and not reply.content


def test_an_unknown_mesh_is_a_problem(client):
    check_problem(client.get("/v1/meshes/m_none/patches"), 404, "mesh_not_found")
