"""Bodies of SMPL model files: a made-up person in their schema, against SMPL's equations; hostile pickles."""

import os
import pickle
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from scipy.sparse import csc_matrix

from tests.bodies.smpl_file import smpl_arrays, smpl_vertices, write_npz, write_pickle
from uvcloth.bodies.body import REGIONS, load_body, save_body
from uvcloth.bodies.layout import layout_of
from uvcloth.bodies.posing import posed_skin
from uvcloth.bodies.smpl import read_smpl
from uvcloth.bodies.smpl_joints import SMPL_JOINTS
from uvcloth.commands.body import MakeBody, Phenotype
from uvcloth.commands.run.body import make
from uvcloth.errors import InputError
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.geometry.skeleton import joint_transforms, world_rotations
from uvcloth.motion.retarget import REQUIRED_ROLES

Arrays = dict[str, np.ndarray]

STAND = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From Y up, facing +Z, to Z up, facing -Y."""


@pytest.fixture(scope="module")
def arrays() -> Arrays:
    return smpl_arrays()


@pytest.fixture(scope="module")
def file(arrays: Arrays, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_npz(tmp_path_factory.mktemp("smpl") / "person.npz", arrays)


@pytest.fixture(scope="module")
def coarse() -> Arrays:
    """Arrays of a person in few vertices, for what only reads them."""
    return smpl_arrays(voxel=0.06)


def a_pose(joints: int, seed: int = 1) -> np.ndarray:
    return 0.4 * np.random.default_rng(seed).standard_normal((joints, 3))


@pytest.mark.parametrize("rest_turn", [0.0, 0.15])
def test_a_posed_body_is_that_of_smpls_equations(arrays: Arrays, file: Path, rest_turn: float) -> None:
    betas = np.array([0.8, -0.5, 0.3])
    rest = np.zeros((24, 3))
    rest[1, 2], rest[2, 2] = rest_turn, -rest_turn
    body = read_smpl(file).resting(torch.from_numpy(rest)).body(torch.from_numpy(betas), unwrapped=False)
    pose, trans = a_pose(24), np.array([0.3, 1.0, -0.2])
    vertices, joints = smpl_vertices(arrays, betas, pose, trans)

    at_rest = world_rotations(body.skeleton.parents, from_axis_angles(torch.from_numpy(rest).float())[None])
    posed = world_rotations(body.skeleton.parents, from_axis_angles(torch.from_numpy(pose).float())[None])
    stand = torch.from_numpy(STAND).float()
    rotations = stand @ posed @ at_rest.mT @ stand.mT
    transforms = joint_transforms(
        body.skeleton, rotations, torch.from_numpy(joints[0] @ STAND.T).float()[None]
    )
    found = posed_skin(body, transforms)[0].double().numpy() @ STAND
    off = np.linalg.norm(found - vertices, axis=1)
    one_joint = arrays["weights"].max(1) > 0.9999
    assert one_joint.any()
    assert not one_joint.all()
    assert off[one_joint].max() < 1e-5
    # Between pelvis and thighs, skinning to the turned rest pose and from there is that from the T nearly.
    assert off.max() < (1e-5 if rest_turn == 0.0 else 2e-3)


def test_corrections_for_the_pose_survive_a_file_and_skinning_without_them_differs(
    coarse: Arrays, tmp_path: Path
) -> None:
    model = read_smpl(write_npz(tmp_path / "person.npz", coarse))
    body = model.resting().body(torch.zeros(0), unwrapped=False)
    save_body(body, tmp_path / "b.npz")
    again = load_body(tmp_path / "b.npz")
    transforms = joint_transforms(
        body.skeleton,
        from_axis_angles(torch.from_numpy(a_pose(48).reshape(2, 24, 3)).float()),
        torch.zeros(2, 3),
    )
    torch.testing.assert_close(posed_skin(again, transforms), posed_skin(body, transforms), atol=1e-5, rtol=0)
    assert body.pose_shapes is not None
    assert again.pose_shapes is not None
    flat = posed_skin(replace(body, pose_shapes=None), transforms)
    assert float((flat - posed_skin(body, transforms)).abs().max()) > 5e-3


@pytest.mark.parametrize(("kind", "joints"), [("SMPL", 24), ("SMPL-H", 52), ("SMPL-X", 55)])
def test_the_models_have_their_joints_regions_and_sides(kind: str, joints: int, tmp_path: Path) -> None:
    model = read_smpl(write_npz(tmp_path / "person.npz", smpl_arrays(kind, voxel=0.04)))
    body = model.resting().body(torch.zeros(10), unwrapped=False)
    assert model.kind == kind
    assert body.skeleton.names == SMPL_JOINTS[kind]
    assert len(body.skeleton.names) == joints
    assert set(REQUIRED_ROLES) <= body.skeleton.roles.keys()
    mesh = trimesh.Trimesh(body.mesh.vertices.numpy(), body.mesh.faces.numpy(), process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0
    # Facing -Y the left is at +X, the head at the top, the toes in front.
    middle = body.mesh.vertices[body.mesh.faces].mean(1)
    assert float(middle[body.sides == 1, 0].min()) > -0.03
    assert float(middle[body.sides == -1, 0].max()) < 0.03
    by_region = {name: middle[body.regions == index] for index, name in enumerate(REGIONS)}
    assert all(len(faces) for faces in by_region.values())
    assert float(by_region["head"][:, 2].min()) > float(by_region["thigh"][:, 2].max())
    assert float(by_region["foot"][:, 1].min()) < float(by_region["calf"][:, 1].min())
    assert float(by_region["hand"][:, 0].abs().min()) > float(by_region["upper_arm"][:, 0].abs().max()) - 0.1


def test_the_command_makes_a_body_with_texture_coordinates_and_a_layout(file: Path, tmp_path: Path) -> None:
    body = make(MakeBody(tmp_path / "tall.npz", smpl=file, betas=(1.0,)))
    again = load_body(tmp_path / "tall.npz")
    assert again.name == "tall"
    assert len(again.mesh.uvs) > len(again.mesh.vertices)
    plain = read_smpl(file).resting().body(torch.zeros(0), unwrapped=False)
    height, tall = (float(np.ptp(each.mesh.vertices[:, 2].numpy())) for each in (plain, again))
    assert tall == pytest.approx(1.1 * height, rel=1e-4)
    assert len(layout_of(body).islands.unique()) == 6
    with pytest.raises(InputError, match=r"person\.npz.*cannot be combined with phenotypes"):
        make(MakeBody(tmp_path / "x.npz", smpl=file, phenotype=Phenotype(height=1.0)))
    with pytest.raises(InputError, match="has 10 shape parameters, 11 were given"):
        make(MakeBody(tmp_path / "x.npz", smpl=file, betas=(0.0,) * 11))
    with pytest.raises(InputError, match="not a finite number"):
        make(MakeBody(tmp_path / "x.npz", smpl=file, betas=(float("nan"),)))
    assert not (tmp_path / "x.npz").exists()


def chumpy() -> dict[str, ModuleType]:
    """Modules in which classes are named as chumpy names its own, which old files hold arrays in."""
    modules = {name: ModuleType(name) for name in ("chumpy", "chumpy.ch", "chumpy.reordering")}
    for module, name in (("chumpy.ch", "Ch"), ("chumpy.reordering", "Select")):
        setattr(modules[module], name, type(name, (), {"__module__": module}))
    return modules


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_an_old_pickle_gives_the_same_model(
    coarse: Arrays, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, protocol: int
) -> None:
    few = {**coarse, "J": coarse["J_regressor"] @ coarse["v_template"]}
    for name, module in chumpy().items():
        monkeypatch.setitem(sys.modules, name, module)
    ch, select = sys.modules["chumpy.ch"].Ch, sys.modules["chumpy.reordering"].Select

    def held(values: np.ndarray) -> Any:
        made = ch()
        made.__dict__.update(x=values, _dirty_vars=set(), _itr=None, _depends_on_deps={})
        return made

    chosen = select()
    wide = np.concatenate([few["shapedirs"], np.ones_like(few["shapedirs"])], axis=2)
    places = np.arange(wide.size).reshape(wide.shape)[..., :10].ravel()
    chosen.__dict__.update(a=held(wide), idxs=places, preferred_shape=few["shapedirs"].shape)
    old = {
        **few,
        "shapedirs": chosen,
        "posedirs": held(np.asfortranarray(few["posedirs"])),
        "J_regressor": csc_matrix(few["J_regressor"]),
        "bs_style": "lbs",
        "f": few["f"].astype(">u4"),
    }
    path = write_pickle(tmp_path / "person.pkl", old, protocol)
    for name in chumpy():
        monkeypatch.delitem(sys.modules, name)
    found, expected = read_smpl(path), read_smpl(write_npz(tmp_path / "person.npz", few))
    for name in ("template", "faces", "shapes", "pose_shapes", "weights", "regressor"):
        torch.testing.assert_close(getattr(found, name), getattr(expected, name), rtol=0, atol=1e-7)
    assert found.parents == expected.parents


class Shell:
    """Runs a command when it is unpickled."""

    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (self.command,)


@pytest.mark.parametrize("place", ["v_template", "extra", "inside"])
def test_code_in_a_pickle_is_refused_and_does_not_run(coarse: Arrays, tmp_path: Path, place: str) -> None:
    ran = tmp_path / "ran"
    evil: Any = Shell(f"touch {ran}")
    content: dict[str, Any] = dict(coarse)
    content[place] = [{"deep": (evil,)}] if place == "inside" else evil
    path = write_pickle(tmp_path / "person.pkl", content)
    with pytest.raises(InputError, match=r"person\.pkl: the pickle asks for (posix|nt)\.system") as caught:
        read_smpl(path)
    assert "\n" not in str(caught.value)
    assert not ran.exists()
    pickle.loads(path.read_bytes())
    assert ran.exists()


class Unknown:
    """A class of some other program."""


HOSTILE = {
    "unknown class": pickle.dumps({"f": Unknown()}, protocol=2),
    "getattr": pickle.dumps({"f": getattr}),
    "eval by name": b"c__builtin__\neval\n(S'1+1'\ntR.",
    "registered code": b"\x80\x02\x82\x01.",
    "persistent id": b"Pelsewhere\n.",
    "numpy's loader": b"cnumpy\nload\n(S'x'\ntR.",
    "calls a value": b"I1\n(tR.",
    "builds a class": b"cnumpy\nndarray\n}b.",
    "no dictionary": pickle.dumps([1, 2]),
    "truncated": pickle.dumps({"f": np.zeros((3, 3))}, protocol=2)[:-20],
    "no pickle": b"v 0 0 0\nv 1 0 0\n",
    "empty": b"",
    "endless number": b"F" + 3000 * b"x\x85" + b"\n.",
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_or_damaged_pickle_is_one_sentence(tmp_path: Path, what: str) -> None:
    path = tmp_path / "person.pkl"
    path.write_bytes(HOSTILE[what])
    with pytest.raises(InputError, match=r"person\.pkl: ") as caught:
        read_smpl(path)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 400 + len(str(path))


class Reduced:
    """An object that a pickle rebuilds by a call, and a state."""

    def __init__(self, *parts: Any) -> None:
        self.parts = parts

    def __reduce__(self) -> tuple[Any, ...]:
        return self.parts


def a_lie(shape: tuple[int, ...], code: str = "f8") -> Reduced:
    """A pickled array of eight bytes that is not what it says."""
    kind = Reduced(np.dtype, (code, False, True), (3, "<", None, None, None, -1, -1, 0))
    return Reduced(
        np.zeros(1).__reduce__()[0], (np.ndarray, (0,), b"b"), (1, shape, kind, False, b"12345678")
    )


@pytest.mark.parametrize(
    ("shape", "code"), [((1000, 1000), "f8"), ((-1,), "f8"), ((1,), "O8"), ((1,), "V8"), ((2**62, 4), "f8")]
)
def test_an_array_that_is_not_what_it_says_is_refused(
    coarse: Arrays, tmp_path: Path, shape: tuple[int, ...], code: str
) -> None:
    path = write_pickle(tmp_path / "person.pkl", {**coarse, "v_template": a_lie(shape, code)})
    with pytest.raises(InputError, match=r"person\.pkl: v_template holds an array of"):
        read_smpl(path)


def test_a_sparse_matrix_whose_parts_do_not_fit_is_refused(coarse: Arrays, tmp_path: Path) -> None:
    matrix = csc_matrix(coarse["J_regressor"])
    matrix.indices[0] = 99
    path = write_pickle(tmp_path / "person.pkl", {**coarse, "J_regressor": matrix})
    with pytest.raises(InputError, match=r"person\.pkl: J_regressor holds"):
        read_smpl(path)


FAULTS = {
    "weights has the shape": lambda a: {**a, "weights": a["weights"][:, :23]},
    "v_template has the shape": lambda a: {**a, "v_template": a["v_template"][:-1]},
    "posedirs has the shape": lambda a: {**a, "posedirs": a["posedirs"][..., :9]},
    "J_regressor has the shape": lambda a: {**a, "J_regressor": a["J_regressor"].T},
    r"f holds \d+, expected 0 to": lambda a: {**a, "f": a["f"] + 5},
    "lacks posedirs, f": lambda a: {k: v for k, v in a.items() if k not in ("posedirs", "f")},
    "v_template holds a value that is not a finite": lambda a: {**a, "v_template": a["v_template"] * np.nan},
    "weights of a vertex": lambda a: {**a, "weights": a["weights"] * 2},
    "kintree_table has a joint before": lambda a: {**a, "kintree_table": a["kintree_table"][:, ::-1]},
    "f is pickled, .*nothing is unpickled": lambda a: {**a, "f": np.array([{}], dtype=object)},
    "weights holds no numbers": lambda a: {**a, "weights": np.array(["a"])},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_model_file_is_one_sentence(coarse: Arrays, tmp_path: Path, fault: str) -> None:
    path = write_npz(tmp_path / "person.npz", FAULTS[fault](coarse))
    with pytest.raises(InputError, match=rf"person\.npz: .*{fault}") as caught:
        read_smpl(path)
    assert "\n" not in str(caught.value)


def test_a_truncated_or_missing_npz_is_one_sentence(file: Path, tmp_path: Path) -> None:
    path = tmp_path / "person.npz"
    path.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    for broken in (path, tmp_path / "none.npz", tmp_path / "none.pkl"):
        with pytest.raises(InputError, match=broken.name):
            read_smpl(broken)


def test_a_pickle_takes_no_time_or_memory_for_a_number_in_it(coarse: Arrays, tmp_path: Path) -> None:
    """Pairs of pairs, 60 deep, as a key or as the parts of an array; a place of 10^8 in the memo."""
    pairs = b"\x80\x02}N" + b"2\x86" * 60
    far = b"\x80\x02}r" + (100_000_000).to_bytes(4, "little") + b"."
    sizes = b"\x80\x05\x96" + (2**40).to_bytes(8, "little") + b"."
    for content in (pairs + b"Ns.", far, sizes):
        path = tmp_path / "person.pkl"
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"person\.pkl: "):
            read_smpl(path)
    nested: Any = 0.0
    for _ in range(60):
        nested = (nested, nested)
    path = write_pickle(tmp_path / "person.pkl", {**coarse, "f": nested})
    with pytest.raises(InputError, match="f holds a tuple where an array was expected"):
        read_smpl(path)
