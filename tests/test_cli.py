"""The command line: what it parses, what it calls, and how it fails."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import get_args

import pytest

from tests.writers.glb_reader import GlbReader
from uvcloth import cli
from uvcloth.commands import options, simulate
from uvcloth.errors import InputError
from uvcloth.methods.registry import METHODS
from uvcloth.motion.library import load_clip

HEAVY = ("torch", "warp", "lightning_fabric", "scipy", "trimesh", "pxr", "kornia", "anny")


@pytest.fixture
def stand_in(monkeypatch):
    """Put a module with the given functions in place of a real one that the command would import."""

    def put(name: str, **functions) -> None:
        module = ModuleType(name)
        for key, function in functions.items():
            setattr(module, key, function)
        monkeypatch.setitem(sys.modules, name, module)

    return put


def run(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["uvcloth", *arguments])
    return cli.main()


def test_the_names_that_options_take_are_those_of_the_tables():
    """They are written out so that `--help` imports nothing heavy."""
    from uvcloth.garments.templates import TEMPLATES
    from uvcloth.physics.fabric import FABRICS
    from uvcloth.simulation.engines import ENGINES

    assert get_args(options.TemplateName) == tuple(options.TEMPLATE_NAMES.split(", ")) == tuple(TEMPLATES)
    assert get_args(options.FabricName) == tuple(options.FABRIC_NAMES.split("|")) == tuple(FABRICS)
    assert get_args(simulate.EngineName) == tuple(ENGINES)


def test_help_imports_nothing_heavy():
    code = (
        "import sys\n"
        "from uvcloth import cli\n"
        "sys.argv = ['uvcloth', '--help']\n"
        "try: cli.main()\n"
        "except SystemExit: pass\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]"
    for subcommand in cli.COMMANDS:
        assert subcommand in done.stdout


@pytest.fixture
def simulated(body, tmp_path):
    """A folder in which the sequence of the tops over the built-in walk is there already."""
    from tests.simulation.skinned import skinned_sequence
    from uvcloth.dataset.clip_file import save_simulated
    from uvcloth.garments.templates import fit_template
    from uvcloth.simulation.explicit import Explicit

    made = skinned_sequence(fit_template("tops", body), body)
    made_by = {"body_hash": body.identity.shape, **json.loads(json.dumps(Explicit().describe()))}
    save_simulated(made.labelled(**made_by), tmp_path / "out" / "walk_tops.npz")
    return tmp_path / "out"


def test_simulate_leaves_what_is_there_and_keeps_its_windows(monkeypatch, capsys, simulated, tmp_path):
    windows = tmp_path / "mine.csv"
    windows.write_text("trial,subject,split,action,window_start,window_frames\nwalk,a,test,walking,40,30\n")
    before = (simulated / "walk_tops.npz").read_bytes()
    words = ("simulate", "walk", "--garment", "tops", "--out", str(simulated), "--windows", str(windows))
    assert run(monkeypatch, *words) == 0
    assert f"{simulated}: every sequence is there already\n" in capsys.readouterr().out
    assert (simulated / "index.csv").read_text() == windows.read_text()
    assert (simulated / "walk_tops.npz").read_bytes() == before


def test_simulate_says_which_option_does_not_go_with_what_is_there(
    monkeypatch, capsys, simulated, body, tmp_path
):
    from uvcloth.bodies.body import save_body
    from uvcloth.simulation.engines import ENGINES

    other = SimpleNamespace(describe=lambda: {"engine": "blender.cloth", "settings": {}})
    monkeypatch.setitem(ENGINES, "blender", lambda: other)
    taller = replace(body, name="tall", mesh=replace(body.mesh, vertices=1.02 * body.mesh.vertices))
    save_body(taller, tmp_path / "tall.npz")
    for words, sentence in (
        (("--garment", "tops", "--engine", "blender"), "was simulated by uvcloth."),
        (("--garment", "bottoms", "tops", "--layered"), "was simulated as tops, not as bottoms under tops"),
        (("--garment", "tops", "--body", str(tmp_path / "tall.npz")), "was simulated on another body"),
        (("--garment", "tops", "--jobs", "0"), "--jobs 0: expected at least 1"),
    ):
        assert run(monkeypatch, "simulate", "walk", *words, "--out", str(simulated)) == 2
        assert sentence in capsys.readouterr().err
    assert [path.name for path in simulated.iterdir()] == ["walk_tops.npz"]


def test_simulate_writes_an_ensemble_into_folders_of_its_members(monkeypatch, capsys, simulated):
    """Only the missing members are simulated, each with its own engine."""
    from uvcloth.dataset.clip_file import load_simulated, save_simulated
    from uvcloth.simulation import batch
    from uvcloth.simulation.explicit import Explicit
    from uvcloth.simulation.members import member_engine

    asked = []
    monkeypatch.setattr(batch, "simulate_all", lambda todo, *_: asked.extend(todo))
    words = ("simulate", "walk", "--garment", "tops", "--out", str(simulated), "--ensemble")
    assert run(monkeypatch, *words) == 0
    folders = [simulated / "members" / str(member) for member in (1, 2, 3)]
    assert [job.targets for job in asked] == [(folder / "walk_tops.npz",) for folder in folders]
    assert [job.member for job in asked] == [1, 2, 3]
    usual = load_simulated(simulated / "walk_tops.npz")
    for folder, job in zip(folders, asked, strict=True):
        settings = member_engine(Explicit(), job.member).describe()["settings"]
        save_simulated(usual.labelled(settings=settings), folder / "walk_tops.npz")
    assert run(monkeypatch, *words) == 0
    assert len(asked) == 3
    assert "every sequence is there already" in capsys.readouterr().out


def test_body_hands_on_only_the_given_phenotypes(monkeypatch, stand_in, tmp_path):
    from uvcloth.bodies.body import load_body

    calls = []

    def make_body(name, phenotype):
        calls.append((name, phenotype))
        return load_body()

    stand_in("uvcloth.bodies.anny", make_body=make_body)
    out = tmp_path / "tall.npz"
    assert run(monkeypatch, "body", "--out", str(out), "--height", "0.9", "--gender", "0") == 0
    assert calls == [("tall", {"height": 0.9, "gender": 0.0})]
    assert len(load_body(out).mesh.vertices) == len(load_body().mesh.vertices)


def test_poses_draws_saves_and_counts(monkeypatch, capsys, tmp_path):
    from uvcloth.bodies.body import load_body
    from uvcloth.motion.poses import load_poses

    out = tmp_path / "poses.npz"
    arguments = (
        "poses",
        "run",
        "walk",
        "--out",
        str(out),
        "--apart",
        "0.8",
        "--no-mirror",
        "--recombine",
        "3",
    )
    assert run(monkeypatch, *arguments) == 0
    poses = load_poses(out, load_body())
    assert (poses.clip_names, poses.apart, poses.mirrored.any()) == (("run", "walk"), 0.8, False)
    counts = [len(poses.of(split)) for split in ("train", "validation", "test")]
    assert int((poses.donors[:, 0] >= 0).sum()) == 3
    assert f"{counts[0]} train, {counts[1]} validation, 0 test poses" in capsys.readouterr().out


def test_poses_are_drawn_from_the_clips_that_an_index_names(monkeypatch, capsys, tmp_path):
    asked = []

    def stop(sources, *_):
        asked.extend((source.name, source.split, source.subject) for source in sources)
        raise KeyboardInterrupt

    monkeypatch.setattr("uvcloth.commands.run.poses.draw_poses", stop)
    (tmp_path / "a.bvh").touch()
    header = "trial,subject,split,action,window_start,window_frames\n"
    (tmp_path / "mine.csv").write_text(header + "a,ann,test,walk,0,9\nb,ann,unused,walk,0,9\n")
    words = ("poses", "--windows", str(tmp_path / "mine.csv"), "--out", str(tmp_path / "out" / "poses.npz"))
    assert run(monkeypatch, *words) == 2
    assert "--windows and --clips-from go together" in capsys.readouterr().err
    assert run(monkeypatch, *words, "--clips-from", str(tmp_path)) == 130
    assert asked == [("a", "test", "ann")]


def test_what_poses_cannot_do_is_refused_before_drawing(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("uvcloth.commands.run.poses.draw_poses", None)
    (tmp_path / "file").write_text("mine")
    negative = ("poses", "run", "--out", str(tmp_path / "poses.npz"), "--recombine", "-1")
    assert run(monkeypatch, *negative) == 2
    assert "--recombine -1: expected 0 to 1000000" in capsys.readouterr().err
    assert run(monkeypatch, "poses", "run", "--out", str(tmp_path / "file" / "poses.npz")) == 2
    assert "file: cannot be made a folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_an_interrupted_drawing_leaves_nothing(monkeypatch, tmp_path):
    def interrupt(contact, vertices):
        raise KeyboardInterrupt

    monkeypatch.setattr("uvcloth.physics.self_contact.SelfContact.clear", interrupt)
    assert run(monkeypatch, "poses", "run", "--out", str(tmp_path / "poses.npz")) == 130
    assert not list(tmp_path.iterdir())


def test_export_writes_the_rig_that_its_options_ask_for(monkeypatch, capsys, tmp_path):
    """Of the shipped model: a motion, six blend shapes, and no body, though one is named."""
    from uvcloth.bodies.body import load_body, save_body

    save_body(load_body(), tmp_path / "b.npz")
    out = tmp_path / "rig.glb"
    words = ("export", "--model", "pbns", "--out", str(out), "--motion", "jump", "--shapes", "6")
    assert run(monkeypatch, *words, "--body", str(tmp_path / "b.npz"), "--no-with-body") == 0
    assert capsys.readouterr().out.startswith(f"{out}: ")
    glb = GlbReader.load(out)
    assert {node.name for node in glb.gltf.nodes if node.mesh is not None} == {"bottoms", "tops"}
    assert len(glb.mesh("tops").primitives[0].targets) == 6
    assert len(glb.times()) == len(load_clip("jump", load_body()))
    assert run(monkeypatch, *words, "--body", str(tmp_path / "nobody.npz")) == 2
    assert "nobody.npz: no such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (InputError("walk.bvh: line 7 is not a number"), (2, "uvcloth: walk.bvh: line 7 is not a number\n")),
        (KeyboardInterrupt(), (130, "uvcloth: interrupted; finished work is in place\n")),
    ],
)
def test_failing_commands_say_one_sentence(monkeypatch, stand_in, capsys, error, expected):
    def failing(command):
        raise error

    stand_in("uvcloth.commands.run.demo", run=failing)
    assert (run(monkeypatch, "demo"), capsys.readouterr().err) == expected


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "--out", "x"), "at least one clip"),
        (("simulate", "walk", "--out", "x", "--garment"), "one garment"),
        (("rollout", "--motion", "walk", "--out", "x.glb", "--garment"), "--garment: expected at least one"),
        (("motion", "walk", "--body", "nowhere.npz"), "--body nowhere.npz: no such file"),
        *(
            (
                ("rollout", "--motion", "walk", "--garment", "tops", "--out", "x.glb", "--fps", fps),
                f"--fps {fps}: expected",
            )
            for fps in ("0", "-5", "nan", "inf", "1e+09")
        ),
    ],
)
def test_bad_input_exits_with_two(monkeypatch, capsys, arguments, words):
    assert run(monkeypatch, *arguments) == 2
    sentence = capsys.readouterr().err
    assert words in sentence
    assert sentence.startswith("uvcloth: ")
    assert sentence.count("\n") == 1


def test_unknown_options_exit_with_two(monkeypatch):
    with pytest.raises(SystemExit) as exit_:
        run(monkeypatch, "demo", "--colour", "red")
    assert exit_.value.code == 2


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        *(
            (("--outfits", "made", *option), f"{option[0]}: not allowed with --outfits")
            for option in (("--ensemble",), ("--layered",), ("--body", "b.npz"))
        ),
        (("--plan", "p.csv"), "clips: not allowed with --plan, whose table contains it"),
        (("--outfits", "made", "--garment", "tops"), "--garment: not allowed with --outfits"),
        (("--most-frames", "5"), "--most-frames: needs --outfits"),
    ],
)
def test_options_that_would_do_nothing_are_refused(monkeypatch, capsys, tmp_path, words, sentence):
    monkeypatch.chdir(tmp_path)
    Path("made").mkdir()
    for name in ("b.npz", "p.csv"):
        Path(name).touch()
    command = ("simulate", "walk", *words, "--out", str(tmp_path / "out"))
    assert run(monkeypatch, *command) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_help_says_defaults_once_and_titles_its_groups(monkeypatch, capsys, command):
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit) as exit_:
        run(monkeypatch, command, "--help")
    assert exit_.value.code == 0
    printed = capsys.readouterr().out
    assert "options options" not in printed
    assert not re.search(r"(\(default: [^)]*\))\W*\1", printed)


@pytest.mark.parametrize("command", ["rollout", "view"])
def test_help_names_every_method_of_the_registry(monkeypatch, capsys, command):
    with pytest.raises(SystemExit):
        run(monkeypatch, command, "--help")
    words = set(re.findall(r"\w+", capsys.readouterr().out))
    assert set(METHODS) <= words


def test_help_of_export_names_the_rigs(monkeypatch, capsys):
    with pytest.raises(SystemExit):
        run(monkeypatch, "export", "--help")
    words = set(re.findall(r"\w+", capsys.readouterr().out))
    assert words & set(METHODS) == {name for name, method in METHODS.items() if method.rig}
