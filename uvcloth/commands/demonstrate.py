"""Simulation, rollout, export and pictures from the data of the package.

It takes some minutes on two cores, most of them for rollouts and pictures.
"""

from collections.abc import Iterable, Iterator
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.commands.animate import animate
from uvcloth.commands.export import Export
from uvcloth.commands.export_rig import export
from uvcloth.commands.rollout import Rollout
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.errors import InputError
from uvcloth.files.image import write_png
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.registry import DEFAULT, load_method
from uvcloth.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render_frames
from uvcloth.rollout import rollout
from uvcloth.simulate.batch import simulate_batch
from uvcloth.simulate.plan import ClipSelection

CLIP = "jump"
GARMENT = "miniskirt.obj"
FOREIGN = "female_casualsuit01.mhclo"
"""An outfit from elsewhere that no model was trained on."""

MODELS = {"tops": "physxnet", "bottoms": "physxnet", "dress": "motion_guided"}
"""Templates that are shown, and the model that predicts each."""

PICTURES = 6
PICTURE_SIZE = (300, 420)


def demonstrate(out: Path) -> None:
    """Simulate the templates over a built-in clip, roll the shipped models out on it, write files, pictures.

    `make demo` then lets `python -m evaluate` compare them in a report. Raises InputError if the folder
    cannot be written.
    """
    console = Console()
    body = load_body()
    console.print(f"1. Simulating {', '.join(MODELS)} over the built-in clip {CLIP} (a minute or two)")
    simulate_batch(ClipSelection([CLIP]), [(name,) for name in MODELS], out / "sequences", body)
    skirt, foreign = (str(files("uvcloth") / "data" / "garments" / name) for name in (GARMENT, FOREIGN))
    console.print(
        "2. Rolling out on the same clip: Motion-guided on its dress, physics on a skirt under a T-shirt, "
        "DeePSD on MakeHuman's top and leggings"
    )
    for name, model, garments in (
        ("dress", MODELS["dress"], ("dress",)),
        ("outfit", DEFAULT, (skirt, "tops")),
        ("casual", "deepsd", (foreign,)),
    ):
        written = tuple(out / f"{name}.{suffix}" for suffix in ("glb", "usdc"))
        summary = animate(Rollout(CLIP, garments, written, (model,)))
        console.print("\n".join(f"   {line}" for line in summary.lines()), highlight=False)
    rig = export(Export("pbns", out / "outfit_rig.glb", motion=CLIP))
    console.print("\n".join(f"   {line}" for line in rig.lines()), highlight=False)
    console.print("3. Drawing simulation (top) and prediction (bottom)")
    for name in MODELS:
        path = out / f"{name}.png"
        write_png(path, _side_by_side(out / "sequences" / f"{CLIP}_{name}.npz", name, body))
        console.print(f"   {path}")


def _side_by_side(path: Path, name: str, body: Body) -> np.ndarray:
    """Draw a sheet of PICTURES moments of a simulated sequence, a shipped model's rollout below each."""
    if not path.exists():
        raise InputError(f"{path}: the simulation was kept apart, see {path.parent / 'rejected'}")
    sequence = load_simulated(path)
    method = load_method(MODELS[name], body)
    outfit = Outfit(body, (fit_template(name, body),))
    moments = torch.linspace(sequence.warm_up, len(sequence.vertices) - 1, PICTURES).long().tolist()
    frames = rollout(method, outfit, sequence.transforms, sequence.fps)
    predicted = {frame.index: frame.vertices[0] for frame in frames if frame.index in moments}
    posed = posed_skin(body, sequence.transforms[moments])

    def surfaces(cloth: Iterable[Tensor]) -> Iterator[tuple[Surface, Surface]]:
        for skin_vertices, vertices in zip(posed, cloth, strict=True):
            yield (
                Surface(skin_vertices, body.mesh.faces, BODY_COLOR),
                Surface(vertices, sequence.garments[0].faces, GARMENT_COLORS[list(MODELS).index(name)]),
            )

    simulated = render_frames(surfaces(sequence.vertices[moments]), size=PICTURE_SIZE)
    rolled = render_frames(surfaces(predicted[moment] for moment in moments), size=PICTURE_SIZE)
    return contact_sheet([*simulated, *rolled], columns=PICTURES)
