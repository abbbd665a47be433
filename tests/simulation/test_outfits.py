"""Made outfits are dealt windows of their split, each on its own body, and read again as one."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest
import torch

from uvcloth.bodies.body import Body, save_body
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import load_simulated, save_simulated
from uvcloth.dataset.reader import read_outfit_clips
from uvcloth.errors import InputError
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.physics.fabric import FABRICS, Fabric
from uvcloth.simulation import batch
from uvcloth.simulation.explicit import Explicit
from uvcloth.simulation.options import SimulationOptions
from uvcloth.simulation.outfits import simulate_outfits
from uvcloth.simulation.plan import ClipSelection, Job
from uvcloth.wardrobe.designs import KINDS, PARTS, Design, limits
from uvcloth.wardrobe.outfit_file import OutfitFile, PieceFile, save_outfit_file
from uvcloth.writers.obj import save_obj

WINDOWS = """trial,subject,split,action,window_start,window_frames
walk,ann,train,walk,20,40
run,bob,train,run,0,50
jump,cid,test,jump,10,40
"""


@pytest.fixture(scope="module")
def wardrobe(body: Body, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three outfits for training, one of two pieces, and one for the test."""
    folder = tmp_path_factory.mktemp("wardrobe")
    save_body(body, folder / "bodies" / "b01.npz")
    meshes = {name: fit_template(name, body).mesh for name in ("tops", "bottoms")}
    for number, (split, kinds) in enumerate(
        [
            ("train", ("tshirt",)),
            ("train", ("trousers", "tshirt")),
            ("train", ("trousers",)),
            ("test", ("top",)),
        ]
    ):
        name = f"o{number:04d}"
        pieces = []
        for kind in kinds:
            mesh = meshes["bottoms" if kind == "trousers" else "tops"]
            middle = {part: {k: sum(v) / 2 for k, v in limits(PARTS[part]).items()} for part in KINDS[kind]}
            file = folder / f"{name}_{kind}.obj"
            save_obj(mesh, file)
            pieces.append(PieceFile(file, Design.of(kind, middle), len(mesh.vertices)))
        save_outfit_file(
            OutfitFile(
                path=folder / f"{name}.json",
                name=name,
                split=split,
                body=folder / "bodies" / "b01.npz",
                seed=0,
                pieces=tuple(pieces),
                fabric_name="jersey",
                fabric=Fabric(density=0.3 if len(kinds) == 2 else 0.2),
                tightness=0.5,
                even=True,
                seams=False,
                vertex_range=(1000, 8000),
            )
        )
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the sequences."""
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="module")
def jobs(wardrobe: Path, out: Path) -> list[Job]:
    """The jobs of a batch, whose garments are simply skinned in the place of a simulation."""
    made: list[Job] = []

    def skinned(todo: Iterable[Job], *_: Any) -> None:
        for job in todo:
            made.append(job)
            _store_skinned(job)

    (out / "windows.csv").write_text(WINDOWS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "simulate_all", skinned)
        for _ in range(2):
            simulate_outfits(wardrobe, _selection(out), out, frames=25)
    return made


def _selection(folder: Path) -> ClipSelection:
    return ClipSelection(("walk", "run", "jump"), folder / "windows.csv")


def _store_skinned(job: Job) -> None:
    transforms = job.motion.window(0, 3).transforms()
    for cloth, target in zip(job.cloths, job.targets, strict=True):
        garment = cloth.garment
        metadata = {"clip": job.motion.name, "garment": garment.name, "body": job.body.name, **job.labels}
        metadata |= {"template": garment.template, "body_hash": job.body.identity.shape}
        if len(job.cloths) > 1:
            metadata["layers"] = [each.garment.name for each in job.cloths]
        save_simulated(
            clip_of_garment(
                skin(garment.mesh.vertices, garment.smooth_weights, transforms),
                garment.mesh.faces,
                garment.mesh.vertices,
                transforms,
                30.0,
                1,
                metadata,
            ),
            target,
        )


def test_windows_of_a_split_are_dealt_to_its_outfits(jobs: list[Job]) -> None:
    dealt = [(job.labels["outfit"], job.motion.name, job.labels["subject"]) for job in jobs]
    assert dealt == [
        ("o0000", "walk", "ann"),
        ("o0001", "run", "bob"),
        ("o0002", "walk", "ann"),
        ("o0003", "jump", "cid"),
    ]
    assert [len(job.cloths) for job in jobs] == [1, 2, 1, 1]
    assert [len(job.motion) - job.warm_up for job in jobs] == [25] * 4
    assert [job.warm_up for job in jobs] == [15, 0, 15, 10]


def test_each_outfit_is_of_its_own_fabric(jobs: list[Job]) -> None:
    assert [job.fabric for job in jobs] == [Fabric(), Fabric(density=0.3), Fabric(), Fabric()]


def test_one_fabric_for_all_is_that_of_each(
    wardrobe: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Job] = []
    monkeypatch.setattr(batch, "simulate_all", lambda todo, *_: made.extend(todo))
    (tmp_path / "windows.csv").write_text(WINDOWS)
    simulate_outfits(
        wardrobe, _selection(tmp_path), tmp_path / "out", 25, options=SimulationOptions(fabric="silk")
    )
    assert {job.fabric for job in made} == {FABRICS["silk"]}
    assert {job.labels["fabric"] for job in made} == {"silk"}


def test_data_of_another_fabric_than_the_outfit_are_refused(
    wardrobe: Path, jobs: list[Job], out: Path, tmp_path: Path
) -> None:
    assert jobs
    copytree(out, tmp_path / "out")
    for path in (tmp_path / "out").glob("*.npz"):
        sequence = load_simulated(path)
        made_by = Explicit(fabric=Fabric(density=0.3 if "o0001" in path.name else 0.2)).describe()
        save_simulated(sequence.labelled(**made_by), path)
    simulate_outfits(wardrobe, _selection(out), tmp_path / "out", 25)
    with pytest.raises(InputError, match=r"jump_o0003_top\.npz: was .* \(density 0\.2 instead of 0\.08,"):
        simulate_outfits(
            wardrobe, _selection(out), tmp_path / "out", 25, options=SimulationOptions(fabric="silk")
        )


def test_outfits_are_read_again_with_their_bodies(jobs: list[Job], out: Path, body: Body) -> None:
    found = read_outfit_clips(out, ("train",))
    assert [(c.outfit, c.name, [c.kind(g.name) for g in c.garments]) for _, c in found] == [
        ("o0000", "walk", ["tshirt"]),
        ("o0001", "run", ["trousers", "tshirt"]),
        ("o0002", "walk", ["trousers"]),
    ]
    outfit, both = found[1]
    sizes = [len(cloth.garment.mesh.vertices) for cloth in jobs[1].cloths]
    assert [len(garment.rest) for garment in both.garments] == sizes
    assert torch.equal(outfit.body.mesh.vertices, body.mesh.vertices)
    expected = [
        skin(g.mesh.vertices, g.smooth_weights, both.transforms) for g in (c.garment for c in jobs[1].cloths)
    ]
    assert (both.vertices - torch.cat(expected, dim=1)).norm(dim=-1).max() < 1e-4


def test_a_fabric_that_is_none_is_refused(jobs: list[Job], out: Path, tmp_path: Path) -> None:
    assert jobs
    copytree(out, tmp_path / "out")
    path = tmp_path / "out" / "walk_o0002_trousers.npz"
    sequence = load_simulated(path)
    for fabric, reason in (
        ({"density": 1e9}, "the fabric's density is 1000000000.0, expected 0.01 to 2"),
        ({"colour": 1.0}, "'colour' is not a property of a fabric"),
        ("silk", "the settings, fabric"),
    ):
        save_simulated(sequence.labelled(settings={"fabric": fabric}), path)
        with pytest.raises(InputError, match=rf"walk_o0002_trousers\.npz: {reason}"):
            read_outfit_clips(tmp_path / "out", ("train",))


def test_a_sequence_without_its_layer_is_refused(jobs: list[Job], out: Path, tmp_path: Path) -> None:
    assert jobs
    copytree(out, tmp_path / "out")
    (tmp_path / "out" / "run_o0001_tshirt.npz").unlink()
    with pytest.raises(InputError, match=r"run_o0001_trousers\.npz: was simulated with o0001_tshirt, whose"):
        read_outfit_clips(tmp_path / "out")


def test_a_body_that_is_another_is_refused(jobs: list[Job], out: Path, tmp_path: Path, body: Body) -> None:
    assert jobs
    copytree(out, tmp_path / "out")
    taller = replace(body, mesh=replace(body.mesh, vertices=1.1 * body.mesh.vertices))
    save_body(taller, tmp_path / "out" / "bodies" / f"{body.name}.npz")
    with pytest.raises(
        InputError,
        match=r"was simulated on the body default, which is neither .*bodies.default\.npz nor the one in",
    ):
        read_outfit_clips(tmp_path / "out")


def test_a_body_whose_name_is_a_path_stays_in_the_folder(
    wardrobe: Path, tmp_path: Path, body: Body, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its file is copied by its name into the data."""
    monkeypatch.setattr(batch, "simulate_all", lambda todo, *_: list(todo))
    copied = copytree(wardrobe, tmp_path / "wardrobe")
    save_body(replace(body, name="../../b01"), copied / "bodies" / "b01.npz")
    (tmp_path / "windows.csv").write_text(WINDOWS)
    with pytest.raises(
        InputError, match=r"body \.\./\.\./b01: '\.\./\.\./b01\.npz' cannot be the name of a file"
    ):
        simulate_outfits(copied, _selection(tmp_path), tmp_path / "out", frames=25)
    assert not list(tmp_path.glob("b01*"))


def test_splits_without_windows_and_bad_numbers_are_refused(wardrobe: Path, tmp_path: Path) -> None:
    (tmp_path / "windows.csv").write_text(
        WINDOWS.replace("train", "validation").replace("test", "validation")
    )
    with pytest.raises(InputError, match="no window for the splits of these outfits"):
        simulate_outfits(wardrobe, _selection(tmp_path), tmp_path / "out")
    with pytest.raises(InputError, match="--most-frames 0: has to be 1 or more"):
        simulate_outfits(wardrobe, _selection(tmp_path), tmp_path / "out", frames=0)
    with pytest.raises(InputError, match="name the windows with --windows"):
        simulate_outfits(wardrobe, ClipSelection(("walk",)), tmp_path / "out")
