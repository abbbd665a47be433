"""Hashes of contents, against those that the shipped files name and that hashlib finds."""

import hashlib
import json
from importlib.resources import files
from pathlib import Path

import torch

from uvcloth.bodies.body import Body
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.methods.motion_guided.method import faces_hash

MODELS = Path(str(files("uvcloth") / "data" / "models"))


def test_contents_are_hashed_one_after_another() -> None:
    numbers = torch.arange(6).view(2, 3)
    expected = hashlib.sha256("é".encode() + b"x" + numbers.numpy().tobytes()).hexdigest()
    assert fingerprint("é", b"x", numbers) == expected
    assert fingerprint(numbers.t()) != fingerprint(numbers)
    assert fingerprint(numbers.t().t()) == fingerprint(numbers)


def test_shipped_models_name_the_shipped_body_and_garment(body: Body) -> None:
    """Stored values: a hash that changes makes every model and sequence look foreign."""
    meta = json.loads((MODELS / "motion_guided" / "config.json").read_text())
    assert meta["body"]["topology"] == body.identity.topology
    garment = fit_template(meta["config"]["garment"], body)
    assert meta["notes"]["garment_topology"] == faces_hash(garment)
