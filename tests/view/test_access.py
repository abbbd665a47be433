"""Who may open the live view: a real server, asked as browsers, pages of other sites and programs ask it."""

import http.client
import re
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from tests.view.test_view import moving, rising, shell, tick_until
from uvcloth.errors import InputError
from uvcloth.view.access import Access, listen
from uvcloth.view.computation import Computation
from uvcloth.view.viewer import Viewer

viser = pytest.importorskip("viser", reason="viser is not installed")
msgspec = pytest.importorskip("msgspec", reason="viser is not installed")
zstandard = pytest.importorskip("zstandard", reason="viser is not installed")
client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
failures = pytest.importorskip("websockets.exceptions", reason="websockets is not installed")

TOKEN = "a-token"
EVIL = "evil.example"


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port


@pytest.fixture(scope="module")
def viewer() -> Iterator[Viewer]:
    """A live view that shows the first frame of a shell around the small body."""
    viewer = Viewer(port=free_port())
    viewer.show(Computation(lambda: rising("walk", 0.1)).start())
    tick_until(viewer, lambda: viewer.shown == 0)
    yield viewer
    viewer.close()


def status(viewer: Viewer, path: str, **headers: str) -> int:
    """Status of a plain HTTP request; of `Host` and `Origin`, those that are given replace the right ones."""
    connection = http.client.HTTPConnection("127.0.0.1", viewer.server.get_port(), timeout=10)
    connection.request("GET", path, headers=headers)
    return connection.getresponse().status


def upgraded(viewer: Viewer, path: str, host: str = "", origin: str | None = None) -> Any:
    """A WebSocket as viser's page opens it. Raises InvalidStatus if the server refuses."""
    port = viewer.server.get_port()
    return client.connect(
        f"ws://{host or f'127.0.0.1:{port}'}{path}",
        sock=socket.create_connection(("127.0.0.1", port), timeout=10),
        origin=origin,
        subprotocols=[f"viser-v{viser.__version__}"],
        max_size=None,
    )


def refused(viewer: Viewer, path: str, host: str = "", origin: str | None = None) -> int:
    """Status with which the upgrade to a WebSocket is refused."""
    with pytest.raises(failures.InvalidStatus) as error, upgraded(viewer, path, host, origin):
        pass
    code: int = error.value.response.status_code
    return code


def messages(data: bytes) -> Iterator[dict[str, Any]]:
    """Messages of a packet of viser's, arrays in the places that stand for them."""
    size, packed = (int.from_bytes(data[start : start + 8], "little") for start in (0, 8))
    packet = msgspec.msgpack.decode(
        zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=size)
    )
    start, buffers = 16 + packed, []
    for length in packet["binaryBufferLengths"]:
        start = -(-start // 8) * 8
        buffers.append(data[start : start + length])
        start += length

    def restored(value: Any) -> Any:
        if isinstance(value, dict) and "__binary_index" in value:
            return np.frombuffer(buffers[value["__binary_index"]], value["dtype"])
        return {key: restored(each) for key, each in value.items()} if isinstance(value, dict) else value

    yield from (restored(message) for message in packet["messages"])


def token_of(viewer: Viewer) -> str:
    return viewer.address.rpartition("/")[2]


def test_the_page_and_its_websocket_open_with_the_token(viewer: Viewer) -> None:
    """The page asks for its WebSocket at its own path without query and last slash."""
    port = viewer.server.get_port()
    assert re.fullmatch(rf"http://127\.0\.0\.1:{port}/[\w-]{{20,}}", viewer.address)
    path = f"/{token_of(viewer)}"
    for page in (path, f"{path}/", f"{path}?websocket=ws://127.0.0.1:{port}{path}", f"{path}/index.html"):
        assert status(viewer, page) == 200
    for name in ("127.0.0.1", "localhost", "[::1]"):
        assert status(viewer, path, Host=f"{name}:{port}") == 200
        host = f"{name}:{port}"
        with upgraded(viewer, path, host, f"http://{host}") as page:
            assert page.response.status_code == 101
    with upgraded(viewer, path, origin=f"http://127.0.0.1:{port}") as page:
        deadline, vertices = time.monotonic() + 10, None
        while vertices is None and time.monotonic() < deadline:
            for message in messages(page.recv(timeout=10)):
                if message.get("name") == "/predicted/garment_0/0" and "props" in message:
                    vertices = message["props"]["vertices"]
    assert vertices is not None
    np.testing.assert_allclose(np.reshape(vertices, (-1, 3)), shell().vertices, atol=1e-6)


def test_body_and_cloth_of_a_frame_are_in_one_message(viewer: Viewer) -> None:
    """However the thread that sends and the one that plays take turns, and however late the browser reads."""
    count, heights = 90, []
    up = torch.tensor([0.0, 0.0, 0.01])
    running = Viewer(port=free_port())
    running.show(Computation(lambda: moving("walk", up, count=count)).start())
    running._speed.value = 2.0
    tick_until(running, lambda: running.shown == 0)
    playing = threading.Thread(target=running.run, daemon=True)
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with upgraded(running, f"/{token_of(running)}") as page:
            playing.start()
            while not heights or heights[-1] < 0.01 * (count - 1) - 1e-4:
                lowest = {
                    message["name"]: float(np.reshape(changed["vertices"], (-1, 3))[:, 2].min())
                    for message in messages(page.recv(timeout=10))
                    if "vertices" in (changed := message.get("updates", {}))
                }
                if lowest:
                    body, cloth = lowest["/predicted/body"], lowest["/predicted/garment_0/0"]
                    assert body - cloth == pytest.approx(0.02, abs=1e-5)
                    heights.append(body + 0.1)
                time.sleep(0.001)
    finally:
        sys.setswitchinterval(usual)
        running.close()
        playing.join()
    assert len(heights) > 10


def test_without_the_token_nothing_is_answered(viewer: Viewer) -> None:
    token = token_of(viewer)
    for path in (
        "/", "/index.html", "//", f"/{token[:-1]}", f"/{token}x", f"/x/{token}", f"/?token={token}",
        f"/{token.swapcase()}", "/%2e%2e/", f"/{token}%2f",
    ):  # fmt: skip
        assert status(viewer, path) == 403, path
    for path in ("/", f"/{token[:-1]}", f"/?token={token}"):
        assert refused(viewer, path) == 403, path
    access = Access("127.0.0.1", 8080)
    assert access.token != token
    # websockets reads bytes that are no ASCII so.
    assert "token" in access.refusal("/\udce4", ["127.0.0.1:8080"], [])


def test_a_page_of_another_origin_gets_no_websocket(viewer: Viewer) -> None:
    path, port = f"/{token_of(viewer)}", viewer.server.get_port()
    for origin in (
        f"http://{EVIL}", f"http://{EVIL}:{port}", "http://127.0.0.1", f"http://127.0.0.1:{port + 1}", "",
        f"https://127.0.0.1:{port}", f"http://127.0.0.1:{port}.{EVIL}", f"http://localhost:{port}", "null",
    ):  # fmt: skip
        assert refused(viewer, path, origin=origin) == 403, origin
        assert status(viewer, path, Origin=origin) == 403, origin


def test_another_name_that_leads_here_is_refused(viewer: Viewer) -> None:
    """A page at evil.example:PORT whose name was made to lead to this machine has its own origin and host."""
    path, port = f"/{token_of(viewer)}", viewer.server.get_port()
    for host in (
        f"{EVIL}:{port}", EVIL, f"127.0.0.1.{EVIL}:{port}", f"127.0.0.1:{port + 1}", "127.0.0.1", "localhost",
        f"192.168.1.5:{port}", f"0.0.0.0:{port}", f"{EVIL}@127.0.0.1:{port}", "",
    ):  # fmt: skip
        assert status(viewer, path, Host=host) == 403, host
    for host in (f"{EVIL}:{port}", f"127.0.0.1:{port + 1}"):
        assert refused(viewer, path, host, f"http://{host}") == 403, host
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.putrequest("GET", path, skip_host=True)
    for host in (f"127.0.0.1:{port}", f"{EVIL}:{port}"):
        connection.putheader("Host", host)
    connection.endheaders()
    assert connection.getresponse().status == 403


def test_a_refusal_says_why(viewer: Viewer) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", viewer.server.get_port(), timeout=10)
    connection.request("GET", "/")
    assert b"open the address that uvcloth printed" in connection.getresponse().read()


def test_other_machines_come_by_address_once_they_are_let_in() -> None:
    access = Access("0.0.0.0", 8080, TOKEN)
    assert access.address == f"http://127.0.0.1:8080/{TOKEN}"
    for host in ("127.0.0.1:8080", "localhost:8080", "192.168.1.5:8080", "[fe80::1]:8080", "LOCALHOST:8080"):
        assert access.refusal(f"/{TOKEN}", [host], [f"http://{host}"]) == ""
    for host in (f"{EVIL}:8080", "192.168.1.5", "192.168.1.5:80", "192.168.1.5.nip.example:8080"):
        assert access.refusal(f"/{TOKEN}", [host], [])
    named = Access("mybox.example", 80, TOKEN)
    assert named.address == f"http://mybox.example:80/{TOKEN}"
    assert named.refusal(f"/{TOKEN}", ["mybox.example"], ["http://mybox.example"]) == ""
    assert named.refusal(f"/{TOKEN}", [EVIL], [])
    assert Access("::1", 8080, TOKEN).address == f"http://[::1]:8080/{TOKEN}"


def test_who_else_reaches_the_page_is_said() -> None:
    assert [Access(host, 8080).caution for host in ("127.0.0.1", "::1", "localhost")] == ["", "", ""]
    for host in ("0.0.0.0", "192.168.1.5", "mybox.example"):
        assert re.match(f"--host {host}: other machines reach the page, .* token", Access(host, 8080).caution)


def wait(reached: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not reached():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_share_request_opens_no_tunnel(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same message has viser's own server open one, so that this test knows what such a request is."""
    opened: list[int] = []

    class Tunnel:
        def __init__(self, domain: str, port: int) -> None:
            opened.append(port)
            raise ConnectionError("this test opens none")

    monkeypatch.setattr("viser._viser.ViserTunnel", Tunnel)
    request = msgspec.msgpack.encode(viser._messages.ShareUrlRequest().as_serializable_dict())
    viewer, bare = Viewer(port=free_port()), viser.ViserServer("127.0.0.1", free_port(), verbose=False)
    asked = threading.Event()
    try:
        websocket = viewer.server._websock_server
        websocket.register_handler(viser._messages.ShareUrlRequest, lambda *_: asked.set())
        with upgraded(viewer, f"/{token_of(viewer)}") as page:
            page.send(request)
            assert asked.wait(10)
        viewer.server._thread_executor.shutdown(wait=True)
        assert opened == []
        assert viewer.server.request_share_url() is None
        assert opened == []
        with client.connect(
            f"ws://127.0.0.1:{bare.get_port()}", subprotocols=[f"viser-v{viser.__version__}"], max_size=None
        ) as page:
            page.send(request)
            wait(lambda: opened == [bare.get_port()])
    finally:
        viewer.close()
        bare.stop()


def test_the_page_offers_no_share_button(viewer: Viewer) -> None:
    with upgraded(viewer, f"/{token_of(viewer)}") as page:
        themes: list[dict[str, Any]] = []
        while not themes:
            themes = [m for m in messages(page.recv(timeout=10)) if m["type"] == "ThemeConfigurationMessage"]
    assert themes[0]["show_share_button"] is False


def test_a_viser_that_starts_in_another_way_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A server that is started by another function than the one replaced asks nobody for a token."""
    monkeypatch.setattr("uvcloth.view.server.websocket_server", SimpleNamespace(serve=None))
    with pytest.raises(InputError, match=rf"supports viser 1\.1, not {re.escape(viser.__version__)}"):
        Viewer(port=free_port())


@pytest.mark.parametrize("port", [99999, 65536, 0, -1])
def test_a_port_that_there_is_not_is_refused_at_once(port: int) -> None:
    with pytest.raises(InputError, match=f"--port {port}: expected 1 to 65535"):
        Viewer(port=port)


def test_a_port_that_is_taken_is_refused_at_once(viewer: Viewer) -> None:
    port = viewer.server.get_port()
    with pytest.raises(InputError, match=rf"--port {port}: cannot be opened on 127\.0\.0\.1 \(.*in use\)$"):
        Viewer(port=port)
    with listen("127.0.0.1", free_port()) as other:
        taken = other.getsockname()[1]
        with pytest.raises(InputError, match=f"--port {taken}: cannot be opened"):
            Viewer(port=taken)


@pytest.mark.parametrize("host", ["999.1.1.1", "1.2.3.4.5", "1.2.3.256"])
def test_no_resolver_is_asked_for_numbers(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socket.getaddrinfo", None)
    with pytest.raises(InputError, match=f"--host {host}: unknown address"):
        listen(host, free_port())


@pytest.mark.parametrize("host", ["nowhere.invalid", "", "a" * 300])
def test_a_host_that_there_is_not_is_refused_at_once(host: str) -> None:
    with pytest.raises(InputError, match=f"--host {host}: unknown address"):
        Viewer(host, free_port())
