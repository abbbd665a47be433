"""Web pages on which clothes move: our modules, three.js, the runtime as WebAssembly, and baked files."""

import base64
import html
import json
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

from uvcloth.commands.page import Page
from uvcloth.commands.run.page_characters import PageCharacter, bake_own, load_characters
from uvcloth.commands.run.page_comparison import compared_character
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.physics.fabric import FABRICS
from uvcloth.player.baked import FABRIC

SOURCES = Path(str(files("uvcloth") / "data" / "page"))
WASM = Path(str(files("uvcloth") / "player" / "uvcloth.wasm"))

THREE = "three.min.js"
MODULES = (
    *("runtime.js", "cloth.js", "figure.js", "covered.js", "strain.js", "cage.js", "overlays.js"),
    *("transition.js", "limb.js", "grip.js", "motion.js", "playback.js", "roles.js", "retarget.js", "bvh.js"),
    *("layout.js", "scene.js", "hand.js", "keys.js", "files.js", "arrays.js", "frames.js", "pane.js"),
    *("skinning.js", "perceptron.js", "recurrent.js", "pose.js", "methods.js", "beside.js"),
    *("errors.js", "curve.js", "comparison.js", "opening.js", "page.js"),
)
"""Modules of the page, each after those that it imports."""

POLICY = re.compile(r'(http-equiv="Content-Security-Policy" content=)"[^"]*"')
SINGLE_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' data: 'wasm-unsafe-eval'; worker-src blob:; "
    "style-src 'unsafe-inline'; connect-src blob: data:; img-src blob: data:"
)
"""Content security policy of a page in one file: as in a folder, nothing is fetched from elsewhere."""


@dataclass(frozen=True)
class Written:
    """Result: the page to open, and the sizes of its files in bytes, by name."""

    page: Path
    sizes: Mapping[str, int]

    def lines(self) -> list[str]:
        """Text of the result for a terminal, line by line."""
        parts = ", ".join(f"{name} {size / 1e6:.2f}" for name, size in self.sizes.items() if size >= 5e4)
        return [f"{self.page}: {sum(self.sizes.values()) / 1e6:.2f} MB", f"of which, in MB: {parts}"]


def run(command: Page) -> None:
    """Write the page and say where it is. Raises InputError for bad input."""
    print("\n".join(write_page(command).lines()))


def write_page(command: Page) -> Written:
    """Write a page as a folder, or as one file.

    Raises InputError without the runtime for WebAssembly, as `load_characters` does, and for a full disk.
    """
    if not WASM.is_file():
        raise InputError(
            "page: the runtime for WebAssembly is not installed; `make wasm` compiles it in a checkout, and "
            "wheels have it"
        )
    characters = _characters(command)
    page = _filled((SOURCES / "index.html").read_text(encoding="utf-8"), characters)
    parts = {"uvcloth.wasm": WASM.read_bytes()}
    for character in characters:
        parts |= character.files
    if command.out.suffix.lower() == ".html":
        content = _joined(page, parts).encode()
        _write(command.out, content)
        return Written(command.out, {command.out.name: len(content)})
    names = ("page.css", "worker.js", THREE, *MODULES)
    written = {name: (SOURCES / name).read_bytes() for name in names}
    # The page comes last: where it is, the others are.
    written |= {**parts, "index.html": page.encode()}
    for name, content in written.items():
        _write(command.out / name, content)
    return Written(command.out / "index.html", {name: len(content) for name, content in written.items()})


def _characters(command: Page) -> tuple[PageCharacter, ...]:
    if command.fast and not command.file:
        raise InputError("--fast: name the files that these are the fast quality of")
    if command.simulated is not None:
        return (compared_character(command, command.simulated),)
    for name in ("model", "predicted", "body"):
        if getattr(command, name):
            raise InputError(f"--{name}: needs --simulated")
    return load_characters(command.file, command.fast) if command.file else bake_own()


def _write(path: Path, content: bytes) -> None:
    with atomic_write(path) as unfinished:
        unfinished.write_bytes(content)


def _filled(page: str, characters: Sequence[PageCharacter]) -> str:
    """The page with the choices of its lists."""
    choices = [
        _option(quote(character.name), character.name.removesuffix(".glb"), _methods(character))
        for character in characters
    ]
    fabrics = [
        _option(" ".join(f"{getattr(fabric, each):g}" for each in FABRIC), name)
        for name, fabric in FABRICS.items()
    ]
    page = page.replace("<!-- characters -->", "".join(choices))
    return page.replace("<!-- fabrics -->", "".join(fabrics))


def _methods(character: PageCharacter) -> str:
    """The methods of a character as the page reads them, "" for none."""
    entries = []
    for method in character.methods:
        file = {} if method.content is None else {"file": quote(character.file_of(method))}
        warm_up = {} if method.warm_up is None else {"warmUp": method.warm_up}
        worn = {} if method.worn is None else {"worn": method.worn}
        entries.append({"name": method.name, "kind": method.kind, **file, **warm_up, **worn})
    return json.dumps(entries) if entries else ""


def _option(value: str, text: str, methods: str = "") -> str:
    beside = f' data-methods="{html.escape(methods)}"' if methods else ""
    return f'<option value="{html.escape(value)}"{beside}>{html.escape(text)}</option>'


def _joined(page: str, parts: Mapping[str, bytes]) -> str:
    """The page with everything in it: modules by an import map, the rest deflated, as base64."""

    def source(name: str) -> str:
        return (SOURCES / name).read_text(encoding="utf-8")

    def embedded(content: str) -> str:
        return f"data:text/javascript;base64,{base64.b64encode(content.encode()).decode()}"

    # An address that is data has no folder, so that modules have plain names here.
    modules = {name: source(name).replace('from "./', 'from "') for name in (THREE, *MODULES)}
    entries = ",\n".join(f'"{name}": "{embedded(content)}"' for name, content in modules.items())
    # The worker has no import map: it gets its only module in its own text.
    worker = re.sub(r"^import .*\n", "", source("worker.js"), flags=re.MULTILINE)
    runtime = re.sub(r"^export ", "", source("runtime.js"), flags=re.MULTILINE)
    deflated = {name: zlib.compress(content, 9) for name, content in parts.items()}
    inside = {"worker.js": f"{runtime}\n{worker}".encode(), **deflated}
    scripts = [
        f'<script type="text/plain" data-file="{html.escape(quote(name))}">'
        f"{base64.b64encode(content).decode()}</script>"
        for name, content in inside.items()
    ]
    scripts += [
        f'<script type="importmap">{{"imports": {{\n{entries}\n}}}}</script>',
        '<script type="module">import "page.js";</script>',
    ]
    page = POLICY.sub(rf'\1"{SINGLE_POLICY}"', page)
    page = page.replace(
        '<link rel="stylesheet" href="page.css">', f"<style>\n{source('page.css')}</style>"
    ).replace('<script type="module" src="page.js"></script>\n', "")
    return page.replace("</body>", "\n".join([*scripts, "</body>"]))
