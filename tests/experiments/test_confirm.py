"""confirm: MuJoCo gains what a reduced model gains when the effect is the right one, says no when it is not, and needs
nothing of the diagnosis but its folder."""

import json
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from jointscope.cli import main
from jointscope.errors import InputError, RefusedError
from jointscope.experiments.confirm import TIMESTEP, _check, confirm, step_for
from jointscope.models.effects import augment, write_augmented
from jointscope.models.paper import paper_rig
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Channel, Run, Signal, Stream
from jointscope.recordings.reader import read_campaign
from jointscope.recordings.writer import write_campaign
from jointscope.sim.effects import loop_of, physics_of
from jointscope.sim.physics import Physics
from jointscope.sim.plan import HammerPlan, MotionPlan, SingleJointPlan, SweepPlan
from jointscope.sim.replay import replay_run
from jointscope.sim.single_joint import simulate_single_joint

RIG = paper_rig()
CUBIC = 3e10  # N m/rad^3
HITS = SingleJointPlan(
    hammer=HammerPlan(hits=2, levels=(250.0, 450.0), double_hit_probability=0.0),
    sweep=None,
    motion=None,
    timestep=1e-4,
)
BLOCKED = """
import sys
class Block:
    def find_spec(self, name, path=None, target=None):
        if name.startswith("jointscope.diagnosis"):
            raise ImportError(name + " is blocked")
sys.meta_path.insert(0, Block())
from jointscope.cli import main
sys.exit(main(sys.argv[1:]))
"""


def base_parameters():
    joint = RIG.joint
    return {
        "stiffness": joint.stiffness, "damping": joint.damping, "load_inertia": joint.load_inertia,
        "motor_inertia": joint.reflected_inertia, "motor_damping": joint.motor_damping,
        "load_damping": joint.load_damping, "gravity_moment": -RIG.gravity_torque(0.0), "efficiency": joint.efficiency,
        "torque_scale": 1.0, "torque_offset": 0.0, "torque_age": 0.0, "drive_gain": 0.0, "drive_integral": 0.0,
    }  # fmt: skip


def model(effects):
    plate = {"topology": "two-inertia", "motion": "rotational", "plane": "vertical", "reduction_ratio": 141.0}
    return {"kind": "diagnosis", "rig": plate, "base": base_parameters(), "effects": effects}


def cubic(value=CUBIC):
    return {
        "effect": "stiffness-nonlinearity", "location": "transmission", "variant": "cubic", "parameters": {"cubic": value}
    }  # fmt: skip


COULOMB = {
    "effect": "coulomb-friction", "location": "load", "variant": "plain", "parameters": {"torque": 3.0}
}  # fmt: skip


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Hits on a hardening joint, noise, scatter and all, as files."""

    def harden(spec):
        spec.joint("reducer").stiffness[2] = CUBIC

    path = tmp_path_factory.mktemp("bench") / "campaign"
    write_campaign(
        simulate_single_joint(RIG, HITS, np.random.default_rng(4), physics=lambda take: Physics(edit=harden)), path
    )
    return path


def reduced_errors(campaign, runs, k3):
    """Errors of a Runge-Kutta model of the braked arm that shares nothing with MuJoCo."""
    b, errors = base_parameters(), []
    for run in campaign.runs:
        if run.id not in runs:
            continue
        (force,), (acceleration,) = run.select("force"), run.select("linear-acceleration")
        h, n = 1.0 / (8.0 * force.sampling_rate), 8 * force.samples.size
        F = bandlimited(force.samples, force.sampling_rate)(np.arange(2 * n + 1) * 0.5 * h) * force.channel.radius
        c = b["damping"] + b["load_damping"]
        x0 = -b["gravity_moment"] / b["stiffness"]

        def rate(x, v, f, c=c, x0=x0):
            y = x0 + x
            return (f - c * v - b["stiffness"] * x - k3 * (y**3 - x0**3)) / b["load_inertia"]

        x = v = 0.0
        a = np.empty(n)
        for k in range(n):
            f0, f1, f2 = F[2 * k], F[2 * k + 1], F[2 * k + 2]
            a[k] = a1 = rate(x, v, f0)
            v2, a2 = v + 0.5 * h * a1, rate(x + 0.5 * h * v, v + 0.5 * h * a1, f1)
            v3, a3 = v + 0.5 * h * a2, rate(x + 0.5 * h * v2, v + 0.5 * h * a2, f1)
            v4, a4 = v + h * a3, rate(x + h * v3, v + h * a3, f2)
            x += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        high_pass = butter(1, acceleration.channel.low_cutoff, "highpass", fs=1.0 / h)
        predicted = lfilter(*high_pass, a * acceleration.channel.radius)[::8]
        y = acceleration.samples
        errors.append(float(np.sqrt(np.mean((y - predicted) ** 2) / np.mean(y**2))))
    return float(np.mean(errors))


@pytest.fixture
def diagnosed(recorded, tmp_path):
    """A folder as diagnose leaves it, its claims made by the Runge-Kutta model."""
    campaign = read_campaign(recorded)
    runs = [run.id for run in campaign.runs][1::2]
    answer = {
        "format": "jointscope-diagnosis/1",
        "verdict": "effects",
        "effects": [{"effect": "stiffness-nonlinearity", "location": "transmission"}],
        "held_out": {
            "runs": runs,
            "base_error": reduced_errors(campaign, runs, 0.0),
            "augmented_error": reduced_errors(campaign, runs, CUBIC),
        },
        "campaign": str(recorded),
    }
    (tmp_path / "diagnosis.json").write_text(json.dumps(answer))
    write_augmented(model([cubic()]), tmp_path)
    return tmp_path


def test_the_right_effect_gains_in_mujoco_what_the_reduced_model_claims(diagnosed):
    found = confirm(diagnosed)
    assert found.confirmed and found.ratio == pytest.approx(1.0, abs=0.02)
    assert found.base_error > 5.0 * found.augmented_error
    assert found.base_error == pytest.approx(found.reduced_base_error, rel=0.01)
    assert {check.run for check in found.checks} == set(
        json.loads((diagnosed / "diagnosis.json").read_text())["held_out"]["runs"]
    )


def test_a_fast_mode_is_stepped_finely_enough():
    """In proportion above 100 Hz; what an instrument does is no motion of MuJoCo's."""

    def named(location, **hertz):
        return {
            "effect": "e",
            "location": location,
            "parameters": {k: {"value": f, "unit": "Hz"} for k, f in hertz.items()},
        }

    assert step_for([{"effect": "stiffness-nonlinearity", "location": "transmission"}]) == TIMESTEP
    assert step_for([named("load", frequency=60.0)]) == TIMESTEP
    assert step_for([named("load", frequency=20.0, frequency_2=400.0)]) == pytest.approx(0.25 * TIMESTEP)
    assert step_for([named("acquisition", frequency=2000.0)]) == TIMESTEP


@pytest.mark.parametrize(
    "wrong", [[cubic(1.5 * CUBIC)], [cubic(0.7 * CUBIC)], [cubic(-CUBIC)], [COULOMB], [], [cubic(), COULOMB]],
    ids=["too large", "too small", "wrong sign", "another effect", "none", "one too many"],
)  # fmt: skip
def test_a_wrong_effect_fails(diagnosed, wrong):
    write_augmented(model(wrong), diagnosed)
    found = confirm(diagnosed)
    assert not found.confirmed


def test_an_inverted_accelerometer_changes_nothing(diagnosed, recorded, tmp_path):
    campaign = read_campaign(recorded)
    flipped = replace(
        campaign,
        runs=tuple(
            replace(run, streams=tuple(
                replace(stream, channels=tuple(
                    replace(c, samples=-c.samples) if c.quantity == "linear-acceleration" else c for c in stream.channels
                )) for stream in run.streams
            )) for run in campaign.runs
        ),
    )  # fmt: skip
    write_campaign(flipped, tmp_path / "flipped")
    found = confirm(diagnosed, campaign=tmp_path / "flipped")
    assert found.ratio == pytest.approx(confirm(diagnosed).ratio, rel=1e-3)


def test_the_command_runs_without_the_diagnosis_and_says_no_by_its_exit_code(diagnosed):
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, "confirm", str(diagnosed)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "confirmed" in done.stdout and "NOT" not in done.stdout
    written = json.loads((diagnosed / "confirm.json").read_text())
    assert written["confirmed"] and written["format"] == "jointscope-confirm/1"
    assert 0.9 <= written["gain_ratio"] <= 1.1 and len(written["channels"]) == 2
    assert (diagnosed / "confirm.png").stat().st_size > 20_000
    write_augmented(model([cubic(2.0 * CUBIC)]), diagnosed)
    assert main(["confirm", str(diagnosed), "--no-picture", "--json"]) == 1
    assert not json.loads((diagnosed / "confirm.json").read_text())["confirmed"]


def change(directory, **entries):
    path = directory / "diagnosis.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **entries}))


def test_nothing_to_confirm_is_refused_in_one_line(diagnosed, tmp_path):
    change(diagnosed, effects=[], verdict="none")
    with pytest.raises(RefusedError, match="no effect was named"):
        confirm(diagnosed)
    change(diagnosed, effects=[{"effect": "backlash", "location": "transmission"}], held_out=None)
    with pytest.raises(RefusedError, match="no run was kept back"):
        confirm(diagnosed)
    change(diagnosed, held_out={"runs": ["elsewhere"], "base_error": 0.4, "augmented_error": 0.1})
    with pytest.raises(InputError, match="'elsewhere'"):
        confirm(diagnosed)
    change(diagnosed, campaign="moved-away")
    with pytest.raises(InputError, match="--campaign"):
        confirm(diagnosed)
    (diagnosed / "diagnosis.json").unlink()
    with pytest.raises(InputError, match="jointscope diagnose"):
        confirm(diagnosed)


# --- the two engines, effect by effect ------------------------------------------------------------------------------

PLAN = SingleJointPlan(
    hammer=HammerPlan(hits=1, levels=(200.0,), arm_angle=-0.4),
    sweep=SweepPlan(repeats=1, levels=(0.6,)),
    motion=MotionPlan(repeats=1, travels=(2.0 * math.pi / 3.0,)),
    timestep=1e-4,
)
# what the reduced model does coarser than MuJoCo here, as a share of the effect
COARSE = {"sensor-resonance": 0.2, "transmission-error": 0.25, "delay": 0.8, "clock-drift": 0.8}
ANOTHER_MEANING = ("external-vibration",)  # its phase in a run is no input


@pytest.fixture(scope="module")
def prepared():
    from jointscope.diagnosis import inputs
    from jointscope.diagnosis.prepare import prepare

    campaign = simulate_single_joint(RIG, PLAN, np.random.default_rng(3))
    with pytest.MonkeyPatch.context() as patch:  # both engines get the log as it is
        patch.setattr(inputs, "estimated_input", lambda samples, rate, noise: samples)
        return campaign, prepare(campaign)


def both_engines(campaign, problem, effects):
    """(quantity, reduced, MuJoCo) of every output of every run at the true base."""
    from jointscope.diagnosis.model_file import model_json
    from jointscope.diagnosis.predict import free_prediction

    true = {k: v for k, v in base_parameters().items() if not k.startswith(("torque", "drive"))}
    theta = problem.theta(**true)
    built = augment(model_json(problem, theta, effects))
    description = json.loads(json.dumps(built.description))
    for run in problem.runs:
        reduced = free_prediction(run, theta, effects, problem)
        stepped = replay_run(
            campaign, run.run, built.spec, physics_of(description)(run.run),
            loop=loop_of(description["drive"]), timestep=1e-4,
        )  # fmt: skip
        for output, x in zip(run.declared, reduced, strict=True):
            y = np.array(stepped.streams[output.channel[0]].channels[output.channel[1]].samples)
            if output.quantity == "angle":
                x, y = x - x[0], y - y[0]
            yield output.quantity, x, y


@pytest.mark.parametrize("initial", ["estimate", "rest"])
def test_the_zero_of_a_steady_state_is_its_mean(initial):
    """The model begins at rest and joins the record's steady state within its first half second."""
    rate = 1000.0
    t = np.arange(5000) / rate
    true = 1e-3 * np.cos(2 * np.pi * 10.0 * t)

    def signal(samples):
        channel = Channel(
            column="x", quantity="position", unit="m", location="load", role="output", samples=samples
        )
        return Signal(
            stream=Stream(file="a.csv", sampling_rate=rate, length=t.size, channels=(channel,)),
            channel=channel,
            device=0,
        )

    run = Run(id="a", experiment="torque-sweep", streams=(), initial=initial)
    rising = signal(np.where(t < 0.5, 2.0 * t, 1.0) * true)
    found = _check(run, signal(true + 0.7e-3), rising, rising, 1.0)
    assert found.base_error == found.augmented_error
    assert found.base_error < 1e-12 if initial == "estimate" else found.base_error > 0.3


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


@pytest.mark.slow
def test_both_engines_mean_the_same_by_every_effect_of_the_catalogue(prepared):
    """What MuJoCo adds beside what the reduced model adds: within 5 % of it, or 0.3 % of the signal."""
    from jointscope.diagnosis.effects import ActiveEffect, catalogue

    campaign, problem = prepared
    base = list(both_engines(campaign, problem, ()))
    for _, x, y in base:
        assert rms(y - x) < 2e-3 * rms(x)
    for spec in catalogue(problem):
        if spec.name in ANOTHER_MEANING or (spec.name, spec.variant) == ("end-stop", "lower"):
            continue  # the sweep starts beyond a lower stop
        values = list(spec.starts(problem)[0])
        values.insert(spec.amplitude, spec.scale(problem)[1])
        if spec.name == "end-stop":
            values[0] = 0.3
        with_effect = both_engines(campaign, problem, (ActiveEffect(spec, tuple(values)),))
        for (quantity, x0, y0), (_, x, y) in zip(base, with_effect, strict=True):
            added = rms(x - x0)
            allowed = max(COARSE.get(spec.name, 0.05) * added, 3e-3 * rms(x0))
            assert rms((y - y0) - (x - x0)) < allowed, (spec.name, spec.location, spec.variant, quantity)


@pytest.mark.slow
def test_a_diagnosis_is_confirmed_from_end_to_end(tmp_path):
    def drag(spec):
        spec.tendon("arm").frictionloss = 3.0
        spec.tendon("arm").solref_friction, spec.tendon("arm").solimp_friction = (
            [1e-4, 1.0],
            [0.9999, 0.9999, 1e-3, 0.5, 2.0],
        )

    plan = replace(HITS, hammer=HammerPlan(hits=3, levels=(120.0, 250.0, 450.0), double_hit_probability=0.0))
    recordings = simulate_single_joint(
        RIG, plan, np.random.default_rng(8), physics=lambda take: Physics(edit=drag)
    )
    write_campaign(recordings, tmp_path / "campaign")
    assert main(["diagnose", str(tmp_path / "campaign"), "--out", str(tmp_path / "out")]) == 0
    assert main(["confirm", str(tmp_path / "out")]) == 0
