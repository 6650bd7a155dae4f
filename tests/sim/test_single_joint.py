"""A simulated campaign is what the bench would record: physics, nameplate, scatter, and nothing of the truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointscope.models.joint import hammer_accelerance, load_acceleration_per_torque
from jointscope.models.paper import paper_rig
from jointscope.models.rig import rig_spec, write_mjcf
from jointscope.sim.chain import Chain, CurrentProbes, noiseless
from jointscope.sim.drive import DriveError, SpeedDrive
from jointscope.sim.excitation import Sweep, ThereAndBack
from jointscope.sim.measurement_noise import HitNoise, delayed, with_noise
from jointscope.sim.physics import Physics
from jointscope.sim.plan import HammerPlan, MotionPlan, PlanError, SingleJointPlan, SweepPlan
from jointscope.sim.pulse import Pulse, PulseError
from jointscope.sim.replay import LoggedLoop, replay
from jointscope.sim.single_joint import draw_hit, simulate_single_joint

RIG = paper_rig()
CLEAN_HITS = HammerPlan(
    hits=1, levels=(200.0,), position_scatter=0.0, gain_scatter=0.0, timing_scatter=0.0, double_hit_probability=0.0
)


def small_plan(**changes):
    plan = SingleJointPlan(
        hammer=CLEAN_HITS,
        sweep=SweepPlan(repeats=1, levels=(0.6,)),
        motion=MotionPlan(repeats=1, travels=(math.radians(120.0),)),
        chain=noiseless(),
        timestep=1e-4,
    )
    return replace(plan, **changes)


@pytest.fixture(scope="module")
def clean():
    return simulate_single_joint(RIG, small_plan(), np.random.default_rng(3))


def run_of(campaign, experiment):
    return next(run for run in campaign.runs if run.experiment == experiment)


def only(run, quantity, location=None):
    (found,) = run.select(quantity, location=location)
    return found


def spectrum(signal, frequencies):
    return np.exp(-2j * np.pi * np.outer(frequencies, signal.times)) @ signal.samples / signal.sampling_rate


def test_hit_gives_the_closed_forms_accelerance(clean):
    """Response over force, 2-100 Hz, against (19) with the IEPE's high-pass: 0.2 %."""
    run = run_of(clean, "hammer")
    f = np.arange(2.0, 100.0, 1.0)
    ratio = spectrum(only(run, "linear-acceleration"), f) / spectrum(only(run, "force"), f)
    s = 2j * np.pi * f
    leverage = RIG.hammer_radius * RIG.accelerometer_radius
    expected = hammer_accelerance(RIG.joint, s) * leverage * s / (s + 2.0 * np.pi * 0.5)
    assert np.abs(ratio / expected - 1.0).max() < 2e-3


def test_sweep_gives_the_closed_forms_response(clean):
    """Acceleration over logged torque, from two devices, 10-70 Hz against (7): 2 % with gravity and swing in it."""
    run = run_of(clean, "torque-sweep")
    f = np.arange(10.0, 70.0, 1.0)
    torque = only(run, "torque")
    ac = spectrum(only(run, "linear-acceleration"), f)
    deviation = replace(torque.channel, samples=torque.samples - torque.samples[0])
    ratio = ac / spectrum(replace(torque, channel=deviation), f)
    s = 2j * np.pi * f
    expected = load_acceleration_per_torque(RIG.joint, s) * 98.7 * RIG.accelerometer_radius * s / (s + np.pi)
    assert np.abs(ratio / expected - 1.0).max() < 0.02


def test_motion_follows_its_command(clean):
    """0 -> 120 -> 0 degrees, 246 rad/s at the motor, within the torque limit."""
    run = run_of(clean, "speed-motion")
    angle, command = only(run, "angle").samples / 141.0, only(run, "speed-command").samples
    assert np.degrees(angle.max()) == pytest.approx(120.0, abs=1.0)
    assert abs(np.degrees(angle[-1])) < 1.0
    assert command.max() == pytest.approx(246.1, abs=0.2)
    assert np.abs(only(run, "torque").samples).max() < 4.8


def test_torque_limit_saturates_the_drive():
    """With too little torque the log stops at the limit, and the integrator does not wind up."""
    plan = small_plan(hammer=None, sweep=None)
    plan = replace(plan, motion=replace(plan.motion, drive=SpeedDrive(torque_limit=0.75)))
    run = run_of(simulate_single_joint(RIG, plan, np.random.default_rng(0)), "speed-motion")
    torque = only(run, "torque").samples
    assert 0.74 < torque.max() < 0.78
    angle = np.degrees(only(run, "angle").samples[-100:] / 141.0)
    assert np.ptp(angle) < 1.0  # a speed loop keeps no position, but it has come to rest


@pytest.mark.parametrize("experiment", ["hammer", "torque-sweep", "speed-motion"])
def test_every_run_starts_at_rest(clean, experiment):
    """The first 30 ms show no motion; the log shows the holding torque."""
    run = run_of(clean, experiment)
    signal = only(run, "linear-acceleration")
    quiet = signal.samples[signal.times < 0.03]
    assert np.abs(quiet).max() < 2e-3 * np.abs(signal.samples).max()
    if experiment != "hammer":
        held = -RIG.gravity_torque(run.arm_angle) / 98.7
        assert only(run, "torque").samples[0] == pytest.approx(held, abs=1e-3)


def test_accelerometer_feels_gravity_in_slow_motion(clean):
    """Over the motion the sensor sees g cos q change, high-passed: far more than r q'' at these speeds."""
    run = run_of(clean, "speed-motion")
    acceleration = only(run, "linear-acceleration").samples
    flat = simulate_single_joint(
        replace(RIG, gravity=0.0), small_plan(hammer=None, sweep=None), np.random.default_rng(3)
    )
    without = only(run_of(flat, "speed-motion"), "linear-acceleration").samples
    assert np.std(acceleration - without) > 0.5


def test_seed_decides_everything():
    """Same seed, same bits; another seed, other hits; a run does not depend on the runs before it."""
    plan = small_plan(
        hammer=HammerPlan(hits=2, levels=(100.0,), duration=0.5), sweep=None, motion=None, chain=Chain()
    )
    a, b, c = (simulate_single_joint(RIG, plan, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(only(a.runs[0], "force").samples, only(b.runs[0], "force").samples)
    assert not np.array_equal(only(a.runs[0], "force").samples, only(c.runs[0], "force").samples)


def test_nameplate_holds_the_exact_items_and_no_truth():
    """n, J_m, J_s, mass, radius, eta are the rig's; another K, c, J_L, b_m, b_l leaves it as it was."""
    plan = small_plan(hammer=replace(CLEAN_HITS, duration=0.2), sweep=None, motion=None)
    other = replace(
        RIG,
        joint=replace(
            RIG.joint, stiffness=1.5e5, damping=40.0, load_inertia=3.4, motor_damping=3.0, load_damping=1.0
        ),
    )
    here, there = (simulate_single_joint(rig, plan, np.random.default_rng(0)) for rig in (RIG, other))
    assert here.rig == there.rig
    assert here.rig.reduction_ratio == RIG.joint.reduction_ratio
    assert (here.title, here.notes) == (there.title, there.notes)
    assert here.rig.stiffness_reference != RIG.joint.stiffness


def test_currents_are_recorded_with_what_reads_them():
    """Three phases at 10 kHz, and the torque constant and pole pairs on the nameplate."""
    plan = small_plan(
        hammer=None, motion=None, sweep=SweepPlan(repeats=1, levels=(0.6,), sweep_time=0.5, trail=0.1),
        chain=replace(noiseless(), currents=CurrentProbes()),
    )  # fmt: skip
    campaign = simulate_single_joint(RIG, plan, np.random.default_rng(0))
    phases = campaign.runs[0].select("phase-current")
    assert [signal.channel.column for signal in phases] == ["i_u", "i_v", "i_w"]
    assert phases[0].sampling_rate == 10_000.0
    assert campaign.rig.torque_constant == 0.458 and campaign.rig.pole_pairs == 5
    total = np.sum([signal.samples for signal in phases], axis=0)
    assert np.abs(total).max() < 0.05


def test_hits_scatter_as_planned():
    """Level and contact time scatter about the plan; rebounds come at their probability; the force is only ever a push."""
    rng = np.random.default_rng(0)
    hammer = HammerPlan(double_hit_probability=0.3)
    hits = [draw_hit(hammer, 200.0, rng) for _ in range(2000)]
    assert np.std(np.log([hit[0].peak for hit in hits])) == pytest.approx(0.15, rel=0.1)
    assert np.mean([len(hit) == 2 for hit in hits]) == pytest.approx(0.3, abs=0.04)
    times = np.linspace(0.0, 0.4, 4001)
    assert min(pulse.force(times).min() for hit in hits[:20] for pulse in hit) == 0.0


def test_pulse_is_a_push_of_its_peak_and_length():
    """Zero outside contact, the peak in its middle, symmetric."""
    pulse = Pulse(start=0.01, contact_time=0.004, peak=100.0)
    force = pulse.force(np.array([0.009, 0.01, 0.011, 0.012, 0.013, 0.014, 0.02]))
    assert force[3] == pytest.approx(100.0) and force[2] == pytest.approx(force[4])
    assert np.all(force[[0, 1, 6]] == 0.0) and abs(force[5]) < 1e-9
    with pytest.raises(PulseError, match="contact_time"):
        Pulse(start=0.0, contact_time=0.0, peak=1.0)


def test_sweep_crosses_its_band_and_fades():
    """Instantaneous frequency runs from first to last; nothing outside its time."""
    sweep = Sweep(start=0.5, duration=3.0, first_frequency=4.0, last_frequency=80.0, amplitude=1.0)
    times = np.arange(0.0, 4.0, 1e-4)
    torque = sweep.torque(times)
    assert np.all(torque[(times <= 0.5) | (times >= 3.5)] == 0.0)
    crossings = times[1:][np.diff(np.signbit(torque).astype(int)) != 0]
    crossings = crossings[(crossings > 0.7) & (crossings < 3.3)]
    measured = 0.5 / np.diff(crossings)
    expected = 4.0 + 76.0 / 3.0 * (0.5 * (crossings[1:] + crossings[:-1]) - 0.5)
    np.testing.assert_allclose(measured, expected, rtol=0.02)


def test_triangle_goes_there_and_back():
    """Speed integrates to the travel at half time and to nothing at the end; its peak is travel over a quarter."""
    path = ThereAndBack(start=0.1, duration=4.8, travel=2.0)
    times = np.arange(0.0, 5.2, 1e-3)
    angle = np.cumsum([path.speed(t) for t in times]) * 1e-3
    assert angle[np.searchsorted(times, 2.5)] == pytest.approx(2.0, rel=1e-3)
    assert abs(angle[-1]) < 1e-6
    assert path.peak_speed == pytest.approx(2.0 / 1.2)


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: SingleJointPlan(hammer=None, sweep=None, motion=None), PlanError),
        (lambda: SingleJointPlan(hammer=HammerPlan(hits=0)), PlanError),
        (lambda: SingleJointPlan(timestep=0.1), PlanError),
        (lambda: SpeedDrive(torque_limit=0.0), DriveError),
    ],
)
def test_impossible_plans_are_refused(make, error):
    """One line that names what is wrong."""
    with pytest.raises(error):
        make()


def test_replay_of_the_true_model_returns_the_recording(clean, tmp_path):
    """Inputs run through the rig's own file give the recorded outputs: hit, sweep and closed-loop motion."""
    path = write_mjcf(rig_spec(RIG), tmp_path / "rig.xml")
    drive = SpeedDrive()
    loop = LoggedLoop(proportional=drive.proportional, integral=drive.integral, torque_limit=drive.torque_limit)
    again = replay(clean, path, loop=loop, timestep=1e-4)
    for before, after in zip(clean.runs, again.runs, strict=True):
        for recorded, simulated in zip(before.signals, after.signals, strict=True):
            error = np.sqrt(np.mean((recorded.samples - simulated.samples) ** 2)) / np.std(recorded.samples)
            assert error < (1e-9 if recorded.channel.role == "input" else 2e-3), (
                before.id,
                recorded.channel.column,
            )


def test_replay_of_a_wrong_model_does_not(clean, tmp_path):
    """Ten per cent less stiffness is seen at once."""
    soft = replace(RIG, joint=replace(RIG.joint, stiffness=0.9 * RIG.joint.stiffness))
    hits = replace(clean, runs=(run_of(clean, "hammer"),))
    again = replay(hits, write_mjcf(rig_spec(soft), tmp_path / "soft.xml"), timestep=1e-4)
    recorded, simulated = (only(c.runs[0], "linear-acceleration").samples for c in (hits, again))
    assert np.std(recorded - simulated) > 0.3 * np.std(recorded)


def test_replay_reads_any_radius(clean):
    """A channel at half the radius reads half the tangential acceleration."""
    run = run_of(clean, "hammer")
    (stream,) = run.streams
    force, acceleration = stream.channels
    half = replace(acceleration, radius=0.5 * RIG.accelerometer_radius)
    halved = replace(run, streams=(replace(stream, channels=(force, half)),))
    both = replay(replace(clean, runs=(run, halved)), rig_spec(RIG), timestep=1e-4)
    whole, part = (only(r, "linear-acceleration").samples for r in both.runs)
    np.testing.assert_allclose(part, 0.5 * whole, atol=1e-6 * np.abs(whole).max())


def test_effects_enter_through_the_hook_alone(clean):
    """A law per take changes the recording; the same take without it is the base to the last bit."""
    plan = small_plan(sweep=None, motion=None)
    base = simulate_single_joint(RIG, plan, np.random.default_rng(3), physics=lambda take: Physics())
    assert np.array_equal(
        only(base.runs[0], "linear-acceleration").samples, only(clean.runs[0], "linear-acceleration").samples
    )
    cubic = Physics(law=lambda model: lambda t, q, qd: -2e11 * q**3)
    hard = simulate_single_joint(RIG, plan, np.random.default_rng(3), physics=lambda take: cubic)
    difference = (
        only(hard.runs[0], "linear-acceleration").samples - only(base.runs[0], "linear-acceleration").samples
    )
    assert np.std(difference) > 0.05 * np.std(only(base.runs[0], "linear-acceleration").samples)


def test_noise_is_of_the_stated_size_and_only_on_hits(clean):
    """Shares of each channel's peak; other runs are handed through."""
    noisy = with_noise(clean, HitNoise(acceleration=0.01, force=0.005), np.random.default_rng(0))
    for quantity, share in (("linear-acceleration", 0.01), ("force", 0.005)):
        before, after = (only(run_of(c, "hammer"), quantity).samples for c in (clean, noisy))
        assert np.std(after - before) == pytest.approx(share * np.abs(before).max(), rel=0.05)
    assert run_of(noisy, "torque-sweep") is run_of(clean, "torque-sweep")


def test_delay_moves_a_pulse_without_changing_it():
    """A band-limited pulse, delayed by 0.3 samples, is the pulse at shifted times."""
    t = np.arange(512) / 1024.0
    pulse = lambda at: np.exp(-(((at - 0.2) / 0.01) ** 2))  # noqa: E731
    np.testing.assert_allclose(delayed(pulse(t), 3e-4, 1024.0), pulse(t - 3e-4), atol=1e-9)
