"""The wheel and the source distribution as users get them: installed by pip into clean environments.

`python -m tests.wheel` (`make wheel-test`) builds both from what git tracks. It installs the wheel alone and
with each extra, and runs the commands of the README, its library example, and a command that needs the extra,
from another folder. Without the extra that command has to name it. An environment takes 2 to 4 GB, and is
removed after its use.
"""

import argparse
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from urllib.request import urlopen

from tests.formats.fbx_text import mesh_text
from tests.motion.families import FAMILIES
from tests.motion.layouts import write_layout
from tests.train.simulated import save_clips
from uvcloth.bodies.body import load_body
from uvcloth.garments.templates import fit_template
from uvcloth.motion.library import load_clip
from uvcloth.writers.obj import save_obj

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SCRIPTS = "Scripts" if sys.platform == "win32" else "bin"

VIEW = "uvcloth view walk --model lbs --port 18080"
ROLLOUT = "uvcloth rollout --motion walk --frames 0:4 --garment tops --model lbs --finish none --out"
USES = {
    "simulate": "uvcloth simulate walk --frames 0:4 --garment tops --jobs 1 --out simulated",
    "body": "uvcloth body --height 0.4 --out tall.npz",
    "train": "uvcloth train pbns --garment tops --poses run walk --preset tiny --steps 2 --out run",
    "export": "uvcloth export --model pbns --out rig.glb",
    "video": f"{ROLLOUT} walk.mp4",
    "view": VIEW,
    "alembic": f"{ROLLOUT} walk.abc",
    "fbx": "uvcloth fit blouse.fbx",
    "report": "uvcloth evaluate --model lbs --data data --map-size 16 --out report",
}
"""For each extra a command that needs it."""

NOWHERE = {"HOME": "/proc", "USERPROFILE": "/proc", "XDG_CACHE_HOME": ""}
"""A home that not even root can write to."""

TYPED = "import uvcloth\nuvcloth.load_body().mesh.vertices.missing\nreveal_type(uvcloth.__version__)\n"
"""Of a typed package a checker knows the one and refuses the other."""

SEQUENCES = "benchmarks/*.npz"
"""What only the repository has: see MANIFEST.in."""

SDIST_TESTS = (
    "test_packaging",
    "test_docs",
    "test_dependencies",
    "test_glossary",
    "test_portable",
    "rasterize",
    "files",
)
"""Tests that the unpacked source distribution runs with the packages of this environment."""


class WrongError(Exception):
    """What an installation did other than expected."""


@dataclass(frozen=True)
class Installation:
    """An environment with the wheel, and the folder that its commands run in."""

    scripts: Path
    folder: Path

    def run(self, command: str, code: int = 0, **variables: str) -> str:
        """What a command prints. Raises WrongError for another exit code than expected, or a traceback."""
        done = subprocess.run(
            self._words(command), cwd=self.folder, env=self._variables(variables), check=False, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        if done.returncode != code or "Traceback" in done.stdout:
            raise WrongError(f"{command}: code {done.returncode}, expected {code}\n{done.stdout[-3000:]}")
        return done.stdout

    def serve(self, command: str) -> None:
        """Open the page that a command serves, and end it by SIGTERM. Raises WrongError if that fails."""
        with subprocess.Popen(
            self._words(command), cwd=self.folder, env=self._variables({}), text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        ) as process:  # fmt: skip
            said = ""
            for line in process.stdout or ():
                said += line
                if address := re.search(r"http://\S+", line):
                    with urlopen(address[0]) as page:
                        said += page.read(200).decode()
                    process.send_signal(signal.SIGTERM)
            if process.wait() != 143 or "<html" not in said.lower():
                raise WrongError(f"{command}: code {process.returncode}\n{said[-3000:]}")

    def _words(self, command: str) -> list[str]:
        program, *words = shlex.split(command)
        return [str(self.scripts / program), *words]

    def _variables(self, more: Mapping[str, str]) -> dict[str, str]:
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "UVCLOTH"))}
        return kept | more


def build(kind: str, source: Path, target: Path) -> Path:
    """Build a "wheel" or an "sdist" of a copy of the sources with this environment's setuptools."""
    target.mkdir(parents=True, exist_ok=True)
    code = f"import sys; from setuptools import build_meta; print(build_meta.build_{kind}(sys.argv[1]))"
    command = [sys.executable, "-c", code, str(target)]
    done = subprocess.run(command, cwd=source, check=True, capture_output=True, text=True)
    return target / done.stdout.splitlines()[-1]


def tracked() -> list[str]:
    """The files of the checkout that git tracks, or will."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [name for name in listed.split("\0") if name and (ROOT / name).exists()]


def copy_sources(folder: Path) -> Path:
    """A copy of the sources, since building leaves files beside them."""
    for name in tracked():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    return folder


def write_inputs(folder: Path) -> None:
    """What the README's reader and the commands of USES bring."""
    folder.mkdir()
    body = load_body()
    write_layout(load_clip("walk", body), FAMILIES["CMU"], folder / "walk.bvh")
    blouse = fit_template("shirt", body).mesh
    save_obj(blouse, folder / "blouse.obj")
    (folder / "blouse.fbx").write_text(mesh_text(100.0 * blouse.vertices.numpy(), blouse.faces.numpy()))
    save_clips(folder / "data", ("tops",), clips=2, frames=8)
    (folder / "library.py").write_text(re.findall(r"^```python\n(.*?)^```", README, re.M | re.S)[0])
    (folder / "typed.py").write_text(TYPED)


@contextmanager
def installed(what: str, inputs: Path) -> Iterator[Installation]:
    """A clean environment into which pip has installed something, removed at the end."""
    with tempfile.TemporaryDirectory(prefix="uvcloth-wheel-") as place:
        folder = Path(place)
        subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
        # Of a checkout on PYTHONPATH pip would say that it is installed already.
        pip = [folder / "venv" / SCRIPTS / "python", "-I", "-m", "pip", "install", "-qq", "--no-compile"]
        pins = ["--constraint", ROOT / "constraints.txt"]
        subprocess.run([*pip, *pins, what], check=True, cwd=folder)
        shutil.copytree(inputs, folder / "work")
        yield Installation(folder / "venv" / SCRIPTS, folder / "work")


def check_bare(here: Installation) -> None:
    """The wheel alone: the version, types, homes that cannot be written, and a sentence for every extra."""
    if (said := here.run("uvcloth --version")) != f"uvcloth {PROJECT['version']}\n":
        raise WrongError(f"uvcloth --version: {said}")
    if here.run("python -c 'import uvcloth; print(uvcloth.__version__)'") != f"{PROJECT['version']}\n":
        raise WrongError("uvcloth.__version__ is another version")
    here.run("uvcloth train --help")
    here.run("uvcloth evaluate --help")
    for home in (NOWHERE, {"HOME": ""}):
        here.run("uvcloth motion walk.bvh", **home)
        here.run(f"{ROLLOUT} walk.glb", **home)
    here.run("python library.py")
    for extra, command in USES.items():
        if f"install uvcloth[{extra}]" not in (said := here.run(command, code=2)):
            raise WrongError(f"{command}: does not name its extra\n{said}")
    checker = [sys.executable, "-m", "mypy", "--strict", "--follow-imports", "silent", "--python-executable"]
    done = subprocess.run(
        [*checker, here.scripts / "python", "typed.py"],
        cwd=here.folder,
        check=False,
        capture_output=True,
        text=True,
    )
    if '"Tensor" has no attribute "missing"' not in done.stdout or 'type is "str"' not in done.stdout:
        raise WrongError(f"py.typed: mypy says\n{done.stdout}")


def check_extra(here: Installation, extra: str) -> None:
    """The wheel with one extra: the command that needs it, and no home."""
    if USES[extra] == VIEW:
        here.serve(VIEW)
    else:
        here.run(USES[extra], **NOWHERE)


def check_all(here: Installation) -> None:
    """The wheel with everything: the README's commands, its library example, and those of all extras."""
    for command in re.findall(r"^ {4}(uvcloth (?:motion|body|fit|rollout) [^#\n]*)", README, re.M):
        here.run(command.strip())
    here.run("python library.py")
    for extra in USES:
        check_extra(here, extra)


def check_sdist(sdist: Path, wheel: Path, folder: Path) -> None:
    """The source distribution has every file but simulated sequences, makes the same wheel, and its tests
    run in it.
    """
    shutil.unpack_archive(sdist, folder)
    (source,) = folder.iterdir()
    needed = [name for name in tracked() if not fnmatch(name, SEQUENCES)]
    if missing := [name for name in needed if not (source / name).exists()]:
        raise WrongError(f"{sdist.name}: lacks {missing}")
    tests = [
        f"tests/{name}" if (ROOT / "tests" / name).is_dir() else f"tests/{name}.py" for name in SDIST_TESTS
    ]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n0", *tests],
        cwd=source, env=os.environ | {"PYTHONPATH": str(source)}, check=False, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    print(done.stdout.splitlines()[-1], flush=True)
    if done.returncode:
        raise WrongError(f"{sdist.name}: its tests fail\n{done.stdout[-3000:]}")
    again = build("wheel", source, folder / "wheel")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(again) as other:
        if set(one.namelist()) != set(other.namelist()):
            raise WrongError(f"{sdist.name}: makes another wheel")


def main(arguments: Sequence[str] | None = None) -> int:
    """Build, install and try; returns the exit code: 1 if anything is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.wheel", description=__doc__)
    choices = ("sdist", "bare", *USES, "all")
    parser.add_argument("--only", nargs="+", choices=choices, default=choices, metavar="EXTRA")
    only = parser.parse_args(arguments).only
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="uvcloth-wheel-") as place:
        folder = Path(place)
        source = copy_sources(folder / "source")
        sdist, wheel = build("sdist", source, folder / "built"), build("wheel", source, folder / "built")
        write_inputs(folder / "inputs")
        for name in only:
            begun = time.monotonic()
            try:
                if name == "sdist":
                    check_sdist(sdist, wheel, folder / "unpacked")
                else:
                    with installed(
                        f"{wheel}[{name}]" if name != "bare" else str(wheel), folder / "inputs"
                    ) as here:
                        if name in USES:
                            check_extra(here, name)
                        else:
                            (check_bare if name == "bare" else check_all)(here)
            except WrongError as error:
                wrong += 1
                print(f"{name}: WRONG: {error}", flush=True)
            else:
                print(f"{name}: good, {time.monotonic() - begun:.0f} s", flush=True)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
