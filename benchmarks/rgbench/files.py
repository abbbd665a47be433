"""Files of RGBench: its list of captures, gripper paths, point clouds and published results."""

import csv
import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from uvcloth.errors import InputError, cause
from uvcloth.files.atomic import atomic_write
from uvcloth.files.json_file import read_json_document
from uvcloth.files.reading import read_content

Points = NDArray[np.float64]

METRICS = ("cd_l1_r2s", "cd_l1_s2r", "cd_l2_s2r")
"""Chamfer distances, m, by their names in the published table; the paper ranks by the first."""

RESULTS = ("clouds", *METRICS, "grip_distance", "seconds")
"""Columns of our table: point clouds that were measured, distances, m, and the time that it took, s."""

MODE, ROBOT, ARMS = "fixed_point", "piper", ("left", "right")

PCD_TYPES = {
    "F4": "<f4",
    "F8": "<f8",
    "U1": "u1",
    "U2": "<u2",
    "U4": "<u4",
    "I1": "i1",
    "I2": "<i2",
    "I4": "<i4",
}
"""Types of numbers in a binary point cloud, by TYPE and SIZE."""


class Cell(NamedTuple):
    """Garment, action and sample of a capture."""

    garment: str
    action: str
    sample: str


@dataclass(frozen=True)
class GripperPath:
    """Recorded positions of a gripper. times: (T,) s since the epoch. points: (T, 3) m in the world."""

    times: Points
    points: Points

    def at(self, time: float) -> Points:
        """Position (3,) m at a time, s since the epoch; its first one before, its last one after."""
        return np.array([np.interp(time, self.times, axis) for axis in self.points.T], np.float64)


def read_yaml(path: Path) -> dict[str, Any]:
    """Read settings. Raises InputError naming a file that is missing or holds anything else."""
    try:
        document = yaml.safe_load(read_content(path))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as YAML ({cause(error)})") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: expected settings by name")
    return document


def entry(settings: Any, path: Path | str, *names: Any) -> Any:
    """A setting below the names of its groups. Raises InputError naming the file that lacks it."""
    for depth, name in enumerate(names, start=1):
        try:
            settings = settings[name]
        except (KeyError, TypeError) as error:
            raise InputError(f"{path}: lacks {'.'.join(map(str, names[:depth]))}") from error
    return settings


def number(settings: Any, path: Path | str, *names: Any) -> float:
    """A setting that is a finite number. Raises InputError for any other."""
    value = entry(settings, path, *names)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{path}: {'.'.join(map(str, names))} is {value!s:.40}, expected a number")
    return float(value)


def read_runs(folder: Path, data: Path, garments: Iterable[str] = ()) -> dict[Cell, dict[str, Any]]:
    """Settings of each capture in the list of RGBench, as its own programs hand them to a simulator.

    folder: of its repository. data: of its captures and meshes. garments: those wanted, all if empty.
    """
    library = folder / "configs" / "experiment_library.yaml"
    main = folder / "configs" / "main.yaml"
    experiments, general, wanted = (
        entry(read_yaml(library), library, "experiments"),
        read_yaml(main),
        set(garments),
    )
    if unknown := wanted - experiments.keys():
        raise InputError(f"{library}: has no garment {min(unknown)}, expected {', '.join(experiments)}")
    runs = {}
    for garment in wanted or experiments:
        fabric = folder / "configs" / "cloth_params" / f"{garment}.yaml"
        for action, robots in experiments[garment].items():
            for sample, experiment in entry(robots, library, ROBOT).items():
                cell = Cell(garment, action, str(sample))
                runs[cell] = _run(cell, experiment, library, general, main, fabric, data)
    return runs


def _run(
    cell: Cell,
    experiment: Mapping[str, Any],
    library: Path,
    general: Mapping[str, Any],
    main: Path,
    fabric: Path,
    data: Path,
) -> dict[str, Any]:
    capture = data / entry(experiment, library, "data_subfolder")
    parameters = read_yaml(fabric)
    joints = {f"{arm}_arm_csv_path": _joints(capture, arm) for arm in ARMS}
    return {
        "cloth": {
            "name": cell.garment,
            "model_path": data / "meshes" / entry(parameters, fabric, "cloth_model_file_name"),
            "init_pose": entry(general, main, "generated_paths", "init_pose"),
        },
        "cloth_params": parameters,
        "data": {"root": capture, "pcd": capture / "segment_pcds", "robot_joints": joints},
        "action": {**entry(general, main, "active_run", "action"), "type": cell.action},
        "calibration": {"path": capture / "calibration"},
        "camera": {"system_delay_time": number(experiment, library, "camera_delay")},
        "evaluate": entry(experiment, library, "evaluate"),
    }


def _joints(capture: Path, arm: str) -> Path:
    return capture / "joints" / f"{arm}_arm_joint_states_and_end_pose.csv"


def read_path(path: Path, base: Iterable[float]) -> GripperPath:
    """Read the path of a gripper. base: (3,) m, where its arm stands in the world.

    Raises InputError naming a row that is not as long as the others, or no later than the one before.
    """
    columns = ("time", "pos_x", "pos_y", "pos_z")
    rows = read_table(path, columns)
    try:
        values = np.array([[float(row[column]) for column in columns] for row in rows]).reshape(-1, 4)
    except ValueError as error:
        raise InputError(f"{path}: not a gripper's path ({cause(error)})") from error
    if len(values) < 2 or not np.isfinite(values).all():
        raise InputError(f"{path}: {len(values)} rows, expected two or more of finite numbers")
    if (back := np.flatnonzero(np.diff(values[:, 0]) < 0.0)).size:
        raise InputError(f"{path}, row {back[0] + 2}: is earlier than the row before")
    return GripperPath(values[:, 0], values[:, 1:] + np.array(list(base)))


def read_table(path: Path, columns: Iterable[str]) -> list[dict[str, str]]:
    """Rows of a CSV file that has some columns."""
    try:
        rows = list(csv.DictReader(io.StringIO(read_content(path).decode("utf-8-sig"))))
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as CSV ({cause(error)})") from error
    lacking = sorted(set(columns) - set(rows[0] if rows else ()))
    if lacking:
        raise InputError(f"{path}: has no column {lacking[0]}")
    for index, row in enumerate(rows, start=1):
        if None in row or None in row.values():
            raise InputError(f"{path}, row {index}: has another length than the header")
    return rows


def _value(path: Path, row: Mapping[str, str], column: str) -> float:
    """A number in a row of a table."""
    try:
        return float(row[column])
    except ValueError as error:
        raise InputError(f"{path}: {column} is {row[column]:.40}, expected a number") from error


def cloud_times(folder: Path, start: float) -> dict[Path, float]:
    """Point clouds of a capture in their order, with their times in s after a start, s since the epoch."""
    times = {}
    for path in folder.glob("*_segmented.pcd"):
        try:
            time = float(path.name.removeprefix("pointcloud_").removesuffix("_segmented.pcd")) - start
        except ValueError as error:
            raise InputError(f"{path}: expected a name as pointcloud_SECONDS_segmented.pcd") from error
        if time >= 0.0:
            times[path] = time
    if not times:
        raise InputError(f"{folder}: has no point clouds after the beginning of the grippers' paths")
    return dict(sorted(times.items(), key=lambda item: item[1]))


def read_camera(folder: Path) -> Points:
    """The matrix (4, 4) from the camera into the world, of a calibration."""
    path = folder / "world_to_camera_transform.json"
    document = read_json_document(path, "the matrix from the world into the camera")
    try:
        matrix = np.array(document, np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise ValueError(f"of shape {matrix.shape}")
        return np.asarray(np.linalg.inv(matrix), np.float64)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path}: not an invertible matrix of 4 by 4 ({cause(error)})") from error


def read_cloud(path: Path) -> Points:
    """Read the finite points (P, 3), m in the camera, of a PCD file, as text or as plain binary.

    Raises InputError for other files: compressed ones too.
    """
    content = read_content(path)
    try:
        head, separator, _ = content.partition(b"DATA ")
        lines = [line.split() for line in head.decode("ascii").splitlines()]
        fields = {words[0]: words[1:] for words in lines if words}
        storage, _, body = content[len(head) + len(separator) :].partition(b"\n")
        columns = [fields["FIELDS"].index(axis) for axis in "xyz"]
        types = [PCD_TYPES[kind + size] for kind, size in zip(fields["TYPE"], fields["SIZE"], strict=True)]
        counts = [int(count) for count in fields.get("COUNT", ["1"] * len(types))]
        points = int(fields["POINTS"][0])
        if storage.strip() == b"binary":
            row = np.dtype([(str(k), kind, (counts[k],)) for k, kind in enumerate(types)])
            table = np.frombuffer(body, row, points)
            values = np.concatenate([table[str(column)] for column in columns], 1).astype(np.float64)
        elif storage.strip() == b"ascii":
            numbers = np.loadtxt(io.BytesIO(body), ndmin=2).reshape(points, sum(counts))
            values = numbers[:, [sum(counts[:column]) for column in columns]]
        else:
            raise ValueError(f"DATA is {storage.decode('ascii', 'replace')}, expected ascii or binary")
    except (KeyError, IndexError, ValueError) as error:
        raise InputError(f"{path}: not a readable point cloud ({cause(error)})") from error
    finite = values[np.isfinite(values).all(1)]
    if not len(finite):
        raise InputError(f"{path}: has no points")
    return finite


def read_baselines(folder: Path) -> dict[str, dict[tuple[str, str], float]]:
    """Published Chamfer distances from the captures to a simulator, m: of each, by garment and action."""
    path = folder / "results" / "paper_baselines.csv"
    columns = ("garment", "action", "simulator", "mode", METRICS[0])
    baselines: dict[str, dict[tuple[str, str], float]] = {}
    for row in read_table(path, columns):
        if row["mode"] == MODE:
            try:
                distance = float(row[METRICS[0]])
            except ValueError as error:
                raise InputError(
                    f"{path}: {METRICS[0]} is {row[METRICS[0]]:.40}, expected a number"
                ) from error
            baselines.setdefault(row["simulator"], {})[row["garment"], row["action"]] = distance
    return baselines


def read_results(path: Path) -> dict[Cell, dict[str, float]]:
    """What an earlier run wrote of each capture; nothing if there is no such file."""
    if not path.exists():
        return {}
    rows = read_table(path, (*Cell._fields, *RESULTS))
    return {
        Cell(row["garment"], row["action"], row["sample"]): {
            name: _value(path, row, name) for name in RESULTS
        }
        for row in rows
    }


def write_results(path: Path, results: Mapping[Cell, Mapping[str, float]]) -> None:
    """Write a row per capture."""
    with atomic_write(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*Cell._fields, *RESULTS])
        writer.writerows(
            [*cell, *(f"{result[name]:.6g}" for name in RESULTS)] for cell, result in results.items()
        )
