"""The methods in a comparison, with the records of their checkpoints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import CONFIG, WEIGHTS, load_checkpoint
from uvcloth.errors import InputError
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.finish_names import FinishName
from uvcloth.methods.method import Method, Traits
from uvcloth.methods.physics.finish import Finish, with_finish
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.methods.registry import load_method, model_folder

SIMULATION = "simulation"
"""The name under which the simulation itself is scored, the reference of the physical measures."""

IN_ORDER = "+"
"""Separator of models that form one candidate, one for each garment, the innermost first."""

FINISHED = "@"
"""Sign before the finish of a model, or of several in order, and before the quality of its cages."""

FINISHES: tuple[FinishName, ...] = ("dynamic", "static", "clear")
"""The finishes that a name can ask for; clear is the usual one."""

TRAINING = ("step", "epochs", "minutes", "samples")
"""The notes of a checkpoint on the length of its training."""


@dataclass(frozen=True)
class Candidate:
    """A method in the comparison.

    name: in every table. weights_mb: size of its weights file, 0 without one. fingerprint: hash of what
    decides its predictions besides the code. training_content: hashes of the content of its training and
    validation sequences. training_frames: number of frames in its training sequences; training: length of its
    training (steps, epochs, minutes, samples); both where its checkpoint gives them. clips: the clips of both
    and their subjects, see `TrainingData`.
    """

    name: str
    method: Method
    weights_mb: float
    fingerprint: str
    training_content: frozenset[str]
    training_frames: int | None = None
    clips: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    training: Mapping[str, float] = field(default_factory=dict)

    @property
    def traits(self) -> Traits:
        """Those of the method."""
        return self.method.traits


def load_candidates(models: Sequence[str], body: Body) -> tuple[Candidate, ...]:
    """Load methods by name, trained models by folder, and several in order with "+" between them.

    With "@dynamic" or "@static" at the end, the cloth solver finishes the garments, and a quality of its
    cages may follow ("@dynamic@fine", "physics@fast"). Raises InputError for an unknown name, for a name that
    occurs twice, and for the name SIMULATION.
    """
    candidates = tuple(_load(model, body) for model in models)
    names = [candidate.name for candidate in candidates]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--model: two models are called {name!r}, rename one of the folders")
        if name == SIMULATION:
            raise InputError(f"--model: a model cannot be called {SIMULATION!r}, rename the folder")
    return candidates


def assigned(
    candidates: Sequence[Candidate], outfits: Mapping[str, Outfit], data: Path
) -> dict[str, tuple[Candidate, ...]]:
    """The candidates that support each outfit. Raises InputError naming one that supports none, and why."""
    unsupported = {
        c.name: {name: c.method.unsupported_reason(outfit) for name, outfit in outfits.items()}
        for c in candidates
    }
    for name, reasons in unsupported.items():
        if all(reasons.values()):
            why = "; ".join(dict.fromkeys(reasons.values()))
            raise InputError(f"{data}: nothing to evaluate {name} on: {why}")
    return {name: tuple(c for c in candidates if not unsupported[c.name][name]) for name in outfits}


def _load(model: str, body: Body) -> Candidate:
    """One model, or several in order, and their finish; a folder may have the signs in its name."""
    if (Path(model) / CONFIG).exists():
        return _load_one(model, body)
    unfinished, sign, finish = model.rpartition(FINISHED)
    if sign:
        return _finished(_load(unfinished, body), finish)
    if IN_ORDER not in model:
        return _load_one(model, body)
    return _in_order([_load_one(part, body) for part in model.split(IN_ORDER)])


def _load_one(model: str, body: Body) -> Candidate:
    """A method by its name, or a trained one with the record of its checkpoint."""
    folder, method = model_folder(model), load_method(model, body)
    if folder is None:
        return Candidate(method.name, method, 0.0, fingerprint(model), frozenset())
    checkpoint = load_checkpoint(folder)
    return Candidate(
        name=method.name,
        method=method,
        weights_mb=(folder / WEIGHTS).stat().st_size / 1e6,
        fingerprint=fingerprint((folder / WEIGHTS).read_bytes(), (folder / CONFIG).read_bytes()),
        training_content=frozenset(checkpoint.data.files.values()),
        training_frames=checkpoint.notes.get("training_frames"),
        clips=checkpoint.data.clips,
        training={key: checkpoint.notes[key] for key in TRAINING if key in checkpoint.notes},
    )


def _finished(candidate: Candidate, suffix: str) -> Candidate:
    """The candidate with a finish, or with cages of a quality, under a name that says so."""
    return replace(
        candidate,
        name=f"{candidate.name}{FINISHED}{suffix}",
        method=finished(candidate.method, suffix, f"--model {candidate.name}{FINISHED}{suffix}"),
        fingerprint=fingerprint(candidate.fingerprint, suffix),
    )


def finished(method: Method, suffix: str, option: str) -> Method:
    """A method with the finish, or with cages of the quality, that a suffix of its name asks for.

    option: for messages. Raises InputError for another suffix, and for the quality of a method without cages.
    """
    finish = next((each for each in FINISHES if each == suffix), None)
    if finish:
        return with_finish(method, finish, Physics())
    if suffix not in QUALITIES:
        known = ", ".join(f"{FINISHED}{each}" for each in (*FINISHES, *QUALITIES))
        raise InputError(f"{option}: expected one of {known}")
    physics = Physics(PhysicsConfig(suffix))
    if isinstance(method, Finish):
        return replace(method, physics=physics)
    if isinstance(method, Physics):
        return physics
    raise InputError(f"{option}: only physics and the finishes dynamic and static have cages of a quality")


def _in_order(parts: Sequence[Candidate]) -> Candidate:
    """One candidate of several methods in order: it was trained on the data of all of them."""
    method = Ensemble.of(tuple(part.method for part in parts))
    splits = dict.fromkeys(split for part in parts for split in part.clips)
    return Candidate(
        name=method.name,
        method=method,
        weights_mb=sum(part.weights_mb for part in parts),
        fingerprint=fingerprint("/".join(part.fingerprint for part in parts)),
        training_content=frozenset().union(*(part.training_content for part in parts)),
        clips={s: {clip: who for p in parts for clip, who in p.clips.get(s, {}).items()} for s in splits},
    )
