"""Blind comparison by people: one page of pairs of clips side by side, in random order, without names."""

import base64
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.geometry.mesh import join_meshes
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Surface, render
from uvcloth.rollouts.rollout import prepare_rollout
from uvcloth.writers.pictures import camera_path
from uvcloth.writers.video import open_video

from .candidates import SIMULATION, Candidate
from .case import Case
from .compare import entrants_of
from .familiar import Entrant
from .judge import rolled_out
from .predicted import Prediction, played
from .progress import progress
from .selection import Cases

PAGE = "blind.html"
FORMAT = "uvcloth-blind-1"
TEMPLATES = Path(__file__).with_name("templates")

SECONDS = 3.0
"""Most seconds of a clip."""

SIZE = (320, 480)
"""Width and height of a clip in pixels."""


@dataclass(frozen=True)
class Film:
    """The same window by one method. video: an MP4 file."""

    window: str
    method: str
    video: bytes


def write_blind(
    candidates: Sequence[Candidate],
    predictions: Sequence[Prediction],
    cases: Cases,
    out: Path,
) -> Path:
    """Write OUT/blind.html of methods and the simulation on all cases; returns its path.

    Raises InputError as `compare` does, and if there is no pair.
    """
    films: list[Film] = []
    entrants = entrants_of(candidates, predictions, cases)
    with progress("Films", sum(1 + len(each) for _, each in entrants)) as tick:
        for opener, each in entrants:
            case = opener.load()
            for name, garments in _dressed(case, each):
                films.append(Film(case.name, name, filmed(case, garments[: round(SECONDS * case.fps)])))
                tick(note=f"{case.name}: {name}")
    return write_page(out / PAGE, films)


def write_page(path: Path, films: Sequence[Film]) -> Path:
    """Write the page of some films; returns its path. Raises InputError if there is no pair."""
    pairs = draw_pairs(films)
    if not pairs:
        raise InputError("--blind: there is only one method, nothing to compare it with")
    videos = [base64.b64encode(film.video).decode("ascii") for film in films]
    listed = [
        {
            "window": films[one].window,
            "clips": [one, other],
            "methods": [films[one].method, films[other].method],
        }
        for one, other in pairs
    ]
    page = (TEMPLATES / "blind.html").read_text(encoding="utf-8")
    content = json.dumps({"format": FORMAT, "pairs": listed, "videos": videos}).replace("<", "\\u003c")
    with atomic_write(path) as partial:
        partial.write_text(page.replace("{{ content }}", content), encoding="utf-8")
    return path


def draw_pairs(films: Sequence[Film]) -> list[tuple[int, int]]:
    """Pairs of films of the same window, by place.

    In each window the methods form a random ring, so that each is in two pairs of different others, and all
    are compared with all, over others.
    """
    generator = np.random.default_rng(0)
    pairs: list[tuple[int, int]] = []
    for window in dict.fromkeys(film.window for film in films):
        ring = generator.permutation([k for k, film in enumerate(films) if film.window == window]).tolist()
        # Two methods make one pair, not two.
        pairs += zip(ring, [*ring[1:], *ring[: len(ring) > 2]], strict=False)
    return pairs


def filmed(case: Case, garments: Tensor) -> bytes:
    """An MP4 of garments (F, N, 3) m, all as one, on the body of a case."""
    body = case.outfit.body
    meshes = [(garment.mesh.vertices, garment.mesh.faces) for garment in case.outfit.garments]
    faces = join_meshes(meshes).faces
    colors = torch.cat(
        [
            torch.tensor(GARMENT_COLORS[place % len(GARMENT_COLORS)]).expand(len(vertices), 3)
            for place, (vertices, _) in enumerate(meshes)
        ]
    )
    # The same cameras for all methods: they follow the body.
    cameras = camera_path(body, case.transforms[: len(garments)], case.fps, SIZE[0] / SIZE[1])
    pictures = (
        render([Surface(skin, body.mesh.faces, BODY_COLOR), Surface(cloth, faces, colors)], camera, SIZE)
        for skin, cloth, camera in zip(case.body_vertices, garments, cameras, strict=False)
    )
    return video_of(pictures, case.fps)


def video_of(pictures: Iterable[np.ndarray], fps: float) -> bytes:
    """An MP4 of pictures (480, 320, 3) uint8."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        video = open_video(path, SIZE, fps)
        for picture in pictures:
            video.add(picture)
        video.close()
        return path.read_bytes()


def _dressed(case: Case, entrants: Sequence[Entrant]) -> Iterator[tuple[str, Tensor]]:
    """Yield the name of the simulation and of each method, with its garments (F, N, 3) m, finished."""
    yield SIMULATION, case.truth
    for entrant in entrants:
        method = (
            played(case, entrant, entrant.folder) if isinstance(entrant, Prediction) else entrant
        ).method
        yield entrant.name, rolled_out(case, prepare_rollout(method, case.outfit))[1]
