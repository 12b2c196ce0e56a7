"""Real pairs of a triangle mesh and a quad mesh of the same model, from the folder of collected meshes."""
import hashlib
import json
import os
import pathlib
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("QM_BUILD", ROOT / "build")).resolve()
DATA = pathlib.Path(os.environ.get("QM_TEST_DATA", ROOT / "../shared/data"))
BRACKETS = pathlib.Path(__file__).with_name("brackets.json")
ROUNDINGS = 1e-12  # of the distance: CGAL computes in doubles without a margin


def pairs():
    """Every model's triangles with each of its quad meshes."""
    found = []
    for folder in sorted((DATA / "pairs").iterdir()):
        # tri_original and tri_dense lie in another frame or on another surface than tri.
        triangles = [path for path in folder.glob("tri*") if path.stem in ("tri", "tri_cc3", "tri_400k")]
        found += [(a, b) for a in sorted(triangles) for b in sorted(folder.glob("quad*"))]
    return found


@pytest.mark.parametrize("reading", ["triangles", "bilinear"])
@pytest.mark.parametrize("a,b", pairs(), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_real_pairs_converge(a, b, reading):
    done = subprocess.run([BUILD / "quadmesh", "hausdorff", a, b, "--quads", reading, "--json", "--threads", "2"],
                          capture_output=True, text=True, timeout=110)
    result = json.loads(done.stdout)
    assert done.returncode == 0, result
    assert result["converged"] is True and 0 <= result["lower"] <= result["upper"]
    assert result["upper"] - result["lower"] <= result["gap"] * (1 + 1e-9)
    # Some thousands as a rule: facets that are ranked badly for small pieces have taken a pair to half a million.
    assert result["iterations"] < 60000


def stored():
    """What an independent program said of each pair; brackets.py made the file."""
    return json.loads(BRACKETS.read_text())["brackets"]


@pytest.mark.parametrize("bracket", stored(), ids=lambda bracket: f"{bracket['source']}-{bracket['target']}")
def test_real_pairs_agree_with_an_independent_program(bracket):
    files = json.loads(BRACKETS.read_text())["files"]
    source, target = (DATA / "pairs" / bracket[end] for end in ("source", "target"))
    for path, name in ((source, bracket["source"]), (target, bracket["target"])):
        assert hashlib.sha256(path.read_bytes()).hexdigest() == files[name], f"{name} is another mesh"
    done = subprocess.run([BUILD / "quadmesh", "hausdorff", source, target, "--direction", "a_to_b", "--json"],
                          capture_output=True, text=True, timeout=110)
    result = json.loads(done.stdout)
    assert done.returncode == 0, result
    assert result["lower"] <= bracket["upper"] * (1 + ROUNDINGS)
    assert result["upper"] >= bracket["lower"] * (1 - ROUNDINGS)
