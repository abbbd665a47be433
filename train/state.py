"""The training state of a run: networks, optimizers and progress, for an exact resume."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import NoneType
from typing import Any

import torch
from torch import Tensor, nn

from uvcloth.checkpoint import load_tensors, require_like, save_tensors
from uvcloth.errors import InputError
from uvcloth.files.json_file import require_kinds
from uvcloth.files.settings import is_a

STATE = Path("training") / "state.safetensors"
"""The training state of a run, for an exact resume."""

CONTENTS = ("data", "body", "garments")
"""Parts of the settings that hold hashes."""

KINDS = {
    "done": {
        "step": int,
        "epochs": float,
        "seconds": float,
        "best": (float, NoneType),
        "errors": [dict],
    },
    "settings": dict,
}
"""Kinds of the JSON values in a state."""


@dataclass
class Progressed:
    """The progress of a run: optimizer steps, epochs and seconds of training, and the scores so far."""

    step: int = 0
    epochs: float = 0.0
    seconds: float = 0.0
    best: float = math.inf
    errors: list[dict[str, float]] = field(default_factory=list)


@dataclass(frozen=True)
class TrainingState:
    """All of a run that its steps change.

    networks, optimizers: AdamW's, by the same names. average: the running mean of the weights, None where
    there is none. memory: the objective's own. settings: JSON values that must not change within a run.
    """

    networks: Mapping[str, nn.Module]
    optimizers: Mapping[str, Any]
    average: nn.Module | None
    memory: Mapping[str, Tensor]
    done: Progressed
    settings: Mapping[str, Any]

    def tensors(self) -> dict[str, Tensor]:
        """Tensors of the networks, their mean and the memory, by their names in the file."""
        tensors = {f"memory/{key}": value for key, value in self.memory.items()}
        for name, network in self.networks.items():
            tensors |= {f"network/{name}/{key}": value for key, value in network.state_dict().items()}
        if self.average is not None:
            tensors |= {f"average/{key}": value for key, value in self.average.state_dict().items()}
        return tensors


def save_state(state: TrainingState, run: Path) -> None:
    """Write the state into the run's folder, whole or not at all."""
    tensors = state.tensors()
    for name, optimizer in state.optimizers.items():
        for index, entries in optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer/{name}/{index}/{key}": value for key, value in entries.items()}
    done = asdict(state.done)
    done["best"] = None if math.isinf(state.done.best) else state.done.best
    save_tensors(tensors, {"done": done, "settings": state.settings}, run / STATE)


def load_state(state: TrainingState, run: Path) -> dict[str, Tensor]:
    """Read the run's state into networks, optimizers and progress; returns the objective's memory.

    Raises InputError naming the folder if it is of other settings or another network, and the file if what it
    holds is none of a training.
    """
    path = run / STATE
    tensors, meta = load_tensors(path)
    require_kinds(meta, KINDS, f"{path}: the training state")
    _require_same_settings(run, meta["settings"], state.settings)
    done = _progress(path, meta["done"])
    moments = {key: tensors.pop(key) for key in list(tensors) if key.startswith("optimizer/")}
    try:
        require_like(tensors, state.tensors())
        for name, optimizer in state.optimizers.items():
            _load_optimizer(optimizer, _part(moments, f"optimizer/{name}/"))
    except (RuntimeError, ValueError, KeyError) as error:
        first = str(error).splitlines()[0][:300]
        raise InputError(f"{run}: was started with another network ({first})") from error
    for name, network in state.networks.items():
        network.load_state_dict(_part(tensors, f"network/{name}/"))
    if state.average is not None:
        state.average.load_state_dict(_part(tensors, "average/"))
    for key, value in asdict(done).items():
        setattr(state.done, key, value)
    return _part(tensors, "memory/")


def _part(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key[len(prefix) :]: value for key, value in tensors.items() if key.startswith(prefix)}


def _progress(path: Path, saved: Mapping[str, Any]) -> Progressed:
    """The progress in a file. Raises InputError for what no training comes to."""
    best = math.inf if saved["best"] is None else saved["best"]
    if not (0 <= saved["step"] <= 10**9 and 0 <= saved["epochs"] <= 1e9 and 0 <= saved["seconds"] <= 1e9):
        raise InputError(f"{path}: its length is impossible, {saved['step']} steps in {saved['seconds']:g} s")
    for scores in saved["errors"]:
        if not {"step", "minutes"} < scores.keys() or not all(
            is_a(score, float) for score in scores.values()
        ):
            raise InputError(f"{path}: a validation in the training state has no step, minutes and scores")
    return Progressed(saved["step"], saved["epochs"], saved["seconds"], best, saved["errors"])


def _require_same_settings(run: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Raise InputError naming the first setting that a run was started with another value of."""
    for part, values in now.items():
        old = before.get(part)
        if old == values:
            continue
        if part in CONTENTS or not isinstance(old, dict) or not isinstance(values, dict):
            raise InputError(f"{run}: was started with other {part}")
        key = next(key for key in (old | values) if old.get(key) != values.get(key))
        was = str(old.get(key))[:100]
        raise InputError(f"{run}: was started with {part}.{key[:100]} = {was}, not {values.get(key)}")


def _load_optimizer(optimizer: Any, saved: Mapping[str, Tensor]) -> None:
    """Restore an optimizer from tensors named INDEX/ENTRY; its parameter groups stay.

    Raises ValueError unless they are the moments of its weights.
    """
    weights = [weight for group in optimizer.param_groups for weight in group["params"]]
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in saved.items():
        index, _, entry = key.partition("/")
        state.setdefault(int(index), {})[entry] = value
    for number, entries in state.items():
        weight = weights[number] if 0 <= number < len(weights) else None
        if weight is None:
            raise ValueError(f"moments of weights {number} of {len(weights)}")
        like = {"step": torch.zeros(()), "exp_avg": weight, "exp_avg_sq": weight}
        require_like(entries, like)
        if min(float(entries[key].min()) for key in ("step", "exp_avg_sq")) < 0:
            raise ValueError(f"moments of weights {number} are below zero")
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": state, "param_groups": groups})
    # The fused optimizer walks weights and moments by their place in memory.
    for weight, moments in optimizer.state.items():
        for key, value in moments.items():
            if value.shape == weight.shape:
                moments[key] = torch.empty_like(weight).copy_(value)
