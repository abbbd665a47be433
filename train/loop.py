"""The training loop: any objective, on CPU, one GPU or several, with an exact resume after interruption."""

import copy
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from uvcloth.errors import InputError
from uvcloth.files.atomic import make_folder, require_there
from uvcloth.files.options import AtLeast, Between
from uvcloth.process.interruption import uninterrupted

from .state import STATE, Progressed, TrainingState, load_state, save_state

PROGRESS_KEYS = ("step", "minutes")
"""Keys in addition to the scores of a validation."""

LOG_EVERY = 10
"""Steps between entries in the log."""


@dataclass(frozen=True)
class LoopConfig:
    """Settings of the training loop: length, learning rate, averaging, validation."""

    steps: Annotated[int, AtLeast(1)] = 3000
    """Number of optimizer steps."""
    minutes: Annotated[float | None, Between(0, 1e6, above=True)] = None
    """Stop after so many minutes of training and validation; the learning rate schedule ends there too."""
    batch: Annotated[int, Between(1, 100_000)] = 8
    """Frames, or poses, in a step, over all devices."""
    double_every: Annotated[float, Between(0, 1)] = 0.0
    """Share of the training after which the batch size doubles, again and again (DeePSD: 0.2); 0: never."""
    learning_rate: Annotated[float, Between(0, 10, above=True)] = 1e-3
    """Highest learning rate of Adam (PhysXNet: 2e-4, PBNS: 1e-3)."""
    schedule: Literal["constant", "cosine"] = "cosine"
    """Constant (paper), or rising for the first percent and falling to zero along a cosine."""
    weight_decay: Annotated[float, Between(0, 100)] = 0.05
    """Decoupled weight decay."""
    average: Annotated[float, Between(0, 1)] = 0.998
    """Decay of the running mean of the weights, which is validated and saved; 0: no mean."""
    validate_every: Annotated[int, AtLeast(1)] = 250
    """Steps between validations."""
    keep: Literal["best", "last"] = "best"
    """Network to keep: the best in validation, or the last."""
    save_seconds: Annotated[float, Between(0, 1e6)] = 120.0
    """Seconds between saved training states."""
    seed: Annotated[int, Between(0, 2**32 - 1)] = 0
    """Random seed of weights, order of samples and steps."""
    devices: Annotated[int, Between(1, 64)] = 1
    """Number of GPUs, if there are any."""

    def __post_init__(self) -> None:
        """Raises InputError for values out of range."""
        for name in ("steps", "batch", "validate_every", "devices", "minutes", "learning_rate"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(f"--{name.replace('_', '-')} {value}: has to be more than 0")
        if not 0 <= self.double_every < 1:
            raise InputError(f"--double-every {self.double_every}: has to be 0 or more, and less than 1")
        if not self.weight_decay >= 0:
            raise InputError(f"--weight-decay {self.weight_decay}: has to be 0 or more")
        if not 0 <= self.average < 1:
            raise InputError(f"--average {self.average}: has to be 0 or more, and less than 1")


class Objective(Protocol):
    """The method-specific part of training, on one device; derived classes inherit the defaults."""

    @property
    def samples(self) -> Tensor:
        """(S,) int64 rows that a step may ask for."""
        ...

    def networks(self) -> dict[str, nn.Module]:
        """New networks by name; "net" is the one that is validated and saved."""
        ...

    def steps(
        self, networks: Mapping[str, nn.Module], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """For each network to update in turn: its name, its loss, and the parts of the loss for the log."""
        ...

    def validate(self, net: nn.Module) -> dict[str, float]:
        """Scores by name and unit; the network with the lowest first score is kept."""
        ...

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        """Write the checkpoint of the network."""
        ...

    def settings(self) -> dict[str, Any]:
        """Settings that must not change within a run: parts such as "method" and "losses", of JSON values.

        Of CONTENTS (`train/state.py`), what differs is not named.
        """
        ...

    def picture(self, net: nn.Module) -> Tensor | None:
        """A picture of the network's output for the log: (H, W, 3) uint8; None for none."""
        return None

    def memory(self) -> dict[str, Tensor]:
        """The objective's own state between steps, for an exact resume."""
        return {}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Restore the state that `memory` gave."""
        return


def training_device() -> torch.device:
    """The device that this process trains on: its own GPU where there are any."""
    if not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))


@dataclass(frozen=True)
class Training:
    """A run in memory: what `fit` works on and what an exact resume needs."""

    objective: Objective
    run: Path
    config: LoopConfig
    fabric: Any
    networks: dict[str, Any]
    optimizers: dict[str, Any]
    average: nn.Module
    done: Progressed


def fit(objective: Objective, run: Path, config: LoopConfig, *, resume: bool) -> dict[str, float]:
    """Train until the end of the steps or minutes; returns the validation scores of the kept network.

    Every step seeds its own randomness and draws its samples by its number, so that a resumed run continues
    exactly. Ctrl-C ends the step and saves. Raises InputError if there is nothing to resume, if the run was
    started with other settings or data, if its folder cannot be made, or if the loss is no longer a number.
    """
    check_run(run, resume=resume)
    training = _begin(objective, run, config)
    if resume:
        objective.remember(load_state(_state(training), run))
    done = training.done
    with uninterrupted() as interrupted:
        _train(training, interrupted)
        if interrupted():
            _save_state(training)
            Console(stderr=True).print(f"interrupted at step {done.step}; continue with --resume")
    if not _validated(done):
        _save_state(training)
        Console(stderr=True).print(f"step {done.step}: {_validate(training)}")
    _save_state(training)
    return done.errors[-1] if config.keep == "last" else min(done.errors, key=_first)


def format_scores(scores: Mapping[str, float]) -> str:
    """Validation scores as text, without step and minutes."""
    return ", ".join(f"{name} {score:.4g}" for name, score in scores.items() if name not in PROGRESS_KEYS)


def _first(scores: Mapping[str, float]) -> float:
    """The score that decides."""
    return next(score for name, score in scores.items() if name not in PROGRESS_KEYS)


def has_begun(run: Path) -> bool:
    """True if the folder holds a run that can be resumed."""
    return (run / STATE).exists()


def check_run(run: Path, *, resume: bool) -> None:
    """Raise InputError if a new run would overwrite the folder's, or if there is none to resume."""
    if resume and not has_begun(run):
        raise InputError(f"{run}: nothing to resume, it has no {STATE}")
    if not resume and has_begun(run):
        raise InputError(f"{run}: holds a run already; continue it with --resume or name another folder")


def _begin(objective: Objective, run: Path, config: LoopConfig) -> Training:
    """Make networks, optimizers and logger, the weights seeded."""
    from lightning_fabric import Fabric
    from lightning_fabric.loggers.tensorboard import TensorBoardLogger

    make_folder((run / STATE).parent)
    gpu = torch.cuda.is_available()
    fabric = Fabric(
        accelerator="cuda" if gpu else "cpu",
        devices=config.devices if gpu else 1,
        precision="bf16-mixed" if gpu else "32-true",
        loggers=[TensorBoardLogger(run, name="tensorboard", version="")],
    )
    fabric.launch()
    torch.manual_seed(config.seed)
    networks: dict[str, Any] = {}
    optimizers: dict[str, Any] = {}
    for name, network in objective.networks().items():
        laid_out = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        optimizer = torch.optim.AdamW(
            laid_out.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
        )
        networks[name], optimizers[name] = fabric.setup(laid_out, optimizer)
    average = copy.deepcopy(networks["net"].module) if config.average else networks["net"].module
    return Training(objective, run, config, fabric, networks, optimizers, average, Progressed())


def _train(training: Training, interrupted: Callable[[], bool]) -> None:
    """Step, log, validate and save until the training is spent or interrupted."""
    config, fabric, done = training.config, training.fabric, training.done
    samples = training.objective.samples.cpu()
    shown = ""
    begun = time.monotonic() - done.seconds
    saved = time.monotonic()
    with _progress(fabric.is_global_zero) as bar:
        task = bar.add_task("training", total=1.0)
        if done.step and done.step % config.validate_every == 0 and not _validated(done):
            shown = _validate(training)
        while not interrupted() and (share := _share(config, done)) < 1.0:
            require_there(training.run)
            set_rates(training.optimizers, config, share)
            parts = _step(training, samples, batch_after(config, share))
            done.seconds = fabric.broadcast(time.monotonic() - begun)
            if done.step % LOG_EVERY == 0:
                values = {key: float(value.detach()) for key, value in parts.items()}
                if not all(map(math.isfinite, values.values())):
                    raise InputError(
                        f"{training.run}: at step {done.step} the loss is no longer a number; "
                        "lower --learning-rate and start again"
                    )
                fabric.log_dict({f"loss/{key}": value for key, value in values.items()}, done.step)
                losses = " ".join(f"{key} {value:.3f}" for key, value in values.items())
                bar.update(task, completed=share, description=f"step {done.step} {losses} {shown}")
            if done.step % config.validate_every == 0:
                # A run that is ended in a validation, which may take minutes, goes on with it.
                _save_state(training)
                shown = _validate(training)
                bar.console.print(f"step {done.step}, {done.seconds / 60:.1f} min: {shown}")
                done.seconds = time.monotonic() - begun
            if time.monotonic() - saved > config.save_seconds:
                _save_state(training)
                saved = time.monotonic()


def _step(training: Training, samples: Tensor, batch: int) -> dict[str, Tensor]:
    """One step of every network on a batch of samples; returns the parts of the losses."""
    config, fabric, done = training.config, training.fabric, training.done
    rows = rows_of_step(samples, replace(config, batch=batch), done.step)[
        fabric.global_rank :: fabric.world_size
    ]
    torch.manual_seed((config.seed * 1_000_003 + done.step) * fabric.world_size + fabric.global_rank)
    parts: dict[str, Tensor] = {}
    if fabric.device.type == "cuda":
        # A copy from other memory would wait for the step before.
        rows = rows.pin_memory()
    rows = rows.to(fabric.device, non_blocking=True)
    for name, loss, logged in training.objective.steps(training.networks, rows):
        training.optimizers[name].zero_grad()
        fabric.backward(loss)
        training.optimizers[name].step()
        parts |= logged
    if config.average:
        _update_average(training.average, training.networks["net"].module, config.average, done.step)
    done.step += 1
    done.epochs += 1.0 / (len(samples) // min(batch, len(samples)))
    return parts


def _validated(done: Progressed) -> bool:
    """True if the last step was validated."""
    return bool(done.errors) and done.errors[-1]["step"] == done.step


def _validate(training: Training) -> str:
    """Validate, save the network if it is to be kept, and return the errors as text."""
    done = training.done
    errors = training.objective.validate(training.average)
    when = {"step": done.step, "minutes": done.seconds / 60}
    done.errors.append({**when, **errors})
    training.fabric.log_dict({f"validation/{name}": error for name, error in errors.items()}, done.step)
    picture = training.objective.picture(training.average)
    if picture is not None:
        training.fabric.logger.experiment.add_image("validation", picture, done.step, dataformats="HWC")
    if training.config.keep == "last" or _first(errors) < done.best:
        if training.fabric.is_global_zero:
            learned = {**when, **_learned(training)}
            notes = {**learned, "validation": errors, "loop": asdict(training.config), "curve": done.errors}
            training.objective.save(training.average, training.run, notes)
        done.best = min(done.best, _first(errors))
    return "validation: " + format_scores(errors)


def _learned(training: Training) -> dict[str, float]:
    """The number of samples, and how often each was seen so far."""
    return {"samples": len(training.objective.samples), "epochs": round(training.done.epochs, 2)}


def _progress(shown: bool) -> Progress:
    """The progress bar, on the main process alone."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        disable=not shown,
    )


def rows_of_step(samples: Tensor, config: LoopConfig, step: int) -> Tensor:
    """The rows of a step. Every epoch is a permutation drawn by its number; its ragged end is dropped."""
    batch = min(config.batch, len(samples))
    epoch, place = divmod(step, len(samples) // batch)
    order = torch.randperm(len(samples), generator=torch.Generator().manual_seed(config.seed + 7919 * epoch))
    return samples[order[place * batch : (place + 1) * batch]]


def _share(config: LoopConfig, done: Progressed) -> float:
    """The share of the steps or the minutes that is spent, whichever is more: 0 to 1."""
    spent = done.step / config.steps
    return spent if config.minutes is None else max(spent, done.seconds / 60.0 / config.minutes)


def batch_after(config: LoopConfig, share: float) -> int:
    """The samples in a step after a share of the training, 0 to 1."""
    if not config.double_every:
        return config.batch
    # A share such as 0.6 is a little less than three times 0.2 in floating point.
    return config.batch * 2 ** int(share / config.double_every + 1e-9)


def set_rates(optimizers: Mapping[str, Any], config: LoopConfig, share: float) -> None:
    """Set the learning rate after a share of the training, 0 to 1."""
    rate = config.learning_rate
    if config.schedule == "cosine":
        rate *= min(1.0, share / 0.01 + 1e-2) * 0.5 * (1.0 + math.cos(math.pi * share))
    for optimizer in optimizers.values():
        for group in optimizer.param_groups:
            group["lr"] = rate


@torch.no_grad()
def _update_average(average: nn.Module, network: nn.Module, decay: float, step: int) -> None:
    """Move the running mean towards the network: faster while there is little to average."""
    decay = min(decay, (1.0 + step) / (10.0 + step))
    means, values = average.state_dict(), network.state_dict()
    counts = [name for name, mean in means.items() if not mean.is_floating_point()]
    for name in counts:
        means.pop(name).copy_(values.pop(name))
    get_ema_multi_avg_fn(decay)([*means.values()], [*values.values()], None)


def _settings(training: Training) -> dict[str, Any]:
    """Settings that must not change within a run, as JSON values; "loop": the loop's but its length."""
    may_change = ("steps", "minutes", "validate_every", "save_seconds")
    loop = {key: value for key, value in asdict(training.config).items() if key not in may_change}
    settings: dict[str, Any] = json.loads(json.dumps({"loop": loop, **training.objective.settings()}))
    return settings


def _state(training: Training) -> TrainingState:
    """State of a run, as its file holds it."""
    return TrainingState(
        networks={name: network.module for name, network in training.networks.items()},
        optimizers=training.optimizers,
        average=training.average if training.config.average else None,
        memory=training.objective.memory(),
        done=training.done,
        settings=_settings(training),
    )


def _save_state(training: Training) -> None:
    """Write the training state, on the main process alone."""
    if training.fabric.is_global_zero:
        save_state(_state(training), training.run)
