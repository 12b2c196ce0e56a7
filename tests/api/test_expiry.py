"""Meshes with a time to live: when they go, what keeps them, and how the time is changed."""
import datetime
import time

import pytest

import shapes
from conftest import SLOW, check_problem

PATIENCE_S = 60  # the daemon looks every few seconds


def is_gone(client, mesh):
    return client.get(f"/v1/meshes/{mesh['id']}").status_code == 404


def wait_until_gone(client, mesh):
    limit = time.monotonic() + PATIENCE_S
    while not is_gone(client, mesh):
        assert time.monotonic() < limit, "the mesh is still there"
        time.sleep(0.2)


def seconds(text):
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()


def set_ttl(client, mesh, ttl, **options):
    return client.patch(f"/v1/meshes/{mesh['id']}", json={"ttl_seconds": ttl}, **options)


def test_a_mesh_goes_when_its_time_is_over(client):
    content = shapes.sphere(0.31)
    mesh = client.upload(content, ttl_seconds=1)
    assert seconds(mesh["expires_at"]) - seconds(mesh["created"]) == pytest.approx(1, abs=5)
    stays = client.upload(shapes.sphere(0.32))
    assert "expires_at" not in stays
    wait_until_gone(client, mesh)
    assert not is_gone(client, stays)
    again = client.upload(content, ttl_seconds=100000)
    assert again["id"] != mesh["id"]
    listed = {m["id"]: m for m in client.get("/v1/meshes", params={"limit": 1000}).json()["meshes"]}
    assert listed[again["id"]] == again and mesh["id"] not in listed


def test_an_upload_of_the_same_bytes_lives_for_the_longer_time(client):
    content = shapes.sphere(0.33)
    short = client.upload(content, ttl_seconds=1000)
    longer = client.upload(content, ttl_seconds=5000)
    assert longer["id"] == short["id"] and longer["expires_at"] > short["expires_at"]
    assert client.upload(content, ttl_seconds=10)["expires_at"] == longer["expires_at"]
    assert "expires_at" not in client.upload(content)
    assert "expires_at" not in client.upload(content, ttl_seconds=10)


def test_the_time_is_changed(client):
    mesh = client.upload(shapes.sphere(0.34), ttl_seconds=1000)
    reply = set_ttl(client, mesh, None)
    assert reply.status_code == 200 and "expires_at" not in reply.json()
    assert client.get(f"/v1/meshes/{mesh['id']}").json() == reply.json()
    assert "expires_at" in set_ttl(client, mesh, 3155760000).json()
    check_problem(set_ttl(client, mesh, 1, headers={"If-Match": '"other"'}), 412, "precondition_failed")
    assert set_ttl(client, mesh, 1, headers={"If-Match": reply.headers["etag"]}).status_code == 200
    wait_until_gone(client, mesh)
    check_problem(set_ttl(client, mesh, 1), 404, "mesh_not_found")


def test_the_time_survives_a_restart(make_daemon):
    daemon = make_daemon()
    with daemon.client() as client:
        stays = client.upload(shapes.sphere(0.31), ttl_seconds=3600)
        goes = client.upload(shapes.sphere(0.32), ttl_seconds=1)
    daemon.stop()
    time.sleep(1)
    daemon.start()
    with daemon.client() as client:
        wait_until_gone(client, goes)
        assert client.get(f"/v1/meshes/{stays['id']}").json()["expires_at"] == stays["expires_at"]


@pytest.mark.parametrize("ttl", [0, -1, 1.5, 3155760001, "1", True, [1]])
def test_other_times_are_refused(client, ttl):
    mesh = client.upload(shapes.sphere(0.35))
    problem = check_problem(set_ttl(client, mesh, ttl), 400, "invalid_field")
    assert problem["errors"][0]["pointer"] == "/ttl_seconds"
    if not isinstance(ttl, (list, bool)):
        reply = client.post("/v1/meshes", params={"ttl_seconds": ttl if ttl != "1" else "1s"}, content=b"v 0 0 0\n")
        check_problem(reply, 400, "invalid_parameter")


def test_other_members_are_refused(client):
    mesh = client.upload(shapes.sphere(0.35))
    for body in ({}, {"name": "other"}, {"ttl_seconds": 1, "name": "other"}):
        check_problem(client.patch(f"/v1/meshes/{mesh['id']}", json=body), 400, "invalid_field")
    assert "expires_at" not in client.get(f"/v1/meshes/{mesh['id']}").json()


def test_jobs_and_layouts_keep_a_mesh(client, slow_files):
    needed = client.upload(shapes.saddle(8), ttl_seconds=1)
    layout = client.post("/v1/layouts", json={"mesh": needed["id"]}).json()
    a, b = (client.upload(content, name="expires", ttl_seconds=1) for content in slow_files)
    job = client.start(a["id"], b["id"], **SLOW)
    probe = client.upload(shapes.sphere(0.36), ttl_seconds=1)
    wait_until_gone(client, probe)
    assert not any(is_gone(client, mesh) for mesh in (needed, a, b))
    client.delete(f"/v1/jobs/{job['id']}")
    client.delete(f"/v1/layouts/{layout['id']}")
    for mesh in (needed, a, b):
        wait_until_gone(client, mesh)
