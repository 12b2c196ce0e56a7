"""`quadmesh report`: a page that is one, whose figures are those of `compare`, and whose pictures show what formulas say."""

import hashlib
import json
import math
import os
import random
import re
import subprocess

import pytest
from conftest import write_box, write_torus
from page import Page, hues_of, interval_of, pixels_of

A_SIDE = "from-a_to_b"


def write_sphere(path, radius, count=24, offset=(0, 0, 0)):
    lines = []
    for i in range(count + 1):
        for j in range(2 * count):
            theta, phi = math.pi * i / count, math.pi * j / count
            at = (math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta))
            lines.append("v " + " ".join(repr(offset[k] + radius * at[k]) for k in range(3)))
    for i in range(count):
        for j in range(2 * count):
            a, b = i * 2 * count + j + 1, i * 2 * count + (j + 1) % (2 * count) + 1
            lines.append(f"f {a} {a + 2 * count} {b + 2 * count} {b}")
    path.write_text("\n".join(lines) + "\n")
    return path


def write_plane(path, height, bump=0.0, count=20):
    """The square [0, 1]^2 at a height, with a bump in the middle of one quarter."""
    lines = []
    for i in range(count + 1):
        for j in range(count + 1):
            x, y = i / count, j / count
            lines.append(f"v {x!r} {y!r} {height + bump * math.exp(-200 * ((x - 0.75) ** 2 + (y - 0.25) ** 2))!r}")
    for i in range(count):
        for j in range(count):
            at = i * (count + 1) + j + 1
            lines.append(f"f {at} {at + count + 1} {at + count + 2} {at + 1}")
    path.write_text("\n".join(lines) + "\n")
    return path


def make(quadmesh, tmp_path, *arguments, status=0):
    done = quadmesh("report", *arguments, "-o", "report.html")
    assert done.returncode == status, (done.returncode, done.stdout, done.stderr)
    return Page((tmp_path / "report.html").read_text(encoding="utf-8")).check()


def side_pictures(page, label=A_SIDE):
    return [image for division in page.section(label).all("div") if division.attributes["class"] == "sides" for image in division.all("image")]


def test_the_verdict_and_the_exit_status(quadmesh, square, raised, tmp_path):
    page = make(quadmesh, tmp_path, square, raised, "--limit", 1.5)
    assert "Within the limit of 1.5" in page.verdict().text() and "within" in page.verdict().attributes["class"]
    assert "within the limit" in page.all("title")[0].text()
    page = make(quadmesh, tmp_path, square, raised, "--limit", 0.5, status=1)
    assert "Beyond the limit of 0.5" in page.verdict().text() and "beyond" in page.verdict().attributes["class"]
    page = make(quadmesh, tmp_path, square, raised)
    assert "No limit was given" in page.verdict().text()
    # A gap of 2.8 about a distance of 1.
    torus, other = write_torus(tmp_path / "a.obj", 12, 8, 0.3), write_torus(tmp_path / "b.obj", 13, 9, 0.31)
    compared = json.loads(quadmesh("compare", torus, other, "--json", "--gap", 1.0).stdout)["symmetric"]["hausdorff"]
    if compared["lower"] < compared["upper"]:
        middle = (compared["lower"] + compared["upper"]) / 2
        page = make(quadmesh, tmp_path, torus, other, "--limit", middle, "--gap", 1.0, status=3)
        assert "Undecided" in page.verdict().text()


def test_figures_are_those_of_the_comparison(quadmesh, tmp_path):
    a, b = write_torus(tmp_path / "a.obj", 40, 20, 0.3), write_torus(tmp_path / "b.obj", 41, 21, 0.32)
    done = quadmesh("report", a, b, "--limit", 0.015, "-o", "report.html", "--json")
    result = json.loads(done.stdout)
    page = Page((tmp_path / "report.html").read_text()).check()
    figures = page.figures()
    for label, path in [("Greatest distance (Hausdorff)", "hausdorff"), ("Mean distance", "mean"), ("Root mean square", "rms"), ("Standard deviation", "std")]:
        for side, name in enumerate(["a_to_b", "b_to_a"]):
            assert figures[label][side] == (result[name][path]["lower"], result[name][path]["upper"])
    symmetric = result["symmetric"]
    assert figures["Greatest distance (Hausdorff)"][2] == (symmetric["hausdorff"]["lower"], symmetric["hausdorff"]["upper"])
    assert figures["Chamfer L2: mean squares added"][2] == (symmetric["chamfer"]["l2"]["lower"], symmetric["chamfer"]["l2"]["upper"])
    for i, share in enumerate(result["a_to_b"]["shares"]):
        row = figures[f"Share within {share['limit']:.12g}; both: F-score"]
        assert row[0] == (share["lower"], share["upper"])
        assert row[2] == tuple(symmetric["f_score"][i]["f"][end] for end in ("lower", "upper"))
    for percentile in result["b_to_a"]["percentiles"]:
        assert figures[f"{percentile['percent']:.6g}\N{NO-BREAK SPACE}% are within"][1] == (percentile["lower"], percentile["upper"])
    assert len(figures) == 10 + len(result["a_to_b"]["percentiles"]) + len(result["a_to_b"]["shares"])
    # Whatever is printed holds what it is printed for.
    for cell in page.all("td"):
        numbers = re.findall(r"\d[\d.]*(?:e[+-]\d+)?", cell.text())
        if "data-lower" in cell.attributes:
            times = 100 if "%" in cell.text() else 1
            assert float(numbers[0]) <= times * float(cell.attributes["data-lower"]) * (1 + 1e-15)
            assert float(numbers[-1]) >= times * float(cell.attributes["data-upper"]) * (1 - 1e-15)


def test_files_and_the_command_are_named(quadmesh, square, raised, tmp_path):
    text = make(quadmesh, tmp_path, square, raised, "--limit", 2).all("body")[0].text()
    for path in (square, raised):
        assert path.name in text and hashlib.sha256(path.read_bytes()).hexdigest() in text
    version = quadmesh("--version").stdout.split()[1]
    assert f"quadmesh report {square} {raised} --limit 2 -o report.html" in text and f"quadmeshd {version}" in text
    assert re.search(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d", text)


NAMES = [
    "</title><script>alert(1)</script>.obj", '"><img src=x onerror=alert(1)>.obj', "a&lt;b&amp;.obj", "' onload='x.obj", "-->.obj",
    "\N{RIGHT-TO-LEFT OVERRIDE}jbo.exe.obj", "l\N{LATIN SMALL LETTER A WITH DIAERESIS}ng " + 200 * "x" + ".obj", "new\nline.obj", "%s%n%d.obj", "{{7*7}}.obj", "]]>.obj", "a$(id)`id`.obj",
]


def test_names_are_no_markup(quadmesh, square, tmp_path):
    paths = []
    for i, name in enumerate(NAMES):
        (tmp_path / str(i)).mkdir()
        paths.append(tmp_path / str(i) / name.replace("/", "\N{DIVISION SLASH}"))
        paths[-1].write_bytes(square.read_bytes())
    for a, b in zip(paths[::2], paths[1::2]):
        page = make(quadmesh, tmp_path, a, b, "--limit", 2)
        assert page.all("h1")[0].text() == f"{a.name} (A) against {b.name} (B)"
        assert a.name in page.section("meshes").text() and b.name in page.all("title")[0].text()
    odd = os.fsencode(tmp_path) + b"/bad\xff\x01name.obj"
    with open(odd, "wb") as file:
        file.write(square.read_bytes())
    command = [os.fsencode(quadmesh.program), b"report", odd, os.fsencode(square), b"-o", b"report.html"]
    assert subprocess.run(command, cwd=tmp_path, timeout=60).returncode == 0
    page = Page((tmp_path / "report.html").read_text()).check()
    assert "bad\N{REPLACEMENT CHARACTER}\N{REPLACEMENT CHARACTER}name.obj" in page.all("h1")[0].text()


def test_spheres_have_one_colour(quadmesh, tmp_path):
    inner, outer = write_sphere(tmp_path / "inner.obj", 1.0), write_sphere(tmp_path / "outer.obj", 1.1)
    # Distances from 0.0974 to 0.1: one band of sixteen up to twice the limit.
    page = make(quadmesh, tmp_path, inner, outer, "--limit", 0.12)
    legend = [rect.attributes["fill"] for rect in page.section(A_SIDE).all("svg")[0].all("rect")]
    assert len(legend) == 17
    band = legend[6]
    expected = tuple(int(band[i : i + 2], 16) for i in (1, 3, 5))
    pictures = side_pictures(page)
    assert len(pictures) == 6
    for picture in pictures[::4]:
        rows = pixels_of(picture)
        assert (len(rows), len(rows[0])) == (360, 480)
        covered = [colour for row in rows for colour in row if colour]
        # A disc that fills 0.92 of the height.
        assert abs(len(covered) - math.pi * (0.46 * 360) ** 2) < 0.02 * len(covered)
        hue = max(hues_of(rows), key=hues_of(rows).get)
        assert sum(1 for colour in covered if all(abs(colour[k] * max(expected) - expected[k] * max(colour)) < 3 * 255 for k in range(3))) > 0.99 * len(covered), hue


def test_a_bump_has_the_greatest_colour(quadmesh, tmp_path):
    bump, flat = write_plane(tmp_path / "bump.obj", 0.0, 0.1), write_plane(tmp_path / "flat.obj", 0.0)
    page = make(quadmesh, tmp_path, bump, flat, "--limit", 0.04, status=1)
    # From +z: right is x, up is y. The square fills the picture's height.
    rows = pixels_of(side_pictures(page)[2])
    middle = lambda x, y: rows[round(180 - (y - 0.5) * 0.92 * 360)][round(240 + (x - 0.5) * 0.92 * 360)]
    red, _, blue = middle(0.75, 0.25)
    assert red > blue + 40
    for x, y in [(0.25, 0.25), (0.25, 0.75), (0.75, 0.75), (0.05, 0.05)]:
        red, green, blue = middle(x, y)
        assert blue > red
    # The limit is a dark line round it, at the radius at which the bump is as high as the limit.
    radius = math.sqrt(math.log(0.1 / 0.04) / 200)
    darkest = min(range(100), key=lambda i: sum(middle(0.75 + 0.002 * i, 0.25)))
    assert sum(middle(0.75 + 0.002 * darkest, 0.25)) == 0 and abs(0.002 * darkest - radius) < 0.01


def test_a_coarse_mesh_whose_corners_lie_on_the_other_does_not_look_perfect(quadmesh, tmp_path):
    fine, coarse = write_sphere(tmp_path / "fine.obj", 1.0, 48), write_sphere(tmp_path / "coarse.obj", 1.0, 3)
    page = make(quadmesh, tmp_path, coarse, fine, "--limit", 0.05, status=1)
    covered = [colour for row in pixels_of(side_pictures(page)[0]) for colour in row if colour and sum(colour)]
    assert sum(1 for red, _, blue in covered if red > blue) > 0.2 * len(covered)


def test_worst_places_are_marked_and_listed(quadmesh, tmp_path):
    bump, flat = write_plane(tmp_path / "bump.obj", 0.0, 0.1), write_plane(tmp_path / "flat.obj", 0.0)
    page = make(quadmesh, tmp_path, bump, flat, "--limit", 0.04, "--worst", 3, status=1)
    section = page.section(A_SIDE)
    places = next(table for table in section.all("table"))
    assert [row.all("th")[0].text() for row in places.all("tbody")[0].all("tr")] == ["1", "2", "3"]
    x, y, z = (float(number) for number in re.search(r"\(([^)]*)\)", places.all("tbody")[0].all("td")[1].text()).group(1).split(","))
    assert math.hypot(x - 0.75, y - 0.25) < 1e-5 and abs(z - 0.1) < 1e-5
    figures = [figure for figure in section.all("figure") if figure.all("figcaption")]
    from_above = next(figure for figure in figures if figure.all("figcaption")[0].text() == "A from +z")
    first = [mark for mark in from_above.all("text") if mark.text() == "1"][0]
    circles = from_above.all("circle")
    assert len(circles) == len(from_above.all("text")) == 3
    last = circles[-1].attributes  # The first place is drawn last, over the others.
    assert abs(float(last["cx"]) - (240 + 0.25 * 0.92 * 360)) < 1 and abs(float(last["cy"]) - (180 + 0.25 * 0.92 * 360)) < 1
    assert first and "1, 2, 3" in from_above.all("title")[0].text()
    assert [figure.all("figcaption")[0].text() for figure in figures[-3:]] == ["A: place 1", "A: place 2", "A: place 3"]


def test_regions_are_listed_with_pictures(quadmesh, tmp_path):
    bump, flat = write_plane(tmp_path / "bump.obj", 0.0, 0.1), write_plane(tmp_path / "flat.obj", 0.0)
    page = make(quadmesh, tmp_path, bump, flat, "--limit", 0.04, "--regions", status=1)
    section = page.section(A_SIDE)
    rows = section.all("table")[1].all("tbody")[0].all("tr")
    assert len(rows) == 1 and rows[0].all("td")[0].text() == "yes"
    low, high = (float(rows[0].all("td")[2].attributes[end]) for end in ("data-lower", "data-upper"))
    # Where 0.1 exp(-200 r^2) is above 0.04, seen from above, and the slope adds to it.
    assert low <= high and low > 0.9 * math.pi * math.log(2.5) / 200
    middle = [float(number) for number in rows[0].all("td")[4].text().strip("()").split(",")]
    assert math.hypot(middle[0] - 0.75, middle[1] - 0.25) < 0.01
    captions = [figure.all("figcaption")[0].text() for figure in section.all("figure") if figure.all("figcaption")]
    assert captions[-1] == "A: part 1"
    assert "No part of" in make(quadmesh, tmp_path, flat, flat, "--limit", 0.04, "--regions").section(A_SIDE).text()
    assert quadmesh("report", bump, flat, "--regions", "-o", "report.html").returncode == 2
    points = tmp_path / "points.xyz"
    points.write_text("0 0 0.5\n1 1 0.5\n")
    page = make(quadmesh, tmp_path, points, flat, "--limit", 0.04, "--regions", status=1)
    assert [title.text() for title in page.all("h3") if title.text().startswith("Parts")] == ["Parts of B beyond the limit"]


def test_regions_of_a_daemon_are_the_same(quadmesh, server, tmp_path):
    bump, flat = write_plane(tmp_path / "bump.obj", 0.0, 0.1), write_plane(tmp_path / "flat.obj", 0.0)
    here, there = (make(quadmesh, tmp_path, bump, flat, "--limit", 0.04, "--regions", *where, status=1).section(A_SIDE).text()
                   for where in ([], ["--server", server]))
    assert here == there and "Parts of A beyond the limit" in here


def test_one_scale_and_what_it_ends_with(quadmesh, square, raised, tmp_path):
    def ends(page):
        return [svg.all("text") for svg in page.all("svg") if svg.all("title")[0].text().startswith("Colours of")]

    page = make(quadmesh, tmp_path, square, raised, "--limit", 2, "--range", 8)
    both = [[text.text() for text in legend] for legend in ends(page)]
    assert len(both) == 2 and both[0] == both[1] and both[0][-4:] == ["8", "more", "", "limit"] and "2" in both[0]
    page = make(quadmesh, tmp_path, square, raised)
    assert [text.text() for text in ends(page)[0]][-3:] == ["1.2", "more", ""]
    page = make(quadmesh, tmp_path, square, raised, "--limit", 0, status=1)
    assert "Beyond the limit of 0" in page.verdict().text()


def test_units_and_uncertainties(quadmesh, square, raised, tmp_path):
    page = make(quadmesh, tmp_path, square, raised, "--limit", 1.05, "--unit", "mm", "--uncertainty", "0.1,0.2")
    text = page.verdict().text()
    assert "Within the limit of 1.05" in text and "true surfaces" in text and ": undecided" in text
    low, high = page.figures()["Greatest distance of the true surfaces"][2]
    assert low <= 0.7 <= low + 1e-4 and high - 1e-4 <= 1.3 <= high
    assert "Distances are in mm" in page.all("header")[0].text()
    assert [text.text() for text in page.section(A_SIDE).all("text")].count("distance, mm") == 2
    rows = {row.all("th")[0].text(): [cell.text() for cell in row.all("td")] for row in page.section("meshes").all("tr") if row.all("td")}
    assert rows["Unit"] == ["mm", "mm"] and rows["Uncertainty: the true surface is within"] == ["0.1", "0.2"]


def test_moved_meshes(quadmesh, square, raised, tmp_path):
    (tmp_path / "pose.json").write_text(json.dumps({"transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0.75, 1]}))
    page = make(quadmesh, tmp_path, square, raised, "--limit", 0.3, "--transform", "pose.json")
    rows = {row.all("th")[0].text(): [cell.text() for cell in row.all("td")] for row in page.section("meshes").all("tr") if row.all("td")}
    assert rows["Moved by"] == ["1 0 0 0; 0 1 0 0; 0 0 1 0.75; 0 0 0 1", "nothing"]
    low, high = page.figures()["Greatest distance (Hausdorff)"][2]
    assert low <= 0.25 <= high <= 0.2501
    torus, other = write_torus(tmp_path / "a.obj", 24, 12, 0.3), write_torus(tmp_path / "b.obj", 24, 12, 0.3)
    other.write_text("".join(f"v {float(x) + 3} {y} {z}\n" if kind == "v" else f"{kind} {x} {y} {z}\n" for kind, x, y, z in (line.split(maxsplit=3) for line in other.read_text().splitlines())))
    page = make(quadmesh, tmp_path, torus, other, "--limit", 0.01, "--align")
    assert "Within" in page.verdict().text() and "Moved by" in page.section("meshes").text()


def test_meshes_of_unlike_size_are_a_warning(quadmesh, tmp_path):
    small, large = write_sphere(tmp_path / "small.obj", 1.0, 6), write_sphere(tmp_path / "large.obj", 100.0, 6)
    assert "Warning: " in make(quadmesh, tmp_path, small, large).verdict().text()


def test_a_mesh_against_itself(quadmesh, square, tmp_path):
    page = make(quadmesh, tmp_path, square, square, "--limit", 0)
    figures = page.figures()
    assert figures["Greatest distance (Hausdorff)"] == [(0, 0), (0, 0), (0, 0)]
    assert "Within the limit of 0" in page.verdict().text()


def test_bilinear_quads(quadmesh, tmp_path):
    saddle, flat = tmp_path / "saddle.obj", tmp_path / "flat.obj"
    saddle.write_text("v -1 -1 1\nv 1 -1 -1\nv 1 1 1\nv -1 1 -1\nf 1 2 3 4\n")
    flat.write_text("v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nf 1 2 3 4\n")
    page = make(quadmesh, tmp_path, saddle, flat, "--limit", 0.5, "--quads", "bilinear", status=1)
    assert "bilinear patches" in page.section("meshes").text()
    rows = pixels_of(side_pictures(page)[2])
    for x, y, beyond in [(0.1, 0.1, False), (0.0, 0.9, False), (0.9, 0.9, True), (-0.9, 0.9, True), (0.6, 0.6, False)]:
        red, _, blue = rows[round(180 - y * 0.46 * 360)][round(240 + x * 0.46 * 360)]
        assert (red > blue) == beyond, (x, y)


def write_odd(path, kind, scale, offset, chance):
    """Meshes that are hard to draw."""
    points = [[chance.uniform(-1, 1) for _ in range(3)] for _ in range(12)]
    faces = [[chance.randrange(12) + 1 for _ in range(chance.choice([3, 4]))] for _ in range(8)]
    faces = [face for face in faces if len(set(face)) == len(face)] or [[1, 2, 3]]
    if kind == "needles":
        points[1] = [2 * points[0][k] - points[2][k] for k in range(3)]
        faces = [[1, 2, 3]]
    elif kind == "flat":
        for point in points:
            point[2] = 0.0
    elif kind == "spot":
        points = [list(points[0]) for _ in points]
    elif kind == "points":
        faces = []
    elif kind == "far vertex":
        points.append([1e6, 1e6, 1e6])
    lines = ["v " + " ".join(repr(scale * (x + offset)) for x in point) for point in points]
    if kind == "points":
        path = path.with_suffix(".xyz")
        lines = [line[2:] for line in lines]
    path.write_text("\n".join(lines + ["f " + " ".join(map(str, face)) for face in faces]) + "\n")
    return path


@pytest.mark.parametrize("kind, scale, offset, quads", [
    ("soup", 1e-30, 0, "bilinear"), ("needles", 1, 1e9, "triangles"), ("flat", 1e30, 0, "bilinear"), ("spot", 1, 1e9, "triangles"),
    ("points", 1e-30, 0, "triangles"), ("far vertex", 1, 0, "bilinear")])
def test_odd_meshes_have_reports(quadmesh, tmp_path, kind, scale, offset, quads):
    chance = random.Random(kind)
    a, b = write_odd(tmp_path / "a.obj", kind, scale, offset, chance), write_odd(tmp_path / "b.obj", "soup", scale, offset, chance)
    done = quadmesh("report", a, b, "--quads", quads, "--accuracy", 0.1, "-o", "report.html")
    assert done.returncode in (0, 3), (kind, done.stderr)
    page = Page((tmp_path / "report.html").read_text()).check()
    for label in (A_SIDE, "from-b_to_a"):
        assert any(colour for row in pixels_of(side_pictures(page, label)[0]) for colour in row), (kind, label)


def test_a_report_of_a_daemon_is_the_same(quadmesh, server, square, raised, tmp_path):
    here = make(quadmesh, tmp_path, square, raised, "--limit", 0.5, status=1)
    there = make(quadmesh, tmp_path, square, raised, "--limit", 0.5, "--server", server, status=1)
    assert here.figures() == there.figures() and here.verdict().text() == there.verdict().text()
    assert [image.attributes["href"] for image in here.all("image")] == [image.attributes["href"] for image in there.all("image")]


def test_standard_output_and_bad_input(quadmesh, square, raised, tmp_path):
    done = quadmesh("report", square, raised, "-o", "-")
    assert done.returncode == 0 and done.stdout.startswith("<!DOCTYPE html>")
    Page(done.stdout).check()
    done = quadmesh("report", square, raised)
    assert done.returncode == 2 and "-o" in done.stderr
    done = quadmesh("report", square, raised, "-o", "no/such/report.html")
    assert done.returncode == 2 and "report.html: cannot be written" in done.stderr
    done = quadmesh("report", square, tmp_path / "none.obj", "-o", "report.html")
    assert done.returncode == 2 and "none.obj" in done.stderr and not (tmp_path / "report.html").exists()
    for bad in [("--limit", "-1"), ("--limit", "x"), ("--range", "0"), ("--worst", "0")]:
        assert quadmesh("report", square, raised, "-o", "report.html", *bad).returncode == 2


def test_no_libspng_is_a_problem_that_says_so(quadmesh, square, raised, tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "libspng.so.0").write_text("no library")
    done = quadmesh("report", square, raised, "-o", "report.html", env=os.environ | {"LD_LIBRARY_PATH": str(tmp_path / "lib")})
    assert done.returncode == 2 and "libspng" in done.stderr and not (tmp_path / "report.html").exists()


def signed_table(page, label, caption):
    for table in page.section(label).all("table"):
        if table.all("caption")[0].text().startswith(caption):
            return {row.all("th")[0].text(): interval_of(row.all("td")[0]) for row in table.all("tbody")[0].all("tr")}
    return None


def test_sides_and_bands(quadmesh, tmp_path, where):
    """All of the smaller cube is a quarter inside of the larger; figures are those of the result."""
    a, b = write_box(tmp_path / "a.obj", 0.75), write_box(tmp_path / "b.obj", 1.0)
    done = quadmesh("report", a, b, "--limit", 0.5, "--bands", ":-0.3,-0.3:-0.2,-0.1:0.1,0.2:", "-o", "report.html", "--json", *where)
    result = json.loads(done.stdout)
    assert done.returncode == 0 and result["a_to_b"]["signed"]["sign"] == "outside"
    page = Page((tmp_path / "report.html").read_text()).check()
    bands = signed_table(page, A_SIDE, "Share of A in each band")
    assert list(bands) == ["below -0.3", "-0.3 to -0.2", "-0.1 to 0.1", "above 0.2"]
    for (lower, upper), share in zip(bands.values(), (0, 1, 0, 0), strict=True):
        assert lower <= share <= upper
    figures = signed_table(page, A_SIDE, "Signed figures of A")
    for label, value, path in (("Mean signed distance", -0.25, ["mean"]), ("Greatest distance inside", 0.25, ["inside", "max"]),
                               ("Greatest distance outside", 0, ["outside", "max"]), ("Area, or count, inside", 13.5, ["inside", "size"])):
        found = result["a_to_b"]["signed"]
        for member in path:
            found = found[member]
        assert figures[label] == (found["lower"], found["upper"]) and figures[label][0] <= value <= figures[label][1]
    assert signed_table(page, "from-b_to_a", "Signed figures of B")["Greatest distance inside"] == (0, 0)
    assert "The sides are proven" in page.section(A_SIDE).text()


def test_sides_that_are_not_known(quadmesh, tmp_path, where):
    opened, b = write_box(tmp_path / "a.obj", 0.75, faces=5), write_box(tmp_path / "b.obj", 1.0)
    done = quadmesh("report", opened, b, "--sign", "inside", "-o", "report.html", *where)
    page = Page((tmp_path / "report.html").read_text()).check()
    assert done.returncode == 0 and "Distances inside of B are positive" in page.section(A_SIDE).text()
    assert "The sides of B are not known, as A is open." in page.section("from-b_to_a").text()
    done = quadmesh("report", b, opened, "--sign", "outside", "-o", "open.html", *where)
    assert done.returncode == 2 and "is open" in done.stderr and not (tmp_path / "open.html").exists()
    done = quadmesh("report", b, opened, "--sign", "normal", "-o", "report.html", *where)
    assert done.returncode == 0 and "not proven" in Page((tmp_path / "report.html").read_text()).check().section(A_SIDE).text()
    done = quadmesh("report", b, b, "-o", "report.html", *where)
    assert done.returncode == 0 and "On which side" not in Page((tmp_path / "report.html").read_text()).check().root.text()
    done = quadmesh("check", "b.obj", "b.obj", "--limit-in", 0.1, "--report", "check.html", *where)
    page = Page((tmp_path / "check.html").read_text()).check()
    assert "above -0.1" in page.section(A_SIDE).text() and "Within the limits" in page.verdict().text()


def test_limits_of_the_sides_are_judged(quadmesh, tmp_path, where):
    a, b = write_box(tmp_path / "a.obj", 1.25), write_box(tmp_path / "b.obj", 1.0)
    for limits, status, word in ((["--limit-out", 0.5], 0, "within"), (["--limit-out", 0.4, "--limit-in", 0], 1, "beyond"),
                                 (["--limit-in", 0, "--sign", "inside"], 0, "within"),
                                 (["--limit-out", 0.5, "--sign", "normal"], 3, "undecided")):
        done = quadmesh("report", a, b, *limits, "-o", "report.html", *where)
        assert done.returncode == status and done.stdout.startswith(word + ", limit "), (limits, done)
        page = Page((tmp_path / "report.html").read_text()).check()
        assert word.capitalize() in page.verdict().text() and "in each band of signed distance" in page.section(A_SIDE).text()
