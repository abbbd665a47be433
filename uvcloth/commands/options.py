"""Types of options that several commands have: ranges, and names and defaults in help texts."""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, get_args

from tyro.conf import OmitArgPrefixes, arg

from uvcloth.files.options import AtLeast, Between, InputPath, NewFile, Package, Several, Text
from uvcloth.methods.registry import DEFAULT, list_methods
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.fabric import FabricName

TemplateName = Literal["tops", "bottoms", "dress", "shirt", "skirt", "jacket"]
"""Written out, as the names of fabrics and engines are, so that help texts import nothing heavy."""

TEMPLATE_NAMES = ", ".join(get_args(TemplateName))
FABRIC_NAMES = "|".join(get_args(FabricName))
TRAINED = "a folder written by `uvcloth train`"

MOTIONS = (".bvh", ".glb", ".gltf", ".vrm", ".vrma", ".fbx", ".npz")
"""Suffixes of motion files."""

CHARACTERS = (".glb", ".gltf", ".vrm", ".fbx")
"""Suffixes of rigged characters."""

VIDEO = Package("av", "videos need PyAV: install uvcloth[video]", (".mp4", ".gif"))
EXTRAS = (
    Package("alembic3d", "writing Alembic needs alembic3d: install uvcloth[alembic]", (".abc",)),
    VIDEO,
)
"""Packages that formats of animations need."""

DASK = Package("dask", "simulating needs dask: install uvcloth[simulate]")
ANNY = Package("anny", "making a body needs Anny: install uvcloth[body]")
REMESHER = Package("pyacvd", "tailoring needs the remesher: install uvcloth[body]")
ONNX = Package("onnx", "an export without --motion needs the package onnx: install uvcloth[export]")


def clip_names() -> list[str]:
    """Names of the built-in clips."""
    folder = Path(str(files("uvcloth"))) / "data" / "clips"
    return sorted(path.stem for path in folder.glob("*.npz"))


GARMENT = InputPath(names=lambda: get_args(TemplateName))
MOTION = InputPath(MOTIONS, names=clip_names)
MOTIONS_OR_FOLDERS = InputPath(MOTIONS, "file or folder", clip_names)
CSV, JSON, NPZ = (InputPath((suffix,)) for suffix in (".csv", ".json", ".npz"))
FOLDER = InputPath(kind="folder")
PNG = NewFile((".png",))
DEVICE = Text(r"cpu|cuda(:\d{1,2})?", "cpu, cuda or cuda:N")
SEED = Between(0, 2**32 - 1)

Garments = Annotated[tuple[str, ...], arg(metavar="NAME|FILE ..."), GARMENT, Several()]
GarmentsInOrder = Annotated[
    tuple[str, ...],
    arg(
        metavar="NAME|FILE ...",
        help=f"Templates ({TEMPLATE_NAMES}) or garment files, in the order in which they are worn, the "
        "innermost first.",
    ),
    GARMENT,
    Several(least=1),
]
Quality = Annotated[
    Literal["fast", "default", "fine"],
    arg(help="Size of the faces that the cloth solver moves: edges of about 57, 40 or 30 mm."),
]
Models = Annotated[
    tuple[str, ...],
    arg(
        metavar="NAME|RUN ...",
        help=f"Methods: {list_methods()}; or {TRAINED}. One for all garments, or one for each in order. "
        f"auto: {DEFAULT} where every garment has a hem that holds it, otherwise a model of any garment.",
        help_behavior_hint="(default: auto)",
    ),
    Several(),
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
    InputPath(),
]
Wrinkled = Annotated[
    bool,
    arg(
        help="Add wrinkles that the solver's faces are too large for, on finer meshes, to garments that a "
        "network was trained on."
    ),
]
WrinklesFrom = Annotated[
    Path | None,
    arg(
        metavar="RUN",
        help="Folder of `uvcloth train wrinkles` whose network makes the wrinkles.",
        help_behavior_hint="(default: the network in the package)",
    ),
    FOLDER,
]
OnCharacter = Annotated[
    bool,
    arg(
        help="Garment files lie on the character as its file has it: in its axes, its unit and its bind pose."
    ),
]
Fabric = Annotated[FabricName | None, arg(metavar=FABRIC_NAMES, help_behavior_hint="(default: jersey)")]
Dynamics = Annotated[
    float | None,
    arg(
        metavar="K",
        help="Factor, 0 to 2, of what a recurrent model does because of motion: 0 shows the garments as they "
        "come to rest in each pose, 2 swings twice as far. The dynamic finish adds its own motion.",
        help_behavior_hint="(default: 1)",
    ),
    Between(0, 2),
]
BodyFile = Annotated[
    Path | None, arg(metavar="NPZ", help_behavior_hint="(default: the one in the package)"), NPZ
]
Jobs = Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: one per core)"), AtLeast(1)]
Port = Annotated[int, arg(metavar="N"), Between(1, 65535)]
Host = Annotated[str, arg(metavar="ADDRESS"), Text(r"[\w.:%-]+", "an address or the name of a machine")]
Threads = Annotated[int, arg(metavar="N"), Between(1, 1024)]
MotionFile = Annotated[OmitArgPrefixes[MotionOptions], arg(name="motion file")]


@dataclass(frozen=True)
class FitOptions:
    """Fitting of the garments: how they are worn, and what is known of their files."""

    tuck: Annotated[
        tuple[str, ...],
        arg(
            metavar="GARMENT:INTO ...",
            help="Garments that are tucked into others, by name: shirt:bottoms wears the shirt beneath the "
            "trousers, whatever the order.",
            help_behavior_hint="",
        ),
    ] = ()
    hold: Annotated[
        tuple[str, ...],
        arg(
            metavar="[GARMENT:]PLACE|FILE ...",
            help="Places that hold garments up: top (the uppermost hem), collar, waist, cuffs or shoulders; "
            "`uvcloth fit` names those of a garment. cuffs: sleeves or trouser legs with a closure. Or, with "
            "the garment's name, a .txt file of the numbers of its vertices, from 0.",
            help_behavior_hint="(default: the uppermost hem, or the shoulders)",
        ),
    ] = ()
    garment_pose: GarmentPose = None
    from_body: FromBody = None
    fabric: Annotated[
        tuple[FabricName, ...], arg(metavar=f"{FABRIC_NAMES} ...", help_behavior_hint="(default: jersey)")
    ] = ()
    """Fabric of the garments, for the cloth solver and DeePSD models: one for all, or one for each."""


GarmentFiles = Annotated[OmitArgPrefixes[FitOptions], arg(name="garment")]
