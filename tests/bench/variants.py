"""Pairs that no one has tuned for: a seeded draw from all pairs both ways, one mesh of each pair varied."""
import dataclasses
import math
import pathlib
import random
import subprocess

import measuring
import pairs as meshes
import programs

MADE = programs.OUT / "wide"
# What a mesh is changed by, in words of bench_engine.
CHANGES = {
    "as it is": (),
    "decimated": ("--coarsen", "2"),
    "noisy": ("--noise", "2e-4"),
    "subdivided": ("--refine",),
    "turned 1e-4": ("--turn", "1e-4"),
    "turned 1 degree": ("--turn", repr(math.pi / 180.0)),
}


@dataclasses.dataclass(frozen=True)
class Variant:
    """A pair in one direction with a change of one of its meshes."""
    pair: meshes.Pair
    change: str
    of_b: bool

    def make(self):
        """The changed pair, whose file is written again."""
        words = CHANGES[self.change]
        if not words:
            return self.pair
        path = self.pair.b if self.of_b else self.pair.a
        changed = vary(self.pair.model, path, self.change, words)
        return dataclasses.replace(self.pair, **{"b" if self.of_b else "a": changed})

    def quads_first(self):
        return self.pair.a.stem.startswith("quad") or self.pair.a.parent.name == "quadriflow"

    def kind(self):
        """Which meshes are compared, and which of them was changed how."""
        names = ["quads", "scan"] if self.quads_first() else ["scan", "quads"]
        if CHANGES[self.change]:
            names[self.of_b] += " " + self.change
        return " -> ".join(names)


def vary(model, path, change, words) -> pathlib.Path:
    MADE.mkdir(parents=True, exist_ok=True)
    out = MADE / f"{model}-{path.stem}-{change.replace(' ', '-')}.off"
    subprocess.run([str(word) for word in measuring.engine("vary", path, out, *words)], stdout=subprocess.DEVNULL,
                   check=True)
    return out


def find_all():
    """Every pair, both ways, as it is and with each change of each mesh."""
    both_ways = [way for pair in meshes.find_pairs() + meshes.find_remeshed() for way in (pair, pair.swapped())]
    return [Variant(pair, change, of_b) for pair in both_ways for change in CHANGES
            for of_b in ((False, True) if CHANGES[change] else (False,))]


def draw(count, seed, texts):
    """So many variants of pairs whose names hold one of the texts; the same for a seed on every machine."""
    found = [variant for variant in find_all() if any(text in str(variant.pair) for text in texts)]
    return random.Random(seed).sample(found, min(count, len(found)))
