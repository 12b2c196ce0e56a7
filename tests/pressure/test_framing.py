"""Requests whose end two readers could see in two places: refused, and the bytes behind them are no second request.

The shapes are those of RFC 9112, sections 5.1, 5.2 and 6, and of requests that were smuggled past real proxies."""
import socket

import pytest

BEHIND = b"GET /v1/info HTTP/1.1\r\nHost: localhost\r\nX-Request-Id: behind\r\n\r\n"
HEAD = b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\n"
LENGTH = b"%d" % len(BEHIND)
SHAPES = {
    "blank before the colon": HEAD + b"Content-Length : " + LENGTH,
    "tab before the colon": HEAD + b"Content-Length\t: " + LENGTH,
    "length on the next line": HEAD + b"Content-Length:\r\n " + LENGTH,
    "length on two lines": HEAD + b"Content-Length: " + LENGTH + b"\r\n 0",
    "first header behind a blank": b"POST /v1/jobs HTTP/1.1\r\n Content-Length: " + LENGTH + b"\r\nHost: localhost",
    "coding with a blank before the colon": HEAD + b"Transfer-Encoding : chunked",
    "coding with a tab before the colon": HEAD + b"Transfer-Encoding\t: chunked",
    "coding with a NUL": HEAD + b"Transfer-Encoding: chunked\0x",
    "length with a NUL": HEAD + b"Content-Length: " + LENGTH + b"\x000",
    "coding on the next line": HEAD + b"Transfer-Encoding:\r\n chunked",
    "coding on two lines": HEAD + b"Transfer-Encoding: chunked\r\n , identity",
    "carriage return in a value": HEAD + b"X: a\rContent-Length: " + LENGTH,
    "carriage return in a name": HEAD + b"X\rContent-Length: " + LENGTH,
    "NUL in a name": HEAD + b"Content-Length\0: " + LENGTH,
    "length and coding": HEAD + b"Content-Length: " + LENGTH + b"\r\nTransfer-Encoding: chunked",
    "coding twice": HEAD + b"Transfer-Encoding: chunked\r\nTransfer-Encoding: identity",
    "length twice": HEAD + b"Content-Length: 0\r\nContent-Length: " + LENGTH,
    "list of lengths": HEAD + b"Content-Length: 0, " + LENGTH,
    "sign": HEAD + b"Content-Length: +" + LENGTH,
    "hexadecimal": HEAD + b"Content-Length: 0x10",
    "empty length": HEAD + b"Content-Length:",
    "blank in the length": HEAD + b"Content-Length: 4 5",
    "unknown coding": HEAD + b"Transfer-Encoding: chunked, gzip",
    "coding in quotes": HEAD + b'Transfer-Encoding: "chunked"',
    "coding behind a vertical tab": HEAD + b"Transfer-Encoding: \x0bchunked",
    "no colon": HEAD + b"Content-Length " + LENGTH,
    "name in brackets": HEAD + b"(Content-Length): " + LENGTH,
    "name of another alphabet": HEAD + "Contént-Length: ".encode() + LENGTH,
    "two hosts": HEAD + b"Host: localhost",
    "no host": b"GET /v1/info HTTP/1.1",
    "no host in a later version": b"GET /v1/info HTTP/1.2",
}


def exchange(daemon, text):
    """All that comes back until the daemon closes the connection or is silent."""
    received = b""
    with socket.create_connection(("127.0.0.1", daemon.port), timeout=2) as connection:
        try:
            connection.sendall(text)
            while chunk := connection.recv(65536):
                received += chunk
        except OSError:
            pass
    return received


@pytest.mark.parametrize("chunk", [b"", b"0\r\n\r\n"], ids=["no body", "the last chunk"])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_bytes_behind_are_no_request(daemon, client, shape, chunk):
    received = exchange(daemon, SHAPES[shape] + b"\r\n\r\n" + chunk + BEHIND)
    assert received.startswith(b"HTTP/1.1 400 ") or received == b"", received
    assert b"behind" not in received and b"HTTP/1.1 2" not in received, received
    assert client.get("/healthz").status_code == 200


def test_a_request_behind_a_whole_one_is_answered(daemon):
    for frame in (b"Content-Length: 2\r\n\r\n{}", b"content-length:2\r\n\r\n{}", b"Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n",
                  b"transfer-encoding:\tChunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n"):
        received = exchange(daemon, HEAD + b"Content-Type: application/json\r\n" + frame + BEHIND)
        assert received.count(b"HTTP/1.1 ") == 2 and b"behind" in received, received


@pytest.mark.parametrize("target", [b"http://localhost/v1/info", b"HTTP://127.0.0.1:7878/v1/info", b"https://localhost/v1/info"])
def test_absolute_targets(daemon, target):
    assert exchange(daemon, b"GET " + target + b" HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").startswith(b"HTTP/1.1 200 ")


def test_the_host_of_an_absolute_target_goes_before_the_header(daemon):
    """Host may name any server then; the target may not."""
    target = b"GET http://elsewhere.example/v1/info HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    assert exchange(daemon, target).startswith(b"HTTP/1.1 403 ")
    target = b"GET http://localhost/v1/info HTTP/1.1\r\nHost: elsewhere.example\r\nConnection: close\r\n\r\n"
    assert exchange(daemon, target).startswith(b"HTTP/1.1 200 ")
    assert exchange(daemon, b"GET http://localhost HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").startswith(b"HTTP/1.1 200 ")
