"""Plain npz files of points over time."""

from pathlib import Path

import torch

from uvcloth.files.archive import read_arrays
from uvcloth.files.fields import check_fields, indices, numbers
from uvcloth.formats.point_sequence import PointSequence, Wanted
from uvcloth.geometry.mesh import unique_edges


def read_npz(path: Path, wanted: Wanted) -> PointSequence:
    """Read vertices (F, N, 3) m with Z up and, where they are there, fps, faces (M, 3) and rest (N, 3).

    The names begin with that of the mesh, NAME_vertices, in a file of several, as `uvcloth rollout` writes
    them. Raises InputError naming the file and the array that does not fit.
    """
    arrays = read_arrays(path, "an npz of vertices over time")
    own = f"{wanted.name}_" if f"{wanted.name}_vertices" in arrays else ""
    fields = {
        f"{own}vertices": numbers("F", "N", 3),
        f"{own}faces": indices("M", 3, of="N").if_there(),
        f"{own}rest": numbers("N", 3).if_there(),
        "fps": numbers(least=0.0).if_there(),
    }
    data = check_fields(path, arrays, fields)
    faces = data.get(f"{own}faces")
    return PointSequence(
        points=data[f"{own}vertices"],
        fps=float(data["fps"]) if "fps" in data else None,
        edges=None if faces is None else unique_edges(torch.from_numpy(faces)).numpy(),
        rest=data.get(f"{own}rest"),
    )
