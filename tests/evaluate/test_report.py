"""The page: what is in it, and that it works in a browser without a network."""

import json
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from evaluate.__main__ import summary
from evaluate.charts import DASH, number, scatter, ticks
from evaluate.report import MotionMap, Picture, write_metrics, write_report
from evaluate.standings import standings
from evaluate.viewer import QUANTUM, ViewerClip
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton

ACTIONS = ("jump", "walking", "salsa dance")
MEANS = {"lbs": 40.0, "lbs_smooth": 30.0, "net": 24.0}
PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de"
    "0000000c4944415408d763f8cfc0000003010100c9fe92ef0000000049454e44ae426082"
)


CLEARED = 0.8
"""Share of an error that a finish leaves."""


def cell(mean: float) -> dict[str, float]:
    """Of a method whose mean distance is that before the finish."""
    both: dict[str, float] = {}
    for stage, error in (("_raw", mean), ("", CLEARED * mean)):
        both |= {
            f"vertex_mse_mm2{stage}": 1.3 * error**2,
            f"vertex_rmse_mm{stage}": 1.14 * error,
            f"vertex_mean_mm{stage}": error,
            f"edge_mm{stage}": 0.4,
            f"bend_cos{stage}": 0.03,
            f"bend_rad{stage}": 0.12,
            f"inside_percent{stage}": 1.5 if stage else 0.0,
            f"squeezed_percent{stage}": 0.25,
            f"inside_faces_percent{stage}": 1.75 if stage else 0.125,
            f"skin_percent{stage}": 2.5 if stage else 0.5,
            f"crossing_edges_percent{stage}": 0.75,
            f"jitter_ratio{stage}": 1.1,
        }
    times = {"network_ms": 20.0, "contact_ms": 5.0, "ms_per_frame": 25.0}
    return {"frames": 100, "map_mse_mm2": 1.1 * mean**2, **both, **times}


def steps(mean: float) -> dict[str, float | None]:
    """One of the fields called stability."""
    both: dict[str, float | None] = {}
    for stage, error in (("_raw", mean), ("", CLEARED * mean)):
        both |= {
            f"one_step_mm{stage}": 0.1 * error,
            f"rollout_50_mm{stage}": 0.5 * error,
            f"whole_mm{stage}": error,
        }
    return {"frames": 300, **both, "late_over_early": 1.25 if mean == MEANS["net"] else None}


def fake_results() -> dict[str, Any]:
    def method(mean: float) -> dict[str, Any]:
        actions = {
            action: {t: cell(mean + 3 * i + 9 * (t == "dress")) for t in ("tops", "dress")}
            for i, action in enumerate(ACTIONS)
        }
        clips = {
            t: {
                action: {"frames": 100, "vertex_mean_mm": by[t]["vertex_mean_mm"]}
                for action, by in actions.items()
            }
            for t in ("tops", "dress")
        }
        over_time = {t: [mean + 0.05 * k for k in range(100)] for t in ("tops", "dress")}
        return {
            "actions": actions,
            "clips": clips,
            "weights_mb": 0.0,
            "trained_on": [],
            "chosen_on": [],
            "familiar": {},
            "static": mean != MEANS["net"],
            "baseline": mean != MEANS["net"],
            "representation": {},
            "outfits": {},
            "training_frames": 1434 if mean == MEANS["net"] else None,
            "training": {"step": 300, "epochs": 1.67, "minutes": 6.5} if mean == MEANS["net"] else {},
            "over_time_mm_raw": dict(over_time),
            "over_time_mm": over_time,
            "stability": {t: steps(mean) for t in ("tops", "dress")},
        }

    floor = {"tops": 5.5, "dress": 9.0}
    return {
        "methods": {name: method(mean) for name, mean in MEANS.items()},
        "simulation": {
            "actions": {a: {t: {**cell(0.0)} for t in ("tops", "dress")} for a in ACTIONS},
            "outfits": {},
        },
        "floor": {
            "representation_mm": {"tops": 1.5, "dress": 2.5},
            "representation_rmse_mm": {"tops": 2.0, "dress": 3.0},
            "representation_mse_mm2": {"tops": 4.0, "dress": 9.0},
            "repeatability_mm": floor,
            "repeatability_rmse_mm": {t: 1.4 * v for t, v in floor.items()},
            "repeatability_mse_mm2": {t: 2.0 * v * v for t, v in floor.items()},
        },
        "previous_frame": {
            kind: {t: steps(mean) for t in ("tops", "dress")}
            for kind, mean in (("held", 400.0), ("carried", 80.0))
        },
        "garments": {t: {"vertices": 3100, "model_mb": 0.2} for t in ("tops", "dress")},
        "outfits": {},
        "actions": list(ACTIONS),
        "split": "test",
        "windows": 3,
        "people": ["02", "12"],
        "missing": {},
        "frames": 300,
        "fps": 30.0,
        "body": "fake <body>",
        "date": "2026-11-21",
        "machine": "a test",
        "map_size": 256,
        "code": "0123456789ab",
    }


def tube(rings: int = 24, around: int = 32) -> tuple[Tensor, Tensor]:
    """An open tube about the Z axis: vertices and outward faces."""
    angle = torch.arange(around) * (2 * torch.pi / around)
    height = torch.linspace(0.6, 1.4, rings)
    radius = 0.16 + 0.12 * (1.4 - height)
    circle = torch.stack([torch.cos(angle), torch.sin(angle)], dim=-1)
    vertices = torch.cat(
        [radius[:, None, None] * circle, height[:, None, None].expand(-1, around, 1)], dim=-1
    ).reshape(-1, 3)
    row, column = torch.meshgrid(torch.arange(rings - 1), torch.arange(around), indexing="ij")
    a, b = row * around + column, row * around + (column + 1) % around
    faces = torch.stack([a, b, b + around, a, b + around, a + around], dim=-1).reshape(-1, 3)
    return vertices, faces


def fake_body() -> Body:
    vertices, faces = tube(40, 24)
    vertices = vertices * torch.tensor([0.7, 0.7, 1.0]) + torch.tensor([0.0, 0.0, 0.1])
    skeleton = Skeleton(("hips",), (-1,), torch.zeros(1, 3))
    flat = torch.zeros(len(faces), dtype=torch.long)
    mesh = Mesh(vertices, faces, vertices[:, :2], faces)
    return Body("fake", mesh, skeleton, torch.ones(len(vertices), 1), flat, flat, {})


def fake_clip(frames: int = 30) -> ViewerClip:
    rest, faces = tube()
    time = torch.arange(frames)[:, None, None] / 15.0
    path = torch.cat([1.2 * time, 0 * time, 0 * time], dim=-1)
    sway = 0.04 * torch.sin(9 * time + 6 * rest[:, 2:])
    truth = rest + path + torch.cat([0 * sway, sway, 0 * sway], dim=-1)
    # Frame t is off by exactly t millimetres, so that the page's own arithmetic can be checked.
    net = truth + torch.cat([0 * time, 0 * time, time * 0.015], dim=-1)
    transforms = torch.cat([torch.eye(3).expand(frames, 1, 3, 3), path[:, :, :, None]], dim=-1)
    meshes = {"simulation": truth, "lbs": rest + path, "net": net}
    return ViewerClip("salsa dance", "dress", 15.0, 2, faces, fake_body(), transforms, meshes)


def write_fake(out: Path) -> Path:
    pictures = [Picture("jump: simulation beside net", PIXEL)]
    return write_report(out, fake_results(), [fake_clip(), fake_clip(20)], pictures)


def test_standings_compare_with_the_better_lbs() -> None:
    rows = {(row.method, row.garment): row for row in standings(fake_results())}
    before, after = rows["net", "tops"].before, rows["net", "tops"].after
    assert (before.mean_mm, after.mean_mm) == pytest.approx((27.0, CLEARED * 27.0))
    assert before.rmse_mm == pytest.approx(1.14 * (24**2 / 3 + 27**2 / 3 + 30**2 / 3) ** 0.5)
    assert before.against == pytest.approx(27.0 / 33.0)
    assert (before.won, before.of) == (3, 3)
    assert rows["lbs", "tops"].before.against is None


def test_a_baseline_is_one_by_nature_not_by_name() -> None:
    results = fake_results()
    results["methods"]["lbs_residual"] = results["methods"].pop("net")
    rows = {(row.method, row.garment): row for row in standings(results)}
    assert rows["lbs_residual", "tops"].before.against == pytest.approx(27.0 / 33.0)
    assert rows["lbs_smooth", "tops"].before.against is None


def test_a_finish_may_turn_a_standing_around() -> None:
    results = fake_results()
    for by_garment in results["methods"]["lbs_smooth"]["actions"].values():
        by_garment["tops"]["vertex_mean_mm"] = 10.0
    net = {(row.method, row.garment): row for row in standings(results)}["net", "tops"]
    assert (net.before.won, net.after.won) == (3, 0)
    assert net.after.against == pytest.approx(CLEARED * 27.0 / 10.0)
    (said,) = (line for line in summary(results).splitlines() if line.split()[:2] == ["tops", "net"])
    assert "  -18 %, 3 of 3" in said
    assert "+116 %, 0 of 3" in said


def only_the_dress() -> dict[str, Any]:
    """Results in which net dresses nothing but the dress."""
    results = fake_results()
    net = results["methods"]["net"]
    del net["over_time_mm"]["tops"], net["over_time_mm_raw"]["tops"], net["stability"]["tops"]
    for by_garment in net["actions"].values():
        del by_garment["tops"]
    del results["methods"]["lbs"]["actions"]["jump"]["dress"]
    return results


def test_a_method_counts_only_on_what_it_dresses() -> None:
    found = {(row.method, row.garment): row for row in standings(only_the_dress())}
    assert ("net", "tops") not in found
    dress = found["net", "dress"]
    assert (dress.frames, dress.after.won, dress.after.of) == (300, 3, 3)
    assert dress.before.mean_mm == pytest.approx(36.0)
    assert found["lbs_smooth", "tops"].frames == 300


def dressed_outfit(mean: float, side: float) -> dict[str, Any]:
    """What metrics.json says of a method, or of the simulation, on tops over bottoms."""
    sides = {"tops": {"bottoms": side}}
    both = {**cell(mean), "wrong_side_percent_raw": sides, "wrong_side_percent": {"tops": {"bottoms": 0.0}}}
    return {
        "actions": {"jump": both, "walking": both | {"wrong_side_percent_raw": {"tops": {"bottoms": 9.0}}}},
        "clips": {},
    }


def test_page_has_outfits_as_one(tmp_path: Path) -> None:
    assert 'id="outfits"' not in write_report(tmp_path, fake_results(), [], []).read_text()
    results = fake_results()
    results["outfits"] = {"tops over bottoms": {"garments": ["bottoms", "tops"]}}
    results["simulation"]["outfits"]["tops over bottoms"] = dressed_outfit(0.0, 1.0)
    results["methods"]["lbs"]["outfits"]["tops over bottoms"] = dressed_outfit(20.0, 3.0)
    results["methods"]["net"]["outfits"]["tops over bottoms"] = dressed_outfit(10.0, 5.0)
    page = write_report(tmp_path, results, [], []).read_text()
    whole = rows(page, 'id="outfits"')
    assert [row[1] for row in whole[2:]] == ["simulation", "lbs", "net"]
    assert whole[4] == ["", "net", "10.0", "11.4", "2.50", "0.75", "8.00", "9.12", "0.50", "0.75", "25.0"]
    assert rows(page, 'id="layers"')[1:] == [
        ["tops over bottoms", "simulation", "tops over bottoms", "5.00", "0"],
        ["", "lbs", "tops over bottoms", "6.00", "0"],
        ["", "net", "tops over bottoms", "7.00", "0"],
    ]
    (net,) = (row for row in standings(results) if row.garment == "tops over bottoms" and row.method == "net")
    assert (net.before.against, net.before.won, net.before.of) == (pytest.approx(0.5), 2, 2)
    assert "tops over bottoms net" in summary(results)


def tags(page: str) -> Counter[tuple[str, ...]]:
    """The page's tags with the names of their attributes."""
    found: Counter[tuple[str, ...]] = Counter()

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            found[tag, *(name for name, _ in attrs)] += 1

    Reader().feed(page)
    return found


def test_names_are_text_whatever_is_in_them(tmp_path: Path) -> None:
    """Of garments, outfits, methods, actions, clips: the page has the tags that it has with plain ones."""

    def written(names: Mapping[str, str], out: Path) -> str:
        results = fake_results()
        results["outfits"] = {"tops over bottoms": {"garments": ["bottoms", "tops"]}}
        results["simulation"]["outfits"]["tops over bottoms"] = dressed_outfit(0.0, 1.0)
        results["methods"]["net"]["outfits"]["tops over bottoms"] = dressed_outfit(10.0, 5.0)
        results["missing"] = {"walking": {"dress": "12_01 was refused"}}
        text, clip = json.dumps(results), fake_clip(3)
        for plain, name in names.items():
            text = re.sub(rf"\b{plain}(?!\w)", lambda _, name=name: json.dumps(name)[1:-1], text)
        meshes = {names.get(mesh, mesh): points for mesh, points in clip.meshes.items()}
        clip = replace(clip, action=names["salsa dance"], garment=names["dress"], meshes=meshes)
        pictures = [Picture(f"{names['walking']}: simulation beside net", PIXEL)]
        return write_report(out, json.loads(text), [clip], pictures).read_text()

    plain = ("dress", "net", "walking", "salsa dance", "bottoms", "fake <body>", "12_01", "a test")
    attacks = ("<script>alert({})</script>", '"><img src=x onerror=alert({})>', "</script><b id='{}'>")
    odd = {name: attacks[k % len(attacks)].format(k) for k, name in enumerate(plain)}
    harmless = tags(written({name: f"n{k}" for k, name in enumerate(plain)}, tmp_path / "plain"))
    page = written(odd, tmp_path / "odd")
    assert tags(page) == harmless
    assert "alert(0)" in page


def test_page_has_looks_and_names_impossible_frames(tmp_path: Path) -> None:
    results = fake_results()
    true = results["simulation"]["actions"]["jump"]["dress"]
    true |= {"force_median": 6.5, "swing_ratio_member": 1.0, "force_median_member": 1.25}
    results["simulation"]["stop_energy_mj_kg"] = {"dress": [60.0, 30.0, 10.0]}
    named = [{"clip": "02_03", "frame": 17, "force": 44.0}]
    results["methods"]["net"]["actions"]["jump"]["dress"] |= {
        "swing_ratio_1_3_hz": 0.75, "swing_correlation_1_3_hz": 0.5, "impossible_frames": named,
    }  # fmt: skip
    page = write_report(tmp_path, results, [], []).read_text()
    looks = rows(page, 'id="looks"')
    assert [row[1] for row in looks[2:]] == ["simulation", *MEANS, "simulation", "another simulation", *MEANS]
    titles = ["Garment", "Method", *looks[1]]
    force, swing = titles.index("median (m/s²)"), titles.index(f"1{DASH}3 Hz")
    assert [row[force] for row in looks[6:8]] == ["6.50", "1.25"]
    assert looks[-1][swing] == "0.75 (0.50)"
    assert all(len(row) == len(titles) for row in looks[2:])
    assert "02_03, dress: frame 17 (44.0 m/s²)" in page
    assert 'aria-label="dress: energy after a stop"' in page
    assert 'aria-label="tops: energy after a stop"' not in page


def test_page_says_which_methods_are_quasi_static(tmp_path: Path) -> None:
    page = write_report(tmp_path, fake_results(), [fake_clip()], []).read_text()
    assert "<p>lbs, lbs_smooth are quasi-static:" in page
    results = fake_results()
    for judged in results["methods"].values():
        judged["static"] = False
    assert "static:" not in write_report(tmp_path, results, [fake_clip()], []).read_text()


def test_page_leaves_out_what_a_method_does_not_dress(tmp_path: Path) -> None:
    clips = [
        fake_clip(),
        replace(
            fake_clip(),
            garment="tops",
            meshes={"simulation": tube()[0][None], "lbs_smooth": tube()[0][None]},
            transforms=torch.eye(3, 4)[None, None],
        ),
    ]
    page = write_report(tmp_path, only_the_dress(), clips, []).read_text()
    assert "net does not support every garment: it is evaluated on dress." in page
    assert "net" not in rows(page, "tops: vertices inside the body")[0]
    assert "net" in rows(page, "dress: vertices inside the body")[0]
    assert "net" not in rows(page, "tops: map MSE")[0]
    assert [row[1] for row in rows(page, 'id="physics-before"')] == [
        "Method", "simulation", "lbs", "lbs_smooth", "simulation", "lbs", "lbs_smooth", "net"
    ]  # fmt: skip
    assert [row[:2] for row in rows(page, 'id="cost"')][-1] == ["net", "dress"]
    charts = re.findall(r'aria-label="tops: mean vertex distance before the finish">.*?</svg>', page)
    assert 'class="m1"' in charts[0]
    assert 'class="m2"' not in charts[0]
    headers = re.search(r'id="viewer-clips">(.*?)</script>', page)
    assert headers is not None
    assert [header["colors"] for header in json.loads(headers.group(1))] == [[0, 2], [1]]


def test_page_is_self_contained_and_escaped(tmp_path: Path) -> None:
    page = write_fake(tmp_path).read_text()
    assert "fake &lt;body&gt;" in page
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", page)
    assert '<link rel="stylesheet"' not in page
    embedded = re.search(r'id="metrics">(.*?)</script>', page)
    assert embedded is not None
    assert json.loads(embedded.group(1)) == fake_results()
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def warned(tmp_path: Path, split: str, made_by: str) -> str:
    """What the page says of a method that has met two of three windows, between tags."""
    results = fake_results() | {"split": split}
    results["methods"]["net"]["familiar"] = {
        "02_04_tops": {"split": made_by, "same": "person", "subject": "02", "clips": ("02_01", "02_06")},
        "02_04_dress": {"split": made_by, "same": "person", "subject": "02", "clips": ("02_01", "02_06")},
        "12_01_tops": {"split": made_by, "same": "clip", "subject": "12", "clips": ("12_01",)},
    }
    page = " ".join(write_report(tmp_path, results, [], []).read_text().split())
    return page[page.index("</header>") : page.index("<div class=")]


def test_page_warns_of_familiar_windows(tmp_path: Path) -> None:
    red = warned(tmp_path, "test", "train")
    assert '<p class="warning"><b>net was trained on data that overlap with 3 of these 3 windows</b>' in red
    assert "person 02 in clips 02_01, 02_06 (windows 02_04_tops, 02_04_dress)" in red
    assert "clip 12_01 (window 12_01_tops)" in red
    assert "unseen motion and people" in red
    selected = "<b>net was selected on data that overlap with 3 of these"
    assert f'<p class="warning">{selected}' in warned(tmp_path, "test", "validation")
    assert f"<p>{selected}" in warned(tmp_path, "validation", "validation")
    assert "was trained on" not in write_report(tmp_path, fake_results(), [], []).read_text()


def test_page_names_what_is_missing(tmp_path: Path) -> None:
    results = fake_results()
    results["missing"] = {"ballet": {"tops": "not simulated", "dress": "a limb <b>"}, "jump": {"dress": "x"}}
    line = "ballet, tops (not simulated); ballet, dress (a limb &lt;b&gt;); jump, dress (x)."
    assert line in write_report(tmp_path, results, [], []).read_text()
    assert "lack of a simulation" not in write_report(tmp_path, fake_results(), [], []).read_text()


def rows(page: str, table: str) -> list[list[str]]:
    """The texts of a table's cells."""
    inside = page[page.index(table) :].partition("</table>")[0]
    return [re.findall(r"<t[dh][^>]*>([^<]*)<", row) for row in inside.split("<tr")[1:]]


def test_page_says_how_stable_a_method_is(tmp_path: Path) -> None:
    found = rows(write_report(tmp_path, fake_results(), [], []).read_text(), 'id="stability"')
    assert ["", "net", "1434", "2.40", "12.0", "24.0", "1.92", "9.60", "19.2", "1.25"] in found
    assert ["tops", "lbs", DASH, "4.00", "20.0", "40.0", "3.20", "16.0", "32.0", DASH] in found


def test_page_says_what_is_inside_the_body_in_each_action(tmp_path: Path) -> None:
    results = fake_results()
    results["methods"]["net"]["actions"]["walking"]["dress"]["inside_percent_raw"] = 4.5
    found = rows(write_report(tmp_path, results, [], []).read_text(), "dress: vertices inside the body")
    plain = ["1.50", "0", "0.25"]
    assert ["walking", "0", "0.25", *plain, *plain, "4.50", "0", "0.25"] in found
    assert ["all frames", "0", "0.25", *plain, *plain, "2.50", "0", "0.25"] in found


def test_page_ranks_after_the_finish_and_hides_columns_without_a_figure(tmp_path: Path) -> None:
    page = write_report(tmp_path, fake_results(), [], []).read_text()
    standing = rows(page, 'id="standings"')
    assert [text for text in standing[0] if "finish" in text] == ["After the finish", "Before the finish"]
    assert standing[2][1:4] == ["net", "21.6", "24.7"]
    assert standing[2][6:8] == ["27.0", "30.9"]
    assert "Spread ratio" not in page
    assert 'id="looks"' not in page
    keys = re.findall(r'name="measure" value="(\w+)"', page)
    assert keys[:4] == ["vertex_mean_mm_raw", "vertex_rmse_mm_raw", "vertex_mse_mm2_raw", "map_mse_mm2"]
    assert page.index('id="physics-before"') < page.index('id="physics-after"')
    titles = re.findall(r'aria-label="(tops, \w+ the finish)"', page)
    assert titles == ["tops, before the finish", "tops, after the finish"]


def test_page_says_what_shows_and_what_runs_through_what(tmp_path: Path) -> None:
    page = write_report(tmp_path, fake_results(), [], []).read_text()
    for when, inside, faces, skin in (("before", "1.50", "1.75", "2.50"), ("after", "0", "0.12", "0.50")):
        figures = ["0.40", "0.030", "0.12", "1.10", inside, "0.25", faces, skin, "0.75"]
        assert ["", "net", *figures] in rows(page, f'id="physics-{when}"')
    shown = rows(page, "dress: skin that shows")
    assert ["walking", "0.50", "2.50", "0.50", "2.50", "0.50", "2.50", "0.50"] in shown


def test_page_says_how_long_networks_learned(tmp_path: Path) -> None:
    page = write_report(tmp_path, fake_results(), [], []).read_text()
    assert ["net", "0", DASH, "300", "1.67", "6.50"] in rows(page, 'id="training"')
    untaught = fake_results()
    untaught["methods"]["net"]["training"] = {}
    assert 'id="training"' not in write_report(tmp_path, untaught, [], []).read_text()


def test_page_shows_motion_and_the_space_of_garments(tmp_path: Path) -> None:
    tests = {"jump": torch.rand(3, 2), "a & b": torch.rand(4, 2)}
    motion = [
        MotionMap(("net",), 5, 2, 581, torch.rand(6, 2), tests),
        MotionMap(("far",), 3, 0, 581, torch.zeros(0, 2), tests),
    ]
    space = [Picture("net, dress", PIXEL, ("a = 1", "a = 0"))]
    page = write_report(tmp_path, fake_results(), [], [], spaces=space, motion=motion).read_text()
    assert "net: 2 of the 5 training sequences are in the data folder" in page
    assert "holds none of the 3 sequences that far\nwas trained on" in page
    assert [path.count("M") for path in re.findall(r'class="dots [^"]*" d="([^"]*)"', page)] == [
        6,
        3,
        4,
        0,
        3,
        4,
    ]
    assert "<title>a &amp; b</title>" in page
    assert "<span>a = 1</span><span>a = 0</span>" in page
    assert "t-SNE" not in write_report(tmp_path, fake_results(), [], []).read_text()


def test_many_groups_of_dots_differ_in_colour_or_shape() -> None:
    chart = scatter("t", {str(k): [(0.5, 0.5)] for k in range(15)})
    assert len(set(re.findall(r'class="dots ([^"]*)"', chart))) == 15


def test_metrics_are_written_whole(tmp_path: Path) -> None:
    path = write_metrics(tmp_path / "new", fake_results())
    assert json.loads(path.read_text()) == fake_results()
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="file"):
        write_metrics(tmp_path / "file", fake_results())


@pytest.mark.parametrize("largest", [0.0, 0.03, 1.0, 9.7, 1234.0])
def test_ticks_reach_the_largest_value(largest: float) -> None:
    values = ticks(largest)
    assert values[0] == 0.0
    assert values[-1] >= largest * 0.999
    assert 2 <= len(values) <= 7


def test_number_shows_what_a_reader_needs() -> None:
    assert [number(v) for v in (None, 0.0, 0.0314, 0.42, 23.456, 1234.5)] == [
        DASH, "0", "0.031", "0.42", "23.5", "1,234"
    ]  # fmt: skip


def dumped_dom(browser: str, page: Path, fragment: str, profile: Path, *more: str) -> str:
    command = [
        browser, "--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync",
        "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
        f"--user-data-dir={profile}", "--virtual-time-budget=8000", *more, "--dump-dom",
        f"file://{page}#{fragment}",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout


SCRUB = """
const ready = setInterval(() => {
  if (!document.querySelector("canvas[data-ready]")) return;
  clearInterval(ready);
  document.body.dataset.before = document.getElementById("viewer-number").textContent;
  const slider = document.getElementById("viewer-frame");
  slider.value = 12;
  slider.dispatchEvent(new Event("input"));
}, 20);
"""
"""What a user does on the page: once it is ready, move the slider to frame 12."""


def shown(dom: str) -> Mapping[str, str]:
    """The text of every <output> element by id."""
    return dict(re.findall(r'<output id="([\w-]+)"[^>]*>([^<]*)</output>', dom))


def test_page_scrubs_in_a_browser(tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("Chromium is not installed")
    page = write_fake(tmp_path)
    page.write_text(page.read_text().replace("</body>", f"<script>{SCRUB}</script></body>"))
    dom = dumped_dom(browser, page, "clip=0&left=0&right=2&frame=5", tmp_path / "profile", "--disable-gpu")
    assert 'data-ready="0"' in dom
    outputs = shown(dom)
    # The link led to frame 5, the slider on to frame 12 of a clip that shows every second frame.
    assert 'data-before="10"' in dom
    assert outputs["viewer-number"] == "24"
    assert outputs["viewer-time"] == "0.80"
    # Predicted 12 mm too high.
    measured = float(outputs["viewer-right-error"].split()[0])
    assert measured == pytest.approx(12.0, abs=1000 * QUANTUM)
    assert outputs["viewer-left-error"] == "the reference"
    assert "27.0" in dom[dom.index('id="standings"') :]
