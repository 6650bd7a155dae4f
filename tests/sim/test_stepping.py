"""The stepping is a second-order leapfrog whose read-out knows when each signal was."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointscope.models.joint import antiresonance
from jointscope.models.paper import paper_rig
from jointscope.models.rig import brake, rig_spec
from jointscope.sim import stepping
from jointscope.sim.bench import holding_command, set_up, take
from jointscope.sim.calibration import calibrate
from jointscope.sim.equilibrium import EquilibriumError, equilibrium
from jointscope.sim.physics import Physics
from jointscope.sim.stepping import grid, machine, march, stack_inputs, step

RIG = paper_rig()
FLAT = replace(RIG, gravity=0.0)
H = 1e-4


def released(rig, windup, h, duration):
    """The braked arm let go from a wind-up [rad]."""
    braked = machine(brake(rig_spec(rig), 0.0), h)
    return step(braked, np.array([windup]), stack_inputs(braked, {}, len(grid(duration, h))))


def free_decay(rig, times, windup):
    """Its closed form, from rest at t = 0."""
    joint = rig.joint
    w0, sigma = antiresonance(joint), 0.5 * (joint.damping + joint.load_damping) / joint.load_inertia
    w = math.sqrt(w0**2 - sigma**2)
    return windup * np.exp(-sigma * times) * (np.cos(w * times) + sigma / w * np.sin(w * times))


def decay_error(h):
    # the leapfrog's first speed belongs to -h/2, where a released arm had none: start from where the decay is smooth
    trace = released(FLAT, 1e-3, h, 0.2)
    skip = round(0.02 / h)
    times, angle = trace.times[skip:], trace.signals["arm angle"][skip:]
    basis = np.column_stack([free_decay(FLAT, times, 1.0), np.gradient(free_decay(FLAT, times, 1.0), h)])
    coefficients, *_ = np.linalg.lstsq(basis, angle, rcond=None)
    return float(np.abs(basis @ coefficients - angle).max() / 1e-3)


def test_error_falls_with_the_square_of_the_step():
    """Order of convergence 2, by the slope of log error over log step."""
    steps = np.array([4e-4, 2e-4, 1e-4])
    errors = np.array([decay_error(h) for h in steps])
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 1.8 < order < 2.3


def test_undamped_joint_keeps_its_energy():
    """Without damping the amplitude neither grows nor decays over 20 periods."""
    joint = replace(FLAT.joint, damping=0.0, load_damping=0.0, motor_damping=0.0)
    angle = released(replace(FLAT, joint=joint), 1e-3, H, 0.5).signals["arm angle"]
    early, late = np.abs(angle[: len(angle) // 10]).max(), np.abs(angle[-len(angle) // 10 :]).max()
    assert late == pytest.approx(early, rel=2e-3)


def test_without_inputs_momentum_is_conserved():
    """Spring and reducer damping only pass torque from one side to the other."""
    joint = replace(FLAT.joint, motor_damping=0.0, load_damping=0.0)
    free = machine(rig_spec(replace(FLAT, joint=joint)), H)
    trace = step(free, np.array([0.0, 1e-3]), stack_inputs(free, {}, 5000))
    J_M, J_L = joint.reflected_inertia, joint.load_inertia
    momentum = J_M * trace.signals["motor speed"] + J_L * trace.signals["arm speed"]
    assert np.abs(momentum).max() < 1e-6 * J_L * np.abs(trace.signals["arm speed"]).max()


@pytest.mark.parametrize("angle", [-math.pi / 3.0, 0.0, 1.2])
@pytest.mark.parametrize("braked", [False, True])
def test_rest_stays_at_rest(angle, braked):
    """From its equilibrium nothing moves: the holding torque is gravity's over eta n, the brake needs none."""
    setup = set_up(rig_spec(RIG), angle, H, braked=braked)
    columns = {} if braked else {"motor": setup.holding_torque}
    trace = take(setup, columns, 2000)
    assert trace.signals["arm angle"][0] == pytest.approx(angle, abs=1e-12)
    assert np.ptp(trace.signals["arm angle"]) < 1e-9
    gain = RIG.joint.efficiency * RIG.joint.reduction_ratio
    assert setup.holding_torque == pytest.approx(0.0 if braked else -RIG.gravity_torque(angle) / gain, abs=1e-9)


def test_no_rest_is_an_error():
    """A spring that is cancelled leaves a torque that nothing can balance; the error says how much."""
    free = machine(rig_spec(RIG), H)
    with pytest.raises(EquilibriumError, match="unbalanced"):
        equilibrium(free, 0.0, lambda t, q, qd: np.array([0.0, RIG.joint.stiffness * q[1] + 500.0]))


def test_signals_belong_to_the_same_instant():
    """Speed is the derivative of angle and acceleration that of speed, centred, and input meets output at once."""
    free = machine(rig_spec(FLAT), H)
    times = grid(0.5, H)
    torque = np.sin(2.0 * np.pi * 10.0 * times)
    trace = step(free, np.zeros(2), stack_inputs(free, {"motor": torque}, len(times)))
    angle, speed = trace.signals["arm angle"], trace.signals["arm speed"]
    acceleration = trace.signals["arm acceleration"]
    central = (angle[2:] - angle[:-2]) / (2.0 * H)
    np.testing.assert_allclose(speed[1:-1], central, atol=1e-12)
    np.testing.assert_allclose(acceleration[1:-1], (angle[2:] - 2.0 * angle[1:-1] + angle[:-2]) / H**2, atol=1e-6)
    np.testing.assert_allclose(
        trace.signals["accelerometer"][:, 2] / FLAT.accelerometer_radius, acceleration, atol=1e-9
    )


def test_march_and_rollout_are_the_same_stepping():
    """Python's loop and compiled code give the same bits."""
    free = machine(rig_spec(RIG), H)
    inputs = stack_inputs(free, {"motor": np.sin(np.arange(500) * 0.01)}, 500)
    compiled, looped = step(free, np.zeros(2), inputs), march(free, np.zeros(2), inputs)
    for name, values in compiled.signals.items():
        np.testing.assert_array_equal(values, looped.signals[name])


def test_a_law_of_damping_is_as_good_as_the_models_own():
    """The reducer's damping taken from the model and given back as a law gives the same motion to second order."""
    without = replace(FLAT, joint=replace(FLAT.joint, damping=0.0))
    c = FLAT.joint.damping
    differences = []
    for h in (1e-4, 5e-5):
        native, lawful = machine(rig_spec(FLAT), h), machine(rig_spec(without), h)
        times = grid(0.2, h)
        push = 20.0 * np.sin(np.pi * np.clip(times / 0.01, 0.0, 1.0))
        reference = step(native, np.zeros(2), stack_inputs(native, {"hammer": push}, len(times)))
        other = step(
            lawful, np.zeros(2), stack_inputs(lawful, {"hammer": push}, len(times)),
            law=lambda t, q, qd: np.array([0.0, -c * qd[1]]),
        )  # fmt: skip
        scale = np.abs(reference.signals["arm angle"]).max()
        differences.append(np.abs(reference.signals["arm angle"] - other.signals["arm angle"]).max() / scale)
    assert differences[1] < 1e-4
    assert differences[0] / differences[1] == pytest.approx(4.0, rel=0.3)


def test_an_idle_law_and_a_true_actuation_change_nothing():
    """The hook's negative control."""
    plain = set_up(rig_spec(RIG), -0.5, H)
    hooked = set_up(
        rig_spec(RIG), -0.5, H,
        physics=Physics(law=lambda model: lambda t, q, qd: np.zeros(model.nv), actuation=lambda h: lambda t, command: command),
    )  # fmt: skip
    torque = plain.holding_torque + 0.1 * np.sin(np.arange(1000) * 0.02)
    a, b = take(plain, {"motor": torque}, 1000), take(hooked, {"motor": torque}, 1000)
    np.testing.assert_allclose(a.signals["arm angle"], b.signals["arm angle"], atol=1e-12)


def test_actuation_starts_settled():
    """A drive that loses 20 % and lags commands the torque that holds the arm, which then stays at rest."""

    def lossy(h):
        state = 0.0

        def act(t, command):
            nonlocal state
            state += h / 0.005 * (0.8 * command - state)
            return state

        return act

    setup = set_up(rig_spec(RIG), -0.5, H, physics=Physics(actuation=lossy))
    command = holding_command(setup)
    assert command == pytest.approx(setup.holding_torque / 0.8, rel=1e-6)
    trace = take(setup, {"motor": command}, 2000)
    assert np.ptp(trace.signals["arm angle"]) < 1e-7


def test_an_edit_reaches_free_and_braked_models():
    """Half the stiffness, half the resonance squared."""

    def soften(spec):
        spec.joint("reducer").stiffness[0] *= 0.5

    for braked in (False, True):
        setup = set_up(rig_spec(RIG), 0.0, H, braked=braked, physics=Physics(edit=soften))
        assert setup.machine.model.jnt_stiffness[-1] == 0.5 * RIG.joint.stiffness


def test_selfcheck_is_within_a_tenth_of_a_per_cent_and_of_a_degree():
    """The shipped step is calibrated, with a margin of five."""
    found = calibrate(RIG)
    assert found.passed
    for deviation in (found.motor, found.hammer):
        assert deviation.magnitude_error < 2e-4
        assert deviation.phase_error_deg < 0.02


def _not_centred(monkeypatch):
    monkeypatch.setattr(stepping, "centre_damping", lambda spec, timestep: None)


def _late_by_a_step(monkeypatch):
    honest = stepping.read_out
    monkeypatch.setattr(
        stepping, "read_out", lambda m, inputs, sensors: honest(m, inputs, np.roll(sensors, 1, axis=0))
    )


@pytest.mark.parametrize(
    ("perturb", "timestep"),
    [(_not_centred, 1e-4), (_late_by_a_step, 1e-4), (lambda monkeypatch: None, 1e-3)],
    ids=["damping at the half step", "read-out a step late", "step of 1 ms"],
)
def test_a_perturbed_simulator_fails_its_selfcheck(monkeypatch, perturb, timestep):
    """The detector's own control: each common mistake turns it red."""
    perturb(monkeypatch)
    assert not calibrate(RIG, timestep).passed


def test_selfcheck_prints_what_the_format_fixes(capsys):
    """{"motor": {"magnitude_error", "phase_error_deg"}, "hammer": {...}} on one line; exit 1 when red."""
    import json

    from jointscope.cli import main

    assert main(["selfcheck", "--json", "--timestep", "1e-4"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) == {"motor", "hammer"}
    assert set(printed["motor"]) == {"magnitude_error", "phase_error_deg"}
    assert main(["selfcheck", "--timestep", "5e-4"]) == 1
    assert "TOO LARGE" in capsys.readouterr().out
