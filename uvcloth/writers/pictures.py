"""Videos and contact sheets of garments on a moving body, drawn as the frames arrive."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.errors import InputError
from uvcloth.files.image import write_png
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.rotations import from_euler, heading
from uvcloth.geometry.skeleton import joint_positions
from uvcloth.rendering.lighting import COARSE, FINE, Quality
from uvcloth.rendering.render import (
    BODY_COLOR,
    FRAMING,
    GARMENT_COLORS,
    Camera,
    Surface,
    contact_sheet,
    filled_size,
    render,
    three_quarter,
)
from uvcloth.writers.shot import USUAL, CameraName, Shot
from uvcloth.writers.video import open_video

VIDEOS, SHEETS = (".mp4", ".gif"), (".png",)

SHEET_COLUMNS = 6

REACH = 0.1
"""Margin around the joints, metres, that holds body and clothes."""

FITTED_FRAMES = 500
"""Approximate number of frames that the camera is fitted to."""

FOLLOWING_SECONDS = 0.3
"""Standard deviation of the filter that smooths the camera's path, so that it does not shake."""


TURNS: dict[CameraName | None, float] = {"front": 0.0, "side": 90.0, "back": 180.0}
"""Degrees of cameras around the body, from its front to its left; others stand at ASIDE."""

ASIDE = 30.0

FILLED = 1.03
"""Framing of cameras that a person chose: they hold the body with a narrow margin."""

CLOSE = 0.15
"""Distance from the middle of the body, over its height, up to which a close camera keeps joints in view."""


@dataclass(frozen=True)
class PictureSettings:
    """Size (width, height) of each picture in pixels, quality, and number of pictures on a contact sheet."""

    size: tuple[int, int]
    quality: Quality
    on_sheet: int


VIDEO = PictureSettings((480, 640), FINE, 0)
SHEET = PictureSettings((300, 400), FINE, 2 * SHEET_COLUMNS)
COARSE_VIDEO = PictureSettings((240, 320), COARSE, 0)
COARSE_SHEET = PictureSettings((240, 320), COARSE, SHEET_COLUMNS)


def picture_settings(suffix: str, coarse: bool) -> PictureSettings:
    """Settings of the pictures in a file of that suffix."""
    if suffix in VIDEOS:
        return COARSE_VIDEO if coarse else VIDEO
    return COARSE_SHEET if coarse else SHEET


def camera_path(
    body: Body, motion: Tensor, fps: float, aspect: float, camera: CameraName | None = None
) -> list[Camera]:
    """A camera for each frame of a motion (F, J, 3, 4), which follows the body and keeps all of it in view.

    aspect: width of the picture over its height. camera: as a `Shot` has it; close keeps only the joints in
    view that are above the hips and near the middle at rest.
    """
    path, turned, points = _followed(body, motion, fps, camera)
    framing = FILLED if camera else FRAMING
    still = three_quarter(points, TURNS.get(camera, ASIDE), aspect=aspect, framing=framing)
    eyes, targets = (
        path + turned @ torch.tensor(place, dtype=path.dtype) for place in (still.eye, still.target)
    )
    return [
        replace(still, eye=tuple(eye), target=tuple(target))
        for eye, target in zip(eyes.tolist(), targets.tolist(), strict=True)
    ]


def _followed(
    body: Body, motion: Tensor, fps: float, camera: CameraName | None
) -> tuple[Tensor, Tensor, Tensor]:
    """A camera's path (F, 3) m and turns (F, 3, 3), and relative to them the points (..., 3) m to hold."""
    from scipy.ndimage import gaussian_filter1d

    joints = joint_positions(body.skeleton, motion)
    if camera == "close":
        x, _, z = body.skeleton.heads.T
        joints = joints[:, (z >= z[0]) & (x.abs() < CLOSE * (z.max() - z.min()))]
    middle = (joints.amin(1) + joints.amax(1)) / 2
    middle[:, 2] = (joints[..., 2].min() + joints[..., 2].max()) / 2
    path = torch.from_numpy(gaussian_filter1d(middle.numpy(), FOLLOWING_SECONDS * fps, 0, mode="nearest"))
    facing = heading(motion[:, 0, :, :3].double())
    angles = np.unwrap(torch.atan2(facing[:, 1, 0], facing[:, 0, 0]).numpy())
    smooth = gaussian_filter1d(angles, FOLLOWING_SECONDS * fps, mode="nearest")
    angles = smooth if camera == "follow" else np.full(len(motion), angles[0] if camera else 0.0)
    turned = from_euler("z", torch.from_numpy(angles)[:, None]).to(path.dtype)
    around = ((joints - path[:, None]) @ turned)[:: max(1, len(motion) // FITTED_FRAMES)].reshape(-1, 1, 3)
    corners = torch.cartesian_prod(*[torch.tensor([-REACH, REACH])] * 3)
    return path, turned, around + corners


def sheet_moments(frames: int, count: int) -> list[int]:
    """Frames on a contact sheet of `count` pictures, spread evenly over `frames`."""
    return sorted(set(np.linspace(0, frames - 1, count).round().astype(int).tolist()))


def sheet_interval(frames: int, coarse: bool) -> int:
    """Least number of frames from one picture to the next on a contact sheet of `frames` frames."""
    return max(1, (frames - 1) // picture_settings(SHEETS[0], coarse).on_sheet)


class Pictures:
    """Drawing of frames one by one: all of them into a video, or some onto a contact sheet.

    motion: (F, J, 3, 4), the joint transforms of all frames, from which the camera's path is made. A video
    leaves out a last frame that is the first one again, since players begin anew after it. Raises InputError
    for a video if PyAV is not installed, and if its width or height is odd.
    """

    def __init__(
        self,
        partial: Path,
        garments: Sequence[tuple[str, Mesh]],
        body: Body,
        fps: float,
        motion: Tensor,
        coarse: bool,
        shot: Shot = USUAL,
    ) -> None:
        suffix = partial.suffix.lower()
        self._settings = picture_settings(suffix, coarse)
        if shot.size:
            self._settings = replace(self._settings, size=shot.size)
        elif suffix in SHEETS:
            _, _, points = _followed(body, motion.cpu(), fps, shot.camera)
            size = filled_size(points, self._settings.size, TURNS.get(shot.camera, ASIDE))
            self._settings = replace(self._settings, size=size)
        self._faces, self._body = [mesh.faces for _, mesh in garments], body
        width, height = self._settings.size
        if suffix in VIDEOS and (width % 2 or height % 2):
            raise InputError(f"--size {width}x{height}: videos have even widths and heights")
        self._cameras = camera_path(body, motion.cpu(), fps, width / height, shot.camera)
        self._moments = None if suffix in VIDEOS else set(sheet_moments(len(motion), self._settings.on_sheet))
        self._video = open_video(partial, self._settings.size, fps) if suffix in VIDEOS else None
        repeats = self._video is not None and len(motion) > 2 and torch.equal(motion[-1], motion[0])
        self._partial, self._frame, self._end = partial, 0, len(motion) - repeats
        self._sheet: list[np.ndarray] = []

    def add(self, vertices: Sequence[np.ndarray], transforms: np.ndarray) -> None:
        """Draw B frames: per garment (B, N, 3) m, and (B, J, 3, 4)."""
        for offset, joints in enumerate(torch.from_numpy(transforms)):
            if self._frame < self._end if self._moments is None else self._frame in self._moments:
                picture = self._draw([values[offset] for values in vertices], joints)
                if self._video is not None:
                    self._video.add(picture)
                else:
                    self._sheet.append(picture)
            self._frame += 1

    def hide(self, faces: Tensor) -> None:
        """Do nothing: the frames are drawn already."""

    def finish(self, path: Path) -> None:
        """Write the result. Raises OSError if the disk is full."""
        if self._video is not None:
            self._video.close()
            self._partial.replace(path)
        else:
            write_png(path, contact_sheet(self._sheet, min(SHEET_COLUMNS, len(self._sheet))))

    def discard(self) -> None:
        """Close open files."""
        if self._video is not None:
            self._video.discard()

    def _draw(self, vertices: Sequence[np.ndarray], joints: Tensor) -> np.ndarray:
        return render(
            list(self._surfaces(vertices, joints)),
            self._cameras[self._frame],
            self._settings.size,
            quality=self._settings.quality,
        )

    def _surfaces(self, vertices: Sequence[np.ndarray], joints: Tensor) -> Iterator[Surface]:
        body = self._body
        yield Surface(posed_skin(body, joints[None])[0], body.mesh.faces, BODY_COLOR)
        for index, (values, faces) in enumerate(zip(vertices, self._faces, strict=True)):
            yield Surface(torch.from_numpy(values), faces, GARMENT_COLORS[index % len(GARMENT_COLORS)])
