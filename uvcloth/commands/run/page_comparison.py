"""A character of a web page in a simulated garment, and other methods' sequences of it."""

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

import numpy as np
from numpy.typing import NDArray

from uvcloth.commands.options import GARMENT, FitOptions
from uvcloth.commands.page import Page
from uvcloth.commands.run.page_characters import (
    PageCharacter,
    add_animations,
    load_characters,
    open_whole,
)
from uvcloth.commands.run.page_methods import PageMethod
from uvcloth.dataset.clip import REST_TOLERANCE, SimulatedClip, SimulatedGarment
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.dataset.predicted_file import READERS, read_prediction
from uvcloth.errors import InputError
from uvcloth.physics.fabric import FABRICS, FabricName
from uvcloth.player.baked import FABRIC, BakedFile
from uvcloth.player.gltf_file import GltfFile
from uvcloth.writers.page_frames import pack_frames

FPS = 30.0
"""Frames per second of a page's cloth."""

TAKEN = ("cloth", "skinning")
"""Names of methods that every page has."""

SIMULATION = "simulation"


def compared_character(command: Page, path: Path) -> PageCharacter:
    """A character that moves as in a simulation, beside that and its predictions.

    Raises InputError for a sequence that is damaged or of another frame rate, for a baked file in other
    garments or on other joints, and for predictions that do not fit the simulation.
    """
    if len(command.file) > 1:
        raise InputError(f"--simulated: a page compares methods on one file, not on {len(command.file)}")
    clip = load_simulated(path)
    (garment,) = clip.garments
    if abs(clip.fps - FPS) > 1e-3:
        raise InputError(f"{path}: has {clip.fps:g} frames per second, a page compares at {FPS:g}")
    models = _models(command, path, clip, garment)
    predicted = _predicted(command.predicted, clip, garment, [model.name for model in models])
    with tempfile.TemporaryDirectory(prefix="uvcloth-page-") as folder:
        files, fast = _animated(command, path, clip, garment, Path(folder))
        for each in (*files, *fast):
            _require_mesh(open_whole(each), garment, path)
        (character,) = load_characters(files, fast)
    truth = PageMethod(SIMULATION, "truth", _packed(path, garment.vertices.numpy(), garment), clip.warm_up)
    return replace(character, methods=(*character.methods, truth, *models, *predicted))


def _animated(
    command: Page, path: Path, clip: SimulatedClip, garment: SimulatedGarment, folder: Path
) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """The baked file, and in fast quality, if there is one, whose last animation is that of the clip."""
    sources = (*command.file, *command.fast)
    motion = {clip.name: (clip.transforms.double().numpy(), clip.fps)}
    if not sources:
        sources = _baked(command.body, path, clip, garment, folder)
    copies = []
    for place, source in enumerate(sources):
        skin = open_whole(source, animated=False).skin
        joints = clip.transforms.shape[1]
        if len(skin.nodes) != joints:
            raise InputError(f"{source}: has {len(skin.nodes)} joints, the body of {path} has {joints}")
        copy = folder / str(place) / source.name
        copy.parent.mkdir()
        copy.write_bytes(source.read_bytes())
        add_animations(copy, motion)
        copies.append(copy)
    return (copies[0],), tuple(copies[1:])


def _baked(
    body: Path | None, path: Path, clip: SimulatedClip, garment: SimulatedGarment, folder: Path
) -> tuple[Path, Path]:
    """The template of a garment's name on a body, in default and fast quality."""
    from uvcloth.commands.bake import Bake
    from uvcloth.commands.run.bake import bake

    if garment.name not in GARMENT.names():
        raise InputError(
            f"{path}: {garment.name} is no template; name the file that `uvcloth bake` wrote of that garment"
        )
    fabric = _fabric(clip)
    fitting = FitOptions() if fabric is None else FitOptions(fabric=(fabric,))
    default, fast = folder / f"{garment.name}.glb", folder / f"{garment.name}.fast.glb"
    bake(Bake((garment.name,), default, body=body, fitting=fitting))
    bake(Bake((garment.name,), fast, body=body, fitting=fitting, quality="fast"))
    return default, fast


def _fabric(clip: SimulatedClip) -> FabricName | None:
    """The fabric that was simulated, None where it is not known."""
    numbers = clip.metadata.get("settings", {}).get("fabric", {})
    for name in get_args(FabricName):
        if all(numbers.get(each) == getattr(FABRICS[name], each) for each in FABRIC):
            return cast(FabricName, name)
    return None


def _models(command: Page, path: Path, clip: SimulatedClip, garment: SimulatedGarment) -> list[PageMethod]:
    """The models of `--model`, over the motion of the simulation."""
    from uvcloth.commands.run.page_models import model_methods

    if command.model and garment.name not in GARMENT.names():
        raise InputError(f"--model: {garment.name} of {path} is no template; use --predicted")
    return model_methods(command.model, command.body, clip, garment, _fabric(clip))


def _predicted(
    options: tuple[str, ...], clip: SimulatedClip, garment: SimulatedGarment, taken: Sequence[str]
) -> list[PageMethod]:
    """The sequences of `--predicted NAME=FILE`, which may lack the warm-up of the simulation."""
    methods: list[PageMethod] = []
    for option in options:
        name, _, place = option.partition("=")
        path, label = Path(place), f"--predicted {option}"
        if name in (*TAKEN, SIMULATION, *taken, *(method.name for method in methods)):
            raise InputError(f"{label}: another method is called {name!r}")
        if not path.is_file() or path.suffix.lower() not in READERS:
            raise InputError(f"{label}: no such file of {', '.join(READERS)}")
        points = read_prediction(path, garment, clip.fps, clip.warm_up).numpy()
        methods.append(PageMethod(name, "frames", _packed(path, points, garment)))
    return methods


def _packed(path: Path, points: NDArray[np.float32], garment: SimulatedGarment) -> bytes:
    try:
        first = len(garment.vertices) - len(points)
        return pack_frames(points, garment.faces.numpy(), first)
    except ValueError as error:
        raise InputError(f"{path}: {error} by more than 1.8 m between frames") from error


def _require_mesh(baked: BakedFile, garment: SimulatedGarment, path: Path) -> None:
    """Raise InputError unless a baked file wears the garment of a simulation, and nothing else."""
    file = baked.file.path.name
    if len(baked.garments) != 1:
        names = ", ".join(each.name for each in baked.garments)
        raise InputError(f"{file}: wears {names}, expected {garment.name} alone, as in {path}")
    (single,) = baked.garments
    expected = len(garment.rest)
    if single.size != expected:
        raise InputError(
            f"{file}: its {single.name} has {single.size:,} vertices, that of {path} {expected:,}"
        )
    points, faces = _mesh(baked.file, single.node)
    rest = np.zeros((single.size, 3))
    rest[single.vertices] = points @ baked.skin.axes[:3, :3].T
    apart = float(np.linalg.norm(rest - garment.rest.numpy(), axis=1).max())
    same = np.array_equal(_sorted(single.vertices[faces]), _sorted(garment.faces.numpy()))
    if not same or not apart <= REST_TOLERANCE:
        reason = f"at rest they are up to {1000 * apart:.0f} mm apart" if same else "their faces differ"
        raise InputError(f"{file}: its {single.name} is another mesh than that of {path}: {reason}")


def _mesh(file: GltfFile, node: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Positions (M, 3) of a node's mesh in the scene, and faces (F, 3) of all its primitives."""
    primitives = file.entries("meshes")[file.entries("nodes")[node]["mesh"]]["primitives"]
    points = file.array(primitives[0]["attributes"]["POSITION"], "VEC3").astype(np.float64)
    corners = [file.array(primitive["indices"], "SCALAR").reshape(-1, 3) for primitive in primitives]
    return points, np.concatenate(corners).astype(np.int64)


def _sorted(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Faces (F, 3) in an order that does not depend on theirs, nor on the first corner of each."""
    first = faces.argmin(1)
    turned = faces[np.arange(len(faces))[:, None], (first[:, None] + np.arange(3)) % 3]
    return turned[np.lexsort(turned.T[::-1])]
