"""A large file that the daemon has already is named by its hash and not sent again."""
import http.client
import http.server
import json
import threading
import urllib.parse

import pytest

from conftest import write_torus


@pytest.fixture
def counting(server):
    """A proxy before the daemon, and the names of the files that were sent through it."""
    daemon, sent = urllib.parse.urlsplit(server), []

    class Proxy(http.server.BaseHTTPRequestHandler):
        def forward(self):
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            url = urllib.parse.urlsplit(self.path)
            if self.command == "POST" and url.path == "/v1/meshes":
                sent.append(urllib.parse.parse_qs(url.query)["name"][0])
            connection = http.client.HTTPConnection(daemon.hostname, daemon.port)
            connection.request(self.command, self.path, body, {name: self.headers[name] for name in ("Accept", "Content-Type")
                                                               if self.headers[name]})
            answer = connection.getresponse()
            content = answer.read()
            self.send_response(answer.status)
            for name in ("Content-Type", "Location"):
                if answer.headers[name]:
                    self.send_header(name, answer.headers[name])
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        do_GET = do_POST = forward

        def log_message(self, *_):
            pass

    proxy = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Proxy)
    threading.Thread(target=proxy.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{proxy.server_port}", sent
    proxy.shutdown()
    proxy.server_close()


def ask(quadmesh, *arguments):
    run = quadmesh("hausdorff", *arguments, "--json")
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.splitlines()[-1])


def test_a_large_file_is_sent_once(quadmesh, tmp_path, counting):
    server, sent = counting
    a, b = tmp_path / "a.obj", tmp_path / "b.obj"
    write_torus(a, 120, 60, 0.3)
    write_torus(b, 120, 60, 0.31)
    assert a.stat().st_size > 256 << 10
    first = ask(quadmesh, a, b, "--server", server)
    assert sent == ["a.obj", "b.obj"]
    again = ask(quadmesh, a, b, "--server", server)
    assert sent == ["a.obj", "b.obj"] and (again["lower"], again["upper"]) == (first["lower"], first["upper"])


def test_other_bytes_names_and_notes_are_sent(quadmesh, tmp_path, counting):
    server, sent = counting
    a, b = tmp_path / "c.obj", tmp_path / "d.obj"
    write_torus(a, 120, 60, 0.3)
    write_torus(b, 120, 60, 0.32)
    ask(quadmesh, a, b, "--server", server)
    ask(quadmesh, a, b, "--unit", "cm", "--server", server)
    assert sent == ["c.obj", "d.obj"] * 2
    true = ask(quadmesh, a, b, "--unit", "cm", "--uncertainty", "0.5", "--server", server)
    assert sent == ["c.obj", "d.obj"] * 3 and true["of_true"]["upper"] > true["upper"] + 0.9
    assert "of_true" not in ask(quadmesh, a, b, "--unit", "cm", "--server", server)
    assert sent == ["c.obj", "d.obj"] * 3
    b.write_text(b.read_text() + "# other bytes\n")
    ask(quadmesh, a, b, "--server", server)
    assert sent == ["c.obj", "d.obj"] * 3 + ["d.obj"]
    a.rename(tmp_path / "e.obj")
    ask(quadmesh, tmp_path / "e.obj", b, "--server", server)
    assert sent[-1] == "e.obj" and len(sent) == 8
