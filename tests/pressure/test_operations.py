"""The daemon among the tools of its operators: a service manager, a full disk, descriptors that run out, metrics, logs."""
import http.client
import os
import pathlib
import resource
import socket
import subprocess
import threading
import time

import pytest

import shapes
from api_conftest import PATIENCE, Daemon, check_problem

STOPS = 2000 if os.environ.get("QM_TEST_LONG", "0") != "0" else 20


def test_the_service_manager_is_told_of_start_and_end(tmp_path):
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(path))
        manager.settimeout(PATIENCE)
        folder = tmp_path / "daemon"
        folder.mkdir()
        running = Daemon(folder, env={**os.environ, "NOTIFY_SOCKET": str(path)})
        assert manager.recv(100) == b"READY=1"
        assert running.stop() == 0
        assert manager.recv(100) == b"STOPPING=1"


def test_it_stops_in_order_while_clients_come_and_go(tmp_path):
    """Closing the port raced with the threads that take connections: one stop in some thousand ended in an abort."""
    running = Daemon(tmp_path)
    ends = threading.Event()

    def come_and_go():
        while not ends.is_set():
            connection = http.client.HTTPConnection("127.0.0.1", running.port, timeout=PATIENCE)
            try:
                for _ in range(3):
                    connection.request("GET", "/v1/meshes")
                    connection.getresponse().read()
            except (OSError, http.client.HTTPException):
                pass  # it stops
            connection.close()

    clients = [threading.Thread(target=come_and_go) for _ in range(4)]
    for client in clients:
        client.start()
    try:
        for _ in range(STOPS):
            assert running.stop() == 0, running.log()
            running.start()
    finally:
        ends.set()
        for client in clients:
            client.join()
    assert running.stop() == 0


@pytest.fixture
def small_disk(tmp_path):
    """A folder on a disk of its own, of 160 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=160m", "none", folder], capture_output=True, text=True)
    if done.returncode != 0:
        pytest.skip(f"a disk can only be mounted by root: {done.stderr}")
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_a_full_disk_is_not_ready(small_disk):
    running = Daemon(small_disk)
    with running.client() as client:
        mesh = client.upload(shapes.cube())["id"]
        (small_disk / "other").write_bytes(bytes(110 << 20))
        assert "the disk of the data folder is full" in check_problem(client.get("/readyz"), 503, "unavailable")["detail"]
        assert client.get("/healthz").status_code == 200
        assert client.get(f"/v1/meshes/{mesh}").status_code == 200
        free = next(float(line.split()[1]) for line in client.get("/metrics").text.splitlines()
                    if line.startswith("quadmeshd_disk_free_bytes "))
        assert free < 64 << 20
        (small_disk / "other").unlink()
        assert client.get("/readyz").status_code == 200
    assert running.stop() == 0


def test_descriptors_run_out(make_daemon):
    """Connections wait or fail, the log stays short, and all is well when there are descriptors again."""
    running = make_daemon()
    with running.client() as client:
        client.upload(shapes.cube())
        opened = len(list(pathlib.Path(f"/proc/{running.process.pid}/fd").iterdir()))
        _, most = resource.prlimit(running.process.pid, resource.RLIMIT_NOFILE)
        resource.prlimit(running.process.pid, resource.RLIMIT_NOFILE, (opened + 4, most))
        before = running.log().count("\n")
        waiting = [socket.create_connection(("127.0.0.1", running.port), timeout=PATIENCE) for _ in range(60)]
        time.sleep(2)
        lines = running.log().count("\n") - before
        assert 0 < lines < 60, running.log()[-2000:]
        resource.prlimit(running.process.pid, resource.RLIMIT_NOFILE, (most, most))
        for connection in waiting:
            connection.close()
        assert client.get("/healthz").status_code == 200


def test_metrics_of_the_process(make_daemon):
    running = make_daemon()
    with running.client() as client:
        values = {line.rsplit(" ", 1)[0]: float(line.rsplit(" ", 1)[1]) for line in client.get("/metrics").text.splitlines()
                  if not line.startswith("#")}
        version = client.get("/v1/info").json()["version"]
    assert values[f'quadmeshd_build_info{{version="{version}"}}'] == 1
    assert 0 < values["process_cpu_seconds_total"] < 1000
    assert 1 << 20 < values["process_resident_memory_bytes"] < values["process_virtual_memory_bytes"]
    assert 5 < values["process_open_fds"] < 500
    assert values["quadmeshd_decodes_running"] == values["quadmeshd_decodes_waiting"] == 0


def test_one_address_leaves_connections_to_others(make_daemon):
    running = make_daemon("--connections", 20, "--idle-timeout", 600)
    silent = [socket.create_connection(("127.0.0.1", running.port), source_address=("127.0.0.2", 0), timeout=PATIENCE)
              for _ in range(40)]
    with running.client() as client:
        assert client.get("/v1/info").status_code == 200
    for connection in silent:
        connection.close()
