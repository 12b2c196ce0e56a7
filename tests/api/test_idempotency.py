"""Idempotency-Key of what stays: layouts and reconstructions. Those of jobs are with the jobs."""
import shapes
from conftest import check_problem, together
from test_layouts import saddle_layout


def make_once(client, path, key, request):
    return client.post(path, json=request, headers={"Idempotency-Key": key})


def check_once(daemon, path, request, other):
    """A request with a key makes one thing however often it comes, and at the same time; after a restart as well."""
    def make(_):
        with daemon.client() as own:
            return make_once(own, path, "all at once", request)

    replies = together(6, make)
    assert {reply.status_code for reply in replies} == {201}, [reply.text for reply in replies]
    (made,) = {reply.json()["id"] for reply in replies}
    assert {reply.headers["location"] for reply in replies} == {f"{path}/{made}"}
    daemon.stop()
    daemon.start()
    with daemon.client() as client:
        assert make_once(client, path, "all at once", request).json()["id"] == made
        check_problem(make_once(client, path, "all at once", other), 422, "idempotency_mismatch")
        assert make_once(client, path, "another", request).json()["id"] != made
        check_problem(make_once(client, path, "x" * 256, request), 400, "invalid_parameter")
        assert client.delete(f"{path}/{made}").status_code == 204
        assert make_once(client, path, "all at once", other).status_code == 201  # the key went with what it made


def test_one_key_makes_one_layout(make_daemon):
    running = make_daemon()
    with running.client() as client:
        mesh = client.upload(shapes.saddle(4))["id"]
    check_once(running, "/v1/layouts", {"mesh": mesh, **saddle_layout()}, {"mesh": mesh})


def test_one_key_makes_one_reconstruction(make_daemon):
    running = make_daemon()
    with running.client() as client:
        mesh = client.upload(shapes.saddle(24))["id"]
        layout = client.post("/v1/layouts", json={"mesh": mesh, **saddle_layout()}).json()["id"]
    check_once(running, "/v1/reconstructions", {"layout": layout}, {"layout": layout, "pull_curves": False})
    with running.client() as client:
        assert len(client.get("/v1/reconstructions").json()["reconstructions"]) == 2
