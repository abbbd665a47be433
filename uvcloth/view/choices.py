"""Motions, garments, models and bodies that the live view offers, and the rollout of a choice."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from uvcloth.bodies.body import Body, load_body
from uvcloth.dataset.clip import REST_TOLERANCE, SimulatedClip
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.errors import InputError
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.methods.finish_names import FinishName
from uvcloth.methods.method import Method
from uvcloth.methods.registry import DEFAULT, METHODS
from uvcloth.motion.arrays import clip_of_transforms
from uvcloth.motion.library import builtin_clips, load_clip
from uvcloth.physics.fabric import FabricName
from uvcloth.rollouts.ready import ReadyRollout, ready_method, ready_rollout
from uvcloth.view.computation import Performance

TEMPLATES = ("bottoms", "tops", "shirt", "dress", "skirt", "jacket")
"""The templates, the innermost first."""

DEFAULT_BODY = "default"
"""Name of the body in the package."""


@dataclass(frozen=True)
class Choice:
    """A choice.

    garments: in the order in which they are worn, the innermost first. fabric: of all garments, None for
    jersey. quality: of the solver, a key of QUALITIES.
    """

    motion: str
    garments: tuple[str, ...]
    model: str
    body: str
    finish: FinishName | None = None
    fabric: FabricName | None = None
    quality: str = "default"


@dataclass(frozen=True)
class Choices:
    """Names and files to choose from; sequences are motions whose garment was also simulated."""

    motions: tuple[str, ...]
    garments: tuple[str, ...]
    models: tuple[str, ...]
    bodies: tuple[str, ...]
    sequences: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        motions: Sequence[str] = (),
        garments: Sequence[str] = (),
        models: Sequence[str] = (),
        bodies: Sequence[str] = (),
        sequences: Sequence[str] = (),
    ) -> "Choices":
        """Given choices, followed by all that ships."""

        def first(given: Sequence[str], shipped: Sequence[str]) -> tuple[str, ...]:
            return (*given, *(name for name in shipped if name not in given))

        return cls(
            motions=first([*sequences, *motions], list(builtin_clips())),
            garments=first(garments, TEMPLATES),
            models=first(models, [DEFAULT, *(name for name in METHODS if name != DEFAULT)]),
            bodies=first(bodies, [DEFAULT_BODY]),
            sequences=tuple(sequences),
        )

    def perform(self, choice: Choice) -> Performance:
        """Load a choice and start its rollout. Raises InputError for an impossible combination, and for
        anything that is not among the choices, which a page other than ours may send.
        """
        for what, offered in (
            (choice.motion, self.motions),
            (choice.model, self.models),
            (choice.body, self.bodies),
            (choice.quality, QUALITIES),
            *((name, self.garments) for name in choice.garments),
        ):
            if what not in offered:
                raise InputError(f"{what} is not among the choices")
        body = load_body(None if choice.body == DEFAULT_BODY else Path(choice.body))
        if choice.motion in self.sequences:
            return self._beside_simulation(choice, body)
        if not choice.garments:
            raise InputError("choose a garment")
        outfit = Outfit(body, load_outfit(choice.garments, body, fabric=choice.fabric))
        method, clear = _method(choice, outfit)
        return _perform(ready_rollout(method, outfit, load_clip(choice.motion, body), clear))

    def _beside_simulation(self, choice: Choice, body: Body) -> Performance:
        """The rollout over the motion of a sequence, in its garment, to be compared vertex by vertex."""
        sequence = load_simulated(Path(choice.motion))
        garment = self._simulated_garment(choice.motion, sequence)
        outfit = Outfit(body, load_outfit([garment], body, fabric=choice.fabric))
        _require_same(choice.motion, sequence, outfit)
        motion = clip_of_transforms(sequence.transforms, body, sequence.fps, choice.motion)
        method, clear = _method(choice, outfit)
        ready = ready_rollout(method, outfit, motion, clear, proxies=False)
        return replace(_perform(ready), title=Path(choice.motion).stem, truth=sequence.vertices)

    def _simulated_garment(self, path: str, sequence: SimulatedClip) -> str:
        """The template or file of a sequence's garment. Raises InputError if it is not among the choices."""
        (simulated,) = sequence.garments
        for name in self.garments:
            if simulated.name in (name, Path(name).stem):
                return name
        raise InputError(f"{path}: its garment {simulated.name} is unknown, give its file with --garment")


def _method(choice: Choice, outfit: Outfit) -> tuple[Method, bool]:
    """The method of a choice with its finish, and whether clearing comes after it."""
    return ready_method(
        [choice.model], outfit, choice.finish, choice.quality, [choice.fabric] if choice.fabric else []
    )


def _perform(ready: ReadyRollout) -> Performance:
    """A rollout for the page, which continues even if a garment tears."""
    return Performance(
        title=ready.motion.name,
        body=ready.proxied.outfit.body,
        meshes=ready.proxied.meshes,
        count=len(ready.transforms),
        fps=ready.motion.fps,
        frames=(frame.in_world() for frame in ready.frames(keep_going=True)),
    )


def _require_same(path: str, sequence: SimulatedClip, outfit: Outfit) -> None:
    """Raise InputError if a sequence is not of the outfit's garment on its body."""
    body, (garment,) = outfit.body, outfit.garments
    rest, simulated = garment.mesh.vertices, sequence.garments[0].rest
    if sequence.transforms.shape[1] != len(body.skeleton.names):
        raise InputError(f"{path}: was simulated on a body with another skeleton, give that body with --body")
    if rest.shape != simulated.shape or float((rest - simulated).abs().max()) > REST_TOLERANCE:
        raise InputError(
            f"{path}: its garment {garment.name} is not the one that this body has, give the body that it "
            "was simulated on with --body"
        )
