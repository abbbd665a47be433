"""Plain npz files of points over time."""

from pathlib import Path

import torch

from uvcloth.files.archive import read_arrays
from uvcloth.files.fields import check_fields, indices, numbers
from uvcloth.formats.point_sequence import MeshQuery, PointSequence
from uvcloth.geometry.mesh import unique_edges


def read_npz(path: Path, query: MeshQuery) -> PointSequence:
    """Read vertices (F, N, 3) m with Z up and, where they are there, fps, faces (M, 3) and rest (N, 3).

    The names begin with that of the mesh, NAME_vertices, in a file of several, as `uvcloth rollout` writes
    them. Raises InputError naming the file and the array that does not fit.
    """
    arrays = read_arrays(path, "an npz of vertices over time")
    prefix = f"{query.name}_" if f"{query.name}_vertices" in arrays else ""
    fields = {
        f"{prefix}vertices": numbers("F", "N", 3),
        f"{prefix}faces": indices("M", 3, of="N").if_there(),
        f"{prefix}rest": numbers("N", 3).if_there(),
        "fps": numbers(least=0.0).if_there(),
    }
    data = check_fields(path, arrays, fields)
    faces = data.get(f"{prefix}faces")
    return PointSequence(
        points=data[f"{prefix}vertices"],
        fps=float(data["fps"]) if "fps" in data else None,
        edges=None if faces is None else unique_edges(torch.from_numpy(faces)).numpy(),
        rest=data.get(f"{prefix}rest"),
    )
