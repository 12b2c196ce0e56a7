"""`quadmesh layout`: a mesh of quads in, a layout out that `reconstruct` takes."""
import json


def ball(path, n=6):
    """The quads of a cube, n x n a side, on the unit sphere."""
    number, lines, faces = {}, [], []

    def vertex(p):
        if p not in number:
            number[p] = len(number) + 1
            q = [2 * x / n - 1 for x in p]
            length = sum(x * x for x in q) ** 0.5
            lines.append("v {!r} {!r} {!r}".format(*(x / length for x in q)))
        return number[p]

    for axis in range(3):
        for end in (0, n):
            for i in range(n):
                for j in range(n):
                    corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    places = []
                    for u, v in corners if end else corners[::-1]:
                        p = [0, 0, 0]
                        p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3] = end, u, v
                        places.append(vertex(tuple(p)))
                    faces.append("f {} {} {} {}".format(*places))
    path.write_text("\n".join(lines + faces) + "\n")
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
