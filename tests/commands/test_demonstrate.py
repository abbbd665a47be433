"""The demo: a motion stops, and the pictures have the simulation and all methods at the same moments."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from tests.simulation.skinned import skinned_sequence
from uvcloth.commands.run import demo
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.errors import InputError
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip
from uvcloth.rollouts.rollout import RolloutFrame

SIZE, GAP = (22, 30), 6
LEAD = 2


@pytest.fixture
def commands(monkeypatch, body):
    """What the demo rolls out and exports, in order; skinning takes the place of simulations and methods."""
    known = []

    def transforms(motion):
        return load_clip(motion, body).transforms()

    def skinned(name, joints):
        garment = fit_template(name, body)
        return skin(garment.mesh.vertices, garment.smooth_weights, joints)

    def simulate_batch(selection, outfits, folder, body):
        (motion,) = selection.clips
        joints = transforms(motion)
        joints = torch.cat([joints[:1].expand(LEAD, -1, -1, -1), joints])
        for name in (name for outfit in outfits for name in outfit):
            made = skinned_sequence(fit_template(name, body), body)
            (garment,) = made.garments
            moved = replace(garment, vertices=skinned(name, joints))
            clip = replace(made, garments=(moved,), transforms=joints, warm_up=LEAD)
            save_simulated(clip, folder / f"{Path(motion).stem}_{name}.npz")

    def animate(command, audience=None):
        known.append(command)
        if audience:
            joints = transforms(command.motion)
            for index, garments in enumerate(
                zip(*(skinned(n, joints) for n in command.garment), strict=True)
            ):
                audience.add(RolloutFrame(index, garments, garments, joints[index], garments[0], {}))
        return SimpleNamespace(lines=lambda: ["a line"])

    def write(command):
        known.append(command)
        return SimpleNamespace(lines=lambda: ["a file"])

    monkeypatch.setattr(demo, "WASM", Path("/no/such/file"))
    monkeypatch.setattr(demo, "write_page", lambda _: pytest.fail("a page without the runtime for browsers"))
    monkeypatch.setattr(demo, "bake", write)
    monkeypatch.setattr(demo, "play", write)
    monkeypatch.setattr(demo, "simulate_batch", simulate_batch)
    monkeypatch.setattr(demo, "animate", animate)
    monkeypatch.setattr(demo, "export", write)
    monkeypatch.setattr(demo, "PICTURE_SIZE", SIZE)
    return known


@pytest.mark.thorough
def test_all_methods_are_drawn_below_the_simulation_at_the_same_moments(
    tmp_path, monkeypatch, capsys, commands
):
    monkeypatch.setattr(demo, "MOMENTS", dict.fromkeys(demo.MOMENTS, (-0.2, 0.1)))
    demo.demonstrate(tmp_path, long=True)
    printed = capsys.readouterr().out
    for outfit in (demo.DRESS, *demo.STOPPED):
        sheet = np.asarray(Image.open(tmp_path / f"{outfit.name}.png").convert("RGB"))
        height = (sheet.shape[0] + GAP) // 4
        drawn = [sheet[row * height :][: height - GAP] for row in range(4)]
        for row in drawn[1:]:
            # The simulation comes from a file, to within 0.05 mm: an edge may touch another pixel.
            assert (np.abs(row.astype(int) - drawn[0].astype(int)) > 1).mean() < 0.002
        network = outfit.network
        assert f"simulation, {network} cleared, {network} with --finish dynamic, physics" in printed
    ways = [(Path(c.motion).stem, c.garment, c.model, c.finish) for c in commands if hasattr(c, "finish")]
    for outfit in (demo.DRESS, *demo.STOPPED):
        for model, finish in (
            (outfit.network, "clear"),
            (outfit.network, "dynamic"),
            ("physics", "clear"),
        ):
            assert ways.count((outfit.motion, outfit.garments, (model,), finish)) == 1


@pytest.mark.thorough
def test_everything_moves_over_a_motion_that_stops_at_the_moment_that_is_called_so(
    tmp_path, monkeypatch, commands, body
):
    monkeypatch.setattr(demo, "STOPPED", ())
    demo.demonstrate(tmp_path, long=True)
    motion = load_clip(tmp_path / "stop.npz", body)
    moves = motion.transforms().diff(dim=0).abs().flatten(1).amax(1)
    assert float(moves[: demo.FRAMES - 4].min()) > 1e-2
    still = int((moves > 1e-6).nonzero().max()) + 1
    stopped = [
        command for command in commands if getattr(command, "motion", "") == str(tmp_path / "stop.npz")
    ]
    assert len(stopped) == 3
    assert still == demo.standstill(motion.fps)
    assert still + max(demo.MOMENTS["stop"]) * motion.fps < len(motion)


def test_a_page_is_left_where_the_runtime_for_browsers_is(tmp_path, monkeypatch, capsys, commands):
    pages = []

    def write_page(command):
        pages.append(command)
        return SimpleNamespace(page=command.out)

    monkeypatch.setattr(demo, "write_page", write_page)
    monkeypatch.setattr(demo, "MOMENTS", dict.fromkeys(demo.MOMENTS, (0.0,)))
    monkeypatch.setattr(demo, "WASM", Path(__file__))
    demo.demonstrate(tmp_path)
    assert [page.out for page in pages] == [tmp_path / "page" / "index.html"]
    assert pages[0].simulated.is_file()
    assert f"   file://{tmp_path}/page/index.html: open it in a browser\n" in capsys.readouterr().out


def test_a_leg_is_highest_when_the_demo_says_so(body):
    kick = load_clip(demo.KICK, body)
    heads = torch.cat([body.skeleton.heads, torch.ones(len(body.skeleton.heads), 1)], 1)
    heights = (kick.transforms() @ heads[:, :, None])[:, :, 2, 0]
    feet = [body.skeleton.names.index(f"{side}Foot") for side in ("Left", "Right")]
    assert abs(int(heights[:, feet].amax(1).argmax()) - demo.HIGHEST) <= 1
    assert demo.HIGHEST + max(demo.MOMENTS[demo.KICK]) * kick.fps < len(kick)


def test_a_refused_simulation_is_named(tmp_path, monkeypatch, commands):
    monkeypatch.setattr(demo, "simulate_batch", lambda *_: None)
    with pytest.raises(InputError, match=r"kick_dress.npz: the simulation was rejected"):
        demo.demonstrate(tmp_path)
