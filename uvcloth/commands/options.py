"""Types of options that several commands have, with their names and defaults in help texts."""

from pathlib import Path
from typing import Annotated, Literal, get_args

from tyro.conf import OmitArgPrefixes, arg

from uvcloth.methods.registry import DEFAULT, list_methods
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.fabric import FabricName

TemplateName = Literal["tops", "bottoms", "dress", "shirt", "skirt", "jacket"]
"""Written out, as the names of fabrics and engines are, so that help texts import nothing heavy."""

TEMPLATE_NAMES = ", ".join(get_args(TemplateName))
FABRIC_NAMES = "|".join(get_args(FabricName))
TRAINED = "a folder written by `python -m train`"

Garments = Annotated[tuple[str, ...], arg(metavar="NAME|FILE ...")]
Models = Annotated[
    tuple[str, ...],
    arg(
        metavar="NAME|RUN ...",
        help=f"Methods: {list_methods()}; or {TRAINED}. One for all garments, or one for each in order. "
        f"auto: {DEFAULT} where every garment has a hem that holds it, otherwise a model of any garment.",
        help_behavior_hint="(default: auto)",
    ),
]
GarmentPose = Annotated[
    Literal["t", "a"] | None,
    arg(
        metavar="t|a",
        help="Pose of the body on which garment files were modelled: arms straight and level (t), or 45 "
        "degrees down (a).",
        help_behavior_hint="(default: found by where each garment lies best)",
    ),
]
FromBody = Annotated[
    Path | None,
    arg(
        metavar="OBJ|GLB",
        help="Mesh of the body on which garment files were modelled, in their coordinates; they are "
        "transferred from it with their ease.",
        help_behavior_hint="(default: found by where each garment lies best)",
    ),
]
Tucks = Annotated[
    tuple[str, ...],
    arg(
        metavar="GARMENT:INTO ...",
        help="Garments that are tucked into others, by name: shirt:bottoms wears the shirt beneath the "
        "trousers, whatever the order.",
        help_behavior_hint="",
    ),
]
Fabric = Annotated[FabricName | None, arg(metavar=FABRIC_NAMES, help_behavior_hint="(default: jersey)")]
BodyFile = Annotated[Path | None, arg(metavar="NPZ", help_behavior_hint="(default: the one in the package)")]
Jobs = Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: one per core)")]
Port = Annotated[int, arg(metavar="N")]
Host = Annotated[str, arg(metavar="ADDRESS")]
Threads = Annotated[int, arg(metavar="N")]
MotionFile = Annotated[OmitArgPrefixes[MotionOptions], arg(name="motion file")]
