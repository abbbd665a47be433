from dataclasses import replace
from pathlib import Path

import pytest

from uvcloth.errors import InputError
from uvcloth.writers.animation import Animation
from uvcloth.writers.size import announce, expected_bytes
from uvcloth.writers.writer import WRITERS


@pytest.mark.parametrize("suffix", [".glb", ".pc2", ".abc"])
def test_the_size_is_known_beforehand(animation: Animation, tmp_path: Path, suffix: str) -> None:
    """Of the frames alone: of two lengths of a clip, so that the meshes at rest do not count."""
    sizes = []
    for count in (10, 40):
        frames = tuple(values[:count] for values in animation.vertices)
        part = replace(animation, vertices=frames, transforms=animation.transforms[:count])
        folder = tmp_path / str(count)
        folder.mkdir()
        WRITERS[suffix](part, folder / f"walk{suffix}")
        sizes.append(sum(path.stat().st_size for path in folder.glob(f"*{suffix}")))
    expected = [expected_bytes(suffix, count, animation.meshes, animation.body) for count in (10, 40)]
    assert sizes[1] - sizes[0] == pytest.approx(expected[1] - expected[0], rel=0.1)


def test_a_large_file_is_announced_with_what_is_smaller(animation: Animation) -> None:
    meshes = animation.meshes
    assert announce(Path("walk.glb"), 100, meshes, animation.body) == ""
    sentence = announce(Path("walk.glb"), 6000, meshes, animation.body)
    assert sentence.startswith("walk.glb: will take about")
    assert ".usdc (" in sentence
    with pytest.raises(InputError, match=r"walk\.glb: 90000 frames would take .* GB and a \.glb holds 4\.3"):
        announce(Path("walk.glb"), 90000, meshes, animation.body)
