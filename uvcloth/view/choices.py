"""Motions, garments, models and bodies that the live view offers, and the rollout of what was chosen."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import load_body
from uvcloth.dataset.clip import REST_TOLERANCE, SimulatedClip
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.garments.proxy import ProxiedOutfit
from uvcloth.methods.registry import DEFAULT, METHODS, load_methods
from uvcloth.motion.library import builtin_clips, load_clip
from uvcloth.rollout import rollout_proxied, with_proxies
from uvcloth.view.computation import Performance

TEMPLATES = ("bottoms", "tops", "shirt", "dress", "skirt", "jacket")
"""The templates, the innermost first."""

DEFAULT_BODY = "default"
"""Name of the body in the package."""


@dataclass(frozen=True)
class Chosen:
    """A choice: garments are in the order in which they are worn, the innermost first."""

    motion: str
    garments: tuple[str, ...]
    model: str
    body: str
    contact: bool = True


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

    def perform(self, chosen: Chosen) -> Performance:
        """Load a choice and start its rollout. Raises InputError for an impossible combination, and for
        anything that is not among the choices, which a page other than ours may send.
        """
        for what, offered in (
            (chosen.motion, self.motions),
            (chosen.model, self.models),
            (chosen.body, self.bodies),
            *((name, self.garments) for name in chosen.garments),
        ):
            if what not in offered:
                raise InputError(f"{what} is not among the choices")
        body = load_body(None if chosen.body == DEFAULT_BODY else Path(chosen.body))
        if chosen.motion in self.sequences:
            sequence = load_simulated(Path(chosen.motion))
            garments: tuple[str, ...] = (self._simulated_garment(chosen.motion, sequence),)
            transforms, fps = sequence.transforms, sequence.fps
        else:
            sequence, garments = None, chosen.garments
            clip = load_clip(chosen.motion, body)
            transforms, fps = clip.transforms(torch.float64), clip.fps
        if not garments:
            raise InputError("choose a garment")
        outfit = Outfit(body, load_outfit(garments, body))
        if sequence is not None:
            _require_same(chosen.motion, sequence, outfit)
        method = load_methods([chosen.model], body)
        if reason := method.unsupported_reason(outfit):
            raise InputError(reason)
        truth: Tensor | None = None if sequence is None else sequence.vertices
        # What was simulated is compared vertex by vertex.
        as_is = sequence is not None or not chosen.contact
        proxied = ProxiedOutfit.as_is(outfit) if as_is else with_proxies(outfit, method)
        frames = rollout_proxied(method, proxied, transforms, fps, chosen.contact, keep_going=True)
        return Performance(
            title=Path(chosen.motion).stem,
            body=body,
            meshes=proxied.meshes,
            count=len(transforms),
            fps=fps,
            frames=(frame.in_world() for frame in frames),
            truth=truth,
        )

    def _simulated_garment(self, path: str, sequence: SimulatedClip) -> str:
        """The template or file of a sequence's garment. Raises InputError if it is none of the choices."""
        (simulated,) = sequence.garments
        for name in self.garments:
            if simulated.name in (name, Path(name).stem):
                return name
        raise InputError(f"{path}: its garment {simulated.name} is unknown, give its file with --garment")


def _require_same(path: str, sequence: SimulatedClip, outfit: Outfit) -> None:
    """Raise InputError if a sequence is not of the outfit's garment on its body."""
    body, (garment,) = outfit.body, outfit.garments
    rest, simulated = garment.mesh.vertices, sequence.garments[0].rest
    if sequence.transforms.shape[1] != len(body.skeleton.names):
        raise InputError(f"{path}: was simulated on a body of another skeleton, give it with --body")
    if rest.shape != simulated.shape or float((rest - simulated).abs().max()) > REST_TOLERANCE:
        raise InputError(
            f"{path}: its garment {garment.name} is not the one that this body has, give the body that it "
            "was simulated on with --body"
        )
