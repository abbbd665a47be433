"""Checkpoints: a folder with model.safetensors and config.json, and nothing that could run code.

config.json holds the method's name and config, the body that it was trained on, the garments, the training
data (hashes of the files, clips, people) and the version of this package; the normalization statistics
travel with the weights.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor, nn

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_files, atomic_write
from uvcloth.files.json_file import parse_json, read_json, require_kinds
from uvcloth.files.reading import require_file
from uvcloth.version import package_version

VERSION = 3
"""Raised whenever a model of an older version can no longer be read or would no longer mean the same."""

KINDS = {
    "method": str,
    "config": dict,
    "body": {"*": str},
    "garments": [str],
    "data": {"files": {"*": str}, "clips": {"*": {"*": str}}},
    "notes": dict,
}
"""Kinds of the values of config.json."""

DTYPES = (
    *(torch.float16, torch.bfloat16, torch.float32, torch.float64, torch.bool),
    *(torch.uint8, torch.int8, torch.int16, torch.int32, torch.int64),
)
"""Types of tensors that are read."""

WEIGHTS = "model.safetensors"
CONFIG = "config.json"


@dataclass(frozen=True)
class TrainingData:
    """The data that a model was made from.

    files: name -> content hash, those of its validation included. clips: "train" (used in training) and
    "validation" (used to choose) -> name of a clip -> its subject, "" if unknown.
    """

    files: dict[str, str] = field(default_factory=dict)
    clips: dict[str, dict[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Checkpoint:
    """A trained method.

    method: its name in the registry. config: its config as JSON values. tensors: weights and statistics.
    body: name and topology hash of the body it was trained on. garments: names of
    those it dresses (PhysXNet: its templates), in the network's order.
    data: what it was made from. notes: anything worth knowing (steps, minutes, errors).
    """

    method: str
    config: dict[str, Any]
    tensors: dict[str, Tensor]
    body: dict[str, str]
    garments: tuple[str, ...]
    data: TrainingData
    notes: dict[str, Any]


def body_record(body: Body) -> dict[str, str]:
    """Name and topology of a body, as a checkpoint holds them."""
    return {"name": body.name, "topology": body.identity.topology}


def save_checkpoint(checkpoint: Checkpoint, folder: Path) -> None:
    """Write a checkpoint folder, both files or neither; indices in the smallest type that holds them.

    Raises InputError if it cannot be written.
    """
    folder = Path(folder)
    meta = {
        "version": VERSION,
        "uvcloth": package_version(),
        "method": checkpoint.method,
        "config": checkpoint.config,
        "body": checkpoint.body,
        "garments": checkpoint.garments,
        "data": asdict(checkpoint.data),
        "notes": checkpoint.notes,
    }
    with atomic_files(folder / CONFIG) as unfinished:
        tensors = {name: _narrowed(tensor) for name, tensor in checkpoint.tensors.items()}
        save_tensors(tensors, {}, unfinished / WEIGHTS)
        (unfinished / CONFIG).write_text(json.dumps(meta, indent=2) + "\n", encoding="utf-8")


def load_checkpoint(folder: Path, body: Body | None = None) -> Checkpoint:
    """Read a checkpoint folder; with a body, refuse a model that was trained on another topology or rig.

    Raises InputError naming the file if it is missing, damaged, of another version or of another body.
    """
    folder = Path(folder)
    path = folder / CONFIG
    if not path.exists():
        raise InputError(f"{folder}: not a trained model, it has no {CONFIG}")
    meta = read_json(path, "the description of a trained model")
    if meta.get("version") != VERSION:
        raise InputError(
            f"{path}: a model of version {meta.get('version')!s:.40}, this program reads version {VERSION}; "
            "train it again"
        )
    require_kinds(meta, KINDS, f"{path}: the model's description")
    tensors, _ = load_tensors(folder / WEIGHTS)
    checkpoint = Checkpoint(
        method=meta["method"],
        config=meta["config"],
        tensors=tensors,
        body=meta["body"],
        garments=tuple(meta["garments"]),
        data=TrainingData(files=meta["data"]["files"], clips=meta["data"]["clips"]),
        notes=meta["notes"],
    )
    if body is not None and body.identity.topology != checkpoint.body.get("topology"):
        raise InputError(
            f"{folder}: the model was trained on the mesh and rig of body "
            f"{checkpoint.body.get('name')!r:.100}, "
            f"body {body.name!r} has another mesh or rig"
        )
    return checkpoint


def restored(
    checkpoint: Checkpoint,
    folder: Path,
    config: Callable[..., Any],
    create: Callable[[Any], Any],
    networks: Callable[[Any], nn.Module],
) -> Any:
    """The method that is created of a checkpoint's config, with its weights.

    config: the method's config dataclass. networks: what of the method takes the weights. Raises InputError
    if weights and config do not fit each other, before the method is created.
    """
    try:
        settings = stored_config(checkpoint, config)
        require_weights_of(lambda: networks(create(settings)), checkpoint.tensors)
        method = create(settings)
        networks(method).load_state_dict(checkpoint.tensors)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise misfit(folder, error) from error
    return method


def require_weights_of(create: Callable[[], nn.Module], tensors: Mapping[str, Tensor]) -> None:
    """Raise ValueError unless tensors are those of the network that `create` makes.

    It is made without memory for its weights: a file's claims about sizes cost nothing.
    """
    with torch.device("meta"):
        expected = create().state_dict()
    require_like(tensors, expected)


def require_like(tensors: Mapping[str, Tensor], expected: Mapping[str, Tensor]) -> None:
    """Raise ValueError naming the first tensor that has another name, shape or kind than is expected."""
    different = sorted(expected.keys() ^ tensors.keys())
    if different:
        difference = "is missing" if different[0] in expected else "is none of the network"
        raise ValueError(f"{different[0]!r:.80} {difference}")
    for name, tensor in tensors.items():
        wanted = expected[name]
        if wanted.shape != tensor.shape or wanted.is_floating_point() != tensor.is_floating_point():
            raise ValueError(
                f"{name} is {tuple(tensor.shape)} {tensor.dtype}, "
                f"the network has {tuple(wanted.shape)} {wanted.dtype}"
            )


def stored_config(checkpoint: Checkpoint, config: Callable[..., Any]) -> Any:
    """The config of a checkpoint, of the given dataclass.

    Raises KeyError, TypeError or ValueError if a setting is missing, unknown or impossible.
    """
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in checkpoint.config.items()}
    missing = {field.name for field in fields(config)} - values.keys()  # type: ignore[arg-type]
    if missing:
        raise KeyError(*sorted(missing))
    return config(**values)


def misfit(folder: Path, error: Exception) -> InputError:
    """The error to raise where weights and config of a model in a folder do not fit each other."""
    first = str(error).partition("\n")[0][:300]
    if isinstance(error, InputError):
        return InputError(f"{folder / CONFIG}: {first}")
    return InputError(f"{folder}: weights and config of the model do not fit each other ({first})")


def _narrowed(tensor: Tensor) -> Tensor:
    """The same whole numbers in the smallest type that holds them; other tensors as they are."""
    if tensor.dtype != torch.int64 or not tensor.numel():
        return tensor
    low, high = int(tensor.min()), int(tensor.max())
    ranges = {kind: torch.iinfo(kind) for kind in (torch.uint8, torch.int16, torch.int32, torch.int64)}
    return tensor.to(next(kind for kind, held in ranges.items() if held.min <= low and high <= held.max))


def save_tensors(tensors: Mapping[str, Tensor], metadata: Mapping[str, Any], path: Path) -> None:
    """Write tensors and JSON values as one safetensors file, whole or not at all."""
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with atomic_write(path) as partial:
        partial.write_bytes(to_bytes(plain, metadata={"json": json.dumps(dict(metadata))}))


def load_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read what `save_tensors` wrote. Raises InputError if it is missing, damaged or not finite."""
    path = Path(path)
    require_file(path)
    try:
        with safe_open(path, framework="pt") as archive:
            tensors = {name: archive.get_tensor(name) for name in archive.keys()}  # noqa: SIM118
            metadata = (archive.metadata() or {}).get("json", "{}")
    except (OSError, SafetensorError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: not a readable safetensors file") from error
    for name, tensor in tensors.items():
        if tensor.dtype not in DTYPES:
            raise InputError(f"{path}: {name!r:.80} has the type {tensor.dtype}, which is not supported")
        if tensor.is_floating_point() and not torch.isfinite(tensor).all():
            raise InputError(f"{path}: {name!r:.80} holds a value that is not a finite number")
    return tensors, parse_json(metadata, f"{path}: the metadata", "JSON values")
