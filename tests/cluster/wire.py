"""As much of PostgreSQL's protocol as it takes to see which answer belongs to which statements.

Protocol 3.0, PostgreSQL 15 documentation, chapter 55: a message is a letter and a big-endian length that counts itself; the
first packets of a client have no letter. Each Query or Sync of the client gets one ReadyForQuery, in order. Statements that
are sent with Flush alone, and encrypted connections, are not understood.
"""
import collections
import dataclasses
import struct

ENCRYPTION_REQUESTS = (80877103, 80877104)  # SSL, GSS: the server answers with one byte
ASYNCHRONOUS = b"ANS"      # notification, notice, parameter status: may come when nothing was asked
WAITS_FOR_CLIENT = b"GW"   # COPY FROM STDIN and COPY BOTH: the client speaks next


@dataclasses.dataclass
class Answer:
    """All of the server's messages up to one ReadyForQuery."""
    statements: list   # their texts
    tags: list         # of CommandComplete, as "INSERT 0 1"
    is_error: bool
    is_in_transaction: bool


def split(buffer):
    """Takes the complete messages off a bytearray: pairs of their letter and their bytes, the letter included."""
    found = []
    while len(buffer) >= 5:
        size = 1 + struct.unpack_from(">i", buffer, 1)[0]
        if len(buffer) < size:
            break
        found.append((bytes(buffer[:1]), bytes(buffer[:size])))
        del buffer[:size]
    return found


def text_of(message, start):
    """The string of a message that begins at start, and where the next one begins."""
    end = message.index(b"\0", start)
    return message[start:end].decode(errors="replace"), end + 1


class Talk:
    """What was said so far on one connection."""

    def __init__(self):
        self.asked, self.told = bytearray(), bytearray()
        self.is_starting, self.bytes_due = True, 0
        self.prepared, self.portals = {}, {}
        self.statements, self.requests = [], collections.deque()
        self.is_ready = False      # the first ReadyForQuery has been seen: before it the two sides take turns
        self.messages = []         # of the answer that has begun
        self.kept = b""            # those of them that are held back

    def ask(self, data):
        """Bytes of the client."""
        self.asked += data
        while self.is_starting and len(self.asked) >= 8:
            size, code = struct.unpack_from(">ii", self.asked)
            if len(self.asked) < size:
                return
            del self.asked[:size]
            self.bytes_due += code in ENCRYPTION_REQUESTS
            self.is_starting = code in ENCRYPTION_REQUESTS
        if not self.is_starting:
            for letter, message in split(self.asked):
                self._take(letter, message)

    def _take(self, letter, message):
        if letter == b"Q":
            self.requests.append([text_of(message, 5)[0]])
        elif letter == b"P":
            name, start = text_of(message, 5)
            self.prepared[name] = text_of(message, start)[0]
        elif letter == b"B":
            portal, start = text_of(message, 5)
            self.portals[portal] = self.prepared.get(text_of(message, start)[0], "")
        elif letter == b"E":
            self.statements.append(self.portals.get(text_of(message, 5)[0], ""))
        elif letter == b"S":
            self.requests.append(self.statements)
            self.statements = []

    def tell(self, data, is_held):
        """Bytes of the server: pairs of bytes to pass on and the Answer that they end, or None. With is_held the messages of
        an answer come together, with its end."""
        self.told += data
        passed = []
        while self.bytes_due and self.told:
            passed.append((bytes(self.told[:1]), None))
            del self.told[:1]
            self.bytes_due -= 1
        for letter, message in split(self.told):
            if letter == b"Z":
                passed.append((self.kept + message, self._end(message)))
                self.kept = b""
                continue
            if letter not in ASYNCHRONOUS:
                self.messages.append((letter, message))
            if is_held and self.is_ready and letter not in WAITS_FOR_CLIENT and (self.kept or letter not in ASYNCHRONOUS):
                self.kept += message
            else:
                passed.append((self.kept + message, None))
                self.kept = b""
        return passed

    def _end(self, message):
        answer = Answer(self.requests.popleft() if self.is_ready and self.requests else [],
                        [text_of(text, 5)[0] for letter, text in self.messages if letter == b"C"],
                        any(letter == b"E" for letter, _ in self.messages), message[5:6] != b"I")
        self.is_ready, self.messages = True, []
        return answer
