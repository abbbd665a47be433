"""OpenUSD: a rig as one UsdSkel root: skinned garments with blend shapes, one animation, the body.

The body keeps all of its influences, garments have those of the rig.
"""

from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.bodies.body import BODY_INFLUENCES
from uvcloth.geometry.skinning import strongest
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS
from uvcloth.writers.rig import Rig, RiggedGarment
from uvcloth.writers.usd_materials import add_subsets
from uvcloth.writers.usd_stage import (
    add_skeleton,
    animate_skeleton,
    bind,
    define_mesh,
    identifiers,
    rest_geometry,
    writing,
)


def write_rig_usd(rig: Rig, path: Path) -> None:
    """Write a binary USD stage: metres, Z up, time codes are frames from 0 on.

    A rig without motion holds the rest pose at time 0. Textures of the garments' files lie beside it.
    Raises OSError if it cannot be written, and InputError if a texture cannot.
    """
    from pxr import UsdSkel, Vt

    still = not len(rig.transforms)
    rest = np.eye(3, 4, dtype=np.float32)[None, None].repeat(len(rig.skeleton.names), axis=1)
    weights = rig.resting[None] if still else rig.weights
    with writing(path, rig.fps, len(weights)) as stage:
        root = UsdSkel.Root.Define(stage, "/Outfit")
        stage.SetDefaultPrim(root.GetPrim())
        skeleton = add_skeleton(stage, "/Outfit/skeleton", rig.skeleton)
        motion = animate_skeleton(stage, skeleton, rig.skeleton, rest if still else rig.transforms)
        if rig.shape_names:
            motion.CreateBlendShapesAttr(rig.shape_names)
            levels = motion.CreateBlendShapeWeightsAttr()
            for frame, row in enumerate(weights):
                levels.Set(Vt.FloatArray.FromNumpy(row), frame)
        _, _, *names = identifiers(["skeleton", "body", *(garment.name for garment in rig.garments)])
        for index, name in enumerate(names):
            color = GARMENT_COLORS[index % len(GARMENT_COLORS)]
            geometry = define_mesh(stage, f"/Outfit/{name}", rig.garments[index].mesh, color)
            _rig_garment(stage, geometry, skeleton, rig.garments[index], rig.shape_names)
            # Two garments may have textures of one name.
            add_subsets(stage, geometry, rig.garments[index].mesh, path.with_stem(f"{path.stem}_{name}"))
        if body := rig.body:
            geometry = define_mesh(stage, "/Outfit/body", body.mesh, BODY_COLOR)
            rest_geometry(geometry, body.mesh)
            bind(geometry, skeleton, *strongest(body.weights, BODY_INFLUENCES))
            add_subsets(stage, geometry, body.mesh, path.with_stem(f"{path.stem}_body"))


def _rig_garment(stage: Any, geometry: Any, skeleton: Any, garment: RiggedGarment, names: list[str]) -> None:
    from pxr import UsdSkel, Vt

    rest_geometry(geometry, garment.mesh)
    bind(geometry, skeleton, garment.joints, garment.weights)
    if not names:
        return
    changes = garment.normal_shapes().numpy()
    paths = [geometry.GetPath().AppendChild(name) for name in names]
    for path, offsets, change in zip(paths, garment.shapes.numpy(), changes, strict=True):
        shape = UsdSkel.BlendShape.Define(stage, path)
        shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(offsets)))
        shape.CreateNormalOffsetsAttr(Vt.Vec3fArray.FromNumpy(change))
    binding = UsdSkel.BindingAPI(geometry.GetPrim())
    binding.CreateBlendShapesAttr(names)
    binding.CreateBlendShapeTargetsRel().SetTargets(paths)
