"""What is compared: this engine and its peers, those that there are on this machine."""
import dataclasses
import importlib.metadata
import pathlib
import subprocess
import sys
import typing

import child
from pairs import ROOT

PEERS = ROOT / "tests/bench/peers"
OUT = ROOT / "build/bench"
ENVIRONMENT = ROOT / "build/bench-env"
ENGINE = OUT / "bench_engine"


@dataclasses.dataclass(frozen=True)
class Peer:
    """A program that answers `COMMAND hausdorff A B TOLERANCE`, `COMMAND project MESH POINTS`, `COMMAND collide A B` or
    `COMMAND self MESH`, or several of them."""
    name: str
    command: typing.Sequence[object]
    package: str
    hausdorff: str = ""  # what its distance is worth: "guaranteed", "vertices only" or "samples"; "": it has none
    project: str = ""    # "double" or "float"; "": it has none
    collide: str = ""    # what its pairs are worth: "exact" or "rounded"; "": it finds none
    reads: bool = False  # answers `COMMAND files A B TOLERANCE`, the distance between two files, too
    aligns: typing.Sequence[str] = ()  # the words W of `COMMAND W A B MOTIONS` that it answers
    compares: str = ""   # what a sample is measured from in `COMMAND compare A B POINTS SEED LIMIT`: "surface" or "sample"
    self: str = ""       # the same of one mesh with itself; "partly": leaves pairs with a common corner out
    remeshes: bool = False  # answers `COMMAND remesh MESH QUADS OUT` and writes OUT


@dataclasses.dataclass
class Programs:
    peers: list
    versions: dict
    missing: list

    def guaranteed(self):
        return [peer for peer in self.peers if peer.hausdorff == "guaranteed"]

    def estimates(self):
        return [peer for peer in self.peers if peer.hausdorff not in ("", "guaranteed")]

    def reading(self):
        return [peer for peer in self.peers if peer.reads]

    def projecting(self):
        return [peer for peer in self.peers if peer.project]

    def aligning(self):
        return [peer for peer in self.peers if peer.aligns]

    def comparing(self):
        return [peer for peer in self.peers if peer.compares]

    def remeshing(self):
        return [peer for peer in self.peers if peer.remeshes]

    def colliding(self):
        return [peer for peer in self.peers if peer.collide]


def python_peer(name, package, **kinds):
    return Peer(name, (ENVIRONMENT / "bin/python", PEERS / f"peer_{name}.py"), package, **kinds)


PYTHON_PEERS = (
    python_peer("cub", "cascading-upper-bounds", hausdorff="guaranteed", reads=True),
    python_peer("fcpw", "fcpw", project="float"),
    python_peer("igl", "libigl", hausdorff="vertices only", project="double"),
    python_peer("coal", "coal", collide="rounded"),
    python_peer("trueform", "trueform", collide="rounded"),
    python_peer("open3d", "open3d", aligns=("align", "search"), compares="surface"),
    python_peer("meshlab", "pymeshlab", hausdorff="samples", reads=True, compares="surface"),
    python_peer("trimesh", "trimesh", compares="surface"),
    python_peer("pcu", "point-cloud-utils", compares="sample"),
    python_peer("instant", "pynanoinstantmeshes", remeshes=True),
)
COMPILED_PEERS = (
    Peer("cgal", (OUT / "peer_cgal",), "CGAL", hausdorff="guaranteed", project="double", collide="exact",
         self="exact"),
    Peer("embree", (OUT / "peer_embree",), "Embree", project="float"),
    Peer("rtcCollide", (OUT / "peer_embree_collide",), "Embree", collide="rounded", self="partly"),
    Peer("fcl", (OUT / "peer_fcl",), "FCL", collide="rounded"),
)
# Programs of the system, behind a script.
INSTALLED_PEERS = (
    python_peer("cloudcompare", "CloudCompare", aligns=("align",)),
)


def last_words(text):
    """The line that says what went wrong."""
    lines = [line.strip() for line in text.splitlines() if "rror" in line] or text.strip().splitlines() or [""]
    return lines[0]


def make(*targets):
    """Builds in the release configuration; returns what went wrong, "" if nothing."""
    done = subprocess.run(["make", "-s", "-j2", "config=release", *[str(target) for target in targets]], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    return last_words(done.stderr) or f"make ended with {done.returncode}" if done.returncode else ""


def wanted_versions():
    """Package and version of each line that names one."""
    lines = (PEERS / "requirements.txt").read_text(encoding="ascii").splitlines()
    return dict(line.split("==") for line in lines if "==" in line)


def installed_versions():
    folders = [str(path) for path in ENVIRONMENT.glob("lib/python*/site-packages")]
    return {package: found.version for package in wanted_versions()
            for found in importlib.metadata.distributions(name=package, path=folders)}


def make_environment():
    """The peers' own Python packages; returns why one is not there, by package."""
    faults = {}
    if not (ENVIRONMENT / "bin/pip").exists():
        done = subprocess.run([sys.executable, "-m", "venv", ENVIRONMENT], capture_output=True, text=True, check=False)
        if done.returncode:
            return dict.fromkeys(wanted_versions(), last_words(done.stdout + done.stderr))
    there = installed_versions()
    for package, version in wanted_versions().items():
        if there.get(package) == version:
            continue
        done = subprocess.run([ENVIRONMENT / "bin/pip", "install", "--quiet", "--disable-pip-version-check", "--retries", "1",
                               "--only-binary", ":all:", f"{package}=={version}"],
                              capture_output=True, text=True, check=False)
        if done.returncode:
            faults[package] = last_words(done.stderr)
    there = installed_versions()
    for package, version in wanted_versions().items():
        if there.get(package) != version:
            faults.setdefault(package, f"pip did not put it into {ENVIRONMENT}; remove that folder")
    return faults


def find_programs():
    """Builds and installs; ends the run only if this engine itself does not build."""
    fault = make(pathlib.Path("build/bench/bench_engine"), pathlib.Path("build/quadmesh"))
    if fault:
        sys.exit(f"bench: the engine does not build: {fault}")
    programs = Programs([], {}, [])
    faults = make_environment()
    there = installed_versions()
    for peer in PYTHON_PEERS:
        fault = faults.get("numpy") or faults.get(peer.package)
        if fault:
            programs.missing.append(f"{peer.package}: {fault}")
        else:
            programs.peers.append(peer)
            programs.versions[peer.name] = f"{peer.package} {there[peer.package]}"
    for peer in COMPILED_PEERS + INSTALLED_PEERS:
        fault = make(peer.command[0].relative_to(ROOT)) if peer in COMPILED_PEERS else ""
        answer = {"failed": fault} if fault else child.run([*peer.command, "version"])
        if "failed" in answer:
            programs.missing.append(f"{peer.package}: {answer['failed']}")
        else:
            programs.peers.append(peer)
            programs.versions[peer.name] = f"{peer.package} {answer['version']}"
    return programs
