"""Trained wrinkles: the network, its checkpoint, and what it serves."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import Checkpoint, TrainingData, body_record, load_checkpoint, restored
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.physics.fabric import JERSEY
from uvcloth.wrinkles.network import WrinkleConfig, WrinkleNet

METHOD = "wrinkles"
"""Name in a checkpoint."""

TRAINED_BODY = "default"
"""Name of the body that the networks in the package were trained on."""

BY_DEFAULT = ("tops",)
"""Templates whose pictures have wrinkles without being asked for: better in validation than plain ones."""

SHIPPED = Path(str(files("uvcloth"))) / "data" / "wrinkles"
"""Folder of the trained networks in the package, a folder for each template."""


def shipped_for(outfit: Outfit) -> Path:
    """Folder of the packaged network of the outermost garment that has one; of T-shirts if none has."""
    folders = [SHIPPED / garment.template for garment in outfit.garments if garment.template]
    return next((folder for folder in reversed(folders) if folder.is_dir()), SHIPPED / "tops")


@dataclass(frozen=True)
class Wrinkles:
    """A trained network of wrinkles."""

    config: WrinkleConfig
    net: WrinkleNet

    @classmethod
    def untrained(cls, config: WrinkleConfig) -> "Wrinkles":
        """The network with untrained weights, which makes no wrinkles."""
        return cls(config, WrinkleNet(config))

    def unsupported_reason(self, garment: Garment, quality: str) -> str:
        """The reason that it has no wrinkles for a garment on a cage of a quality, "" if it has."""
        if quality != self.config.quality:
            return (
                f"garment {garment.name}: wrinkles are trained for --quality {self.config.quality}, "
                f"not {quality}"
            )
        if garment.fabric != JERSEY:
            return f"garment {garment.name}: wrinkles are trained for jersey, not for another fabric"
        if garment.template not in self.config.garments:
            kind = garment.template or "a garment without template"
            return (
                f"garment {garment.name}: wrinkles are trained for {', '.join(self.config.garments)}, "
                f"not {kind}"
            )
        return ""


def wrinkles_checkpoint(
    wrinkles: Wrinkles, body: Body, data: TrainingData, notes: Mapping[str, Any]
) -> Checkpoint:
    """The checkpoint of trained wrinkles; weights in half precision."""
    return Checkpoint(
        method=METHOD,
        config=asdict(wrinkles.config),
        tensors={name: value.half() for name, value in wrinkles.net.state_dict().items()},
        body=body_record(body),
        garments=wrinkles.config.garments,
        data=data,
        notes=dict(notes),
    )


def load_wrinkles(folder: Path, body: Body) -> Wrinkles:
    """Read trained wrinkles. Raises InputError as `load_checkpoint`, and for a model of another method."""
    checkpoint = load_checkpoint(folder, body)
    if checkpoint.method != METHOD:
        raise InputError(f"{folder}: a model of method {checkpoint.method!r:.60}, expected {METHOD}")
    wrinkles: Wrinkles = restored(
        checkpoint, folder, WrinkleConfig, Wrinkles.untrained, lambda each: each.net
    )
    wrinkles.net.eval()
    return wrinkles
