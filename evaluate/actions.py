"""The simulated windows of a split, by action, and those that are missing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from uvcloth.dataset.clip_file import read_metadata
from uvcloth.dataset.folder import Stored, refused_captures, rejected
from uvcloth.errors import InputError
from uvcloth.garments.templates import TEMPLATES
from uvcloth.motion.index import INDEX, read_index


@dataclass(frozen=True)
class Window:
    """One garment over one unseen clip.

    subject: the captured person, "" if unknown. path: its sequence, there or not.
    """

    action: str
    clip: str
    subject: str
    garment: str
    path: Path

    @property
    def name(self) -> str:
        """Clip and garment."""
        return f"{self.clip}_{self.garment}"


def find_windows(
    data: Path, actions: Sequence[str] = (), garments: Sequence[str] = TEMPLATES, split: str = "test"
) -> tuple[Window, ...]:
    """The windows of a split in a data folder made by `uvcloth simulate`, in the order of its index.

    split: test or validation. DATA/index.csv names its clips and their actions; without one every sequence
    is a test sequence and its clip is its action. actions: keep only these, all if empty. garments: names of
    the garments to find. Raises InputError if the folder, the index or an action is missing, or nothing was
    simulated.
    """
    wanted = _wanted(Path(data), actions, garments, split)
    windows = tuple(window for window in wanted if window.path.is_file())
    if not windows:
        named = ", ".join(dict.fromkeys(window.action for window in wanted))
        raise InputError(f"{data}: holds no simulated {split} window (CLIP_GARMENT.npz) for {named}")
    return windows


def find_missing(
    data: Path, actions: Sequence[str] = (), garments: Sequence[str] = TEMPLATES, split: str = "test"
) -> dict[str, dict[str, str]]:
    """The windows of a split without a sequence: {action: {garment: reason}}.

    A garment that has no simulation of any clip, finished or refused, is left out. Raises InputError as
    find_windows does.
    """
    everything = _wanted(Path(data), (), garments, split)
    tried = {w.garment for w in everything if w.path.is_file() or rejected(w.path).is_file()}
    captures = refused_captures(Path(data))
    missing: dict[str, dict[str, str]] = {}
    for window in _wanted(Path(data), actions, garments, split):
        if window.garment in tried and not window.path.is_file():
            reasons = missing.setdefault(window.action, {})
            known = f"{reasons[window.garment]}; " if window.garment in reasons else ""
            reasons[window.garment] = known + _why(window, captures)
    return missing


def _why(window: Window, captures: Mapping[str, str]) -> str:
    """The reason that a window has no sequence. captures: by clip, the reason that it was refused."""
    apart = rejected(window.path)
    if apart.is_file():
        return str(Stored(apart, read_metadata(apart)).reason)
    return captures.get(window.clip, "not simulated")


def people_in(data: Path) -> dict[str, str]:
    """The subject of each clip, by the index of a data folder; empty without one."""
    index = Path(data) / INDEX
    return {clip: entry.subject for clip, entry in read_index(index).items()} if index.is_file() else {}


def _wanted(data: Path, actions: Sequence[str], garments: Sequence[str], split: str) -> list[Window]:
    """Every clip of the actions in a split with every garment, simulated or not."""
    if not data.is_dir():
        raise InputError(f"{data}: no such folder, expected one made by `uvcloth simulate`")
    index = data / INDEX
    if not index.is_file() and split != "test":
        raise InputError(f"{data}: has no {INDEX}, which is needed to find the clips for {split}")
    named = _clips_of(index, split) if index.is_file() else _simulated_clips(data, garments)
    people = people_in(data)
    known = list(dict.fromkeys(named.values()))
    for action in actions:
        if action not in known:
            raise InputError(
                f"{data}: no {split} action is called {action!r}, expected one of {', '.join(known)}"
            )
    return [
        Window(action, clip, people.get(clip, ""), garment, data / f"{clip}_{garment}.npz")
        for clip, action in named.items()
        if not actions or action in actions
        for garment in garments
    ]


def _clips_of(index: Path, split: str) -> dict[str, str]:
    """The action of each clip of a split by the index. Raises InputError if it has none."""
    clips = {entry.clip: entry.action for entry in read_index(index).values() if entry.split == split}
    if not clips:
        raise InputError(f"{index}: no row has the split {split}")
    return clips


def _simulated_clips(data: Path, garments: Sequence[str]) -> dict[str, str]:
    """Clips by the names of sequence files, each as its own action. Raises InputError if there are none."""
    longest_first = sorted(garments, key=len, reverse=True)
    clips = []
    for stem in sorted(path.stem for path in data.glob("*.npz")):
        ends = (f"_{garment}" for garment in longest_first)
        clips += [stem.removesuffix(end) for end in ends if stem.endswith(end)][:1]
    if not clips:
        named = ", ".join(garments)
        raise InputError(f"{data}: holds no simulated sequence (CLIP_GARMENT.npz) of {named}")
    return {clip: clip for clip in clips}
