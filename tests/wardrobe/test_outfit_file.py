"""Outfit files and the command that makes them: the same every time, resumed, and refused with a sentence."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from uvcloth.bodies.body import load_body, save_body
from uvcloth.commands.outfits import Outfits
from uvcloth.commands.run.outfits import make_outfits, split_of, wearer
from uvcloth.errors import InputError
from uvcloth.files.options import check_options
from uvcloth.wardrobe.outfit_file import load_outfit_file, load_pieces, on_body, outfit_files

SHORTS = {"drop": 0.02, "length": 0.6, "ease": 0.01, "flare": 0.0}


def outfit_values() -> dict[str, Any]:
    return {
        "version": "uvcloth-outfit-1",
        "name": "o0001",
        "split": "train",
        "body": "bodies/b.npz",
        "seed": 0,
        "vertex_range": [1000, 2500],
        "even": True,
        "seams": False,
        "tightness": 0.5,
        "fabric": {"name": "jersey", "parameters": {"density": 0.2}},
        "pieces": [
            {"file": "o0001_shorts.obj", "type": "shorts", "vertices": 3, "parameters": {"legs": SHORTS}}
        ],
    }


def write(
    folder: Path, values: dict[str, Any], triangle: str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
) -> Path:
    (folder / "bodies").mkdir(exist_ok=True)
    (folder / "bodies" / "b.npz").write_bytes(b"")
    (folder / "o0001_shorts.obj").write_text(triangle)
    path = folder / "o0001.json"
    path.write_text(json.dumps(values))
    return path


def test_an_outfit_is_read_as_it_is_written(tmp_path: Path) -> None:
    outfit = load_outfit_file(write(tmp_path, outfit_values()))
    assert (outfit.name, outfit.split, outfit.fabric.density) == ("o0001", "train", 0.2)
    assert outfit.body == tmp_path / "bodies" / "b.npz"
    assert outfit.pieces[0].design.parameters() == {"legs": SHORTS}
    assert load_pieces(outfit)[0].vertices.shape == (3, 3)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"version": "uvcloth-outfit-9"}, "expected version uvcloth-outfit-1, found uvcloth-outfit-9"),
        ({"split": "holdout"}, "split 'holdout', expected one of train, validation, test"),
        ({"body": "bodies/gone.npz"}, "names gone.npz, which does not exist"),
        ({"tightness": float("nan")}, "the outfit, tightness: is nan, expected a finite number"),
        ({"seed": None}, "the outfit, seed: is null, expected a whole number"),
        ({"fabric": {}}, "the outfit, fabric: lacks 'name'"),
        ({"pieces": []}, "the outfit has no pieces"),
        ({"tightness": 2.0}, "tightness is 2.0, expected 0 to 1"),
        ({"even": "no"}, 'the outfit, even: is "no", expected true or false'),
        ({"vertex_range": [5, 2]}, "vertex_range is [5, 2], expected two numbers from 1"),
        ({"body": "../builtin.npz"}, "../builtin.npz lies outside"),
        ({"body": "/etc/passwd"}, "/etc/passwd lies outside"),
        ({"fabric": {"name": "a", "parameters": {"colour": 1}}}, "'colour' is not a property of a fabric"),
        (
            {"fabric": {"name": "a", "parameters": {"density": 0}}},
            "the fabric's density is 0, expected 0.01 to 2",
        ),
        (
            {"fabric": {"name": "a", "parameters": {"poisson": 1.0}}},
            "the fabric's poisson is 1.0, expected 0 to 0.49",
        ),
    ],
)
def test_a_faulty_outfit_is_refused_in_one_sentence(
    tmp_path: Path, change: dict[str, Any], sentence: str
) -> None:
    path = write(tmp_path, {**outfit_values(), **change})
    with pytest.raises(InputError, match=re.escape(f"{path}: {sentence}")):
        load_outfit_file(path)


def test_a_piece_that_is_missing_unknown_or_another_is_named(tmp_path: Path) -> None:
    values = outfit_values()
    path = write(tmp_path, values)
    (tmp_path / "o0001_shorts.obj").unlink()
    with pytest.raises(InputError, match=r"names o0001_shorts\.obj, which does not exist"):
        load_outfit_file(path)
    write(tmp_path, values, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 1 1\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"o0001_shorts.obj: has 4 vertices, o0001.json says 3"):
        load_pieces(load_outfit_file(path))
    write(tmp_path, values, "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="vertex 0 is not a finite number"):
        load_pieces(load_outfit_file(path))
    values["pieces"][0]["type"] = "cape"
    with pytest.raises(InputError, match=r"o0001_shorts\.obj: cape is not a type of piece"):
        load_outfit_file(write(tmp_path, values))


def test_outfits_are_the_same_every_time_and_what_is_there_is_kept(tmp_path: Path) -> None:
    pytest.importorskip("pyacvd", reason="sewing needs the remesher of uvcloth[body]")

    def made(name: str, count: int, seed: int = 5, kind: str = "shorts") -> Path:
        make_outfits(
            Outfits(
                out=tmp_path / name,
                count=count,
                seed=seed,
                body=("builtin",),
                type=(kind,),
                vertices=(1000, 1100),
                jobs=1,
            )
        )
        return tmp_path / name

    one, two = made("one", 2), made("two", 1)
    assert [path.name for path in outfit_files(one)] == ["o0001.json", "o0002.json"]
    for name in ("o0001.json", "o0001_shorts.obj"):
        assert (one / name).read_bytes() == (two / name).read_bytes()
    kept = (two / "o0001.json").stat().st_mtime_ns
    (two / "o0001_shorts.obj").unlink()
    with pytest.raises(InputError, match="which does not exist"):
        made("two", 1)
    made("one", 2)
    assert (two / "o0001.json").stat().st_mtime_ns == kept
    with pytest.raises(InputError, match="was made with --seed 5"):
        made("one", 2, seed=6)
    with pytest.raises(InputError, match="has the type shorts, which --type leaves out"):
        made("one", 2, kind="skirt")
    dressed = on_body(load_outfit_file(one / "o0001.json"))
    assert dressed.garments[0].name == "o0001_shorts"
    assert dressed.garments[0].template == "bottoms"


def test_splits_follow_the_number_and_share_no_body() -> None:
    splits = [split_of(number) for number in range(1, 31)]
    assert [splits.count(split) for split in ("train", "validation", "test")] == [24, 3, 3]
    assert (split_of(8), split_of(19), split_of(20)) == ("validation", "test", "train")
    for count in (3, 12):
        bodies = [Path(f"b{index}.npz") for index in range(count)]
        worn: dict[str, set[Path]] = {}
        for number in range(1, 200):
            worn.setdefault(split_of(number), set()).add(wearer(number, bodies, seed=0))
        assert sum(map(len, worn.values())) == len(set.union(*worn.values())) == count


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"count": 0}, "--count 0: expected 1 to 100000"),
        ({"seed": -1}, "--seed -1: expected 0 to 4294967295"),
        ({"jobs": 0}, "--jobs 0: expected at least 1"),
        ({"vertices": (10, 2000)}, "--vertices 10: expected 1000 to 16000"),
        ({"vertices": (2000, 1000)}, "--vertices 2000 1000: expected the smaller number first"),
        ({"type": ("cape",)}, "--type cape: unknown, expected one of tshirt"),
        ({"bodies": 2}, "--bodies: 2 bodies, expected one for all, or at least three"),
        ({"body": ("gone.npz",)}, "gone.npz: no such file"),
        ({"body": ("builtin", "a.npz", "b/a.npz")}, "--body: two bodies are named a"),
    ],
)
def test_settings_out_of_range_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("b").mkdir()
    for name in ("a.npz", "b/a.npz"):
        Path(name).touch()
    chosen = Outfits(**{"out": tmp_path / "out", "count": 1, **settings})
    with pytest.raises(InputError, match=re.escape(sentence)):  # noqa: PT012
        check_options(chosen)
        make_outfits(chosen)
    assert not list(tmp_path.rglob("*.json"))


def test_a_body_without_proxies_is_refused(tmp_path: Path) -> None:
    from dataclasses import replace

    save_body(replace(load_body(), proxies={}), tmp_path / "bare.npz")
    with pytest.raises(InputError, match="has no garment proxy, outfits cannot be cut on it"):
        make_outfits(Outfits(out=tmp_path / "out", count=1, body=(str(tmp_path / "bare.npz"),)))
