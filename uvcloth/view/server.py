"""viser's server behind `Access`: requests that are refused never reach it, and share requests do nothing.

viser cannot restrict who connects, and if a port is taken it uses the next one. It starts its server by
`websockets.asyncio.server.serve`: during the start another function replaces this one, which gives the server
a socket that already listens, and a `process_request` (the hook of websockets) that asks `Access` before
viser.
"""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from http import HTTPStatus
from typing import Any

import viser
from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request

from uvcloth.errors import InputError
from uvcloth.view.access import Access, listen


class PrivateServer(viser.ViserServer):
    """viser's server, for requests with the token.

    host, port: the address that it listens on. access: the rule that decides on every request. Raises
    InputError as `listen` does, and for a version of viser that does not start as this module says.
    """

    def __init__(self, host: str, port: int) -> None:
        self.access = Access(host, port)
        with _checked(self.access, listen(host, port)):
            super().__init__(host, port, label="uvcloth", verbose=False)
        if self.get_port() != port:
            # viser has opened a port of its own.
            self.stop()
            raise InputError(
                f"the live view supports viser 1.1, not {viser.__version__}: install uvcloth[view]"
            )
        self.gui.configure_theme(show_share_button=False)

    def request_share_url(self, verbose: bool = True) -> None:
        """Do nothing: viser's handler would open a tunnel from the internet for any client."""


@contextmanager
def _checked(access: Access, listening: socket.socket) -> Iterator[None]:
    """Make a server that the block starts use a socket that listens, and put its requests to a rule."""
    usual = websocket_server.serve

    def serve(handler: Any, *_: Any, process_request: Any, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Any:
            hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
            if reason := access.refusal(request.path, hosts, origins):
                return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
            return process_request(connection, replace(request, path=access.inner_path(request.path)))

        return usual(handler, sock=listening, process_request=answer, **options)

    websocket_server.serve = serve  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        websocket_server.serve = usual  # type: ignore[misc]
