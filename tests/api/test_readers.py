"""Files against readers that are not ours, trimesh and meshio: what we read of theirs, and what they read of ours.

The corpus of the fuzzer has the rare forms (sparse, quantised, strips, packages in parts); those that trimesh reads are
compared, and the list says which must be among them."""
import io
import json
import struct

import meshio
import networkx
import pytest
import trimesh

import shapes
from conftest import ROOT
from test_content import download

CORPUS = ROOT / "tests/fuzz/corpus"


def key(corners):
    return tuple(sorted(tuple(round(float(x), 4) + 0.0 for x in corner) for corner in corners))


def cut(face):
    return [(face[0], face[i], face[i + 1]) for i in range(1, len(face) - 1)]


def our_triangles(client, mesh):
    """As the daemon has it, by the text of OFF: triangles as sorted corners."""
    lines = download(client, mesh, format="off").text.split("\n")
    vertices, faces = map(int, lines[1].split()[:2])
    places = [tuple(map(float, line.split()[:3])) for line in lines[2:2 + vertices]]
    listed = [list(map(int, line.split()[1:])) for line in lines[2 + vertices:2 + vertices + faces]]
    return sorted(key([places[k] for k in triangle]) for face in listed for triangle in cut(face))


def trimesh_triangles(content, suffix):
    loaded = trimesh.load_scene(io.BytesIO(content), file_type=suffix, process=False, maintain_order=True).to_mesh()
    return sorted(key(corners) for corners in loaded.triangles)


def meshio_triangles(path):
    loaded = meshio.read(path)
    return sorted(key([loaded.points[k] for k in triangle]) for block in loaded.cells
                  if block.type in ("triangle", "quad") for face in block.data for triangle in cut(list(face)))


def check_same(ours, theirs):
    """Triangles without area may be left out by one of the two."""
    def flat(triangle):
        return len(set(triangle)) < 3
    assert [t for t in ours if not flat(t)] == [t for t in theirs if not flat(t)]


WRITERS = {"obj": shapes.obj, "off": shapes.off, "ply": shapes.ply_big, "stl": shapes.stl_binary, "glb": shapes.glb,
           "3mf": shapes.threemf}


@pytest.mark.parametrize("suffix", WRITERS)
def test_files_are_read_as_trimesh_reads_them(client, suffix):
    content = WRITERS[suffix](shapes.rough(9, seed=3))
    mesh = client.upload(content, format=suffix)
    check_same(our_triangles(client, mesh), trimesh_triangles(content, suffix))


def draco_glb(encoded, vertices, corners):
    """A scene of one mesh that KHR_draco_mesh_compression holds; the library numbers attributes from 0."""
    name = "KHR_draco_mesh_compression"
    document = {
        "asset": {"version": "2.0"}, "extensionsUsed": [name], "extensionsRequired": [name],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "translation": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "extensions": {
            name: {"bufferView": 0, "attributes": {"POSITION": 0}}}}]}],
        "accessors": [{"componentType": 5126, "type": "VEC3", "count": vertices},
                      {"componentType": 5125, "type": "SCALAR", "count": corners}],
        "buffers": [{"byteLength": len(encoded)}], "bufferViews": [{"buffer": 0, "byteLength": len(encoded)}]}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    data = encoded + bytes(-len(encoded) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(data), len(text), 0x4E4F534A) + text + \
        struct.pack("<II", len(data), 0x004E4942) + data


def test_draco_in_gltf_is_read_as_trimesh_reads_it(client):
    stl = client.upload(shapes.stl_binary(shapes.rough(9, seed=6)), format="stl")
    encoded = download(client, stl, format="drc").content
    content = draco_glb(encoded, stl["vertices"], 3 * stl["faces"]["triangles"])
    check_same(our_triangles(client, client.upload(content, format="glb")), trimesh_triangles(content, "glb"))


@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "stl", "glb", "3mf"])
def test_trimesh_reads_what_comes_down(client, suffix):
    mesh = client.upload(shapes.rough(9, seed=4))
    check_same(our_triangles(client, mesh), trimesh_triangles(download(client, mesh, format=suffix).content, suffix))


@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "stl"])
def test_meshio_reads_what_comes_down(client, suffix, tmp_path):
    # Its reader of OFF takes triangles only.
    mesh = client.upload(shapes.stl_binary(shapes.rough(9, seed=5)) if suffix == "off" else shapes.ply_little(shapes.rough(9, seed=5)))
    path = tmp_path / f"mesh.{suffix}"
    path.write_bytes(download(client, mesh, format=suffix).content)
    check_same(our_triangles(client, mesh), meshio_triangles(path))


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb"])
def test_trimesh_reads_the_texture_coordinates_of_patches(client, suffix):
    """Of a cube of 6 x 3 x 3 quads: rectangles of square cells, as many as the patches have, which do not overlap."""
    points, faces, index = [], [], {}
    def vertex(place):
        return index.setdefault(place, len(index))
    size = (6, 3, 3)
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        for level in (0, size[axis]):
            for i in range(size[a]):
                for j in range(size[b]):
                    quad = []
                    for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        place = [0, 0, 0]
                        place[axis], place[a], place[b] = level, i + di, j + dj
                        quad.append(vertex(tuple(place)))
                    faces.append(quad if level else quad[::-1])
    points = [list(map(float, place)) for place in index]
    mesh = client.upload((points, faces))
    patches = client.get(f"/v1/meshes/{mesh['id']}/patches").json()["patches"]
    content = download(client, mesh, format=suffix, uv="patches").content
    loaded = trimesh.load(io.BytesIO(content), file_type=suffix, process=False)
    loaded = loaded if isinstance(loaded, trimesh.Trimesh) else list(loaded.geometry.values())[0]
    corners, uv = loaded.triangles, loaded.visual.uv[loaded.faces]
    assert len(corners) == 2 * len(faces) and uv.min() > 0 and uv.max() < 1
    # Counterclockwise in the picture as on the surface, all of one area, with the sides of the cells along the axes.
    (x, y), (z, w) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
    areas = (x * w - y * z) / 2
    side = (2 * areas[0]) ** 0.5
    assert areas.min() == pytest.approx(areas.max(), rel=1e-4) and areas.min() > 0
    # Each point of the surface has its place: equal lengths in space are equal lengths in the picture.
    for k in range(3):
        lengths = ((corners[:, k] - corners[:, k - 1]) ** 2).sum(axis=1) ** 0.5
        drawn = ((uv[:, k] - uv[:, k - 1]) ** 2).sum(axis=1) ** 0.5
        assert abs(drawn / side - lengths).max() < 1e-3
    # The rectangles, by what is connected: as many as patches, with their sizes, apart from each other.
    graph = networkx.Graph()
    for triangle in loaded.faces:
        graph.add_edges_from(zip(triangle, triangle[1:]))
    boxes = []
    for part in networkx.connected_components(graph):
        places = loaded.visual.uv[sorted(part)]
        boxes.append((places.min(axis=0), places.max(axis=0)))
    sizes = sorted(tuple(round(float(x)) for x in (high - low) / side) for low, high in boxes)
    assert sizes == sorted((patch["columns"], patch["rows"]) for patch in patches)
    for n, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:n]:
            assert max((low - other_high).max(), (other_low - high).max()) > 0.4 * side


@pytest.mark.parametrize("suffix", ["ply"])
def test_meshio_reads_texture_coordinates(client, suffix, tmp_path):
    mesh = client.upload(shapes.rough(9, seed=7))
    path = tmp_path / f"mesh.{suffix}"
    path.write_bytes(download(client, mesh, format=suffix, uv="patches").content)
    check_same(our_triangles(client, mesh), meshio_triangles(path))
    loaded = meshio.read(path)
    assert {"s", "t"} <= set(loaded.point_data) and len(loaded.point_data["s"]) == len(loaded.points)


# Of the corpus: what trimesh must be able to read, so that the comparison does not shrink in silence.
COMPARED = {*(f"codec-{name}" for name in (
    "3mf/deflated", "3mf/nested", "3mf/one", "glb/cube", "glb/mixed", "obj/cube", "obj/mixed", "obj/odd",
    "off/colours", "off/cube", "ply/big", "ply/cube", "stl/cube", "stl/mixed", "stl/text"))}


def test_the_corpus_is_read_as_trimesh_reads_it(client):
    compared = set()
    for folder in ("codec-glb", "codec-3mf", "codec-ply", "codec-off", "codec-obj", "codec-stl"):
        suffix = folder.split("-")[1]
        for path in sorted((CORPUS / folder).iterdir()):
            content = path.read_bytes()
            reply = client.post("/v1/meshes", content=content, params={"format": suffix})
            if reply.status_code not in (200, 201) or reply.json()["kind"] == "points":
                continue
            try:
                theirs = trimesh_triangles(content, suffix)
            except Exception as problem:
                print(f"{folder}/{path.name}: trimesh does not read it: {problem!r}")
                continue
            if not theirs:
                print(f"{folder}/{path.name}: trimesh finds no triangle")
                continue
            print(f"{folder}/{path.name}")
            check_same(our_triangles(client, reply.json()), theirs)
            compared.add(f"{folder}/{path.name}")
    print("compared:", sorted(compared))
    assert compared >= COMPARED
