"""What the tables hold when nothing is under way, for checkers.check_rest. All SQL about the tables is here."""
SCHEMA = "quadmeshd"

LISTS = {
    "unneeded_blobs": "SELECT hash FROM blobs WHERE unneeded IS NOT NULL",
    "named_blobs": """SELECT hash FROM meshes UNION SELECT positions FROM meshes WHERE positions IS NOT NULL
                      UNION SELECT hash FROM job_arrays""",
    "queued": "SELECT j.id FROM job_queue JOIN jobs j USING (sequence)",
    "running": "SELECT j.id FROM job_runs JOIN jobs j USING (sequence)",
    "unfinished": "SELECT id FROM jobs WHERE document IS NULL",
}
COUNTS = {
    "blobs": "SELECT hash, size FROM blobs",
    "stored_bytes": """SELECT b.hash, sum(length(c.bytes)) FROM blobs b JOIN blob_chunks c USING (generation)
                       GROUP BY b.hash""",
    "terminal_events": """SELECT j.id, count(*) FILTER (WHERE e.name IN ('result', 'error'))
                          FROM jobs j LEFT JOIN job_events e USING (sequence) WHERE j.document IS NOT NULL GROUP BY j.id""",
}
LEASE = "SELECT n.name, n.id, r.epoch FROM job_runs r JOIN nodes n ON n.id = r.node JOIN jobs j USING (sequence) WHERE j.id = '{}'"
# Claims stop in the middle, with all that they have locked, as long as a session has the advisory lock.
CLAIM_LOCK = 1
MAKE_STOP = f"""CREATE OR REPLACE FUNCTION stop_claims() RETURNS trigger LANGUAGE plpgsql AS
                $$ BEGIN PERFORM pg_advisory_xact_lock_shared({CLAIM_LOCK}); RETURN NEW; END $$;
                CREATE OR REPLACE TRIGGER stop_claims BEFORE INSERT ON job_runs
                FOR EACH ROW EXECUTE FUNCTION stop_claims()"""
STOP_CLAIMS = f"SELECT pg_advisory_lock({CLAIM_LOCK})"
DROP_STOP = "DROP FUNCTION stop_claims CASCADE"
WAITING_CLAIMS = "SELECT application_name FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND wait_event = 'advisory'"
WAITING_REAPERS = "SELECT pid FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND query ILIKE '%UPDATE%nodes%state = 2%'"
PART_NODES = """SELECT DISTINCT n.name FROM job_parts p JOIN nodes n ON n.id = p.node AND n.state = 0
                JOIN jobs j USING (sequence) WHERE j.id = '{}'"""
PARTS = "SELECT p.part FROM job_parts p JOIN jobs j USING (sequence) WHERE j.id = '{}'"
BOUNDS = """SELECT b.lower, greatest(b.lower, b.discarded, max(p.upper)) FROM job_bounds b JOIN jobs j USING (sequence)
            LEFT JOIN job_parts p USING (sequence) WHERE j.id = '{}' GROUP BY b.sequence"""
NEXT_VERSION = "UPDATE about SET version = version + 1; ALTER TABLE jobs ADD COLUMN new int; CREATE TABLE new (n int)"
FIRST_VERSION = """DROP TABLE job_parts, job_bounds, blob_place, blob_objects;
                   ALTER TABLE meshes DROP COLUMN unit, DROP COLUMN uncertainty, DROP COLUMN labels;
                   ALTER TABLE jobs DROP COLUMN labels;
                   UPDATE about SET version = 1"""
DEAD = "SELECT id FROM nodes WHERE state = 2"


def select(query, sql):
    return query(f"SET search_path TO {SCHEMA}; {sql}")


def read_tables(query):
    """query runs a statement and gives its rows. One statement each: nothing may be under way."""
    rows = {name: [row[0] for row in select(query, sql)] for name, sql in LISTS.items()}
    for name, sql in COUNTS.items():
        rows[name] = {row[0]: int(row[1]) for row in select(query, sql)}
    return rows


def lease(query, job):
    """Who runs a job: the node's name, its life, and the epoch; None when nobody does."""
    rows = select(query, LEASE.format(job))
    return rows[0] if rows else None


def part_nodes(query, job):
    """The names of the nodes that run parts of a job's search."""
    return [row[0] for row in select(query, PART_NODES.format(job))]


def parts(query, job):
    """The parts that are left of a job's search."""
    return select(query, PARTS.format(job))


def bounds(query, job):
    """The stored bounds of a search, without the margin for roundings."""
    lower, upper = select(query, BOUNDS.format(job))[0]
    return float(lower), float(upper)


def dead_nodes(query):
    """The lives that were declared dead."""
    return {row[0] for row in select(query, DEAD)}


def waiting_claims(query):
    """The names of the nodes whose claims were stopped."""
    return [name.rsplit("/", 1)[-1] for name, in select(query, WAITING_CLAIMS)]


def waiting_reapers(query):
    """The servers of statements that declare nodes dead and wait for a claim of these."""
    return select(query, WAITING_REAPERS)


def lose_events(query, job):
    """Takes the second half of a job's events away, as a failover may take what was committed last. Gives the seqs of these."""
    return [row[0] for row in select(query, f"""
        WITH e AS (SELECT e.sequence, e.seq, ntile(2) OVER (ORDER BY e.seq) AS half
                   FROM job_events e JOIN jobs j USING (sequence) WHERE j.id = '{job}')
        DELETE FROM job_events d USING e WHERE e.half = 2 AND d.sequence = e.sequence AND d.seq = e.seq RETURNING d.seq""")]


def seqs(query, job):
    return [row[0] for row in select(query, f"SELECT seq FROM job_events JOIN jobs USING (sequence) WHERE id = '{job}'")]
