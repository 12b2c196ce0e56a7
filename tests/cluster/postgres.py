"""PostgreSQL for tests: a primary and a streaming standby on loopback, in a temporary folder that goes with them.

Each instance is a child of this process, without pg_ctl, so that a kill takes effect at an exact instant. fsync is on: what
the tests ask is what survives. A superuser `quadmeshd` without a password owns the database `quadmeshd`.
"""
import functools
import os
import pathlib
import pwd
import shutil
import signal
import subprocess
import sys
import tempfile
import time

sys.path.append(str(pathlib.Path(__file__).parent.parent / "api"))  # for who is not a test, as measurements

from ports import claim_port  # noqa: E402 (needs the path)

NAME = "quadmeshd"
PATIENCE = float(os.environ.get("QM_PATIENCE", 60))  # seconds
SETTINGS = {
    "listen_addresses": "127.0.0.1", "fsync": "on", "shared_buffers": "32MB", "max_connections": 200,
    "wal_level": "replica", "max_wal_senders": 8, "wal_keep_size": "256MB", "max_wal_size": "512MB",
    # A link that was cut is noticed and tried again within seconds instead of a minute.
    "wal_sender_timeout": "3s", "wal_receiver_timeout": "3s", "wal_retrieve_retry_interval": "200ms",
    "log_line_prefix": "%m [%p] %a ",
}


@functools.cache
def find_program(name):
    """The path of a program of PostgreSQL: Debian keeps those of the server out of PATH, and has a slow script before the others."""
    folders = sorted(pathlib.Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    if shutil.which("pg_config"):
        folders.append(pathlib.Path(subprocess.check_output(["pg_config", "--bindir"], text=True).strip()))
    for folder in folders:
        if (folder / name).exists():
            return str(folder / name)
    raise FileNotFoundError(f"no {name}: install postgresql")


def server_user():
    """Whom the server runs as, as arguments of subprocess: it refuses to run as root."""
    if os.geteuid() != 0:
        return {}
    for name in ("postgres", "nobody"):
        try:
            entry = pwd.getpwnam(name)
        except KeyError:
            continue
        return {"user": entry.pw_uid, "group": entry.pw_gid, "extra_groups": []}
    raise LookupError("there is neither a user postgres nor nobody")


def children(pid):
    """The processes that pid has started: their ids with their titles."""
    found = {}
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            title = (folder / "cmdline").read_text().replace("\0", " ").strip()
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has ended since
        if parent == pid:
            found[int(folder.name)] = title
    return found


class Instance:
    """One server over a folder that outlives its process."""

    def __init__(self, folder, port=None):
        self.folder = pathlib.Path(folder)
        self.port = port or claim_port()
        self.prefix = []           # words before the command of the server, as env VARIABLE=VALUE
        self.process = None

    def initialize(self):
        self._run("initdb", "--pgdata", self.folder, "--username", NAME, "--auth", "trust", "--encoding", "UTF8",
                  "--locale", "C", "--no-sync")

    def copy(self, primary_port, name):
        """Makes this the standby `name` of the primary that is reached at primary_port."""
        self._run("pg_basebackup", "--pgdata", self.folder, "--checkpoint", "fast", "--no-sync", "--write-recovery-conf",
                  "--dbname", f"host=127.0.0.1 port={primary_port} user={NAME} application_name={name}")

    def _run(self, program, *arguments):
        done = subprocess.run([find_program(program), *map(str, arguments)], capture_output=True, text=True,
                              cwd=self.folder.parent, **server_user())
        assert done.returncode == 0, done.stderr

    def start(self, **settings):
        """Starts the server and waits until it answers."""
        options = {**SETTINGS, "unix_socket_directories": self.folder.parent, "port": self.port, **settings}
        self._launch(options)
        end = time.monotonic() + PATIENCE
        while not self.answers():
            if self.process.poll() is not None:
                # A process of a server that was killed may have been born too late to be killed as well: it ends by itself.
                assert "is still in use" in self.log()[-1000:], f"the server ended at once:\n{self.log()[-5000:]}"
                time.sleep(0.1)
                self._launch(options)
            assert time.monotonic() < end, f"the server is not ready:\n{self.log()[-5000:]}"
            time.sleep(0.02)

    def _launch(self, options):
        with open(self.log_path, "ab") as log:
            self.process = subprocess.Popen(
                [*self.prefix, find_program("postgres"), "-D", self.folder, *(f"--{name}={value}" for name, value in options.items())],
                stdout=log, stderr=log, cwd=self.folder.parent, **server_user())

    @property
    def log_path(self):
        return self.folder.with_suffix(".log")

    def log(self):
        return self.log_path.read_text(errors="replace")

    @property
    def conninfo(self):
        return f"host=127.0.0.1 port={self.port} user={NAME} dbname={NAME} connect_timeout=5"

    def answers(self):
        """What pg_ctl waits for: the last line of the server's own file, without a program and a connection for each look."""
        try:
            lines = (self.folder / "postmaster.pid").read_text().splitlines()
        except FileNotFoundError:
            return False
        return lines[:1] == [str(self.process.pid)] and len(lines) == 8 and lines[7].strip() == "ready"

    def query(self, sql, database=NAME):
        """The rows of a statement, each a list of texts; None stands for NULL."""
        end = time.monotonic() + PATIENCE
        while True:
            done = subprocess.run(
                [find_program("psql"), "-XAtq", "-v", "ON_ERROR_STOP=1", "-F", "\x1f", "-R", "\x1e", "-P", "null=\x1d",
                 "-d", f"{self.conninfo} dbname={database}", "-c", sql], capture_output=True, text=True, timeout=PATIENCE)
            # Sessions of clients that were killed while they waited for the standby go when it has answered.
            if "too many clients already" not in done.stderr or time.monotonic() > end:
                break
            time.sleep(0.5)
        if done.returncode != 0:
            raise RuntimeError(done.stderr.strip())
        rows = done.stdout.removesuffix("\n").removesuffix("\x1e")
        return [[None if field == "\x1d" else field for field in row.split("\x1f")]
                for row in rows.split("\x1e")] if rows else []

    def set(self, name, value):
        """Changes a setting of the running server, for its later starts as well."""
        self.query(f"ALTER SYSTEM SET {name} = '{value}'")
        self.query("SELECT pg_reload_conf()")

    def kill(self):
        """kill -9 of the server and of everything that it has started, at one instant."""
        self.process.send_signal(signal.SIGSTOP)  # so that it starts nothing more
        started = children(self.process.pid)
        self.process.kill()
        for pid in started:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        self.process.wait()
        end = time.monotonic() + PATIENCE
        while any(pathlib.Path(f"/proc/{pid}").exists() for pid in started):
            assert time.monotonic() < end, "a child of the server does not end"
            time.sleep(0.005)

    def stop(self):
        """An orderly stop that waits for no client."""
        if self.process and self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(PATIENCE)

    def promote(self):
        """Makes a primary of this standby and returns once it takes writes."""
        self.query("SELECT pg_promote(wait => true)")
        end = time.monotonic() + PATIENCE
        while self.query("SELECT pg_is_in_recovery()") != [["f"]]:
            assert time.monotonic() < end, self.log()
            time.sleep(0.02)

    def _receiver(self):
        end = time.monotonic() + PATIENCE
        while True:
            for pid, title in children(self.process.pid).items():
                if "walreceiver" in title:
                    return pid
            assert time.monotonic() < end, "this server receives nothing"
            time.sleep(0.02)

    def pause_receiver(self):
        """The standby stays up and takes nothing more from its primary; to be resumed before a promotion."""
        os.kill(self._receiver(), signal.SIGSTOP)

    def resume_receiver(self):
        os.kill(self._receiver(), signal.SIGCONT)


class Session:
    """One connection that stays, for transactions that are left open."""

    def __init__(self, instance):
        self.process = subprocess.Popen([find_program("psql"), "-XAtq", "-v", "ON_ERROR_STOP=1", "-d", instance.conninfo],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)

    def run(self, sql):
        """True once the statements are done; False when the connection has ended, or ends with them."""
        try:
            self.process.stdin.write(f"{sql};\n\\echo done\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            return False
        while line := self.process.stdout.readline():
            if line == "done\n":
                return True
        return False

    def close(self):
        self.process.kill()
        self.process.communicate()


class Postgres:
    """A primary and, if wanted, a synchronous standby.

    `link` may give another port through which the standby reaches a port of the primary, for instance that of a proxy.
    """

    def __init__(self, standby=False, link=lambda port: port):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="quadmeshd-postgres-"))
        user = server_user()
        if user:
            os.chown(self.folder, user["user"], user["group"])
        self.count = 0
        self.primary, self.standby = self._instance(), None
        try:
            self.primary.initialize()
            self.primary.start()
            self.primary.query(f"CREATE DATABASE {NAME}", database="postgres")
            if standby:
                self.add_standby(link=link)
        except BaseException:
            self.close()
            raise

    def _instance(self, port=None):
        self.count += 1
        return Instance(self.folder / f"server{self.count}", port)

    def add_standby(self, port=None, link=lambda port: port):
        """From its return on, no commit returns before the standby has it."""
        self.standby = self._instance(port)
        self.standby.copy(link(self.primary.port), "s1")
        self.standby.start()
        self.require_standby()

    def require_standby(self):
        """Waits for the standby, and for the primary to know it as synchronous."""
        self.primary.set("synchronous_standby_names", "ANY 1 (s1)")
        end = time.monotonic() + PATIENCE
        while self.primary.query("SELECT sync_state FROM pg_stat_replication") not in ([["quorum"]], [["sync"]]):
            assert time.monotonic() < end, self.primary.log()
            time.sleep(0.02)

    def fail_over(self):
        """kill -9 of the primary, then the standby is promoted and asks for no standby of its own. Gives the dead one."""
        dead = self.primary
        if dead.process.poll() is None:
            dead.kill()
        self.standby.promote()
        self.standby.set("synchronous_standby_names", "")
        self.primary, self.standby = self.standby, None
        return dead

    def close(self):
        for instance in (self.standby, self.primary):
            if instance and instance.process and instance.process.poll() is None:
                instance.kill()
        shutil.rmtree(self.folder)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
