"""Motion capture in, moving clothes out.

The public names of the library, each loaded when it is first used: `import uvcloth` alone loads no torch.
docs/library.md says what they are and how they go together.
"""

import logging
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uvcloth.api import (
        export,
        fit,
        load_body,
        load_model,
        load_motion,
        rollout,
        rollout_frames,
        simulate,
    )
    from uvcloth.bodies.body import Body
    from uvcloth.errors import InputError
    from uvcloth.garments.garment import Garment, Outfit
    from uvcloth.garments.holds import Hold
    from uvcloth.garments.tucks import Tuck
    from uvcloth.geometry.mesh import Mesh
    from uvcloth.geometry.skeleton import Skeleton
    from uvcloth.methods.method import Method
    from uvcloth.motion.clip import Clip
    from uvcloth.physics.fabric import Fabric
    from uvcloth.rollouts.rollout import BrokenRolloutError, RolloutFrame
    from uvcloth.version import __version__
    from uvcloth.writers.animation import Animation

__all__ = [
    "Animation",
    "Body",
    "BrokenRolloutError",
    "Clip",
    "Fabric",
    "Garment",
    "Hold",
    "InputError",
    "Mesh",
    "Method",
    "Outfit",
    "RolloutFrame",
    "Skeleton",
    "Tuck",
    "__version__",
    "export",
    "fit",
    "load_body",
    "load_model",
    "load_motion",
    "rollout",
    "rollout_frames",
    "simulate",
]

_HOMES = {
    **dict.fromkeys(("export", "fit", "load_body", "load_model", "load_motion"), "uvcloth.api"),
    **dict.fromkeys(("rollout", "rollout_frames", "simulate"), "uvcloth.api"),
    "Animation": "uvcloth.writers.animation",
    "Body": "uvcloth.bodies.body",
    "BrokenRolloutError": "uvcloth.rollouts.rollout",
    "Clip": "uvcloth.motion.clip",
    "Fabric": "uvcloth.physics.fabric",
    "Garment": "uvcloth.garments.garment",
    "Hold": "uvcloth.garments.holds",
    "InputError": "uvcloth.errors",
    "Mesh": "uvcloth.geometry.mesh",
    "Method": "uvcloth.methods.method",
    "Outfit": "uvcloth.garments.garment",
    "RolloutFrame": "uvcloth.rollouts.rollout",
    "Skeleton": "uvcloth.geometry.skeleton",
    "Tuck": "uvcloth.garments.tucks",
    "__version__": "uvcloth.version",
}
"""Module of each public name."""

logging.getLogger(__name__).addHandler(logging.NullHandler())


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Load a public name (PEP 562)."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(_HOMES[name]), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted(__all__)
