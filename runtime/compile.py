"""Compile the runtime into shared libraries, with a C++ compiler of the system or with ziglang from PyPI.

`pip install` and `make install` run it. On x86-64 there are two libraries, of which the player takes the one
that the processor runs faster. What has not changed is not compiled again.
`python runtime/compile.py --wasm OUT` writes a module for WebAssembly instead.
"""

import argparse
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
OBJECTS = HERE.parent / "build" / "runtime"
PACKAGE = HERE.parent / "uvcloth" / "player"

ZIGLANG = "ziglang==0.17.1"
"""What is installed to compile where the system has no compiler, and for wheels of other systems."""

ZIG = (sys.executable, "-m", "ziglang", "cc")
"""Command of its compiler of C, which compiles C++ too and does not link the library of C++."""

FLAGS = (
    *("-std=c++20", "-O3", "-fPIC", "-fvisibility=hidden"),
    *("-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics"),
    *("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-ffp-contract=fast"),
    *("-Wall", "-Wextra", "-Wno-psabi"),
)


@dataclass(frozen=True)
class Target:
    """A system to compile for: its name for zig, and its processors by the ends of the libraries' names."""

    zig: str
    suffix: str
    processors: Mapping[str, str]


SUFFIXES = {"linux": ".so", "darwin": ".dylib", "win32": ".dll"}
EVERY, X86_64 = {"": ""}, {"": "x86-64", "_v3": "x86-64-v3"}

TARGETS = {
    "manylinux_2_17_x86_64": Target("x86_64-linux-gnu.2.17", ".so", X86_64),
    "manylinux_2_17_aarch64": Target("aarch64-linux-gnu.2.17", ".so", EVERY),
    "macosx_11_0_arm64": Target("aarch64-macos.11.0", ".dylib", EVERY),
    "macosx_11_0_x86_64": Target("x86_64-macos.11.0", ".dylib", X86_64),
    "win_amd64": Target("x86_64-windows-gnu", ".dll", X86_64),
}
"""Systems that wheels are built for, by the platform in the wheel's name."""

WASM = ("-mexec-model=reactor", "-s", "-Wl,--export-dynamic", "-Wl,--export=malloc", "-Wl,--export=free")
"""Flags that link a module whose host calls the functions of uvcloth.h."""


def this_system() -> Target:
    """The system that runs this."""
    wide = platform.machine().lower() in ("x86_64", "amd64") and sys.maxsize > 1 << 32
    return Target("", SUFFIXES.get(sys.platform, ".so"), X86_64 if wide else EVERY)


def system_compiler() -> list[str]:
    """The command of the system's C++ compiler, $CXX or the first that there is; empty if there is none."""
    commands = map(shlex.split, (os.environ.get("CXX", ""), "c++", "g++", "clang++"))
    return next((command for command in commands if command and shutil.which(command[0])), [])


def requirements() -> list[str]:
    """Packages that are needed to compile here."""
    return [] if system_compiler() else [ZIGLANG]


def compile_runtime(folder: Path = PACKAGE, system: str | None = None) -> None:
    """Compile the libraries into a folder, for this system or, by zig, for one of TARGETS.

    Raises SystemExit, after what the compiler says, if it fails.
    """
    target = TARGETS[system] if system else this_system()
    command = [] if system else system_compiler()
    by_zig = not command
    if by_zig:
        command = [*ZIG, *(["-target", target.zig] if target.zig else [])]
    # Zig writes the names of processors in its own way.
    march = {
        name: [f"-march={processor.replace('-', '_') if by_zig else processor}"] if processor else []
        for name, processor in target.processors.items()
    }
    for name, flags in march.items():
        objects = _compile([*command, *flags, *FLAGS], sorted(HERE.glob("src/*.cpp")))
        # For every processor that it links for, zig compiles the system's libraries: for minutes on Windows.
        stripped = ["-s"] if by_zig else []
        _link(
            [*command, *march[""], *stripped, "-shared"], objects, folder / f"libuvcloth{name}{target.suffix}"
        )


def compile_wasm(module: Path) -> None:
    """Compile the runtime, by zig, into a WebAssembly module with 128-bit vectors; its host gives it WASI.

    Raises SystemExit, after what the compiler says, if it fails.
    """
    command = [*ZIG, "-target", "wasm32-wasi", "-msimd128"]
    # Code that runs at any address would look functions up in a table.
    flags = [flag for flag in FLAGS if flag != "-fPIC"]
    _link([*command, *WASM], _compile([*command, *flags], sorted(HERE.glob("src/*.cpp"))), module)


def _compile(command: Sequence[str], sources: Sequence[Path]) -> list[Path]:
    """Compile files to objects, of which the names say all that they were made of."""
    OBJECTS.mkdir(parents=True, exist_ok=True)
    headers = sorted([*HERE.glob("include/*.h"), *HERE.glob("src/*.h")])
    said = hashlib.sha256(b"\0".join([repr(command).encode(), *(path.read_bytes() for path in headers)]))

    def compiled(source: Path) -> Path:
        digest = said.copy()
        digest.update(source.read_bytes())
        made = OBJECTS / f"{source.stem}-{digest.hexdigest()[:16]}.o"
        if not made.exists():
            begun = made.with_suffix(f".{os.getpid()}")
            _run([*command, f"-I{HERE / 'include'}", f"-I{HERE / 'src'}", "-c", source, "-o", begun])
            begun.replace(made)
        return made

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(compiled, sources))


def _link(command: Sequence[str], objects: Sequence[Path], library: Path) -> None:
    """Link objects; a library that some process has loaded is replaced, not changed."""
    library.parent.mkdir(parents=True, exist_ok=True)
    # The compiler would have the library of C++ loaded, which nothing here uses.
    needed = ["-Wl,--as-needed", "-Wl,-z,defs"] if library.suffix == ".so" else []
    # A folder of its own, since linkers for Windows write a file beside the library.
    begun = OBJECTS / f"linked-{os.getpid()}" / library.name
    begun.parent.mkdir(exist_ok=True)
    _run([*command, *needed, *objects, "-o", begun])
    moved = library.with_name(f"{library.name}.{os.getpid()}")
    shutil.move(begun, moved)
    moved.replace(library)
    shutil.rmtree(begun.parent)


def _run(command: Sequence[str | Path]) -> None:
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.stderr.strip():
        print(done.stderr, file=sys.stderr)
    if done.returncode:
        raise SystemExit(f"the runtime cannot be compiled: {shlex.join(map(str, command))} failed")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wasm", type=Path, metavar="OUT", help="a module for WebAssembly to write")
    module = parser.parse_args().wasm
    if (module or requirements()) and find_spec("ziglang") is None:
        subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", ZIGLANG], check=True)
    if module:
        compile_wasm(module)
    else:
        compile_runtime()
