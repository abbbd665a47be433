"""Which simulated windows are judged, and what their actions are called."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rasterize.errors import InputError
from uvcloth.garments.templates import TEMPLATES
from uvcloth.simulate.index import INDEX, read_index


@dataclass(frozen=True)
class Window:
    """One simulated garment over one unseen clip.

    path: its sequence. repeat: the same window simulated from an earlier start, or None where there is none.
    """

    action: str
    clip: str
    template: str
    path: Path
    repeat: Path | None

    @property
    def name(self) -> str:
        return f"{self.clip}_{self.template}"


def find_windows(data: Path, actions: Sequence[str] = ()) -> tuple[Window, ...]:
    """The test windows of a data folder made by `uvcloth simulate`, in the order of its index.

    DATA/index.csv names the test clips and their actions; without one every
    sequence counts and its clip is its action. actions: keep only these, all if empty. Raises InputError if
    the folder, the index or an action is missing, or nothing was simulated.
    """
    data = Path(data)
    if not data.is_dir():
        raise InputError(f"{data}: no such folder, expected one made by `uvcloth simulate`")
    index = data / INDEX
    named = _test_clips(index) if index.is_file() else _simulated_clips(data)
    known = list(dict.fromkeys(named.values()))
    for action in actions:
        if action not in known:
            raise InputError(
                f"{data}: no test action is called {action!r}, expected one of {', '.join(known)}"
            )
    windows = tuple(
        Window(action, clip, template, path, repeat if repeat.is_file() else None)
        for clip, action in named.items()
        if not actions or action in actions
        for template in TEMPLATES
        for path, repeat in [(data / f"{clip}_{template}.npz", data / "repeat" / f"{clip}_{template}.npz")]
        if path.is_file()
    )
    if not windows:
        raise InputError(f"{data}: holds no simulated test window (CLIP_GARMENT.npz) for {', '.join(known)}")
    return windows


def _test_clips(index: Path) -> dict[str, str]:
    clips = {entry.clip: entry.action for entry in read_index(index).values() if entry.split == "test"}
    if not clips:
        raise InputError(f"{index}: no row has the split test")
    return clips


def _simulated_clips(data: Path) -> dict[str, str]:
    stems = sorted(path.stem for path in data.glob("*.npz"))
    clips = [stem.rpartition("_")[0] for stem in stems if stem.rpartition("_")[2] in TEMPLATES]
    if not clips:
        raise InputError(f"{data}: holds no simulated sequence (CLIP_GARMENT.npz)")
    return {clip: clip for clip in clips}
