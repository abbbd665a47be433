"""The part of a data folder that is judged: its cases, all on one body, or of outfits on their own bodies."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import folder_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import read_metadata
from uvcloth.dataset.reader import read_outfit_clips
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.loading import load_garment_for_data
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.garments.untangling import untangle

from .actions import Window, find_missing, find_windows, people_in
from .case import Case, make_case, open_case, outfit_name, simulated_together
from .maps import garment_map


@dataclass(frozen=True)
class Selection:
    """The part of a data folder that is judged.

    actions: only these, all if empty. files: garments other than the templates. frames: of each window, None
    for all. split: test, or validation to choose by. map_size: of the maps that are measured.
    """

    data: Path
    actions: Sequence[str] = ()
    files: Sequence[str] = ()
    frames: int | None = None
    split: str = "test"
    map_size: int = 256


@dataclass(frozen=True)
class Opener:
    """A case that is not in memory: the name of its outfit, its windows, and the function that loads it."""

    outfit: str
    windows: tuple[Window, ...]
    load: Callable[[], Case]


@dataclass(frozen=True)
class Cases:
    """The cases of a selection.

    outfits: by name, all on bodies of one skeleton. openers: of each case. people: subjects by clip.
    missing: windows without a sequence, see `find_missing`. map_size: of the maps that are measured, 0 for
    none. one_body: whether all are on the same body.
    """

    data: Path
    split: str
    outfits: Mapping[str, Outfit]
    openers: Sequence[Opener]
    people: Mapping[str, str]
    missing: Mapping[str, Mapping[str, str]]
    map_size: int
    one_body: bool

    @property
    def body(self) -> Body:
        """The body, or that of the first outfit."""
        return next(iter(self.outfits.values())).body

    @property
    def body_name(self) -> str:
        """The body in words."""
        bodies = {outfit.body.name for outfit in self.outfits.values()}
        return self.body.name if self.one_body else f"their own ({len(bodies)})"


def find_cases(selection: Selection) -> Cases:
    """Find what a selection has to judge.

    Raises InputError for data that do not fit, for a file that is no sequence, and if there is nothing to
    judge.
    """
    if _holds_outfits(selection.data):
        return _cases_of_outfits(selection)
    return cases_on(folder_body(selection.data), selection)


def cases_on(body: Body, selection: Selection) -> Cases:
    """The cases of templates and garment files that were simulated on a body.

    Raises InputError as `find_windows` and `open_case` do, and for a garment file without a sequence.
    """
    data, split = selection.data, selection.split
    others = load_garment_files(selection.files, body)
    query = (data, selection.actions, (*TEMPLATES, *others), split)
    windows = find_windows(*query)
    names = dict.fromkeys(window.garment for window in windows)
    for name in others:
        if name not in names:
            raise InputError(f"{data}: holds no {split} sequence of the garment {name} (CLIP_{name}.npz)")
    garments = {name: others[name] if name in others else fit_template(name, body) for name in names}
    texels = {name: garment_map(garment, body, selection.map_size) for name, garment in garments.items()}
    outfits: dict[str, Outfit] = {}
    # The scene of the first case of an outfit is also turned.
    begun: set[str] = set()
    openers = []
    for case in simulated_together(windows):
        name = outfit_name([window.garment for window in case])
        if name not in outfits:
            # As simulations of layers begin: garments that cross are untangled.
            worn = untangle([garments[window.garment] for window in case], body)
            outfits[name] = Outfit(body, worn.garments)
        load = partial(open_case, case, outfits[name], texels, selection.frames, turned=name not in begun)
        begun.add(name)
        openers.append(Opener(name, case, load))
    return Cases(
        data, split, outfits, openers, people_in(data), find_missing(*query), selection.map_size, True
    )


def _cases_of_outfits(selection: Selection) -> Cases:
    """The cases of outfits on bodies of their own; garments are named by type, so that figures are by type.

    No maps are measured. Raises InputError as `read_outfit_clips` does.
    """
    data, split = selection.data, selection.split
    if selection.files:
        raise InputError(f"{data}: contains random outfits, --garment is not allowed")
    pairs = read_outfit_clips(data, (split,))
    outfits: dict[str, Outfit] = {}
    openers: list[Opener] = []
    for outfit, clip in pairs:
        if not selection.actions or clip.action in selection.actions:
            windows, typed, renamed = _by_type(data, outfit, clip)
            name = "+".join(window.path.stem for window in windows)
            outfits[name] = typed
            first = not openers
            load = partial(make_case, windows, renamed, typed, {}, selection.frames, turned=first)
            openers.append(Opener(name, windows, load))
    if not openers:
        known = ", ".join(dict.fromkeys(clip.action for _, clip in pairs))
        raise InputError(f"{data}: no {split} action is called {selection.actions[0]!r}, expected {known}")
    people = {clip.name: clip.subject for _, clip in pairs}
    return Cases(data, split, outfits, openers, people, {}, 0, False)


def _holds_outfits(data: Path) -> bool:
    """Test for a folder of outfits on bodies of their own, as `uvcloth simulate --outfits` makes it.

    Raises InputError for a file that is no sequence.
    """
    return any("outfit" in read_metadata(path) for path in sorted(data.glob("*.npz"))[:1])


def _by_type(
    data: Path, outfit: Outfit, clip: SimulatedClip
) -> tuple[tuple[Window, ...], Outfit, SimulatedClip]:
    """Windows, outfit and clip of garments that are named by their types, numbered from the second one on."""
    kinds = [clip.kind(garment.name) for garment in clip.garments]
    counts = [kinds[: index + 1].count(kind) for index, kind in enumerate(kinds)]
    names = [kind if count == 1 else f"{kind} {count}" for kind, count in zip(kinds, counts, strict=True)]
    windows = tuple(
        Window(clip.action, clip.name, clip.subject, name, data / file)
        for name, file in zip(names, clip.files, strict=True)
    )
    garments = tuple(replace(each, name=name) for each, name in zip(outfit.garments, names, strict=True))
    simulated = tuple(replace(each, name=name) for each, name in zip(clip.garments, names, strict=True))
    return windows, replace(outfit, garments=garments), replace(clip, garments=simulated)


def load_garment_files(files: Sequence[str], body: Body) -> dict[str, Garment]:
    """Garments from files, templates left out, by the names that their sequences have.

    Raises InputError also if two have one name.
    """
    garments: dict[str, Garment] = {}
    for file in files:
        garment = load_garment_for_data(file, body, print)
        if garment.name in garments:
            raise InputError(f"garment {file}: another one is also named {garment.name}")
        garments[garment.name] = garment
    return {name: garment for name, garment in garments.items() if name not in TEMPLATES}
