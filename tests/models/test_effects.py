"""A diagnosed effect in MJCF: loadable, quiet, nothing at zero amplitude, and the law that its name stands for."""

import json
import math

import mujoco
import numpy as np
import pytest

from jointscope.errors import InputError
from jointscope.models.effects import alone, augment, read_description, write_augmented
from jointscope.models.rig import brake

BASE = {
    "stiffness": 2e5, "damping": 60.0, "load_inertia": 3.0, "motor_inertia": 9.0, "motor_damping": 2.0,
    "load_damping": 1.0, "gravity_moment": 58.0, "efficiency": 0.7, "torque_scale": 1.0, "torque_offset": 0.0, "torque_age": 0.0,
    "drive_gain": 1600.0, "drive_integral": 32000.0, "drive_acceleration": 0.0, "drive_velocity": 0.0, "drive_limit": 600.0,
}  # fmt: skip
RIG = {"topology": "two-inertia", "motion": "rotational", "plane": "vertical", "reduction_ratio": 100.0}

# effect, location, variant, parameters, the parameter that switches it off and the value at which it does
CATALOGUE = [
    ("coulomb-friction", "motor", "plain", {"torque": 20.0}, "torque", 0.0),
    ("coulomb-friction", "load", "asymmetric", {"torque": 3.0, "asymmetry": 0.2}, "torque", 0.0),
    ("coulomb-friction", "motor", "rounded", {"torque": 20.0, "rounding": 0.02}, "torque", 0.0),
    ("coulomb-friction", "load", "rounded", {"torque": 3.0, "rounding": 0.02}, "torque", 0.0),
    ("coulomb-friction", "load", "rounded-asymmetric", {"torque": 3.0, "rounding": 0.02, "asymmetry": 0.2}, "torque", 0.0),
    ("coulomb-friction", "motor", "rounded-algebraic", {"torque": 20.0, "rounding": 0.02, "asymmetry": 0.1}, "torque", 0.0),
    ("stribeck-friction", "motor", "gaussian", {"torque": 20.0, "breakaway": 30.0, "stribeck_velocity": 0.02}, "torque", 0.0),
    ("stribeck-friction", "load", "exponential", {"torque": 2.0, "breakaway": 3.0, "stribeck_velocity": 0.02}, "torque", 0.0),
    ("stribeck-friction", "motor", "rounded",
     {"torque": 20.0, "breakaway": 30.0, "stribeck_velocity": 0.02, "rounding": 0.004}, "torque", 0.0),
    ("stribeck-friction", "load", "rounded-asymmetric",
     {"torque": 2.0, "breakaway": 3.0, "stribeck_velocity": 0.02, "rounding": 0.004, "asymmetry": 0.1}, "torque", 0.0),
    ("stribeck-friction", "motor", "bristles",
     {"torque": 20.0, "breakaway": 30.0, "stribeck_velocity": 0.02, "presliding": 1e-5}, "torque", 0.0),
    ("stribeck-friction", "motor", "bristles-exponential",
     {"torque": 20.0, "breakaway": 30.0, "stribeck_velocity": 0.02, "presliding": 1e-5}, "torque", 0.0),
    ("stribeck-friction", "load", "bristles-damped",
     {"torque": 2.0, "breakaway": 3.0, "stribeck_velocity": 0.02, "presliding": 1e-5, "bristle_time": 2e-4},
     "torque", 0.0),
    ("coulomb-friction", "motor", "presliding", {"torque": 20.0, "presliding": 1e-5}, "torque", 0.0),
    ("coulomb-friction", "motor", "presliding-asymmetric", {"torque": 20.0, "presliding": 1e-5, "asymmetry": 0.1},
     "torque", 0.0),
    ("coulomb-friction", "load", "presliding-shaped", {"torque": 2.0, "presliding": 1e-5, "exponent": 0.4},
     "torque", 0.0),
    ("load-dependent-friction", "transmission", "input-side", {"coefficient": 0.05}, "coefficient", 0.0),
    ("load-dependent-friction", "transmission", "output-side", {"coefficient": 0.05}, "coefficient", 0.0),
    ("load-dependent-friction", "transmission", "input-side-presliding", {"coefficient": 0.05, "presliding": 1e-5},
     "coefficient", 0.0),
    ("load-dependent-friction", "transmission", "input-side-quadrants",
     {"coefficient": 0.05, "rounding": 0.02, "driven": 0.3}, "coefficient", 0.0),
    ("load-dependent-friction", "transmission", "output-side-rounded", {"coefficient": 0.05, "rounding": 0.02},
     "coefficient", 0.0),
    ("quadratic-damping", "load", "drag", {"coefficient": 30.0}, "coefficient", 0.0),
    ("backlash", "transmission", "damped", {"gap": 1e-4}, "gap", 0.0),
    ("backlash", "transmission", "free-flight", {"gap": 1e-4}, "gap", 0.0),
    ("backlash", "transmission", "off-centre", {"gap": 1e-4, "centre": 0.7}, "gap", 0.0),
    ("backlash", "transmission", "sheds", {"gap": 1e-4}, "gap", 0.0),
    ("backlash", "transmission", "rounded", {"gap": 1e-4, "contact_depth": 4e-5, "fade": 1.0}, "gap", 0.0),
    ("backlash", "transmission", "hyperbolic", {"gap": 1e-4, "corner": 0.5, "fade": 1.0}, "gap", 0.0),
    ("backlash", "transmission", "softplus", {"gap": 1e-4, "corner": 0.2, "fade": 1.0}, "gap", 0.0),
    ("backlash", "transmission", "impact", {"gap": 1e-4, "corner": 0.5, "impact": 3.0}, "gap", 0.0),
    ("stiffness-nonlinearity", "transmission", "cubic", {"cubic": 2e10}, "cubic", 0.0),
    ("stiffness-nonlinearity", "transmission", "piecewise", {"soft_share": 0.3, "transition_angle": 1e-4}, "soft_share", 0.0),
    ("stiffness-nonlinearity", "transmission", "smooth", {"soft_share": 0.3, "transition_angle": 1e-4}, "soft_share", 0.0),
    ("stiffness-nonlinearity", "transmission", "power", {"growth": 0.2, "exponent": 1.6, "reference_angle": 1e-4}, "growth", 0.0),
    ("hysteresis", "transmission", "bouc-wen", {"torque": 8.0, "stiffness": 1e5}, "torque", 0.0),
    ("hysteresis", "transmission", "bouc-wen-linear", {"torque": 8.0, "stiffness": 1e5}, "torque", 0.0),
    ("hysteresis", "transmission", "dahl", {"torque": 8.0, "stiffness": 1e5}, "torque", 0.0),
    ("hysteresis", "transmission", "bouc-wen-shaped", {"torque": 8.0, "stiffness": 1e5, "shape": -1.4}, "torque", 0.0),
    ("hysteresis", "transmission", "maxwell-slip", {"torque": 8.0, "stiffness": 1e5}, "torque", 0.0),
    ("hysteresis", "transmission", "slip-spread", {"torque": 8.0, "stiffness": 1e5, "spread": 10.0}, "torque", 0.0),
    ("hysteresis", "transmission", "elastic-slip", {"torque": 8.0, "stiffness": 1e5}, "torque", 0.0),
    ("structural-damping", "transmission", "relaxation", {"loss_factor": 0.05}, "loss_factor", 0.0),
    ("structural-damping", "transmission", "rate-independent", {"loss_factor": 0.05}, "loss_factor", 0.0),
    ("stiffness-drift", "transmission", "in-run", {"rate": 0.02}, "rate", 0.0),
    ("stiffness-drift", "transmission", "per-run", {"rate": 0.01}, "rate", 0.0),
    ("transmission-error", "transmission", "motor-order", {"amplitude": 1e-4, "order": 2.0, "phase": 0.3}, "amplitude", 0.0),
    ("transmission-error", "transmission", "output-order", {"amplitude": 1e-4, "order": 39.0, "phase": 0.3}, "amplitude", 0.0),
    ("transmission-error", "transmission", "motor-order-reacting",
     {"amplitude": 1e-4, "order": 2.0, "phase": 0.3}, "amplitude", 0.0),
    ("transmission-error", "transmission", "output-order-reacting",
     {"amplitude": 1e-4, "order": 39.0, "phase": 0.3}, "amplitude", 0.0),
    ("torque-ripple", "motor", "cogging", {"amplitude": 5.0, "order": 6.0, "phase": 0.3}, "amplitude", 0.0),
    ("transmission-error", "transmission", "motor-order-harmonic",
     {"amplitude": 1e-4, "order": 2.0, "phase": 0.3, "second_sine": 2e-5, "second_cosine": -1e-5,
      "third_sine": -5e-6, "third_cosine": 1e-5}, "amplitude", 0.0),
    ("transmission-error", "transmission", "output-order-harmonic",
     {"amplitude": 1e-4, "order": 39.0, "phase": 0.3, "second_sine": 2e-5, "second_cosine": -1e-5,
      "third_sine": -5e-6, "third_cosine": 1e-5}, "amplitude", 0.0),
    *(("transmission-error", "transmission", f"{turn}-order-reacting-harmonic",
       {"amplitude": 1e-4, "order": order, "phase": 0.3, "second_sine": 2e-5, "second_cosine": -1e-5,
        "third_sine": -5e-6, "third_cosine": 1e-5}, "amplitude", 0.0) for turn, order in (("motor", 2.0), ("output", 39.0))),
    ("torque-ripple", "motor", "cogging-harmonic",
     {"amplitude": 5.0, "order": 6.0, "phase": 0.3, "second_sine": 1.0, "second_cosine": -0.5,
      "third_sine": -0.25, "third_cosine": 0.5}, "amplitude", 0.0),
    ("torque-ripple", "motor", "load-proportional", {"share": 0.05, "order": 6.0, "phase": 0.3}, "share", 0.0),
    ("drive-lag", "motor", "first-order", {"time_constant": 1e-3}, "time_constant", 0.0),
    ("drive-lag", "motor", "magnitude-optimum", {"time_constant": 1e-3}, "time_constant", 0.0),
    *(("drive-lag", "motor", "damped-loop", {"time_constant": 1e-3, "damping": zeta}, "time_constant", 0.0)
      for zeta in (0.5, 1.0, 1.6)),
    ("torque-gain", "motor", "constant", {"gain": 1.1}, "gain", 1.0),
    ("gravity", "load", "level", {"moment": -12.0}, "moment", 0.0),
    ("gravity", "load", "inclined", {"moment": 12.0, "phase": 1.0}, "moment", 0.0),
    ("payload", "load", "some-runs", {"inertia": 0.5}, "inertia", 0.0),
    ("payload", "load", "lifted", {"inertia": 0.5, "percussion_radius": 0.8}, "inertia", 0.0),
    ("end-stop", "load", "upper", {"angle": 0.4, "stiffness": 1e5}, "stiffness", 0.0),
    ("end-stop", "load", "lower", {"angle": -0.4, "stiffness": 1e5}, "stiffness", 0.0),
    ("end-stop", "load", "upper", {"angle": 0.4, "stiffness": 1e5, "damping": 2.0}, "stiffness", 0.0),
    ("link-flexibility", "load", "one-shape", {"frequency": 90.0, "inertia": 0.2, "damping": 0.02, "shape": 1.5}, "inertia", 0.0),
    ("link-flexibility", "load", "two-shapes",
     {"frequency": 90.0, "inertia": 0.2, "damping": 0.02, "hit_shape": 1.5, "sensor_shape": -0.5}, "inertia", 0.0),
    ("link-flexibility", "load", "cantilever",
     {"frequency": 90.0, "inertia": 0.2, "damping": 0.02, "shape": 5.0, "elbow_radius": 0.1, "curve": 2.5}, "inertia", 0.0),
    ("link-flexibility", "load", "elbow",
     {"frequency": 90.0, "inertia": 0.2, "damping": 0.02, "shape": 5.0, "elbow_radius": 0.3}, "inertia", 0.0),
    ("link-flexibility", "load", "2-bends-2-places",
     {"frequency": 90.0, "damping": 0.02, "share_of_1": 0.5, "share_of_2": -0.3, "frequency_2": 140.0, "damping_2": 0.01,
      "share_2_of_1": 0.2, "share_2_of_2": 0.4, "shape_2": 0.8}, "share_of_1", 0.0),
    ("neighbour-flexibility", "neighbour", "absorber",
     {"frequency": 25.0, "modal_share": 0.05, "damping": 0.02}, "modal_share", 0.0),
    ("base-compliance", "base", "turning-mount", {"frequency": 25.0, "modal_share": 0.05, "damping": 0.02}, "modal_share", 0.0),
    ("base-compliance", "base", "sliding-mount",
     {"frequency": 25.0, "modal_share": 0.05, "damping": 0.02, "percussion_radius": 0.8}, "modal_share", 0.0),
    ("neighbour-flexibility", "neighbour", "carrier",
     {"frequency": 25.0, "modal_share": 0.05, "damping": 0.02, "offset": 0.3}, "modal_share", 0.0),
    ("base-compliance", "base", "sliding-mount-turned",
     {"frequency": 25.0, "modal_share": 0.05, "damping": 0.02, "percussion_radius": 0.8, "direction": 0.3}, "modal_share", 0.0),
    ("neighbour-flexibility", "neighbour", "carrier-turned",
     {"frequency": 25.0, "modal_share": 0.05, "damping": 0.02, "percussion_radius": 0.8, "direction": 0.3,
      "eccentricity": 0.5}, "modal_share", 0.0),
    ("external-vibration", "base", "torque", {"frequency": 25.0, "amplitude": 2.0}, "amplitude", 0.0),
    ("delay", "acquisition", "constant", {"delay": 1e-3}, "delay", 0.0),
    ("delay", "acquisition", "encoder", {"delay": 1e-3}, "delay", 0.0),
    ("clock-drift", "acquisition", "constant", {"ppm": 60.0}, "ppm", 0.0),
    ("sensor-tilt", "acquisition", "radial", {"angle": 0.05}, "angle", 0.0),
    ("sensor-resonance", "acquisition", "mount", {"frequency": 300.0, "damping": 0.05}, "frequency", math.inf),
    ("sensor-resonance", "acquisition", "mount-limited", {"frequency": 300.0, "damping": 0.05, "corner": 4.0},
     "frequency", math.inf),
    ("sensor-resonance", "acquisition", "bandwidth", {"frequency": 300.0}, "frequency", math.inf),
    ("sensor-saturation", "acquisition", "clip", {"level": 20.0}, "level", math.inf),
    ("sensor-saturation", "acquisition", "compressing", {"level": 20.0, "knee": 2.0}, "level", math.inf),
    ("sensor-gain", "acquisition", "accelerometer", {"gain": 1.1}, "gain", 1.0),
    ("sensor-gain", "acquisition", "force", {"gain": 1.1}, "gain", 1.0),
    ("torque-logging", "acquisition", "averaged", {"rate": 100.0}, "rate", math.inf),
]  # fmt: skip
NAMES = [f"{name}@{location}/{variant}" for name, location, variant, *_ in CATALOGUE]


def model(*effects, rig=RIG, **base):
    return {
        "format": "jointscope-model/1",
        "kind": "diagnosis",
        "rig": rig,
        "base": {**BASE, **base},
        "effects": [
            {"effect": name, "location": location, "variant": variant, "parameters": parameters}
            for name, location, variant, parameters in effects
        ],
    }


def compiled(*effects, timestep=1e-4, **options):
    spec = augment(model(*effects, **options)).spec
    spec.option.timestep = timestep
    return spec.compile()


def forces(machine, angles, speeds=None):
    """Passive forces at named joint angles, by joint."""
    data = mujoco.MjData(machine)
    for name, angle in angles.items():
        data.joint(name).qpos[0] = angle
    for name, speed in (speeds or {}).items():
        data.joint(name).qvel[0] = speed
    mujoco.mj_forward(machine, data)
    return {machine.joint(i).name: data.qfrc_passive[machine.joint(i).dofadr[0]] for i in range(machine.njnt)}


@pytest.mark.parametrize("entry", CATALOGUE, ids=NAMES)
def test_every_effect_reloads_and_steps_quietly(entry, tmp_path):
    write_augmented(model(entry[:4]), tmp_path)
    machine = mujoco.MjModel.from_xml_path(str(tmp_path / "augmented.xml"))
    data = mujoco.MjData(machine)
    data.joint("motor").qpos[0] = 0.1
    for _ in range(400):
        mujoco.mj_step(machine, data)
    assert np.all(np.isfinite(data.qpos))
    assert sum(int(warning.number) for warning in data.warning) == 0
    description = read_description(tmp_path / "effects.json")
    assert description["native"] or description["laws"]
    assert json.loads(json.dumps(description, allow_nan=False)) == description


@pytest.mark.parametrize("entry", CATALOGUE, ids=NAMES)
def test_zero_amplitude_is_the_base_exactly(entry):
    name, location, variant, parameters, amplitude, null = entry
    off, bare = (
        augment(model((name, location, variant, {**parameters, amplitude: null}))),
        augment(model()),
    )
    for built in (off, bare):
        built.spec.compile()
    assert off.spec.to_xml() == bare.spec.to_xml()
    assert off.description == bare.description


def test_the_base_is_the_base_alone(tmp_path):
    content = {**model(CATALOGUE[0][:4]), "base_alone": {**BASE, "stiffness": 1.8e5}}
    write_augmented(content, tmp_path)
    base = mujoco.MjModel.from_xml_path(str(tmp_path / "base.xml"))
    augmented = mujoco.MjModel.from_xml_path(str(tmp_path / "augmented.xml"))
    assert base.jnt_stiffness[1] == 1.8e5 and base.dof_frictionloss.sum() == 0.0
    assert augmented.jnt_stiffness[1] == 2e5 and augmented.dof_frictionloss[0] == 20.0
    assert alone(model(CATALOGUE[0][:4]))["base"] == BASE  # where no other base is known


def test_the_polynomial_spring_is_k_delta_k2_k3():
    machine = compiled(("stiffness-nonlinearity", "transmission", "cubic", {"cubic": 2e10, "quadratic": 3e7}))
    for delta in (-1e-3, 4e-4, 1e-3):
        torque = 2e5 * delta + 3e7 * delta**2 + 2e10 * delta**3
        assert forces(machine, {"reducer": -delta})["reducer"] == pytest.approx(torque, rel=1e-12)


def test_play_is_a_dead_zone_off_centre_with_the_polynomial_outside():
    machine = compiled(
        ("backlash", "transmission", "off-centre", {"gap": 2e-4, "centre": 0.5}),
        ("stiffness-nonlinearity", "transmission", "cubic", {"cubic": 2e10}),
    )
    for delta in np.linspace(-1e-3, 1e-3, 21):
        el = np.sign(delta - 5e-5) * max(abs(delta - 5e-5) - 1e-4, 0.0)
        assert forces(machine, {"reducer": -delta})["reducer"] == pytest.approx(2e5 * el + 2e10 * el**3, abs=1e-9)


@pytest.mark.parametrize("share", [0.3, -0.5])
def test_a_soft_middle_misses_its_share_within_the_angle_and_a_constant_outside(share):
    machine = compiled(
        ("stiffness-nonlinearity", "transmission", "piecewise", {"soft_share": share, "transition_angle": 1e-4})
    )
    for delta in (-4e-4, -5e-5, 5e-5, 4e-4):
        missing = share * 2e5 * float(np.clip(delta, -1e-4, 1e-4))
        assert forces(machine, {"reducer": -delta})["reducer"] == pytest.approx(2e5 * delta - missing, rel=1e-12)


def test_drag_is_odd_and_quadratic_in_the_arms_speed():
    machine = compiled(("quadratic-damping", "load", "drag", {"coefficient": 30.0}))
    found = forces(machine, {}, {"motor": -2.0})
    assert found["reducer"] == pytest.approx(1.0 * 2.0 + 30.0 * 4.0)


@pytest.mark.parametrize("location", ["motor", "load"])
def test_dry_friction_holds_below_breakaway_and_lets_exactly_the_excess_through(location):
    """The default solver creeps like 8.6e3 N m s/rad; this one by less than 1e-6 rad/s."""
    machine = compiled(
        ("coulomb-friction", location, "asymmetric", {"torque": 20.0, "asymmetry": 0.25}),
        gravity_moment=0.0, motor_damping=0.0, load_damping=0.0, damping=2000.0,
    )  # fmt: skip
    gear = machine.actuator("motor").gear[0]

    def after(torque, seconds=0.3):
        data = mujoco.MjData(machine)
        data.actuator("motor").ctrl[0] = torque / gear
        for _ in range(round(seconds / 1e-4)):
            mujoco.mj_step(machine, data)
        return data.joint("motor").qvel[0]

    assert abs(after(24.0)) < 1e-6 and abs(after(-14.0)) < 1e-6  # breaks away at 25 and at -15 N m
    assert after(37.0) == pytest.approx((37.0 - 25.0) / 12.0 * 0.3, rel=2e-2)
    assert after(-27.0) == pytest.approx(-(27.0 - 15.0) / 12.0 * 0.3, rel=2e-2)


def test_weight_is_the_sum_of_the_bases_and_the_effects():
    machine = compiled(("gravity", "load", "inclined", {"moment": 12.0, "phase": 1.0}))
    data = mujoco.MjData(machine)
    for q in (-1.0, 0.3, 2.0):
        data.joint("motor").qpos[0] = q
        mujoco.mj_forward(machine, data)
        assert -data.qfrc_bias[1] == pytest.approx(-58.0 * math.cos(q) - 12.0 * math.cos(q + 1.0), rel=1e-9)


def test_a_stop_pushes_back_from_beyond_its_angle_only_also_on_the_brake():
    built = augment(model(("end-stop", "load", "upper", {"angle": 0.4, "stiffness": 1e5})))
    for machine, held in ((built.spec.compile(), 0.0), (brake(built.spec, 0.39).compile(), 0.39)):
        for q in (0.3, 0.399, 0.401, 0.41):
            angles = {"reducer": q - held} if held else {"motor": q}
            spring = -2e5 * (q - held) if held else 0.0
            expected = -1e5 * max(q - 0.4, 0.0) + spring
            assert forces(machine, angles)["reducer"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "location"), [("link-flexibility", "load"), ("neighbour-flexibility", "neighbour")]
)
def test_a_mode_on_the_arm_keeps_the_inertia_and_gives_the_two_mass_eigenvalues(name, location):
    amount = {"inertia": 0.3} if location == "load" else {"modal_share": 0.1}
    rest = {"shape": 0.0} if location == "load" else {}
    entry = (
        name,
        location,
        "one-shape" if rest else "absorber",
        {"frequency": 60.0, "damping": 0.01, **amount, **rest},
    )
    machine = brake(augment(model(entry, gravity_moment=0.0)).spec, 0.0).compile()
    data = mujoco.MjData(machine)
    mujoco.mj_forward(machine, data)
    M = np.zeros((machine.nv, machine.nv))
    mujoco.mj_fullM(machine, data, M)
    assert M[0, 0] == pytest.approx(3.0, rel=1e-6)
    found = np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(M, np.diag(machine.jnt_stiffness))).real))
    k = 0.3 * (2.0 * math.pi * 60.0) ** 2
    expected = np.sqrt(np.linalg.eigvals(np.linalg.solve([[2.7, 0.0], [0.0, 0.3]], [[2e5 + k, -k], [-k, k]])).real)
    assert found == pytest.approx(np.sort(expected), rel=1e-5)


def test_the_mount_turns_under_the_joints_reaction_alone():
    """J_b b'' = -T_S - J_b w^2 b with J_b = J_L / share, and the arm is carried along."""
    machine = compiled(CATALOGUE[NAMES.index("base-compliance@base/turning-mount")][:4], gravity_moment=0.0)
    data = mujoco.MjData(machine)
    data.joint("reducer").qpos[0] = -1e-4
    mujoco.mj_forward(machine, data)
    torque = 2e5 * 1e-4
    assert data.joint("base").qacc[0] == pytest.approx(-torque * 0.05 / 3.0, rel=1e-6)
    assert data.joint("motor").qacc[0] == pytest.approx(-torque / 9.0, rel=1e-6)
    total = sum(data.joint(name).qacc[0] for name in ("base", "motor", "reducer"))
    assert total == pytest.approx(torque / 3.0, rel=1e-6)


def test_cogging_counts_from_the_horizontal_and_its_control_does_nothing():
    machine = compiled(("torque-ripple", "motor", "cogging", {"amplitude": 5.0, "order": 6.0, "phase": 0.3}))
    data = mujoco.MjData(machine)
    data.joint("motor").qpos[0], data.actuator("cogging 1").ctrl[0] = 0.02, 1.0
    mujoco.mj_forward(machine, data)
    assert data.actuator("cogging 1").force[0] == pytest.approx(5.0 * math.sin(600.0 * 0.02 + 0.3), rel=1e-6)


def test_a_single_inertia_has_one_coordinate_and_its_motor_pushes_it():
    rig = {"topology": "single-dof", "motion": "translational", "plane": "horizontal"}
    entry = ("coulomb-friction", "load", "plain", {"torque": 20.0})
    machine = compiled(
        entry, rig=rig, load_inertia=95.0, gravity_moment=0.0, efficiency=1.0, stiffness=0.0, damping=0.0
    )
    assert machine.nv == 1 and machine.jnt_type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    data = mujoco.MjData(machine)
    data.actuator("motor").ctrl[0] = 115.0
    mujoco.mj_forward(machine, data)
    assert data.qacc[0] == pytest.approx((115.0 - 20.0) / 95.0, rel=1e-3)


def test_the_drives_law_is_referred_to_the_motor_shaft():
    drive = augment(model()).description["drive"]
    assert drive["proportional"] == pytest.approx(0.16) and drive["integral"] == pytest.approx(3.2)
    assert drive["torque_limit"] == pytest.approx(6.0)
    assert drive["share"] == pytest.approx(12.0 * 2.0 * math.pi * 0.3 / (0.7 * 1600.0))


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ({**model(), "kind": "base"}, "kind"),
        (model(("static-cling", "load", "", {})), "static-cling@load"),
        (model(("backlash", "transmission", "damped", {})), "gap"),
        (model(("latent-law", "load", "speed", {"torque_0": 1.0, "torque_1": 2.0})), "low"),
        (model(("hysteresis", "transmission", "dahl", {"torque": 1.0})), "stiffness"),
        ({**model(), "base": {"stiffness": 1.0}}, "base.damping"),
        (model(rig={**RIG, "topology": "arm"}), "topology"),
    ],
)
def test_what_cannot_be_said_is_refused_by_name(content, named):
    with pytest.raises(InputError, match=named):
        augment(content)


def test_a_description_of_another_format_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_description(tmp_path / "effects.json")
    (tmp_path / "effects.json").write_text('{"format": "other/1"}')
    with pytest.raises(InputError, match="other/1"):
        read_description(tmp_path / "effects.json")


def test_a_spring_of_several_slopes_is_written_by_both_its_parts_and_off_without_either():
    """Soft inside and stiffening outside: the tendon of the one law and the polynomial of the other."""
    both = {"soft_share": 0.1, "transition_angle": 1e-4, "cubic": 2e10}
    texts = {}
    for name, values in {
        "both": both, "soft": {**both, "cubic": 0.0}, "cubic": {**both, "soft_share": 0.0},
        "neither": {**both, "soft_share": 0.0, "cubic": 0.0},
    }.items():  # fmt: skip
        entry = {
            "effect": "stiffness-nonlinearity", "location": "transmission", "law": "piecewise-cubic", "parameters": values,
        }  # fmt: skip
        texts[name] = augment({"kind": "diagnosis", "rig": RIG, "base": BASE, "effects": [entry]}).spec.to_xml()
    plain = augment({"kind": "diagnosis", "rig": RIG, "base": BASE, "effects": []}).spec.to_xml()
    assert texts["neither"] == plain
    assert len({*texts.values()}) == 4
    assert "low-torque" in texts["both"] and "low-torque" in texts["soft"]
