"""Videos and contact sheets, read back by PyAV and OpenImageIO."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.rotations import from_euler
from uvcloth.writers.animation import Animation
from uvcloth.writers.pictures import COARSE_SHEET, COARSE_VIDEO, camera_path, sheet_moments
from uvcloth.writers.shot import CameraName
from uvcloth.writers.video import open_video
from uvcloth.writers.writer import open_writer

av = pytest.importorskip("av", reason="PyAV is not installed")


def striped(index: int) -> np.ndarray:
    """A grey picture 32 wide and 48 high with a white bar that moves down."""
    picture = np.full((48, 32, 3), 80, np.uint8)
    picture[4 * index : 4 * index + 8] = 255
    return picture


@pytest.mark.parametrize("name", ["walk.mp4", "walk.gif"])
def test_a_video_holds_every_picture_at_its_time(tmp_path: Path, name: str) -> None:
    video = open_video(tmp_path / name, (32, 48), 30.0)
    for index in range(10):
        video.add(striped(index))
    video.close()
    with av.open(str(tmp_path / name)) as container:
        frames = list(container.decode(video=0))
    assert len(frames) == 10
    # GIF counts hundredths of a second.
    for index, frame in enumerate(frames):
        assert float(frame.time) == pytest.approx(index / 30, abs=0.006)
        assert np.abs(frame.to_ndarray(format="rgb24").astype(int) - striped(index)).mean() < 6


def draw(animation: Animation, path: Path, frames: int) -> np.ndarray | list[np.ndarray]:
    motion = torch.from_numpy(animation.transforms[:frames])
    garments = list(zip(animation.names, animation.meshes, strict=True))
    with open_writer(path, garments, animation.body, 30.0, motion, coarse=True) as writer:
        for index in range(frames):
            writer.add([torch.from_numpy(values[index]) for values in animation.vertices], motion[index])
    assert [part.name for part in path.parent.iterdir()] == [path.name]
    if path.suffix == ".png":
        return np.asarray(OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.UINT8))
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def colored(picture: np.ndarray) -> float:
    """Share of the pixels that are garment: blue or orange, where all else is grey."""
    return float((np.abs(picture[..., 2].astype(int) - picture[..., 0]) > 30).mean())


def test_a_video_shows_the_garments_in_every_frame(animation: Animation, tmp_path: Path) -> None:
    pictures = draw(animation, tmp_path / "walk.mp4", 3)
    assert len(pictures) == 3
    width, height = COARSE_VIDEO.size
    for picture in pictures:
        assert picture.shape == (height, width, 3)
        assert 0.005 < colored(picture) < 0.3


def test_a_video_of_a_loop_leaves_out_the_first_frame_at_its_end(
    animation: Animation, tmp_path: Path
) -> None:
    """A player begins anew after the last frame: the same picture twice would be a stop."""
    order = [0, 1, 0]
    loop = replace(
        animation,
        vertices=tuple(values[order] for values in animation.vertices),
        transforms=animation.transforms[order],
    )
    assert len(draw(loop, tmp_path / "loop.mp4", 3)) == 2


def test_a_contact_sheet_shows_frames_of_the_whole_clip(animation: Animation, tmp_path: Path) -> None:
    assert sheet_moments(115, 6) == [0, 23, 46, 68, 91, 114]
    assert sheet_moments(2, 6) == [0, 1]
    sheet = draw(animation, tmp_path / "walk.png", 2)
    assert isinstance(sheet, np.ndarray)
    height, columns = sheet.shape[0], 2
    width = (sheet.shape[1] - 6 * (columns - 1)) // columns
    assert height > width
    assert height * width == pytest.approx(np.prod(COARSE_SHEET.size), rel=0.02)
    assert min(colored(sheet[:, :width]), colored(sheet[:, -width:])) > 0.005


def test_the_camera_holds_every_joint_of_every_frame(animation: Animation) -> None:
    motion = torch.from_numpy(animation.transforms)
    body = animation.body
    assert body is not None
    joints = torch.einsum("fjab,jb->fja", motion[..., :3], body.skeleton.heads) + motion[..., 3]
    for camera, points in zip(camera_path(body, motion, 30.0, 0.75), joints, strict=True):
        eye, target = np.array(camera.eye), np.array(camera.target)
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.array([-forward[1], forward[0], 0.0]) / np.hypot(*forward[:2])
        seen = points.double().numpy() - eye
        half = np.tan(np.radians(camera.view / 2)) * (seen @ forward)
        assert (np.abs(seen @ right) < 0.75 * half).all()
        assert (np.abs(seen @ np.cross(right, forward)) < half).all()


def test_without_pyav_a_video_is_refused_in_a_sentence(
    animation: Animation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(InputError, match=r"walk\.mp4: videos need PyAV: install uvcloth\[video\]"):
        open_writer(tmp_path / "walk.mp4", [], animation.body, 30.0, torch.from_numpy(animation.transforms))
    assert not list(tmp_path.iterdir())


def test_cameras_stand_around_the_body_as_it_faces_and_follow_its_turn(body: Body) -> None:
    """The body turns by 90 degrees to its left on the spot, from a first facing of 40 degrees."""
    angles = torch.deg2rad(torch.linspace(40.0, 130.0, 90))
    turns = from_euler("z", angles[:, None]).float()
    transforms = torch.cat([turns, torch.zeros(90, 3, 1)], dim=2)[:, None].expand(
        -1, len(body.skeleton.names), -1, -1
    )
    seen = {}
    shots: tuple[tuple[CameraName, float], ...] = (
        ("front", 0.0),
        ("side", 90.0),
        ("back", 180.0),
        ("close", 30.0),
        ("follow", 30.0),
    )
    for name, aside in shots:
        cameras = camera_path(body, transforms, 30.0, 0.75, name)
        ways = torch.tensor([camera.eye for camera in cameras]) - torch.tensor([c.target for c in cameras])
        around = torch.rad2deg(torch.atan2(ways[:, 0], -ways[:, 1])) % 360
        last = 130.0 if name == "follow" else 40.0
        assert float(around[0]) == pytest.approx(40.0 + aside, abs=6)
        assert float(around[-1]) == pytest.approx(last + aside, abs=6)
        seen[name] = float(ways[0].norm())
    assert seen["close"] < 0.8 * seen["follow"]
