"""Access to the live view: the rule for requests."""

import os
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from ipaddress import ip_address

from uvcloth.errors import InputError

LOOPBACK = ("localhost", "127.0.0.1", "[::1]")
"""Names by which a browser reaches its own machine."""

WILDCARDS = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}
"""Addresses that stand for all of a machine's own, and the one at which a browser on it finds the page."""

HTTP_PORT = 80
"""The port that browsers leave out of an address."""


@dataclass(frozen=True)
class Access:
    """Rule by which requests to a page are answered or refused.

    host: the address that is listened on, as it was asked for. port: of the page. token: a secret that begins
    every path, since the page's own WebSocket keeps the path of its address and drops the query.
    """

    host: str
    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16), repr=False)

    @property
    def address(self) -> str:
        """Address of the page for a browser on this machine, token included."""
        return f"http://{WILDCARDS.get(self.host, _bracketed(self.host))}:{self.port}/{self.token}"

    @property
    def caution(self) -> str:
        """Sentence on who else reaches the page, "" if nobody does."""
        if _is_loopback(self.host):
            return ""
        return (
            f"--host {self.host}: other machines reach the page, and whoever has its address with the token "
            "sees it and has this machine compute"
        )

    def refusal(self, path: str, hosts: Sequence[str], origins: Sequence[str]) -> str:
        """Reason why a request is refused, as text, "" if it is answered.

        path: of the request, query included. hosts, origins: values of its headers of these names. A page of
        another site has another origin or, where its name was made to lead to this machine (DNS rebinding),
        another host; other users of this machine lack the token.
        """
        if len(hosts) != 1 or not self._is_served(hosts[0].lower()):
            return f"the page is served at port {self.port} of {self.host} and under no other name"
        if any(origin.lower() != f"http://{hosts[0].lower()}" for origin in origins):
            return "the request comes from a page of another address"
        token = path.partition("?")[0].removeprefix("/").partition("/")[0]
        # Bytes that are no ASCII come as surrogates.
        if not secrets.compare_digest(token.encode(errors="surrogateescape"), self.token.encode()):
            return "the token is missing or belongs to an earlier run: open the address that uvcloth printed"
        return ""

    def inner_path(self, path: str) -> str:
        """Path of an answered request without the token."""
        return path.removeprefix(f"/{self.token}") or "/"

    def _is_served(self, host: str) -> bool:
        """Say whether a host header, in lower case, names the page."""
        name = host.removesuffix(f":{self.port}")
        if name == host and self.port != HTTP_PORT:
            return False
        if name in (*LOOPBACK, _bracketed(self.host.lower())):
            return True
        # Other machines use an IP address, which no site can have as its name.
        return not _is_loopback(self.host) and _is_address(name.removeprefix("[").removesuffix("]"))


def listen(host: str, port: int) -> socket.socket:
    """Open a TCP socket that listens.

    Raises InputError for a port that is out of range, taken or reserved, and for a host that is unknown or
    another machine.
    """
    if not 0 < port < 65536:
        raise InputError(f"--port {port}: expected 1 to 65535")
    if set(host) <= set("0123456789.") and not _is_address(host):
        # A resolver may take a minute to find no machine of that name.
        raise InputError(f"--host {host}: unknown address")
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise InputError(f"--host {host}: unknown address") from error
    try:
        return socket.create_server(address, family=family)
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise InputError(f"--port {port}: cannot be opened on {host} ({reason})") from error


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _is_loopback(host: str) -> bool:
    return ip_address(host).is_loopback if _is_address(host) else host == "localhost"
