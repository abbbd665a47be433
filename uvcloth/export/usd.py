"""OpenUSD: garments as points over time, the body as a UsdSkel skeleton with all of its blend weights."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from uvcloth.bodies.body import INFLUENCES, Body
from uvcloth.export.animation import Animation, local_pose, strongest
from uvcloth.mesh import Mesh, vertex_normals
from uvcloth.render import BODY_COLOR, GARMENT_COLORS, Color


def write_usd(animation: Animation, path: Path) -> None:
    """Write a binary USD stage: metres, Z up, time codes are frames from 0 on; OSError if it cannot."""
    from pxr import Tf, Usd, UsdGeom

    try:
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(animation.fps)
        stage.SetFramesPerSecond(animation.fps)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(len(animation) - 1)
        root = UsdGeom.Xform.Define(stage, "/Outfit")
        stage.SetDefaultPrim(root.GetPrim())
        for index, identifier in enumerate(_identifiers(animation.names)):
            _write_garment(stage, animation, index, f"/Outfit/{identifier}")
        if animation.body is not None:
            _write_body(stage, animation, animation.body)
        stage.Save()
    except Tf.ErrorException as error:
        raise OSError(f"OpenUSD: {str(error).strip().splitlines()[-1]}") from error


def _write_garment(stage: Any, animation: Animation, index: int, prim: str) -> None:
    from pxr import UsdGeom, Vt

    mesh, vertices = animation.meshes[index], animation.vertices[index]
    geometry = _define_mesh(stage, prim, mesh, GARMENT_COLORS[index % len(GARMENT_COLORS)])
    points, extent = geometry.GetPointsAttr(), geometry.GetExtentAttr()
    normals = geometry.GetNormalsAttr()
    geometry.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    for frames in animation.chunks():
        positions = np.array(vertices[frames])
        turned = vertex_normals(torch.from_numpy(positions), mesh.faces).numpy()
        bounds = np.stack([positions.min(1), positions.max(1)], axis=1)
        for offset, frame in enumerate(range(frames.start, frames.stop)):
            points.Set(Vt.Vec3fArray.FromNumpy(positions[offset]), frame)
            normals.Set(Vt.Vec3fArray.FromNumpy(turned[offset]), frame)
            extent.Set(Vt.Vec3fArray.FromNumpy(bounds[offset]), frame)
        # Saved samples leave memory.
        stage.Save()


def _write_body(stage: Any, animation: Animation, body: Body) -> None:
    from pxr import Gf, UsdGeom, UsdSkel, Vt

    skeleton = body.skeleton
    paths: list[str] = []
    for joint, parent in enumerate(skeleton.parents):
        own = f"j{joint:03d}_{_identifier(skeleton.names[joint])}"
        paths.append(own if parent < 0 else f"{paths[parent]}/{own}")
    UsdSkel.Root.Define(stage, "/Outfit/body")
    rig = UsdSkel.Skeleton.Define(stage, "/Outfit/body/skeleton")
    heads = skeleton.heads.double().numpy()
    parents = np.array(skeleton.parents)
    local = heads - np.where(parents[:, None] >= 0, heads[parents], 0.0)
    rig.CreateJointsAttr(paths)
    rig.CreateBindTransformsAttr([Gf.Matrix4d().SetTranslate(Gf.Vec3d(*head)) for head in heads.tolist()])
    rig.CreateRestTransformsAttr([Gf.Matrix4d().SetTranslate(Gf.Vec3d(*bone)) for bone in local.tolist()])

    motion = UsdSkel.Animation.Define(stage, "/Outfit/body/skeleton/motion")
    motion.CreateJointsAttr(paths)
    translations, rotations = local_pose(skeleton, animation.transforms)
    motion.CreateScalesAttr(Vt.Vec3hArray(len(paths), Gf.Vec3h(1)))
    shift, turn = motion.CreateTranslationsAttr(), motion.CreateRotationsAttr()
    for frame in range(len(animation)):
        shift.Set(Vt.Vec3fArray.FromNumpy(translations[frame]), frame)
        turn.Set(Vt.QuatfArray.FromNumpy(rotations[frame]), frame)
    UsdSkel.BindingAPI.Apply(rig.GetPrim()).CreateAnimationSourceRel().SetTargets([motion.GetPath()])

    geometry = _define_mesh(stage, "/Outfit/body/mesh", body.mesh, BODY_COLOR)
    positions = body.mesh.vertices.numpy()
    geometry.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(positions))
    geometry.GetExtentAttr().Set(Vt.Vec3fArray.FromNumpy(np.stack([positions.min(0), positions.max(0)])))
    geometry.GetNormalsAttr().Set(
        Vt.Vec3fArray.FromNumpy(vertex_normals(body.mesh.vertices, body.mesh.faces).numpy())
    )
    geometry.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    joints, weights = strongest(body.weights, INFLUENCES)
    binding = UsdSkel.BindingAPI.Apply(geometry.GetPrim())
    binding.CreateSkeletonRel().SetTargets([rig.GetPath()])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1))
    binding.CreateJointIndicesPrimvar(False, INFLUENCES).Set(joints.ravel().tolist())
    binding.CreateJointWeightsPrimvar(False, INFLUENCES).Set(Vt.FloatArray.FromNumpy(weights.ravel()))


def _define_mesh(stage: Any, prim: str, mesh: Mesh, color: Color) -> Any:
    """A polygon mesh without points: topology, texture coordinates by face corner, a display colour."""
    from pxr import Gf, Sdf, UsdGeom, Vt

    geometry = UsdGeom.Mesh.Define(stage, prim)
    geometry.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    geometry.CreateDoubleSidedAttr(True)
    geometry.CreateFaceVertexCountsAttr(Vt.IntArray(len(mesh.faces), 3))
    geometry.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.faces.numpy().astype(np.int32).ravel()))
    linear = [channel**2.2 for channel in color]
    geometry.CreateDisplayColorAttr([Gf.Vec3f(*linear)])
    if len(mesh.uvs):
        primvars = UsdGeom.PrimvarsAPI(geometry)
        st = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
        st.Set(Vt.Vec2fArray.FromNumpy(mesh.uvs.numpy().astype(np.float32)))
        st.SetIndices(Vt.IntArray.FromNumpy(mesh.face_uvs.numpy().astype(np.int32).ravel()))
    return geometry


def _identifiers(names: Sequence[str]) -> list[str]:
    """An identifier for each name, numbered where names share one: my_shirt, my_shirt_2."""
    found: list[str] = []
    for plain in map(_identifier, names):
        identifier, number = plain, 1
        while identifier in found:
            number += 1
            identifier = f"{plain}_{number}"
        found.append(identifier)
    return found


def _identifier(name: str) -> str:
    from pxr import Tf

    return str(Tf.MakeValidIdentifier(name))
