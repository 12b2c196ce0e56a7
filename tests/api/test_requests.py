"""HTTP itself: methods, media types, sizes, two lengths in one request, and the daemon's reports of its state."""
import contextlib
import gzip
import hashlib
import json
import socket
import threading

import httpx
import pytest

import shapes
from conftest import MET_CODES, check_problem

METHODS = [
    ("PUT", "/v1/meshes", {"GET", "HEAD", "POST"}), ("PATCH", "/v1/jobs", {"GET", "HEAD", "POST"}),
    ("POST", "/v1/meshes/m_1", {"GET", "HEAD", "DELETE", "PATCH"}), ("POST", "/healthz", {"GET", "HEAD"}),
    ("DELETE", "/v1/info", {"GET", "HEAD"}), ("PUT", "/v1/jobs/j_1/events", {"GET", "HEAD"}),
]


@pytest.mark.parametrize("method,path,allowed", METHODS)
def test_wrong_methods(client, method, path, allowed):
    reply = client.request(method, path)
    check_problem(reply, 405, "method_not_allowed")
    assert {name.strip() for name in reply.headers["allow"].split(",")} == allowed


@pytest.mark.parametrize("path", ["/v1", "/v1/", "/v2/meshes", "/v1/meshes/", "/v1/meshes/a/b", "/v1/jobs/%00",
                                  "/v1/meshes/..%2f..%2fetc%2fpasswd", "/dashboard/../quadmeshd", "/v1/jobs/" + "x" * 3000])
def test_unknown_paths(client, path):
    check_problem(client.get(path), 404)


ACCEPT = [("GET", "/v1/info", "text/html"), ("GET", "/v1/meshes", "image/png"), ("GET", "/v1/jobs", "text/csv"),
          ("POST", "/v1/jobs", "text/html")]


@pytest.mark.parametrize("method,path,accept", ACCEPT)
def test_not_acceptable(client, spheres, method, path, accept):
    body = {"json": {"type": "hausdorff", "a": spheres[0], "b": spheres[1]}} if method == "POST" else {}
    check_problem(client.request(method, path, headers={"Accept": accept}, **body), 406, "not_acceptable")


def test_events_not_acceptable(client, spheres):
    job = client.hausdorff(*spheres)
    check_problem(client.get(f"/v1/jobs/{job['id']}/events", headers={"Accept": "image/png"}), 406)


@pytest.mark.parametrize("accept", ["*/*", "application/*", "text/html, application/json;q=0.5"])
def test_acceptable(client, accept):
    assert client.get("/v1/info", headers={"Accept": accept}).status_code == 200


@pytest.mark.parametrize("media_type", ["image/png", "application/json", "multipart/form-data; boundary=x"])
def test_media_types_of_uploads(client, media_type):
    reply = client.post("/v1/meshes", content=b"v 0 0 0", headers={"Content-Type": media_type})
    check_problem(reply, 415, "unsupported_media_type")


def test_media_type_of_jobs(client):
    check_problem(client.post("/v1/jobs", content=b"{}", headers={"Content-Type": "text/xml"}), 415)


@pytest.mark.parametrize("path, fault", [
    ("/v1/meshes?limt=3", "`limt` is not a parameter"), ("/v1/meshes?Limit=3", "`Limit` is not a parameter"),
    ("/v1/jobs/j_1?wait", "`wait` is not a parameter"), ("/v1/jobs?limit=3&limit=4", "`limit` is given more than once"),
    ("/v1/info?%22%0a%ff", '`"\n\ufffd` is not a parameter')])
def test_slips_in_the_query_are_told(client, path, fault):
    assert check_problem(client.get(path), 400, "invalid_parameter")["detail"].startswith(fault)


@pytest.mark.parametrize("path", ["/v1/meshes?", "/v1/meshes?&limit=3&&", "/healthz?x=1", "/readyz?x=1", "/metrics?x=1", "/?job=j_1"])
def test_nothing_is_wrong_with_these_queries(client, path):
    assert client.get(path).status_code == 200


def test_packed_bodies_of_others_are_refused(client):
    content = shapes.obj(shapes.cube(side=7.25))
    for path in ("/v1/jobs", "/v1/layouts"):
        reply = client.post(path, content=gzip.compress(content), headers={"Content-Encoding": "gzip"})
        check_problem(reply, 415, "unsupported_media_type")
        assert reply.headers["Accept-Encoding"] == "identity"
    for encoding in ("br", "gzip, gzip", "deflate", ""):
        reply = client.post("/v1/meshes", content=gzip.compress(content), headers={"Content-Encoding": encoding})
        assert "gzip or identity" in check_problem(reply, 415, "unsupported_media_type")["detail"]
        assert reply.headers["Accept-Encoding"] == "gzip"
    assert client.post("/v1/meshes", content=content, headers={"Content-Encoding": "identity"}).status_code == 201


@pytest.mark.parametrize("headers, name", [
    ({"Content-Encoding": "gzip"}, ""), ({"Content-Encoding": "X-GZIP", "Content-Type": "model/obj"}, ""), ({}, "packed.obj.gz"),
    ({}, "")])
def test_packed_uploads(client, headers, name):
    content = shapes.obj(shapes.cube(side=7.5))
    packed = gzip.compress(content[:50]) + gzip.compress(content[50:] + f"# {headers} {name}".encode())
    reply = client.post("/v1/meshes", params={"name": name}, content=packed, headers=headers)
    assert reply.status_code == 201, reply.text
    mesh = reply.json()
    assert (mesh["vertices"], mesh["format"], mesh["size_bytes"]) == (8, "obj", len(packed))
    assert mesh["content_hash"] == hashlib.sha256(packed).hexdigest()
    again = client.post("/v1/meshes", params={"name": name}, content=packed, headers=headers)
    assert (again.status_code, again.json()["id"]) == (200, mesh["id"])
    assert b"\nv " in client.get(f"/v1/meshes/{mesh['id']}/content", params={"format": "obj"}).content


def test_a_packed_mesh_outlives_the_daemon(make_daemon):
    daemon = make_daemon()
    with daemon.client() as client:
        mesh = client.post("/v1/meshes", params={"name": "a.obj.gz"}, content=gzip.compress(shapes.obj(shapes.cube(side=7.75)))).json()
    daemon.stop()
    daemon.start()
    with daemon.client() as client:
        assert client.get(f"/v1/meshes/{mesh['id']}").json() == mesh
        assert client.get(f"/v1/meshes/{mesh['id']}/content").status_code == 200


def test_damaged_gzip_data(client):
    packed = gzip.compress(shapes.obj(shapes.cube(side=7.25)))
    problem = check_problem(client.post("/v1/meshes", content=packed[:60]), 422, "malformed_file")
    assert problem["detail"] == "the gzip data ends early at byte 60"
    assert problem["errors"][0]["offset"] == 60
    problem = check_problem(client.post("/v1/meshes", content=packed + b"more"), 422, "malformed_file")
    assert f"at byte {len(packed)}" in problem["detail"]
    reply = client.post("/v1/meshes", content=b"v 0 0 0", headers={"Content-Encoding": "gzip"})
    assert "does not start like gzip data" in check_problem(reply, 422, "malformed_file")["detail"]


def test_gzip_bombs(make_daemon):
    bomb = gzip.compress(b"v 0 0 0\n" * 4_000_000)
    with make_daemon("--max-body", 100_000).client() as client:
        problem = check_problem(client.post("/v1/meshes", content=bomb), 413, "too_large")
        assert problem["detail"] == "the gzip data inflates to more than 100000 bytes"
    with make_daemon("--memory-budget", 10_000_000).client() as client:
        check_problem(client.post("/v1/meshes", content=bomb), 507, "out_of_memory")


def test_empty_bodies_are_called_so(client):
    for path in ("/v1/jobs", "/v1/layouts", "/v1/reconstructions"):
        assert "the body is empty" in check_problem(client.post(path), 400, "malformed_json")["detail"]


def test_unknown_format_parameter(client):
    check_problem(client.post("/v1/meshes", params={"format": "step"}, content=b"v 0 0 0"), 400, "invalid_parameter")


def test_too_large_bodies(make_daemon):
    with make_daemon("--max-body", 5000).client() as client:
        small = shapes.obj(shapes.cube())
        assert client.post("/v1/meshes", content=small).status_code == 201
        check_problem(client.post("/v1/meshes", content=b"x" * 5001), 413, "too_large")
        # Without a length the daemon finds out on the way; an answer or a cut connection are both fine.
        try:
            check_problem(client.post("/v1/meshes", content=(b"x" * 1000 for _ in range(50))), 413)
        except httpx.TransportError:
            pass
        check_problem(client.post("/v1/jobs", content=b" " * (2 << 20)), 413)
        assert client.post("/v1/meshes", content=small).status_code == 200


def test_too_many_faces(make_daemon):
    with make_daemon("--max-faces", 100).client() as client:
        assert client.post("/v1/meshes", content=shapes.obj(shapes.cube())).status_code == 201
        check_problem(client.post("/v1/meshes", content=shapes.obj(shapes.saddle(20))), 413, "too_large")


# ---- by hand ----


def talk(daemon, text, whole=True):
    """Sends bytes as they are and returns all that comes back until the daemon closes or falls silent."""
    with socket.create_connection(("127.0.0.1", daemon.port), timeout=5) as connection:
        received = b""
        try:
            connection.sendall(text)
            if whole:
                connection.shutdown(socket.SHUT_WR)
            while chunk := connection.recv(65536):
                received += chunk
        except OSError:
            pass
        return received


SMUGGLED = (b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n"
            b"0\r\n\r\nGET /v1/info HTTP/1.1\r\nHost: localhost\r\n\r\n")


def test_two_lengths_are_refused(daemon):
    answer = talk(daemon, SMUGGLED)
    assert answer.startswith(b"HTTP/1.1 400") and b'"code":"ambiguous_length"' in answer
    MET_CODES.add("ambiguous_length")
    assert answer.count(b"HTTP/1.1 ") == 1, "the text behind it is not taken for a second request"


def test_other_transfer_codings_are_refused(daemon):
    answer = talk(daemon, b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n")
    assert answer.startswith(b"HTTP/1.1 400")


NONSENSE = [b"\r\n\r\n", b"GET\r\n\r\n", b"\0" * 5000, b"GET / HTTP/9.9\r\n\r\n", b"A" * 300000,
            b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
            b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999999999999999\r\n\r\n",
            b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
            b"GET /v1/info HTTP/1.1\r\n" + b"X: y\r\n" * 50000 + b"\r\n"]


@pytest.mark.parametrize("text", NONSENSE, ids=range(len(NONSENSE)))
def test_nonsense_hurts_nobody(daemon, client, text):
    answer = talk(daemon, text)
    assert b"HTTP/1.1 2" not in answer
    assert client.get("/healthz").status_code == 200


def test_an_upload_that_breaks_off_leaves_nothing(make_daemon):
    running = make_daemon()
    head = b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n"
    talk(running, head + b"v 0 0 0\n" * 1000)
    with running.client() as client:
        assert client.get("/v1/meshes").json()["meshes"] == []
    assert running.stop() == 0
    assert not [path for path in (running.folder / "data" / "incoming").rglob("*") if path.is_file()]


def test_http_1_0(daemon, spheres):
    body = json.dumps({"type": "hausdorff", "a": spheres[0], "b": spheres[1]}).encode()
    answer = talk(daemon, b"POST /v1/jobs HTTP/1.0\r\nAccept: application/x-ndjson\r\nContent-Length: "
                  + str(len(body)).encode() + b"\r\n\r\n" + body, whole=False)
    head, _, events = answer.partition(b"\r\n\r\n")
    assert b" 200 " in head.splitlines()[0] and b"chunked" not in head
    assert json.loads(events.splitlines()[-1])["event"] == "result"


def test_many_clients_at_once(daemon):
    failures = []

    def ask(number):
        with daemon.client() as client:
            mesh = client.upload(shapes.cube(side=1 + number % 4))
            job = client.hausdorff(mesh["id"], mesh["id"], tolerance=1e-3)
            if job["result"]["lower"] != 0 or client.get("/healthz").status_code != 200:
                failures.append(number)

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(24)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures


# ---- reports of its state ----


def test_health(client):
    assert client.get("/healthz").status_code == 200
    assert client.get("/readyz").status_code == 200


def test_info(client):
    info = client.get("/v1/info").json()
    assert info["version"].count(".") == 2
    assert {"obj", "ply", "stl", "off", "glb", "drc", "xyz"} <= set(info["formats"])
    assert info["kernel"] in ("portable", "avx2", "avx512")
    assert info["jobs"][:2] == ["hausdorff", "project"]
    assert info["limits"]["body_bytes"] > 0 and info["limits"]["faces"] > 0


def test_the_description_and_the_page_are_served(client):
    assert client.get("/openapi.yaml").text.startswith("openapi: 3.1")
    page = client.get("/")
    assert page.status_code == 200 and "text/html" in page.headers["content-type"]


def test_replies_may_not_be_guessed_at(client):
    for path in ("/v1/info", "/", "/v1/none"):
        assert client.get(path).headers["x-content-type-options"] == "nosniff"


def test_strict_bodies_refuse_unknown_members(client):
    """Each body that the description calls strict (additionalProperties: false)."""
    mesh = client.upload(shapes.saddle(8))["id"]
    layout = client.post("/v1/layouts", json={"mesh": mesh}).json()["id"]
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    stroke = {"points": [[1, 1], [9, 9]], "view": matrix, "projection": matrix, "viewport": [0, 0, 10, 10]}
    for path, body in (("/v1/layouts", {"mesh": mesh}),
                       (f"/v1/layouts/{layout}/strokes", stroke),
                       (f"/v1/layouts/{layout}/curves/0/split", {"point": [0, 0, 0]}),
                       (f"/v1/layouts/{layout}/curves/0/snap", {"end": "from", "point": [0, 0, 0]}),
                       (f"/v1/layouts/{layout}/curves/0/redraw", {"points": [[0, 0, 0], [1, 0, 0]]}),
                       (f"/v1/layouts/{layout}/curves/merge", {"first": 0, "second": 1}),
                       ("/v1/reconstructions", {"layout": layout}),
                       ("/v1/jobs", {"type": "reconstruction_step", "reconstruction": "r_1"}),
                       ("/v1/jobs", {"type": "remesh", "mesh": mesh}),
                       ("/v1/jobs", {"type": "distance", "a": mesh, "b": mesh})):
        problem = check_problem(client.post(path, json={**body, "nonsense": 1}), 400)
        assert "nonsense" in str(problem), (path, problem)
    problem = check_problem(client.post("/v1/jobs", json={"type": "reconstruction_step", "reconstruction": "r_1",
                                                          "until": {"nonsense": 1}}), 400)
    assert problem["errors"][0]["pointer"] == "/until"


LIBRARY = [
    (b"GET /v1/info HTTP/7.1\r\nHost: localhost\r\n\r\n", 505, "unsupported_version"),
    (b"GET /v1/info?" + b"a" * (1 << 20) + b" HTTP/1.1\r\nHost: localhost\r\n\r\n", 414, "uri_too_long"),
    (b"GET /v1/info HTTP/1.1\r\nHost: localhost\r\n" + b"X: y\r\n" * (1 << 17) + b"\r\n", 431, "headers_too_large"),
    (b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n", 400, "malformed_request"),
    (b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffffff\r\n", 413,
     "too_large"),
]


@pytest.mark.parametrize("text,status,code", LIBRARY, ids=range(len(LIBRARY)))
def test_errors_of_the_library_are_problems(daemon, text, status, code):
    received = b""
    with socket.create_connection(("127.0.0.1", daemon.port), timeout=10) as connection:
        with contextlib.suppress(OSError):
            connection.sendall(text)
        with contextlib.suppress(OSError):
            while block := connection.recv(65536):
                received += block
    head, _, body = received.partition(b"\r\n\r\n")
    lines = head.decode().lower().split("\r\n")
    assert lines[0].split()[1] == str(status), received
    assert "content-type: application/problem+json" in lines, received
    problem = json.loads(body)
    assert problem["code"] == code and problem["status"] == status and problem["detail"]
    assert problem["instance"].startswith("urn:request:")
    MET_CODES.add(code)
