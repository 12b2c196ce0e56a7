"""Uploads in every format, the members of the mesh resource, lists, deletion."""
import hashlib
import math
import subprocess

import pytest

import shapes
from conftest import check_problem

# What is uploaded, as which format, and whether the format keeps quads.
FORMATS = {
    "obj": (shapes.obj, "obj", True),
    "ply_ascii": (shapes.ply_ascii, "ply", True),
    "ply_little": (shapes.ply_little, "ply", True),
    "ply_big": (shapes.ply_big, "ply", True),
    "stl_ascii": (shapes.stl_ascii, "stl", False),
    "stl_binary": (shapes.stl_binary, "stl", False),
    "off": (shapes.off, "off", True),
    "glb": (shapes.glb, "glb", False),
    "3mf": (shapes.threemf, "3mf", False),
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("given", ["format", "name", "sniffed"])
def test_every_format_gives_the_cube(client, name, given):
    write, suffix, keeps_quads = FORMATS[name]
    query = {"format": {"format": suffix}, "name": {"name": f"cube.{suffix}"}, "sniffed": {}}[given]
    mesh = client.upload(write(shapes.cube()), **query)
    assert mesh["format"] == suffix
    assert mesh["vertices"] == 8
    assert mesh["faces"] == ({"triangles": 0, "quads": 6, "polygons": 0} if keeps_quads else
                             {"triangles": 12, "quads": 0, "polygons": 0})
    assert mesh["kind"] == ("quads" if keeps_quads else "triangles")
    assert (mesh["boundary_edges"], mesh["components"], mesh["manifold"]) == (0, 1, True)
    assert mesh["bounding_box"]["min"] == [0, 0, 0] and mesh["bounding_box"]["max"] == [1, 1, 1]
    assert mesh["bounding_box"]["diagonal"] == pytest.approx(math.sqrt(3), rel=1e-15)
    assert mesh["revision"] == 0
    assert mesh["memory_bytes"] > 0
    assert mesh["prepare_ms"]["parse"] >= 0 and mesh["prepare_ms"]["bvh"] >= 0


MEDIA_TYPES = [("model/obj", shapes.obj), ("application/x-ply", shapes.ply_big), ("model/stl", shapes.stl_binary),
               ("application/x-off", shapes.off), ("model/gltf-binary", shapes.glb), ("text/x-xyz", shapes.xyz),
               ("application/x-pcd", shapes.pcd), ("model/3mf", shapes.threemf)]


@pytest.mark.parametrize("media_type,write", MEDIA_TYPES)
def test_content_type_names_the_format(client, media_type, write):
    reply = client.post("/v1/meshes", content=write(shapes.cube()), headers={"Content-Type": media_type})
    assert reply.status_code in (200, 201), reply.text
    assert reply.json()["vertices"] == 8


def test_points(client):
    mesh = client.upload(b"0 0 0\n1 2 3\n4 5 6.5\n", format="xyz")
    assert (mesh["kind"], mesh["vertices"], mesh["format"]) == ("points", 3, "xyz")
    assert mesh["bounding_box"]["max"] == [4, 5, 6.5]


@pytest.mark.parametrize("level", [0, 7])
def test_draco(client, tmp_path, level):
    source, packed = tmp_path / "sphere.obj", tmp_path / "sphere.drc"
    source.write_bytes(shapes.obj(shapes.triangles(shapes.sphere(parallels=10, meridians=20))))
    subprocess.run(["draco_encoder", "-i", source, "-o", packed, "-cl", str(level), "-qp", "14"], check=True,
                   stdout=subprocess.DEVNULL)
    mesh = client.upload(packed.read_bytes())
    assert (mesh["format"], mesh["kind"], mesh["vertices"]) == ("drc", "triangles", 180)
    assert mesh["faces"]["triangles"] == 320
    assert mesh["bounding_box"]["diagonal"] == pytest.approx(math.sqrt(8 + 4 * math.cos(math.pi / 10) ** 2), rel=1e-3)


def test_mixed_and_polygons(client):
    text = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 2 0\nv 2 0 0\nf 1 2 3 4\nf 2 6 3\nf 1 2 3 5 4\n"
    mesh = client.upload(text, format="obj")
    assert mesh["kind"] == "mixed"
    assert mesh["faces"] == {"triangles": 1, "quads": 1, "polygons": 1}
    assert any("fan" in warning or "triangle" in warning for warning in mesh["warnings"]), mesh["warnings"]


def test_nothing_is_dropped_in_silence(client):
    mesh = client.upload(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 9 9 9\nf 1 2 3\n", format="obj")
    assert mesh["warnings"] and mesh["bounding_box"]["max"] == [1, 1, 0]


def test_same_bytes_are_one_mesh(client):
    content = shapes.off(shapes.cube(side=1.25))
    first = client.post("/v1/meshes", params={"name": "dedup.off"}, content=content)
    again = client.post("/v1/meshes", params={"name": "dedup.off"}, content=content)
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json() == again.json()
    mesh = first.json()
    assert first.headers["location"] == f"/v1/meshes/{mesh['id']}"
    assert mesh["content_hash"].split(":")[-1] == hashlib.sha256(content).hexdigest()
    assert client.get(first.headers["location"]).json() == mesh
    other = client.post("/v1/meshes", content=shapes.off(shapes.cube(side=1.5)))
    assert other.status_code == 201 and other.json()["id"] != mesh["id"]


def test_etag_names_content_and_revision(client):
    content = shapes.obj(shapes.cube(side=1.75))
    posted = client.post("/v1/meshes", content=content)
    url, tag = posted.headers["location"], posted.headers["etag"]
    assert hashlib.sha256(content).hexdigest() in tag
    got = client.get(url)
    assert got.headers["etag"] == tag
    kept = client.get(url, headers={"If-None-Match": tag})
    assert kept.status_code == 304 and kept.content == b"" and kept.headers["etag"] == tag
    assert client.get(url, headers={"If-None-Match": '"other"'}).status_code == 200


def test_head_is_get_without_a_body(client):
    mesh = client.upload(shapes.cube(side=2.5))
    reply = client.head(f"/v1/meshes/{mesh['id']}")
    assert reply.status_code == 200 and reply.content == b""
    assert reply.headers["content-type"] == "application/json"


def test_a_chunked_upload_is_the_same_mesh(client):
    content = shapes.obj(shapes.sphere(0.5, 30, 40))
    chunks = (content[i:i + 1000] for i in range(0, len(content), 1000))
    whole, pieces = client.post("/v1/meshes", content=content), client.post("/v1/meshes", content=chunks)
    assert (whole.status_code, pieces.status_code) == (201, 200)
    assert whole.json()["id"] == pieces.json()["id"]


def test_lists_come_in_pages(make_daemon):
    with make_daemon().client() as client:
        assert client.get("/v1/meshes").json() == {"meshes": [], "next": None}
        ids = [client.upload(shapes.cube(side=1 + i))["id"] for i in range(5)]
        seen, cursor = [], None
        for _ in range(3):
            query = {"limit": 2, **({"cursor": cursor} if cursor else {})}
            page = client.get("/v1/meshes", params=query).json()
            assert len(page["meshes"]) <= 2
            seen += [mesh["id"] for mesh in page["meshes"]]
            cursor = page["next"]
        assert cursor is None and seen == ids
        assert len(client.get("/v1/meshes").json()["meshes"]) == 5


@pytest.mark.parametrize("query", [{"limit": 0}, {"limit": -1}, {"limit": "many"}, {"limit": 10**9}, {"cursor": "?"},
                                   {"cursor": "-4"}])
def test_bad_pages_are_refused(client, query):
    check_problem(client.get("/v1/meshes", params=query), 400)
    check_problem(client.get("/v1/jobs", params=query), 400)


def test_a_deleted_mesh_is_gone(client):
    content = shapes.obj(shapes.cube(side=3.5))
    mesh = client.upload(content)
    url = f"/v1/meshes/{mesh['id']}"
    reply = client.delete(url)
    assert reply.status_code == 204 and reply.content == b""
    check_problem(client.get(url), 404, "mesh_not_found")
    check_problem(client.delete(url), 404, "mesh_not_found")
    check_problem(client.post("/v1/jobs", json={"type": "hausdorff", "a": mesh["id"], "b": mesh["id"]}), 404)
    assert client.post("/v1/meshes", content=content).status_code == 201


def test_names_are_kept_as_given(client):
    name = "Würfel \"1\" / ü.obj"
    assert client.upload(shapes.obj(shapes.cube(side=4.5)), name=name, format="obj")["name"] == name
    check_problem(client.post("/v1/meshes", params={"name": "a\nb"}, content=b"x"), 400)
    check_problem(client.post("/v1/meshes", params={"name": "n" * 5000}, content=b"x"), 400)


BAD_FILES = [
    ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "index_out_of_range", {"line": 4}),
    ("obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "not_finite", {"line": 2}),
    ("obj", b"v 0 0 0\nv 1e999 0 0\nv 0 1 0\nf 1 2 3\n", "not_finite", {"line": 2}),
    ("obj", b"v 0 0 zero\n", "malformed_file", {"line": 1}),
    ("obj", b"", "empty_mesh", None),
    ("obj", b"# nothing\n", "empty_mesh", None),
    ("off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n", "malformed_file", {"line": None}),
    ("xyz", b"1 2 3\n4 5\n", "malformed_file", {"line": 2}),
    ("pcd", shapes.pcd(shapes.cube())[:-1], "malformed_file", {"offset": None}),
    ("3mf", shapes.threemf(shapes.cube())[:-1], "malformed_file", None),
    ("3mf", shapes.threemf(([(0, 0, 0)], [(0, 0, 1)])), "index_out_of_range", {"line": 1}),
    ("off", b"OFF BINARY\n\0\0\0\1", "malformed_file", {"offset": None}),
    ("stl", shapes.stl_binary(shapes.cube())[:-7], "malformed_file", {"offset": None}),
    ("glb", shapes.glb(shapes.cube())[:-9], "malformed_file", {"offset": None}),
    ("ply", shapes.ply_little(shapes.cube())[:-3], "malformed_file", {"offset": None}),
    ("drc", b"DRACO\2\2\1\1\0\0", "malformed_file", None),
]


@pytest.mark.parametrize("suffix,content,code,place", BAD_FILES)
def test_bad_files_are_refused_with_their_place(client, suffix, content, code, place):
    problem = check_problem(client.post("/v1/meshes", params={"format": suffix}, content=content), 422, code)
    for name, value in (place or {}).items():
        assert name in problem["errors"][0], problem
        assert value is None or problem["errors"][0][name] == value, problem


def test_bad_files_leave_nothing_behind(make_daemon):
    running = make_daemon()
    with running.client() as client:
        for suffix, content, _, _ in BAD_FILES:
            client.post("/v1/meshes", params={"format": suffix}, content=content)
        assert client.get("/v1/meshes").json()["meshes"] == []
    left = [path for path in (running.folder / "data").rglob("*") if path.is_file() and path.stat().st_size > 0]
    assert not [path for path in left if "blobs" in path.parts or "incoming" in path.parts], left


def test_a_format_that_is_not_read_is_named(client):
    for content, name in ((b"# vtk DataFile Version 3.0\n", "VTK"), (b"ISO-10303-21;\n", "STEP"), (b"\x01\x02\x03", "unknown")):
        problem = check_problem(client.post("/v1/meshes", content=content), 422, "unsupported_feature")
        assert name in problem["detail"] and " ply obj" in problem["detail"], problem
