"""Daemons on one database, each behind its own proxies, and what may happen to them."""
import contextlib
import os
import pathlib
import signal
import time

import proxy
from api_conftest import PATIENCE, Client, Daemon, is_ready
from postgres import NAME, Postgres


class PatientClient(Client):
    """Does with an upload as Retry-After asks: a machine with much else to do keeps a daemon from its database at times."""

    def upload(self, content, **query):
        end = time.monotonic() + PATIENCE
        while True:
            reply = self.post_mesh(content, **query)
            if reply.status_code != 503 or time.monotonic() > end:
                return self.check_mesh(reply)
            time.sleep(float(reply.headers["Retry-After"]))


class Node:
    """One daemon with its name, its data folder, and a proxy before each server of the database."""

    def __init__(self, folder, name, ports, settings):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir(parents=True)
        self.name, self.kills = name, 0
        self.links = [proxy.Proxy(port) for port in ports]
        self.settings = [*settings, "--node-name", name, "--store", self.store] if ports else list(settings)
        self.daemon = None
        self.start()

    @property
    def store(self):
        """The address of the database, as this node reaches it."""
        hosts = ",".join(f"127.0.0.1:{link.port}" for link in self.links)
        return f"postgres://{NAME}@{hosts}/{NAME}"

    def start(self, **user):
        """user: further arguments of the process, as `env`."""
        if self.daemon is None or user:
            self.daemon = Daemon(self.folder, *self.settings, **user)
        else:
            self.daemon.start()
        self.is_serving = True

    @property
    def pid(self):
        return self.daemon.process.pid

    def client(self):
        return PatientClient(base_url=self.daemon.url, timeout=PATIENCE + 10, verify=False)

    def info(self):
        with self.client() as client:
            return client.get("/v1/info").json()

    def kill(self):
        """kill -9."""
        self.is_serving = False
        self.kills += 1
        self.daemon.stop(signal.SIGKILL)

    def note_kill(self):
        """It has killed itself, or will at once."""
        self.is_serving = False
        self.kills += 1
        assert self.daemon.stop(signal.SIGCONT) == -signal.SIGKILL, self.daemon.log()

    def stop(self):
        """An orderly end; gives the exit status."""
        self.is_serving = False
        return self.daemon.stop()

    def pause(self):
        self.is_serving = False
        os.kill(self.pid, signal.SIGSTOP)

    def resume(self):
        os.kill(self.pid, signal.SIGCONT)
        self.is_serving = True

    def cut_off(self, *ways):
        """The database is not to be reached, or only one way; the daemon is."""
        for link in self.links:
            link.hold(*ways)

    def heal(self):
        for link in self.links:
            link.release()

    def close(self):
        try:
            if self.daemon.process.poll() is None:
                os.kill(self.pid, signal.SIGCONT)
                self.heal()
                assert self.stop() == 0, self.daemon.log()
        finally:
            for link in self.links:
                link.close()


class Cluster:
    """`store` is "postgres", or "embedded" for one daemon with its own store, which proves load and checkers.

    standby: with a synchronous standby, whose link to the primary is the proxy `wire`.
    """

    def __init__(self, folder, count=3, store="postgres", standby=False, settings=()):
        self.folder, self.settings = pathlib.Path(folder), settings
        assert store == "postgres" or count == 1
        self.wire = self.database = None
        self.nodes = []
        try:
            if store == "postgres":
                self.database = Postgres(standby, self._wire)
            for number in range(1, count + 1):
                self.add_node(f"n{number}")
        except BaseException:
            self.close()
            raise

    def _wire(self, port):
        """The port through which a standby is to reach the port of its primary."""
        if self.wire:
            self.wire.close()
        self.wire = proxy.Proxy(port)
        return self.wire.port

    def ports(self):
        servers = (self.database.primary, self.database.standby) if self.database else ()
        return [server.port for server in servers if server]

    def add_node(self, name, *settings):
        node = Node(self.folder / name, name, self.ports(), [*self.settings, *settings])
        self.nodes.append(node)
        return node

    def serving(self):
        """The nodes that a balancer would choose from."""
        return [node for node in self.nodes if node.is_serving]

    def query(self, sql):
        return self.database.primary.query(sql)

    def fail_over(self):
        """The primary dies, its standby takes over, and a new standby comes up in the dead one's place."""
        dead = self.database.fail_over()
        self.database.add_standby(dead.port, self._wire)

    def wait_for(self, what, true, patience=PATIENCE):
        """Waits until true() and gives what it gave."""
        end = time.monotonic() + patience
        while True:
            start = time.monotonic()
            if found := true():
                return found
            looked = time.monotonic()
            assert looked < end, f"waited in vain for {what}"
            # Most looks run psql: they would keep a processor busy without a longer rest.
            time.sleep(min(max(0.02, 2 * (looked - start)), 0.2))

    def wait_until_ready(self):
        for node in self.nodes:
            self.wait_for(f"node {node.name}", lambda node=node: is_ready(node.daemon.url))

    def mend(self):
        """All nodes and servers are up again and reach each other."""
        if self.database:
            if self.wire:
                self.wire.release()
            if self.database.primary.process.poll() is not None:
                self.database.primary.start()
            if self.database.standby:
                self.database.standby.resume_receiver()
        for node in self.nodes:
            node.heal()
            if node.daemon.process.poll() is None:
                node.resume()
            else:
                node.start()
        self.wait_until_ready()

    def close(self):
        """Stops all. What a daemon has to say against it is raised when all is stopped."""
        with contextlib.ExitStack() as closing:
            if self.database:
                closing.callback(self.database.close)
            if self.wire:
                closing.callback(self.wire.close)
            for node in self.nodes:
                closing.callback(node.close)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
