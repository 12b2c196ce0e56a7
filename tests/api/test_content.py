"""Meshes downloaded again: every format, what it could not keep, and conditional requests."""
import subprocess

import pytest

import shapes
from conftest import check_problem

FORMATS = {"obj": "model/obj", "ply": "application/x-ply", "off": "application/x-off", "drc": "application/x-draco",
           "stl": "model/stl", "glb": "model/gltf-binary", "3mf": "model/3mf"}
EXACT = ("obj", "ply", "off")


@pytest.fixture(scope="module")
def sphere(daemon):
    with daemon.client() as client:
        return client.upload(shapes.sphere(0.25))


def download(client, mesh, **query):
    reply = client.get(f"/v1/meshes/{mesh['id']}/content", params=query)
    assert reply.status_code == 200, reply.text
    return reply


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_comes_back_as_what_it_says(client, sphere, name):
    reply = download(client, sphere, format=name)
    assert reply.headers["content-type"] == FORMATS[name]
    assert reply.headers["content-disposition"] == f'attachment; filename="{sphere["id"]}.{name}"'
    again = client.upload(reply.content, format=name)
    displacement = float(reply.headers["mesh-displacement"])
    cut = int(reply.headers.get("mesh-cut-faces", 0))
    if name in ("stl", "3mf"):
        assert cut == 4800 and again["faces"] == {"triangles": 9600, "quads": 0, "polygons": 0}
    else:
        assert cut == 0 and again["faces"] == sphere["faces"] and again["vertices"] == sphere["vertices"]
    assert (displacement == 0.0) == (name in EXACT or name == "3mf")
    by_type = client.get(f"/v1/meshes/{sphere['id']}/content", headers={"Accept": FORMATS[name]})
    assert by_type.content == reply.content
    # The distance between the two is no more than what the download said.
    distance = client.hausdorff(sphere["id"], again["id"], tolerance=1e-9)["result"]
    assert distance["lower"] <= displacement


@pytest.mark.parametrize("name", EXACT)
def test_bilinear_patches_come_back_bit_for_bit(client, name):
    mesh = client.upload(shapes.rough(12, seed=5))
    again = client.upload(download(client, mesh, format=name).content, format=name)
    result = client.hausdorff(mesh["id"], again["id"], quads="bilinear", tolerance=1e-3)["result"]
    assert result["lower"] == 0.0
    for key in ("vertices", "faces", "bounding_box"):
        assert mesh[key] == again[key]


def test_what_quantisation_moved_is_told(client, sphere):
    sizes, moved = [], []
    for bits in (8, 11, 16, 20, 24):
        reply = download(client, sphere, format="drc", quantization=bits)
        assert reply.headers["mesh-quantization"] == str(bits)
        moved.append(float(reply.headers["mesh-displacement"]))
        sizes.append(len(reply.content))
        again = client.upload(reply.content)
        assert again["faces"] == sphere["faces"]
        result = client.hausdorff(sphere["id"], again["id"], quads="bilinear", tolerance=1e-4)["result"]
        assert 0.0 < result["lower"] <= moved[-1] < 4.0 / 2**bits + 1e-6
    assert sizes == sorted(sizes) and moved == sorted(moved, reverse=True)


def test_the_library_s_own_tool_finds_the_quads(client, sphere, tmp_path):
    (tmp_path / "sphere.drc").write_bytes(download(client, sphere, format="drc", quantization=14).content)
    subprocess.run(["draco_decoder", "-i", tmp_path / "sphere.drc", "-o", tmp_path / "sphere.obj"], check=True,
                   stdout=subprocess.DEVNULL)
    faces = [line.split() for line in (tmp_path / "sphere.obj").read_text().splitlines() if line.startswith("f ")]
    assert len(faces) == 4800 and all(len(face) == 5 for face in faces)


def test_points_have_their_own_formats(client):
    cloud = client.upload(b"0 0 0\n1 2.5 3\n-4 0.1 1e-30\n", format="xyz")
    assert download(client, cloud, format="xyz").content == b"0 0 0\n1 2.5 3\n-4 0.1 1e-30\n"
    for name in ("obj", "ply", "off", "drc", "glb", "pcd"):
        again = client.upload(download(client, cloud, format=name).content, format=name)
        assert again["kind"] == "points" and again["vertices"] == 3
    for name in ("stl", "3mf"):
        check_problem(client.get(f"/v1/meshes/{cloud['id']}/content?format={name}"), 422, "unsupported_feature")


def test_what_cannot_be_is_refused(client, sphere):
    path = f"/v1/meshes/{sphere['id']}/content"
    check_problem(client.get(path + "?format=pcd"), 422, "unsupported_feature")
    refused = client.get(path + "?format=xyz")
    check_problem(refused, 422, "unsupported_feature")
    assert "etag" not in refused.headers
    for query in ("format=step", "format=drc&quantization=25", "format=drc&quantization=x", "quantization=-1",
                  "format=drc&quantization=", "format=obj&quantization=8"):
        check_problem(client.get(f"{path}?{query}"), 400, "invalid_parameter")
    check_problem(client.get(path, headers={"Accept": "image/png"}), 406, "not_acceptable")
    check_problem(client.get("/v1/meshes/m_none/content"), 404, "mesh_not_found")
    far = client.upload(b"v 0 0 0\nv 1e39 0 0\nv 0 1e39 0\nf 1 2 3\n", format="obj")
    check_problem(client.get(f"/v1/meshes/{far['id']}/content?format=stl"), 422, "scale_out_of_range")
    assert b"1e+39" in download(client, far, format="obj").content


def test_texture_coordinates_have_their_formats(client, sphere):
    for query in ({"format": "off", "uv": "patches"}, {"format": "stl", "uv": "patches"}, {"format": "obj", "uv": "faces"},
                  {"format": "obj", "uv": ""}):
        problem = check_problem(client.get(f"/v1/meshes/{sphere['id']}/content", params=query), 400, "invalid_parameter")
        assert "`uv`" in problem["detail"]
    points = client.upload(b"0 0 0\n1 1 1\n", format="xyz")
    triangles = client.upload(shapes.stl_binary(shapes.saddle(2)), format="stl")
    polygon = client.upload(b"v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 3 0\nv 0 2 0\nf 1 2 3 4 5\nf 1 2 3 4\n", format="obj")
    for mesh, words in ((points, "no quads"), (triangles, "no quads"), (polygon, "five corners")):
        reply = client.get(f"/v1/meshes/{mesh['id']}/content", params={"format": "obj", "uv": "patches"})
        assert words in check_problem(reply, 422, "unsupported_feature")["detail"]
    plain, textured = (client.get(f"/v1/meshes/{sphere['id']}/content", params={"format": "obj", **more})
                       for more in ({}, {"uv": "patches"}))
    assert plain.headers["etag"] != textured.headers["etag"]
    again = client.get(f"/v1/meshes/{sphere['id']}/content", params={"format": "obj", "uv": "patches"},
                       headers={"If-None-Match": textured.headers["etag"]})
    assert again.status_code == 304


@pytest.mark.parametrize("name", ["obj", "ply", "glb"])
def test_files_with_texture_coordinates_come_back(client, sphere, name):
    reply = download(client, sphere, format=name, uv="patches")
    assert name == "obj" or reply.headers["content-length"] == str(len(reply.content))
    again = client.upload(reply.content, format=name)
    assert again["faces"] == sphere["faces"]
    assert (again["vertices"] == sphere["vertices"]) == (name == "obj")
    distance = client.hausdorff(sphere["id"], again["id"], tolerance=1e-9)["result"]
    assert distance["lower"] <= float(reply.headers["mesh-displacement"])


def test_head_of_a_body_without_a_size_ends_with_its_headers(client, sphere):
    """The library would add a last chunk, which is then taken for the next reply on the connection."""
    job = client.hausdorff(sphere["id"], sphere["id"])["id"]
    for path in (f"/v1/meshes/{sphere['id']}/content?format=obj", f"/v1/jobs/{job}/events"):
        for _ in range(3):
            reply = client.head(path)
            assert reply.status_code == 200 and reply.content == b"" and "content-length" not in reply.headers
            assert client.get("/healthz").json() == {"status": "ok"}


def test_head_tells_what_get_sends(client, sphere):
    path = f"/v1/meshes/{sphere['id']}/content"
    for name in ("ply", "stl", "glb", "drc"):
        head, got = client.head(path, params={"format": name}), client.get(path, params={"format": name})
        assert head.status_code == 200 and head.content == b""
        assert int(head.headers["content-length"]) == len(got.content)
        for header in ("etag", "content-type", "mesh-displacement"):
            assert head.headers[header] == got.headers[header]


def test_conditional_downloads(client, sphere):
    path = f"/v1/meshes/{sphere['id']}/content"
    tags = {name: client.head(path, params={"format": name}).headers["etag"] for name in FORMATS}
    tags["coarse"] = client.head(path, params={"format": "drc", "quantization": 8}).headers["etag"]
    assert len(set(tags.values())) == len(tags)
    for known in (tags["obj"], "W/" + tags["obj"], f'"a", {tags["obj"]}, "b"', "*"):
        kept = client.get(path, params={"format": "obj"}, headers={"If-None-Match": known})
        assert kept.status_code == 304 and kept.content == b"" and kept.headers["etag"] == tags["obj"]
    for other in (tags["ply"], "nonsense", '"', tags["obj"][:-1]):
        assert client.get(path, params={"format": "obj"}, headers={"If-None-Match": other}).status_code == 200


def test_a_mesh_is_deleted_only_as_the_one_expected(client):
    path = f"/v1/meshes/{client.upload(shapes.cube(side=41.5))['id']}"
    tag = client.get(path).headers["etag"]
    for wanted in ('"other"', "W/" + tag):
        check_problem(client.delete(path, headers={"If-Match": wanted}), 412, "precondition_failed")
        check_problem(client.get(path, headers={"If-Match": wanted}), 412, "precondition_failed")
    assert client.delete(path, headers={"If-Match": f'"other", {tag}'}).status_code == 204
    check_problem(client.get(path), 404, "mesh_not_found")


def test_a_download_outlives_its_mesh(daemon, client):
    mesh = client.upload(shapes.rough(150, seed=6))
    with daemon.client() as own, own.stream("GET", f"/v1/meshes/{mesh['id']}/content?format=obj") as reply:
        lines = reply.iter_lines()
        next(lines)
        client.delete(f"/v1/meshes/{mesh['id']}")
        assert sum(line.startswith("f ") for line in lines) == 150 * 150
