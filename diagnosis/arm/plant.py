r"""The arm's dynamics along one joint's path, tabled: what the kernel interpolates.

Joint k moves far, the others only shake about the posture. With q = path(p) + y, to first order in the others' angles
and rates and without further approximation in joint k's own,

    M(p) q'' + p' D(p) (q' - e_k p'/2) + g(p) + K_g(p) y = T

where D = dh/dq' at q' = e_k of the velocity-product torque h (Pinocchio's RNEA derivatives), g the gravity torque and
K_g its slope. An accelerometer along axis a at a point with Jacobian row J reads

    J q'' + p' B (q' - e_k p'/2) + a_g(p) + S y

with B the same derivative of the point's velocity-product acceleration, a_g = -a.g, S how gravity's share tilts. Hits and
sweeps are the table of a single node.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from jointscope.models.arm.holding import Probe
from jointscope.models.arm.reference import Reference

Vector = NDArray[np.float64]

KEPT = 64  # reduced tables
SPACING = 0.02  # rad between nodes: linear interpolation errs by 5e-5 of a unit swing


@dataclass(frozen=True, eq=False)
class Reduced:
    """The table of the joints that move, contiguous, for the kernel; N nodes, m joints, o sensors.

    Attributes:
        joints: Their places in the arm, shape (m,).
        inverse: M^-1 [1/(kg m^2)], shape (N, m, m).
        gravity, slope, product: g, K_g, D, shapes (N, m), (N, m, m), (N, m, m).
        motion, tilt, bias, static: J, S, B, a_g, shapes (N, o, m) thrice and (N, o).
        hit: J of the hammer's point at the posture, shape (m,).
        moving: Place of joint k among ``joints``, -1 where nothing moves far.
    """

    joints: NDArray[np.int_]
    inverse: Vector
    gravity: Vector
    slope: Vector
    product: Vector
    motion: Vector
    tilt: Vector
    bias: Vector
    static: Vector
    hit: Vector
    moving: int


@dataclass(frozen=True)
class Mount:
    """How an arm's mount gives way.

    Attributes:
        depth: Of the axis about which it turns, under the arm's origin [m].
        heavier: Its own inertia over that of the arm about the same axis [-].
    """

    depth: float
    heavier: float


@dataclass(frozen=True)
class Links:
    """In which the links' inertia is another than the file says, shape (n,) each; their weight is as in the file, but one's.

    Attributes:
        added: About its own joint's axis [kg m^2]: a link whose mass lies elsewhere about its centre.
        masses: As a multiple of all that the file says of it: a link of other walls.
        carried: What the last link carries, over its own inertia and over its own weight [-].
        heavier: Which link weighs more than the file says, and by how much over its own weight [-].
    """

    added: tuple[float, ...]
    masses: tuple[float, ...]
    carried: tuple[float, float] = (0.0, 0.0)
    heavier: tuple[int, float] = (0, 0.0)


Key = tuple[tuple[bool, ...], Links, Mount | None]


@dataclass(frozen=True, eq=False)
class Plant:
    """The whole arm's table; see :class:`Reduced` for the symbols, n joints and the two ways its mount gives way.

    Attributes:
        low, step: First node and spacing of p [rad], counted from the posture.
        moving: k, or -1.
        mass: M, shape (N, n + 2, n + 2).
        shares: What each link's own inertia gives to M, shape (N, n + 2, n + 2, n + 2), link second.
        turns: How fast each link turns about its own joint's axis per rate of any joint [-], shape (N, n + 2, n + 2),
            link second.
        weights: What holds each link's own weight [N m], shape (N, n + 2, n + 2), link second.
    """

    low: float
    step: float
    moving: int
    mass: Vector
    gravity: Vector
    slope: Vector
    product: Vector
    motion: Vector
    tilt: Vector
    bias: Vector
    static: Vector
    hit: Vector
    shares: Vector
    turns: Vector
    weights: Vector
    _cache: dict[Key, Reduced] = field(default_factory=dict, repr=False)

    def reduced(self, mask: NDArray[np.bool_], links: Links, mount: Mount | None) -> Reduced:
        """The same with only the joints of ``mask`` moving, the others rigid at the posture.

        Args:
            mask: Shape (n,).
            mount: How the arm moves on its mount, as the last joint; ``None``: it does not.
        """
        key = (tuple(bool(m) for m in mask), links, mount)
        found = self._cache.get(key)
        if found is None:
            found = self._reduced(mask, links, mount)
            if len(self._cache) > KEPT:
                self._cache.clear()
            self._cache[key] = found
        return found

    def _reduced(self, mask: NDArray[np.bool_], links: Links, mount: Mount | None) -> Reduced:
        n, j = len(mask), np.flatnonzero(mask)
        columns = np.eye(self.mass.shape[1])[:, j]
        mass, added, scaled = self.mass, np.array(links.added), np.array(links.masses) - 1.0
        if np.any(scaled):
            mass = mass + np.einsum("i,nijk->njk", scaled, self.shares[:, :n])
        if np.any(added):
            mass = mass + np.einsum("i,nij,nik->njk", added, self.turns[:, :n], self.turns[:, :n])
        gravity = self.gravity
        if any(links.carried):
            mass = mass + links.carried[0] * self.shares[:, n - 1]
            gravity = gravity + links.carried[1] * self.weights[:, n - 1]
        if links.heavier[1]:
            gravity = gravity + links.heavier[1] * self.weights[:, links.heavier[0]]
        moving = int(np.flatnonzero(j == self.moving)[0]) if self.moving in j else -1
        if mount is not None:
            together = np.zeros((self.mass.shape[1], 1))
            together[n:, 0] = 1.0, mount.depth
            columns, j = np.concatenate([columns, together], axis=1), np.append(j, n)

        def both(x: Vector) -> Vector:
            return np.ascontiguousarray(columns.T @ x @ columns, dtype=np.float64)

        def right(x: Vector) -> Vector:
            return np.ascontiguousarray(x @ columns, dtype=np.float64)

        small = both(mass)
        if mount is not None:
            small[:, -1, -1] *= 1.0 + mount.heavier
        return Reduced(
            j,
            np.ascontiguousarray(np.linalg.inv(small)),
            right(gravity),
            both(self.slope),
            both(self.product),
            right(self.motion),
            right(self.tilt),
            right(self.bias),
            np.ascontiguousarray(self.static),
            right(self.hit),
            moving,
        )


def arm_plant(
    reference: Reference,
    posture: Mapping[str, float],
    sensors: Sequence[Probe],
    hit: Probe | None,
    moving: int,
    path: tuple[float, float],
) -> Plant:
    """Table the arm over ``path`` [rad from the posture] of joint ``moving`` (-1: one node, at the posture)."""
    n = len(reference.joints)
    if moving < 0:
        nodes = np.zeros(1)
    else:
        count = max(2, int(np.ceil((path[1] - path[0]) / SPACING)) + 1)
        nodes = np.linspace(path[0], path[1], count)
    places = [_with(posture, reference.joints[moving], p) if moving >= 0 else dict(posture) for p in nodes]
    rows = [[reference.rows(place, s) for s in sensors] for place in places]
    shape = (len(nodes), len(sensors), n)
    static = np.array([[_static(reference, place, s) for s in sensors] for place in places])
    product, bias = np.zeros((len(nodes), n, n)), np.zeros(shape)
    if moving >= 0:
        for i, place in enumerate(places):
            product[i] = _product(reference, place, moving)
            for o, sensor in enumerate(sensors):
                bias[i, o] = _bias(reference, place, moving, sensor)
    return Plant(
        low=float(nodes[0]),
        step=float(nodes[1] - nodes[0]) if len(nodes) > 1 else 1.0,
        moving=moving,
        mass=np.array([reference.mass_matrix(place) for place in places]),
        gravity=np.array([reference.gravity(place) for place in places]),
        slope=np.array([reference.gravity_stiffness(place) for place in places]),
        product=product,
        motion=np.array([[r[0] for r in node] for node in rows]).reshape(shape),
        tilt=np.array([[r[1] for r in node] for node in rows]).reshape(shape),
        bias=bias,
        static=static.reshape(shape[:2]),
        hit=np.zeros(n) if hit is None else reference.rows(posture, hit)[0],
        shares=np.array(shares := [reference.shares(place) for place in places]),
        weights=np.array([reference.weights(place) for place in places]),
        turns=np.array([_turns(reference.axes(p), own) for p, own in zip(places, shares, strict=True)]),
    )


def _turns(axes: Vector, shares: Vector) -> Vector:
    """a_i . a_k of every joint k that carries link i, else 0, shape (n, n)."""
    carries = np.einsum("ikk->ik", shares) > 0.0
    return np.asarray(np.where(carries, axes @ axes.T, 0.0))


def _with(posture: Mapping[str, float], joint: str, by: float) -> dict[str, float]:
    return {**posture, joint: float(posture.get(joint, 0.0)) + by}


def _configuration(reference: Reference, posture: Mapping[str, float]) -> Vector:
    angles = np.zeros(reference.model.nv)
    angles[reference.dofs] = [float(posture.get(name, 0.0)) for name in reference.joints]
    return np.asarray(pin.integrate(reference.model, pin.neutral(reference.model), angles))


def _product(reference: Reference, posture: Mapping[str, float], moving: int) -> Vector:
    """D [N m per (rad/s)^2], shape (n, n)."""
    model = reference.model
    data = model.createData()
    v = np.zeros(model.nv)
    v[reference.dofs[moving]] = 1.0
    pin.computeRNEADerivatives(model, data, _configuration(reference, posture), v, np.zeros(model.nv))
    return np.asarray(data.dtau_dv)[np.ix_(reference.dofs, reference.dofs)].copy()


def _world(reference: Reference, posture: Mapping[str, float], sensor: Probe) -> tuple[Vector, Vector]:
    """Axis and lever of a probe in the world's directions."""
    model = reference.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, _configuration(reference, posture))
    rotation = np.asarray(data.oMf[model.getFrameId(sensor.body)].rotation)
    return rotation @ sensor.direction, rotation @ np.asarray(sensor.point)


def _static(reference: Reference, posture: Mapping[str, float], sensor: Probe) -> float:
    """What the sensor reads at rest [m/s^2]: -axis . g."""
    if sensor.body == "world":
        return float(-sensor.direction @ np.asarray(reference.model.gravity.linear))
    return float(-_world(reference, posture, sensor)[0] @ np.asarray(reference.model.gravity.linear))


def _bias(reference: Reference, posture: Mapping[str, float], moving: int, sensor: Probe) -> Vector:
    """B [m/s^2 per (rad/s)^2], shape (n,), by polarisation of the point's velocity-product acceleration."""
    n = len(reference.joints)
    if sensor.body == "world":
        return np.zeros(n)
    model = reference.model
    data = model.createData()
    q = _configuration(reference, posture)
    frame = model.getFrameId(sensor.body)
    axis, lever = _world(reference, posture, sensor)

    def acceleration(v: Vector) -> float:
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        found = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        speed = np.asarray(pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).angular)
        turn = np.cross(np.asarray(found.angular), lever) + np.cross(speed, np.cross(speed, lever))
        return float(axis @ (np.asarray(found.linear) + turn))

    def unit(*places: int) -> Vector:
        v = np.zeros(model.nv)
        for place in places:
            v[reference.dofs[place]] += 1.0
        return v

    own = acceleration(unit(moving))
    return np.array([acceleration(unit(moving, j)) - own - acceleration(unit(j)) for j in range(n)])
