"""The rig's MJCF is the two-inertia joint, to MuJoCo and to Pinocchio alike."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from jointscope.errors import InputError
from jointscope.models.joint import antiresonance, torsion_frequency
from jointscope.models.paper import paper_rig
from jointscope.models.pinocchio_reference import arm_gravity_torque, arm_inertia, load_mjcf
from jointscope.models.rig import brake, rig_spec, write_mjcf

RIG = paper_rig()


def mass_matrix(model, q):
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    dense = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, dense)
    return dense, np.array(data.qfrc_bias)


def odd_rig():
    joint = replace(
        RIG.joint, stiffness=3.1e4, damping=7.0, load_inertia=4.4, reduction_ratio=57.0, load_damping=3.0
    )
    return replace(RIG, joint=joint, arm_mass=7.5, arm_com_radius=0.31)


@pytest.mark.parametrize("rig", [RIG, odd_rig()], ids=["paper", "odd"])
def test_mass_matrix_is_that_of_two_inertias(rig):
    """M = [[J_M + J_L, J_L], [J_L, J_L]] in (q_s, q - q_s), whatever the angle."""
    J_M, J_L = rig.joint.reflected_inertia, rig.joint.load_inertia
    M, _ = mass_matrix(rig_spec(rig).compile(), [0.4, -0.2])
    np.testing.assert_allclose(M, [[J_M + J_L, J_L], [J_L, J_L]], rtol=1e-9)


@pytest.mark.parametrize("rig", [RIG, odd_rig()], ids=["paper", "odd"])
def test_modes_are_those_of_8_and_9(rig):
    """The free rig's elastic mode is (9), the braked one's is (8)."""
    K = rig.joint.stiffness
    M, _ = mass_matrix(rig_spec(rig).compile(), [0.0, 0.0])
    free = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, np.diag([0.0, K]))).real.max())
    braked, _ = mass_matrix(brake(rig_spec(rig), 0.3).compile(), [0.0])
    assert free == pytest.approx(torsion_frequency(rig.joint), rel=1e-9)
    assert math.sqrt(K / braked[0, 0]) == pytest.approx(antiresonance(rig.joint), rel=1e-9)


def test_load_damping_acts_on_the_arms_own_speed():
    """b_l opposes q', shared by both coordinates; b_m opposes q_s' and c the wind-up's speed alone."""
    model = rig_spec(RIG).compile()
    data = mujoco.MjData(model)
    data.qvel[:] = [0.7, -0.2]
    mujoco.mj_forward(model, data)
    joint = RIG.joint
    of_load = joint.load_damping * 0.5
    expected = [-joint.motor_damping * 0.7 - of_load, joint.damping * 0.2 - of_load]
    np.testing.assert_allclose(data.qfrc_passive, expected, rtol=1e-12)


def test_controls_are_motor_torque_and_hammer_force():
    """T_e acts with eta n on q_s; the hammer's force with its radius on q, in any posture."""
    model = rig_spec(RIG).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = [1.1, 0.01]
    data.ctrl[:] = [2.0, 30.0]
    mujoco.mj_forward(model, data)
    by_hammer = 30.0 * RIG.hammer_radius
    np.testing.assert_allclose(
        data.qfrc_actuator,
        [2.0 * RIG.joint.efficiency * RIG.joint.reduction_ratio + by_hammer, by_hammer],
        rtol=1e-9,
    )


def test_accelerometer_at_rest_reads_gravity_upwards():
    """Tangential g cos q, radial g sin q, as the campaign format says."""
    windup = RIG.gravity_torque(0.6) / RIG.joint.stiffness
    model = brake(rig_spec(RIG), 0.6 - windup).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = [windup]
    mujoco.mj_forward(model, data)
    radial, _, tangential = data.sensor("accelerometer").data
    assert tangential == pytest.approx(RIG.gravity * math.cos(0.6), rel=1e-9)
    assert radial == pytest.approx(RIG.gravity * math.sin(0.6), rel=1e-9)


@pytest.mark.parametrize("angle", [-1.0, 0.0, 2.0])
def test_braked_arm_stands_where_the_brake_closed(angle):
    """A braked rig at zero wind-up has the geometry and gravity of the free one turned to the same angle."""
    free, held = rig_spec(RIG).compile(), brake(rig_spec(RIG), angle).compile()
    here, there = mujoco.MjData(free), mujoco.MjData(held)
    here.qpos[:] = [angle, 0.0]
    mujoco.mj_forward(free, here)
    mujoco.mj_forward(held, there)
    np.testing.assert_allclose(here.site("hammer").xpos, there.site("hammer").xpos, atol=1e-12)
    assert there.qfrc_bias[0] == pytest.approx(here.qfrc_bias[1], abs=1e-9)


def test_brake_leaves_other_tendons_their_share():
    """A tendon over both joints keeps its part on the reducer, with all its properties."""
    spec = rig_spec(RIG)
    extra = spec.add_tendon(name="extra")
    extra.stiffness[0], extra.springlength[:] = 123.0, 0.02
    extra.wrap_joint("motor", 2.0)
    extra.wrap_joint("reducer", -3.0)
    model = brake(spec, 0.1).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = [0.01]
    mujoco.mj_forward(model, data)
    tendon = model.tendon("extra").id
    assert data.ten_length[tendon] == pytest.approx(-0.03)
    assert model.tendon_stiffness[tendon] == 123.0
    assert model.tendon_damping[model.tendon("arm").id] == RIG.joint.load_damping


def test_brake_needs_a_motor():
    """Braking twice is an error that names the joint."""
    with pytest.raises(InputError, match="motor"):
        brake(brake(rig_spec(RIG), 0.0), 0.0)


@pytest.mark.parametrize("rig", [RIG, odd_rig()], ids=["paper", "odd"])
def test_pinocchio_and_mujoco_agree_on_the_same_file(rig, tmp_path):
    """Mass matrix and gravity torque agree to 1e-6 at random postures; so do J_L and -m g r cos q from the Rig."""
    path = write_mjcf(rig_spec(rig), tmp_path / "rig.xml")
    bodies, model = load_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    rng = np.random.default_rng(0)
    for q in rng.uniform(-2.0, 2.0, (10, 2)):
        M, bias = mass_matrix(model, q)
        np.testing.assert_allclose(bodies.mass_matrix(q), M, rtol=1e-6)
        np.testing.assert_allclose(bodies.gravity_torque(q), -bias, rtol=1e-6, atol=1e-6)
        assert arm_gravity_torque(bodies, q[0]) == pytest.approx(rig.gravity_torque(q[0]), rel=1e-6, abs=1e-5)
    assert arm_inertia(bodies) == pytest.approx(rig.joint.load_inertia, rel=1e-6)


def test_pinocchio_reads_the_braked_rig_at_its_angle(tmp_path):
    """The brake's angle survives the file: gravity on the arm is that of the angle held."""
    bodies = load_mjcf(write_mjcf(brake(rig_spec(RIG), -0.8), tmp_path / "braked.xml"))
    assert arm_gravity_torque(bodies, 0.0) == pytest.approx(RIG.gravity_torque(-0.8), rel=1e-6)


def test_pinocchio_takes_gravity_from_the_file(tmp_path):
    """A rig in a horizontal plane has no gravity torque."""
    bodies = load_mjcf(write_mjcf(rig_spec(replace(RIG, gravity=0.0)), tmp_path / "flat.xml"))
    assert arm_gravity_torque(bodies, 0.0) == 0.0


def test_a_second_tree_that_pinocchio_would_drop_is_refused(tmp_path):
    """Pinocchio silently keeps the first of two root bodies; the loader does not."""
    body = '<body name="{0}"><joint name="{0}" axis="0 1 0"/><geom size=".1" mass="1"/></body>'
    path = tmp_path / "two.xml"
    path.write_text(f"<mujoco><worldbody>{body.format('a')}{body.format('b')}</worldbody></mujoco>")
    with pytest.raises(InputError, match="1 of 2"):
        load_mjcf(path)


def test_unknown_joint_is_named_with_what_there_is(tmp_path):
    """The error lists the joints."""
    bodies = load_mjcf(write_mjcf(rig_spec(RIG), tmp_path / "rig.xml"))
    with pytest.raises(InputError, match="motor, reducer"):
        arm_inertia(bodies, "elbow")
