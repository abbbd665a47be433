"""Description of how a motion file is understood, and a picture of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from uvcloth.bodies.body import Body, load_body
from uvcloth.commands.motion import DescribeMotion
from uvcloth.errors import InputError
from uvcloth.files.image import write_png
from uvcloth.geometry.roles import ROLES, naming_family
from uvcloth.geometry.units import UNITS
from uvcloth.motion.clip import Clip
from uvcloth.motion.gltf import ANIMATED, animation_names
from uvcloth.motion.library import MotionSource, clip_roles, load_source, motion_on_body, read_motion
from uvcloth.motion.posture import check_posture
from uvcloth.motion.retarget import leg_length
from uvcloth.motion.stick_sheet import stick_sheet
from uvcloth.player.animation import numbered

UNIT_ERROR = 1.25
"""Factor by which a leg in one of the units may be longer or shorter than the body's."""


def run(command: DescribeMotion) -> None:
    """Print how a motion file is understood, and write a sheet of stick figures.

    Raises InputError as `load_clip` does, after the readable part is printed; for an impossible motion, after
    the sheet is written too.
    """
    motion, out, options = command.file, command.out, command.options
    body = load_body(command.body)
    console = Console()
    if Path(motion).suffix.lower() in ANIMATED:
        _print(console, [f"animations: {numbered(animation_names(Path(motion)))}"])
    clip = read_motion(motion, options.animation)
    roles, _ = clip_roles(clip, options)
    _print(
        console, [f"{clip.name}: {len(clip)} frames at {clip.fps:g} per second, {len(clip) / clip.fps:.2f} s"]
    )
    _print(console, _joint_lines(clip, roles))
    console.print(_table(clip, roles))
    source = load_source(motion, body, options)
    _print(console, [f"rest pose: {source.rest.origin}; up: {source.rest.up}; {_unit(source, body)}"])
    try:
        clip = motion_on_body(source, body, options)
        _, frames = options.window(len(clip))
        write_png(out, stick_sheet(source, clip))
        colors = "the file's in grey, the body's over it, left blue, right red"
        _print(console, [f"{frames} frames at {clip.fps:g} per second; {out}: stick figures, {colors}"])
        check_posture(clip, lying=options.up is not None)
    except InputError as error:
        raise InputError(f"{motion}: {error}") from error


def _print(console: Console, lines: Sequence[str]) -> None:
    console.print("\n".join(lines), highlight=False, markup=False, soft_wrap=True)


def _joint_lines(clip: Clip, roles: Mapping[str, int]) -> list[str]:
    names = clip.skeleton.names
    free = [name for joint, name in enumerate(names) if joint not in roles.values()]
    missing = [role for role in ROLES if role not in roles]
    return [
        f"{naming_family(names)} names, {len(names)} joints, {len(roles)} of them with a role",
        f"joints without a role, which move with their parents: {', '.join(free) or 'none'}",
        f"roles without a joint: {', '.join(missing) or 'none'}",
    ]


def _unit(source: MotionSource, body: Body) -> str:
    legs = (
        float(leg_length(skeleton.heads, roles))
        for skeleton, roles in (
            (source.clip.skeleton, source.roles),
            (body.skeleton, body.skeleton.roles),
        )
    )
    leg, body_leg = next(legs), next(legs)
    metre = body_leg / leg
    name = min(UNITS, key=lambda unit: abs(UNITS[unit] / metre - 1.0))
    near = 1 / UNIT_ERROR < UNITS[name] / metre < UNIT_ERROR
    unit = name if near else "unknown units"
    return f"a leg of {leg:.4g} {unit} is scaled to the body's of {body_leg:.2f} m"


def _table(clip: Clip, roles: Mapping[str, int]) -> Table:
    table = Table("role", "joint", box=None)
    for role, joint in roles.items():
        table.add_row(role, clip.skeleton.names[joint])
    return table
