"""Functions that `import uvcloth` offers: each what a command does, with Python's objects and arrays.

Everything is in metres and seconds, Z up, the body facing -Y. Places are computed in float64 around the
body's root, as by the command line, and returned in float32. Bad input raises an InputError with one sentence
that names the file or the argument, and how an option of the command line is called (`--fps`). All other
messages go to the logger `uvcloth`.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeAlias, cast

import numpy as np
import torch

from uvcloth.bodies import body as bodies
from uvcloth.bodies.body import Body
from uvcloth.bodies.visible import visible_body
from uvcloth.errors import InputError
from uvcloth.garments.arrays import named_mesh
from uvcloth.garments.fit import Fitting
from uvcloth.garments.garment import Outfit
from uvcloth.garments.holds import Hold
from uvcloth.garments.joined import join
from uvcloth.garments.loading import load_outfit
from uvcloth.garments.order import check_order
from uvcloth.garments.tucks import Tuck
from uvcloth.geometry.arrays import Array
from uvcloth.geometry.mesh import Mesh
from uvcloth.methods.automatic import named_models
from uvcloth.methods.finish_names import FinishName
from uvcloth.methods.method import Method, require_fabric_read
from uvcloth.methods.physics.finish import finished
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.registry import DEFAULT, load_methods
from uvcloth.motion.arrays import clip_of_transforms
from uvcloth.motion.capture import find_jump, find_standstill
from uvcloth.motion.clip import Clip
from uvcloth.motion.lead_in import LeadIn, pose_from_rest
from uvcloth.motion.library import load_clip, wanted_part
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.fabric import FABRICS, JERSEY, Fabric, FabricName, find_fabric
from uvcloth.rollouts.difficulties import Difficulties
from uvcloth.rollouts.ready import ReadyRollout, find_device, ready_rollout, require_same_skeleton
from uvcloth.rollouts.rollout import RolloutFrame
from uvcloth.simulation.engines import ENGINES, require_engine_name
from uvcloth.simulation.quality_check import examine
from uvcloth.simulation.run import simulate as simulate_scene
from uvcloth.writers.animation import Animation
from uvcloth.writers.size import announce
from uvcloth.writers.writer import open_writer

LOGGER = logging.getLogger(__name__)

File: TypeAlias = str | PathLike[str]

GarmentSource: TypeAlias = File | Mesh | tuple[Array, Array]
"""A template's name, a garment file, a mesh, or its vertices (N, 3) and triangles (M, 3)."""

GARMENT_KINDS = (str, PathLike, Mesh, tuple)
"""Classes of a garment's source."""

Model: TypeAlias = Method | File | Sequence[File]
Garments: TypeAlias = Outfit | GarmentSource | Sequence[GarmentSource]


def load_body(path: File | None = None) -> Body:
    """Load a body that `uvcloth body` made, by default the one in the package.

    Raises InputError naming the file, and the array, if it is not one.
    """
    return bodies.load_body(None if path is None else Path(path))


def load_motion(
    motion: File | Array,
    body: Body | None = None,
    *,
    fps: float = 30.0,
    up: Literal["y", "z"] | None = None,
    joints: File | None = None,
    animation: str | None = None,
    rest_frame: int | None = None,
    frames: str | None = None,
    in_place: bool = False,
    clear_arms: bool = True,
    name: str = "motion",
) -> Clip:
    """Load a motion onto a body: from a file, by the name of a built-in clip, or from joint transforms.

    motion: a BVH, glTF, FBX or AMASS file, a name ("walk"), or an array (F, J, 3, 4) or (F, J, 4, 4) of
    matrices that take points of the body's rest pose to the posed one, metres, Z up, in the order of
    `body.skeleton.names`. body: by default the one in the package.

    fps: frames per second, 1 to 1000: those of an array, or those that a file is brought to. frames: "A:B",
    the frames A to B - 1 at that rate, None for all. in_place: the hips stay over one spot. Of a file only:
    up, the axis that points up; joints, a JSON file that says which joint plays which role; animation, the
    name or number of one in a glTF or FBX file; rest_frame, the frame in which the person stands straight;
    clear_arms, that forearms and hands are kept out of torso and legs.
    name: of an array's motion, for messages.

    Raises InputError naming the file for one that cannot be read or understood and a motion that no person
    can have made; naming joint and frame for matrices that do not fit the body.
    """
    body = body or load_body()
    if up not in (None, "y", "z"):
        raise InputError(f"--up {up}: expected y or z")
    roles = None if joints is None else Path(joints)
    options = MotionOptions(up, roles, animation, rest_frame, fps, frames, in_place, clear_arms)
    if isinstance(motion, str | PathLike):
        return load_clip(str(motion), body, options)
    if up or joints or animation or rest_frame is not None:
        raise InputError(
            f"{name}: up, joints, animation and rest_frame apply to motion files, not to transforms of the "
            "body"
        )
    return wanted_part(clip_of_transforms(motion, body, fps, name), options)


def fit(
    garments: GarmentSource | Sequence[GarmentSource],
    body: Body | None = None,
    *,
    template: str | Sequence[str] = (),
    pose: Literal["t", "a"] | None = None,
    from_body: str | PathLike[str] | None = None,
    fabric: FabricName | Fabric | Sequence[FabricName | Fabric] | None = None,
    tucks: Sequence[Tuck] = (),
    holds: Sequence[Hold] = (),
    name: str = "garment",
) -> Outfit:
    """Fit garments to a body, in the order in which they are worn, the innermost first: an outfit.

    Where they cross at rest, outer ones are moved out and inner ones in, until each lies over those before
    it.

    garments: one or several, each the name of a template ("tops", "bottoms", "dress", "shirt", "skirt",
    "jacket"), a garment file (OBJ, PLY, GLB, STL, MHCLO), a Mesh, or a tuple of vertices (N, 3) and triangles
    (M, 3, whole numbers). Unit, axes and origin of a file or mesh are found by where it lies best on the
    body's rest pose; one that holds several garments gives all of them. body: by default the one in the
    package.

    template: whose motion garments take, one for all or one for each, "auto" for the one that each covers
    best. pose: in which files and meshes were modelled, "t" or "a", None to find it. from_body: mesh file of
    the body on which they were modelled, in their coordinates; they are transferred from it. fabric: what
    they are made of, a name ("jersey", "cotton", "silk", "denim") or a Fabric, one for all or one for each.
    tucks: garments that are worn beneath others, whatever the order, as in Tuck("shirt", into="bottoms").
    holds: places that hold garments up, as in Hold("waist", garment="skirt"); by default each is held at its
    top. name: of meshes, numbered where there are several. The findings on each file and mesh are logged.

    Raises InputError naming the garment for what cannot be read or worn, for tucks and holds of garments that
    are not worn, for tucks that contradict each other, and for a place that a garment does not have.
    """
    body = body or load_body()
    sources = _sources(garments)
    meshes = [source for source in sources if not isinstance(source, str | PathLike)]
    numbers = iter(range(1, len(meshes) + 1))
    loaded = [
        str(source)
        if isinstance(source, str | PathLike)
        else named_mesh(name if len(meshes) == 1 else f"{name}_{next(numbers)}", source)
        for source in sources
    ]
    templates = [template] if isinstance(template, str) else template
    how = Fitting(pose, from_body=None if from_body is None else Path(from_body))
    return Outfit(body, load_outfit(loaded, body, LOGGER.info, templates, how, fabric, tucks, holds))


def load_model(model: File | Sequence[File] = DEFAULT, body: Body | None = None) -> Method:
    """Load what moves garments: a model by its name or the folder of its training.

    model: "physics", the cloth solver on cages of the garments; "physxnet" (any garment), "motion_guided"
    (the dress), "recurrent" (tops, shirt, bottoms, dress), "pbns" (bottoms and tops) or "deepsd" (any) as
    they ship; "lbs", "lbs_smooth", or a folder that `uvcloth train` wrote; several, one for each garment of
    an outfit in order. body: that of the outfit, by default the one in the package.

    Raises InputError for an unknown name, and for a damaged model, or one of another body.
    """
    models = [model] if isinstance(model, str | PathLike) else model
    if not models:
        raise InputError("load_model: name at least one model")
    return load_methods([str(each) for each in models], body or load_body())


def rollout(
    model: Model,
    motion: Clip | File,
    garments: Garments,
    *,
    finish: FinishName | None = None,
    loop: bool = False,
    device: str = "cpu",
    keep_going: bool = False,
) -> Animation:
    """Move garments over a motion.

    model, motion, garments: what `load_model`, `load_motion` and `fit` return, or take: that is then loaded
    for the body of the garments. model may be "auto" as well, which chooses one for the outfit and logs why.
    A motion of one frame, a pose, becomes the way into it from rest.
    finish: "dynamic", "static", "clear" or "none", as `uvcloth rollout --finish`; None for the usual one.
    loop: the motion is closed into a cycle, and the garments end as they start; the last frame is the first
    one again. device: "cpu" or "cuda". keep_going: a garment that is torn is that of linear blend skinning in
    its frame, instead of an error.

    Returns all frames of garments and body; `rollout_frames` gives them one by one. Frames that were
    difficult, and garments that were replaced, are logged as warnings.
    Raises InputError for what does not go together, BrokenRolloutError, which is one, naming the first frame
    and garment that is torn or not finite.
    """
    ready = _ready(model, motion, garments, finish, loop)
    difficulties, count = Difficulties(), len(ready.transforms)
    meshes = ready.proxied.meshes
    vertices = tuple(np.empty((count, len(mesh.vertices), 3), np.float32) for mesh in meshes)
    transforms = np.empty(ready.transforms.shape, np.float32)
    for frame in ready.frames(find_device(device), keep_going=keep_going):
        difficulties.add(frame.difficulties, frame.index)
        for reason in frame.replaced:
            LOGGER.warning("%s; replaced by linear blend skinning", reason)
        placed = frame.in_world()
        transforms[frame.index] = placed.transforms.numpy()
        for array, values in zip(vertices, placed.vertices, strict=True):
            array[frame.index] = values.numpy()
    for line in difficulties.lines():
        LOGGER.warning("%s: %s", ready.motion.name, line)
    names = tuple(name for name, _ in ready.proxied.named())
    return Animation(names, meshes, vertices, ready.proxied.outfit.body, transforms, ready.motion.fps)


def rollout_frames(
    model: Model,
    motion: Clip | File,
    garments: Garments,
    *,
    finish: FinishName | None = None,
    loop: bool = False,
    device: str = "cpu",
    keep_going: bool = False,
) -> Iterator[RolloutFrame]:
    """Move garments over a motion as `rollout` does, and yield each frame as it is computed.

    Memory does not grow with their number. Raises InputError at the call for what does not go together, and
    BrokenRolloutError in between.
    """
    ready, place = _ready(model, motion, garments, finish, loop), find_device(device)
    return (frame.in_world() for frame in ready.frames(place, keep_going=keep_going))


def export(animation: Animation, path: File) -> tuple[Path, ...]:
    """Write an animation to a file; the suffix says how, as for `uvcloth rollout`.

    path: .glb, .usdc or .usd, .abc, .pc2 or .obj for other programs, .npz for arrays, .mp4 or .gif for a
    video, .png for a contact sheet. Without a body in the animation only the garments are written.

    Returns the files, of which formats such as .pc2 have several. Raises InputError for another suffix, a
    missing package or a full disk; then nothing is written.
    """
    path, body = Path(path), animation.body
    if line := announce(path, len(animation), animation.meshes, body and visible_body(body)):
        LOGGER.info(line)
    garments = list(zip(animation.names, animation.meshes, strict=True))
    motion = None if body is None else torch.from_numpy(animation.transforms)
    with open_writer(path, garments, body, animation.fps, motion) as writer:
        for chunk in animation.chunks():
            vertices = [torch.from_numpy(values[chunk]) for values in animation.vertices]
            writer.add(vertices, torch.from_numpy(animation.transforms[chunk]))
    return writer.written


def simulate(
    motion: Clip | File,
    garments: Garments,
    *,
    fabric: FabricName | Fabric | None = None,
    engine: Literal["explicit", "blender"] = "explicit",
    progress: Callable[[int], None] = lambda frames: None,
) -> Animation:
    """Simulate garments over a motion with a cloth engine, together, the innermost first.

    motion, garments: as `rollout` has them. The body first moves from rest into the motion's first frame.
    fabric: of all garments, None for their own. engine: the project's solver, or Blender's cloth. progress:
    is told the number of frames that are made, those of the lead-in included.

    Returns the frames of the motion, as `rollout` does. What the quality check of `uvcloth simulate` would
    refuse is logged as a warning.
    Raises InputError for a motion that cloth cannot follow, garments that cross or cannot be simulated, an
    engine that is not installed, and a simulation that leaves the finite numbers, naming the frame.
    """
    require_engine_name(engine)
    outfit = _outfit(garments)
    clip = _motion(motion, outfit)
    require_same_skeleton(clip, outfit)
    if fault := find_jump(clip) or find_standstill(clip):
        raise InputError(f"{clip.name}: refused, {fault}")
    check_order(outfit.garments)
    cloths = [join(garment, outfit.body) for garment in outfit.garments]
    made_by = ENGINES[engine]().with_fabric(_one_fabric(outfit) if fabric is None else find_fabric(fabric))
    clip = pose_from_rest(clip, outfit.body)
    made = simulate_scene(clip, 0, cloths, outfit.body, made_by, LeadIn(), progress)
    made, reason = examine(made, outfit.garments, outfit.body)
    if reason and not all(bool(torch.isfinite(each.vertices[-1]).all()) for each in made.garments):
        raise InputError(f"{clip.name}: {reason}")
    if reason:
        LOGGER.warning("%s: %s", clip.name, reason)
    start = made.warm_up
    return Animation(
        names=tuple(each.name for each in made.garments),
        meshes=tuple(garment.mesh for garment in outfit.garments),
        vertices=tuple(each.vertices[start:].numpy() for each in made.garments),
        body=outfit.body,
        transforms=made.transforms[start:].numpy(),
        fps=clip.fps,
    )


def _sources(garments: GarmentSource | Sequence[GarmentSource]) -> list[GarmentSource]:
    """A list of one garment or several; a tuple of two arrays is one. Raises InputError for other things."""
    one = isinstance(garments, str | PathLike | Mesh) or (
        isinstance(garments, tuple) and not any(isinstance(part, GARMENT_KINDS) for part in garments)
    )
    sources = cast("list[GarmentSource]", [garments] if one else list(cast("Sequence[Any]", garments)))
    for source in sources:
        if not isinstance(source, GARMENT_KINDS) or (isinstance(source, tuple) and len(source) != 2):
            raise InputError(
                "fit: a garment is the name of a template, a file, a Mesh, or a tuple of vertices and faces, "
                f"not {type(source).__name__}"
            )
    return sources


def _outfit(garments: Garments) -> Outfit:
    outfit = garments if isinstance(garments, Outfit) else fit(garments)
    if not outfit.garments:
        raise InputError("rollout and simulate: name at least one garment")
    return outfit


def _motion(motion: Clip | File, outfit: Outfit) -> Clip:
    return motion if isinstance(motion, Clip) else load_motion(motion, outfit.body)


def _ready(
    model: Model, motion: Clip | File, garments: Garments, finish: FinishName | None, loop: bool
) -> ReadyRollout:
    """Bring together what a rollout is asked for. Raises InputError for what does not go together."""
    outfit = _outfit(garments)
    clip = _motion(motion, outfit)
    method = _load_model(model, outfit) if isinstance(model, str | PathLike | Sequence) else model
    method, clear = finished(method, outfit, finish, Physics())
    for garment in outfit.garments:
        if garment.fabric != JERSEY:
            require_fabric_read(method, _fabric_name(garment.fabric))
    ready = ready_rollout(method, outfit, clip, clear, loop=loop)
    for line in ready.lines:
        LOGGER.info(line)
    return ready


def _load_model(model: File | Sequence[File], outfit: Outfit) -> Method:
    """Load the models that are named for an outfit, or the one that suits it."""
    names = [model] if isinstance(model, str | PathLike) else model
    models, line = named_models([str(name) for name in names], outfit)
    if line:
        LOGGER.info(line)
    return load_model(models, outfit.body)


def _one_fabric(outfit: Outfit) -> Fabric:
    """The fabric of all garments. Raises InputError where they are made of several."""
    fabrics = {garment.fabric for garment in outfit.garments}
    if len(fabrics) > 1:
        raise InputError("--fabric: garments that are simulated together need one fabric, these have several")
    return fabrics.pop()


def _fabric_name(fabric: Fabric) -> str:
    return next((name for name, known in FABRICS.items() if known == fabric), "of your own")
