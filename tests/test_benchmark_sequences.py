"""The packed sequences in `benchmarks/sequences`: they unpack here as where they were packed."""

from functools import partial
from pathlib import Path

import torch

from uvcloth.bodies.body import load_body
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.skinning import skin
from uvcloth.motion.index import read_index
from uvcloth.physics.energies import edge_change
from uvcloth.simulate.packed import load_mesh, load_packed

FOLDER = Path(__file__).parent.parent / "benchmarks" / "sequences"
TEMPLATES = ("tops", "bottoms", "dress")


def test_a_sequence_is_cloth_on_a_body() -> None:
    """One garment's: a file that does not unpack to what was packed is refused, with any LAPACK."""
    garment = load_garment("bottoms", load_body())
    sequence = load_packed(FOLDER / "26_01_bottoms.npz", partial(load_mesh, FOLDER), {})
    assert torch.equal(sequence.faces, garment.mesh.faces)
    torch.testing.assert_close(sequence.rest, garment.mesh.vertices)
    scored = slice(sequence.warm_up, None, 10)
    skinned = skin(sequence.rest, garment.smooth_weights, sequence.transforms[scored])
    apart = (sequence.vertices[scored] - skinned).norm(dim=-1)
    assert 0.005 < float(apart.mean()) < 0.05
    assert float(edge_change(sequence.vertices[scored], sequence.rest, sequence.faces).mean()) < 1.5e-3


def test_every_template_has_every_clip_and_nobody_is_in_two_splits() -> None:
    index = read_index(FOLDER / "index.csv")
    names = {path.name for path in FOLDER.glob("*.npz")}
    clips = {name.rpartition("_")[0] for name in names}
    assert clips <= index.keys()
    splits = {
        split: {index[clip].subject for clip in clips if index[clip].split == split}
        for split in ("train", "validation", "test")
    }
    assert all(splits.values())
    assert sum(map(len, splits.values())) == len(set.union(*splits.values()))
    assert len(names) > 2 * len(clips)
    assert {path.stem for path in (FOLDER / "meshes").glob("*.npz")} == set(TEMPLATES)
