"""The meshes that are compared: made by formula, and those of a data folder where there is one."""
import dataclasses
import math
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
MADE = ROOT / "build/bench/formula"
FOLDERS = ("pairs/*", "quads", "grids")  # of the data folder
ENDINGS = {".obj", ".ply", ".off", ".stl"}
# In another frame or on another surface than the rest of their folder (see the folder's own README).
STRANGERS = {"bunny/tri_original.ply", "spot/tri_dense.ply"}


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two meshes of one model; measured both ways."""
    model: str
    a: pathlib.Path
    b: pathlib.Path

    def swapped(self):
        return Pair(self.model, self.b, self.a)

    def __str__(self):
        return f"{self.model} {self.a.stem} -> {self.b.stem}"


def data_folder():
    return pathlib.Path(os.environ.get("QM_TEST_DATA", ROOT / "../shared/data"))


def make_spheres():
    """The unit sphere of quads, and the same turned by pi/100: their distance is 1 - cos(pi/100)."""
    paths = []
    for name, turn in (("sphere", 0.0), ("turned", math.pi / 100)):
        path = MADE / f"{name}.off"
        command = [sys.executable, ROOT / "clients/demo/models.py", "sphere", repr(turn), path]
        subprocess.run([str(word) for word in command], check=True)
        paths.append(path)
    return Pair("spheres", *paths)


def write_torus(path, columns, rows, corners):
    """A torus with waves on it, of quads or of triangles."""
    with open(path, "w", encoding="ascii") as out:
        count = columns * rows * (2 if corners == 3 else 1)
        out.write(f"OFF\n{columns * rows} {count} 0\n")
        for i in range(rows):
            v = 2.0 * math.pi * i / rows
            for j in range(columns):
                u = 2.0 * math.pi * j / columns
                tube = 0.4 + 0.03 * math.sin(9.0 * u) * math.cos(5.0 * v)
                ring = 1.0 + tube * math.cos(v)
                out.write(f"{ring * math.cos(u)!r} {ring * math.sin(u)!r} {tube * math.sin(v)!r}\n")
        for i in range(rows):
            for j in range(columns):
                k, below = (j + 1) % columns, (i + 1) % rows * columns
                quad = (i * columns + j, i * columns + k, below + k, below + j)
                faces = [quad] if corners == 4 else [quad[:3], (quad[0], quad[2], quad[3])]
                for face in faces:
                    out.write(" ".join(str(number) for number in (corners, *face)) + "\n")


def make_torus():
    fine, coarse = MADE / "fine.off", MADE / "coarse.off"
    write_torus(fine, 320, 160, 3)
    write_torus(coarse, 128, 64, 4)
    return Pair("torus", fine, coarse)


def make_large():
    """4 million triangles and 350,000 quads of the same torus."""
    MADE.mkdir(parents=True, exist_ok=True)
    fine, coarse = MADE / "large_fine.off", MADE / "large_coarse.off"
    write_torus(fine, 2000, 1000, 3)
    write_torus(coarse, 840, 420, 4)
    return Pair("torus", fine, coarse)


def find_models():
    """Name, triangle meshes and quad meshes of each model of the data folder, if there is one."""
    folder = data_folder() / "pairs"
    for model in sorted(path for path in folder.glob("*") if path.is_dir()):
        meshes = [path for path in sorted(model.iterdir())
                  if path.suffix in ENDINGS and f"{model.name}/{path.name}" not in STRANGERS]
        yield (model.name, [path for path in meshes if path.name.startswith("tri")],
               [path for path in meshes if path.name.startswith("quad")])


def find_pairs():
    """Each model's triangles against each of its quad meshes; the spheres come first."""
    MADE.mkdir(parents=True, exist_ok=True)
    pairs = [Pair(model, fine, coarse) for model, triangles, quads in find_models()
             for fine in triangles for coarse in quads]
    return [make_spheres()] + (pairs or [make_torus()])


def find_remeshed():
    """Each model's triangles against what QuadriFlow made of it at several sizes."""
    return [Pair(model, fine, coarse) for model, triangles, _ in find_models() for fine in triangles
            for coarse in sorted((data_folder() / "quadriflow").glob(f"{model}_*.ply"))]


def find_all(pairs):
    """The meshes of these pairs, all others of their models, and those that stand alone."""
    models = {pair.model for pair in pairs}
    found = {path for folder in FOLDERS for path in data_folder().glob(f"{folder}/*")
             if path.suffix in ENDINGS and (folder != "pairs/*" or path.parent.name in models)}
    return sorted(found | {path for pair in pairs for path in (pair.a, pair.b)}, key=str)
