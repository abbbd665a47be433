"""Rolls methods out over the test windows and scores every frame; finished windows are kept for a rerun."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from evaluate.actions import Window
from evaluate.body_scores import body_scores, put_on
from evaluate.metrics import Reference, distance_scores, frame_scores
from evaluate.stability import stability_scores, uses_feedback
from rasterize.archive import load_arrays, save_arrays
from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.skinning import skin
from uvcloth.methods.method import Method
from uvcloth.rollout import RolloutFrame, rollout
from uvcloth.simulate.sequence import SimulatedSequence, content_hash, load_sequence

FORMAT = "uvcloth-judged-4"

SIMULATION = "simulation"
"""The name under which the simulation itself is scored: the yardstick of the physics."""

SHOWN = 50
"""Frames of a window that are kept to be looked at, at most."""

SAME_REST = 0.002
"""Metres between a sequence's rest mesh and the garment on the body that still count as the same garment."""

SAME_MOTION = 0.001
"""Metres (and matrix entries) between joint transforms that still count as the same motion."""

TRAINING = ("step", "epochs", "minutes", "samples")
"""What a checkpoint's notes say of how long it was trained."""

JUDGING = (
    "rasterize",
    "uvcloth",
    "evaluate/metrics.py",
    "evaluate/maps.py",
    "evaluate/body_scores.py",
    "evaluate/stability.py",
    "evaluate/judge.py",
)
"""The sources and data that decide a score."""


@dataclass(frozen=True)
class Candidate:
    """A method in the comparison.

    name: in every table. weights_mb: size of its weights file, 0 without one. fingerprint: hash of what
    decides its predictions besides the code. seen: content hashes of the sequences that it was trained
    on or chosen by. training_frames: how many frames the former have, and training: how long it learned
    from them (steps, epochs, minutes, samples), where its checkpoint says so. clips: the clips of both
    and who moves in them, see `TrainingData`.
    """

    name: str
    method: Method
    weights_mb: float
    fingerprint: str
    seen: frozenset[str]
    training_frames: int | None = None
    clips: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    training: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class CaseScores:
    """One method on one window.

    scores: per frame, F values each (jitter F - 2); with "network_ms" and "contact_ms" if it is a method, and
    with the scores of its stability if it is autoregressive.
    shown: (S, N, 3) every stride-th frame of the case after contact, metres, world.
    """

    scores: Mapping[str, Tensor]
    shown: Tensor


@dataclass(frozen=True)
class Case:
    """A window ready to be judged: its sequence, what it is measured against, and who wears it.

    start: number of warm-up frames. reference: the scored frames. transforms: (F, J, 3, 4) and
    body_vertices: (F, V, 3) of the body in those.
    """

    window: Window
    sequence: SimulatedSequence
    outfit: Outfit
    reference: Reference
    start: int
    transforms: Tensor
    body_vertices: Tensor

    @property
    def stride(self) -> int:
        return -(-len(self.reference.vertices) // SHOWN)


def open_case(
    window: Window, body: Body, garment: Garment, texels: tuple[Tensor, Tensor] | None, frames: int | None
) -> Case:
    """Load a window and check that it was simulated with this garment on this body.

    texels: corners and barycentrics (P, 3) of the garment's map, None without one. frames: judge at most so
    many, None for all. Raises InputError naming the file if the mesh, the rest shape or the skeleton differs,
    or no frame counts.
    """
    sequence = load_sequence(window.path)
    mesh, joints = garment.mesh, len(body.skeleton.names)
    if not torch.equal(sequence.faces, mesh.faces):
        raise InputError(f"{window.path}: its mesh is not that of the garment {garment.name}")
    if sequence.transforms.shape[1] != joints:
        raise InputError(
            f"{window.path}: simulated on a body of {sequence.transforms.shape[1]} joints, "
            f"body {body.name!r} has {joints}"
        )
    apart = float((sequence.rest - mesh.vertices).norm(dim=1).max())
    if apart > SAME_REST:
        raise InputError(
            f"{window.path}: at rest it is up to {1000 * apart:.0f} mm from the garment {garment.name} "
            f"on body {body.name!r}; it was simulated in another shape or on another body"
        )
    end = len(sequence.vertices) if frames is None else sequence.warm_up + frames
    truth = sequence.vertices[sequence.warm_up : end]
    if not len(truth):
        raise InputError(f"{window.path}: has no frame after its {sequence.warm_up} warm-up frames")
    reference = Reference(truth, sequence.rest, sequence.faces, sequence.fps, *(texels or (None, None)))
    transforms = sequence.transforms[sequence.warm_up : end]
    posed = skin(body.mesh.vertices, body.weights, transforms)
    return Case(window, sequence, Outfit(body, (garment,)), reference, sequence.warm_up, transforms, posed)


def judge(case: Case, candidate: Candidate) -> CaseScores:
    """Roll a method out from the first warm-up frame and score the scored frames.

    Before contact, one that goes on from what contact left is rolled out again without it: otherwise its
    predictions owe something to contact. It is also rolled out from the truth. Raises InputError if a
    prediction is not a finite number.
    """
    method, end = candidate.method, case.start + len(case.reference.vertices)
    predicted, resolved, milliseconds = [], [], []
    for frame in _rolled(case, method, contact=True):
        predicted.append(frame.raw[0])
        resolved.append(frame.vertices[0])
        milliseconds.append([frame.milliseconds["network"], frame.milliseconds["contact"]])
    stable: dict[str, Tensor] = {}
    if uses_feedback(method, case.outfit, case.sequence):
        predicted = [frame.raw[0] for frame in _rolled(case, method, contact=False)]
        stable = stability_scores(method, case.outfit, case.sequence, end)
    scored = score(case, torch.stack(predicted).cpu(), torch.stack(resolved).cpu())
    times = torch.tensor(milliseconds)
    scores = {**scored.scores, **stable, "network_ms": times[:, 0], "contact_ms": times[:, 1]}
    return CaseScores(scores, scored.shown)


def _rolled(case: Case, method: Method, contact: bool) -> Iterator[RolloutFrame]:
    """The frames of a rollout that count."""
    transforms = case.sequence.transforms[: case.start + len(case.reference.vertices)]
    return islice(rollout(method, case.outfit, transforms, case.sequence.fps, contact), case.start, None)


def judge_simulation(case: Case) -> CaseScores:
    """The simulation scored as if it were a prediction: no error, but its own edges, bends and jitter."""
    return score(case, case.reference.vertices, case.reference.vertices)


def score(case: Case, raw: Tensor, resolved: Tensor) -> CaseScores:
    """Score predictions before (F, N, 3) and after contact (F, N, 3) on the scored frames."""
    scores = frame_scores(raw, resolved, case.reference)
    worn = put_on(case.outfit)
    for suffix, frames in (("_raw", raw), ("", resolved)):
        found = body_scores(worn, frames, case.body_vertices)
        scores |= {f"{key}{suffix}": values for key, values in found.items()}
    return CaseScores(scores, resolved[:: case.stride])


def repeatability(case: Case) -> dict[str, Tensor]:
    """How far the simulation is from its repeat, per frame that counts in both; empty without a repeat.

    Frames are matched by the body's pose. A clip that has nothing before its window cannot start earlier: its
    repeat is the same simulation and tells nothing, so it counts as none. Raises InputError if the repeat is
    not the same motion or mesh.
    """
    if case.window.repeat is None:
        return {}
    repeat = load_sequence(case.window.repeat)
    ours = case.sequence
    if repeat.vertices.shape[1:] != ours.vertices.shape[1:]:
        raise InputError(f"{case.window.repeat}: not the mesh of {case.window.path}")
    gaps = (repeat.transforms - ours.transforms[-1]).abs().amax(dim=(1, 2, 3))
    shift = int(gaps.argmin()) - (len(ours.vertices) - 1)
    if shift == 0 and len(repeat.vertices) == len(ours.vertices):
        return {}
    first = max(ours.warm_up, repeat.warm_up - shift)
    frames = torch.arange(first, len(ours.vertices))
    if not len(frames) or (
        (ours.transforms[frames] - repeat.transforms[frames + shift]).abs().max() > SAME_MOTION
    ):
        raise InputError(f"{case.window.repeat}: does not repeat the motion of {case.window.path}")
    return distance_scores(repeat.vertices[frames + shift], ours.vertices[frames])


def cached(out: Path, case: Case, name: str, setting: str, work: Callable[[], CaseScores]) -> CaseScores:
    """The result of an earlier run of the same code on the same input, or that of `work`, then kept."""
    hashes = (setting, garment_fingerprint(case.outfit.garments[0]), content_hash(case.sequence))
    key = fingerprint("/".join([FORMAT, *hashes, str(len(case.reference.vertices))]))[:16]
    path = Path(out) / "partial" / f"{case.window.name}_{name}_{key}.npz"
    truth = case.reference.vertices[:: case.stride]
    if path.is_file():
        data = load_arrays(path, FORMAT, "a judged window")
        scores = {k.removeprefix("score_"): torch.from_numpy(v) for k, v in data.items() if k[:6] == "score_"}
        return CaseScores(scores, truth + torch.from_numpy(data["offset"].astype(np.float32)))
    judged = work()
    # Offsets from the simulation are small, so half precision keeps them well within a millimetre.
    arrays = {"format": np.array(FORMAT), "offset": (judged.shown - truth).numpy().astype(np.float16)}
    arrays.update({f"score_{key}": values.numpy() for key, values in judged.scores.items()})
    save_arrays(path, arrays)
    return judged


def code_fingerprint() -> str:
    """Hash of the sources and data that decide a score: results of others are not taken over."""
    root = Path(__file__).resolve().parent.parent
    contents: list[str | bytes] = []
    for name in JUDGING:
        place = root / name
        inside = [*place.rglob("*.py"), *place.rglob("*.npz")]
        for path in sorted(inside) if place.is_dir() else [place]:
            contents += [str(path.relative_to(root)), path.read_bytes()]
    return fingerprint(*contents)


def body_fingerprint(body: Body) -> str:
    """Hash of the body that the garments are worn on."""
    tensors = [body.mesh.vertices, body.mesh.faces, body.weights, body.skeleton.heads]
    tensors += [body.regions, body.sides]
    for proxy in body.proxies.values():
        tensors += [proxy.vertices, proxy.faces, proxy.weights]
    return fingerprint("/".join(body.skeleton.names), *tensors)


def garment_fingerprint(garment: Garment) -> str:
    """Hash of what a method sees of a garment, which a file may change without the sequence."""
    mesh = garment.mesh
    tensors = (mesh.vertices, mesh.faces, mesh.uvs, mesh.face_uvs, garment.weights, garment.smooth_weights)
    return fingerprint(f"{garment.source}/{garment.template}", *tensors)


def load_candidates(models: Sequence[str], body: Body) -> tuple[Candidate, ...]:
    """Load what ships by name and trained models by folder. Raises InputError for unknown or equal names."""
    from uvcloth.checkpoint import CONFIG, WEIGHTS, load_checkpoint
    from uvcloth.methods.registry import load_method, model_folder

    candidates = []
    for model in models:
        folder = model_folder(model)
        method = load_method(model, body)
        contents = fingerprint(model)
        seen: frozenset[str] = frozenset()
        training_frames = None
        clips: Mapping[str, Mapping[str, str]] = {}
        training: dict[str, float] = {}
        if folder:
            checkpoint = load_checkpoint(folder)
            contents = fingerprint((folder / WEIGHTS).read_bytes(), (folder / CONFIG).read_bytes())
            seen = frozenset(checkpoint.data.files.values())
            clips = checkpoint.data.clips
            training_frames = checkpoint.notes.get("training_frames")
            training = {key: checkpoint.notes[key] for key in TRAINING if key in checkpoint.notes}
        candidates.append(
            Candidate(
                name=method.name,
                method=method,
                weights_mb=(folder / WEIGHTS).stat().st_size / 1e6 if folder else 0.0,
                fingerprint=contents,
                seen=seen,
                training_frames=training_frames,
                clips=clips,
                training=training,
            )
        )
    names = [candidate.name for candidate in candidates]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--model: two models are called {name!r}, rename one of the folders")
        if name == SIMULATION:
            raise InputError(f"--model: no model can be called {SIMULATION!r}, rename the folder")
    return tuple(candidates)
