"""The database of the tests does what they rely on: acknowledged rows survive kills, and a failover to the standby."""
import concurrent.futures

import pytest

from postgres import Postgres, Session


@pytest.fixture(scope="module")
def pair():
    with Postgres(standby=True) as made:
        made.primary.query("CREATE TABLE written (n int PRIMARY KEY)")
        yield made


def write(session, n):
    """True once row n is committed; False when the connection ended."""
    return session.run(f"INSERT INTO written VALUES ({n})")


def numbers(instance):
    return {int(row[0]) for row in instance.query("SELECT n FROM written")}


def test_rows_survive_a_kill_and_a_failover(pair):
    session = Session(pair.primary)
    assert all(write(session, n) for n in range(100))
    pair.primary.kill()
    assert not write(session, 100)
    session.close()
    pair.primary.start()
    assert set(range(100)) <= numbers(pair.primary)
    pair.require_standby()
    session = Session(pair.primary)
    assert all(write(session, n) for n in range(101, 200))
    session.close()
    dead = pair.fail_over()
    assert {*range(100), *range(101, 200)} <= numbers(pair.primary)
    pair.add_standby(dead.port)
    session = Session(pair.primary)
    assert write(session, 1000)
    session.close()
    pair.fail_over()
    assert 1000 in numbers(pair.primary)


def test_values_come_as_they_are(pair):
    assert pair.primary.query("SELECT NULL, '', E'two\\nlines', 7") == [[None, "", "two\nlines", "7"]]
    assert pair.primary.query("SELECT n FROM written WHERE false") == []
    with pytest.raises(RuntimeError, match="does not exist"):
        pair.primary.query("SELECT * FROM nothing")


def test_a_commit_waits_for_the_standby():
    with Postgres(standby=True) as pair, concurrent.futures.ThreadPoolExecutor() as pool:
        pair.primary.query("CREATE TABLE written (n int PRIMARY KEY)")
        pair.standby.pause_receiver()
        session = Session(pair.primary)
        writing = pool.submit(write, session, 1)
        while not pair.primary.query("SELECT 1 FROM pg_stat_activity WHERE wait_event = 'SyncRep'"):
            pass
        assert numbers(pair.primary) == set(), "a row is seen before it is safe"
        assert not writing.done()
        pair.standby.resume_receiver()
        assert writing.result()
        session.close()
        assert numbers(pair.primary) == {1}
