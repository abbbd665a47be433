"""The methods that ship, by name, and how a name or a folder becomes one."""

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import CONFIG, load_checkpoint
from uvcloth.errors import InputError
from uvcloth.methods import lbs
from uvcloth.methods.deepsd import method as deepsd
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.method import Method, MethodEntry
from uvcloth.methods.motion_guided import method as motion_guided
from uvcloth.methods.pbns import method as pbns
from uvcloth.methods.physics import method as physics
from uvcloth.methods.physxnet import method as physxnet
from uvcloth.methods.resized import for_size

METHODS: dict[str, MethodEntry] = {
    **lbs.ENTRIES,
    "physics": physics.ENTRY,
    "physxnet": physxnet.ENTRY,
    "motion_guided": motion_guided.ENTRY,
    "pbns": pbns.ENTRY,
    "deepsd": deepsd.ENTRY,
}
"""Every method by name: settings, presets, and how it is created and loaded."""

SHIPPED = Path(str(files("uvcloth"))) / "data" / "models"
"""Folder of the trained models in the package, each named as its method."""

DEFAULT = "physics"
"""The method of a rollout that names none: it dresses any garment that has a hem to hang by."""


def load_methods(models: Sequence[str | Path], body: Body) -> Method:
    """One method for all garments, or several, one for each in order. Raises InputError as load_method."""
    methods = tuple(load_method(model, body) for model in models)
    return methods[0] if len(methods) == 1 else Ensemble.of(methods)


def model_folder(name_or_run: str | Path) -> Path | None:
    """The folder of a trained model, in the package if named as its method; None if untrained."""
    entry = METHODS.get(str(name_or_run))
    if entry is None:
        return Path(name_or_run)
    return SHIPPED / str(name_or_run) if entry.load else None


def load_method(name_or_run: str | Path, body: Body) -> Method:
    """Load a method by name (a baseline or a shipped model), or a trained one from its run folder.

    A trained method is named after its folder, so that several can stand in one report. A shipped one scales
    a body that is not an adult's to an adult's size. Raises InputError for an unknown name, and for a
    checkpoint that is damaged, of another method or version, or of another body.
    """
    name, folder = str(name_or_run), model_folder(name_or_run)
    if folder is None:
        return METHODS[name].create(METHODS[name].config)
    if not (folder / CONFIG).exists() and name in METHODS:
        raise InputError(
            f"{name}: no trained model ships; train it (python -m train {name}) and name its run folder"
        )
    if not (folder / CONFIG).exists():
        close = get_close_matches(name, METHODS, n=1)
        hint = f", did you mean {close[0]!r}" if close else ""
        raise InputError(f"{name}: neither a run folder with {CONFIG} nor one of {', '.join(METHODS)}{hint}")
    checkpoint = load_checkpoint(folder, body)
    loaders = {known: entry.load for known, entry in METHODS.items() if entry.load}
    if checkpoint.method not in loaders:
        expected = ", ".join(loaders)
        raise InputError(
            f"{folder / CONFIG}: a model of method {checkpoint.method!r:.60}, expected one of {expected}"
        )
    # Every method is a frozen dataclass with a name, which the protocol cannot say.
    method: Method = replace(loaders[checkpoint.method](checkpoint, folder), name=folder.resolve().name)  # type: ignore[type-var]
    return for_size(method, body) if folder.parent == SHIPPED else method
