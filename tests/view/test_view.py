"""The live view without a browser: the scene that one would be sent, and how it follows the controls."""

import html
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest
import torch
from torch import Tensor

from tests.simulation.skinned import skinned_sequence
from tests.small_body import small_body
from uvcloth.bodies.body import Body
from uvcloth.commands.run.view import LiveAudience
from uvcloth.commands.view import View
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.errors import InputError
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.library import load_clip, save_clip
from uvcloth.rollouts.rollout import RolloutFrame
from uvcloth.view.choices import Choice, Choices
from uvcloth.view.computation import Computation, Performance
from uvcloth.view.heat import CLEARING, COLORS, ERROR, STRETCH, Stretch, bands
from uvcloth.view.viewer import Viewer

pytest.importorskip("viser", reason="viser is not installed")

COUNT = 5


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    viewer = Viewer(port=port)
    yield viewer
    viewer.close()


def shell() -> Mesh:
    mesh = small_body().mesh
    return Mesh(1.2 * mesh.vertices, mesh.faces, mesh.uvs, mesh.face_uvs)


def rising(title: str, speed: float, truth: Tensor | None = None) -> Performance:
    """A shell around the small body that rises by `speed` metres per frame, a centimetre by clearing."""
    return moving(title, torch.tensor([0.0, 0.0, speed]), truth)


def moving(title: str, way: Tensor, truth: Tensor | None = None, count: int = COUNT) -> Performance:
    """A shell around the small body that moves by a way (3,) m per frame, a centimetre by clearing."""
    body, mesh = small_body(), shell()

    def frames() -> Iterator[RolloutFrame]:
        for index in range(count):
            up = index * way
            transforms = torch.eye(3, 4).repeat(len(body.skeleton.names), 1, 1)
            transforms[:, :, 3] = up
            vertices = mesh.vertices + up
            yield RolloutFrame(
                index, (vertices - 0.01,), (vertices,), transforms, body.mesh.vertices + up, {}
            )

    return Performance(title, body, [mesh], count, 30.0, frames(), truth)


def tick_until(viewer: Viewer, reached: Callable[[], bool]) -> None:
    """Tick until something is so, ten seconds at most."""
    for _ in range(1000):
        viewer.tick()
        if reached():
            return
        time.sleep(0.01)
    raise AssertionError("the view never came there")


def node(viewer: Viewer, name: str) -> Any:
    return viewer.server.scene._handle_from_node_name[name]


def names(viewer: Viewer) -> set[str]:
    return {name for name in viewer.server.scene._handle_from_node_name if "/" in name[1:]}


def test_the_page_is_served_and_the_scene_has_the_meshes(viewer: Viewer) -> None:
    assert urlopen(viewer.address, timeout=10).status == 200
    viewer.show(Computation(lambda: rising("walk", 0.1)).start())
    tick_until(viewer, lambda: viewer.shown == COUNT - 1)
    assert names(viewer) >= {"/predicted/body", "/predicted/garment_0/0"}
    shown = node(viewer, "/predicted/garment_0/0")
    expected = shell().vertices.numpy() + np.array([0.0, 0.0, 0.1 * (COUNT - 1)])
    np.testing.assert_allclose(shown.vertices, expected, atol=1e-6)
    risen = small_body().mesh.vertices.numpy() + np.array([0.0, 0.0, 0.1 * (COUNT - 1)])
    np.testing.assert_allclose(node(viewer, "/predicted/body").vertices, risen, atol=1e-6)


def test_the_camera_follows_a_figure_over_the_floor(viewer: Viewer) -> None:
    """The figure stays where the camera looks, and the floor moves beneath it."""
    away = torch.tensor([0.3, -2.25, 0.0])
    truth = torch.stack([shell().vertices + k * away for k in range(COUNT)])
    viewer.show(Computation(lambda: moving("walk", away, truth)).start())
    tick_until(viewer, lambda: viewer.shown == COUNT - 1)
    for name in ("predicted", "simulated"):
        shown = node(viewer, f"/{name}/garment_0/0").vertices
        np.testing.assert_allclose(shown, shell().vertices.numpy(), atol=1e-5)
    np.testing.assert_allclose(
        node(viewer, "/predicted/body").vertices, small_body().mesh.vertices.numpy(), atol=1e-5
    )
    # A point that is fixed on the floor; its pattern repeats every metre.
    floor = np.array(node(viewer, "/floor").position) + (COUNT - 1) * away.numpy()
    np.testing.assert_allclose(floor, floor.round(), atol=1e-5)


def test_a_new_choice_is_prepared_while_the_one_before_plays(viewer: Viewer) -> None:
    go_on = threading.Event()

    def later() -> Performance:
        go_on.wait(10)
        return rising("run", 0.1)

    before = Computation(lambda: rising("walk", 0.1)).start()
    viewer.show(before)
    before.wait(10)
    tick_until(viewer, lambda: viewer.shown == COUNT - 1)
    viewer.show(Computation(later).start())
    order = []
    for _ in range(3):
        viewer.tick()
        order.append(viewer.shown)
    assert order == [0, 1, 2]
    assert viewer._state.content == "preparing ..."
    go_on.set()
    tick_until(viewer, lambda: viewer._state.content == f"run: {COUNT} frames")


def test_it_plays_in_a_circle_and_goes_where_the_slider_is_moved(viewer: Viewer) -> None:
    computation = Computation(lambda: rising("walk", 0.1)).start()
    viewer.show(computation)
    computation.wait(10)
    order = []
    for _ in range(COUNT + 2):
        viewer.tick()
        order.append(viewer.shown)
    assert order == [0, 1, 2, 3, 4, 0, 1]
    viewer._playing.value = False
    viewer._frame.value = 3
    viewer.tick()
    viewer.tick()
    assert viewer.shown == 3


def test_a_slow_computation_is_shown_as_far_as_it_is(viewer: Viewer) -> None:
    go_on = threading.Event()

    def slowly() -> Performance:
        performance = rising("walk", 0.1)

        def waiting() -> Iterator[RolloutFrame]:
            yield next(performance.frames)
            go_on.wait(10)
            yield from performance.frames

        return Performance("walk", performance.body, performance.meshes, COUNT, 30.0, waiting())

    viewer.show(Computation(slowly).start())
    tick_until(viewer, lambda: viewer.shown == 0)
    for _ in range(3):
        viewer.tick()
    assert viewer.shown == 0
    assert viewer._state.content == f"walk: 1 of {COUNT} frames computed"
    go_on.set()
    tick_until(viewer, lambda: viewer.shown == COUNT - 1)


def test_heat_maps_color_every_face_once(viewer: Viewer) -> None:
    truth = torch.stack([shell().vertices + torch.tensor([0.0, 0.03, 0.1 * k]) for k in range(COUNT)])
    computation = Computation(lambda: rising("walk", 0.1, truth)).start()
    viewer.show(computation)
    computation.wait(10)
    viewer._playing.value = False
    faces = len(shell().faces)
    # Rigid; 17 mm of 20; 30 mm of 50.
    for quantity, band in ((STRETCH, 0), (CLEARING, 7), (ERROR, 5)):
        viewer._heat.value = quantity.label
        viewer.tick()
        visible = {
            index: len(node(viewer, f"/predicted/garment_0/{index + 1}").faces)
            for index in range(len(COLORS))
            if f"/predicted/garment_0/{index + 1}" in names(viewer)
            and node(viewer, f"/predicted/garment_0/{index + 1}").visible
        }
        assert visible == {band: faces}
    assert "/simulated/body" in names(viewer)


def test_stretch_is_the_mean_of_the_edges_and_bands_share_the_faces() -> None:
    mesh = shell()
    torch.testing.assert_close(Stretch(mesh)(1.1 * mesh.vertices), torch.full((8,), 0.1))
    values = torch.linspace(0, 1, 8)
    parts = list(bands(values, mesh.faces, 1.0))
    assert len(parts) == len(COLORS)
    together = torch.cat(parts)
    assert sorted(together.tolist()) == sorted(mesh.faces.tolist())


def test_a_rollout_is_shown_while_it_is_computed(viewer: Viewer) -> None:
    performance, audience = rising("walk", 0.1), LiveAudience(viewer)
    audience.begin("walk", performance.body, performance.meshes, COUNT, 30.0)
    audience.add(next(performance.frames))
    tick_until(viewer, lambda: viewer.shown == 0)
    assert viewer._state.content == f"walk: 1 of {COUNT} frames computed"
    for frame in performance.frames:
        audience.add(frame)
    audience.end()
    tick_until(viewer, lambda: viewer.shown == COUNT - 1)


def test_changing_the_clip_changes_the_meshes(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    speeds = {"walk": 0.1, "run": 0.3}
    monkeypatch.setattr(Choices, "perform", lambda self, chosen: rising(chosen.motion, speeds[chosen.motion]))
    choices = Choices(("walk", "run"), ("tops",), ("lbs",), ("default",))
    viewer.offer(choices, Choice("walk", ("tops",), "lbs", "default"))
    tick_until(viewer, lambda: viewer.shown == COUNT - 1)
    viewer.controls["motion"].value = "run"
    highest = shell().vertices[:, 2].max() + 0.3 * (COUNT - 1)
    tick_until(
        viewer,
        lambda: (
            abs(float(np.max(node(viewer, "/predicted/garment_0/0").vertices[:, 2])) - float(highest)) < 1e-5
        ),
    )
    assert viewer._state.content == f"run: {COUNT} frames"


def test_what_cannot_be_is_said_on_the_page(viewer: Viewer) -> None:
    choices = Choices.of(motions=["absent.bvh"], models=["lbs"])
    viewer.offer(choices, Choice("absent.bvh", ("tops",), "lbs", "default"))
    tick_until(viewer, lambda: "absent.bvh" in viewer._state.content)
    assert "Traceback" not in viewer._state.content


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="the system does not list its sockets")
def test_the_page_is_served_to_this_machine_alone(viewer: Viewer) -> None:
    """The system's list of what listens, addresses in hexadecimal."""
    rows = [
        line.split()
        for table in ("tcp", "tcp6")
        for line in Path("/proc/net", table).read_text().splitlines()[1:]
    ]
    ends = [row[1].split(":") for row in rows if row[3] == "0A"]
    assert [address for address, port in ends if int(port, 16) == viewer.server.get_port()] == ["0100007F"]
    assert View.host == "127.0.0.1"


def test_names_of_files_are_text_on_the_page(viewer: Viewer) -> None:
    name = "<script>alert(1)</script>![x](/etc/passwd)"
    viewer.show(Computation(lambda: rising(name, 0.1)).start())
    tick_until(viewer, lambda: viewer.shown == COUNT - 1)
    assert viewer._state.content == f"{html.escape(name)}: {COUNT} frames"
    choices = Choices.of(motions=[f"{name}.bvh"], models=["lbs"])
    viewer.offer(choices, Choice(f"{name}.bvh", ("tops",), "lbs", "default"))
    tick_until(viewer, lambda: "no such file" in viewer._state.content)
    assert html.escape(name) in viewer._state.content
    assert "<script" not in viewer._state.content


def test_what_was_not_offered_is_not_opened() -> None:
    choices = Choices.of(models=["lbs"])
    for choice in (
        Choice("/etc/passwd.bvh", ("tops",), "lbs", "default"),
        Choice("walk", ("/etc/passwd.obj",), "lbs", "default"),
        Choice("walk", ("tops",), "/etc", "default"),
        Choice("walk", ("tops",), "lbs", "/etc/passwd.npz"),
        Choice("walk", ("tops",), "lbs", "default", quality="/etc"),
    ):
        with pytest.raises(InputError, match=r"/etc.* is not among the choices"):
            choices.perform(choice)


def test_a_choice_is_rolled_out_as_the_command_would() -> None:
    choices = Choices.of(models=["lbs"])
    performance = choices.perform(Choice("walk", ("tops",), "lbs", "default", finish="none"))
    first = next(performance.frames)
    assert performance.count == 115
    assert first.vertices[0].shape == performance.meshes[0].vertices.shape
    with pytest.raises(InputError, match="choose a garment"):
        choices.perform(Choice("walk", (), "lbs", "default"))
    with pytest.raises(InputError, match="--fabric denim: model lbs knows only the fabric of its training"):
        choices.perform(Choice("walk", ("tops",), "lbs", "default", fabric="denim"))


def test_fabric_and_quality_reach_the_solver() -> None:
    choices = Choices.of(models=["physics"])
    choice = Choice("walk", ("dress",), "physics", "default", quality="fast")
    frames = {
        name: choices.perform(replace(choice, **changed)).frames
        for name, changed in {
            "jersey": {},
            "denim": {"fabric": "denim"},
            "default": {"quality": "default"},
        }.items()
    }
    first = {name: next(each).vertices[0] for name, each in frames.items()}
    for name in ("denim", "default"):
        assert (first[name] - first["jersey"]).norm(dim=1).max() > 0.001


def test_a_pose_is_reached_from_rest(body: Body, tmp_path: Path) -> None:
    pose = str(tmp_path / "pose.npz")
    save_clip(load_clip("walk", body).window(40, 1), Path(pose))
    choices = Choices.of(motions=[pose], models=["lbs"])
    performance = choices.perform(Choice(pose, ("tops",), "lbs", "default", finish="none"))
    frames = list(performance.frames)
    assert len(frames) == performance.count > 1
    rest = torch.eye(3, 4).expand_as(frames[0].transforms)
    assert (frames[0].transforms - rest)[..., :3].abs().max() < 0.01
    reached = load_clip(pose, body).transforms()[0]
    torch.testing.assert_close(frames[-1].transforms, reached, atol=1e-5, rtol=0)


def test_a_sequence_is_shown_with_the_rollout_over_its_motion(body: Body, tmp_path: Path) -> None:
    sequence = skinned_sequence(fit_template("tops", body), body)
    save_simulated(sequence, tmp_path / "walk_tops.npz")
    path = str(tmp_path / "walk_tops.npz")
    choices = Choices.of(models=["lbs"], sequences=[path])
    performance = choices.perform(Choice(path, (), "lbs", "default", finish="none"))
    assert (performance.title, performance.count) == ("walk_tops", len(sequence.vertices))
    assert performance.truth is not None
    torch.testing.assert_close(performance.truth, sequence.vertices, atol=1e-4, rtol=0)
    for frame, transforms in zip(performance.frames, sequence.transforms, strict=True):
        torch.testing.assert_close(frame.transforms, transforms, atol=1e-4, rtol=0)
