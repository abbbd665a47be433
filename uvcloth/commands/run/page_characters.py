"""Characters of a web page: baked files, and other ways to move their garments beside them."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uvcloth.commands.run.page_methods import PageMethod
from uvcloth.errors import InputError
from uvcloth.player.baked import BakedFile, open_baked
from uvcloth.player.outfit import Outfit
from uvcloth.player.worn import without_others

SHOWN = {"dress": ("dress",), "trousers and shirt": ("bottoms", "tops")}
"""Garments of the files that are baked where none is given, on our own body."""

CLIPS = ("walk", "twirl", "jump", "dance")
"""Built-in clips that are the animations of these files."""


AS_BAKED = "as it was baked"
"""What the page calls the quality of a file that it has in no other."""

MOST_LAYERS = 3
"""Garments of a file up to which the page has an outfit for each set of them, of 0.4 to 0.6 MB."""


@dataclass(frozen=True)
class PageCharacter:
    """A baked file, and what the page has beside its cloth. name: of the file on the page."""

    name: str
    content: bytes
    methods: tuple[PageMethod, ...] = ()

    def file_of(self, method: PageMethod) -> str:
        """Name of a method's file on the page."""
        return f"{self.name.removesuffix('.glb')}.{self.methods.index(method)}.bin"

    @property
    def files(self) -> dict[str, bytes]:
        """Files by name: the baked one, and those of its methods."""
        beside = {
            self.file_of(method): method.content for method in self.methods if method.content is not None
        }
        return {self.name: self.content, **beside}


def load_characters(paths: Sequence[Path], fast: Sequence[Path]) -> tuple[PageCharacter, ...]:
    """The characters of baked files, checked to be whole. fast: the same ones in fast quality, or none.

    Raises InputError for files that are not baked or damaged, two of one name, fast ones of another number,
    and one that is of other joints or garments.
    """
    if fast and len(fast) != len(paths):
        raise InputError(f"--fast: {len(fast)} files, expected one for each of the {len(paths)} of the page")
    characters: dict[str, PageCharacter] = {}
    for place, path in enumerate(paths):
        if path.name in characters:
            raise InputError(f"page: {path.name} is there twice; a page has one file of a name")
        baked = open_whole(path)
        methods = _fewer(AS_BAKED, baked)
        if fast:
            other = open_whole(fast[place])
            _require_same(other, baked)
            qualities = (PageMethod("default", "baked"), PageMethod("fast", "outfit", other.content))
            methods = (*qualities, *_fewer("default", baked), *_fewer("fast", other))
        characters[path.name] = PageCharacter(path.name, path.read_bytes(), methods)
    return tuple(characters.values())


def _fewer(quality: str, baked: BakedFile) -> tuple[PageMethod, ...]:
    """Outfits with some of the garments of a file; none where there are more than `MOST_LAYERS`."""
    garments = range(len(baked.garments))
    if len(garments) > MOST_LAYERS:
        return ()
    sets = chain.from_iterable(combinations(garments, count) for count in garments if count)
    return tuple(
        PageMethod(quality, "fewer", without_others(baked.content, worn), worn=worn) for worn in sets
    )


def open_whole(path: Path, animated: bool = True) -> BakedFile:
    """A baked file. animated: with an animation. Raises InputError for one that is damaged, or none."""
    try:
        baked = open_baked(path)
        outfit = Outfit(baked.content)
        baked.require_fit(outfit.joints, outfit.garments)
        if animated:
            baked.motion()
    except ValueError as error:
        raise InputError(str(error)) from error
    return baked


def _require_same(other: BakedFile, baked: BakedFile) -> None:
    same = other.skin.names == baked.skin.names and [garment.size for garment in other.garments] == [
        each.size for each in baked.garments
    ]
    if not same:
        raise InputError(f"--fast {other.file.path}: has other joints or garments than {baked.file.path}")


def bake_own() -> tuple[PageCharacter, ...]:
    """Our own body in some garments, in default and fast quality and as a recurrent rig, with some clips."""
    from uvcloth.commands.bake import Bake
    from uvcloth.commands.run.bake import bake
    from uvcloth.commands.run.page_models import recurrent_of

    with tempfile.TemporaryDirectory(prefix="uvcloth-page-") as folder:
        paths = {name: Path(folder) / f"{name}.glb" for name in SHOWN}
        fast = {name: Path(folder) / f"{name}.fast.glb" for name in SHOWN}
        for name, garments in SHOWN.items():
            bake(Bake(garments, paths[name]))
            bake(Bake(garments, fast[name], quality="fast"))
            for path in (paths[name], fast[name]):
                add_clips(path, CLIPS)
        characters = load_characters(tuple(paths.values()), tuple(fast.values()))
    return tuple(
        replace(character, methods=(*character.methods, recurrent_of(garments)))
        for character, garments in zip(characters, SHOWN.values(), strict=True)
    )


def add_clips(path: Path, clips: Sequence[str]) -> None:
    """Add built-in clips to a baked file of our own body, behind its animations."""
    import torch

    from uvcloth.bodies.body import load_body
    from uvcloth.motion.library import load_clip

    body = load_body()
    loaded = {name: load_clip(name, body) for name in clips}
    add_animations(
        path, {name: (clip.transforms(torch.float64).numpy(), clip.fps) for name, clip in loaded.items()}
    )


def add_animations(path: Path, animations: Mapping[str, tuple[NDArray[np.float64], float]]) -> None:
    """Add animations to a baked file, behind its own: transforms (F, J, 3, 4) from rest, m, and their fps."""
    from uvcloth.formats.gltf import read_gltf
    from uvcloth.writers.gltf_cloth import animate_cloth
    from uvcloth.writers.gltf_reopened import reopened

    skin, document = open_baked(path).skin, reopened(read_gltf(path))
    for name, (transforms, fps) in animations.items():
        animate_cloth(document, skin, transforms, fps)
        animation = {"name": name, "samplers": document.samplers, "channels": document.channels}
        document.animations.append(animation)
        document.samplers, document.channels = [], []
    document.write(path)
