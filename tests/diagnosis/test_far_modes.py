"""A neighbour about a parallel axis, met in three postures, is found though the base follows none of the hits."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.candidates import candidates_for, residuals_of
from jointscope.diagnosis.carriers import carriers
from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.far_modes import far_modes
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import with_fresh_jacobian
from jointscope.recordings.campaign import Run, Stream

J, K, C, MASS, REACH = 8.6, 1.3e5, 65.0, 12.0, 1.0  # MASS: m l [kg m]
NEIGHBOUR, STIFF, LOSS, LINK, WAY = (
    24.14,
    1.05e6,
    420.0,
    0.65,
    1.25,
)  # its inertia, spring, dashpot, length and direction
RATE = 1024.0
ALONG = J + MASS * LINK  # what couples the two where the arm lies along the link
FREE = math.sqrt(STIFF / (NEIGHBOUR + J + 2.0 * MASS * LINK - ALONG**2 / J)) / (
    2.0 * math.pi
)  # Hz, against a free joint


def struck(builders, rng, peak, posture, name, *, stiff=STIFF):
    """A hit at 0.8 m of an arm whose joint sits on a link that turns about a parallel axis; accelerometers at two radii."""
    couples = MASS * LINK * math.cos(posture - WAY)
    M = np.array([[NEIGHBOUR + J + 2.0 * couples, J + couples], [J + couples, J]])
    inverse = np.linalg.inv(M)

    def force(t):
        return peak * math.sin(math.pi * (t - 0.1) / 0.005) if 0.1 <= t < 0.105 else 0.0

    def arm(t):  # virtual work of a force along the arm's tangent at 0.8 m
        return np.array([0.8 + LINK * math.cos(posture - WAY), 0.8]) * force(t)

    def rates(t, x):
        return np.concatenate([x[2:], inverse @ (arm(t) - [stiff * x[0] + LOSS * x[2], K * x[1] + C * x[3]])])

    t = np.arange(int(1.4 * RATE)) / RATE
    x = solve_ivp(
        rates, (0.0, t[-1]), np.zeros(4), t_eval=t, method="DOP853", rtol=1e-8, atol=1e-12, max_step=1e-3
    ).y
    a = np.array([rates(u, s)[2:] for u, s in zip(t, x.T, strict=True)])
    channels = [builders.channel("f", "force", "N", "arm", "input", [force(u) for u in t], radius=0.8)]
    for column, radius in (("a", REACH), ("b", 0.45)):
        y = (radius + LINK * math.cos(posture - WAY)) * a[:, 0] + radius * a[:, 1]
        y = y + 0.02 * rng.standard_normal(t.size)
        channels.append(
            builders.channel(
                column, "linear-acceleration", "m/s^2", "arm", "output", y, radius=radius, direction="tangential"
            )
        )
    stream = Stream(file=f"{name}.csv", sampling_rate=RATE, length=t.size, channels=tuple(channels))
    return Run(id=name, experiment="hammer", streams=(stream,), brake=True, arm_angle=posture)


def sought(builders, stiff):
    rng = np.random.default_rng(9)
    runs = [
        struck(builders, rng, peak, posture, f"h{k}{peak:.0f}", stiff=stiff)
        for k, posture in enumerate((-1.1, -0.2, 0.8))
        for peak in (150.0, 260.0)
    ]
    rig = replace(
        builders.NAMEPLATE, plane="horizontal", arm_mass=24.0, arm_com_radius=0.5, stiffness_reference=1.5e5,
        inertia_reference=7.7, damping_reference=52.0,
    )  # fmt: skip
    problem = prepare(builders.campaign_of(runs, rig))
    specs = catalogue(problem)
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(problem, predict_outputs, tuple(range(len(runs))), pool)
        candidates = candidates_for(problem, specs, residuals_of(stage.objective, stage.predictions))
        where = stage.fit.coordinates
        theta, _ = where.unpack(stage.fit.x)
        theta[BASE_INDEX["stiffness"]], theta[BASE_INDEX["load_inertia"]] = (
            0.96 * K,
            0.98 * J,
        )  # as sweeps put them
        near = with_fresh_jacobian(stage.objective, replace(stage.fit, x=where.pack(theta, ())))
        far = far_modes(stage, stage.objective, near if stiff == STIFF else stage.fit, candidates)
        return stage, far, carriers(stage, stage.objective, specs)


@pytest.fixture(scope="module")
def sprung(builders):
    return sought(builders, STIFF)


def test_a_neighbour_that_couples_differently_in_each_posture_is_found(sprung):
    """The joint's stiffness and inertia, and where the link lies, are those of the two bodies; the rest is seen apart less."""
    stage, found, _ = sprung
    best = min(found, key=lambda h: h.loss)
    theta, (mode,) = best.fit.coordinates.unpack(best.fit.x)
    values = dict(zip((p.name for p in mode.spec.parameters), mode.values, strict=True))
    assert mode.spec.variant == "carrier-turned"
    assert best.fit.chi2 < 0.1 * stage.fit.chi2
    assert theta[BASE_INDEX["stiffness"]] == pytest.approx(K, rel=0.02)
    assert theta[BASE_INDEX["load_inertia"]] == pytest.approx(J, rel=0.05)
    assert values["direction"] == pytest.approx(WAY, abs=0.15)
    assert values["frequency"] == pytest.approx(FREE, rel=0.2)


def test_the_postures_own_stiffnesses_lead_to_it_from_the_base_that_lost_them(sprung):
    """No further from the data than where the sweeps' stiffness leads."""
    stage, far, found = sprung
    best = min(found, key=lambda h: h.loss)
    theta, (mode,) = best.fit.coordinates.unpack(best.fit.x)
    assert mode.spec.variant == "carrier-turned"
    assert best.fit.chi2 < 0.1 * stage.fit.chi2
    assert best.loss < min(h.loss for h in far)
    assert theta[BASE_INDEX["stiffness"]] == pytest.approx(K, rel=0.1)
    assert theta[BASE_INDEX["load_inertia"]] == pytest.approx(J, rel=0.05)
    assert mode.values[4] == pytest.approx(WAY, abs=0.15)


def test_none_is_sought_where_the_base_follows_the_hits(builders):
    assert sought(builders, 1e3 * STIFF)[1] == []


def test_no_posture_leads_to_a_carrier_that_no_hit_feels(builders):
    assert sought(builders, 1e5 * STIFF)[2] == []
