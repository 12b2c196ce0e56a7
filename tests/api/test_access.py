"""Who may do what: tokens, hosts, origins, and clients that keep the daemon waiting."""
import json
import os
import signal
import socket
import subprocess
import time

import httpx
import pytest

import shapes
from conftest import BUILD, PATIENCE, check_problem
from ports import claim_port

READ, WRITE, OTHER = "r" * 20, "w" * 20, "x" * 40


def bearer(token):
    return {"Authorization": f"Bearer {token}"}


@pytest.fixture
def guarded(make_daemon, tmp_path):
    """A daemon with a token for reading and one for writing, and the file that holds them."""
    file = tmp_path / "tokens"
    file.write_text(f"# scope token\nread {READ}\n\n  write   {WRITE}\n")
    running = make_daemon("--token-file", file, "--log-format", "json")
    running.tokens = file
    return running


def test_without_a_token_nothing_is_told(guarded):
    with guarded.client() as client:
        for method, path in (("GET", "/v1/meshes"), ("POST", "/v1/meshes"), ("GET", "/v1/jobs/j_1/events"),
                             ("POST", "/v1/jobs"), ("POST", "/v1/batches"), ("DELETE", "/v1/meshes/m_1"),
                             ("GET", "/v1/info"), ("GET", "/metrics"), ("HEAD", "/v1/meshes")):
            for headers in ({}, bearer(OTHER), bearer(READ + "r"), {"Authorization": f"Basic {WRITE}"},
                            {"Authorization": WRITE}):
                reply = client.request(method, path, headers=headers)
                assert reply.status_code == 401, (method, path, headers)
                assert reply.headers["www-authenticate"].startswith("Bearer")
                if method != "HEAD":
                    check_problem(reply, 401, "unauthorized")
        for path in ("/healthz", "/readyz", "/openapi.yaml", "/"):
            assert client.get(path).status_code == 200


def test_a_reader_changes_nothing(guarded):
    with guarded.client() as client:
        mesh = client.post("/v1/meshes", content=shapes.obj(shapes.cube()), headers=bearer(WRITE)).json()["id"]
        client.headers.update(bearer(READ))
        for path in ("/v1/meshes", f"/v1/meshes/{mesh}", f"/v1/meshes/{mesh}/content?format=obj", "/v1/info",
                     "/metrics"):
            assert client.get(path).status_code == 200
        assert client.post(f"/v1/meshes/{mesh}/project", content=bytes(24)).status_code == 200
        for method, path in (("POST", "/v1/meshes"), ("POST", "/v1/jobs"), ("POST", "/v1/batches"),
                             ("DELETE", f"/v1/meshes/{mesh}")):
            reply = client.request(method, path, content=b"{}")
            check_problem(reply, 403, "forbidden")
            assert "insufficient_scope" in reply.headers["www-authenticate"]
        client.headers.update({"Authorization": f"bearer  {WRITE}"})
        assert client.delete(f"/v1/meshes/{mesh}").status_code == 204


def test_an_upload_without_a_token_is_refused_before_it_comes(guarded):
    with socket.create_connection(("127.0.0.1", guarded.port), timeout=PATIENCE) as wire:
        wire.sendall(b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000000\r\n\r\n")
        said = b""
        while piece := wire.recv(65536):
            said += piece
        assert said.startswith(b"HTTP/1.1 401 ") and b"Connection: close" in said


def wait_for_log(running, words, times=1):
    end = time.monotonic() + PATIENCE
    while running.log().count(words) < times:
        assert time.monotonic() < end, running.log()
        time.sleep(0.02)


def test_tokens_are_read_again_at_sighup(guarded):
    with guarded.client() as client:
        assert client.get("/v1/info", headers=bearer(READ)).status_code == 200
        guarded.tokens.write_text(f"write {OTHER}\n")
        guarded.process.send_signal(signal.SIGHUP)
        wait_for_log(guarded, "token file: 1 tokens")
        assert client.get("/v1/info", headers=bearer(READ)).status_code == 401
        assert client.get("/v1/info", headers=bearer(OTHER)).status_code == 200
        # A file that cannot be read leaves the old tokens.
        for words, text in (("line 1 does not start with read or write", "admin " + WRITE),
                            ("line 2 has a token that is too short", f"read {READ}\nwrite abc\n")):
            guarded.tokens.write_text(text)
            guarded.process.send_signal(signal.SIGHUP)
            wait_for_log(guarded, words)
            assert client.get("/v1/info", headers=bearer(OTHER)).status_code == 200
        # An empty file leaves none, and does not open the daemon.
        guarded.tokens.write_text("# nothing\n")
        guarded.process.send_signal(signal.SIGHUP)
        wait_for_log(guarded, "token file: 0 tokens")
        assert client.get("/v1/info", headers=bearer(OTHER)).status_code == 401
        assert client.get("/v1/info").status_code == 401
        guarded.tokens.write_text(f"write {OTHER} robot\n")
        guarded.process.send_signal(signal.SIGHUP)
        wait_for_log(guarded, "token file: 1 tokens", times=2)
        assert client.get("/v1/info", headers=bearer(OTHER)).status_code == 200
        guarded.tokens.unlink()
        guarded.process.send_signal(signal.SIGHUP)
        end = time.monotonic() + PATIENCE
        while client.get("/v1/info", headers=bearer(OTHER)).status_code != 401:
            assert time.monotonic() < end, "a token of a file that is gone is still valid"
    wait_for_log(guarded, '"client":"127.0.0.1","token":"robot"')
    for token in (READ, WRITE, OTHER):
        assert token not in guarded.log()


def start_and_fail(tmp_path, *settings):
    done = subprocess.run([BUILD / "quadmeshd", "--port", "0", "--data-dir", tmp_path / "data", *settings],
                          capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode != 0
    return done.stderr


def test_other_addresses_need_tokens(make_daemon, tmp_path):
    for address in ("0.0.0.0", "::", "192.0.2.1"):
        assert "--token-file" in start_and_fail(tmp_path, "--listen", address)
    assert "No such file" in start_and_fail(tmp_path, "--listen", "0.0.0.0", "--token-file", tmp_path / "none")
    file = tmp_path / "tokens"
    file.write_text(f"write {WRITE}\n")
    running = make_daemon("--listen", "0.0.0.0", "--token-file", file)
    with running.client() as client:
        assert client.get("/v1/info", headers=bearer(WRITE)).status_code == 200
        # With tokens the name of the host does not matter.
        assert client.get("/v1/info", headers={**bearer(WRITE), "Host": "mesh.example"}).status_code == 200


def test_a_daemon_without_tokens_goes_by_its_address(daemon, client, make_daemon):
    for host in ("localhost", "localhost:1", "LOCALHOST", "127.0.0.1:80", "[::1]:7878", "10.1.2.3", ""):
        assert client.get("/v1/info", headers={"Host": host}).status_code == 200, host
    for host in ("evil.example", "evil.example:7878", "localhost.evil.example", "127.0.0.1.evil.example", "x" * 300):
        check_problem(client.get("/v1/info", headers={"Host": host}), 403, "forbidden")
    with make_daemon("--hosts", "mesh.example, other.example").client() as named:
        assert named.get("/v1/info", headers={"Host": "mesh.example:443"}).status_code == 200
        check_problem(named.get("/v1/info", headers={"Host": "evil.example"}), 403, "forbidden")


def test_pages_of_other_origins_change_nothing(daemon, client):
    cube = shapes.obj(shapes.cube(side=7.5))
    own = f"http://127.0.0.1:{daemon.port}"
    for origin in ("https://evil.example", "null", "http://127.0.0.1:1"):
        check_problem(client.post("/v1/meshes", content=cube, headers={"Origin": origin}), 403, "forbidden")
        reply = client.get("/v1/info", headers={"Origin": origin})
        assert reply.status_code == 200 and "access-control-allow-origin" not in reply.headers
    assert client.post("/v1/meshes", content=cube, headers={"Origin": own}).status_code == 201


def test_origins_that_are_named_may_use_the_daemon(make_daemon):
    origin = "https://mesh.example"
    with make_daemon("--cors-origins", f"http://a.example,{origin}").client() as client:
        preflight = {"Origin": origin, "Access-Control-Request-Method": "POST"}
        reply = client.options("/v1/jobs", headers=preflight)
        assert reply.status_code == 204 and reply.headers["access-control-allow-origin"] == origin
        assert "POST" in reply.headers["access-control-allow-methods"]
        assert "Idempotency-Key" in reply.headers["access-control-allow-headers"]
        made = client.post("/v1/meshes", content=shapes.obj(shapes.cube()), headers={"Origin": origin})
        assert made.status_code == 201 and made.headers["access-control-allow-origin"] == origin
        assert "Origin" in made.headers["vary"].split(", ") and "ETag" in made.headers["access-control-expose-headers"]
        for other in ("https://evil.example", "https://mesh.example.evil", "https://mesh.exampl"):
            refused = client.options("/v1/jobs", headers={**preflight, "Origin": other})
            assert "access-control-allow-origin" not in refused.headers and refused.headers["vary"] == "Origin"
    with make_daemon("--cors-origins", "*").client() as client:
        assert client.get("/v1/info", headers={"Origin": "null"}).headers["access-control-allow-origin"] == "null"


def test_options_tells_the_methods(client):
    assert client.options("/v1/meshes").headers["allow"] == "POST, GET, HEAD, OPTIONS"
    assert "access-control-allow-methods" not in client.options("/v1/meshes", headers={"Origin": "http://a"}).headers
    check_problem(client.options("/nowhere"), 404, "not_found")


# ---- clients that keep the daemon waiting ----


def seconds_until_closed(wire, drip=b"", pause=0.2):
    start = time.monotonic()
    wire.settimeout(pause)
    while time.monotonic() < start + PATIENCE:
        try:
            if drip:
                wire.sendall(drip)
            if not wire.recv(65536):
                break
        except TimeoutError:
            continue
        except OSError:
            break
    return time.monotonic() - start


def test_a_connection_without_a_request_ends_whatever_it_sends(make_daemon):
    running = make_daemon("--idle-timeout", 2)
    address = ("127.0.0.1", running.port)
    for first, drip in ((b"", b""), (b"GET /healthz HTTP/1.1\r\nX-Long: ", b"x")):
        with socket.create_connection(address, timeout=PATIENCE) as wire:
            wire.sendall(first)
            assert 1 < seconds_until_closed(wire, drip) < 30


def test_a_body_that_drips_ends(make_daemon):
    running = make_daemon("--min-upload-rate", 1000)
    with socket.create_connection(("127.0.0.1", running.port), timeout=PATIENCE) as wire:
        wire.sendall(b"POST /v1/meshes HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n")
        assert 8 < seconds_until_closed(wire, b"v 0 0 0\n") < 40
    with running.client() as client:
        assert "quadmeshd_slow_clients_total 1\n" in client.get("/metrics").text


def test_one_address_has_so_many_connections(make_daemon):
    running = make_daemon("--client-connections", 4)
    wires = [socket.create_connection(("127.0.0.1", running.port), timeout=5) for _ in range(8)]
    answered = []
    for wire in wires:
        try:
            wire.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
            answered.append(wire.recv(100).startswith(b"HTTP/1.1 200"))
        except OSError:
            answered.append(False)
    # A connection of the test's own start may still be counted.
    assert 3 <= sum(answered) <= 4
    for wire in wires:
        wire.close()


# ---- how it fares ----


def test_health_and_metrics_have_a_door_of_their_own(make_daemon, tmp_path):
    file = tmp_path / "tokens"
    file.write_text(f"write {WRITE}\n")
    port = claim_port()
    running = make_daemon("--health-port", port, "--token-file", file, "--connections", 8)
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=PATIENCE, verify=False) as door:
        # Also when every connection of the other is taken.
        wires = [socket.create_connection(("127.0.0.1", running.port), timeout=5) for _ in range(12)]
        assert door.get("/healthz").json() == {"status": "ok"}
        assert door.get("/readyz").json() == {"status": "ready"}
        assert "quadmeshd_connections_limit 8\n" in door.get("/metrics").text
        for path in ("/v1/info", "/v1/meshes", "/", "/openapi.yaml"):
            check_problem(door.get(path), 404, "not_found")
        for wire in wires:
            wire.close()


def read_metrics(text):
    """name{labels} -> value; every series is announced and has a number."""
    announced, values = set(), {}
    for line in text.splitlines():
        if line.startswith("# "):
            if line.startswith("# TYPE"):
                announced.add(line.split()[2])
            continue
        series, value = line.rsplit(" ", 1)
        name = series.split("{")[0]
        base = name.rsplit("_", 1)[0] if name.endswith(("_bucket", "_sum", "_count")) else name
        assert name in announced or base in announced, line
        values[series] = float(value)
    return values


def test_metrics_count_what_happens(make_daemon):
    running = make_daemon()
    with running.client() as client:
        pair = [client.upload(shapes.sphere(turn))["id"] for turn in (0.0, 1.0)]
        client.hausdorff(*pair, tolerance=0.1)
        client.hausdorff(*pair, tolerance=0.1)
        client.get("/v1/meshes/m_none")
        client.request("BREW", "/v1/meshes")
        # A request is counted when it has ended, which another connection need not wait for.
        brewed, deadline = 'quadmeshd_request_seconds_count{method="other",route="",status="405"}', time.monotonic() + PATIENCE
        while brewed not in (reply := client.get("/metrics")).text and time.monotonic() < deadline:
            time.sleep(0.01)
    assert reply.headers["content-type"].startswith("text/plain; version=0.0.4")
    values = read_metrics(reply.text)
    p = "quadmeshd_"
    assert values[p + "meshes_added_total"] == 2 and values[p + "cached_answers_total"] == 1
    assert values[p + "uploaded_bytes_total"] > 100_000
    assert values[p + 'job_seconds_count{type="hausdorff",state="succeeded"}'] == 1
    assert values[p + 'request_seconds_count{method="POST",route="/v1/meshes",status="201"}'] == 2
    assert values[p + 'request_seconds_count{method="GET",route="/v1/meshes/{id}",status="404"}'] == 1
    assert values[p + 'request_seconds_count{method="other",route="",status="405"}'] == 1
    assert values[p + "connections_open"] >= 1 and values[p + "jobs_running"] == 0
    labels = 'method="POST",route="/v1/meshes",status="201"'
    buckets = [value for series, value in values.items() if series.startswith(p + "request_seconds_bucket{" + labels)]
    assert buckets == sorted(buckets) and buckets[-1] == 2
    assert values[p + "request_seconds_sum{" + labels + "}"] > 0


def test_requests_have_names_in_reply_and_log(make_daemon):
    running = make_daemon("--log-format", "json")
    with running.client() as client:
        named = client.get("/v1/meshes/m_none", headers={"X-Request-Id": "trace-7.a_B"})
        assert named.headers["x-request-id"] == "trace-7.a_B"
        assert named.json()["instance"] == "urn:request:trace-7.a_B"
        for odd in ('with "quotes"', "x" * 65, "a b", "<script>"):
            given = client.get("/healthz", headers={"X-Request-Id": odd}).headers["x-request-id"]
            assert given != odd and len(given) > 10
        client.get('/v1/meshes/%22"%0a\\%ff')
    running.stop()
    records = [json.loads(line) for line in running.log().splitlines() if line.startswith("{")]
    assert all({"time", "level", "message"} <= set(record) for record in records)
    (record,) = [record for record in records if record.get("request_id") == "trace-7.a_B"]
    assert (record["method"], record["path"], record["status"]) == ("GET", "/v1/meshes/m_none", 404)
    assert record["duration_ms"] >= 0 and record["received_bytes"] == 0


# ---- settings ----


def print_config(*flags, **environment):
    done = subprocess.run([BUILD / "quadmeshd", *flags, "--print-config"], capture_output=True, text=True,
                          env={**os.environ, **environment}, timeout=PATIENCE)
    settings = dict(line.split(" = ", 1) if " = " in line else (line.rstrip(" ="), "")
                    for line in done.stdout.splitlines() if not line.startswith("#"))
    return done, settings


def test_settings_come_from_file_environment_and_flags(tmp_path):
    file = tmp_path / "quadmeshd.conf"
    file.write_text("# a comment\n\n queue = 7 \nworkers=3\nlisten = ::1\nstreams = 11\r\n")
    done, settings = print_config("--config", file, "--queue", "9", QUADMESHD_WORKERS="4", QUADMESHD_QUEUE="8")
    assert done.returncode == 0, done.stderr
    assert settings["queue"] == "9" and settings["workers"] == "4" and settings["streams"] == "11"
    assert settings["listen"] == "::1" and settings["port"] == "7878"
    file.write_text(done.stdout)
    again, same = print_config(QUADMESHD_CONFIG=str(file))
    assert again.stdout == done.stdout and same == settings
    for line, words in (("nothing = 1", 'no setting "nothing"'), ("queue = x", "line 1 must be an integer"),
                        ("queue", 'no setting "queue"'), ("config = other", 'no setting "config"')):
        file.write_text(line + "\n")
        refused, _ = print_config(f"--config={file}")
        assert refused.returncode == 2 and words in refused.stderr, refused.stderr
    missing, _ = print_config("--config", tmp_path / "none")
    assert missing.returncode == 2 and "No such file" in missing.stderr
