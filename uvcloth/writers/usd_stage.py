"""Parts of OpenUSD files that animations and rigs share: stage, meshes at rest, skeleton, poses, skins."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.files.atomic import require_room
from uvcloth.geometry.authored import polygons_of
from uvcloth.geometry.mesh import Mesh, vertex_normals
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.rendering.render import Color
from uvcloth.writers.animation import local_poses

MAX_UNSAVED = 16_000_000
"""Bytes of samples kept in memory between saves, which are rare: each repeats the stage's tables.

Of 10,000 frames of 400 vertices the repeated tables are 1 % of the file, of 40,000 frames 4 %.
"""


class SavedInParts:
    """A stage whose samples leave memory while they are added: call `add` with the bytes of each."""

    def __init__(self, stage: Any) -> None:
        self._stage, self._unsaved = stage, 0

    def add(self, size: int) -> None:
        """Count `size` bytes of samples, and save the stage once they exceed MAX_UNSAVED."""
        self._unsaved += size
        if self._unsaved > MAX_UNSAVED:
            self._stage.Save()
            self._unsaved = 0


@contextmanager
def writing(path: Path, fps: float, frames: int) -> Iterator[Any]:
    """Open a new stage, saved at the end: metres, Z up, time codes are frames from 0 on.

    Raises OSError if it cannot be written.
    """
    from pxr import Tf, Usd, UsdGeom

    try:
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(fps)
        stage.SetFramesPerSecond(fps)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(max(frames - 1, 0))
        yield stage
        stage.Save()
    except Tf.ErrorException as error:
        # OpenUSD calls its own file corrupt where the disk is full: the system is asked for its reason.
        require_room(path.parent)
        raise OSError(f"OpenUSD: {str(error).strip().splitlines()[-1]}") from error


def define_mesh(stage: Any, prim: str, mesh: Mesh, color: Color) -> Any:
    """Define a polygon mesh without points: topology, texture coordinates by corner, a display colour.

    A mesh that was read from a file has its polygons, all of its UV sets and the colours of its vertices.
    """
    from pxr import Gf, Sdf, UsdGeom, Vt

    polygons = polygons_of(mesh)
    geometry = UsdGeom.Mesh.Define(stage, prim)
    geometry.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    geometry.CreateDoubleSidedAttr(True)
    geometry.CreateFaceVertexCountsAttr(_integers(polygons.sizes))
    geometry.CreateFaceVertexIndicesAttr(_integers(polygons.corners))
    shown = geometry.CreateDisplayColorAttr([Gf.Vec3f(*(channel**2.2 for channel in color))])
    if polygons.colors is not None:
        shown.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(polygons.colors[:, :3] ** 2.2)))
        UsdGeom.Primvar(shown).SetInterpolation(UsdGeom.Tokens.vertex)
    primvars = UsdGeom.PrimvarsAPI(geometry)
    for index, each in enumerate(polygons.uv_sets):
        kind = Sdf.ValueTypeNames.TexCoord2fArray
        st = primvars.CreatePrimvar(uv_name(index), kind, UsdGeom.Tokens.faceVarying)
        st.Set(Vt.Vec2fArray.FromNumpy(each.uvs))
        st.SetIndices(_integers(each.corners))
    return geometry


def uv_name(index: int) -> str:
    """Usual name of a set of texture coordinates: st, st1, st2."""
    return f"st{index}" if index else "st"


def _integers(values: np.ndarray) -> Any:
    from pxr import Vt

    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, np.int32))


def rest_geometry(geometry: Any, mesh: Mesh) -> None:
    """Set points, normals and extent of a mesh that only its skin moves."""
    from pxr import UsdGeom, Vt

    positions = mesh.vertices.numpy()
    geometry.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(positions))
    geometry.GetExtentAttr().Set(Vt.Vec3fArray.FromNumpy(np.stack([positions.min(0), positions.max(0)])))
    normals = vertex_normals(mesh.vertices, mesh.faces).numpy()
    geometry.GetNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(normals))
    geometry.SetNormalsInterpolation(UsdGeom.Tokens.vertex)


def add_skeleton(stage: Any, prim: str, skeleton: Skeleton) -> Any:
    """Add a skeleton at rest, where every joint has the axes of the stage."""
    from pxr import Gf, UsdSkel

    paths: list[str] = []
    for joint, parent in enumerate(skeleton.parents):
        element = f"j{joint:03d}_{_identifier(skeleton.names[joint])}"
        paths.append(element if parent < 0 else f"{paths[parent]}/{element}")
    rig = UsdSkel.Skeleton.Define(stage, prim)
    heads = skeleton.heads.double().numpy()
    parents = np.array(skeleton.parents)
    local = heads - np.where(parents[:, None] >= 0, heads[parents], 0.0)
    rig.CreateJointsAttr(paths)
    rig.CreateBindTransformsAttr([Gf.Matrix4d().SetTranslate(Gf.Vec3d(*head)) for head in heads.tolist()])
    rig.CreateRestTransformsAttr([Gf.Matrix4d().SetTranslate(Gf.Vec3d(*bone)) for bone in local.tolist()])
    return rig


def animate_skeleton(stage: Any, rig: Any, skeleton: Skeleton, transforms: np.ndarray) -> Any:
    """Add the motion of a skeleton as a prim below it: transforms (F, J, 3, 4), one per time code."""
    from pxr import Gf, UsdSkel, Vt

    motion = UsdSkel.Animation.Define(stage, rig.GetPath().AppendChild("motion"))
    motion.CreateJointsAttr(rig.GetJointsAttr().Get())
    motion.CreateScalesAttr(Vt.Vec3hArray(len(skeleton.names), Gf.Vec3h(1)))
    shift, turn = motion.CreateTranslationsAttr(), motion.CreateRotationsAttr()
    samples, frame = SavedInParts(stage), 0
    for translations, rotations in local_poses(skeleton, transforms):
        for translation, rotation in zip(translations, rotations, strict=True):
            shift.Set(Vt.Vec3fArray.FromNumpy(translation), frame)
            turn.Set(Vt.QuatfArray.FromNumpy(rotation), frame)
            frame += 1
        samples.add(translations.nbytes + rotations.nbytes)
    UsdSkel.BindingAPI.Apply(rig.GetPrim()).CreateAnimationSourceRel().SetTargets([motion.GetPath()])
    return motion


def bind(geometry: Any, rig: Any, joints: np.ndarray, weights: np.ndarray) -> None:
    """Bind a mesh of N vertices to a skeleton: joints (N, I) and weights (N, I)."""
    from pxr import Gf, UsdSkel, Vt

    binding = UsdSkel.BindingAPI.Apply(geometry.GetPrim())
    binding.CreateSkeletonRel().SetTargets([rig.GetPath()])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1))
    binding.CreateJointIndicesPrimvar(False, joints.shape[1]).Set(joints.ravel().tolist())
    binding.CreateJointWeightsPrimvar(False, joints.shape[1]).Set(Vt.FloatArray.FromNumpy(weights.ravel()))


def identifiers(names: Sequence[str]) -> list[str]:
    """Identifiers for names, numbered where names share one: my_shirt, my_shirt_2."""
    paths: list[str] = []
    for plain in map(_identifier, names):
        identifier, number = plain, 1
        while identifier in paths:
            number += 1
            identifier = f"{plain}_{number}"
        paths.append(identifier)
    return paths


def _identifier(name: str) -> str:
    from pxr import Tf

    return str(Tf.MakeValidIdentifier(name))
