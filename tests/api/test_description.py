"""The description (proto/openapi.yaml) and the daemon agree: routes, types, examples, problem codes, and what a
generator of requests makes of it.

The generator's seed comes from the clock and is printed; QM_TEST_SEED repeats a run.
"""
import json
import os
import pathlib
import re
import subprocess
import sys
import time

import pytest
import yaml

import shapes
from conftest import BUILD, MET_CODES, PATIENCE, ROOT, WAIT, check_problem

DESCRIPTION = yaml.safe_load((ROOT / "proto/openapi.yaml").read_text())
METHODS = ("get", "post", "put", "patch", "delete")
SEED = int(os.environ.get("QM_TEST_SEED", time.time_ns() % 2**31))
CASES = 5000
# QM_TEST_LONG=1 tries what the configuration says, other runs half of it: at least CASES in any case.
SHARE = 1 if os.environ.get("QM_TEST_LONG", "0") != "0" else 2
GENERATOR_S = 15 * PATIENCE  # a minute or two on a machine that has nothing else to do
# Two runs at the same time, as the generator keeps one processor busy. Together they try every operation.
PARTS = ("--include-path-regex", "--exclude-path-regex")


def operations():
    return {(method.upper(), path): operation for path, item in DESCRIPTION["paths"].items()
            for method, operation in item.items() if method in METHODS}


def routes():
    done = subprocess.run([BUILD / "quadmeshd", "--print-routes"], capture_output=True, text=True, check=True)
    return {tuple(line.split()[:2]): set(line.split()[2:]) for line in done.stdout.splitlines()}


def types(route):
    return {word for word in routes()[route] if not word.startswith("?")}


def test_every_route_is_described_and_every_description_is_served():
    assert set(routes()) == set(operations())


@pytest.mark.parametrize("route", routes(), ids=" ".join)
def test_the_parameters_of_the_query_are_described(route):
    item = DESCRIPTION["paths"][route[1]]
    described = [resolve(one) for one in (*item.get("parameters", []), *operations()[route].get("parameters", []))]
    read = {word[1:] for word in routes()[route] if word.startswith("?")}
    assert {one["name"] for one in described if one["in"] == "query"} == read


def resolve(value):
    while "$ref" in value:
        node = DESCRIPTION
        for part in value["$ref"].removeprefix("#/").split("/"):
            node = node[part]
        value = node
    return value


@pytest.mark.parametrize("route", [route for route in routes() if types(route)], ids=" ".join)
def test_the_types_that_are_offered_are_described(route):
    described = set()
    for status, response in operations()[route]["responses"].items():
        if status.startswith("2"):
            described |= set(resolve(response).get("content", {}))
    # What only sends the client elsewhere has no content of its own.
    only_redirects = all(not status.startswith("2") for status in operations()[route]["responses"])
    assert described == (set() if only_redirects else types(route))


def test_every_refusal_is_a_problem_document():
    for route, operation in operations().items():
        for status, response in operation["responses"].items():
            if status >= "400":
                assert list(resolve(response)["content"]) == ["application/problem+json"], (route, status)


def problems():
    """(status, code) of the daemon's own list."""
    text = (ROOT / "server/ops/problem.h").read_text()
    found = re.findall(r'XX\(\w+, (\d+), "(\w+)",', text)
    assert found
    return {(int(status), code) for status, code in found}


def test_problem_codes_agree():
    described = DESCRIPTION["components"]["schemas"]["ProblemCode"]
    assert {code for _, code in problems()} == set(described["enum"])
    listed = {(int(status), code) for status, codes in re.findall(r"(\d{3})\s+([a-z_, \n]+)", described["description"])
            for code in re.findall(r"[a-z_]+", codes.replace("with", ""))}
    assert listed == problems()


def test_each_problem_has_a_page(client):
    for status, code in problems():
        page = client.get(f"/problems/{code}")
        assert page.status_code == 200 and page.headers["content-type"] == "text/html; charset=utf-8"
        assert f"<code>{code}</code>, status {status}" in page.text and page.text.count("<p>") == 3
    check_problem(client.get("/problems/none"), 404, "not_found")


@pytest.mark.looks_back
def test_every_problem_code_was_met():
    """The daemons of this run have sent each of them but those for faults of the daemon itself and of a shared store. Other
    processes may have tests before them still."""
    wanted = {code for _, code in problems()} - {"internal", "store_unavailable"}
    end = time.monotonic() + PATIENCE
    while wanted - MET_CODES.read() and time.monotonic() < end and "PYTEST_XDIST_WORKER" in os.environ:
        time.sleep(0.1)
    assert wanted - MET_CODES.read() == set()


def test_a_mesh_whose_bytes_are_gone_is_a_fault_of_the_daemon(make_daemon):
    running = make_daemon("--log-level", "error")
    with running.client() as client:
        mesh = client.upload(shapes.cube())["id"]
    running.stop()
    for blob in (running.folder / "data/blobs").rglob("*"):
        if blob.is_file():
            blob.unlink()
    running.start()
    with running.client() as client:
        check_problem(client.get(f"/v1/meshes/{mesh}/content"), 500, "blob_damaged")
        assert client.get("/healthz").status_code == 200


def test_an_array_whose_file_is_gone_is_a_fault_of_the_daemon(make_daemon):
    running = make_daemon("--log-level", "error")
    with running.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        job = client.post("/v1/jobs", json={"type": "deviation", "a": mesh, "b": mesh}, headers={"Prefer": WAIT}).json()["id"]
        (running.folder / f"data/results/{job}.f64").unlink()
        check_problem(client.get(f"/v1/jobs/{job}/result"), 500, "record_damaged")


# ---- examples ----


def examples():
    for (method, path), operation in operations().items():
        for media, content in operation.get("requestBody", {}).get("content", {}).items():
            for name, example in content.get("examples", {}).items():
                yield pytest.param(method, path, media, example["value"], id=f"{path} {name}")


@pytest.mark.parametrize("method, path, media, value", examples())
def test_examples_work(client, spheres, method, path, media, value):
    """With the ids of meshes that are there in place of the made-up ones."""
    text = value if isinstance(value, str) else json.dumps(value)
    for made_up, real in zip(sorted(set(re.findall(r"m_[a-z0-9]{20}", text))), spheres):
        text = text.replace(made_up, real)
    reply = client.request(method, path, content=text, headers={"Content-Type": media, "Prefer": WAIT})
    assert reply.status_code in (200, 201), reply.text
    assert '"failed"' not in reply.text


# ---- generated requests ----


def fill(client):
    """Little meshes of each kind, and a job of each kind about them."""
    files = (shapes.obj(shapes.cube()), shapes.obj(shapes.rough(2, seed=1)), b"0 0 0\n1 2 3\n")
    meshes = [client.post("/v1/meshes", content=file).json()["id"] for file in files]
    requests = ({"type": "hausdorff", "a": meshes[0], "b": meshes[1]},
                {"type": "project", "mesh": meshes[0], "points": [[1, 2, 3]]},
                {"type": "deviation", "a": meshes[1], "b": meshes[0]})
    jobs = [client.post("/v1/jobs", json=request, headers={"Prefer": WAIT}).json()["id"] for request in requests]
    return meshes, jobs


def write_configuration(path):
    text = (ROOT / "tests/api/schemathesis/schemathesis.toml").read_text()
    path.write_text(re.sub(r"(max-examples = )(\d+)", lambda found: f"{found[1]}{int(found[2]) // SHARE}", text))


def start_generator(running, meshes, jobs, place, folder):
    command = [pathlib.Path(sys.executable).parent / "schemathesis",
               "--config-file", folder / "schemathesis.toml", "run", ROOT / "proto/openapi.yaml",
               "-u", running.url, "--seed", str(SEED + place), "--no-shrink",
               PARTS[place], "^/v1/meshes"]
    environment = {**os.environ, "SCHEMATHESIS_HOOKS": "hooks", "QM_MESHES": ",".join(meshes), "QM_JOBS": ",".join(jobs),
                   "QM_SEED": str(SEED + place), "PYTHONPATH": str(ROOT / "tests/api/schemathesis"),
                   "PYTHONHASHSEED": "0", "COLUMNS": "160"}
    return subprocess.Popen(command, cwd=folder, env=environment, text=True, stdout=subprocess.PIPE,
                            stderr=subprocess.STDOUT)


@pytest.mark.timeout(GENERATOR_S + 30)
def test_generated_requests_find_no_fault(make_daemon, tmp_path, capsys):
    running = make_daemon("--log-level", "warn", "--kept-jobs", 100000)
    with running.client() as client:
        meshes, jobs = fill(client)
    with capsys.disabled():
        print(f" schemathesis seed {SEED}", end=" ", flush=True)
    write_configuration(tmp_path / "schemathesis.toml")
    runs = [start_generator(running, meshes, jobs, place, tmp_path) for place in range(len(PARTS))]
    end = time.monotonic() + GENERATOR_S
    try:
        said = [run.communicate(timeout=end - time.monotonic())[0] for run in runs]
    finally:
        for run in runs:
            run.kill()
    with running.client() as client:
        (tmp_path / "metrics").write_text(client.get("/metrics").text)
    cases = sum(int(re.search(r"(\d+) generated", text).group(1)) for text in said if "generated" in text)
    for run, text in zip(runs, said):
        assert run.returncode == 0, f"seed {SEED}\n{text}"
    with capsys.disabled():
        print(f"{cases} cases", end=" ", flush=True)
    assert cases >= CASES, f"seed {SEED}: only {cases} cases"
    assert running.process.poll() is None, running.log()
