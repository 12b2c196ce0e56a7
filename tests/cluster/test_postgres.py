"""The database of the tests does what they rely on: acknowledged rows survive kills, and a failover to the standby."""
import subprocess

import pytest

from postgres import Postgres


@pytest.fixture(scope="module")
def pair():
    with Postgres(standby=True) as made:
        made.primary.query("CREATE TABLE written (n int PRIMARY KEY)")
        yield made


class Writer:
    """Inserts rising numbers through one connection and remembers the last that was acknowledged."""

    def __init__(self, instance):
        self.process = subprocess.Popen(["psql", "-XAtq", "-v", "ON_ERROR_STOP=1", "-d", instance.conninfo],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)

    def write(self, n):
        """True once row n is committed; False when the connection ended."""
        try:
            self.process.stdin.write(f"INSERT INTO written VALUES ({n}) RETURNING n;\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            return False
        return self.process.stdout.readline().strip() == str(n)

    def close(self):
        self.process.kill()
        self.process.communicate()


def numbers(instance):
    return {int(row[0]) for row in instance.query("SELECT n FROM written")}


def test_rows_survive_a_kill_and_a_failover(pair):
    writer = Writer(pair.primary)
    assert all(writer.write(n) for n in range(100))
    pair.primary.kill()
    assert not writer.write(100)
    writer.close()
    pair.primary.start()
    assert set(range(100)) <= numbers(pair.primary)
    pair.require_standby()
    writer = Writer(pair.primary)
    assert all(writer.write(n) for n in range(101, 200))
    writer.close()
    dead = pair.fail_over()
    assert {*range(100), *range(101, 200)} <= numbers(pair.primary)
    pair.add_standby(dead.port)
    writer = Writer(pair.primary)
    assert writer.write(1000)
    writer.close()
    pair.fail_over()
    assert 1000 in numbers(pair.primary)


def test_values_come_as_they_are(pair):
    assert pair.primary.query("SELECT NULL, '', E'two\\nlines', 7") == [[None, "", "two\nlines", "7"]]
    assert pair.primary.query("SELECT n FROM written WHERE false") == []
    with pytest.raises(RuntimeError, match="does not exist"):
        pair.primary.query("SELECT * FROM nothing")


def test_a_commit_waits_for_the_standby():
    with Postgres(standby=True) as pair:
        pair.primary.query("CREATE TABLE written (n int PRIMARY KEY)")
        pair.standby.pause_receiver()
        writer = Writer(pair.primary)
        writer.process.stdin.write("INSERT INTO written VALUES (1) RETURNING n;\n")
        writer.process.stdin.flush()
        while not pair.primary.query("SELECT 1 FROM pg_stat_activity WHERE wait_event = 'SyncRep'"):
            pass
        assert numbers(pair.primary) == set(), "a row is seen before it is safe"
        pair.standby.resume_receiver()
        assert writer.process.stdout.readline() == "1\n"
        writer.close()
        assert numbers(pair.primary) == {1}
