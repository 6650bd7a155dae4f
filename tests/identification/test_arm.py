"""Single joints and equivalent modes from hits on an arm, and stiffness from wind-up."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.errors import RefusedError
from jointscope.experiments.six_axis.plans import hammer_plan, joints_plan
from jointscope.identification.arm_spots import read_spots
from jointscope.identification.hit_spectra import Hit, read_hit
from jointscope.identification.joint_stiffness import BrakedArm, identify_joints
from jointscope.identification.modal_model import ModalModel
from jointscope.identification.modal_physics import equivalent_modes, explain_modes, with_modes
from jointscope.identification.windup import WindupRecord, fit_windup, statement
from jointscope.models.arm.build import build_arm
from jointscope.models.arm.linear import joint_values
from jointscope.models.arm.reference import arm_reference
from jointscope.models.arm.solve import PAPER_TABLE_4
from jointscope.sim.arm.campaign import arm_campaign, simulate_arm
from jointscope.sim.arm.plan import ELBOW, JOINT


@pytest.fixture(scope="module")
def joint_hits():
    plan = joints_plan(hits=2)
    campaign = arm_campaign(plan, tuple(r.run for r in simulate_arm(plan, np.random.default_rng(4))))
    return plan, campaign


@pytest.fixture(scope="module")
def spots(joint_hits):
    plan, campaign = joint_hits
    return read_spots(campaign, arm_reference(build_arm(plan.lab)))[0]


@pytest.fixture(scope="module")
def fit(joint_hits, spots):
    lab = build_arm(joint_hits[0].lab)
    rough = joint_values(lab)
    return identify_joints(spots, lab.rotors, rough.stiffness, rough.damping, (JOINT, ELBOW))


@pytest.fixture(scope="module")
def modes():
    plan = hammer_plan()
    spot = replace(plan.spots[0], hammer=replace(plan.spots[0].hammer, hits=6))
    plan = replace(plan, spots=(spot,))
    campaign = arm_campaign(plan, tuple(r.run for r in simulate_arm(plan, np.random.default_rng(1))))
    hits = [hit for run in campaign.runs if isinstance(hit := read_hit(run, campaign.rig), Hit)]
    return equivalent_modes(hits, campaign.rig)


def test_hits_are_gathered_by_point_and_posture(spots):
    assert len(spots) == 4
    assert all(len(spot.hits) == 2 for spot in spots)
    assert all(spot.outputs == ("acc_upper_arm", "acc_forearm") for spot in spots)  # the base shows the floor


def test_the_response_s_derivatives_are_its_slopes(spots):
    model = BrakedArm(spots[1], np.concatenate([np.log(np.full(6, 8e4)), np.log(np.full(6, 20.0)), [0.02]]))
    s = 2j * np.pi * np.array([5.0, 17.0, 40.0])
    jacobian = model.jacobian(s)
    for k in range(13):
        step = np.zeros(13)
        step[k] = 1e-5
        slope = (
            model.with_vector(model.vector() + step).response(s)
            - model.with_vector(model.vector() - step).response(s)
        ) / 2e-5
        assert np.allclose(slope, jacobian[:, :, k], rtol=1e-6, atol=1e-9 * np.abs(jacobian).max())


def test_joints_two_and_three_are_recovered(joint_hits, fit):
    truth = joint_values(build_arm(joint_hits[0].truth))
    for k in (1, 2):
        assert fit.stiffness[k].value == pytest.approx(truth.stiffness[k], rel=5e-3)
        assert fit.stiffness[k].low <= truth.stiffness[k] <= fit.stiffness[k].high
        assert fit.damping[k].value == pytest.approx(truth.damping[k], rel=0.05)
    assert fit.misfit == pytest.approx(1.0, abs=0.05)


def test_what_the_hits_do_not_move_is_said_not_to_be_identifiable(fit):
    said = {estimate.joint: estimate.identifiable for estimate in fit.stiffness}
    assert said[JOINT]
    assert said[ELBOW]
    assert not said["wrist_3_joint"]


def test_no_hits_no_joints():
    with pytest.raises(RefusedError, match="no usable hit"):
        identify_joints([], ("a",), np.ones(1), np.ones(1), ("a",))


def test_a_double_hit_is_left_out(joint_hits):
    plan, campaign = joint_hits
    run = campaign.runs[0]
    force = run.select("force")[0].samples.copy()
    at = int(np.argmax(force)) + 25
    force[at : at + 10] += 0.5 * force.max() * np.hanning(10)
    stream = run.streams[0]
    bad = replace(
        stream, channels=(replace(stream.channels[0], samples=force), *stream.channels[1:])
    )  # the same hit with a rebound
    spoilt = replace(campaign, runs=(replace(run, streams=(bad,)), *campaign.runs[1:]))
    spots, rejected = read_spots(spoilt, arm_reference(build_arm(plan.lab)))
    assert [r.finding for r in rejected] == ["double-hit"]
    assert sum(len(spot.hits) for spot in spots) == 7


def test_equivalent_parameters_are_the_paper_s(modes):
    assert len(modes.modes) == 2
    for mode, target in zip(modes.modes, PAPER_TABLE_4, strict=True):
        assert mode.inertia.value == pytest.approx(target.inertia, rel=0.05)
        assert mode.stiffness.value == pytest.approx(target.stiffness, rel=0.05)
        assert mode.damping.value == pytest.approx(target.damping, rel=0.05)
        assert mode.inertia.low < mode.inertia.value < mode.inertia.high
    assert modes.complex_modes  # joint 2 is damped fifteen times as much as joint 3


def test_modes_say_which_joints_move(modes, joint_hits):
    plan = joint_hits[0]
    arm = build_arm(plan.truth)
    low, high = explain_modes(modes, arm_reference(arm), plan.truth.posture, joint_values(arm), JOINT)
    assert max(low.share, key=low.share.get) == JOINT
    assert max(high.share, key=high.share.get) == ELBOW
    assert "together" in low.summary
    assert "against each other" in high.summary
    assert low.inertia == pytest.approx(PAPER_TABLE_4[0].inertia, rel=1e-3)


def test_stabilisation_holds_both_modes_at_every_higher_order(modes):
    poles = modes.selection.stabilisation
    higher = {p.order for p in poles if p.order >= 4}
    assert higher
    for wanted in (16.79, 28.65):
        assert {p.order for p in poles if p.stable and abs(p.frequency - wanted) < 0.1} >= higher


def test_parts_of_a_sum_add_up():
    none = np.zeros(0)
    model = ModalModel(
        a1=np.array([7.0, 6.0]), a2=np.array([1.1e4, 3.2e4]), b1=np.array([[0.1, 0.07]]), mass_line=none,
        stiffness_line=none, b2=np.array([[0.5, -1.4]]),
    )  # fmt: skip
    s = 2j * np.pi * np.linspace(2.0, 50.0, 30)
    parts = with_modes(model, [0]).response(s) + with_modes(model, [1]).response(s)
    assert np.allclose(parts, model.response(s))


def test_b2_has_its_slopes_too():
    rng = np.random.default_rng(0)
    model = ModalModel(
        a1=np.array([7.0, 6.0]), a2=np.array([1.1e4, 3.2e4]), b1=rng.normal(size=(2, 2)), mass_line=rng.normal(size=2),
        stiffness_line=1e-4 * rng.normal(size=2), b2=rng.normal(size=(2, 2)),
    )  # fmt: skip
    s = 2j * np.pi * np.linspace(2.0, 50.0, 9)
    jacobian = model.jacobian(s)
    for k, value in enumerate(model.vector()):
        step = np.zeros(model.vector().size)
        step[k] = 1e-6 * max(1.0, abs(value))
        ahead, behind = (model.with_vector(model.vector() + sign * step).response(s) for sign in (1.0, -1.0))
        assert np.allclose((ahead - behind) / (2.0 * step[k]), jacobian[:, :, k], rtol=1e-4, atol=1e-8)


def axis_takes(stiffness=6e6, skew=0.0, coulomb=300.0, inertia=700.0, rotor=600.0, seed=0):
    """Three takes of an axis that turns to and fro; its motor's encoder is read ``skew`` s after everything else."""
    rng = np.random.default_rng(seed)
    takes = []
    for name in "ABC":
        parts = list(zip((0.1, 0.23, 0.5), rng.uniform(0.1, 0.4, 3), rng.uniform(0, 6, 3), strict=True))

        def motion(t, order, parts=parts):
            return sum(
                a * (2 * np.pi * f) ** order * np.sin(2 * np.pi * f * t + p + order * np.pi / 2)
                for f, a, p in parts
            )

        def spring(t, motion=motion):
            return inertia * motion(t, 2) + 2000.0 * np.cos(motion(t, 0))

        t = np.arange(2500) * 0.004
        torque = spring(t) + rotor * motion(t, 2) + coulomb * np.tanh(motion(t, 1) / 2e-3)
        motor = motion(t + skew, 0) + spring(t + skew) / stiffness + 1e-4
        takes.append(
            WindupRecord(
                name=name, rate=250.0, motor_angle=motor + 2e-5 * rng.normal(size=t.size),
                link_angle=motion(t, 0) + 2e-5 * rng.normal(size=t.size),
                torque=torque + 10.0 * rng.normal(size=t.size),
            )
        )  # fmt: skip
    return takes


@pytest.mark.parametrize("skew", [0.0, 2.8e-3])
def test_windup_tells_stiffness_from_skew(skew):
    found = fit_windup(axis_takes(skew=skew), 600.0, rng=np.random.default_rng(0))
    assert found.stiffness.value == pytest.approx(6e6, rel=0.02)
    assert found.stiffness.low <= 6e6 <= found.stiffness.high
    assert found.skew.value == pytest.approx(skew, abs=1e-5)
    assert found.coulomb.value == pytest.approx(300.0, rel=0.2)


def test_skew_ruins_the_plain_spring_and_nothing_else():
    plain = fit_windup(axis_takes(coulomb=0.0, rotor=0.0), 0.0, rng=np.random.default_rng(0))
    skewed = fit_windup(axis_takes(coulomb=0.0, rotor=0.0, skew=2.8e-3), 0.0, rng=np.random.default_rng(0))
    assert plain.plain_explained > 0.99
    assert plain.plain_stiffness.value == pytest.approx(6e6, rel=0.02)
    assert skewed.plain_explained < 0.8
    assert "2.80 ms apart" in statement(skewed, "axis 1")


def test_an_axis_at_rest_is_refused():
    still = [replace(take, link_angle=np.zeros(2500)) for take in axis_takes()]
    with pytest.raises(RefusedError, match="hardly moves"):
        fit_windup(still, 600.0, rng=np.random.default_rng(0))
