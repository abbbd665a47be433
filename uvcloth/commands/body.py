"""`uvcloth body`: its options, and their valid combinations."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import ANNY, JSON, BodyFile
from uvcloth.errors import InputError
from uvcloth.files.options import Between, InputPath, NewFile, NewFolder, Several

SUFFIXES = (".npz", ".obj", ".glb")

Fraction = Annotated[float | None, arg(metavar="0..1", help_behavior_hint=""), Between(0, 1)]


@dataclass(frozen=True)
class Phenotype:
    """Shape of the body, each from 0 to 1; the default is the value of the body that ships with uvcloth."""

    gender: Fraction = None
    """0 male, 1 female."""
    age: Fraction = None
    """0 baby, 0.33 child, 0.67 young adult, 1 old."""
    muscle: Fraction = None
    """0 weak, 1 muscular."""
    weight: Fraction = None
    """0 thin, 1 heavy."""
    height: Fraction = None
    """0 small, 1 tall."""
    proportions: Fraction = None
    """0 uncommon, 1 idealized proportions."""

    def given(self) -> dict[str, float]:
        """The values that were given, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True)
class MakeBody(Command):
    """Make a body from phenotypes, a character or an SMPL model, or write the body of the package as a mesh
    to model on."""

    out: Annotated[Path, NewFile(SUFFIXES)]
    """File to write: .npz for --body of other commands, .obj or .glb to model on (rest pose, UVs)."""
    body: BodyFile = None
    """An existing body to write in another format; not together with phenotypes."""
    character: Annotated[
        Path | None, arg(metavar="GLB", help_behavior_hint=""), InputPath((".glb", ".gltf", ".vrm", ".fbx"))
    ] = None
    """A rigged character (.glb, .gltf, .vrm, .fbx) to make the body from; see docs/characters.md."""
    joints: Annotated[
        Path | None, arg(metavar="JSON", help_behavior_hint="(default: by their names)"), JSON
    ] = None
    """Roles of the character's joints, as for motions: {"hips": "Pelvis_02", ...}."""
    keep: Annotated[tuple[str, ...], arg(metavar="MESH ...", help_behavior_hint=""), Several()] = ()
    """Meshes or materials of the character that cloth collides with, in spite of their names."""
    drop: Annotated[tuple[str, ...], arg(metavar="MESH ...", help_behavior_hint=""), Several()] = ()
    """Meshes or materials of the character to leave out."""
    clothes: Annotated[Path | None, arg(metavar="FOLDER", help_behavior_hint=""), NewFolder()] = None
    """Folder for the character's clothes, each as an OBJ with its textures, for --garment of other commands.
    Meshes and materials that --drop names are among them."""
    unit: Annotated[
        Literal["m", "dm", "cm", "mm", "inches", "feet"] | None,
        arg(metavar="m|dm|cm|mm|inches|feet", help_behavior_hint="(default: by its height)"),
    ] = None
    """Unit of the character's file. Needed for a character of unusual height in another unit than metres."""
    smpl: Annotated[Path | None, arg(metavar="NPZ|PKL", help_behavior_hint=""), InputPath()] = None
    """A model file of SMPL, SMPL-H or SMPL-X of one gender; see docs/field_data.md."""
    betas: Annotated[
        tuple[float, ...],
        arg(metavar="N ...", help_behavior_hint="(default: all 0)"),
        Between(-20, 20),
        Several(most=1000),
    ] = ()
    """First shape parameters of the SMPL model."""
    phenotype: OmitArgPrefixes[Phenotype] = field(default_factory=Phenotype)

    def check(self) -> None:
        """Raise InputError for two sources of the body, options without their source, or without Anny."""
        phenotype = self.phenotype.given()
        if phenotype:
            ANNY.require()
        if phenotype and self.body:
            raise InputError(f"{self.body}: --body cannot be combined with phenotypes, give one of them")
        if self.character and (phenotype or self.body):
            raise InputError(f"{self.character}: has its own shape, leave out phenotypes and --body")
        if self.smpl and (phenotype or self.body or self.character):
            raise InputError(f"{self.smpl}: --smpl cannot be combined with phenotypes, --body or --character")
        if not self.character and (self.joints or self.keep or self.drop or self.unit or self.clothes):
            raise InputError("body: --joints, --keep, --drop, --clothes and --unit need --character")
        if not self.smpl and self.betas:
            raise InputError("body: --betas need --smpl")
