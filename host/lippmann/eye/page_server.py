"""Serves the viewer page at a loopback address, for browsers that refuse local files."""

from __future__ import annotations

import secrets
import socket
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from lippmann.errors import input_error

LOOPBACK = "127.0.0.1"
#: Maximum simultaneous requests.
MAX_REQUESTS = 8
#: Time after which a silent connection ends, s.
SILENCE_S = 10.0
HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Frame-Options": "DENY",
}


class PageServer(ThreadingHTTPServer):
    """A server of one page at `url`, a secret loopback address; the constructor does not start it.

    TCP port 0 means any free port. Raises InputError if the port cannot be opened.
    """

    daemon_threads = True

    def __init__(self, page: bytes, tcp_port: int = 0) -> None:
        self.page = page
        self.path = f"/{secrets.token_urlsafe(16)}/"
        self._free = threading.Semaphore(MAX_REQUESTS)
        try:
            super().__init__((LOOPBACK, tcp_port), _Handler)
        except OSError as error:
            what = f"cannot listen on port {tcp_port} ({error.strerror})"
            raise input_error("--tcp-port", what, "choose another port, or 0 for a free one") from None
        port = self.server_address[1]
        self.url = f"http://{LOOPBACK}:{port}{self.path}"
        self.hosts = [f"{host}:{port}" for host in (LOOPBACK, "localhost")]
        self.origins = [f"http://{host}" for host in self.hosts]

    def verify_request(self, request: object, client_address: object) -> bool:
        """Accept a request unless too many requests are running."""
        return self._free.acquire(blocking=False)

    def process_request_thread(
        self, request: socket.socket | tuple[bytes, socket.socket], client_address: object
    ) -> None:
        """Answer a request in its thread."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a browser that closed the connection."""


class _Handler(BaseHTTPRequestHandler):
    timeout = SILENCE_S
    server: PageServer

    def do_GET(self) -> None:
        """Send the page; refuse requests from other sites, which name another host or origin."""
        origin = self.headers.get("Origin")
        if self.headers.get("Host") not in self.server.hosts or origin not in (None, *self.server.origins):
            self.send_error(HTTPStatus.FORBIDDEN)
        elif not secrets.compare_digest(self.path.encode(), self.server.path.encode()):
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            self.send_response(HTTPStatus.OK)
            for name, value in HEADERS.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(self.server.page)))
            self.end_headers()
            self.wfile.write(self.server.page)

    def log_message(self, format: str, *arguments: object) -> None:
        """Do not log requests."""
