"""The report of a comparison: what it is, that its figures are those of the job, and what has none."""
import hashlib
import html
import math
import re

import pytest

import shapes
from conftest import WAIT, Daemon, check_problem

FLOOR = ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)])
RAMP = ([(0, 0, 1), (1, 0, 2), (1, 1, 2), (0, 1, 1)], [(0, 1, 2, 3)])


def compare(client, a, b, **fields):
    reply = client.post("/v1/jobs", json={"type": "comparison", "a": a, "b": b, **fields}, headers={"Prefer": WAIT})
    assert reply.status_code == 200, reply.text
    return reply.json()


def read(client, job, **query):
    reply = client.get(f"/v1/jobs/{job['id']}/report", params=query)
    assert reply.status_code == 200, reply.text
    assert reply.headers["content-type"] == "text/html; charset=utf-8"
    return reply


@pytest.fixture(scope="module")
def job(daemon):
    with daemon.client() as client:
        pair = [client.upload(mesh, name=name)["id"] for mesh, name in [(RAMP, "ramp.ply"), (FLOOR, "floor.ply")]]
        return compare(client, *pair, limits=[1, 1.5, 2], worst={"count": 3, "radius": 0.4})


def test_a_report_has_the_figures_of_its_job(client, job):
    page = read(client, job, limit=1.5).text
    found = {(float(lower), float(upper)) for lower, upper in re.findall(r'<td data-lower="([^"]*)" data-upper="([^"]*)">', page)}
    intervals = []

    def collect(value):
        if isinstance(value, dict):
            if "lower" in value and "upper" in value:
                intervals.append((value["lower"], value["upper"]))
            for member in value.values():
                collect(member)
        if isinstance(value, list):
            for member in value:
                collect(member)

    result = job["result"]
    for side in ("a_to_b", "b_to_a"):
        collect(result[side])
    collect({name: value for name, value in result["symmetric"].items() if name != "f_score"})
    collect([score["f"] for score in result["symmetric"]["f_score"]])
    assert len(intervals) > 40 and set(intervals) == found
    assert "Beyond the limit of 1.5" in page and page.count("data:image/png;base64,") >= 12
    for mesh, name in [(RAMP, "ramp.ply"), (FLOOR, "floor.ply")]:
        assert name in page and hashlib.sha256(shapes.ply_little(mesh)).hexdigest() in page


def test_the_verdict_follows_the_limit(client, job):
    for limit, words in [(3, "Within the limit of 3"), (0, "Beyond the limit of 0"), (job["result"]["symmetric"]["hausdorff"]["upper"], "Within")]:
        assert words in read(client, job, limit=limit).text
    assert "No limit was given" in read(client, job).text
    assert read(client, job, range=10).text.count(">10</text>") >= 2


def test_nothing_is_fetched_and_nothing_runs(client, job):
    reply = read(client, job)
    assert "default-src 'none'" in reply.headers["content-security-policy"] and "script" not in reply.headers["content-security-policy"]
    assert reply.headers["x-content-type-options"] == "nosniff"
    assert reply.headers["content-disposition"] == f"inline; filename=\"{job['id']}.html\""
    page = reply.text
    assert "http:" not in page and "https:" not in page and "<script" not in page and "@import" not in page and "url(" not in page
    assert not re.search(r'\s(?:src|srcset|action|on\w+)=', page)


@pytest.mark.parametrize("name", ["</title><script>alert(1)</script>", '"><svg onload=alert(1)>', "&lt;b&gt;", "x" * 199, "\u202efdp.ply", "\u00e4\u4e00\U0001f600"])
def test_names_are_no_markup(client, name):
    a, b = client.upload(RAMP, name=name)["id"], client.upload(FLOOR, name=name)["id"]
    page = read(client, compare(client, a, b)).text
    escaped = html.escape(name).replace("&#x27;", "'")
    assert page.count(f"<bdi>{escaped}</bdi>") == 6
    assert not re.search(r"<(?:script|svg onload)", page)


def test_limits_of_the_sides(client, job):
    inner, outer = (client.upload(shapes.cube(side, (-side / 2,) * 3), name="cube")["id"] for side in (1.0, 1.25))
    found = compare(client, outer, inner, sign="outside")
    assert found["result"]["a_to_b"]["signed"]["outside"]["max"]["lower"] <= math.sqrt(3) / 8
    for query, words in (({"limit_out": 0.25}, "Within the limits"), ({"limit_out": 0.2}, "Beyond the limits"),
                         ({"limit_in": 0}, "Within the limits"), ({"limit_in": 0, "limit_out": 0.2}, "Beyond the limits"),
                         ({"limit": 0.1, "limit_out": 0.25}, "Beyond the limits")):
        assert words in read(client, found, **query).text, query
    # No sides, or none with proof.
    problem = check_problem(client.get(f"/v1/jobs/{job['id']}/report?limit_in=1"), 409, "conflict")
    assert "limit_in" in problem["detail"]
    guessed = compare(client, outer, inner, sign="normal")
    assert "Undecided at the limits" in read(client, guessed, limit_in=9, limit_out=9).text


def test_bad_queries(client, job):
    for query in ["limit_in=-1", "limit_out=nan", "limit=-1", "limit=x", "limit=", "limit=nan", "limit=inf", "limit=1e999", "range=0", "range=-2", "limit=1&limit=2", "scale=3"]:
        check_problem(client.get(f"/v1/jobs/{job['id']}/report?{query}"), 400, "invalid_parameter")
    check_problem(client.get(f"/v1/jobs/{job['id']}/report", headers={"Accept": "application/pdf"}), 406, "not_acceptable")
    check_problem(client.get("/v1/jobs/j_aaaaaaaaaaaaaaaaaaaa/report"), 404, "job_not_found")
    check_problem(client.post(f"/v1/jobs/{job['id']}/report"), 405, "method_not_allowed")


def test_other_jobs_have_none(client, job):
    request = {"type": "hausdorff", "a": job["request"]["a"], "b": job["request"]["b"]}
    other = client.post("/v1/jobs", json=request, headers={"Prefer": WAIT}).json()
    problem = check_problem(client.get(f"/v1/jobs/{other['id']}/report"), 409, "conflict")
    assert "only comparisons" in problem["detail"]


def test_regions_say_what_they_are_beyond(client):
    a, b = client.upload(RAMP, name="has parts")["id"], client.upload(FLOOR, name="below")["id"]
    job = compare(client, a, b, limit=1.5, regions=True)
    region = job["result"]["a_to_b"]["regions"][0]
    page = read(client, job, limit=1.5).text
    assert "Parts of A beyond the limit<" in page and "Parts of B beyond the limit<" in page
    assert f'<td data-lower="{region["area"]["lower"]!r}" data-upper="{region["area"]["upper"]!r}">' in page
    for query in ({"limit": 1.2}, {}):
        page = read(client, job, **query).text
        assert "Parts of A beyond 1.5<" in page and "beyond 1.5, the farthest first" in page and "Parts of A beyond the limit" not in page
    assert "Parts of A" not in read(client, compare(client, a, b, limit=1.5), limit=1.5).text


def test_moved_meshes(client):
    a, b = client.upload(RAMP, name="to move")["id"], client.upload(FLOOR, name="rests")["id"]
    before = compare(client, a, b)
    read(client, before)
    moved = [[x, y, z + 1] for x, y, z in RAMP[0]]
    assert client.patch(f"/v1/meshes/{a}/vertices", json={"positions": moved}).status_code == 200
    problem = check_problem(client.get(f"/v1/jobs/{before['id']}/report"), 409, "conflict")
    assert "moved" in problem["detail"]
    after = compare(client, a, b)
    assert after["id"] != before["id"]
    page = read(client, after, limit=2.5).text
    assert "revision 1" in page and "Beyond the limit of 2.5" in page


def test_deleted_meshes(client):
    a, b = client.upload(RAMP, name="to delete")["id"], client.upload(FLOOR, name="stays")["id"]
    job = compare(client, a, b, accuracy=0.1)
    assert client.delete(f"/v1/meshes/{a}").status_code == 204
    check_problem(client.get(f"/v1/jobs/{job['id']}/report"), 404, "mesh_not_found")


def test_a_report_after_a_restart(tmp_path):
    daemon = Daemon(tmp_path)
    with daemon.client() as client:
        job = compare(client, client.upload(RAMP)["id"], client.upload(FLOOR)["id"])
        before = read(client, job, limit=1).text
    assert daemon.stop() == 0
    daemon.start()
    with daemon.client() as client:
        after = read(client, job, limit=1).text
    assert daemon.stop() == 0
    undated = [re.sub(r"20\d\d-\d\d-\d\dT[\d:.]*Z", "", page) for page in (before, after)]
    assert undated[0] == undated[1]


def test_units_uncertainties_and_meshes_by_content(client):
    mesh = client.upload(RAMP, name="noted", unit="mm", uncertainty=0.25)
    floor = client.upload(FLOOR, name="exact", unit="mm")
    job = compare(client, f"sha256:{mesh['content_hash']}", floor["id"])
    page = read(client, job, limit=2.1).text
    true = job["result"]["symmetric"]["hausdorff"]["of_true"]
    assert f'<td data-lower="{true["lower"]!r}" data-upper="{true["upper"]!r}">' in page
    assert "Distances are in mm" in page and "<td>0.25</td><td>0</td>" in page and ": undecided.</p>" in page


def test_moved_for_the_job(client):
    a, b = client.upload(RAMP, name="posed")["id"], client.upload(FLOOR, name="stays there")["id"]
    transform = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -1, 1]
    page = read(client, compare(client, {"mesh": a, "transform": transform}, b), limit=1.01).text
    assert "Within the limit of 1.01" in page and "<td>1 0 0 0; 0 1 0 0; 0 0 1 -1; 0 0 0 1</td><td>nothing</td>" in page
