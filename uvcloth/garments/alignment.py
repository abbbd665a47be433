"""Alignment of a garment with a body that it was not modelled on: shift, scale, heading and stance.

A few hundred starts (up axis, heading, size and height of the garment) are ranked by how its openings lie
around the bones and how its cloth lies on the skin. The best are refined by the cross-entropy method
(Rubinstein 1999): samples around a mean, which moves to the mean of the best of them.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.errors import InputError
from uvcloth.garments.boundaries import boundaries
from uvcloth.garments.judge import CLOTHED
from uvcloth.garments.placing import (
    ACROSS_COST,
    AXES,
    COMMON,
    FAR,
    INSIDE_WEIGHT,
    SEARCH_DISTANCE,
    ClothSample,
    lies_along,
)
from uvcloth.garments.pose import LEG, REST, Stance, has_arms, limbs_held, posed_body
from uvcloth.geometry.mesh import Mesh, face_normals
from uvcloth.geometry.roles import assign_roles
from uvcloth.geometry.units import UNITS
from uvcloth.physics.surface import BodySurface

UPS = {
    "Y": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    "Z": ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)),
}
"""Rotation of a file with the usual front of its up axis to Z up, facing -Y."""

SIDES = ("left", "right")

TRUNK, SLICE = ("hips", "lower_spine", "middle_spine", "upper_spine"), 0.03
"""Roles of the joints of the trunk, and metres over and under one within which is its slice of the trunk."""

ARMS = (0.0, 20.0, 45.0, 65.0, 80.0)
"""Degrees below the horizontal at which straight arms are tried, besides the rest pose."""

LEGS = (-2.0, 2.0, 8.0, 14.0)
"""Degrees outwards at which legs are tried, besides the rest pose."""

FEW_POINTS, SOME_POINTS, POINTS = 48, 96, 160
"""Points over the cloth by which starts are ranked, by which they are refined, and by which the best is."""

SIZES = (0.2, 1.0, 11)
"""Least and greatest diagonal of a garment, over that of the body, and how many are tried."""

HEIGHTS = (-0.48, 0.24, 13)
"""Heights of a garment's centre over the body's, in body heights, and how many are tried."""

RANKED, REFINED = 500, 8
"""Starts whose cloth is compared with the skin, and those that are refined."""

AS_GOOD = 0.01
"""Metres of the cost within which the other heading gets its stance too: clothes are alike from behind."""

STANCES_REFINED = {"arms": 6, "legs": 2}
"""Poses of limbs that are refined, the cheapest at the place of the start: sleeves beside the arms may be
cheap there.
"""

SAMPLES, BEST, ROUNDS = 24, 6, 7
"""Samples, those of them that move the mean, and rounds of a refinement."""

SPREAD = (0.04, 0.04, 0.07, 0.12, 4.0)
"""Standard deviations of the first samples: shift, m, logarithm of the scale, heading, degrees."""

OPENING_COST = 0.06
"""Metres added to the misfit where no opening goes around a bone."""

EASE = 0.015
"""Metres from the skin up to which cloth hardly costs: clothes have ease."""

LOOSE, LOOSE_COST = 0.04, 0.05
"""Metres from the skin from which on cloth hangs, and the cost of each metre beyond."""

BARE_COST, CLOTHED_SHARE = 0.08, 0.6
"""Metres added where no cloth is over trunk, upper arms and thighs, and the share from which on none is."""

PERSON, SIZE_COST, MOST_SIZE_COST = 0.3, 0.12, 0.04
"""Logarithm of the ratio between persons' heights and our body's, metres added for each unit of the logarithm
beyond, and at most.
"""

PERSON_COST = 0.04
"""Metres added for each unit of that logarithm within it."""

HELD = 0.4
"""Distance of a bone from the middle of an opening, in its radii, up to which it goes through it."""

SIDE_COST = 0.5
"""Metres added to the misfit for each metre that the centre of the cloth is beside the body's."""

TURN_COST, SKEW_COST = 0.004, 0.0004
"""Metres added to the misfit for a garment that faces another way than files usually do, and for each degree
between its heading and an axis, up to 10.
"""

TILT_COST, TILT = 0.01, 0.1
"""Metres added to the misfit where the uppermost opening leans backwards, and the sine of the angle from
which on all of them are: necklines and waistbands are lower in front.
"""

STANCE_COST = 0.003
"""Metres added to the misfit for each pair of limbs that is not as at rest."""

SYMMETRY_STEP = 5.0
"""Degrees between the vertical planes in which the garment is mirrored."""


@dataclass(frozen=True)
class Known:
    """Parts of an alignment that a user gives, None for what is to be found; as in Alignment."""

    shift: tuple[float, float, float] | None = None
    scale: float | None = None
    turn: float | None = None

    def check(self) -> None:
        """Raise InputError for a scale that is not above zero, or a number that is not finite."""
        given = [*(self.shift or ()), self.scale or 0.0, self.turn or 0.0]
        if not all(map(math.isfinite, given)):
            raise InputError("--shift, --scale, --turn: expected finite numbers")
        if self.scale is not None and self.scale <= 0.0:
            raise InputError(f"--scale {self.scale:g}: expected metres in one unit of the file, above 0")

    def __bool__(self) -> bool:
        return (self.shift, self.scale, self.turn) != (None, None, None)


UNKNOWN = Known()


@dataclass(frozen=True)
class Alignment:
    """Similarity that takes a file's coordinates to the body's, and the stance of the body that fits there.

    up: "Y" or "Z". turn: degrees about the vertical, counter-clockwise from above, from the usual front of
    the up axis. scale: metres in a unit of the file. shift: (x, y, z) m, added last. misfit: m, see `align`.
    """

    up: str
    turn: float
    scale: float
    shift: tuple[float, float, float]
    stance: Stance
    misfit: float

    def apply(self, points: Tensor) -> Tensor:
        """Points (N, 3) of the file in the body's frame: (N, 3) float32, metres, Z up, facing -Y."""
        turned = points.double() @ (_about_vertical(torch.tensor([self.turn]))[0].double() @ _up(self.up)).T
        return (self.scale * turned + torch.tensor(self.shift, dtype=torch.float64)).float()

    def text(self) -> str:
        """Description of the alignment in the words of the options that fix it; one line."""
        shift = " ".join(f"{each:.3f}" for each in self.shift)
        done = f"{self.up} up, shift {shift} m, scale {self.scale:.4g}, turn {self.turn:.0f} degrees"
        return ", ".join(filter(None, (done, self.stance.text())))


@dataclass(frozen=True)
class PlacementError:
    """Misfit of a garment at rest, m, see `align`; off_limbs: the part of it for openings that do not go
    around bones.
    """

    misfit: float
    off_limbs: float


@dataclass(frozen=True)
class Places:
    """K similarities: up (K,), index into UPS, turn (K,) degrees, scale (K,), shift (K, 3) m of centres."""

    up: Tensor
    turn: Tensor
    scale: Tensor
    shift: Tensor

    def at(self, rows: Tensor) -> "Places":
        return Places(self.up[rows], self.turn[rows], self.scale[rows], self.shift[rows])


class StancedBody:
    """A body in a stance, as garments are compared with it."""

    def __init__(self, body: Body, stance: Stance) -> None:
        self.stance = stance
        self.body = body if stance == REST else posed_body(body, limbs_held(body, stance))
        heads, parents = _centred_joints(self.body), self.body.skeleton.parents
        bones = [(parent, joint) for joint, parent in enumerate(parents) if parent >= 0]
        self.starts, self.ends = heads[torch.tensor(bones)].unbind(1)
        if has_arms(body):
            # A skirt goes around both legs.
            roles = assign_roles(body.skeleton.names, {})
            thighs, feet = (heads[[roles[f"{side}_{part}"] for side in SIDES]].mean(0) for part in LEG)
            self.starts = torch.cat([self.starts, thighs[None]])
            self.ends = torch.cat([self.ends, feet[None]])
        wanted = torch.tensor([REGIONS.index(region) for region in CLOTHED])
        self.clothed = torch.isin(body.regions, wanted)

    @cached_property
    def surface(self) -> BodySurface:
        return BodySurface(self.body.mesh.vertices, self.body.mesh.faces)


class AlignmentCost:
    """Cost of lying somewhere on a body, for a garment whose coordinates are relative to its centre."""

    def __init__(self, mesh: Mesh, body: Body) -> None:
        low, high = mesh.vertices.amin(0), mesh.vertices.amax(0)
        self.extent = (high - low).float()
        self.centre, self.size = (low + high) / 2, float(self.extent.norm())
        vertices = (mesh.vertices - self.centre).float() / self.size
        self.cloth = {
            count: ClothSample.of(vertices, mesh.faces, count) for count in (FEW_POINTS, SOME_POINTS, POINTS)
        }
        self.boundaries = boundaries(vertices, mesh.faces)
        areas = face_normals(vertices, mesh.faces).norm(dim=1, keepdim=True)
        self.centroid = (areas * vertices[mesh.faces].mean(1)).sum(0) / areas.sum()
        trunk = _trunk(body)
        self.middle = (trunk.amin(0) + trunk.amax(0)) / 2
        self.floor, top = body.mesh.vertices[:, 2].aminmax()
        self.height = float(top - self.floor)

    def cost(self, places: Places, standing: StancedBody, count: int) -> Tensor:
        """Metres (K,) by which a garment is off, more where it is unusual."""
        return self.misfit(places, standing, count) + self._unusual(places)

    def misfit(self, places: Places, standing: StancedBody, count: int) -> Tensor:
        """Metres (K,) by which a garment is off: its cloth, its openings, and its middle."""
        frames, cloth = self.frames(places), self.cloth[count]
        points = self.placed(places, cloth.points)
        normals = torch.einsum("kij,pj->kpi", frames, cloth.normals)
        beside = (self.placed(places, self.centroid[None])[:, 0, 0] - self.middle[0]).abs()
        return (
            self._lying(points, normals, standing) + SIDE_COST * beside + self.opening_cost(places, standing)
        )

    def _lying(self, points: Tensor, normals: Tensor, standing: StancedBody) -> Tensor:
        """Metres (K,) by which cloth (K, P, 3) does not lie as clothes lie; see `misfit`."""
        skin = standing.surface.closest(points.reshape(-1, 3), SEARCH_DISTANCE)
        distance = skin.signed_distance
        near = distance.clamp(min=0.0, max=LOOSE)
        off_skin = near.square() / (near + EASE) + LOOSE_COST * (distance - LOOSE).clamp(min=0.0)
        cost = torch.where(distance < 0, -INSIDE_WEIGHT * distance, off_skin).clamp(max=FAR)
        cost = cost + ACROSS_COST * ~lies_along(normals.reshape(-1, 3), skin)
        clothed = standing.clothed[skin.faces].float().reshape(points.shape[:2]).mean(1)
        bare = (1.0 - clothed / CLOTHED_SHARE).clamp(min=0.0)
        return cost.reshape(points.shape[:2]).mean(1) + BARE_COST * bare

    def opening_cost(self, places: Places, standing: StancedBody, held: float = HELD) -> Tensor:
        """Metres (K,) by which the openings do not go around bones, which may be off by `held`."""
        openings = self.boundaries
        if not len(openings.radii):
            return torch.zeros(len(places.up))
        centres = self.placed(places, openings.centres)
        axes = torch.einsum("kij,lj->kli", self.frames(places), openings.axes)
        radii = places.scale[:, None] * self.size * openings.radii
        bone = standing.ends - standing.starts
        length = bone.norm(dim=1).clamp(min=1e-6)
        along = bone / length[:, None]
        away = centres[:, :, None] - standing.starts
        share = ((away * along).sum(-1) / length).clamp(0.0, 1.0)
        off = (away - share[..., None] * bone).norm(dim=-1) / radii[..., None]
        across = 1.0 - torch.einsum("kli,bi->klb", axes, along).abs()
        wrong = (off - held).clamp(min=0.0) + (across - held).clamp(min=0.0)
        return OPENING_COST * wrong.amin(-1).clamp(max=1.0).mean(1)

    def _unusual(self, places: Places) -> Tensor:
        """Metres (K,) for an unusual scale or heading."""
        units = torch.tensor([math.log(UNITS[unit]) for unit in COMMON])
        ratio = (places.scale.log()[:, None] - units).abs().amin(1)
        size = (SIZE_COST * (ratio - PERSON).clamp(min=0.0)).clamp(max=MOST_SIZE_COST)
        size = size + PERSON_COST * ratio.clamp(max=PERSON)
        heading = TURN_COST * (places.turn.abs() > 45.0) + SKEW_COST * self.skew(places)
        return size + heading + self._leaning(places)

    def _leaning(self, places: Places) -> Tensor:
        """Metres (K,) for an uppermost opening that leans backwards."""
        if not len(self.boundaries.radii):
            return torch.zeros(len(places.up))
        frames = self.frames(places)
        heights = torch.einsum("kj,lj->kl", frames[:, 2], self.boundaries.centres)
        axes = torch.einsum("kij,kj->ki", frames, self.boundaries.axes[heights.argmax(1)])
        backwards = axes[:, 1] * axes[:, 2].sign()
        return TILT_COST * (backwards / TILT).clamp(0.0, 1.0)

    def skew(self, places: Places) -> Tensor:
        """Degrees (K,) between the heading and an axis, at most 10."""
        return ((places.turn + 45.0) % 90.0 - 45.0).abs().clamp(max=10.0)

    def frames(self, places: Places) -> Tensor:
        """Rotations (K, 3, 3) of the file's axes."""
        ups = torch.stack([_up(up) for up in UPS]).float()
        return _about_vertical(places.turn) @ ups[places.up]

    def placed(self, places: Places, points: Tensor) -> Tensor:
        """Points (K, P, 3) m of the garment, (P, 3) of its size about its centre."""
        turned = torch.einsum("kij,pj->kpi", self.frames(places), points)
        return places.scale[:, None, None] * self.size * turned + places.shift[:, None]

    def headings(self, up: str) -> list[float]:
        """Degrees to turn a garment: the four of axes, and those at which it is its own mirror image."""
        points = self.cloth[POINTS].points @ _up(up).float().T
        angles = torch.arange(0.0, 180.0, SYMMETRY_STEP)
        turned = torch.einsum("kij,pj->kpi", _about_vertical(angles), points)
        centred = turned - (turned.amin(1, keepdim=True) + turned.amax(1, keepdim=True)) / 2
        mirrored = centred * torch.tensor([-1.0, 1.0, 1.0])
        off = torch.cdist(mirrored, centred).amin(2).mean(1)
        best = float(angles[int(off.argmin())])
        return [0.0, 180.0, 90.0, -90.0, *([best, best - 180.0] if best % 90.0 else [])]

    def starts(self, known: Known) -> Places:
        """Every start: up axes, headings, sizes and heights."""
        diagonal = math.hypot(self.height, 0.6 * self.height)
        scales = diagonal / self.size * torch.logspace(math.log10(SIZES[0]), math.log10(SIZES[1]), SIZES[2])
        rows = [
            torch.cartesian_prod(
                torch.tensor([float(index)]),
                torch.tensor(self.headings(up) if known.turn is None else [known.turn]),
                scales if known.scale is None else torch.tensor([known.scale]),
                torch.linspace(*HEIGHTS[:2], HEIGHTS[2]) * self.height,
            )
            for index, up in enumerate(UPS)
        ]
        up, turn, scale, height = torch.cat(rows).unbind(1)
        shift = self.middle + height[:, None] * AXES["+Z"]
        places = Places(up.long(), turn, scale, shift)
        return self.held(places, known)

    def held(self, places: Places, known: Known) -> Places:
        """The places with what is known instead of what was sampled."""
        if known.scale is not None:
            places = replace(places, scale=torch.full_like(places.scale, known.scale))
        if known.turn is not None:
            places = replace(places, turn=torch.full_like(places.turn, known.turn))
        if known.shift is not None:
            centre = torch.einsum("kij,j->ki", self.frames(places), self.centre.float())
            places = replace(places, shift=torch.tensor(known.shift) + places.scale[:, None] * centre)
        return places

    def alignment(self, place: Places, stance: Stance, misfit: float) -> Alignment:
        """One place, (1,), as an alignment of the file's own coordinates."""
        x, y, z = (place.shift[0] - place.scale * (self.frames(place)[0] @ self.centre.float())).tolist()
        turn = (float(place.turn) + 180.0) % 360.0 - 180.0
        return Alignment(list(UPS)[int(place.up)], turn, float(place.scale), (x, y, z), stance, misfit)


def lying(mesh: Mesh, body: Body) -> PlacementError:
    """Measure how a garment in metres lies on a body at rest."""
    comparison, standing = AlignmentCost(mesh, body), StancedBody(body, REST)
    upright, centre = torch.tensor([list(UPS).index("Z")]), comparison.centre.float()
    here = Places(upright, torch.zeros(1), torch.ones(1), centre[None])
    return PlacementError(
        float(comparison.misfit(here, standing, POINTS)), float(comparison.opening_cost(here, standing))
    )


def stances(body: Body) -> list[Stance]:
    """The rest pose, and all that are tried besides; only the rest pose for a body without arms."""
    if not has_arms(body):
        return [REST]
    return [Stance(arms, legs) for arms in (None, *ARMS) for legs in (None, *LEGS)]


def align(mesh: Mesh, body: Body, known: Known = UNKNOWN, arms: float | None = None) -> Alignment:
    """Find where a garment of a file, in any unit and axes, lies best on a body.

    The misfit is metres by which cloth lies inside, across or off the skin, more where openings do not go
    around bones and where other regions than CLOTHED are covered. What is unusual in files is searched less.
    known: what is not searched. arms: degrees below the horizontal at which they are held, None to search it.
    """
    return search(AlignmentCost(mesh, body), body, known, arms)


def search(
    comparison: AlignmentCost, body: Body, known: Known = UNKNOWN, arms: float | None = None
) -> Alignment:
    """Find the alignment whose cost is least; known, arms: as `align` takes them."""
    tried = [stance for stance in stances(body) if arms is None or stance.arms == arms]
    standing = {stance: StancedBody(body, stance) for stance in tried}
    first = [each for each in standing.values() if each.stance.legs in (None, LEGS[0])]
    starts = comparison.starts(known)
    around = torch.stack([comparison.opening_cost(starts, each, 0.0) for each in first])
    kept = around.amin(0).argsort(stable=True)[:RANKED]
    places, suits = starts.at(kept), around[:, kept].argmin(0)
    costs = torch.full((len(first), len(kept)), torch.inf)
    for index, each in enumerate(first):
        rows = torch.nonzero((suits == index) | (index == 0)).squeeze(1)
        if len(rows):
            costs[index, rows] = comparison.cost(places.at(rows), each, FEW_POINTS)
    best = costs.amin(0).argsort(stable=True)[:REFINED].tolist()
    refined = [
        _refined(
            comparison,
            places.at(torch.tensor([row])),
            first[int(costs[:, row].argmin())],
            known,
            SOME_POINTS,
            1.0,
        )
        for row in best
    ]
    refined.sort(key=lambda each: each.cost)
    likely = refined[0]
    turned = [each for each in refined if _faces_away(each, likely) and each.cost < likely.cost + AS_GOOD]
    posed = [_best_stance(comparison, each, standing, known) for each in (likely, *turned[:1])]
    final = min(posed, key=lambda each: each.cost)
    misfit = float(comparison.misfit(final.place, final.standing, POINTS))
    return comparison.alignment(final.place, final.standing.stance, misfit)


def _refined(
    comparison: AlignmentCost, start: Places, standing: StancedBody, known: Known, count: int, narrow: float
) -> "_Refined":
    """The place near one, (1,), at which the cost is least, by the cross-entropy method."""
    generator = torch.Generator().manual_seed(0)
    mean = torch.cat([start.shift[0], start.scale.log(), start.turn])
    spread = narrow * torch.tensor(SPREAD)
    best, least = start, float(comparison.cost(start, standing, count))
    for _ in range(ROUNDS):
        rows = mean + spread * torch.randn(SAMPLES, len(SPREAD), generator=generator)
        places = Places(start.up.expand(SAMPLES), rows[:, 4], rows[:, 3].exp(), rows[:, :3])
        places = comparison.held(places, known)
        cost = comparison.cost(places, standing, count)
        order = cost.argsort(stable=True)
        if float(cost[order[0]]) < least:
            best, least = places.at(order[:1]), float(cost[order[0]])
        mean = rows[order[:BEST]].mean(0)
        spread = 0.5 * spread + 0.5 * rows[order[:BEST]].std(0)
    return _Refined(best, standing, least)


@dataclass(frozen=True)
class _Refined:
    """A place (1,), the body that it is on, and its cost, m, with that of an unusual stance."""

    place: Places
    standing: StancedBody
    least: float

    @property
    def cost(self) -> float:
        stance = self.standing.stance
        return self.least + STANCE_COST * sum(each is not None for each in (stance.arms, stance.legs))


def _best_stance(
    comparison: AlignmentCost, start: _Refined, standing: dict[Stance, StancedBody], known: Known
) -> _Refined:
    """The stance that fits best: arms first, then legs, each refined where it starts well."""
    best = start
    for part in STANCES_REFINED:
        others = [
            each
            for each in standing.values()
            if replace(each.stance, **{part: None}) == replace(best.standing.stance, **{part: None})
        ]
        costs = [float(comparison.cost(best.place, each, POINTS)) for each in others]
        order = sorted(range(len(others)), key=costs.__getitem__)[: STANCES_REFINED[part]]
        tried = [_refined(comparison, best.place, others[index], known, POINTS, 0.4) for index in order]
        best = min([best, *tried], key=lambda each: each.cost)
    return best


def _faces_away(one: _Refined, other: _Refined) -> bool:
    """Test for two headings that are more than a right angle apart."""
    apart = float(one.place.turn - other.place.turn)
    return math.cos(math.radians(apart)) < 0.0


def _centred_joints(body: Body) -> Tensor:
    """Joints (J, 3) m, those of the trunk midway between its front and its back: a spine is near the back."""
    heads, roles = body.skeleton.heads.clone(), assign_roles(body.skeleton.names, {})
    trunk = _trunk(body)
    for joint in (roles[role] for role in TRUNK if role in roles):
        near = trunk[(trunk[:, 2] - heads[joint, 2]).abs() < SLICE, 1]
        if len(near):
            heads[joint, 1] = (near.amin() + near.amax()) / 2
    return heads


def _trunk(body: Body) -> Tensor:
    """Corners (C, 3) m of the faces of the trunk."""
    return body.mesh.vertices[body.mesh.faces[body.regions == REGIONS.index("torso")]].reshape(-1, 3)


def _up(up: str) -> Tensor:
    return torch.tensor(UPS[up], dtype=torch.float64)


def _about_vertical(degrees: Tensor) -> Tensor:
    """Rotations (K, 3, 3) about Z by angles (K,)."""
    angle = torch.deg2rad(degrees)
    cos, sin, none, one = angle.cos(), angle.sin(), torch.zeros_like(angle), torch.ones_like(angle)
    return torch.stack([cos, -sin, none, sin, cos, none, none, none, one], dim=1).unflatten(1, (3, 3))
