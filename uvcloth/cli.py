"""The `uvcloth` command: body, motion, simulate, data, maps, fit, rollout, view, poses, outfits, export,
demo.

Heavy modules are imported by the subcommand that needs them, so that `uvcloth --help` answers at once.
"""

import sys
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import OmitArgPrefixes, Positional, arg, subcommand

from uvcloth.commands.log import printed_log
from uvcloth.errors import InputError
from uvcloth.files.atomic import make_folder
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.fabric import FabricName
from uvcloth.process.command import run_command
from uvcloth.version import package_version

if TYPE_CHECKING:
    from uvcloth.commands.view import LiveAudience

DESCRIPTION = """Motion capture in, moving clothes out.

The first hour:

uvcloth view

uvcloth fit shirt.obj

uvcloth rollout --motion walk.bvh --garment shirt.obj --out walk.mp4 walk.glb

uvcloth --version"""

TemplateName = Literal["tops", "bottoms", "dress", "shirt", "skirt", "jacket"]
EngineName = Literal["explicit", "newton", "blender"]
Garments = Annotated[tuple[str, ...], arg(metavar="NAME|FILE ...")]
GarmentPose = Annotated[
    Literal["t", "a"] | None, arg(metavar="t|a", help_behavior_hint="(default: rest pose)")
]
Fabric = Annotated[
    FabricName | None,
    arg(metavar="jersey|cotton|silk|denim", help_behavior_hint="(default: jersey)"),
]
BodyFile = Annotated[Path | None, arg(metavar="NPZ", help_behavior_hint="(default: the one in the package)")]
Port = Annotated[int, arg(metavar="N")]
Host = Annotated[str, arg(metavar="ADDRESS")]
Share = Annotated[float | None, arg(metavar="0..1", help_behavior_hint="")]


@dataclass(frozen=True)
class Phenotype:
    """Shape of the body, each from 0 to 1; the default is the value of the body that ships with uvcloth."""

    gender: Share = None
    """0 male, 1 female."""
    age: Share = None
    """0 baby, 0.33 child, 0.67 young adult, 1 old."""
    muscle: Share = None
    """0 weak, 1 muscular."""
    weight: Share = None
    """0 thin, 1 heavy."""
    height: Share = None
    """0 small, 1 tall."""
    proportions: Share = None
    """0 uncommon, 1 idealized proportions."""


@dataclass(frozen=True)
class MakeBody:
    """Make a body from phenotypes, a character or an SMPL model, or write the body of the package as a mesh
    to model on."""

    out: Path
    """File to write: .npz for --body of other commands, .obj or .glb to model on (rest pose, UVs)."""
    body: BodyFile = None
    """An existing body to write in another format; not together with phenotypes."""
    character: Annotated[Path | None, arg(metavar="GLB", help_behavior_hint="")] = None
    """A rigged character (.glb, .gltf, .vrm) to make the body from; see docs/characters.md."""
    joints: Annotated[Path | None, arg(metavar="JSON", help_behavior_hint="(default: by their names)")] = None
    """Roles of the character's joints, as for motions: {"hips": "Pelvis_02", ...}."""
    keep: Annotated[tuple[str, ...], arg(metavar="MESH ...", help_behavior_hint="")] = ()
    """Meshes or materials of the character that cloth collides with, in spite of their names."""
    drop: Annotated[tuple[str, ...], arg(metavar="MESH ...", help_behavior_hint="")] = ()
    """Meshes or materials of the character to leave out."""
    unit: Annotated[
        Literal["m", "dm", "cm", "mm", "inches", "feet"] | None,
        arg(metavar="m|dm|cm|mm|inches|feet", help_behavior_hint="(default: by its height)"),
    ] = None
    """Unit of the character's file. Needed for a character of unusual height in another unit than metres."""
    smpl: Annotated[Path | None, arg(metavar="NPZ|PKL", help_behavior_hint="")] = None
    """A model file of SMPL, SMPL-H or SMPL-X of one gender; see docs/field_data.md."""
    betas: Annotated[tuple[float, ...], arg(metavar="N ...", help_behavior_hint="(default: all 0)")] = ()
    """First shape parameters of the SMPL model."""
    phenotype: OmitArgPrefixes[Phenotype] = field(default_factory=Phenotype)

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        from uvcloth.commands.body import CharacterFile, SmplFile, make

        chosen = {key: value for key, value in asdict(self.phenotype).items() if value is not None}
        if self.character is None and (self.joints or self.keep or self.drop or self.unit):
            raise InputError("body: --joints, --keep, --drop and --unit need --character")
        character = self.character and CharacterFile(
            self.character, self.joints, self.keep, self.drop, self.unit
        )
        if self.smpl is None and self.betas:
            raise InputError("body: --betas need --smpl")
        smpl = self.smpl and SmplFile(self.smpl, self.betas)
        body = make(self.out, chosen, self.body, character or None, smpl or None)
        print(f"{self.out}: {len(body.mesh.vertices)} vertices, {len(body.skeleton.names)} joints")


@dataclass(frozen=True)
class Motion:
    """Explain how a motion file is understood, and draw it as stick figures."""

    file: Positional[Annotated[str, arg(metavar="FILE|NAME")]]
    """A motion file (BVH, glTF, AMASS) or the name of a built-in clip."""
    out: Path = Path("motion.png")
    """The picture to write."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    options: OmitArgPrefixes[MotionOptions] = field(default_factory=MotionOptions)

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        from uvcloth.commands.motion import describe

        describe(self.file, self.out, self.options, self.body)


@dataclass(frozen=True)
class Simulate:
    """Simulate garments over clips with a cloth engine; run it again to continue."""

    clips: Positional[Annotated[tuple[str, ...], arg(metavar="CLIP ...", help_behavior_hint="")]]
    """Motion files (BVH, glTF, AMASS) or names of built-in clips."""
    out: Path
    """Folder for the sequences, one npz per clip and garment."""
    garment: Garments = ("tops", "bottoms", "dress")
    """Templates or garment files to simulate; sequences of a file take the name of the file."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    plan: Annotated[Path | None, arg(metavar="CSV", help_behavior_hint="")] = None
    """Simulate the rows of a table instead. Columns: clip, start, frames (a window at 30 fps), garments
    (joined by + if worn together), split, subject, action; optional: name (of the window), hold (seconds to
    stand still at its end), body (a file relative to the table), member (of an ensemble, 1 to 3). Other
    bodies, layers and members get separate folders in OUT."""
    outfits: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None
    """Simulate the outfits of this folder, made by `uvcloth outfits`, instead: each on its body, over one
    window of its split in the table."""
    most_frames: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: whole windows)")] = None
    """With --outfits: at most the first N frames of each window."""
    layered: bool = False
    """Simulate the garments together, worn over one another, the first innermost; otherwise each is simulated
    alone."""
    engine: EngineName = "explicit"
    """Cloth solver: the project's explicit one, Newton's VBD, or Blender's, of the installation that
    UVCLOTH_BLENDER_PYTHON names."""
    fabric: Annotated[
        FabricName | None,
        arg(
            metavar="jersey|cotton|silk|denim",
            help_behavior_hint="(default: jersey; with --outfits each has its fabric)",
        ),
    ] = None
    """Fabric of the garments."""
    windows: Annotated[Path | None, arg(metavar="CSV", help_behavior_hint="(default: whole clips)")] = None
    """Simulate windows of clips: a table with the columns trial, subject, split, action, window_start and
    window_frames, which training and evaluation also use. Without clips, all clips of the table."""
    clips_from: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="(default: the table's)")] = None
    """Folder of the clips of the table."""
    split: Annotated[
        tuple[Literal["train", "validation", "test"], ...] | None,
        arg(metavar="train|validation|test ...", help_behavior_hint="(default: all three)"),
    ] = None
    """Splits to simulate: validation comes first, then test, then training in a mixed order."""
    jobs: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: one per core)")] = None
    """Number of sequences to simulate at the same time."""
    scheduler: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")] = None
    """Address of a dask scheduler that runs the simulations instead of this machine."""
    repeat: bool = False
    """Simulate each window again from a start 20 frames earlier, into OUT/repeat. Evaluation reports the
    difference as the repeatability floor."""
    options: OmitArgPrefixes[MotionOptions] = field(default_factory=MotionOptions)

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        if not (self.clips or self.windows or self.plan) or not self.garment:
            raise InputError(
                "simulate: name at least one clip, or a table with --windows, and one garment, or a --plan"
            )
        from uvcloth.bodies.body import load_body
        from uvcloth.simulate.batch import simulate_batch
        from uvcloth.simulate.plan import ClipSelection
        from uvcloth.simulate.workers import Workers

        workers = Workers(self.jobs, self.scheduler)
        if self.plan is not None:
            self._require_plain(
                "--plan", "plan", "out", "clips_from", "engine", "fabric", "jobs", "scheduler"
            )
            from uvcloth.simulate.planned import simulate_plan

            simulate_plan(self.plan, self.out, self.clips_from, self.engine, self.fabric, workers)
            return
        selection = ClipSelection(self.clips, self.windows, self.clips_from, self.split, self.options)
        if self.most_frames is not None and self.outfits is None:
            raise InputError("--most-frames: needs --outfits; choose frames of clips with --windows")
        if self.outfits is not None:
            unused = {
                "--body": self.body is not None,
                "--garment": self.garment != Simulate.garment,
                "--layered": self.layered,
                "--repeat": self.repeat,
            }
            for option in (name for name, given in unused.items() if given):
                raise InputError(
                    f"{option}: not allowed with --outfits, whose files name garments and bodies"
                )
            from uvcloth.simulate.outfits import simulate_outfits

            simulate_outfits(
                self.outfits, selection, self.out, self.most_frames, self.engine, self.fabric, workers
            )
            return
        simulate_batch(
            selection,
            outfits=[self.garment] if self.layered else [(name,) for name in self.garment],
            out=self.out,
            body=load_body(self.body),
            engine=self.engine,
            fabric=self.fabric,
            repeat=self.repeat,
            workers=workers,
        )

    def _require_plain(self, option: str, *used: str) -> None:
        """Raise InputError for a field that is not allowed with an option. used: fields that are allowed."""
        usual = Simulate(clips=(), out=self.out)
        for each in fields(self):
            if each.name not in used and getattr(self, each.name) != getattr(usual, each.name):
                name = "clips" if each.name == "clips" else f"--{each.name.replace('_', '-')}"
                raise InputError(f"{name}: not allowed with {option}, whose table contains it")


@dataclass(frozen=True)
class Data:
    """List the sequences of a folder, which were refused and why, and which of its index are missing."""

    folder: Positional[Annotated[Path, arg(metavar="DIR")]]
    """A folder made by `uvcloth simulate`; with --unpack, a packed folder."""
    pack: Annotated[Path | None, arg(metavar="OUT", help_behavior_hint="")] = None
    """Pack the sequences into another folder instead, at about a twentieth of their size. Run it again to
    continue."""
    error: Annotated[float, arg(metavar="MM")] = 1.0
    """Mean error of the vertices of a packed sequence; 99 % are within three times as much, all within six
    times. Half the error doubles the size."""
    unpack: Annotated[Path | None, arg(metavar="OUT", help_behavior_hint="")] = None
    """Unpack a packed folder into another one instead, for training and evaluation."""

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        if self.pack and self.unpack:
            raise InputError("data: give --pack or --unpack, not both")
        if self.pack:
            from uvcloth.simulate.packed import pack_folder

            print(f"{self.pack}: {pack_folder(self.folder, self.pack, 1e-3 * self.error)} sequences packed")
            return
        if self.unpack:
            from uvcloth.simulate.packed import unpack_folder

            print(f"{self.unpack}: {unpack_folder(self.folder, self.unpack)} sequences unpacked")
            return
        from rich.console import Console

        from uvcloth.simulate.overview import overview

        Console().print(overview(self.folder), soft_wrap=True)


@dataclass(frozen=True)
class Maps:
    """Write body velocity, body acceleration, garment offset and masks of a simulated sequence as UV maps."""

    sequence: Positional[Path]
    """A sequence npz made by `uvcloth simulate`."""
    out: Path
    """Folder for one EXR file per frame and contact_sheet.png."""
    size: int = 256
    """Texels along each side of the maps."""
    frames: Annotated[str, arg(metavar="FIRST:END:STEP")] = "::10"
    """Frames, as a Python slice."""
    body: BodyFile = None
    """The body that the sequence was simulated on."""
    layout: Annotated[Path | None, arg(metavar="NPZ", help_behavior_hint="(default: the body's)")] = None
    """Another UV layout of that body."""

    def run(self) -> None:
        from uvcloth.commands.maps import draw_maps

        count = draw_maps(
            self.sequence,
            self.out,
            size=self.size,
            frames=self.frames,
            body_file=self.body,
            layout_file=self.layout,
        )
        print(
            f"{self.out}: {count} EXR files; contact_sheet.png has velocity, acceleration, offset per frame"
        )


@dataclass(frozen=True)
class Fit:
    """Explain a garment file, and check that it lies on the body as clothes do."""

    file: Positional[Path]
    """A garment mesh on the body's rest pose (OBJ, PLY, GLB or STL), in any unit, Y or Z up, around the
    body's origin or standing on the floor; or MakeHuman clothes (MHCLO with its OBJ)."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    template: Annotated[
        TemplateName | None,
        arg(metavar="tops|bottoms|dress|shirt", help_behavior_hint="(default: the one that it covers best)"),
    ] = None
    """Template that a PhysXNet predicts it as."""
    garment_pose: GarmentPose = None
    """Pose of the body on which the garment was modelled: arms straight and level (t), or 45 degrees down
    (a)."""
    out: Annotated[Path | None, arg(metavar="OBJ", help_behavior_hint="")] = None
    """Also write the placed garment as OBJ (metres, Z up); several garments go into separate files."""

    picture: Annotated[Path | None, arg(metavar="PNG")] = Path("fit.png")
    """Picture of the garment on the body, also if it is refused; None for no picture."""

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        from uvcloth.commands.fit import examine

        found = examine(
            self.file,
            body_file=self.body,
            template=self.template,
            out=self.out,
            picture=self.picture,
            pose=self.garment_pose,
        )
        print("\n".join(found))


@dataclass(frozen=True)
class Outfits:
    """Make random outfits on bodies as training data: a JSON and OBJ files for each."""

    count: int
    """Number of outfits; run it again to continue."""
    out: Path
    """Folder for o0001.json, its pieces o0001_tshirt.obj, ..., and bodies/."""
    body: Annotated[tuple[str, ...], arg(metavar="NPZ|builtin ...", help_behavior_hint="")] = ()
    """Bodies made by `uvcloth body`, or `builtin` for the one in the package: one, or at least three, so that
    no body is in two splits. Without this option, bodies are drawn from phenotypes."""
    bodies: Annotated[int, arg(metavar="K")] = 12
    """Number of bodies to draw."""
    seed: int = 0
    """Random seed: the same seed gives the same outfits."""
    vertices: Annotated[tuple[int, int], arg(metavar="LEAST MOST")] = (1000, 2500)
    """Range of the number of vertices of an outfit, within 1000 to 16000."""
    type: Annotated[tuple[str, ...], arg(metavar="NAME ...", help_behavior_hint="(default: all)")] = ()
    """Types of outfits: tshirt, top, longsleeve, jacket, trousers, shorts, skirt, gown, jumpsuit, or an upper
    piece over a lower one, such as tshirt+skirt."""
    jobs: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: one per core)")] = None
    """Number of processes."""
    picture: Annotated[Path | None, arg(metavar="PNG", help_behavior_hint="")] = None
    """Also draw a contact sheet of the first 48 outfits."""

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        from uvcloth.commands.outfit_sheet import draw_sheet
        from uvcloth.commands.outfits import OutfitSettings, make_outfits
        from uvcloth.wardrobe.outfit_file import outfit_files

        if self.picture is not None and self.picture.suffix.lower() != ".png":
            raise InputError(f"--picture {self.picture}: a picture is written as .png")
        make_outfits(
            OutfitSettings(
                out=self.out,
                count=self.count,
                seed=self.seed,
                bodies=self.body,
                drawn_bodies=self.bodies,
                types=self.type,
                vertices=self.vertices,
                jobs=self.jobs,
            )
        )
        if self.picture is not None:
            draw_sheet(outfit_files(self.out), self.picture)


@dataclass(frozen=True)
class Rollout:
    """Move garments over a motion, and write files for engines, DCCs and players."""

    motion: str
    """A motion file (BVH, glTF, AMASS) or the name of a built-in clip."""
    garment: Garments
    """Templates (tops, bottoms, dress, shirt, skirt, jacket) or garment files, the innermost first."""
    out: Annotated[tuple[Path, ...], arg(metavar="FILE ...", help_behavior_hint="")] = ()
    """One or more files; the suffix chooses the format: .glb, .usdc, .abc, .pc2, .obj, .npz for other
    programs, .mp4 or .gif for a video, .png for a contact sheet."""
    model: Annotated[
        tuple[str, ...],
        arg(metavar="NAME|RUN ...", help_behavior_hint="(default: physics)"),
    ] = ()
    """Method: physics, the cloth solver on coarse cages of the garments (any garment, nothing learned); a
    shipped model, physxnet (any garment), deepsd (any garment), motion_guided (the dress) or pbns (bottoms
    tops); lbs or lbs_smooth; or a folder written by `python -m train`. One for all garments, or one for each
    in order."""
    finish: Annotated[
        Literal["contact", "dynamic", "static"], arg(help_behavior_hint="(default: contact)")
    ] = "contact"
    """Last step after a model: contact moves its garments off the body; dynamic lets the cloth solver move
    them, pulled to what the model predicts; static lets them come to rest in each pose."""
    quality: Annotated[Literal["fast", "default", "fine"], arg(help_behavior_hint="(default: default)")] = (
        "default"
    )
    """Size of the faces that the cloth solver moves: edges of about 57, 40 or 30 mm."""
    template: Annotated[
        tuple[Literal["tops", "bottoms", "dress", "shirt", "skirt", "jacket", "auto"], ...],
        arg(metavar="NAME|auto ...", help_behavior_hint="(default: the one each covers best)"),
    ] = ()
    """Template that a PhysXNet predicts a garment as: one for all, or one for each in order."""
    garment_pose: GarmentPose = None
    """Pose of the body on which garment files were modelled: arms straight and level (t), or 45 degrees down
    (a)."""
    fabric: Fabric = None
    """Fabric of the garments, for the cloth solver and DeePSD models (default: jersey)."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    contact: bool = True
    """Move vertices out of the body and restore edge lengths. Without it, deepsd includes its branch of
    physics, as in an export."""
    preview: bool = False
    """Quick look: every third frame, in small pictures; fastest with a single .png."""
    keep_going: bool = False
    """Continue where a garment tears: that frame shows it as linear blend skinning moves it."""
    view: bool = False
    """Show the frames in the browser while they are computed, until Ctrl-C."""
    port: Port = 8080
    """Port of the live view, 1 to 65535."""
    host: Host = "127.0.0.1"
    """Address that the live view listens on; 0.0.0.0 admits other machines that have the token."""
    hide_skin: bool = False
    """Leave out body faces that garments cover closely in every frame, and those that MakeHuman clothes hide
    (delete_verts)."""
    device: Annotated[str, arg(metavar="cpu|cuda")] = "cpu"
    """Device of the computation."""
    threads: Annotated[int, arg(metavar="N")] = 1
    """Number of CPU threads; on a loaded machine several are slower than one."""
    options: OmitArgPrefixes[MotionOptions] = field(default_factory=MotionOptions)

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        if not self.garment or not (self.out or self.view):
            raise InputError("rollout: name at least one garment and one file to write, or --view")
        from uvcloth.commands.rollout import animate
        from uvcloth.commands.threads import limited_threads

        with limited_threads(self.threads), self._audience() as audience:
            summary = animate(
                self.model,
                self.motion,
                self.garment,
                self.out,
                templates=self.template,
                garment_pose=self.garment_pose,
                fabric=self.fabric,
                quality=self.quality,
                finish=self.finish,
                body_file=self.body,
                contact=self.contact,
                hide_skin=self.hide_skin,
                device=self.device,
                preview=self.preview,
                keep_going=self.keep_going,
                audience=audience,
                options=self.options,
            )
            print("\n".join(summary.lines()), flush=True)

    def _audience(self) -> "AbstractContextManager[LiveAudience | None]":
        """The live view, with --view."""
        if not self.view:
            return nullcontext()
        from uvcloth.commands.view import live_audience

        return live_audience(self.host, self.port)


@dataclass(frozen=True)
class View:
    """Choose and play rollouts in the browser, computed while they play."""

    motion: Positional[Annotated[tuple[str, ...], arg(metavar="CLIP ...", help_behavior_hint="")]] = ()
    """Motion files to choose from, in addition to the built-in clips."""
    garment: Garments = ("tops",)
    """Templates or garment files to start with, the innermost first."""
    model: Annotated[
        tuple[str, ...], arg(metavar="NAME|RUN ...", help_behavior_hint="(default: physics)")
    ] = ()
    """Models to choose from, in addition to those that ship; the first is shown first."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    data: Annotated[tuple[Path, ...], arg(metavar="SEQUENCE ...", help_behavior_hint="")] = ()
    """Sequences made by `uvcloth simulate`, shown next to the prediction, with its error as a heat map."""
    port: Port = 8080
    """Port of the page, 1 to 65535. The printed address ends with a token; requests without it are
    refused."""
    host: Host = "127.0.0.1"
    """Address to listen on; 0.0.0.0 admits other machines that have the token."""
    threads: Annotated[int, arg(metavar="N")] = 1
    """Number of CPU threads."""

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        from uvcloth.commands.threads import limited_threads
        from uvcloth.commands.view import view

        with limited_threads(self.threads):
            view(
                self.motion,
                self.garment,
                self.model,
                body_file=self.body,
                data=self.data,
                host=self.host,
                port=self.port,
            )


@dataclass(frozen=True)
class Poses:
    """Draw distinct poses without self-intersection of the body from motion capture."""

    out: Path
    """The npz to write."""
    clips: Positional[Annotated[tuple[str, ...], arg(metavar="CLIP|DIR ...", help_behavior_hint="")]] = ()
    """Motion files (BVH, AMASS), folders of them, or names of built-in clips; by default, and without
    --windows, the built-in ones. An index.csv in a folder gives the splits."""
    windows: Annotated[Path | None, arg(metavar="CSV", help_behavior_hint="")] = None
    """Such an index under any name: poses are drawn from its clips."""
    clips_from: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None
    """Folder of those clips."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    apart: float = 0.5
    """Least distance of two poses: at least one joint differs by so many radians."""
    every: int = 1
    """Use one frame of N."""
    mirror: bool = True
    """Also draw training poses mirrored left to right."""
    recombine: int = 2000
    """Additional training poses that combine legs, trunk and arms of several drawn poses."""
    seed: int = 0
    """Random seed."""

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        from uvcloth.bodies.body import load_body
        from uvcloth.motion.clip_splits import find_sources
        from uvcloth.motion.draw_poses import draw_poses
        from uvcloth.motion.poses import SPLITS, save_poses
        from uvcloth.motion.recombine import recombine
        from uvcloth.physics.self_contact import SelfContact

        if self.recombine < 0:
            raise InputError(f"--recombine {self.recombine}: expected a number of poses, 0 or more")
        sources = find_sources(self.clips, self.windows, self.clips_from)
        make_folder(self.out.parent)
        body = load_body(self.body)
        clear = SelfContact(body).clear
        poses = draw_poses(sources, body, clear, self.apart, self.mirror, self.seed, self.every)
        poses = recombine(poses, body, clear, self.recombine, self.seed)
        save_poses(poses, self.out)
        print(f"{self.out}: {', '.join(f'{len(poses.of(split))} {split}' for split in SPLITS)} poses")


@dataclass(frozen=True)
class Export:
    """Write a rig (PBNS, DeePSD) for engines: skeleton, skin, blend shapes and motion."""

    model: Annotated[str, arg(metavar="pbns|RUN")]
    """A shipped model, pbns (a shirt over trousers) or deepsd, or a folder written by `python -m train`."""
    out: Path
    """File to write: .glb, .usdc or .usd."""
    garment: Garments = ()
    """For DeePSD: templates or garment files, the innermost first. PBNS contains its garments."""
    garment_pose: GarmentPose = None
    """Pose of the body on which garment files were modelled: arms straight and level (t), or 45 degrees down
    (a)."""
    fabric: Fabric = None
    """Fabric of the garments, for DeePSD models (default: jersey)."""
    motion: Annotated[str | None, arg(metavar="FILE|NAME", help_behavior_hint="(default: the rig alone)")] = (
        None
    )
    """A motion file or the name of a built-in clip. Without it, the pose embedding is also written, as .onnx,
    for engines that compute the blend shape weights."""
    shapes: Annotated[int | None, arg(metavar="K", help_behavior_hint="(default: all)")] = None
    """Number of blend shapes to keep: principal components of the deformations in the training poses."""
    body: BodyFile = None
    """The body that the model was trained on."""
    with_body: bool = True
    """Write the body too."""
    options: OmitArgPrefixes[MotionOptions] = field(default_factory=MotionOptions)

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        from uvcloth.commands.export_rig import export

        exported = export(
            self.model,
            self.out,
            garments=self.garment,
            garment_pose=self.garment_pose,
            fabric=self.fabric,
            motion=self.motion,
            shapes=self.shapes,
            body_file=self.body,
            with_body=self.with_body,
            options=self.options,
        )
        print("\n".join(exported.lines()))


@dataclass(frozen=True)
class Demo:
    """Simulate a short motion, roll the shipped models out on it, and write pictures and files."""

    out: Path = Path("demo")
    """Folder for all results."""

    def run(self) -> None:
        """Run the command. Raises InputError for bad input."""
        from uvcloth.commands.demo import run

        run(self.out)


Command = (
    Annotated[View, subcommand("view")]
    | Annotated[Motion, subcommand("motion")]
    | Annotated[Fit, subcommand("fit")]
    | Annotated[Rollout, subcommand("rollout")]
    | Annotated[MakeBody, subcommand("body")]
    | Annotated[Simulate, subcommand("simulate")]
    | Annotated[Data, subcommand("data")]
    | Annotated[Maps, subcommand("maps")]
    | Annotated[Poses, subcommand("poses")]
    | Annotated[Outfits, subcommand("outfits")]
    | Annotated[Export, subcommand("export")]
    | Annotated[Demo, subcommand("demo")]
)


def main() -> int:
    """Run `uvcloth` and return the exit code (0, 2 for bad input, 130 after Ctrl-C)."""
    return run_command("uvcloth", _run)


def _run() -> None:
    if sys.argv[1:] == ["--version"]:
        print(f"uvcloth {package_version()}")
        return
    command: (
        MakeBody | Motion | Simulate | Data | Maps | Fit | Rollout | View | Poses | Outfits | Export | Demo
    ) = tyro.cli(Command, prog="uvcloth", description=DESCRIPTION)
    with printed_log():
        command.run()
