"""The proxy does to a connection what it says, seen by libpq (psql) and by plain sockets."""
import contextlib
import socket
import subprocess
import threading
import time

import pytest

import proxy
from postgres import Postgres


@pytest.fixture(scope="module")
def database():
    with Postgres() as made:
        yield made.primary


@pytest.fixture
def before(database):
    with proxy.Proxy(database.port) as made:
        yield made


def psql(port, *statements, patience=20):
    """Runs each statement as a request of its own and gives the status and all output."""
    commands = [part for statement in statements for part in ("-c", statement)]
    done = subprocess.run(["psql", "-XAtq", "-v", "ON_ERROR_STOP=1", "-d",
                           f"host=127.0.0.1 port={port} user=quadmeshd dbname=quadmeshd connect_timeout=5", *commands],
                          capture_output=True, text=True, timeout=patience)
    return done.returncode, done.stdout + done.stderr


def test_it_passes_all_there_is(before):
    assert psql(before.port, "SELECT 1", "SELECT length(repeat('x', 3000000))") == (0, "1\n3000000\n")
    status, text = psql(before.port, "SELECT repeat('x', 3000000)")
    assert status == 0 and len(text) == 3000001


def test_answers_are_told_with_their_statements(before):
    before.note_answers()
    psql(before.port, "CREATE TABLE noted (n int)", "INSERT INTO noted VALUES (1), (2)", "DROP TABLE noted")
    before.answers.popleft()  # of the connection's start
    assert [(answer.statements, answer.tags) for answer in before.answers] == [
        (["CREATE TABLE noted (n int)"], ["CREATE TABLE"]),
        (["INSERT INTO noted VALUES (1), (2)"], ["INSERT 0 2"]), (["DROP TABLE noted"], ["DROP TABLE"])]
    assert not any(answer.is_error or answer.is_in_transaction for answer in before.answers)


def test_a_delay_is_added_each_way(before):
    before.delay(up=0.1, down=0.15)
    start = time.monotonic()
    assert psql(before.port, "SELECT 1")[0] == 0
    assert time.monotonic() - start > 0.5  # a start and a statement are two round trips at least


def test_a_cut_connection_is_told(before, database):
    talk = subprocess.Popen(["psql", "-XAtq", "-d", f"host=127.0.0.1 port={before.port} user=quadmeshd dbname=quadmeshd"],
                            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    talk.stdin.write("SELECT 1;\n")
    talk.stdin.flush()
    assert talk.stdout.readline() == "1\n"
    before.cut(refuse=True)
    assert psql(before.port, "SELECT 1")[0] != 0
    text, _ = talk.communicate("SELECT 2;\n", timeout=20)
    assert "2" not in text.splitlines()
    before.release()
    assert psql(before.port, "SELECT 1")[0] == 0


def test_the_server_hears_of_a_client_that_is_killed():
    """One that has bytes to read resets its connection."""
    with socket.create_server(("127.0.0.1", 0)) as server, proxy.Proxy(server.getsockname()[1], protocol=None) as before:
        client = socket.create_connection(("127.0.0.1", before.port))
        client.sendall(b"x")
        serving, _ = server.accept()
        serving.settimeout(10)
        assert serving.recv(10) == b"x"
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, proxy.RESET)
        client.close()
        with contextlib.suppress(ConnectionResetError):
            assert serving.recv(10) == b""
        serving.close()


@pytest.mark.parametrize("ways", [(), (proxy.UP,), (proxy.DOWN,)], ids=["both", "up", "down"])
def test_what_is_held_comes_late(before, database, ways):
    database.query("CREATE TABLE IF NOT EXISTS held (n int); TRUNCATE held")
    before.hold(*ways)
    with pytest.raises(subprocess.TimeoutExpired):
        psql(before.port, "INSERT INTO held VALUES (1)", patience=1)
    assert database.query("SELECT * FROM held") == []
    waiting = threading.Timer(0.5, before.release)
    waiting.start()
    assert psql(before.port, "INSERT INTO held VALUES (2)") == (0, "")
    waiting.join()
    assert ["2"] in database.query("SELECT * FROM held")


def test_a_cut_after_some_bytes(before):
    before.cut_after(100_000, proxy.DOWN)
    assert psql(before.port, "SELECT repeat('x', 3000000)")[0] != 0
    assert psql(before.port, "SELECT 1")[0] == 0


def is_insert(answer):
    return any(tag.startswith("INSERT") for tag in answer.tags)


def test_the_answer_of_a_statement_is_lost_and_its_effect_is_not(before, database):
    database.query("CREATE TABLE lost (n int)")
    loss = before.lose_answer(is_insert, skip=1)
    status, _ = psql(before.port, "INSERT INTO lost VALUES (1)", "INSERT INTO lost VALUES (2)", "INSERT INTO lost VALUES (3)")
    assert status != 0 and loss.done.is_set() and loss.lost.statements == ["INSERT INTO lost VALUES (2)"]
    assert database.query("SELECT n FROM lost ORDER BY n") == [["1"], ["2"]]
    assert psql(before.port, "INSERT INTO lost VALUES (4)")[0] == 0


def test_the_answer_of_a_commit_is_lost(before, database):
    database.query("CREATE TABLE committed (n int)")
    loss = before.lose_answer(lambda answer: "COMMIT" in answer.tags)
    assert psql(before.port, "BEGIN", "INSERT INTO committed VALUES (1)", "COMMIT")[0] != 0
    assert loss.done.is_set() and database.query("SELECT n FROM committed") == [["1"]]


def test_a_silent_loss_keeps_the_connection(before, database):
    database.query("CREATE TABLE silent (n int)")
    loss = before.lose_answer(is_insert, is_silent=True)
    with pytest.raises(subprocess.TimeoutExpired):
        psql(before.port, "INSERT INTO silent VALUES (1)", patience=1)
    assert loss.done.is_set() and database.query("SELECT n FROM silent") == [["1"]]


def frame(letter, body):
    return letter + (len(body) + 4).to_bytes(4, "big") + body


def test_prepared_statements_are_known_by_their_text(before, database):
    """The extended protocol, as the daemon speaks it, here by hand."""
    before.note_answers()
    with contextlib.closing(socket.create_connection(("127.0.0.1", before.port))) as talk:
        start = (196608).to_bytes(4, "big") + b"user\0quadmeshd\0database\0quadmeshd\0\0"
        talk.sendall((len(start) + 4).to_bytes(4, "big") + start)
        reply = b""
        while b"Z\0\0\0\5I" not in reply:
            reply += talk.recv(4096)
        talk.sendall(frame(b"P", b"one\0SELECT 1\0\0\0") + frame(b"S", b""))
        talk.sendall(frame(b"B", b"\0one\0\0\0\0\0\0\0") + frame(b"E", b"\0\0\0\0\0") + frame(b"S", b""))
        reply = b""
        while reply.count(b"Z\0\0\0\5I") < 2:
            reply += talk.recv(4096)
    assert [(answer.statements, answer.tags) for answer in list(before.answers)[1:]] == [([], []), (["SELECT 1"], ["SELECT 1"])]
