"""The elastic arm: what making a robot elastic must leave as it was, and what two engines must agree on."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from jointscope.errors import InputError, JointscopeError
from jointscope.models.arm.agreement import (
    compare_engines,
    mujoco_gravity,
    mujoco_gravity_stiffness,
    mujoco_mass_matrix,
)
from jointscope.models.arm.build import build_arm, read_arm, source_file, with_reducers, write_arm
from jointscope.models.arm.holding import HoldKind, Probe, equilibrium, hold_arm
from jointscope.models.arm.library import find_arm, library_arms
from jointscope.models.arm.linear import damped_poles, joint_values, linear_arm, natural_modes
from jointscope.models.arm.reference import arm_reference, loaded, robot_reference
from jointscope.models.arm.solve import PAPER_TABLE_4, coupling_bound, equivalent, solve_arm
from jointscope.models.arm.table import ArmTable, ElasticJoint, Payload, read_table, write_table
from jointscope.sim.arm.plan import six_axis_table

RIGID = """<mujoco><compiler angle="radian"/><worldbody><body name="a">
<inertial pos="0.1 0 0.2" mass="5" diaginertia=".1 .2 .1"/>
<joint name="one" axis="0 1 0" armature="0.7" damping="3" frictionloss="2" stiffness="40" springref="0.3"/>
<body name="b" pos="0 0 0.5"><inertial pos="0.2 0 0.1" mass="2" diaginertia=".05 .06 .05"/>
<joint name="two" axis="0 1 0" armature="0.2" damping="1"/></body></body></worldbody>
<actuator><motor name="drive one" joint="one" gear="50"/></actuator></mujoco>"""


def rows(names, **figures):
    base = {"stiffness": 1e5, "damping": 50.0, "reduction_ratio": 100.0, "motor_inertia": 5e-4}
    return tuple(ElasticJoint(name=name, **{**base, **figures}) for name in names)


def library_table(name):
    return ArmTable(source=name, joints=rows(find_arm(name).axes))


@pytest.fixture(scope="module")
def table():
    return six_axis_table()


@pytest.fixture(scope="module")
def arm(table):
    return build_arm(table)


@pytest.fixture(scope="module")
def reference(arm):
    return arm_reference(arm)


def random_posture(names, seed):
    return dict(zip(names, np.random.default_rng(seed).uniform(-1.5, 1.5, len(names)), strict=True))


def test_library_holds_the_six_axis_arms():
    six = {found.name for found in library_arms() if len(found.axes) == 6}
    assert {"ur3", "ur5", "ur10", "kinova", "so100"} <= six


def test_an_unknown_robot_is_refused_with_the_names_there_are():
    with pytest.raises(JointscopeError, match=r"'puma'.*ur10"):
        find_arm("puma")


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10", "kinova", "so100", "so101"])
def test_both_engines_agree_on_every_six_axis_arm(name):
    arm = build_arm(library_table(name))
    both = compare_engines(arm, arm_reference(arm), random_posture(arm.rotors, 3))
    assert both.mass < 1e-6
    assert both.gravity < 1e-6
    assert both.gravity_stiffness < 1e-6
    assert both.modes < 1e-3


def test_the_arm_agrees_with_pinocchio_reading_the_urdf_itself(table, arm):
    by_urdf = loaded(robot_reference(source_file(table)), table.mass_scale, table.payload)
    for seed in range(3):
        posture = random_posture(arm.rotors, seed)
        M = by_urdf.mass_matrix(posture)
        assert np.max(np.abs(mujoco_mass_matrix(arm, posture) - M)) < 2e-6 * np.max(M)  # the MJCF has six digits
        assert np.max(np.abs(mujoco_gravity(arm, posture) - by_urdf.gravity(posture))) < 1e-3


def test_gravity_stiffness_is_the_slope_of_gravity_and_symmetric(arm, reference):
    posture = random_posture(arm.rotors, 5)
    slope = reference.gravity_stiffness(posture)
    assert np.allclose(slope, slope.T, atol=1e-9)
    assert np.allclose(slope, mujoco_gravity_stiffness(arm, posture), atol=1e-5)


@pytest.mark.parametrize("side", ["motor", "load"])
def test_making_a_joint_elastic_moves_its_figures_and_changes_nothing_else(tmp_path, side):
    path = tmp_path / "rigid.xml"
    path.write_text(RIGID)
    names = ("one", "two")
    arm = build_arm(
        ArmTable(source="rigid.xml", folder=tmp_path, joints=rows(names, motor_inertia=None, side=side))
    )
    rigid, elastic = mujoco.MjModel.from_xml_path(str(path)), arm.spec.compile()
    before, after = mujoco.MjData(rigid), mujoco.MjData(elastic)
    before.qpos[:], before.qvel[:] = [0.4, -0.7], [1.0, 0.5]
    rotors = [elastic.joint(n).qposadr[0] for n in arm.rotors]
    after.qpos[rotors], after.qvel[rotors] = before.qpos, before.qvel  # reducers unwound: the rigid robot
    mujoco.mj_forward(rigid, before)
    mujoco.mj_forward(elastic, after)
    M, E = np.zeros((2, 2)), np.zeros((4, 4))
    mujoco.mj_fullM(rigid, before, M)
    mujoco.mj_fullM(elastic, after, E)
    assert np.allclose(E[np.ix_(rotors, rotors)], M, rtol=1e-12)
    assert np.allclose(after.qfrc_bias[rotors], before.qfrc_bias, rtol=1e-12)
    assert np.allclose(after.qfrc_passive[rotors], before.qfrc_passive, rtol=1e-9)  # damping and balancer
    friction = elastic.dof_frictionloss[rotors[0]] + (elastic.tendon_frictionloss[0] if side == "load" else 0.0)
    assert friction == pytest.approx(2.0)
    assert elastic.jnt_stiffness[elastic.joint("one_elastic").id] == pytest.approx(1e5)
    assert elastic.actuator("drive one").trnid[0] == elastic.joint("one").id


def test_a_rotor_without_inertia_is_refused(tmp_path):
    (tmp_path / "rigid.xml").write_text(RIGID.replace('armature="0.2"', ""))
    table = ArmTable(source="rigid.xml", folder=tmp_path, joints=rows(("one", "two"), motor_inertia=None))
    with pytest.raises(InputError, match=r"two.*no inertia"):
        build_arm(table)


def test_table_survives_a_round_trip(tmp_path, table):
    write_table(tmp_path / "t.toml", table)
    again = read_table(tmp_path / "t.toml")
    assert replace(again, folder=table.folder) == table


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ("mass_skale = 1.0", "mass_skale"),
        ("lock = []\n[pay]\nmass = 1.0", "pay"),
        ('lock = []\n[[joint]]\nnam = "x"', "nam"),
    ],
)
def test_a_misspelt_key_is_named(tmp_path, line, key):
    (tmp_path / "t.toml").write_text(f'format = "jointscope-arm/1"\n[robot]\nsource = "ur10"\n{line}\n')
    with pytest.raises(InputError, match=key):
        read_table(tmp_path / "t.toml")


def test_mjcf_survives_a_round_trip(tmp_path, arm, table):
    write_arm(tmp_path / "arm.xml", arm)
    again = read_arm(tmp_path / "arm.xml")
    assert again.rotors == arm.rotors
    assert np.array_equal(mujoco_mass_matrix(again, table.posture), mujoco_mass_matrix(arm, table.posture))
    assert again.reduction_ratio(arm.rotors[1]) == 141.0


def test_mode_shapes_are_orthonormal_and_energies_sum_to_one(arm, reference, table):
    linear = linear_arm(reference, table.posture, joint_values(arm), {})
    modes = natural_modes(linear)
    assert np.allclose(modes.shape.T @ linear.M @ modes.shape, np.eye(6), atol=1e-9)
    assert np.allclose(modes.strain.sum(axis=0), 1.0)


def test_inverse_inertias_of_all_modes_add_up_to_the_free_accelerance(arm, reference, table):
    """Far above all modes a joint moves as if nothing held it: sum of 1/J~ = (M^-1)_jj."""
    linear = linear_arm(reference, table.posture, joint_values(arm), {})
    every = equivalent(natural_modes(linear), np.eye(6)[1])
    assert sum(1.0 / mode.inertia for mode in every) == pytest.approx(np.linalg.inv(linear.M)[1, 1], rel=1e-9)


def test_the_paper_s_pair_is_what_the_shipped_arm_has(arm, reference, table):
    linear = linear_arm(reference, table.posture, joint_values(arm), {})
    found = equivalent(natural_modes(linear), np.eye(6)[1])[:2]
    for mode, target in zip(found, PAPER_TABLE_4, strict=True):
        assert mode.inertia == pytest.approx(target.inertia, rel=1e-4)
        assert mode.stiffness == pytest.approx(target.stiffness, rel=1e-4)
        assert mode.damping == pytest.approx(target.damping, rel=1e-4)


def test_static_and_reciprocal_limits_of_the_response(arm, reference, table):
    linear = linear_arm(reference, table.posture, joint_values(arm), {})
    one, two = np.eye(6)[1], np.eye(6)[2]
    s = np.array([1e-6j, 2j * np.pi * 20.0])
    assert np.allclose(linear.receptance(s, one)[0].real, np.linalg.inv(linear.K)[:, 1], rtol=1e-6)
    assert np.allclose(linear.receptance(s, one)[:, 2], linear.receptance(s, two)[:, 1])


def test_a_braked_rotor_is_a_drive_of_endless_stiffness(arm, reference, table):
    values = joint_values(arm)
    stiff = replace(values, drive_stiffness=np.full(6, 1e12))
    braked = natural_modes(linear_arm(reference, table.posture, values, {})).frequency
    driven = natural_modes(
        linear_arm(reference, table.posture, stiff, dict.fromkeys(arm.rotors, "drive"))
    ).frequency
    assert np.allclose(driven[:6], braked, rtol=1e-6)


def test_a_locked_joint_drops_out_and_stiffens(arm, reference, table):
    values = joint_values(arm)
    free = natural_modes(linear_arm(reference, table.posture, values, {})).frequency
    locked = natural_modes(linear_arm(reference, table.posture, values, {arm.rotors[2]: "locked"})).frequency
    assert locked.size == 5
    assert np.all(locked >= free[:5] - 1e-9)  # Rayleigh: a constraint never lowers a frequency
    assert np.all(locked <= free[1:] + 1e-9)


def test_unlocked_inertia_never_exceeds_the_locked_one(arm, reference):
    for seed in range(5):
        posture = random_posture(arm.rotors, seed)
        assert np.all(reference.unlocked_inertia(posture) <= reference.locked_inertia(posture) * (1 + 1e-12))
        assert reference.unlocked_inertia(posture)[-1] == pytest.approx(reference.locked_inertia(posture)[-1])


def test_payload_adds_its_point_mass(arm, table):
    """A mass m at p adds m J_p^T J_p to the mass matrix, apart from its own small inertia."""
    base = loaded(robot_reference(source_file(table)), 1.0, None)
    more = loaded(
        robot_reference(source_file(table)), 1.0, Payload(mass=2.0, body="wrist_3_link", com=(0, 0.1, 0))
    )
    posture = random_posture(arm.rotors, 2)
    axes = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    motion = np.array(
        [
            base.rows(posture, Probe(name="p", body="wrist_3_link", point=(0, 0.1, 0), axis=axis))[0]
            for axis in axes
        ]
    )
    added = more.mass_matrix(posture) - base.mass_matrix(posture)
    assert np.max(np.abs(added - 2.0 * motion.T @ motion)) < 0.01


@pytest.mark.parametrize(
    "hold", [{}, "drive", {"shoulder_pan_joint": "locked", "wrist_2_joint": "locked", "elbow_joint": "drive"}]
)
def test_equilibrium_is_one(arm, table, hold):
    hold = dict.fromkeys(arm.rotors, hold) if isinstance(hold, str) else hold
    held = hold_arm(arm, hold, table.posture)
    rest = equilibrium(held, table.posture)
    data = mujoco.MjData(held.model)
    data.qpos[:] = rest.qpos
    for k, name in enumerate(arm.rotors):
        if held.hold[name] == "drive":
            kp = held.model.actuator_gainprm[held.actuator(name + "_drive"), 0]
            data.ctrl[held.actuator(name + "_drive")] = rest.rotor[k] + rest.torque[k] / kp
    mujoco.mj_forward(held.model, data)
    assert np.max(np.abs(data.qacc)) < 1e-8


def test_an_arm_with_a_brake_off_has_a_rigid_body_mode(arm, reference, table):
    hold: dict[str, HoldKind] = {arm.rotors[1]: "free"}
    level = {**table.posture}
    linear = linear_arm(reference, level, joint_values(arm), hold)
    assert natural_modes(linear).frequency[0] < 1.5  # only gravity brings it back
    frequency, _ = damped_poles(linear)
    assert frequency[-1] > 100.0


def test_other_reducers_change_only_what_they_name(arm, table):
    other = with_reducers(arm, {arm.rotors[2]: 5e4}, {arm.rotors[2]: 7.0})
    before, after = joint_values(arm), joint_values(other)
    assert after.stiffness[2] == 5e4
    assert after.damping[2] == 7.0
    assert np.array_equal(np.delete(after.stiffness, 2), np.delete(before.stiffness, 2))


def test_the_coupling_bound_is_met_by_two_springs():
    """Whatever the springs, two modes at the given ratio need a coupling below the bound."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        kappa = rng.uniform(0.05, 0.95)
        M = np.array([[1.0, kappa], [kappa, 1.0]])
        square = np.linalg.eigvals(np.linalg.solve(M, np.diag(np.exp(rng.normal(0.0, 1.0, 2))))).real
        low, high = np.sqrt(np.sort(square))
        assert kappa <= coupling_bound(low, high) + 1e-9


def test_what_a_stretched_arm_cannot_do_is_refused():
    table = read_table(_start())
    stiff = tuple(
        replace(row, stiffness=3e3) if row.name == "wrist_1_joint" else row for row in table.joints
    )  # a wrist so soft that it makes the modes itself
    with pytest.raises(JointscopeError, match="change the payload"):
        solve_arm(
            replace(table, joints=stiff),
            "shoulder_lift_joint",
            "elbow_joint",
            starts=2,
            rng=np.random.default_rng(0),
        )


def _start():
    from importlib.resources import files
    from pathlib import Path

    return Path(str(files("jointscope.models.arm") / "six_axis_start.toml"))


def test_probe_rows_are_what_mujoco_s_jacobian_says(arm, reference, table):
    probe = Probe(name="p", body="forearm_link", point=(0.1, 0.0, 0.3), axis=(1.0, 1.0, 0.0))
    held = hold_arm(arm, {}, table.posture, probes=[probe])
    data = mujoco.MjData(held.model)
    data.qpos[:] = equilibrium(held, table.posture).qpos
    mujoco.mj_forward(held.model, data)
    jac = np.zeros((3, held.model.nv))
    mujoco.mj_jacSite(held.model, data, jac, None, held.model.site("p").id)
    axis = data.site("p").xmat.reshape(3, 3)[:, 2].copy()
    motion, tilt = reference.rows(table.posture, probe)
    assert np.allclose(motion, (axis @ jac)[held.reducer], atol=1e-6)
    step = 1e-6
    ahead = data.qpos.copy()
    for k, dof in enumerate(held.reducer):
        data.qpos[:] = ahead
        data.qpos[dof] += step
        mujoco.mj_forward(held.model, data)
        moved = data.site("p").xmat.reshape(3, 3)[2, 2]
        assert tilt[k] == pytest.approx(9.80665 * (moved - axis[2]) / step, abs=1e-4)


def test_reflected_inertia_is_equation_two():
    row = rows(("x",), motor_inertia=1e-3, reducer_inertia=3.2e-4, reduction_ratio=141.0)[0]
    assert row.reflected_inertia == pytest.approx((1e-3 + 3.2e-4) * 141.0**2)
    assert math.isclose(PAPER_TABLE_4[0].frequency, 16.785, abs_tol=1e-3)
