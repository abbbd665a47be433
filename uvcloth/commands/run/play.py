"""Baked files that are played: joints of an animation in, moving garments out, without PyTorch."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from uvcloth.commands.play import Play
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.physics.fabric import FabricName, find_fabrics
from uvcloth.player.baked import FABRIC, BakedFile, JointMotion, open_baked
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.writers.gltf_played import add_played, played_document


@dataclass(frozen=True)
class Played:
    """Result of playing: the files, the number of frames, and the seconds that the runtime took."""

    written: tuple[Path, ...]
    frames: int
    seconds: float

    def lines(self) -> list[str]:
        """Text of the result for a terminal, line by line."""
        return [
            *(f"{path}: {path.stat().st_size / 1e6:.1f} MB" for path in self.written),
            f"{self.frames} frames, {1e3 * self.seconds / self.frames:.1f} ms each",
        ]


def run(command: Play) -> None:
    """Write the file and say what a frame took. Raises InputError for bad input."""
    print("\n".join(play(command).lines()))


def play(command: Play) -> Played:
    """Play a baked file and write what it dresses.

    Raises InputError for bad input, cloth that leaves the finite numbers, and a full disk; then, as after
    Ctrl-C, writes nothing.
    """
    try:
        baked = open_baked(command.file)
        outfit = _outfit(baked)
        motion = _motion(command, baked)
        start = perf_counter()
        cloth = Cloth(outfit)
        cloth.set_world(command.wind, (0.0, 0.0, -command.gravity))
        _change_fabrics(cloth, baked, command.fabric)
        frames = list(_dressed(cloth, motion, len(baked.garments)))
        seconds = perf_counter() - start
        garments = [np.stack(parts) for parts in zip(*frames, strict=True)]
        for garment, vertices in zip(baked.garments, garments, strict=True):
            if not np.isfinite(vertices).all():
                raise baked.file.error(f"a vertex of {garment.name} is not a finite number")
        return Played(_write(command.out, baked, motion, garments), len(frames), seconds)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(str(error)) from error


def _outfit(baked: BakedFile) -> Outfit:
    """The outfit of a file as the runtime reads it. Raises ValueError naming the file."""
    try:
        outfit = Outfit(baked.content)
    except ValueError as error:
        raise baked.file.error(str(error)) from error
    baked.require_fit(outfit.joints, outfit.garments)
    return outfit


def _change_fabrics(cloth: Cloth, baked: BakedFile, names: Sequence[FabricName]) -> None:
    """Change the fabrics of the garments from those that were baked; no names leave them.

    Raises InputError for another number of names, and for a file that does not say what was baked.
    """
    if not names:
        return
    for index, (garment, fabric) in enumerate(
        zip(baked.garments, find_fabrics(names, len(baked.garments)), strict=True)
    ):
        if not (garment.fabric and min(garment.fabric) > 0.0):
            raise baked.file.error(f"the file does not say of which fabric {garment.name} was baked")
        factors = (
            getattr(fabric, name) / before for name, before in zip(FABRIC, garment.fabric, strict=True)
        )
        cloth.set_fabric(index, *factors)


def _motion(command: Play, baked: BakedFile) -> JointMotion:
    """The motion that is asked for: an animation of the file, or one from elsewhere, retargeted."""
    if command.motion is not None:
        from uvcloth.commands.run.play_motion import retargeted

        return retargeted(baked, command.motion, command.options)
    motion = baked.motion(command.options.animation, command.options.fps)
    first, count = command.options.window(len(motion.times))
    window = slice(first, first + count)
    return replace(motion, times=motion.times[window], transforms=motion.transforms[window])


def _dressed(cloth: Cloth, motion: JointMotion, garments: int) -> Iterator[list[np.ndarray]]:
    """Vertices (N, 3) m of each garment, frame after frame."""
    cloth.start(motion.transforms[0])
    for transforms in motion.transforms:
        cloth.step(transforms, 1.0 / motion.fps)
        yield [cloth.vertices(garment).astype(np.float32) for garment in range(garments)]


def _write(path: Path, baked: BakedFile, motion: JointMotion, garments: list[np.ndarray]) -> tuple[Path, ...]:
    """Write the frames in the format of the suffix; returns the files."""
    if path.suffix.lower() != ".glb":
        from uvcloth.commands.run.play_elsewhere import write_garments

        return write_garments(path, baked, motion, garments)
    document, time = played_document(baked, motion)
    if motion.animation is None:
        from uvcloth.writers.gltf_nodes import animate_nodes

        animate_nodes(document, baked.skin.nodes, baked.skin.worlds(motion.transforms), time)
    add_played(document, baked, time, garments)
    with atomic_write(path) as unfinished:
        document.write(unfinished)
    return (path,)
