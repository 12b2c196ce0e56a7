"""Ports for servers that cannot choose one."""
import socket

CLAIMED = []  # sockets that hold a port and never listen


def claim_port():
    """A port of 127.0.0.1 for a server that cannot choose one, until this process ends.

    A bound socket that does not listen lets in a server with SO_REUSEADDR, which nearly all set; no bind to port 0 and no
    connection is given the port meanwhile, also while the server is down.
    """
    CLAIMED.append(socket.socket())
    CLAIMED[-1].setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    CLAIMED[-1].bind(("127.0.0.1", 0))
    return CLAIMED[-1].getsockname()[1]
