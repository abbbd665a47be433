"""A garment of RGBench in this project's cloth solver.

RGBench's own programs run it too: return `UvclothEnv(cfg=env_cfg)` in its rgbench/envs/__init__.py.

Fabrics come from configs/cloth_params, whose units the repository does not say. They read as grams,
millimetres and seconds, as garment CAD has them: density in g/m2 (220 of a T-shirt), stretch in g/s2
(230,000 is 230 N/m), bending in g mm2/s2 (1,000 is 1e-6 N m). poisson is as it is; where a file lacks it,
POISSON, as in the others. Our fabrics have one coefficient of friction: ground_friction where there is one,
or friction. Left out are kinetic friction; damping, 0.1 in all files, of no unit (DAMPING stands, and our own
drag); and mass, 0.255 kg for a skirt and a coat alike. RGBench fitted the numbers to its own simulator and
asks others to fit theirs anew, which is not done here.

Where the repository leaves something open or says it in two ways:
- Arms stand at BASES in its simulators, which made the published figures, and the other way round in its docs
  and transforms. Here as in the simulators; if that is right, `grip_distance` is near 0 in fold and grasp.
- Paths are read from columns time, pos_x, pos_y and pos_z, as its reader does; its docs name others. They are
  those of the link `link7`, a finger of the gripper.
- Point clouds are named pointcloud_SECONDS_segmented.pcd, as its reader asks; data/sample/README.md differs.
- initial_object_pose.json is not read, as in two of three simulators: init_pose of configs/main.yaml counts,
  with w first in the quaternion, as the simulators read it.
- In fold and grasp the vertex nearest to each gripper is held from the beginning, and follows its gripper
  from the start of the window on, as with PyBullet; it goes there within GRIP seconds, not at once.
- The camera's delay in white_cakeskirt/fling/01 is ten times its neighbours' (0.47393 s). It is not changed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from benchmarks.rgbench.files import ARMS, GripperPath, Points, entry, number, read_path
from uvcloth.errors import InputError
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.physics.cloth.body import Body, make_body
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.cloth.solver import Motion, Settings, make_solver, start, step
from uvcloth.physics.fabric import Fabric, fabric_from

BASES = {"left": (0.0, 0.25, 0.0), "right": (0.0, -0.25, 0.0)}
"""Places of the arms, m, to which recorded positions are relative."""

FRAME = 1.0 / 120.0
"""Longest step, s, in which a pin moves evenly."""

GRIP = 0.1
"""Seconds in which a vertex that is gripped goes to its gripper."""

PIN, PIN_DAMPING, PIN_MASS = 1000.0, 0.7, 1000.0
"""Frequency, 1/s, and damping ratio of the springs that move pins, and times that pins are heavier."""

DAMPING = Damping(stretch=1e-5)
"""In the plane a tenth of the solver's own, which would decide the step of fine meshes of stiff cloth."""

POISSON = 0.35
"""Poisson ratio where a file of parameters has none."""

SETTINGS = Settings(radius=0.003, reach=0.06, substeps=4000)
"""Settings of the solver: PyBullet's distance of cloth and ground, and substeps enough for PIN."""

TABLE = 3.0, 1.0
"""Half the width, m, of the ground, and its thickness."""


@dataclass(frozen=True)
class Grippers:
    """Places of two pins at any time: at rest, then on the way to the grippers, then with them.

    paths: left and right. start: s since the epoch, when the recording begins. lead: s of simulation before.
    rest: (2, 3) m, where pins lie. leave, meet: s, when they leave there and meet the grippers.
    """

    paths: tuple[GripperPath, ...]
    start: float
    lead: float
    rest: Points
    leave: float
    meet: float

    def recorded(self, time: float) -> Points:
        """Places (2, 3) m of the grippers."""
        return np.stack([path.at(self.start + max(time - self.lead, 0.0)) for path in self.paths])

    def pins(self, time: float) -> Points:
        """Places (2, 3) m of the pins."""
        share = np.clip((time - self.leave) / max(self.meet - self.leave, FRAME), 0.0, 1.0)
        return self.rest + share * (self.recorded(time) - self.rest)

    def grip_distance(self) -> float:
        """Distance, m, of the pin that is farther from its gripper when it is gripped."""
        return float(np.linalg.norm(self.recorded(self.leave) - self.rest, axis=1).max())


class UvclothEnv:
    """A garment of one capture in the solver, with the methods that RGBench asks of a simulator."""

    def __init__(self, cfg: Mapping[str, Any], **_: Any) -> None:
        """Place the garment. cfg: settings of a capture, as `read_runs` and RGBench's programs make them.

        Raises InputError naming a file that is missing or wrong, and for cloth that the solver cannot step.
        """
        cloth = cfg["cloth"]
        self._source = Path(cloth["model_path"])
        mesh = read_mesh(self._source)
        rest = mesh.vertices.double().numpy()
        turn, place = Rotation.from_quat(cloth["init_pose"][3:], scalar_first=True), cloth["init_pose"][:3]
        placed = turn.apply(rest) + np.array(place)
        parameters, where = cfg["cloth_params"], f"configs/cloth_params/{cloth['name']}.yaml"
        joints = cfg["data"]["robot_joints"]
        paths = tuple(read_path(Path(joints[f"{arm}_arm_csv_path"]), BASES[arm]) for arm in ARMS)
        self._pins, self.grippers = gripped(cfg, placed, paths, where)
        pinned = np.isin(np.arange(len(rest)), self._pins)
        self._solver = make_solver(
            make_cloth(
                rest,
                mesh.faces.numpy(),
                fabric_of(parameters, where),
                mass_factor=np.where(pinned, PIN_MASS, 1.0),
                damping=DAMPING,
            ),
            rest,
            ground(~pinned),
            SETTINGS,
            str(self._source),
        )
        self._pull = np.where(pinned, PIN, 0.0).astype(np.float32)
        self._damping = np.full(len(rest), PIN_DAMPING, np.float32)
        self._targets = placed
        self._state = start(self._solver, placed)
        self._time = 0.0

    def step(self) -> None:
        """Simulate FRAME seconds."""
        self._advance(FRAME)

    def step_to_time(self, target_time: float) -> None:
        """Simulate up to a time, s after the beginning; nothing if it is over."""
        seconds = target_time - self._time
        steps = math.ceil(seconds / FRAME - 1e-3)
        for _ in range(steps):
            self._advance(seconds / steps)

    def get_sim_vertices(self) -> NDArray[np.float64]:
        """Vertices of the cloth, (N, 3) m in the world."""
        return self._state.vertices()

    def get_master_start_time(self) -> float:
        """Beginning of the recording, s since the epoch."""
        return self.grippers.start

    def get_current_sim_time(self) -> float:
        """Simulated time, s."""
        return self._time

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def pins(self) -> NDArray[np.float64]:
        """Where the cloth's pins are, (2, 3) m: left and right."""
        return self.get_sim_vertices()[self._pins]

    def _advance(self, seconds: float) -> None:
        self._time += seconds
        targets = self._targets.copy()
        targets[self._pins] = self.grippers.pins(self._time)
        table = self._solver.body.rest
        motion = Motion(seconds, table, table, self._targets, targets, self._pull, self._damping)
        self._state, self._targets = step(self._solver, self._state, motion), targets
        if not np.isfinite(self._state.positions).all():
            raise InputError(f"{self._source}: the cloth flew apart after {self._time:.2f} s")


def fabric_of(parameters: Mapping[str, Any], where: str) -> Fabric:
    """The fabric of a file of RGBench's parameters. Raises InputError naming it."""
    friction = "ground_friction" if "ground_friction" in parameters else "friction"
    numbers = {
        "density": 1e-3 * number(parameters, where, "density"),
        "stretch": 1e-3 * number(parameters, where, "stretch"),
        "bend": 1e-9 * number(parameters, where, "bending"),
        "friction": number(parameters, where, friction),
        "poisson": number(parameters, where, "poisson") if "poisson" in parameters else POISSON,
    }
    return fabric_from(numbers, where)


def gripped(
    cfg: Mapping[str, Any], placed: Points, paths: tuple[GripperPath, ...], where: str
) -> tuple[NDArray[np.int64], Grippers]:
    """The vertices (2,) that the grippers hold, and the places that these take.

    placed: (N, 3) m, the garment at the beginning.
    """
    begin = min(path.times[0] for path in paths)
    if cfg["action"]["type"] == "fling":
        pins = np.array(entry(cfg["cloth_params"], where, "shoulder_index"), np.int64)
        if pins.shape != (2,) or not (0 <= pins.min() <= pins.max() < len(placed)):
            raise InputError(
                f"{where}: shoulder_index is {pins.tolist()}, expected two of {len(placed)} vertices"
            )
        prepare, wait = (float(cfg["action"][f"fling_{part}_time"]) for part in ("prepare", "wait"))
        return pins, Grippers(paths, begin, prepare + wait, placed[pins], 0.0, prepare)
    grab = float(cfg["evaluate"]["start_calculate_time"])
    pins = KDTree(placed).query(np.stack([path.at(begin + grab) for path in paths]))[1]
    return pins, Grippers(paths, begin, 0.0, placed[pins], grab, grab + GRIP)


def ground(touches: NDArray[np.bool_]) -> Body:
    """A closed flat box whose top is the plane z = 0. touches: (N,), the vertices that lie on it."""
    width, thickness = TABLE
    box = trimesh.creation.box(bounds=[[-width, -width, -thickness], [width, width, 0.0]])
    return make_body(np.array(box.vertices), [np.array(box.faces)], touches[None])
