"""The layouts of the data folder on their surfaces and on the point sets sampled from them, and layouts of our own.

Release build: these are whole reconstructions of real models.
"""
import json
import math
import os
import pathlib
import random
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = ROOT / os.environ.get("QM_BUILD", "build")
DATA = pathlib.Path(os.environ.get("QM_TEST_DATA", ROOT / "../shared/data"))
OURS = ROOT / "tests" / "layouts"  # README.md there says how they were made


def run(*words):
    done = subprocess.run([BUILD / "quadmesh", *map(str, words)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def reconstruct(surface, layout, out, *options):
    text = run("reconstruct", DATA / surface, layout, "-o", out, "--json", *options)
    return [json.loads(line) for line in text.splitlines()][:-1]


def distance(a, b, quads):
    text = run("hausdorff", a, b, "--quads", quads, "--tolerance", "1e-4", "--json")
    return json.loads(text)


CASES = [("torus_6x4", "grids/torus_384x192_tris.ply", 1e-3), ("torus_2x2", "clouds/torus_20k.xyz", 1e-3),
         ("torus_2x2", "grids/torus_384x192_tris.ply", 1e-3), ("saddle_3x2", "grids/saddle_200x200_tris.ply", 4e-4),
         ("rounded_box_12_edges", "grids/rounded_box_tris.ply", 2.5e-3),
         ("rounded_box_3x3x3", "grids/rounded_box_tris.ply", 2e-3),
         ("rounded_box_3x3x3", "clouds/rounded_box_20k_points.obj", 2e-3),
         ("spot_coarse", "pairs/spot/tri.obj", 2e-2), ("spot_coarse", "clouds/spot_10k.ascii.ply", 2e-2),
         ("bunny_coarse", "pairs/bunny/tri.obj", 6e-2), ("bunny_coarse_sketched", "pairs/bunny/tri.obj", 6e-2),
         ("bunny_coarse", "clouds/bunny_40k_no_normals.ply", 6e-2),
         ("bunny_coarse", "clouds/bunny_40k_flipped_normals.ply", 6e-2)]


@pytest.mark.parametrize("layout, surface, reach", CASES)
def test_a_layout_becomes_a_semi_regular_mesh(tmp_path, layout, surface, reach):
    file = DATA / "layouts" / f"{layout}.json"
    steps = reconstruct(surface, file, tmp_path / "out.obj", "--quads", 4200)
    found = json.loads(run("info", tmp_path / "out.obj", "--json"))
    assert found["kind"] == "quads" and found["manifold"] and found["faces"]["quads"] == steps[-1]["quads"] <= 4200
    drawn = json.loads(file.read_text())
    degree = [0] * len(drawn["nodes"])
    for curve in drawn["curves"]:
        degree[curve["from"]] += 1
        degree[curve["to"]] += 1
    uses = [sum(patch.count(curve["id"]) for patch in drawn["patches"]) for curve in drawn["curves"]]
    rim = {end for curve, use in zip(drawn["curves"], uses) if use == 1 for end in (curve["from"], curve["to"])}
    irregular = sum(valence != 4 for node, valence in enumerate(degree) if node not in rim)
    assert found["irregular_vertices"] == irregular
    assert found["boundary_edges"] == 0 or rim
    assert all(step["quality"]["folded_quads"] + step["quality"]["turned_quads"] == 0 for step in steps)
    bounds = [step["hausdorff"] for step in steps]
    # A step's distance to a mesh may be cut short by a deadline.
    last = bounds[-1] if surface.startswith("clouds/") else distance(DATA / surface, tmp_path / "out.obj", "triangles")
    assert last["upper_relative"] <= reach
    # Two steps double both directions.
    for before, after in zip(bounds, bounds[2:]):
        assert after["lower_relative"] <= before["upper_relative"] + 2e-3


@pytest.mark.parametrize("layout", ["bunny_coarse", "bunny_coarse_sketched", "spot_coarse"])
def test_no_quad_is_folded_or_upside_down_where_points_are_few(tmp_path, layout):
    """About as many quads as points, or more of them."""
    clouds = ["spot_10k.ascii.ply"] if layout == "spot_coarse" else [
        f"bunny_{name}.ply" for name in ("100k", "40k_no_normals", "40k_noise_0.2pct", "40k_outliers_1pct", "uneven")]
    for cloud in clouds:
        steps = reconstruct("clouds/" + cloud, DATA / f"layouts/{layout}.json", tmp_path / "out.obj", "--quads", 30000,
                            "--no-measure")
        assert steps[-1]["quads"] > 20000
        found = [(step["quality"]["folded_quads"], step["quality"]["turned_quads"]) for step in steps]
        assert found == [(0, 0)] * len(steps), cloud


@pytest.mark.parametrize("layout, surface, counts", [
    ("saddle_3x2", "grids/saddle_200x200_tris.ply", (192, 768, 3072, 12288)),
    ("torus_6x4", "grids/torus_384x192_tris.ply", (768, 3072, 12288, 49152))])
def test_the_distance_falls_by_the_square_of_the_edges(tmp_path, layout, surface, counts):
    """Both directions doubled: about four times nearer, down to a ten-thousandth of the diagonal."""
    file, out, found = DATA / "layouts" / f"{layout}.json", tmp_path / "out.obj", []
    for count in counts:
        steps = reconstruct(surface, file, out, "--quads", count, "--no-measure", "--no-settle")
        assert 0.95 * count <= steps[-1]["quads"] <= count
        text = run("hausdorff", DATA / surface, out, "--tolerance", "2e-6", "--json")
        found.append(json.loads(text))
    assert found[-1]["upper_relative"] < 1e-4
    for before, after in zip(found, found[1:]):
        assert before["upper_relative"] / after["lower_relative"] > 3.5


@pytest.mark.parametrize("model, irregular", [("spot", 100), ("bunny", 22)])
def test_ours_come_nearer_than_an_automatic_quadrangulator(tmp_path, model, irregular):
    tri, automatic, ours = DATA / f"pairs/{model}/tri.obj", DATA / f"pairs/{model}/quad_qf.obj", tmp_path / "ours.obj"
    steps = reconstruct(f"pairs/{model}/tri.obj", OURS / f"{model}.json", ours, "--quads", 8000, "--no-measure")
    found = json.loads(run("info", ours, "--json"))
    assert found["manifold"] and found["boundary_edges"] == 0 and found["irregular_vertices"] == irregular
    count = json.loads(run("info", automatic, "--json"))["faces"]["quads"]
    for quads in ("triangles", "bilinear"):
        theirs = distance(tri, automatic, quads)["lower"] * count / steps[-1]["quads"]
        assert distance(tri, ours, quads)["upper"] < theirs


def test_noise_is_not_followed(tmp_path):
    """Noise of 0.2 % of the diagonal: the mesh is within three times that of the surface it was taken from."""
    torus = tmp_path / "torus.xyz"
    chance = random.Random(3)
    rows = []
    for _ in range(40000):
        u, v = (2 * math.pi * chance.random() for _ in range(2))
        point = ((1 + 0.35 * math.cos(v)) * math.cos(u), (1 + 0.35 * math.cos(v)) * math.sin(u), 0.35 * math.sin(v))
        rows.append("%.9f %.9f %.9f\n" % tuple(x + chance.gauss(0, 0.002 * 3.882) for x in point))
    torus.write_text("".join(rows))
    reconstruct(torus, DATA / "layouts/torus_6x4.json", tmp_path / "out.obj", "--quads", 7000, "--no-measure")
    found = distance(DATA / "grids/torus_384x192_tris.ply", tmp_path / "out.obj", "triangles")
    assert found["upper_relative"] <= 3 * 0.002
