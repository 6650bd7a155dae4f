"""Channels held against each other: planted mistakes are named before any fit, clean recordings are left alone."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from jointscope.identification.quality import findings
from jointscope.models.joint import torsion_frequency
from jointscope.models.parameters import STANDARD_GRAVITY, Joint
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

JOINT = Joint(
    stiffness=193_600.0, damping=60.0, load_inertia=3.02, motor_inertia=2.1e-4, reducer_inertia=2.48e-4,
    reduction_ratio=141.0, motor_damping=2.0, load_damping=2.0, efficiency=0.7,
)  # fmt: skip
RIG = Nameplate(
    topology="two-inertia", motion="rotational", plane="vertical", reduction_ratio=141.0, motor_inertia=2.1e-4,
    reducer_inertia=2.48e-4, efficiency=0.7, arm_mass=12.0, arm_com_radius=0.5,
)  # fmt: skip
MGR = 12.0 * STANDARD_GRAVITY * 0.5
RADIUS, FINE = 0.95, 20_000.0


def leapt(torque, hammer, angle, braked):
    """q, q'', q_s, q_s' of the two-inertia joint about ``angle``, by semi-implicit Euler at ``FINE`` [Hz]."""
    h, J_M, J_L = 1.0 / FINE, JOINT.reflected_inertia, JOINT.load_inertia
    K, c, b_m, b_l = JOINT.stiffness, JOINT.damping, JOINT.motor_damping, JOINT.load_damping
    q = angle
    q_s = angle + (MGR * math.cos(angle)) / K
    v = w = 0.0
    hold = MGR * math.cos(angle)
    out = np.empty((torque.size, 4))
    for k in range(torque.size):
        spring = K * (q_s - q) + c * (w - v)
        a = (spring + hammer[k] - MGR * math.cos(q) - b_l * v) / J_L
        s = 0.0 if braked else (torque[k] + hold - spring - b_m * w) / J_M
        v, w = v + h * a, w + h * s
        q, q_s = q + h * v, q_s + h * w
        out[k] = q, a, q_s, w
    return out.T


def stream(rate, *channels):
    return Stream(file="x.csv", sampling_rate=rate, length=channels[0].samples.size, channels=channels)


def sweep_run(rng, angle=-math.pi / 3, accelerometer="ac"):
    t = np.arange(round(3.0 * FINE)) / FINE
    drive = np.where(t < 0.2, 0.0, 60.0 * chirp(t - 0.2, 4.0, 2.8, 60.0, phi=-90.0))
    q, a, q_s, w = leapt(drive, np.zeros(t.size), angle, braked=False)
    felt = RADIUS * a + STANDARD_GRAVITY * np.cos(q)
    if accelerometer == "ac":
        k = 1.0 - 2 * math.pi * 0.5 / FINE
        felt = lfilter([1.0, -1.0], [1.0, -k], felt - felt[0])
    daq, plc = slice(None, None, 20), slice(None, None, 40)
    torque = (drive + MGR * math.cos(angle)) / (0.7 * 141.0)
    sensor = {"coupling": "ac", "low_cutoff": 0.5} if accelerometer == "ac" else {}
    acc = felt[daq] + 0.02 * rng.standard_normal(felt[daq].size)
    tq = torque[plc] + 1e-3 * rng.standard_normal(torque[plc].size)
    return Run(id="sweep", experiment="torque-sweep", arm_angle=angle, streams=(
        stream(1000.0, Channel(column="acc", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output",
                               radius=RADIUS, samples=acc, **sensor)),
        stream(500.0,
               Channel(column="torque", quantity="torque", unit="N m", location="motor", role="input", samples=tq),
               Channel(column="motor", quantity="angle", unit="rad", location="motor", role="output", samples=141.0 * q_s[plc]),
               Channel(column="speed", quantity="angular-velocity", unit="rad/s", location="motor", role="output",
                       samples=141.0 * w[plc]),
               Channel(column="arm", quantity="angle", unit="rad", location="arm", role="output", samples=q[plc])),
    ))  # fmt: skip


def hammer_run(rng, number, angle=0.0):
    t = np.arange(round(2.0 * FINE)) / FINE
    phase = (t - 0.1) / 0.007
    push = np.where((phase > 0) & (phase < 1), 150.0 * np.sin(np.pi * np.clip(phase, 0, 1)), 0.0)
    _, a, _, _ = leapt(np.zeros(t.size), 0.8 * push, angle, braked=True)
    part = slice(None, None, 10)
    force = push[part] + 0.1 * rng.standard_normal(t[part].size)
    acc = RADIUS * a[part] + 0.02 * rng.standard_normal(t[part].size)
    return Run(id=f"hit-{number}", experiment="hammer", brake=True, arm_angle=angle, repeat_of="hit", streams=(
        stream(2000.0,
               Channel(column="f", quantity="force", unit="N", location="arm", role="input", radius=0.8, samples=force),
               Channel(column="a", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output",
                       radius=RADIUS, samples=acc, coupling="ac", low_cutoff=0.5)),
    ))  # fmt: skip


@pytest.fixture(scope="module")
def bench():
    rng = np.random.default_rng(7)
    runs = (sweep_run(rng), *(hammer_run(rng, k) for k in range(3)))
    return Campaign(path=Path("."), rig=RIG, runs=runs)


@pytest.fixture(scope="module")
def sensing():
    """A sweep with a dc accelerometer, which feels gravity."""
    rng = np.random.default_rng(8)
    return Campaign(path=Path("."), rig=RIG, runs=(sweep_run(rng, accelerometer="dc"),))


def with_channel(campaign, column, change):
    """The campaign with ``change`` applied to a channel wherever it occurs."""

    def changed(run):
        return replace(
            run,
            streams=tuple(
                replace(s, channels=tuple(change(c) if c.column == column else c for c in s.channels))
                for s in run.streams
            ),
        )

    return replace(campaign, runs=tuple(map(changed, campaign.runs)))


def scaled(campaign, column, factor):
    return with_channel(campaign, column, lambda c: replace(c, samples=c.samples * factor))


def named(campaign):
    return {(f.finding, f.channel) for f in findings(campaign)}


def test_the_bench_of_these_tests_is_the_joint_it_claims_to_be():
    assert torsion_frequency(JOINT) / (2 * math.pi) == pytest.approx(46.5, abs=0.5)


def test_a_clean_campaign_has_no_findings(bench, sensing):
    """Negative control of everything below."""
    assert findings(bench) == []
    assert findings(sensing) == []


@pytest.mark.parametrize(
    ("column", "factor", "name", "words"),
    [
        ("torque", 1000.0 / 1.3, "suspicious-unit", ["permille", "rated_torque = 1.3"]),
        ("torque", 1000.0 / 0.64, "suspicious-unit", ["permille", "rated_torque = 0.64"]),
        ("torque", 141.0, "suspicious-unit", ['side = "output"']),
        ("torque", -1.0, "inverted-polarity", ["scale = -1.0"]),
        ("motor", 180.0 / math.pi, "suspicious-unit", ['unit = "deg"']),
        ("motor", -1.0, "inverted-polarity", ["scale = -1.0"]),
        ("motor", 1.0 / 141.0, "suspicious-unit", ["scale = 141.0"]),
        ("arm", 180.0 / math.pi, "suspicious-unit", ['unit = "deg"']),
        ("arm", -1.0, "inverted-polarity", ["scale = -1.0"]),
        ("speed", 60.0 / (2.0 * math.pi), "suspicious-unit", ['unit = "rpm"']),
        ("speed", 1.0 / (2.0 * math.pi), "suspicious-unit", ["scale = 6.28318"]),
        ("acc", -1.0, "inverted-polarity", ["scale = -1.0"]),
        ("acc", 1.0 / STANDARD_GRAVITY, "suspicious-unit", ['unit = "g_n"']),
        ("a", -1.0, "inverted-polarity", ["scale = -1.0"]),
        ("a", 1.0 / STANDARD_GRAVITY, "suspicious-unit", ['unit = "g_n"']),
        ("f", -1.0, "inverted-polarity", ["scale = -1.0"]),
        ("f", 1.0 / 4.4482216152605, "suspicious-unit", ['unit = "lbf"']),
    ],
)
def test_one_planted_mistake_is_the_one_finding(bench, column, factor, name, words):
    found = findings(scaled(bench, column, factor))
    assert {(f.finding, f.channel) for f in found} == {(name, column)}
    for word in words:
        assert word in found[0].toml


@pytest.mark.parametrize("factor", [1.0 / math.sqrt(2.0), 2.0 / 3.0])
def test_amplitude_conventions_of_a_current_are_seen_where_the_inertia_is_known(bench, factor):
    known = replace(bench, rig=replace(RIG, torque_constant=0.458, inertia_reference=3.1), runs=bench.runs[:1])
    amperes = with_channel(
        known, "torque", lambda c: replace(c, quantity="current", unit="A", samples=c.samples / 0.458)
    )
    assert findings(amperes) == []
    found = findings(scaled(amperes, "torque", factor))
    assert {(f.finding, f.channel) for f in found} == {("suspicious-unit", "torque")}
    assert ('per = "rms"' in found[0].toml) == (factor > 0.7)


def test_pasting_the_corrected_line_leaves_no_finding(bench):
    """The line that inspect prints mends what it found."""
    import tomllib

    broken = scaled(bench, "arm", 180.0 / math.pi)
    line = tomllib.loads(f"c = {findings(broken)[0].toml}")["c"]
    mended = with_channel(
        broken, "arm", lambda c: replace(c, unit=line["unit"], samples=c.samples * math.pi / 180.0)
    )
    assert findings(mended) == []


def test_two_mistakes_at_once_are_both_named(bench):
    broken = scaled(scaled(bench, "arm", -1.0), "torque", 1000.0 / 1.3)
    assert named(broken) == {("inverted-polarity", "arm"), ("suspicious-unit", "torque")}


@pytest.mark.parametrize("gain", [0.85, 1.15])
def test_a_gain_that_is_merely_off_is_left_to_the_diagnosis(bench, gain):
    assert findings(scaled(bench, "torque", gain)) == []


def test_the_arm_angle_in_degrees(bench):
    runs = (replace(bench.runs[0], arm_angle=-60.0),)
    found = findings(replace(bench, runs=runs))
    assert [(f.finding, f.channel, f.toml) for f in found] == [("suspicious-unit", "", "arm_angle = -1.0472")]


def test_gravity_on_a_dc_sensor(sensing):
    assert named(scaled(sensing, "acc", -1.0)) == {("inverted-polarity", "acc")}
    lifted = with_channel(sensing, "acc", lambda c: replace(c, samples=c.samples + 0.8))
    assert named(lifted) == {("gravity-mismatch", "acc")}
    deaf = with_channel(sensing, "acc", lambda c: replace(c, samples=c.samples - np.mean(c.samples[:100])))
    found = findings(deaf)
    assert {(f.finding, f.channel) for f in found} == {("gravity-mismatch", "acc")}
    assert "coupling = 'ac'" in found[0].detail


@pytest.mark.parametrize("late", [-0.006, 0.004])
def test_a_late_device_is_named_with_its_delay(bench, late):
    run = bench.runs[0]
    streams = (replace(run.streams[0], start=late), run.streams[1])
    found = findings(replace(bench, runs=(replace(run, streams=streams),)))
    assert [f.finding for f in found] == ["clock-skew"]
    assert f"{abs(1e3 * late):.0f}" in f"{float(found[0].detail.split()[0]):.0f}"


@pytest.mark.parametrize("late", [0.0, 0.006])
def test_what_an_ac_coupled_slide_leads_is_no_skew(late):
    rate, corner = 2000.0, 0.5
    t = np.arange(round(6.0 * rate)) / rate
    force = chirp(t, 2.0, 6.0, 40.0)
    x = np.cumsum(np.cumsum(force - force.mean())) / rate**2 / 8.0
    x -= np.polyval(np.polyfit(t, x, 1), t)
    k = 1.0 - 2 * math.pi * corner / rate
    felt = lfilter([1.0, -1.0], [1.0, -k], np.gradient(np.gradient(x, t), t))
    drive = Channel(column="f", quantity="force", unit="N", location="motor", role="input", samples=force)
    place = Channel(column="x", quantity="position", unit="m", location="load", role="output", samples=x)
    sensor = Channel(
        column="a", quantity="acceleration", unit="m/s^2", location="load", role="output", coupling="ac",
        low_cutoff=corner, samples=felt,
    )  # fmt: skip
    streams = (replace(stream(rate, sensor), start=late), stream(rate, drive, place))
    rig = Nameplate(topology="two-inertia", motion="translational", plane="horizontal", motor_inertia=4.0)
    run = Run(id="r", experiment="torque-sweep", streams=streams, brake=False)
    found = [f for f in findings(Campaign(path=Path("."), rig=rig, runs=(run,))) if f.finding == "clock-skew"]
    assert [f.channel for f in found] == (["a"] if late else [])


def test_a_start_that_is_said_to_be_unknown_is_no_skew(bench):
    run = bench.runs[0]
    streams = (replace(run.streams[0], start=0.004, start_uncertainty=math.inf), run.streams[1])
    assert findings(replace(bench, runs=(replace(run, streams=streams),))) == []


def test_a_shared_sync_signal_shows_the_skew_of_two_clocks(rng):
    wave = np.cumsum(rng.standard_normal(2000))
    channel = Channel(column="s1", quantity="voltage", unit="V", location="motor", role="input", samples=wave)
    one = replace(stream(1000.0, channel), sync="s1")
    other = replace(stream(1000.0, replace(channel, column="s2")), sync="s2")
    run = Run(id="r", experiment="free", streams=(one, other), brake=True)
    campaign = Campaign(path=Path("."), rig=RIG, runs=(run,))
    assert findings(campaign) == []
    skewed = replace(campaign, runs=(replace(run, streams=(one, replace(other, start=0.02))),))
    (found,) = findings(skewed)
    assert found.finding == "clock-skew"
    assert float(found.toml.removeprefix("start = ")) == pytest.approx(0.0, abs=1e-4)


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def test_hits_that_do_not_repeat_have_low_coherence(bench, rng):
    runs = bench.runs[1:]

    def noisy(run, k):
        filtered = lfilter([0.05], [1.0, -1.6, 0.95], rng.standard_normal(4000)) * 40.0
        rough = with_channel(
            replace(bench, runs=(run,)),
            "a",
            lambda c: replace(c, samples=c.samples + filtered * (k > 0) + filtered),
        )
        return rough.runs[0]

    broken = replace(bench, runs=tuple(noisy(run, k) for k, run in enumerate(runs)))
    assert ("low-coherence", "a") in named(broken)
    assert ("low-coherence", "a") not in named(replace(bench, runs=runs))


def test_an_arm_gets_the_findings_of_single_channels_only(bench):
    arm = replace(scaled(bench, "a", -1.0), rig=replace(RIG, topology="arm"))
    assert findings(arm) == []


def test_names_and_order_change_nothing(bench):
    broken = scaled(bench, "acc", -1.0)
    renamed = replace(
        broken,
        runs=tuple(
            replace(
                run, id=f"x{k}",
                streams=tuple(
                    replace(s, channels=tuple(replace(c, column=c.column[::-1]) for c in reversed(s.channels)))
                    for s in reversed(run.streams)
                ),
            )
            for k, run in enumerate(broken.runs)
        ),
    )  # fmt: skip
    assert {(f.finding, f.channel[::-1]) for f in findings(renamed)} == named(broken)


def spinning(turns, arm_scale=1.0, motor_scale=1.0):
    """A plant of disks that its motor turns ``turns`` times, an encoder on either side of the shaft."""
    rate = 500.0
    t = np.arange(round(8.0 * rate)) / rate
    q = 2.0 * math.pi * turns * 0.5 * (1.0 - np.cos(2.0 * math.pi * t / 8.0))
    acceleration = np.gradient(np.gradient(q, t), t)
    J = 9.0 + 3.02
    rig = replace(RIG, plane="horizontal", arm_mass=None, arm_com_radius=None)
    run = Run(id="turn", experiment="speed-motion", streams=(
        stream(rate,
               Channel(column="torque", quantity="torque", unit="N m", location="motor", role="input",
                       samples=(J * acceleration + 4.0 * np.gradient(q, t)) / (0.7 * 141.0)),
               Channel(column="motor", quantity="angle", unit="rad", location="motor", role="output",
                       samples=motor_scale * 141.0 * q),
               Channel(column="arm", quantity="angle", unit="rad", location="arm", role="output", samples=arm_scale * q)),
    ))  # fmt: skip
    return Campaign(path=Path("."), rig=rig, runs=(run,))


def test_a_shaft_may_spin_that_its_motor_turns_as_far():
    assert not [f for f in findings(spinning(3.0)) if f.finding == "suspicious-unit"]
    (wrong,) = [f for f in findings(spinning(0.5, arm_scale=180.0 / math.pi)) if f.finding == "suspicious-unit"]
    assert wrong.channel == "arm" and '"deg"' in (wrong.toml or "")
    degrees = 180.0 / math.pi
    both = findings(spinning(0.5, arm_scale=degrees, motor_scale=degrees))
    assert any(f.channel == "arm" and '"deg"' in (f.toml or "") for f in both)


def test_a_body_that_friction_holds_is_not_upside_down():
    """It follows the force like a spring: as an inertia that would be negative, but the force does work on it."""
    rate = 500.0
    t = np.arange(round(8.0 * rate)) / rate
    force = 3.0 * np.sin(math.pi * t) + 1.0 * np.sin(2.6 * math.pi * t)
    held = 1e-4 * np.sin(math.pi * t - 0.4) + 3e-5 * np.sin(2.6 * math.pi * t - 0.4)
    rig = Nameplate(topology="single-dof", motion="translational", plane="horizontal")

    def campaign(sign):
        run = Run(id="held", experiment="torque-sweep", streams=(
            stream(rate,
                   Channel(column="F", quantity="force", unit="N", location="load", role="input", samples=force),
                   Channel(column="x", quantity="position", unit="m", location="load", role="output", samples=sign * held)),
        ))  # fmt: skip
        return Campaign(path=Path("."), rig=rig, runs=(run,))

    assert not [f for f in findings(campaign(1.0)) if f.finding == "inverted-polarity"]


@pytest.mark.parametrize("spread", [1.0, 2.5])
def test_a_wrong_unit_is_off_by_the_same_factor_in_every_run(bench, spread):
    """What lies beyond a bend answers a hit like a lighter arm, and each hit a little else: no unit is as fickle."""
    scales = dict(zip(("hit-0", "hit-1", "hit-2"), (1.0, spread**0.5, spread), strict=True))

    def off(run):
        factor = STANDARD_GRAVITY * scales.get(run.id, 1.0)
        streams = tuple(
            replace(
                s,
                channels=tuple(
                    replace(c, samples=c.samples * factor) if c.column == "a" else c for c in s.channels
                ),
            )
            for s in run.streams
        )
        return replace(run, streams=streams)

    runs = tuple(off(run) for run in bench.runs if run.experiment == "hammer")
    rig = replace(RIG, inertia_reference=3.02)
    said = [f for f in findings(replace(bench, rig=rig, runs=runs)) if f.finding == "suspicious-unit"]
    assert len(said) == (3 if spread == 1.0 else 0)


def test_no_motion_is_mistaken_by_the_square_root_of_two(bench):
    wrong = with_channel(bench, "arm", lambda c: replace(c, samples=c.samples * math.sqrt(2.0)))
    assert not any(f.channel == "arm" and "sqrt" in f.detail for f in findings(wrong))
