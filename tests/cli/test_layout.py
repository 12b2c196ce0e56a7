"""`quadmesh layout`: a mesh of quads in, a layout out that `reconstruct` takes."""
import json
import math

import shapes


def ball(path, n=6):
    """The quads of a cube, n x n a side, on the unit sphere."""
    points, faces = shapes.gridded_cube(n)
    lengths = [sum(x * x for x in p) ** 0.5 for p in points]
    path.write_bytes(shapes.obj(([tuple(x / length for x in p) for p, length in zip(points, lengths)], faces)))
    return path


def test_quads_become_a_layout_that_reconstruct_takes(quadmesh, tmp_path):
    quads, out, mesh = ball(tmp_path / "ball.obj"), tmp_path / "layout.json", tmp_path / "out.obj"
    run = quadmesh("layout", quads, "-o", out, "--json")
    assert run.returncode == 0, run.stderr
    counts = json.loads(run.stdout)
    assert counts == {"quads": 216, "required_nodes": 8, "regions": counts["regions"], "patches": 6, "issues": []}
    layout = json.loads(out.read_text())
    assert len(layout["nodes"]) == 8 and len(layout["curves"]) == 12 and len(layout["patches"]) == 6
    run = quadmesh("reconstruct", quads, out, "-o", mesh, "--quads", "600")
    assert run.returncode == 0, run.stderr
    assert sum(line.startswith("f ") for line in mesh.read_text().splitlines()) >= 300


def test_a_surface_and_a_number_of_patches_can_be_given(quadmesh, tmp_path):
    quads, fine = ball(tmp_path / "ball.obj"), ball(tmp_path / "fine.obj", 12)
    run = quadmesh("layout", quads, "--surface", fine, "--patches", "24", "-o", "-")
    assert run.returncode == 0, run.stderr
    layout = json.loads(run.stdout)
    assert 12 <= len(layout["patches"]) <= 24
    assert "patches of 216 quads, 8 required nodes" in run.stderr
    assert quadmesh("layout", quads, "-o", "-", "--json").returncode == 2  # one document
    for curve in layout["curves"]:
        for point in curve["points"]:
            assert 0.95 < sum(x * x for x in point) ** 0.5 < 1.0001


def test_what_is_no_mesh_of_quads_is_refused(quadmesh, tmp_path):
    triangle = tmp_path / "triangle.obj"
    triangle.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    run = quadmesh("layout", triangle, "-o", tmp_path / "layout.json")
    assert run.returncode == 2 and "1 of 1 faces are triangles" in run.stderr
    points = tmp_path / "points.xyz"
    points.write_text("0 0 0\n1 0 0\n0 1 1\n")
    run = quadmesh("layout", points, "-o", tmp_path / "layout.json")
    assert run.returncode == 2 and "has no quads" in run.stderr
    run = quadmesh("layout", ball(tmp_path / "ball.obj"))
    assert run.returncode == 2


def test_points_give_a_layout(quadmesh, tmp_path):
    ball(tmp_path / "ball.obj", 24)
    points = [line[2:] for line in (tmp_path / "ball.obj").read_text().splitlines() if line.startswith("v ")]
    (tmp_path / "ball.xyz").write_text("\n".join(points) + "\n")
    run = quadmesh("layout", "ball.xyz", "--auto", "--quads", "400", "-o", "layout.json", "--json")
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["issues"] == []
    run = quadmesh("reconstruct", "ball.xyz", "layout.json", "-o", "quads.obj", "--quads", "600")
    assert run.returncode == 0, run.stderr
    (tmp_path / "line.xyz").write_text("".join(f"{i} 0 0\n" for i in range(50)))
    run = quadmesh("layout", "line.xyz", "--auto", "-o", "layout.json")
    assert run.returncode == 2 and "along lines" in run.stderr


def test_a_surface_alone_gives_a_layout(quadmesh, tmp_path):
    ball(tmp_path / "ball.obj", 12)
    run = quadmesh("layout", "ball.obj", "--auto", "--quads", "400", "-o", "layout.json", "--json")
    assert run.returncode == 0, run.stderr
    counts = json.loads(run.stdout)
    assert counts["issues"] == [] and counts["patches"] == len(json.loads((tmp_path / "layout.json").read_text())["patches"])
    assert 300 <= counts["quads"] <= 500
    run = quadmesh("reconstruct", "ball.obj", "layout.json", "-o", "out.obj", "--quads", "600")
    assert run.returncode == 0, run.stderr
    for wrong in (["--auto", "--surface", "ball.obj"], ["--quads", "400"]):
        run = quadmesh("layout", "ball.obj", "-o", "layout.json", *wrong)
        assert run.returncode == 2 and "--auto" in run.stderr


def box(path):
    """A cube of 12 triangles."""
    corners = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [f"f {a + 1} {b + 1} {c + 1}\nf {a + 1} {c + 1} {d + 1}" for a, b, c, d in sides]
    path.write_text("\n".join([*("v {} {} {}".format(*p) for p in corners), *faces]) + "\n")
    return path


def test_features_become_sharp_curves(quadmesh, tmp_path):
    surface, out, mesh = box(tmp_path / "box.obj"), tmp_path / "layout.json", tmp_path / "out.obj"
    run = quadmesh("layout", surface, "--features", "-o", out, "--json")
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == {"curves": 12, "corners": 8, "patches": 6, "issues": []}
    layout = json.loads(out.read_text())
    assert all(curve["mark"] == "sharp" for curve in layout["curves"]) and len(layout["corners"]) == 8
    run = quadmesh("reconstruct", surface, out, "-o", mesh, "--quads", "600")
    assert run.returncode == 0, run.stderr
    for line in mesh.read_text().splitlines():
        if line.startswith("v "):
            assert any(abs(float(x) - end) < 1e-12 for x in line.split()[1:] for end in (0, 1))
    run = quadmesh("layout", surface, "--features", "--shortest", "50", "-o", out)
    assert run.returncode == 0 and "0 curves along features" in run.stdout
    for wrong in (["--features", "--auto"], ["--features", "--surface", "box.obj"], ["--features", "--patches", "9"],
                  ["--auto", "--shortest", "1"]):
        run = quadmesh("layout", "box.obj", "-o", "layout.json", *wrong)
        assert run.returncode == 2 and "--features" in run.stderr
    run = quadmesh("layout", surface, "--features", "--crease-angle", "0", "-o", out)
    assert run.returncode == 2 and "angle of creases" in run.stderr


def test_both_sides_of_a_plane_are_alike(quadmesh, tmp_path):
    ball_ = ball(tmp_path / "ball.obj", 16)
    for plane in ("found", "0,0,0,0,0,2"):
        run = quadmesh("layout", ball_, "--auto", "--quads", "600", "--symmetry", plane, "-o", tmp_path / "out.json", "--json")
        assert run.returncode == 0 and json.loads(run.stdout)["issues"] == [], run.stderr
    nodes = json.loads((tmp_path / "out.json").read_text())["nodes"]
    assert all(min(math.dist([x, y, -z], other) for other in nodes) < 1e-3 for x, y, z in nodes) and len(nodes) > 6
    for wrong in (["--auto", "--symmetry", "x"], ["--auto", "--symmetry", "0,0,0,0,0,0"], ["--symmetry", "found"]):
        run = quadmesh("layout", ball_, *wrong, "-o", tmp_path / "out.json")
        assert run.returncode == 2 and "--symmetry" in run.stderr
