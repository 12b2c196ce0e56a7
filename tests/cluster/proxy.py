"""A TCP proxy before a server, of PostgreSQL or another one, that makes the network bad: late, cut, silent, one way, or without
an answer.

One thread runs the event loop of all proxies. The calls of `Proxy` may come from any thread and have taken effect when they
return. The two ways are UP, to the server, and DOWN, to the client.
"""
import asyncio
import collections
import dataclasses
import socket
import struct
import threading
import time

import wire

UP, DOWN = "up", "down"
WAYS = (UP, DOWN)
RESET = struct.pack("ii", 1, 0)  # SO_LINGER of no seconds: close() sends RST


class _Loop:
    """The event loop and its thread, made when the first proxy needs it."""
    running = None
    lock = threading.Lock()

    @classmethod
    def get(cls):
        with cls.lock:
            if cls.running is None:
                cls.running = asyncio.new_event_loop()
                threading.Thread(target=cls.running.run_forever, daemon=True, name="proxy").start()
            return cls.running


def _call(work):
    """Runs a coroutine in the loop and gives what it returns."""
    return asyncio.run_coroutine_threadsafe(work, _Loop.get()).result(60)


@dataclasses.dataclass
class Loss:
    """One answer that is to be withheld: the first whose statements `wanted` accepts, after `skip` others of its kind.

    The statements have been done by then, committed included. `is_silent`: the connection stays open and says nothing
    more, else it is reset.
    """
    wanted: object
    skip: int = 0
    is_silent: bool = False
    lost: wire.Answer = None
    done: threading.Event = dataclasses.field(default_factory=threading.Event)


class Proxy:
    """A port of loopback whose connections go on to the target port. `protocol` is that of PostgreSQL, whose answers it
    follows, or None for another one."""

    def __init__(self, target, protocol="postgres"):
        self.target, self.protocol = target, protocol
        self.delays = dict.fromkeys(WAYS, 0.0)
        self.open = {}             # way: an event that is set while bytes pass
        self.left = dict.fromkeys(WAYS)  # bytes that still pass before a cut, None for any number
        self.is_refusing = False
        self.loss = None
        self.is_noting = False
        self.answers = collections.deque(maxlen=100_000)  # of all connections, when is_noting
        self.connections = set()
        _call(self._listen())

    async def _listen(self):
        for way in WAYS:
            self.open[way] = asyncio.Event()
            self.open[way].set()
        self.server = await asyncio.start_server(self._accept, "127.0.0.1", 0)
        self.port = self.server.sockets[0].getsockname()[1]

    # ---- what a test asks for ----

    def delay(self, up=0.0, down=0.0):
        """Seconds that bytes take each way from now on."""
        self.delays = {UP: up, DOWN: down}

    def hold(self, *ways):
        """Nothing passes the given ways (both, when none is given) until `release`; then it comes late, as TCP sends again.
        New connections are accepted and wait too."""
        async def work():
            for way in ways or WAYS:
                self.open[way].clear()
        _call(work())

    def release(self):
        """Bytes pass, connections are taken, no cut and no loss is waiting."""
        async def work():
            self.is_refusing, self.left, self.loss = False, dict.fromkeys(WAYS), None
            for way in WAYS:
                self.open[way].set()
        _call(work())

    def cut(self, refuse=False):
        """Resets all connections; with refuse each new one too, until `release`."""
        async def work():
            self.is_refusing = refuse
            for connection in list(self.connections):
                connection.reset()
        _call(work())

    def cut_after(self, count, way=DOWN):
        """Resets the connection that carries the count-th byte from now on that way, behind that byte."""
        async def work():
            self.left[way] = count
        _call(work())

    def lose_answer(self, wanted=lambda answer: True, skip=0, is_silent=False):
        """Arms a Loss and returns it; its `done` is set when it has happened."""
        async def work():
            self.loss = Loss(wanted, skip, is_silent)
            return self.loss
        return _call(work())

    def note_answers(self):
        """From now on `answers` gets all that passes, also of connections that are open already."""
        self.is_noting = True

    def close(self):
        async def work():
            self.server.close()
            self.is_refusing = True
            for way in WAYS:
                self.open[way].set()
            for connection in list(self.connections):
                connection.reset()
            while self.connections:
                await asyncio.sleep(0)
        _call(work())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    # ---- in the loop ----

    async def _accept(self, reader, writer):
        connection = _Connection(self, reader, writer)
        if self.is_refusing:
            connection.reset()
            return
        self.connections.add(connection)
        try:
            await connection.run()
        finally:
            self.connections.discard(connection)


class _Connection:
    """One client with its own connection to the server."""

    def __init__(self, proxy, reader, writer):
        self.proxy = proxy
        self.sides = {UP: writer}  # where the bytes of each way come from; DOWN once there is a server
        self.reader = reader
        self.talk = wire.Talk()
        self.tasks, self.is_silent = [], False

    async def run(self):
        await self.proxy.open[UP].wait()
        if self.proxy.is_refusing:
            self.reset()
            return
        try:
            reader, self.sides[DOWN] = await asyncio.open_connection("127.0.0.1", self.proxy.target)
        except OSError:
            self.reset()
            return
        self.tasks = [asyncio.create_task(self._carry(UP, self.reader, self.sides[DOWN])),
                      asyncio.create_task(self._carry(DOWN, reader, self.sides[UP]))]
        try:
            await asyncio.gather(*self.tasks)
        except (OSError, asyncio.CancelledError):
            self.reset()
        finally:
            for writer in self.sides.values():
                writer.close()

    def reset(self):
        for task in self.tasks:
            task.cancel()
        for writer in self.sides.values():
            if not writer.transport.is_closing():
                writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            writer.transport.abort()

    async def _carry(self, way, reader, writer):
        """Reads at once and writes when it is time, so that a delay does not add up over the parts of one answer."""
        waiting = asyncio.Queue(maxsize=256)

        async def read():
            try:
                while data := await reader.read(65536):
                    await waiting.put((time.monotonic() + self.proxy.delays[way], self._look(way, data)))
            except OSError:  # a process that is killed with bytes unread resets its connections, and both sides are to hear of it
                self.reset()
                return
            await waiting.put((time.monotonic() + self.proxy.delays[way], None))

        reading = asyncio.create_task(read())
        try:
            while True:
                due, data = await waiting.get()
                await asyncio.sleep(due - time.monotonic())
                await self.proxy.open[way].wait()
                if data is None:
                    break
                await self._write(way, writer, data)
            await reading
        finally:
            reading.cancel()
        if writer.can_write_eof():
            writer.write_eof()

    async def _write(self, way, writer, data):
        left = self.proxy.left[way]
        if left is not None:
            self.proxy.left[way] = left - len(data) if len(data) < left else None
            if len(data) >= left:
                writer.write(data[:left])
                await writer.drain()
                await asyncio.sleep(0.01)  # so that the peer has them before the reset
                raise ConnectionResetError
        writer.write(data)
        await writer.drain()

    def _look(self, way, data):
        """What of the data is to be passed on; follows the protocol on the way."""
        if self.proxy.protocol is None:
            return data
        if way == UP:
            self.talk.ask(data)
            return data
        passed = b""
        if self.is_silent:
            return passed
        for piece, answer in self.talk.tell(data, is_held=self.proxy.loss is not None):
            if answer and self.proxy.is_noting:
                self.proxy.answers.append(answer)
            if answer and self._is_lost(answer):
                break
            passed += piece
        return passed

    def _is_lost(self, answer):
        loss = self.proxy.loss
        if not loss or not loss.wanted(answer):
            return False
        if loss.skip:
            loss.skip -= 1
            return False
        self.proxy.loss, loss.lost, self.is_silent = None, answer, True
        if not loss.is_silent:
            self.reset()
        loss.done.set()
        return True
