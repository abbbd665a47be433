"""The JSON of a glTF 2.0 file, checked once, so that readers need no checks.

Only what readers here use is checked: kinds of values, indices of other entries, and the tree of nodes.
"""

from dataclasses import dataclass
from typing import Any

DEEPEST = 1000
"""Limit for the ancestors of a node."""

LARGEST = 1e9
"""Limit for a number: float32 holds its square."""


@dataclass(frozen=True)
class Index:
    """Rule for an index into a top-level list of the file."""

    of: str


@dataclass(frozen=True)
class Numbers:
    """Rule for a list of `count` numbers."""

    count: int


@dataclass(frozen=True)
class Needed:
    """Rule for a value that may not be absent."""

    rule: Any


@dataclass(frozen=True)
class Each:
    """Rule for all values of an object, whatever their keys."""

    rule: Any


COUNT = "a whole number from 0"
"""Rule for a count, an offset or a code."""

ASSET = {"version": Needed(str)}
TEXTURE = {"index": Needed(Index("textures")), "texCoord": COUNT}
PRIMITIVE = {
    "attributes": Needed(Each(Index("accessors"))),
    "indices": Index("accessors"),
    "material": Index("materials"),
    "mode": COUNT,
}
SAMPLER = {"input": Needed(Index("accessors")), "output": Needed(Index("accessors")), "interpolation": str}
CHANNEL = {"sampler": Needed(COUNT), "target": Needed({"node": Index("nodes"), "path": Needed(str)})}
NODE = {
    "children": [Index("nodes")],
    "mesh": Index("meshes"),
    "skin": Index("skins"),
    "matrix": Numbers(16),
    "translation": Numbers(3),
    "rotation": Numbers(4),
    "scale": Numbers(3),
}
ACCESSOR = {
    "bufferView": Index("bufferViews"),
    "byteOffset": COUNT,
    "componentType": Needed(COUNT),
    "count": Needed(COUNT),
    "type": Needed(str),
    "normalized": bool,
    "sparse": {
        "count": Needed(COUNT),
        "indices": Needed(
            {"bufferView": Needed(Index("bufferViews")), "byteOffset": COUNT, "componentType": Needed(COUNT)}
        ),
        "values": Needed({"bufferView": Needed(Index("bufferViews")), "byteOffset": COUNT}),
    },
}
SURFACE = {"baseColorFactor": Numbers(4), "baseColorTexture": TEXTURE}
RULES = {
    "asset": Needed(ASSET),
    "extensionsRequired": [str],
    "extensionsUsed": [str],
    "scene": Index("scenes"),
    "scenes": [{"nodes": [Index("nodes")]}],
    "nodes": [NODE],
    "meshes": [{"primitives": Needed([PRIMITIVE])}],
    "skins": [{"joints": Needed([Index("nodes")]), "inverseBindMatrices": Index("accessors")}],
    "animations": [{"channels": Needed([CHANNEL]), "samplers": Needed([SAMPLER])}],
    "materials": [{"pbrMetallicRoughness": SURFACE}],
    "textures": [{"source": Index("images"), "extensions": Each(object)}],
    "images": [{"uri": str, "mimeType": str, "bufferView": Index("bufferViews")}],
    "accessors": [ACCESSOR],
    "bufferViews": [
        {
            "buffer": Needed(Index("buffers")),
            "byteOffset": COUNT,
            "byteLength": Needed(COUNT),
            "byteStride": COUNT,
            "extensions": Each(object),
        }
    ],
    "buffers": [{"uri": str, "byteLength": Needed(COUNT)}],
}


def check_document(document: Any) -> None:
    """Raise ValueError naming the place ("nodes[3].mesh") and what was expected there."""
    if not isinstance(document, dict) or "asset" not in document:
        raise ValueError("not a glTF file, it has no asset")
    check_part(document["asset"], ASSET, "asset", document)
    if not document["asset"]["version"].startswith("2."):
        raise ValueError(f"is glTF {document['asset']['version']:.8}, expected 2.0")
    check_part(document, RULES, "", document)
    for place, node in enumerate(document.get("nodes", [])):
        if not any(node.get("rotation", (1.0,))):
            raise ValueError(f"nodes[{place}].rotation: is 0, 0, 0, 0, expected a unit quaternion")
    for place, animation in enumerate(document.get("animations", [])):
        for number, channel in enumerate(animation["channels"]):
            if channel["sampler"] >= len(animation["samplers"]):
                raise ValueError(f"animations[{place}].channels[{number}].sampler: there is no such sampler")
    for place, skin in enumerate(document.get("skins", [])):
        if not skin["joints"] or len(set(skin["joints"])) < len(skin["joints"]):
            raise ValueError(f"skins[{place}].joints: expected one joint or more, each once")


def parents_of(document: dict[str, Any]) -> dict[int, int]:
    """Parent of every node that has one. Raises ValueError for nodes that are no trees, or too deep."""
    above: dict[int, int] = {}
    for index, node in enumerate(document.get("nodes", [])):
        for child in node.get("children", []):
            if above.setdefault(child, index) != index or child == index:
                raise ValueError(f"nodes[{child}] is the child of two nodes")
    depth: dict[int, int] = {}
    for index in range(len(document.get("nodes", []))):
        way = [index]
        while way[-1] in above and way[-1] not in depth and len(way) <= DEEPEST:
            way.append(above[way[-1]])
        known = depth.get(way[-1], 0)
        for steps, node in enumerate(reversed(way)):
            depth[node] = known + steps
        if depth[index] >= DEEPEST:
            raise ValueError(f"nodes[{index}] is its own ancestor or has more than {DEEPEST} ancestors")
    return above


def check_part(value: Any, rule: Any, place: str, document: dict[str, Any]) -> None:
    """Raise ValueError naming the place for a part of a document that breaks a rule, as RULES has them."""
    match rule:
        case Index():
            _require(_is_count(value), place, value, f"an index of {rule.of}")
            entries = document.get(rule.of)
            count = len(entries) if isinstance(entries, list) else 0
            _require(value < count, place, value, f"one of the {count} {rule.of}")
        case Numbers():
            right = isinstance(value, list) and len(value) == rule.count and all(map(_is_number, value))
            _require(right, place, value, f"{rule.count} numbers")
        case Each():
            _require(isinstance(value, dict), place, value, "an object")
            for key, inner in value.items():
                check_part(inner, rule.rule, f"{place}.{key}", document)
        case dict():
            _require(isinstance(value, dict), place, value, "an object")
            for key, inner in rule.items():
                needed = isinstance(inner, Needed)
                if key in value:
                    check_part(
                        value[key], inner.rule if needed else inner, f"{place}.{key}".lstrip("."), document
                    )
                elif needed:
                    raise ValueError(f"{place or 'the file'} has no {key}")
        case list():
            _require(isinstance(value, list), place, value, "a list")
            for index, inner in enumerate(value):
                check_part(inner, rule[0], f"{place}[{index}]", document)
        case str():
            _require(_is_count(value), place, value, rule)
        case _:
            _require(isinstance(value, rule), place, value, "text" if rule is str else "true or false")


def _require(right: bool, place: str, value: Any, expected: str) -> None:
    if not right:
        raise ValueError(f"{place} is {str(value)[:40]}, expected {expected}")


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
