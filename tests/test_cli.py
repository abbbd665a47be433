"""The command line: what it parses, what it calls, and how it fails."""

import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from rasterize.errors import InputError
from uvcloth import cli

HEAVY = ("torch", "warp", "newton", "lightning", "scipy", "trimesh", "pxr", "kornia", "anny")


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
    for subcommand in ("body", "simulate", "data", "maps", "fit", "rollout", "poses", "export", "demo"):
        assert subcommand in done.stdout


def test_simulate_hands_everything_on(monkeypatch, stand_in):
    from uvcloth.simulate import batch
    from uvcloth.simulate.plan import ClipSelection

    calls = []
    monkeypatch.setattr(batch, "simulate_batch", lambda *given, **options: calls.append((given, options)))
    stand_in("uvcloth.bodies.body", load_body=lambda path: f"body from {path}")
    arguments = ("a.bvh", "walk", "--garment", "tops", "dress", "--out", "data", "--jobs", "2")
    assert run(monkeypatch, "simulate", *arguments, "--windows", "index.csv", "--body", "b.npz") == 0
    assert run(monkeypatch, "simulate", *arguments, "--layered", "--engine", "blender", "--repeat") == 0
    (alone, first), (_, second) = calls
    assert alone == (ClipSelection(("a.bvh", "walk"), Path("index.csv")),)
    assert (first["out"], first["body"]) == (Path("data"), "body from b.npz")
    assert first["workers"] == batch.Workers(jobs=2)
    assert (first["engine"], first["repeat"], second["engine"], second["repeat"]) == (
        "newton",
        False,
        "blender",
        True,
    )
    assert [list(outfit) for outfit in first["outfits"]] == [["tops"], ["dress"]]
    assert [list(outfit) for outfit in second["outfits"]] == [["tops", "dress"]]


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

    monkeypatch.setattr("uvcloth.motion.draw_poses.draw_poses", stop)
    (tmp_path / "a.bvh").touch()
    header = "trial,subject,split,action,window_start,window_frames\n"
    (tmp_path / "mine.csv").write_text(header + "a,ann,test,walk,0,9\nb,ann,unused,walk,0,9\n")
    words = ("poses", "--windows", str(tmp_path / "mine.csv"), "--out", str(tmp_path / "out" / "poses.npz"))
    assert run(monkeypatch, *words) == 2
    assert "--windows and --clips-from go together" in capsys.readouterr().err
    assert run(monkeypatch, *words, "--clips-from", str(tmp_path)) == 130
    assert asked == [("a", "test", "ann")]


def test_what_poses_cannot_do_is_refused_before_drawing(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("uvcloth.motion.draw_poses.draw_poses", None)
    (tmp_path / "file").write_text("mine")
    negative = ("poses", "run", "--out", str(tmp_path / "poses.npz"), "--recombine", "-1")
    assert run(monkeypatch, *negative) == 2
    assert "--recombine -1: expected a number of poses, 0 or more" in capsys.readouterr().err
    assert run(monkeypatch, "poses", "run", "--out", str(tmp_path / "file" / "poses.npz")) == 2
    assert "file: cannot be made a folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_an_interrupted_drawing_leaves_nothing(monkeypatch, tmp_path):
    def interrupt(contact, vertices):
        raise KeyboardInterrupt

    monkeypatch.setattr("uvcloth.physics.self_contact.SelfContact.clear", interrupt)
    assert run(monkeypatch, "poses", "run", "--out", str(tmp_path / "poses.npz")) == 130
    assert not list(tmp_path.iterdir())


def test_export_hands_everything_on(monkeypatch, stand_in, capsys):
    calls = []

    def export(*given, **options):
        calls.append((given, options))
        return SimpleNamespace(lines=lambda: ["out.glb: 1.0 MB"])

    stand_in("uvcloth.commands.export_rig", export=export)
    assert run(monkeypatch, "export", "--model", "runs/a", "--out", "out.glb") == 0
    more = ("--motion", "walk", "--shapes", "40", "--body", "b.npz", "--no-with-body")
    assert run(monkeypatch, "export", "--model", "runs/a", "--out", "out.glb", *more) == 0
    plain = {"motion": None, "shapes": None, "body_file": None, "with_body": True}
    named = {"motion": "walk", "shapes": 40, "body_file": Path("b.npz"), "with_body": False}
    assert calls == [(("runs/a", Path("out.glb")), options) for options in (plain, named)]
    assert capsys.readouterr().out == "out.glb: 1.0 MB\n" * 2


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (InputError("walk.bvh: line 7 is not a number"), (2, "uvcloth: walk.bvh: line 7 is not a number\n")),
        (KeyboardInterrupt(), (130, "uvcloth: interrupted; finished work is in place\n")),
    ],
)
def test_failing_commands_say_one_sentence(monkeypatch, stand_in, capsys, error, expected):
    def failing(out):
        raise error

    stand_in("uvcloth.commands.demo", run=failing)
    assert (run(monkeypatch, "demo"), capsys.readouterr().err) == expected


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "--out", "x"), "at least one clip"),
        (("simulate", "walk", "--out", "x", "--garment"), "one garment"),
        (("rollout", "--motion", "walk", "--out", "x.glb", "--garment"), "at least one garment"),
        (("fit", "nowhere.obj", "--body", "nowhere.npz"), "nowhere.npz: no such file"),
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
