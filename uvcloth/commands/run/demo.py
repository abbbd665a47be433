"""One story from the data of the package: a dress in a kick, and more clothes in a sudden stop.

They are simulated, predicted by networks, predicted by networks over physics, and moved by physics alone.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path

import numpy as np
from rich.console import Console
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.commands.bake import Bake
from uvcloth.commands.demo import Demo
from uvcloth.commands.export import Export
from uvcloth.commands.page import Page
from uvcloth.commands.play import Play
from uvcloth.commands.rollout import Rollout
from uvcloth.commands.run.bake import bake
from uvcloth.commands.run.export import export
from uvcloth.commands.run.page import WASM, write_page
from uvcloth.commands.run.play import play
from uvcloth.commands.run.rollout import animate
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.errors import InputError
from uvcloth.files.image import write_png
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip, save_clip
from uvcloth.motion.stop import BRAKING_SECONDS, come_to_rest
from uvcloth.rendering.render import (
    BODY_COLOR,
    GARMENT_COLORS,
    Surface,
    contact_sheet,
    filled_size,
    render_frames,
    three_quarter,
)
from uvcloth.rollouts.rollout import RolloutFrame
from uvcloth.simulation.batch import simulate_batch
from uvcloth.simulation.plan import ClipSelection

CLIP, FRAMES, STANDING = "twirl", 18, 1.0
"""A built-in clip, the number of its first frames that are used, and the seconds that the stop adds."""

KICK, HIGHEST = "kick", 22
"""A built-in clip, and the frame in which its leg is highest."""

MOMENTS = {"stop": (-0.2, 0.0, 0.1, 0.2, 0.4, 0.8), KICK: (-0.4, -0.1, 0.0, 0.1, 0.3, 0.7)}
"""Seconds that are drawn, after the body has come to a standstill, and after the leg is highest."""

WIND = (0.0, 6.0, 0.0)
"""Wind, m/s, in which the baked character is played."""

PICTURE_SIZE = (220, 300)


@dataclass(frozen=True)
class DemoMotion:
    """A motion: its file or built-in name, and the frame that moments are counted from, in words too."""

    source: str
    clip: Clip
    zero: int
    event: str


@dataclass(frozen=True)
class DemoOutfit:
    """Templates that are simulated together, innermost first, the shipped model for them, and the motion."""

    name: str
    garments: tuple[str, ...]
    network: str
    motion: str

    def rollouts(self, motion: DemoMotion, out: Path) -> dict[str, Rollout]:
        """The rollouts that are compared with the simulation, by what they are called."""
        network = f"{self.name}_{self.network}"
        cleared = Rollout(
            motion.source, self.garments, (out / f"{network}.glb",), (self.network,), finish="clear"
        )
        return {
            f"{self.network} cleared": cleared,
            f"{self.network} with --finish dynamic": replace(
                cleared, out=(out / f"{network}_dynamic.glb",), finish="dynamic"
            ),
            "physics": replace(
                cleared,
                out=tuple(out / f"{self.name}_physics.{suffix}" for suffix in ("glb", "mp4")),
                model=("physics",),
            ),
        }


DRESS = DemoOutfit(KICK, ("dress",), "motion_guided", KICK)
STOPPED = (
    DemoOutfit("dress", ("dress",), "motion_guided", "stop"),
    DemoOutfit("layers", ("bottoms", "tops"), "physxnet", "stop"),
)

FROM_FILES = {"casual": ("deepsd", "female_casualsuit01.mhclo"), "skirt": ("physics", "miniskirt.obj")}
"""Garment files of the package that no model was trained on, and the method that moves each."""


@dataclass
class Snapshots:
    """The garments of a rollout, (N, 3) m each, in some of its frames."""

    wanted: Collection[int]
    garments: list[tuple[Tensor, ...]] = field(default_factory=list)

    def begin(self, title: str, body: Body, meshes: Sequence[Mesh], count: int, fps: float) -> None:
        """Nothing is needed before the first frame."""

    def add(self, frame: RolloutFrame) -> None:
        """Keep the garments of a frame that is wanted."""
        if frame.index in self.wanted:
            self.garments.append(frame.vertices)


def run(command: Demo) -> None:
    """Write all results. Raises InputError for bad input."""
    demonstrate(command.out, command.long)


def demonstrate(out: Path, long: bool = False) -> None:
    """Simulate a dress over a kick, roll methods out on it, write files, pictures, a film and a page.

    long: more outfits, motions and files too. Raises InputError if the folder cannot be written.
    """
    console, body = Console(), load_body()
    kick = DemoMotion(KICK, load_clip(KICK, body), HIGHEST, "the leg is highest")
    console.print("1. A dress in a kick: simulated, by a network, by a network over physics, by physics")
    simulate_batch(ClipSelection([kick.source]), [DRESS.garments], out / "sequences", body)
    _compare(DRESS, kick, out, body, console)
    console.print("2. Baking a dressed character for the runtime, and playing it in wind")
    baked = out / "character.glb"
    _print(console, bake(Bake(("bottoms", "tops"), baked, motion=KICK)).lines())
    _print(console, play(Play(baked, out / "character_in_wind.glb", wind=WIND)).lines())
    if WASM.is_file():
        console.print("3. Writing a page: the kick by several methods, and a figure to drag by hand")
        simulated = _sequence_files(DRESS, out / "sequences")[0]
        page = write_page(Page(out / "page" / "index.html", simulated=simulated, model=("recurrent",))).page
        _print(console, [f"{page.resolve().as_uri()}: open it in a browser"])
    if long:
        _go_on(out, body, console)


def _go_on(out: Path, body: Body, console: Console) -> None:
    """The longer part of the story: a sudden stop, layers, garment files and a rig."""
    stop = out / "stop.npz"
    clip = come_to_rest(load_clip(CLIP, body).window(0, FRAMES), STANDING)
    save_clip(clip, stop, f"The first {FRAMES} frames of the built-in clip {CLIP}, and a sudden stop.")
    motion = DemoMotion(str(stop), clip, standstill(clip.fps), "the body stands still")
    console.print(
        f"4. A dress, and a T-shirt over trousers, over {stop}, a turn that stops suddenly: the same"
    )
    simulate_batch(
        ClipSelection([motion.source]), [outfit.garments for outfit in STOPPED], out / "sequences", body
    )
    for outfit in STOPPED:
        _compare(outfit, motion, out, body, console)
    console.print("5. Rolling out garment files: DeePSD on MakeHuman's top and leggings, physics on a skirt")
    for name, (model, file) in FROM_FILES.items():
        garment = str(files("uvcloth") / "data" / "garments" / file)
        written = tuple(out / f"{name}.{suffix}" for suffix in ("glb", "usdc"))
        _print(console, animate(Rollout(str(stop), (garment,), written, (model,))).lines())
    console.print("6. Exporting PBNS as a rig")
    _print(console, export(Export("pbns", out / "outfit_rig.glb", motion=str(stop))).lines())


def standstill(fps: float) -> int:
    """The first frame in which the body stands still."""
    return FRAMES - 1 + round(BRAKING_SECONDS * fps / 2)


def _compare(outfit: DemoOutfit, motion: DemoMotion, out: Path, body: Body, console: Console) -> None:
    """Roll an outfit out by all methods, and draw them below its simulation."""
    simulated = _simulated(outfit, out / "sequences")
    drawn = MOMENTS[outfit.motion]
    moments = [motion.zero + round(seconds * motion.clip.fps) for seconds in drawn]
    rows = {
        "simulation": [
            tuple(garment.vertices[simulated.warm_up + moment] for garment in simulated.garments)
            for moment in moments
        ]
    }
    for name, command in outfit.rollouts(motion, out).items():
        snapshots = Snapshots(moments)
        _print(console, [f"{outfit.name}, {name}:", *animate(command, snapshots).lines()])
        rows[name] = snapshots.garments
    path = out / f"{outfit.name}.png"
    posed = posed_skin(body, simulated.transforms[simulated.warm_up :][moments])
    write_png(path, _sheet(rows, posed, simulated, body))
    seconds = ", ".join(f"{moment:g}" for moment in drawn)
    _print(console, [f"{path}: from top to bottom {', '.join(rows)}", f"{seconds} s after {motion.event}"])


def _simulated(outfit: DemoOutfit, folder: Path) -> SimulatedClip:
    """The simulation of an outfit. Raises InputError if it was refused."""
    paths = _sequence_files(outfit, folder)
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: the simulation was rejected, see {folder / 'rejected'}")
    return load_simulated(*paths)


def _sequence_files(outfit: DemoOutfit, folder: Path) -> list[Path]:
    """Files of an outfit's simulation, one for each garment."""
    return [folder / f"{outfit.motion}_{garment}.npz" for garment in outfit.garments]


def _sheet(
    rows: Mapping[str, Sequence[tuple[Tensor, ...]]], posed: Tensor, simulated: SimulatedClip, body: Body
) -> np.ndarray:
    """Draw garments, a row for each method, on the posed body (M, V, 3) m of each column, by one camera.

    Every body stands in the middle of its picture.
    """
    middles = 0.5 * (posed.amin(1, keepdim=True) + posed.amax(1, keepdim=True))
    middles[..., 2] = 0.0

    def surfaces() -> Iterator[list[Surface]]:
        for row in rows.values():
            for skin_vertices, garments, middle in zip(posed, row, middles, strict=True):
                worn = zip(garments, simulated.garments, GARMENT_COLORS, strict=False)
                yield [
                    Surface(skin_vertices - middle, body.mesh.faces, BODY_COLOR),
                    *(Surface(vertices - middle, garment.faces, color) for vertices, garment, color in worn),
                ]

    size = filled_size(posed - middles, PICTURE_SIZE)
    camera = three_quarter(posed - middles, aspect=size[0] / size[1])
    return contact_sheet(list(render_frames(surfaces(), camera, size)), columns=len(posed))


def _print(console: Console, lines: Sequence[str]) -> None:
    console.print("\n".join(f"   {line}" for line in lines), highlight=False, soft_wrap=True)
