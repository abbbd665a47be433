"""Materials, groups and objects of garments in OpenUSD, as subsets of their faces."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.geometry.authored import SurfaceMaterial, polygons_of
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.textures import save_texture
from uvcloth.writers.usd_stage import identifiers, uv_name


def add_subsets(stage: Any, geometry: Any, mesh: Mesh, path: Path) -> None:
    """Add objects, groups and materials of a mesh; textures are written beside path, named after it."""
    from pxr import UsdShade

    polygons = polygons_of(mesh)
    for family, labels in (("object", polygons.objects), ("group", polygons.groups)):
        _subsets(geometry, family, labels.names, labels.of)
    names = [material.name for material in polygons.materials]
    subsets = _subsets(geometry, UsdShade.Tokens.materialBind, names, polygons.material)
    for subset, material in zip(subsets, polygons.materials, strict=True):
        prim = geometry.GetPath().AppendChild("materials").AppendChild(subset.GetPrim().GetName())
        surface = _material(stage, prim, material, path)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(surface)


def _subsets(geometry: Any, family: str, names: Sequence[str], of: np.ndarray) -> list[Any]:
    """A subset of the faces for each name. of: (P,) index of the name of each face."""
    from pxr import UsdGeom, Vt

    return [
        UsdGeom.Subset.CreateGeomSubset(
            geometry,
            identifier,
            UsdGeom.Tokens.face,
            Vt.IntArray.FromNumpy(np.nonzero(of == index)[0].astype(np.int32)),
            family,
        )
        for index, identifier in enumerate(identifiers([f"{family}_{name}" for name in names]))
    ]


def _material(stage: Any, prim: Any, material: SurfaceMaterial, path: Path) -> Any:
    """A preview surface of one colour, or of the texture times it."""
    from pxr import Gf, Sdf, UsdShade

    *color, opacity = material.color
    linear = Gf.Vec3f(*(channel**2.2 for channel in color))
    surface = UsdShade.Material.Define(stage, prim)
    shader = UsdShade.Shader.Define(stage, prim.AppendChild("surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
    shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(opacity)
    diffuse = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    diffuse.Set(linear)
    if material.texture:
        reader = UsdShade.Shader.Define(stage, prim.AppendChild("uv"))
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(uv_name(material.uv_set))
        picture = UsdShade.Shader.Define(stage, prim.AppendChild("texture"))
        picture.CreateIdAttr("UsdUVTexture")
        file = f"./{save_texture(material.texture, path)}"
        picture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
        picture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*linear, 1.0))
        for wrap in ("wrapS", "wrapT"):
            picture.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
        picture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        diffuse.ConnectToSource(picture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    surface.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return surface
