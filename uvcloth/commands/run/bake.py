"""Baked files: a character and its outfit, for viewers and for the runtime."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from rich.console import Console

from uvcloth.bodies.body import Body
from uvcloth.bodies.visible import visible_body
from uvcloth.characters.joints import OwnJoints
from uvcloth.commands.bake import Bake
from uvcloth.commands.run.wearer import load_wearer
from uvcloth.commands.run.worn import load_worn
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.formats.gltf import read_gltf
from uvcloth.garments.band import unheld_reason
from uvcloth.garments.garment import Outfit
from uvcloth.garments.own_joints import on_own_joints
from uvcloth.methods.physics.outfit import PhysicsConfig, bake_outfit
from uvcloth.motion.lead_in import pose_from_rest
from uvcloth.motion.library import load_clip
from uvcloth.player.baked import ClothSkin
from uvcloth.wrinkles.model import load_wrinkles, shipped_for
from uvcloth.wrinkles.outfit import WrinkledSheets
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_cloth import add_cloth, add_cloth_skin, add_own_body, animate_cloth
from uvcloth.writers.gltf_reopened import reopened
from uvcloth.writers.writer import require_own_names


@dataclass(frozen=True)
class Baked:
    """Result of baking: the file, names of its garments, and how many joints and bytes the runtime has."""

    path: Path
    garments: tuple[str, ...]
    joints: int
    size: int

    def lines(self) -> list[str]:
        """Text of the result for a terminal, line by line."""
        return [
            f"{self.path}: {self.path.stat().st_size / 1e6:.2f} MB, of which the runtime reads "
            f"{self.size / 1e6:.2f} MB",
            f"{', '.join(self.garments)}; {self.joints} joints",
        ]


def run(command: Bake) -> None:
    """Write the file and say what is in it. Raises InputError for bad input."""
    print("\n".join(bake(command).lines()))


def bake(command: Bake) -> Baked:
    """Fit garments to a character or a body, and write the baked file.

    Raises InputError for bad input and a full disk; then, as after Ctrl-C, writes nothing.
    """
    console = Console(stderr=True)
    report = partial(console.print, highlight=False, markup=False, soft_wrap=True)
    with console.status("preparing"):
        wearer = load_wearer(command.body, report)
        body, joints = wearer.body, wearer.joints
        frame = wearer.require_frame("--on-character") if command.on_character else None
        outfit = load_worn(command.garment, command.fitting, body, report, frame=frame)
        if reason := unheld_reason(outfit):
            raise InputError(f"{reason}; the runtime cannot hold it up")
        require_own_names(command.out, [garment.name for garment in outfit.garments])
        clip = None
        if command.motion is not None:
            clip = pose_from_rest(load_clip(command.motion, body, command.options), body)
    worn = outfit if joints is None else on_own_joints(outfit, joints)
    wrinkled = _wrinkled(command, worn, report)
    with console.status(f"{command.out.name} ..."):
        sections, steps = ({}, {}) if wrinkled is None else (wrinkled.sections(), wrinkled.steps)
        content = bake_outfit(worn, PhysicsConfig(command.quality), sections, steps)
        document, skin = _character(command.body, body, joints)
        shown = worn.garments if wrinkled is None else wrinkled.refined()
        add_cloth(document, skin, shown, content)
        if clip is not None:
            transforms = clip.transforms(torch.float64).numpy()
            if joints is not None:
                transforms = transforms[:, joints.ours]
            animate_cloth(document, skin, transforms, clip.fps)
        with atomic_write(command.out) as unfinished:
            document.write(unfinished)
    names = tuple(garment.name for garment in worn.garments)
    return Baked(command.out, names, len(skin.nodes), len(content))


def _wrinkled(command: Bake, outfit: Outfit, report: Callable[[str], None]) -> WrinkledSheets | None:
    """The garments with wrinkles, None for none; says which they are."""
    if not command.wrinkles:
        return None
    wrinkles = load_wrinkles(command.wrinkles_from or shipped_for(outfit))
    wrinkled = WrinkledSheets.of(wrinkles, outfit, command.quality)
    for line in wrinkled.lines:
        report(line)
    return wrinkled if wrinkled.sheets else None


def _character(path: Path | None, body: Body, joints: OwnJoints | None) -> tuple[Document, ClothSkin]:
    """A document that shows the character or the body, and the skin of its garments."""
    if joints is None or path is None:
        document = Document()
        return document, add_own_body(document, visible_body(body))
    document = reopened(read_gltf(path))
    return document, add_cloth_skin(document, joints)
