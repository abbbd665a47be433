"""Outfits on the joints of a character's file, whatever these are called."""

from dataclasses import replace

import numpy as np
import torch

from uvcloth.bodies.body import Body
from uvcloth.characters.joints import OwnJoints
from uvcloth.garments.band import holding_band
from uvcloth.garments.garment import Outfit
from uvcloth.garments.own_joints import on_own_joints
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skeleton import Skeleton


def test_what_holds_a_garment_is_the_same_on_joints_whose_names_say_nothing(body: Body) -> None:
    count = len(body.skeleton.names)
    foreign = Skeleton(
        tuple(f"joint_{index}" for index in range(count)), body.skeleton.parents, body.skeleton.heads
    )
    every = tuple(range(count))
    joints = OwnJoints(
        foreign, every, every, body.skeleton.names, torch.arange(count), np.eye(4), np.eye(4)[None]
    )
    skirt = replace(fit_template("skirt", body), source="file")
    worn = on_own_joints(Outfit(body, (skirt,)), joints)
    held = holding_band(worn.garments[0], worn.body)
    assert torch.equal(held.vertices, holding_band(skirt, body).vertices)
    assert torch.equal(worn.garments[0].weights, skirt.weights)
