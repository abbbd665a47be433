"""Automatic choice of a model: the cloth solver where it can hold the garments up, otherwise a network.

No network as a guide of the solver has clearly less error than the solver alone (docs/models.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from uvcloth.errors import InputError
from uvcloth.garments.band import unheld_reason
from uvcloth.garments.garment import Outfit
from uvcloth.methods.registry import DEFAULT, load_method

AUTO = "auto"
"""Word for the model that suits an outfit, instead of a model's name."""

INSTEAD = ("physxnet", "lbs_smooth")
"""Models of any garment for those that the solver cannot hold up, the best first."""


@dataclass(frozen=True)
class ModelChoice:
    """Name of a model, and a line on what was taken and why."""

    model: str
    line: str


def choose_model(outfit: Outfit) -> ModelChoice:
    """Choose the model that moves all garments of an outfit."""
    fault = unheld_reason(outfit)
    if not fault:
        return ModelChoice(DEFAULT, f"model {DEFAULT}: every garment has a hem that holds it")
    for name in INSTEAD[:-1]:
        try:
            if not load_method(name, outfit.body).unsupported_reason(outfit):
                return ModelChoice(name, f"model {name}: not {DEFAULT}, {fault}")
        except InputError:
            # A shipped model may be of another skeleton than this body's.
            continue
    return ModelChoice(
        INSTEAD[-1], f"model {INSTEAD[-1]}: not {DEFAULT}, {fault}; no trained model has this body"
    )


def named_models(models: Sequence[str], outfit: Outfit) -> tuple[tuple[str, ...], str | None]:
    """The models that are asked for, AUTO replaced by the one that suits, and the line on that, if any.

    Raises InputError for AUTO beside others.
    """
    if AUTO not in models:
        return tuple(models), None
    if len(models) > 1:
        raise InputError(f"--model {AUTO}: is chosen for all garments together, name no model beside it")
    choice = choose_model(outfit)
    return (choice.model,), choice.line
