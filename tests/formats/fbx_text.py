"""FBX files in ASCII, in centimetres with Z up."""

from collections.abc import Sequence

import numpy as np


def array(name: str, values: Sequence[float] | np.ndarray) -> str:
    return f"{name}: *{len(values)} {{ a: {','.join(f'{value:g}' for value in values)}\n }}\n"


def model(number: int, name: str, kind: str, place: tuple[int, int, int] = (0, 0, 0)) -> str:
    at = ",".join(map(str, place))
    return (
        f'Model: {number}, "Model::{name}", "{kind}" {{ Version: 232\n Properties70: {{\n'
        f' P: "Lcl Translation", "Lcl Translation", "", "A",{at}\n }} }}'
    )


def document(objects: str, connections: str) -> str:
    """A whole file of objects, and of the lines that connect them."""
    return (
        "; FBX 7.4.0 project file\nFBXHeaderExtension: {\n FBXVersion: 7400\n }\n"
        "GlobalSettings: { Properties70: {\n"
        ' P: "UpAxis", "int", "Integer", "",2\n P: "UpAxisSign", "int", "Integer", "",1\n'
        ' P: "FrontAxis", "int", "Integer", "",1\n P: "FrontAxisSign", "int", "Integer", "",-1\n'
        ' P: "CoordAxis", "int", "Integer", "",0\n P: "CoordAxisSign", "int", "Integer", "",1\n'
        ' P: "UnitScaleFactor", "double", "Number", "",1\n P: "TimeMode", "enum", "", "",6\n } }\n'
        f"Objects: {{\n{objects}\n}}\nConnections: {{\n{connections}\n}}\n"
    )


def mesh_text(vertices: np.ndarray, faces: np.ndarray) -> str:
    """A file of one mesh: vertices (N, 3) cm and triangles (M, 3)."""
    corners = np.column_stack([faces[:, :2], -faces[:, 2:] - 1])
    geometry = (
        f'Geometry: 1, "Geometry::mesh", "Mesh" {{ {array("Vertices", vertices.reshape(-1))}'
        f"{array('PolygonVertexIndex', corners.reshape(-1))} }}"
    )
    return document(geometry + "\n" + model(2, "mesh", "Mesh"), 'C: "OO",1,2\nC: "OO",2,0')
