"""Readers of what runs leave behind: animations, training states, results that are kept for a rerun."""

import copy
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from torch import nn

from tests.fuzz.array_targets import check_mesh
from tests.fuzz.target import Target, require, require_numbers
from tests.simulation.test_unfinished import Falling, StopError, some_scene
from tests.small_body import small_body
from train.state import Progressed, TrainingState, load_state, save_state
from train.wrinkles.tracked_runs import TrackedRun, load_run, save_run
from uvcloth.errors import InputError
from uvcloth.geometry.kept import keep_arrays, kept_arrays
from uvcloth.simulation import unfinished
from uvcloth.simulation.unfinished import Place, SimulatedFrames, move, unfinished_frames
from uvcloth.writers.animation import Animation, load_animation, write_npz

FRAMES = 3
SETTINGS = {"loop": {"seed": 0, "learning_rate": 1e-3}, "data": {"walk.npz": "0" * 64}}


def good_animation(folder: Path) -> Path:
    mesh = small_body().mesh
    moved = mesh.vertices.numpy() + np.zeros((FRAMES, 1, 1), np.float32)
    still = np.tile(np.eye(3, 4, dtype=np.float32), (FRAMES, 2, 1, 1))
    write_npz(Animation(("box",), (mesh,), (moved,), None, still, 30.0), folder / "walk.npz")
    return folder / "walk.npz"


def check_animation(animation: Animation) -> None:
    require(len(animation.meshes) == len(animation.names) == len(set(animation.names)), "names")
    require_numbers(torch.from_numpy(animation.transforms), (-1, -1, 3, 4), "transforms")
    require(len(animation) > 0 and 1 <= animation.fps <= 1000, "frames, or frames per second")
    for mesh, vertices in zip(animation.meshes, animation.vertices, strict=True):
        check_mesh(mesh, "garment")
        count = len(mesh.vertices)
        require_numbers(torch.from_numpy(vertices), (len(animation), count, 3), "vertices")


def training() -> TrainingState:
    """A run of one network, which has taken a step."""
    torch.manual_seed(0)
    network = nn.Sequential(nn.Linear(2, 3), nn.BatchNorm1d(3))
    optimizer = torch.optim.AdamW(network.parameters(), fused=True)
    network(torch.ones(4, 2)).square().sum().backward()
    optimizer.step()
    done = Progressed(1, 0.5, 2.0, 3.0, [{"step": 1, "minutes": 0.1, "error_mm": 3.0}])
    memory = {"past": torch.zeros(4, 2), "seen": torch.tensor(3)}
    average = copy.deepcopy(network)
    return TrainingState({"net": network}, {"net": optimizer}, average, memory, done, SETTINGS)


def good_state(folder: Path) -> Path:
    save_state(training(), folder)
    return folder


def resumed(run: Path) -> TrainingState:
    """The run of a file, which takes one more step."""
    state = training()
    memory = load_state(state, run)
    for name, tensor in (state.tensors() | memory).items():
        require(torch.isfinite(tensor).all(), f"{name} is not finite")
    state.networks["net"](torch.ones(4, 2)).square().sum().backward()
    state.optimizers["net"].step()
    return TrainingState(state.networks, state.optimizers, state.average, memory, state.done, state.settings)


def check_state(state: TrainingState) -> None:
    expected = training().tensors()
    require(state.tensors().keys() == expected.keys(), "other tensors")
    for name, tensor in state.tensors().items():
        require(tensor.shape == expected[name].shape, f"{name} of another shape")
    done = state.done
    require(type(done.step) is int and done.step >= 0, "steps")
    require(min(done.seconds, done.epochs) >= 0 and not np.isnan(done.best), "progress")
    require(
        all({"step", "minutes"} < scores.keys() for scores in done.errors), "a validation without its step"
    )


def good_kept(folder: Path) -> Path:
    arrays = {"identity": np.array("body"), "corners": np.arange(12).reshape(4, 3), "points": np.ones((4, 3))}
    keep_arrays(folder / "prepared.npz", "uvcloth-prepared-2", arrays)
    return folder / "prepared.npz"


def check_kept(arrays: dict[str, Any]) -> None:
    require(set(arrays) == {"format", "identity", "corners", "points"}, f"the arrays {sorted(arrays)}")
    require(np.array_equal(arrays["corners"], np.arange(12).reshape(4, 3)), "corners have changed")
    require(np.array_equal(arrays["points"], np.ones((4, 3))), "points have changed")


NAME = "walk_tops"
"""Of the sequence that is simulated."""


@cache
def truth() -> SimulatedFrames:
    """Of a simulation that nobody stops."""
    return move(Falling(), some_scene(), None)


def good_unfinished(folder: Path) -> Path:
    """Frames that are kept when a simulation is stopped."""
    place = Place(folder, folder / f"{NAME}.npz")
    with patch.object(unfinished, "SECONDS", -1.0), suppress(StopError):
        move(Falling(stop=5), some_scene(), place)
    return place.file


def gone_on(file: Path) -> SimulatedFrames:
    """The simulation, on from what the file keeps, and keeping every frame there again.

    It refuses no file: one from which it did not go on counts as refused here.
    """
    place, told = Place(file.parent, file.with_name(f"{NAME}.npz")), list[int]()
    try:
        name, frames = unfinished_frames(file)
        require(name == NAME and 0 <= frames <= 5, f"{frames} frames of {name}")
        with patch.object(unfinished, "SECONDS", -1.0):
            moved = move(Falling(), some_scene(), place, told.append)
    except InputError as error:
        raise AssertionError("a damaged file is not ignored") from error
    if told[0] == 0:
        check_gone_on(moved)
        raise InputError(f"{file}: the simulation begins anew")
    return moved


def check_gone_on(frames: SimulatedFrames) -> None:
    require(torch.equal(frames.vertices, truth().vertices), "other frames than without a stop")
    require(np.isfinite(frames.seconds) and frames.seconds >= 0, "time")


def good_tracked_run(folder: Path) -> Path:
    """Tracking cloth of five vertices over a garment of eight."""
    run = TrackedRun(
        garment="tops",
        quality="default",
        clip="walk",
        subject="ann",
        mesh="0" * 64,
        fps=30.0,
        edge=0.009,
        transforms=torch.eye(3, 4).expand(FRAMES, 2, 3, 4).clone(),
        coarse=torch.zeros(FRAMES + 2, 8, 3),
        offsets=torch.full((FRAMES, 5, 3), 0.01),
    )
    save_run(run, folder / "walk.npz")
    return folder / "walk.npz"


def check_tracked_run(run: TrackedRun) -> None:
    require_numbers(run.transforms, (len(run), -1, 3, 4), "transforms")
    require_numbers(run.coarse, (len(run) + 2, -1, 3), "coarse cloth")
    require_numbers(run.offsets, (len(run), -1, 3), "offsets")
    require(run.fps >= 1.0 and run.edge > 0.0, "frames per second, or edges")


TARGETS = [
    Target("animation", good_animation, load_animation, check_animation),
    Target("training_state", good_state, resumed, check_state),
    Target("kept", good_kept, lambda path: kept_arrays(path, "uvcloth-prepared-2", "a file"), check_kept),
    Target("unfinished", good_unfinished, gone_on, check_gone_on),
    Target("tracked run", good_tracked_run, load_run, check_tracked_run),
]
