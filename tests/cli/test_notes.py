"""Units and uncertainty on the command line, in this process and on a daemon."""
import json
import re
import zipfile

import pytest

BOX = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def write_box(path, shift=0.0, side=1.0):
    lines = [f"v {shift + side * x} {side * y} {side * z}" for x, y, z in BOX]
    path.write_text("\n".join(lines + ["f " + " ".join(str(i + 1) for i in face) for face in FACES]) + "\n")
    return path


def write_3mf(path, unit):
    triangles = [(a, b, c) for a, b, c, _ in FACES] + [(a, c, d) for a, _, c, d in FACES]
    model = ('<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"%s><resources><object id="1" type="model">'
             "<mesh><vertices>%s</vertices><triangles>%s</triangles></mesh></object></resources>"
             '<build><item objectid="1"/></build></model>') % (
                 f' unit="{unit}"' if unit else "", "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in BOX),
                 "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in triangles))
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("[Content_Types].xml", '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"/>')
        archive.writestr("_rels/.rels", '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
                         '<Relationship Id="a" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" '
                         'Target="/3D/m.model"/></Relationships>')
        archive.writestr("3D/m.model", model)
    return path


@pytest.fixture
def boxes(tmp_path):
    return write_box(tmp_path / "a.obj"), write_box(tmp_path / "b.obj", 2.0)


@pytest.mark.parametrize("command, truth", [("hausdorff", 2), ("distance", 1), ("deviation", 2), ("compare", 2)])
def test_true_surfaces_have_bounds(quadmesh, boxes, command, truth):
    run = quadmesh(command, *boxes, "--uncertainty", "0.25,0.125")
    low, high = map(float, re.search(r"true +(\S+) to (\S+)", run.stdout).groups())
    assert run.returncode == 0 and truth - 0.3751 < low <= truth - 0.375 and truth + 0.375 <= high < truth + 0.3751
    assert "true surfaces" not in quadmesh(command, *boxes).stdout
    assert quadmesh(command, *boxes, "--uncertainty", "-1").returncode == 2
    assert quadmesh(command, *boxes, "--unit", "furlong").returncode == 2


def test_different_units_are_refused_unless_told(quadmesh, tmp_path, boxes):
    inch, plain = write_3mf(tmp_path / "inch.3mf", "inch"), write_3mf(tmp_path / "plain.3mf", "")
    for command in ("hausdorff", "distance", "deviation", "collide", "compare"):
        run = quadmesh(command, inch, plain)
        assert run.returncode == 2 and "in in" in run.stderr and "mm" in run.stderr, run.stderr
        assert quadmesh(command, inch, plain, "--unit", "mm").returncode in (0, 1)
        assert quadmesh(command, inch, boxes[1]).returncode in (0, 1)
    problem = json.loads(quadmesh("hausdorff", inch, plain, "--json").stdout)
    assert problem["code"] == "units_differ"
    assert quadmesh("check", inch, plain, "--limit", "1").returncode == 2


def test_sizes_that_differ_much_are_doubted(quadmesh, tmp_path, boxes):
    large = write_box(tmp_path / "large.obj", 0.0, 1000.0)
    assert "warning" in quadmesh("hausdorff", boxes[0], large).stdout
    assert "warning" not in quadmesh("hausdorff", *boxes).stdout


def test_a_daemon_is_told(quadmesh, server, boxes):
    run = quadmesh("hausdorff", *boxes, "--json", "--uncertainty", "0.5", "--unit", "cm", "--server", server)
    result = json.loads(run.stdout)
    assert run.returncode == 0 and result["of_true"]["lower"] <= 1 and result["of_true"]["upper"] >= 3
