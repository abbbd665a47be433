"""The methods that ship, by name, and how a name or a folder becomes one."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.checkpoint import CONFIG, Checkpoint, load_checkpoint
from uvcloth.methods import motion_guided, physxnet
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.lbs import LBSConfig
from uvcloth.methods.method import Method

CONFIGS: dict[str, Any] = {
    "lbs": LBSConfig(smooth=False),
    "lbs_smooth": LBSConfig(smooth=True),
    "physxnet": physxnet.PRESETS["default"],
    "motion_guided": motion_guided.PRESETS["fast"],
}
"""A frozen config per method; its `create()` builds the method, untrained where it learns."""

LOADERS: dict[str, Callable[[Checkpoint, Path], Any]] = {
    "physxnet": physxnet.load_physxnet,
    "motion_guided": motion_guided.load_motion_guided,
}
"""How a checkpoint becomes a method, for those that are trained."""


def load_methods(models: Sequence[str | Path], body: Body) -> Method:
    """One method for all garments, or several, one for each in order. Raises InputError as load_method."""
    methods = tuple(load_method(model, body) for model in models)
    return methods[0] if len(methods) == 1 else Ensemble(methods)


def load_method(name_or_run: str | Path, body: Body) -> Method:
    """A method that needs no training by its name, or a trained one from its run folder.

    A trained method is named after its folder, so that several can stand in one report. Raises InputError for
    an unknown name, and for a checkpoint that is damaged, of another method or version, or of another body.
    """
    folder = Path(name_or_run)
    name = str(name_or_run)
    if name in CONFIGS and name not in LOADERS:
        return CONFIGS[name].create()
    if not (folder / CONFIG).exists():
        untrained = [known for known in CONFIGS if known not in LOADERS]
        close = get_close_matches(name, untrained, n=1)
        hint = f", did you mean {close[0]!r}" if close else ""
        raise InputError(
            f"{name}: neither a run folder with {CONFIG} nor one of {', '.join(untrained)}{hint}"
        )
    checkpoint = load_checkpoint(folder, body)
    if checkpoint.method not in LOADERS:
        known = ", ".join(LOADERS)
        raise InputError(
            f"{folder / CONFIG}: a model of method {checkpoint.method!r}, expected one of {known}"
        )
    method = LOADERS[checkpoint.method](checkpoint, folder)
    return replace(method, name=folder.resolve().name)
