"""OpenUSD: the points of one mesh over time."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.errors import InputError, cause
from uvcloth.files.reading import require_file
from uvcloth.formats.point_sequence import FROM_Y_UP, MeshQuery, PointSequence, polygon_edges, steady_rate


def read_usd(path: Path, query: MeshQuery) -> PointSequence:
    """Read one mesh of a stage, whose unit and upward axis are applied, in the world.

    Its frames are the time samples of its points. Rest points are its primvar `rest`, as Houdini names it.
    Raises InputError naming the file if it cannot be read or holds no such mesh.
    """
    from pxr import Usd

    require_file(path)
    try:
        return _read(path, Usd.Stage.Open(str(path)), query)
    except InputError:
        raise
    except Exception as error:  # The library raises its own, and values that do not fit others.
        raise InputError(f"{path}: not a readable USD file ({cause(error)})") from error


def _read(path: Path, stage: Any, query: MeshQuery) -> PointSequence:
    from pxr import Usd, UsdGeom

    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    named = [(mesh.GetPrim().GetName(), _count(mesh)) for mesh in meshes]
    mesh = meshes[query.choose(path, named)]
    attribute = mesh.GetPointsAttr()
    codes = attribute.GetTimeSamples()
    metres = float(UsdGeom.GetStageMetersPerUnit(stage))
    axes = FROM_Y_UP if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else np.eye(3)
    cache = UsdGeom.XformCache()
    frames: list[NDArray[np.float32]] = []
    for code in codes or [Usd.TimeCode.Default()]:
        cache.SetTime(code)
        world = np.array(cache.GetLocalToWorldTransform(mesh.GetPrim()))
        points = np.array(attribute.Get(code), np.float64).reshape(-1, 3)
        if frames and len(points) != len(frames[0]):
            raise InputError(
                f"{path}: the number of vertices of {mesh.GetPrim().GetName()} changes over time"
            )
        frames.append((metres * (points @ world[:3, :3] + world[3, :3]) @ axes).astype(np.float32))
    rest = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("rest")
    sizes, corners = mesh.GetFaceVertexCountsAttr().Get(), mesh.GetFaceVertexIndicesAttr().Get()
    return PointSequence(
        points=np.stack(frames),
        fps=steady_rate(path, np.array(codes, np.float64) / stage.GetTimeCodesPerSecond()),
        edges=polygon_edges(np.array(sizes, np.int64), np.array(corners, np.int64)) if sizes else None,
        rest=(metres * np.array(rest.Get(), np.float64) @ axes).astype(np.float32)
        if rest.HasValue()
        else None,
    )


def _count(mesh: Any) -> int:
    """Number of vertices of a mesh at its first time."""
    from pxr import Usd

    points = mesh.GetPointsAttr().Get(Usd.TimeCode.EarliestTime())
    return 0 if points is None else len(points)
