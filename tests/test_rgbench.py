"""RGBench's captures in our solver, on made-up ones in its layout: a sheet that two grippers lower."""

import csv
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.rgbench import __main__ as rgbench
from benchmarks.rgbench.env import GRIP, UvclothEnv, fabric_of
from benchmarks.rgbench.files import Cell, read_cloud, read_path, read_results, read_runs, write_results
from tests.simulation.physics.scenes import sheet
from uvcloth.errors import InputError
from uvcloth.physics.cloth.solver import Settings
from uvcloth.physics.fabric import Fabric

BEGIN = 1.7529e9
"""Seconds since the epoch at which the recordings begin."""

pytestmark = pytest.mark.thorough

PLACE = np.array([0.1, 0.0, 0.01])
SIZE = 0.2
FABRIC = {"stretch": 2e4, "bending": 3e4, "density": 200.0, "friction": 0.3, "damping": 0.1, "poisson": 0.2}
PREPARE, WAIT = 0.4, 0.2

TO_CAMERA = np.eye(4)
TO_CAMERA[:3, :3] = Rotation.from_euler("xyz", [2.0, 0.3, -0.4]).as_matrix()
TO_CAMERA[:3, 3] = 0.1, -0.2, 0.9

Points = NDArray[np.float64]


def square(rows: int) -> tuple[Points, NDArray[np.int64]]:
    vertices, faces = sheet(SIZE, SIZE, rows, rows)
    return vertices.double().numpy(), faces.numpy()


def lowered(times: Points) -> Points:
    """Places (T, 2, 3) m of grippers that swing a sheet by two corners while they lower it to the ground."""
    down = 0.05 + 0.125 * (1.0 + np.cos(np.pi * np.clip(times / 0.8, 0.0, 1.0)))
    along = 0.1 + 0.05 * np.sin(2.0 * np.pi * 1.5 * times)
    return np.stack([np.stack([along, np.full_like(times, y), down], 1) for y in (SIZE, 0.0)], 1)


def write(path: Path, content: str | bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def write_cloud(path: Path, points: Points, storage: str = "binary") -> None:
    """Write points (P, 3), m in the world, as the camera sees them."""
    seen = (points @ TO_CAMERA[:3, :3].T + TO_CAMERA[:3, 3]).astype("<f4")
    head = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\n"
    head += f"TYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {len(seen)}\nHEIGHT 1\nPOINTS {len(seen)}\n"
    rows = np.concatenate([seen, np.zeros((len(seen), 1), "<f4")], 1)
    text = "\n".join(" ".join(f"{value:.9g}" for value in row) for row in rows)
    body = text.encode() if storage == "ascii" else rows.tobytes()
    write(path, head.encode() + f"DATA {storage}\n".encode() + body)


class MadeUp:
    """A folder of RGBench with one garment, and captures of it."""

    def __init__(
        self, folder: Path, vertices: Points, faces: NDArray[np.integer], shoulders: list[int]
    ) -> None:
        self.folder, self.data = folder, folder / "data" / "sample"
        self.experiments: dict[str, Any] = {}
        self.write_yaml(
            "configs/main.yaml",
            {
                "dataset_path": "${oc.env:RGBENCH_DATA_ROOT,${hydra:runtime.cwd}/data/sample}",
                "generated_paths": {"init_pose": [*PLACE.tolist(), 1.0, 0.0, 0.0, 0.0]},
                "active_run": {
                    "action": {
                        "type": "${params.action_type}",
                        "fling_prepare_time": PREPARE,
                        "fling_wait_time": WAIT,
                    }
                },
            },
        )
        self.parameters = {
            "cloth_model_file_name": "Square/square.obj",
            "shoulder_index": shoulders,
            **FABRIC,
        }
        self.write_yaml("configs/cloth_params/square.yaml", self.parameters)
        self.write_mesh(vertices, faces)
        write(
            folder / "results" / "paper_baselines.csv",
            "garment,action,simulator,mode,cd_l1_r2s\nsquare,fling,pybullet,fixed_point,0.0431\n"
            "square,fling,pybullet,robot,0.9\nother,fling,pybullet,fixed_point,0.7\n",
        )

    def write_yaml(self, name: str, content: Mapping[str, Any]) -> None:
        write(self.folder / name, yaml.safe_dump(dict(content)))

    def write_mesh(self, vertices: Points, faces: NDArray[np.integer]) -> None:
        lines = [*(f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices)]
        lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
        write(self.data / "meshes" / "Square" / "square.obj", "\n".join(lines))

    def capture(self, action: str, times: Points, places: Points, window: tuple[float, float]) -> None:
        """Add a capture whose grippers are at places (T, 2, 3) m, at times (T,) s after the beginning."""
        window_of = {f"start_{kind}_time": window[0] for kind in ("record", "calculate")}
        window_of |= {f"end_{kind}_time": window[1] for kind in ("record", "calculate")}
        experiment = {"camera_delay": 0.02, "data_subfolder": f"square/{action}", "evaluate": window_of}
        self.experiments[action] = {"piper": {"01": experiment}}
        self.write_yaml("configs/experiment_library.yaml", {"experiments": {"square": self.experiments}})
        root = self.data / "square" / action
        write(root / "calibration" / "world_to_camera_transform.json", json.dumps(TO_CAMERA.tolist()))
        for arm, base, path in zip(("left", "right"), (0.25, -0.25), places.transpose(1, 0, 2), strict=True):
            local = path - np.array([0.0, base, 0.0])
            rows = [
                f"{BEGIN + t:.6f},0.1,{x:.9f},{y:.9f},{z:.9f}"
                for t, (x, y, z) in zip(times, local, strict=True)
            ]
            write(
                root / "joints" / f"{arm}_arm_joint_states_and_end_pose.csv",
                "\n".join(["time,pos_1,pos_x,pos_y,pos_z", *rows]),
            )

    def run(self, action: str) -> dict[str, Any]:
        return read_runs(self.folder, self.data)[Cell("square", action, "01")]

    def film(self, action: str, clouds: Mapping[float, Points]) -> None:
        """Put point clouds (P, 3), m in the world, at times into a capture."""
        folder = self.data / "square" / action / "segment_pcds"
        for time, points in clouds.items():
            write_cloud(folder / f"pointcloud_{BEGIN + time:.6f}_segmented.pcd", points)


TIMES = np.arange(0.0, 1.3001, 0.01)
FILMED = np.arange(1.0, 10.0) / 8.0
"""Seconds at which there are point clouds, exact in names of files: folding cloth multiplies differences."""


@pytest.fixture
def made(tmp_path: Path) -> MadeUp:
    """A sheet of 5 by 5 vertices, lowered."""
    made = MadeUp(tmp_path / "RGBench", *square(5), shoulders=[4, 0])
    made.capture("fling", TIMES, lowered(TIMES), (0.05, 1.25))
    made.film("fling", dict.fromkeys(FILMED.tolist(), square(5)[0]))
    return made


def played(run: Mapping[str, Any], lead: float) -> dict[float, Points]:
    """Vertices (N, 3) m of the simulation when each point cloud is taken: the camera is late."""
    env, frames = UvclothEnv(run), {}
    for time in FILMED.tolist():
        env.step_to_time(time + 0.02 + lead)
        frames[time] = env.get_sim_vertices()
    return frames


def results_of(made: MadeUp) -> list[dict[str, str]]:
    out = made.folder / "results.csv"
    out.unlink(missing_ok=True)
    rgbench.main(made.folder, out)
    with out.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_chamfer_distance_is_nothing_from_itself_and_the_shift_of_a_shifted_cloud() -> None:
    points = square(9)[0]
    shifted = points + np.array([0.0, 0.0, 0.004])
    for norm in (1, 2):
        assert rgbench.chamfer(points, points, norm) == 0.0
        assert rgbench.chamfer(points, shifted, norm) == pytest.approx(0.004)
    slanted = points + np.array([0.003, 0.004, 0.0])
    assert rgbench.chamfer(points, slanted, 1) == pytest.approx(0.007)
    assert rgbench.chamfer(points, slanted, 2) == pytest.approx(0.005)


def test_pins_follow_their_path_and_the_ground_holds_the_cloth(made: MadeUp) -> None:
    made.write_mesh(*square(9))
    made.write_yaml("configs/cloth_params/square.yaml", {**made.parameters, "shoulder_index": [8, 0]})
    env = UvclothEnv(made.run("fling"))
    lead, lowest, off = PREPARE + WAIT, [], []
    np.testing.assert_allclose(env.pins(), square(9)[0][[8, 0]] + PLACE, atol=1e-6)
    while env.get_current_sim_time() < lead + 1.29:
        env.step()
        if (time := env.get_current_sim_time()) > PREPARE:
            off.append(np.linalg.norm(env.pins() - lowered(np.array([max(time - lead, 0.0)]))[0], axis=1))
        lowest.append(env.get_sim_vertices()[:, 2].min())
    assert np.max(off) < 1e-3
    assert min(lowest) > -1e-3
    lying = env.get_sim_vertices()[:, 2] < 2.0 * Settings().radius
    assert lying.mean() > 0.4


def test_a_simulation_is_no_distance_from_its_own_clouds_and_near_those_of_another_mesh(made: MadeUp) -> None:
    lead = PREPARE + WAIT
    coarse = played(made.run("fling"), lead)
    made.film("fling", coarse)
    (itself,) = results_of(made)
    assert itself["clouds"] == str(len(FILMED))
    assert max(float(itself[name]) for name in rgbench.METRICS) < 1e-6
    made.film("fling", {time: points + np.array([0.0, 0.0, 1e-3]) for time, points in coarse.items()})
    (shifted,) = results_of(made)
    assert [float(shifted[name]) for name in rgbench.METRICS] == pytest.approx([1e-3] * 3, rel=1e-3)
    made.film("fling", coarse)
    made.write_mesh(*square(9))
    made.write_yaml("configs/cloth_params/square.yaml", {**made.parameters, "shoulder_index": [8, 0]})
    (finer,) = results_of(made)
    half_an_edge = SIZE / 8.0
    assert 1e-4 < float(finer["cd_l1_r2s"]) < half_an_edge


def test_a_hanging_strip_is_stretched_by_its_weight(tmp_path: Path) -> None:
    """By density x g x (length x s - s^2 / 2) / stiffness at s from the top, in the mean: it bounces.

    Of little stretch: at 5 % the membrane is no longer linear.
    """
    length, rows = 0.5, 26
    vertices, faces = sheet(length, 0.02, rows, 2)
    upright = np.stack([0.0 * vertices[:, 0], vertices[:, 1], 0.8 - vertices[:, 0]], 1).astype(np.float64)
    made = MadeUp(tmp_path, upright, faces.numpy(), shoulders=[1, 0])
    made.write_yaml("configs/cloth_params/square.yaml", {**made.parameters, "stretch": 1e5, "poisson": 0.0})
    still = np.repeat((upright + PLACE)[None, [1, 0]], 2, axis=0)
    made.capture("fling", np.array([0.0, 5.0]), still, (0.0, 5.0))
    stiffness, density = 100.0, 0.2
    period = 4.0 * length * np.sqrt(density / stiffness)
    env, frames = UvclothEnv(made.run("fling")), []
    for time in np.arange(1, 201) * (5.0 * period / 200.0):
        env.step_to_time(time)
        frames.append(env.get_sim_vertices())
    below = 0.8 - upright[:, 2]
    expected = upright + PLACE
    expected[:, 2] -= density * 9.81 * (length * below - below**2 / 2.0) / stiffness
    stretch = (upright + PLACE - expected)[-1, 2]
    reached = (upright + PLACE - np.mean(frames, 0))[-2:, 2].mean()
    assert reached == pytest.approx(stretch, rel=0.03)
    assert rgbench.chamfer(expected, np.mean(frames, 0), 1) < 1e-4
    assert rgbench.chamfer(expected, upright + PLACE, 1) > 1.5e-3


def test_grasped_vertices_wait_for_the_grippers(made: MadeUp) -> None:
    """The nearest to where the grippers close: there, and held, before; with them soon after."""
    corners = square(5)[0][[4, 0]] + PLACE
    places = np.stack([corners + np.array([0.002, 0.0, max(0.3 * (t - 0.5), 0.0)]) for t in TIMES])
    made.capture("grasp", TIMES, places, (0.5, 1.25))
    env = UvclothEnv(made.run("grasp"))
    assert env.grippers.grip_distance() == pytest.approx(0.002, abs=1e-6)
    env.step_to_time(0.5)
    np.testing.assert_allclose(env.pins(), corners, atol=1e-4)
    assert env.get_sim_vertices()[:, 2].max() < 0.011
    env.step_to_time(0.5 + 2.0 * GRIP)
    np.testing.assert_allclose(env.pins(), corners + np.array([0.002, 0.0, 0.06]), atol=1e-3)
    assert env.get_master_start_time() == pytest.approx(BEGIN, abs=1e-3)


def test_figures_stand_beside_the_published_ones(made: MadeUp, capsys: pytest.CaptureFixture[str]) -> None:
    made.film("fling", played(made.run("fling"), PREPARE + WAIT))
    results_of(made)
    rows = {line.split()[1]: line for line in capsys.readouterr().out.splitlines() if line.startswith("│")}
    assert "0.0 (1)" in rows["uvcloth"]
    assert rows["pybullet"].count("43.1 (1)") == 2


def test_captures_of_an_earlier_run_are_not_run_again(
    made: MadeUp, capsys: pytest.CaptureFixture[str]
) -> None:
    results_of(made)
    out = made.folder / "results.csv"
    before = {**read_results(out)[Cell("square", "fling", "01")], "cd_l1_r2s": 0.025}
    write_results(out, {Cell("square", "fling", "01"): before})
    rgbench.main(made.folder, out)
    assert "25.0 (1)" in capsys.readouterr().out
    out.write_text(out.read_text().replace("0.025", "little"))
    with pytest.raises(InputError, match=r"results\.csv: cd_l1_r2s is little, expected a number"):
        rgbench.main(made.folder, out)


def test_fabrics_are_in_grams_millimetres_and_seconds() -> None:
    coat = {"stretch": 1e6, "bending": 20000, "density": 400.0, "friction": 0.3}
    fabric = fabric_of(coat, "coat.yaml")
    assert fabric == Fabric(density=0.4, stretch=1000.0, poisson=0.35, bend=2e-5, friction=0.3)
    assert fabric_of({**coat, "ground_friction": 0.2}, "coat.yaml").friction == 0.2


def test_text_and_binary_clouds_are_the_same(tmp_path: Path) -> None:
    points = square(5)[0]
    for storage in ("ascii", "binary"):
        write_cloud(tmp_path / storage, points, storage)
        world = (read_cloud(tmp_path / storage) - TO_CAMERA[:3, 3]) @ TO_CAMERA[:3, :3]
        np.testing.assert_allclose(world, points, atol=1e-6)


def test_paths_are_in_the_world(made: MadeUp) -> None:
    path = read_path(made.run("fling")["data"]["robot_joints"]["left_arm_csv_path"], (0.0, 0.25, 0.0))
    np.testing.assert_allclose(path.at(BEGIN + 0.105), lowered(np.array([0.105]))[0, 0], atol=1e-4)
    np.testing.assert_allclose(path.at(0.0), lowered(np.zeros(1))[0, 0], atol=1e-6)


LEFT = "data/sample/square/fling/joints/left_arm_joint_states_and_end_pose.csv"


def shortened(text: str) -> str:
    return "\n".join(text.splitlines()[:60])


def cut_row(text: str) -> str:
    return text.rsplit(",", 1)[0]


BAD: dict[str, tuple[str, Callable[[str], str] | None, str]] = {
    "no mesh": ("data/sample/meshes/Square/square.obj", None, "no such file"),
    "no fabric": ("configs/cloth_params/square.yaml", None, "no such file"),
    "fabric without a stiffness": (
        "configs/cloth_params/square.yaml",
        lambda text: text.replace("stretch", "strength"),
        "lacks stretch",
    ),
    "stiffness no fabric has": (
        "configs/cloth_params/square.yaml",
        lambda text: text.replace("stretch: 20000.0", "stretch: 1.0"),
        "the fabric's stretch is 0.001, expected 1 to 10000",
    ),
    "shoulders beyond the mesh": (
        "configs/cloth_params/square.yaml",
        lambda text: text.replace("- 4", "- 40"),
        "shoulder_index is [40, 0], expected two of 25 vertices",
    ),
    "path too short": (LEFT, shortened, "the path ends after 0.6 s, point clouds after 1.1 s"),
    "row too short": (LEFT, cut_row, "row 131: has another length than the header"),
    "path of words": (LEFT, lambda text: text.replace("0.25", "left"), "not a gripper's path"),
    "no calibration": (
        "data/sample/square/fling/calibration/world_to_camera_transform.json",
        lambda text: "[[1, 2], [3, 4]]",
        "not an invertible matrix",
    ),
    "no list": ("configs/experiment_library.yaml", lambda text: "experiments: [", "not readable as YAML"),
    "no figures": ("results/paper_baselines.csv", lambda text: "garment,action\n", "has no column"),
}


@pytest.mark.parametrize("bad", BAD)
def test_bad_input_names_the_file(made: MadeUp, bad: str) -> None:
    name, change, sentence = BAD[bad]
    path = made.folder / name
    if change is None:
        path.unlink()
    else:
        path.write_text(change(path.read_text()))
    with pytest.raises(InputError) as raised:
        rgbench.main(made.folder, made.folder / "results.csv")
    assert sentence in str(raised.value)
    assert path.name in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_compressed_cloud_is_refused(tmp_path: Path) -> None:
    write_cloud(tmp_path / "cloud.pcd", square(5)[0], "binary_compressed")
    with pytest.raises(InputError, match=r"cloud\.pcd: .*binary_compressed"):
        read_cloud(tmp_path / "cloud.pcd")


def test_it_says_where_captures_are_to_be_had(made: MadeUp, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no captures; scripts/download_data\.py .*huggingface\.co"):
        rgbench.main(made.folder, tmp_path / "results.csv", data=tmp_path)
    with pytest.raises(InputError, match="has no garment trousers, expected square"):
        rgbench.main(made.folder, tmp_path / "results.csv", garments=("trousers",))
