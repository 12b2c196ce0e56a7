"""What clients asked and what they were answered: the material of the checkers.

A call has effect at one instant between its start and its end. One without an answer (a cut connection, a 503) may have had
its effect at any instant after its start, or never; its end is infinite.
"""
import dataclasses
import json
import math
import threading
import time


@dataclasses.dataclass(eq=False)
class Call:
    """Times are seconds of one monotonic clock; all clients are threads of one process."""
    process: str               # the client, which has one call at a time
    name: str                  # what was asked; checkers.py lists the names and what their answers hold
    key: str                   # what it is about: an id, or an Idempotency-Key
    arguments: dict
    start: float
    end: float = math.inf
    node: str = ""
    answer: dict = None        # None: nobody knows

    @property
    def is_known(self):
        return self.answer is not None

    def __str__(self):
        answer = "unknown" if self.answer is None else json.dumps(self.answer)
        if len(answer) > 200:
            answer = answer[:200] + "..."
        return (f"[{self.start:.6f}, {self.end:.6f}] {self.process} at {self.node or '?'}: {self.name} {self.key} "
                f"{json.dumps(self.arguments)} -> {answer}")


class History:
    """The calls of all clients, in the order in which they began."""

    def __init__(self, calls=()):
        self.calls = list(calls)
        self.lock = threading.Lock()

    def begin(self, process, name, key="", node="", **arguments):
        """To be called just before the request is sent. Without an `end` the call stays unknown."""
        with self.lock:
            self.calls.append(Call(process, name, key, arguments, time.monotonic(), node=node))
            return self.calls[-1]

    def end(self, call, **answer):
        """To be called just after the answer was read."""
        with self.lock:
            call.end, call.answer = time.monotonic(), answer

    def withdraw(self, call):
        """Takes back a call that is known to have had no effect, and whose refusal tells nothing."""
        with self.lock:
            self.calls.remove(call)

    def save(self, path):
        with self.lock, open(path, "w") as file:
            file.writelines(json.dumps(dataclasses.asdict(call)) + "\n" for call in self.calls)

    @classmethod
    def load(cls, path):
        with open(path) as file:
            return cls(Call(**json.loads(line)) for line in file)
