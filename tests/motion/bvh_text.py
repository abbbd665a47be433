"""Small BVH files written by the tests, independent of the reader."""

import numpy as np

ROOT_CHANNELS = ("Xposition", "Yposition", "Zposition", "Zrotation", "Yrotation", "Xrotation")
CHANNELS = ("Zrotation", "Yrotation", "Xrotation")

Joint = tuple[str, int, tuple[float, ...], tuple[str, ...]]
"""Name, index of the parent, offset, channels."""


def bvh_text(joints: list[Joint], values: np.ndarray, seconds: float = 1 / 30) -> str:
    """A BVH file of joints in depth-first order and one row of channel values per frame."""
    lines = ["HIERARCHY"]
    lines += _block(joints, 0)
    lines += ["MOTION", f"Frames: {len(values)}", f"Frame Time: {seconds:.7f}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in values]
    return "\n".join(lines) + "\n"


def _block(joints: list[Joint], index: int) -> list[str]:
    name, parent, offset, channels = joints[index]
    children = [child for child, joint in enumerate(joints) if joint[1] == index]
    inner = [f"OFFSET {' '.join(map(str, offset))}", f"CHANNELS {len(channels)} {' '.join(channels)}"]
    for child in children:
        inner += _block(joints, child)
    if not children:
        inner += ["End Site", "{", "OFFSET 0 1 0", "}"]
    return [f"{'ROOT' if parent < 0 else 'JOINT'} {name}", "{", *inner, "}"]


def performer(arms_down: bool = False) -> list[Joint]:
    """A person in MotionBuilder's names and inches, Y up, facing +Z, legs splayed by 20 degrees."""
    tilt = np.deg2rad(20.0)
    joints: list[Joint] = [("Hips", -1, (0.0, 0.0, 0.0), ROOT_CHANNELS)]

    def add(name: str, parent: str, *offset: float) -> None:
        index = next(i for i, joint in enumerate(joints) if joint[0] == parent)
        joints.append((name, index, offset, CHANNELS))

    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        add(f"{side}UpLeg", "Hips", 4.0 * sign, -3.0, 0.0)
        down = (np.sin(tilt) * sign, -np.cos(tilt), 0.0)
        add(f"{side}Leg", f"{side}UpLeg", *(17.0 * np.array(down)))
        add(f"{side}Foot", f"{side}Leg", *(16.0 * np.array(down)))
        add(f"{side}ToeBase", f"{side}Foot", 0.0, -1.0, 6.0)
    add("LowerBack", "Hips", 0.0, 2.0, 0.0)
    add("Spine", "LowerBack", 0.0, 5.0, 0.0)
    add("Spine1", "Spine", 0.0, 5.0, 0.0)
    add("Neck", "Spine1", 0.0, 6.0, 0.0)
    add("Head", "Neck", 0.0, 4.0, 0.0)
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        along = (0.0, -1.0, 0.0) if arms_down else (sign, 0.0, 0.0)
        add(f"{side}Shoulder", "Spine1", 1.0 * sign, 5.0, 0.0)
        add(f"{side}Arm", f"{side}Shoulder", 6.0 * sign, 0.0, 0.0)
        add(f"{side}ForeArm", f"{side}Arm", *(11.0 * np.array(along)))
        add(f"{side}Hand", f"{side}ForeArm", *(9.0 * np.array(along)))
    return joints


def still(joints: list[Joint], frames: int = 3) -> np.ndarray:
    """All channels zero."""
    return np.zeros((frames, sum(len(joint[3]) for joint in joints)))
