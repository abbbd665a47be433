"""Simulations that are stopped go on with the frames that were kept, if these are of the same scene."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
import torch
from rich.console import Console

from uvcloth.dataset.folder import rejected
from uvcloth.simulation import unfinished
from uvcloth.simulation.engine import Frame, Scene
from uvcloth.simulation.overview import overview
from uvcloth.simulation.unfinished import (
    Place,
    clear_finished,
    move,
    unfinished_files,
    unfinished_frames,
)

FRAMES = 8
NAME = "walk_tops"


class StopError(Exception):
    """A simulation that ends in the middle."""


@dataclass(frozen=True)
class Falling:
    """Points that fall; it stops before the frame `stop`. remembers: whether it says what it goes on from."""

    gravity: float = 10.0
    stop: int = FRAMES
    remembers: bool = True

    def describe(self) -> dict[str, Any]:
        return {"engine": "falling", "settings": {"gravity": self.gravity}}

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        position, velocity = (
            (scene.rest, torch.zeros_like(scene.rest))
            if after is None
            else after.memory.view(2, -1, 3).unbind()
        )
        for index in range(0 if after is None else after.index + 1, len(scene.skinned)):
            if index == self.stop:
                raise StopError
            velocity = velocity - torch.tensor([0.0, 0.0, self.gravity / scene.fps])
            position = position + velocity / scene.fps
            memory = torch.stack([position, velocity]).flatten()
            yield Frame(index, position + 7.0, memory if self.remembers else None)


def some_scene() -> Scene:
    rest = torch.randn(5, 3, generator=torch.Generator().manual_seed(0))
    return Scene(
        rest=rest,
        faces=torch.tensor([[0, 1, 2], [2, 3, 4]]),
        band=torch.zeros(5, dtype=torch.bool),
        mass_factor=torch.ones(5),
        inner_thickness=torch.zeros(5),
        skinned=rest.expand(FRAMES, 5, 3),
        collider=torch.zeros(FRAMES, 0, 3),
        collider_parts=(),
        touches=torch.zeros(0, 5, dtype=torch.bool),
        fps=30.0,
    )


@pytest.fixture
def scene() -> Scene:
    return some_scene()


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    """A place where every frame is kept."""
    monkeypatch.setattr(unfinished, "SECONDS", -1.0)
    return Place(tmp_path, tmp_path / f"{NAME}.npz")


def made(engine: Falling, scene: Scene, place: Place) -> tuple[torch.Tensor, list[int]]:
    """The vertices, and the numbers of frames that were told."""
    told: list[int] = []
    return move(engine, scene, place, told.append).vertices, told


def stop(engine: Falling, scene: Scene, place: Place) -> None:
    with pytest.raises(StopError):
        made(replace(engine, stop=5), scene, place)


def test_it_goes_on_where_it_was_stopped(scene: Scene, place: Place) -> None:
    truth = move(Falling(), scene, None).vertices
    stop(Falling(), scene, place)
    assert unfinished_files(place.folder) == [place.file]
    assert unfinished_frames(place.file) == (NAME, 5)
    text = StringIO()
    Console(width=160, file=text).print(overview(place.folder))
    assert f"unfinished: 1 sequences, 5 frames ({NAME} 5)" in text.getvalue()
    moved, told = made(Falling(), scene, place)
    assert torch.equal(moved, truth)
    assert told == [5, 6, 7, 8]
    assert made(Falling(), scene, place)[1] == [8]


def test_time_adds_up(scene: Scene, place: Place) -> None:
    stop(Falling(), scene, place)
    before = unfinished._read(place.file)["seconds"]
    assert move(Falling(), scene, place).seconds > before > 0.0


@pytest.mark.parametrize("change", ["engine", "scene", "rate", "damage", "nothing remembered"])
def test_it_begins_anew(scene: Scene, place: Place, change: str) -> None:
    engine = Falling(remembers=change != "nothing remembered")
    stop(engine, scene, place)
    if change == "engine":
        engine = Falling(gravity=9.0)
    elif change == "scene":
        scene = replace(scene, skinned=scene.skinned + 1e-6)
    elif change == "rate":
        scene = replace(scene, fps=25.0)
    elif change == "damage":
        place.file.write_bytes(place.file.read_bytes()[:-100])
        assert unfinished_frames(place.file) == (NAME, 0)
    moved, told = made(engine, scene, place)
    assert told == list(range(FRAMES + 1))
    assert torch.equal(moved, move(engine, scene, None).vertices)


def test_nothing_is_kept_where_the_folder_is_not(scene: Scene, place: Place) -> None:
    gone = place.folder / "gone"
    assert made(Falling(), scene, Place(gone, gone / "a.npz"))[1] == list(range(FRAMES + 1))
    assert not gone.exists()


def test_what_was_kept_goes_when_the_sequence_is_there(scene: Scene, place: Place) -> None:
    again = Place(place.folder, place.folder / "repeat" / f"{NAME}.npz")
    for each in (place, again):
        stop(Falling(), scene, each)
    clear_finished(place.folder)
    assert unfinished_files(place.folder) == [place.file, again.file]
    place.target.touch()
    rejected(again.target).parent.mkdir()
    rejected(again.target).touch()
    clear_finished(place.folder)
    assert not unfinished_files(place.folder)
