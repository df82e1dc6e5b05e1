"""The page's server: for this user's browser alone, whatever asks."""

import http.client
import socket
import threading
import time
from contextlib import ExitStack

import pytest
from lippmann.eye import page_server as serve
from lippmann.eye.page_server import MAX_REQUESTS, PageServer

PAGE = b"<p>the page</p>"


@pytest.fixture
def server():
    with PageServer(PAGE) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def answer(server, path=None, **headers):
    connection = http.client.HTTPConnection(*server.server_address, timeout=5)
    try:
        connection.putrequest("GET", path or server.path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        got = connection.getresponse()
        return got.status, got.read()
    finally:
        connection.close()


def test_only_who_knows_the_address_gets_the_page(server):
    port = server.server_address[1]
    assert server.url == f"http://127.0.0.1:{port}{server.path}"
    assert answer(server) == (200, PAGE)
    assert answer(server, Host=f"localhost:{port}", Origin=f"http://localhost:{port}") == (200, PAGE)
    for path in ("/", "/etc/passwd", server.path[:-2] + "/", server.path + "x", "//", "/%2e%2e/"):
        status, body = answer(server, path)
        assert (status, PAGE in body) == (404, False)
    with PageServer(PAGE) as other:
        assert other.path != server.path
        assert len(other.path) >= 20


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example"}, {"Host": ""}, {"Host": "127.0.0.1"}, {"Host": "127.0.0.1:1"},
     {"Origin": "http://evil.example"}, {"Origin": "null"}],
)  # fmt: skip
def test_pages_of_other_sites_get_nothing(server, headers):
    """A name of theirs may be made to mean this machine."""
    status, body = answer(server, **headers)
    assert (status, PAGE in body) == (403, False)


def test_threads_are_bounded_and_silent_clients_let_go(server, monkeypatch):
    monkeypatch.setattr(serve._Handler, "timeout", 0.7)
    before = threading.active_count()
    with ExitStack() as lines:
        silent = [lines.enter_context(socket.create_connection(server.server_address)) for _ in range(MAX_REQUESTS + 4)]
        time.sleep(0.3)
        assert threading.active_count() - before <= MAX_REQUESTS
        silent[-1].settimeout(2.0)
        assert silent[-1].recv(1) == b""  # one too many
        until = time.monotonic() + 10
        while threading.active_count() > before and time.monotonic() < until:
            time.sleep(0.05)
        assert answer(server) == (200, PAGE)
