"""The budget of memory counts what requests and files make the daemon allocate, and the system gets it back."""
import json
import pathlib
import struct

import shapes
from api_conftest import check_problem


def wide_glb(count):
    """A file whose JSON part is small, and whose tree is forty times as large: an array of zeros beside an empty scene."""
    text = b'{"asset":{"version":"2.0"},"extras":[' + b"0," * (count - 1) + b"0]}"
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text


def resident(running):
    text = pathlib.Path(f"/proc/{running.process.pid}/status").read_text()
    sizes = {line.split(":")[0]: int(line.split()[1]) << 10 for line in text.splitlines() if line.endswith(" kB")}
    return sizes["VmRSS"], sizes["VmHWM"]


def test_trees_of_json_are_in_the_budget(make_daemon):
    running = make_daemon("--memory-budget", 200_000_000)
    with running.client() as client:
        kept = client.upload(shapes.sphere())["id"]
        client.hausdorff(kept, kept)
        idle, _ = resident(running)
        for _ in range(4):
            check_problem(client.post("/v1/meshes", params={"format": "glb"}, content=wide_glb(7_000_000)), 507, "out_of_memory")
        loaded = [line for line in client.get("/metrics").text.splitlines() if line.startswith("quadmeshd_meshes_loaded ")]
        assert loaded == ["quadmeshd_meshes_loaded 1"], "a file that does not fit must not push out other meshes"
        # A tree that fits is read, and given back.
        assert client.post("/v1/meshes", params={"format": "glb"}, content=wide_glb(300_000)).status_code == 422
        points = {"type": "project", "mesh": kept, "points": [[0, 0, 3]] * 50_000}
        done = client.post("/v1/jobs", json=points, headers={"Prefer": "wait=60"})
        assert done.status_code == 200 and done.json()["state"] == "succeeded"
        now, most = resident(running)
        sanitized = "asan" in str(running.process.args[0])
        if not sanitized:  # it keeps what was freed, to find late uses
            assert most < idle + 250_000_000, (idle, most)
            assert now < idle + 64_000_000, (idle, now)
    assert running.stop() == 0


def test_a_deformation_does_not_fit(make_daemon):
    running = make_daemon("--memory-budget", 100_000_000)
    with running.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        body = b'{"positions":[' + b",".join([b"[0,0,0]"] * 1_500_000) + b"]}"
        check_problem(client.patch(f"/v1/meshes/{mesh}/vertices", content=body,
                                   headers={"Content-Type": "application/json"}), 507, "out_of_memory")
        body = json.dumps({"indices": [0], "positions": [[0, 0, 1]]})
        assert client.patch(f"/v1/meshes/{mesh}/vertices", content=body,
                            headers={"Content-Type": "application/json"}).status_code == 200
