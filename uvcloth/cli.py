"""The `uvcloth` command: a table of its subcommands.

Their modules import heavy ones when they run, so that `uvcloth --help` answers at once.
"""

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path

from tyro.extras import subcommand_cli_from_dict

from uvcloth.commands.bake import Bake
from uvcloth.commands.body import MakeBody
from uvcloth.commands.command import Command
from uvcloth.commands.data import Data
from uvcloth.commands.demo import Demo
from uvcloth.commands.export import Export
from uvcloth.commands.fit import Fit
from uvcloth.commands.log import printed_log
from uvcloth.commands.maps import Maps
from uvcloth.commands.motion import DescribeMotion
from uvcloth.commands.outfits import Outfits
from uvcloth.commands.page import Page
from uvcloth.commands.play import Play
from uvcloth.commands.poses import DrawPoses
from uvcloth.commands.rollout import Rollout
from uvcloth.commands.serve import Serve
from uvcloth.commands.simulate import Simulate
from uvcloth.commands.tryon import TryOn
from uvcloth.commands.view import View
from uvcloth.files.options import parsed
from uvcloth.process.command import run_command
from uvcloth.version import package_version

DESCRIPTION = """Motion capture in, moving clothes out.

The first hour:

uvcloth view

uvcloth fit shirt.obj

uvcloth rollout --motion walk.bvh --garment shirt.obj --out walk.mp4 walk.glb

Train a method, judge methods:

uvcloth train physxnet --data data --out runs/first

uvcloth evaluate --model lbs_smooth runs/first --data data --out report

uvcloth --version"""


COMMANDS: dict[str, Callable[..., Command]] = {
    "view": View,
    "motion": DescribeMotion,
    "fit": Fit,
    "rollout": Rollout,
    "bake": Bake,
    "play": Play,
    "page": Page,
    "tryon": TryOn,
    "body": MakeBody,
    "simulate": Simulate,
    "data": Data,
    "maps": Maps,
    "poses": DrawPoses,
    "outfits": Outfits,
    "export": Export,
    "serve": Serve,
    "demo": Demo,
}
"""The subcommands by name, in the order of the help text."""

PROGRAMS = ("train", "evaluate")
"""Commands that are packages: inside this one when installed from a wheel, beside it in a checkout."""


def main() -> int:
    """Run `uvcloth` and return the exit code (0, 2 for bad input, 130 after Ctrl-C)."""
    return run_command("uvcloth", _run)


def parse(arguments: Sequence[str]) -> Command:
    """Parse a command line.

    Raises InputError for an option out of its range, and SystemExit after a help text and for other mistakes,
    which are printed.
    """

    def tyro() -> Command:
        return subcommand_cli_from_dict(COMMANDS, prog="uvcloth", description=DESCRIPTION, args=arguments)

    return parsed(tyro, arguments)


def _run() -> None:
    if sys.argv[1:] == ["--version"]:
        print(f"uvcloth {package_version()}")
        return
    if sys.argv[1:2] and sys.argv[1] in PROGRAMS:
        _program(sys.argv[1])(sys.argv[2:])
        return
    command = parse(sys.argv[1:])
    with printed_log():
        command.run()


def _program(name: str) -> Callable[[Sequence[str]], None]:
    """The function that runs the arguments of one of PROGRAMS."""
    package = Path(__file__).parent
    if (package / name / "__main__.py").is_file():
        return import_module(f"uvcloth.{name}.__main__").run
    sys.path.insert(0, str(package.parent))
    return import_module(f"{name}.__main__").run
