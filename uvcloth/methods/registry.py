"""The methods that ship, by name, and how a name or a folder becomes one."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.checkpoint import CONFIG, Checkpoint, load_checkpoint
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.lbs import LBSConfig
from uvcloth.methods.method import Method
from uvcloth.methods.motion_guided import method as motion_guided
from uvcloth.methods.pbns import method as pbns
from uvcloth.methods.physxnet import method as physxnet

CONFIGS: dict[str, Any] = {
    "lbs": LBSConfig(smooth=False),
    "lbs_smooth": LBSConfig(smooth=True),
    "physxnet": physxnet.PRESETS["default"],
    "motion_guided": motion_guided.PRESETS["fast"],
    "pbns": pbns.PBNSConfig(),
}
"""A frozen config per method; its `create()` builds the method, untrained where it learns."""

LOADERS: dict[str, Callable[[Checkpoint, Path], Any]] = {
    "physxnet": physxnet.load_physxnet,
    "motion_guided": motion_guided.load_motion_guided,
    "pbns": pbns.load_pbns,
}
"""How a checkpoint becomes a method, for those that are trained."""

SHIPPED = Path(str(files("uvcloth"))) / "data" / "models"
"""Folder of the trained models in the package, each named as its method."""

DEFAULT = "physxnet"
"""The method of a rollout that names none: it dresses any garment."""


def load_methods(models: Sequence[str | Path], body: Body) -> Method:
    """One method for all garments, or several, one for each in order. Raises InputError as load_method."""
    methods = tuple(load_method(model, body) for model in models)
    return methods[0] if len(methods) == 1 else Ensemble(methods)


def model_folder(name_or_run: str | Path) -> Path | None:
    """Where a trained model lies: in the package if it is named as its method; None for what is untrained."""
    name = str(name_or_run)
    if name in LOADERS:
        return SHIPPED / name
    return None if name in CONFIGS else Path(name)


def load_method(name_or_run: str | Path, body: Body) -> Method:
    """A method that needs no training or ships trained by its name, or a trained one from its run folder.

    A trained method is named after its folder, so that several can stand in one report. Raises InputError for
    an unknown name, and for a checkpoint that is damaged, of another method or version, or of another body.
    """
    name, folder = str(name_or_run), model_folder(name_or_run)
    if folder is None:
        return CONFIGS[name].create()
    if not (folder / CONFIG).exists() and name in LOADERS:
        raise InputError(
            f"{name}: no trained one ships; train it (python -m train {name}) and name its run folder"
        )
    if not (folder / CONFIG).exists():
        close = get_close_matches(name, CONFIGS, n=1)
        hint = f", did you mean {close[0]!r}" if close else ""
        raise InputError(f"{name}: neither a run folder with {CONFIG} nor one of {', '.join(CONFIGS)}{hint}")
    checkpoint = load_checkpoint(folder, body)
    if checkpoint.method not in LOADERS:
        known = ", ".join(LOADERS)
        raise InputError(
            f"{folder / CONFIG}: a model of method {checkpoint.method!r}, expected one of {known}"
        )
    method = LOADERS[checkpoint.method](checkpoint, folder)
    return replace(method, name=folder.resolve().name)
