"""FBX files as glTF, by ufbx in a process of its own: its Python binding can end the process it runs in."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from uvcloth.errors import InputError, cause
from uvcloth.files.reading import require_file

FBX = ".fbx"

FBX_WORKER = Path(__file__).with_name("fbx_worker.py")

LONGEST = 300
"""Seconds that a conversion may take."""

BLENDER = "or convert it to .glb with Blender by the command in docs/motion.md"


def glb_from_fbx(path: Path) -> bytes:
    """Convert an FBX file to the bytes of a .glb, in metres, Y up: see `fbx_worker`.

    Raises InputError naming the file if it is missing, if ufbx is not installed, and if it cannot be read.
    """
    require_file(path)
    if find_spec("ufbx") is None:
        raise InputError(f"{path}: reading FBX needs ufbx: install uvcloth[fbx], {BLENDER}")
    command = [sys.executable, "-P", str(FBX_WORKER), str(Path(path).resolve())]
    try:
        answer = subprocess.run(command, capture_output=True, check=False, timeout=LONGEST)
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{path}: its conversion takes more than {LONGEST} s: simplify it") from error
    if answer.returncode:
        said = answer.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        reason = cause(ValueError(said or f"ufbx ended with code {answer.returncode}"))
        raise InputError(f"{path}: not a readable FBX file ({reason}); save it again, {BLENDER}")
    return answer.stdout
