"""Serves the page on loopback, for browsers that refuse local files."""

from __future__ import annotations

from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from lippmann.errors import input_error

LOOPBACK = "127.0.0.1"


def page_server(page: bytes, tcp_port: int = 0) -> ThreadingHTTPServer:
    """Return a server of the page, bound to loopback but not started; port 0 means any free port.

    InputError when the port is taken.
    """

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            """Send the page."""
            if self.path != "/":
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(page)))
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, format: str, *arguments: object) -> None:
            """Do not log requests."""

    try:
        return ThreadingHTTPServer((LOOPBACK, tcp_port), Handler)
    except OSError as error:
        raise input_error(
            f"--tcp-port {tcp_port}", f"cannot be opened ({error.strerror})", "choose another, or 0"
        ) from None
