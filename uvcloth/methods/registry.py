"""The methods that ship, by name, and how a name or a folder becomes one.

The table imports no method, so that help texts can name them; an entry is imported when it is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from uvcloth.errors import InputError

if TYPE_CHECKING:
    from uvcloth.bodies.body import Body
    from uvcloth.methods.method import Method, MethodEntry


@dataclass(frozen=True)
class Registered:
    """A method in the registry.

    about: what it is, or which garments it is for, in a few words for help texts. source: its entry, or where
    that is, "module:NAME". rig: some of its models are rigs, see `Riggable`.
    """

    about: str
    source: "str | MethodEntry"
    rig: bool = False

    @property
    def entry(self) -> "MethodEntry":
        """Settings of the method, and how it is created and loaded."""
        if not isinstance(self.source, str):
            return self.source
        module, _, name = self.source.partition(":")
        entry: MethodEntry = getattr(import_module(module), name)
        return entry


METHODS: dict[str, Registered] = {
    "physics": Registered(
        "the cloth solver on coarse cages of any garments, untrained", "uvcloth.methods.physics.method:ENTRY"
    ),
    "physxnet": Registered("any garment", "uvcloth.methods.physxnet.method:ENTRY"),
    "motion_guided": Registered("the dress", "uvcloth.methods.motion_guided.method:ENTRY"),
    "recurrent": Registered(
        "tops, shirt, bottoms, dress", "uvcloth.methods.recurrent.method:ENTRY", rig=True
    ),
    "pbns": Registered("bottoms under tops", "uvcloth.methods.pbns.method:ENTRY", rig=True),
    "deepsd": Registered("any garments", "uvcloth.methods.deepsd.method:ENTRY", rig=True),
    "lbs": Registered("linear blend skinning", "uvcloth.methods.lbs:LBS"),
    "lbs_smooth": Registered("the same with smooth blend weights", "uvcloth.methods.lbs:LBS_SMOOTH"),
}
"""Every method by name."""

SHIPPED = Path(str(files("uvcloth"))) / "data" / "models"
"""Folder of the trained models in the package, each named as its method."""

DEFAULT = "physics"
"""The method of a rollout that names none: it dresses any garment that has a hem to hang by."""


def list_methods() -> str:
    """All methods in words, for help texts."""
    return ", ".join(f"{name} ({method.about})" for name, method in METHODS.items())


def list_rigs() -> str:
    """The shipped models that are rigs, in words, for help texts."""
    rigs = ((name, method) for name, method in METHODS.items() if method.rig and (SHIPPED / name).is_dir())
    return " or ".join(f"{name} ({method.about})" for name, method in rigs)


def load_methods(models: Sequence[str | Path], body: "Body") -> "Method":
    """One method for all garments, or several, one for each in order. Raises InputError as load_method."""
    from uvcloth.methods.ensemble import in_order

    return in_order([load_method(model, body) for model in models])


def model_folder(name_or_run: str | Path) -> Path | None:
    """The folder of a trained model, in the package if named as its method; None if untrained."""
    registered = METHODS.get(str(name_or_run))
    if registered is None:
        return Path(name_or_run)
    return SHIPPED / str(name_or_run) if registered.entry.load else None


def load_method(name_or_run: str | Path, body: "Body") -> "Method":
    """Load a method by name (a baseline or a shipped model), or a trained one from its run folder.

    A trained method is named after its folder, so that several can stand in one report. A shipped one scales
    a body that is not an adult's to an adult's size. Raises InputError for an unknown name, and for a
    checkpoint that is damaged, of another method or version, or of another body.
    """
    from uvcloth.checkpoint import CONFIG, load_checkpoint
    from uvcloth.methods.resized import for_size

    name, folder = str(name_or_run), model_folder(name_or_run)
    if folder is None:
        entry = METHODS[name].entry
        return entry.create(entry.config)
    if not (folder / CONFIG).exists() and name in METHODS:
        raise InputError(
            f"{name}: no trained model ships; train it (uvcloth train {name}) and name its run folder"
        )
    if not (folder / CONFIG).exists():
        close = get_close_matches(name, METHODS, n=1)
        hint = f", did you mean {close[0]!r}" if close else ""
        raise InputError(f"{name}: neither a run folder with {CONFIG} nor one of {', '.join(METHODS)}{hint}")
    checkpoint = load_checkpoint(folder, body)
    registered = METHODS.get(checkpoint.method)
    load = registered and registered.entry.load
    if not load:
        expected = ", ".join(known for known, method in METHODS.items() if method.entry.load)
        raise InputError(
            f"{folder / CONFIG}: a model of method {checkpoint.method!r:.60}, expected one of {expected}"
        )
    # Every method is a frozen dataclass with a name, which the protocol cannot say.
    method: Method = replace(load(checkpoint, folder), name=folder.resolve().name)  # type: ignore[type-var]
    return for_size(method, body) if folder.parent == SHIPPED else method
