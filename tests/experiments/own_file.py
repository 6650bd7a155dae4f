"""A joint's own file in three shapes, the bench that measures it, and a diagnosis that is right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jointscope.experiments.own_model.study import OwnModelStudy, study_own_model
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.sim.own_model import OwnJoint, load_own
from jointscope.sim.own_stepping import own_run

K, C, J_L, J_M, B_M, B_L, N = 193665.0, 59.76, 3.02, 9.105498, 2.0, 2.0, 141.0

NESTED = """<?xml version="1.0"?>
<!-- my robot: hands off -->
<mujoco model="bench">
  <option timestep="5e-4" integrator="RK4" gravity='0 0 0'/>
  <default><joint axis="0 -1 0"/></default>
  <worldbody>
    <body name="motor">
      <inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>
      <joint name="shoulder" armature="{J_M}" damping="2"{held}/> <!-- rotor > here -->
      <body name="arm">
        <inertial pos="0.5 0 0" mass="12" diaginertia="0.001 0.02 0.02"/>
        <joint name="shoulder_spring" stiffness="{K}" damping="59.76"/>
        <site name="imu" pos="0.95 0 0"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="sum" damping="2"><joint joint="shoulder" coef="1"/><joint joint="shoulder_spring" coef="1"/></fixed>
  </tendon>
  <actuator>
    <motor name="drive" joint="shoulder" gear="98.7"/>
  </actuator>
</mujoco>
"""

GEARED = """<mujoco><option timestep="2e-4" integrator="RK4" gravity="0 0 0"/><worldbody>
  <body name="r"><inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>
    <joint name="rotor" axis="0 -1 0" armature="4.58e-4" damping="1.00598561e-4"/></body>
  <body name="a"><inertial pos="0.5 0 0" mass="12" diaginertia="0.001 0.02 0.02"/>
    <joint name="arm" axis="0 -1 0" damping="2"/></body></worldbody>
  <tendon><fixed name="gear" stiffness="193665" damping="59.76"><joint joint="rotor" coef="0.00709219858"/>
    <joint joint="arm" coef="-1"/></fixed></tendon>
  <actuator><motor name="m" joint="rotor" gear="0.7"/></actuator></mujoco>
"""

SHAFTED = """<mujoco><option timestep="2e-4" integrator="RK4" gravity="0 0 0"/><worldbody>
  <body name="servo"><inertial pos="0 0 0" mass="1e-9" diaginertia="2.29e-4 2.29e-4 2.29e-4"/>
    <joint name="shaft" axis="0 -1 0"/></body>
  <body name="out"><inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>
    <joint name="turned" axis="0 -1 0" damping="2" armature="4.552749"/>
    <body name="boom"><inertial pos="0.5 0 0" mass="12" diaginertia="0.001 0.02 0.02"/>
      <joint name="wound" axis="0 -1 0" stiffness="193665" damping="59.76"/></body></body></worldbody>
  <tendon><fixed name="sum" damping="2"><joint joint="turned" coef="1"/><joint joint="wound" coef="1"/></fixed></tendon>
  <equality><joint joint1="shaft" joint2="turned" polycoef="0 141 0 0 0" solref="0.0004 1"
    solimp="0.9999 0.9999 0.001"/></equality>
  <actuator><motor name="m" joint="shaft" gear="0.7"/></actuator></mujoco>
"""

RIGID = """<mujoco><option timestep="1e-3" integrator="RK4" gravity="0 0 0"/><worldbody><body name="a">
    <joint name="arm" axis="0 -1 0" damping="4" armature="9.105498"/>
    <inertial pos="0.5 0 0" mass="12" diaginertia="0.001 0.02 0.02"/></body></worldbody>
  <actuator><motor name="m" joint="arm" gear="98.7"/></actuator></mujoco>
"""

JOINT = OwnJoint(link="shoulder_spring", rotor="shoulder", actuator="drive", torque="motor")
GEARED_JOINT = OwnJoint(link="arm", rotor="rotor", rotor_ratio=N, actuator="m", torque="motor")
SHAFTED_JOINT = OwnJoint(link="wound", rotor="turned", actuator="m", torque="motor")
RIG = Nameplate(
    topology="two-inertia", motion="rotational", plane="horizontal", reduction_ratio=N, motor_inertia=2.1e-4,
    reducer_inertia=2.48e-4, efficiency=0.7,
)  # fmt: skip


def nested(stiffness: float = K, held: str = "", **others: str) -> str:
    text = NESTED.replace("{K}", repr(stiffness)).replace("{J_M}", repr(J_M)).replace("{held}", held)
    for old, new in others.items():
        text = text.replace(old.replace("_", " "), new)
    return text


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def channel(quantity: Any, samples: np.ndarray, **more: Any) -> Channel:
    samples = np.asarray(samples, dtype=np.float64)
    samples.setflags(write=False)
    return Channel(column=more.pop("column", quantity), quantity=quantity, samples=samples, **more)


def recorded(truth: Path, joint: OwnJoint, *, noise: float = 0.002) -> Campaign:
    """Two braked hits and three sweeps, as the truth's own file gives them, with noise."""
    rng = np.random.default_rng(1)
    runs = []
    for k, peak in enumerate((300.0, 600.0)):
        t = np.arange(512) / 1024.0
        force = np.where((t > 0.05) & (t < 0.058), peak * np.sin(np.pi * (t - 0.05) / 0.008), 0.0)
        daq = Stream(file=f"h{k}", sampling_rate=1024.0, length=t.size, channels=(
            channel("force", force, unit="N", location="arm", role="input", radius=0.8),
            channel("linear-acceleration", t, unit="m/s^2", location="arm", role="output", radius=0.95),
        ))  # fmt: skip
        runs.append(Run(id=f"hit{k}", experiment="hammer", brake=True, streams=(daq,)))
    for k, size in enumerate((0.6, 0.9, 1.2)):
        t = np.arange(768) / 512.0
        torque = size * np.sin(2.0 * np.pi * (2.0 + 14.0 * t) * t) * np.minimum(1.0, 10.0 * t)
        plc = Stream(file=f"s{k}", sampling_rate=512.0, length=t.size, channels=(
            channel("torque", torque, unit="N m", location="motor", role="input"),
            channel("angle", t, unit="rad", location="motor", role="output"),
            channel("linear-acceleration", t, unit="m/s^2", location="arm", role="output", radius=0.95),
        ))  # fmt: skip
        runs.append(Run(id=f"sweep{k}", experiment="torque-sweep", streams=(plc,)))
    campaign = Campaign(path=Path("bench"), rig=RIG, runs=tuple(runs))
    spec, noisy = load_own(truth), []
    for run in runs:
        made = own_run(campaign, run, spec, joint)
        streams = []
        for stream in made.streams:
            channels = tuple(
                c if c.role == "input" or c.samples is None
                else replace(c, samples=c.samples + noise * np.std(c.samples) * rng.normal(size=c.samples.size))
                for c in stream.channels
            )  # fmt: skip
            streams.append(replace(stream, channels=channels))
        noisy.append(replace(made, streams=tuple(streams)))
    return replace(campaign, runs=tuple(noisy))


def diagnosed(effects: tuple[dict[str, Any], ...] = (), **base: float) -> tuple[dict[str, Any], dict[str, Any]]:
    """``diagnosis.json`` and ``model.json`` of a diagnosis that is right."""
    values = {
        "stiffness": K, "damping": C, "load_inertia": J_L, "motor_inertia": J_M, "motor_damping": B_M,
        "load_damping": B_L, "gravity_moment": 0.0, "efficiency": 0.7, "torque_scale": 1.0, "torque_offset": 0.0,
        "torque_age": 0.0,
        "drive_gain": 0.0, "drive_integral": 0.0, "drive_acceleration": 0.0, "drive_velocity": 0.0, "drive_limit": 0.0,
    } | base  # fmt: skip
    units = {"stiffness": "N m/rad", "damping": "N m s/rad", "inertia": "kg m^2"}
    answer = {
        "parameters": {
            name: {"value": v, "unit": units[name], "interval95": [v * 0.999, v * 1.001]}
            for name, v in (("stiffness", values["stiffness"]), ("damping", values["damping"]), ("inertia", J_L))
        },
        "effects": [
            {**e, "parameters": {k: {"value": v, "unit": "", "interval95": [0.99 * v, 1.01 * v]}
                                 for k, v in e["parameters"].items()}} for e in effects
        ],
        "held_out": {"runs": ["hit0", "sweep1"]},
    }  # fmt: skip
    rig = {"topology": "two-inertia", "motion": "rotational", "plane": "horizontal", "reduction_ratio": N,
           "motor_inertia": 2.1e-4, "reducer_inertia": 2.48e-4, "efficiency": 0.7}  # fmt: skip
    model = {
        "format": "jointscope-model/1",
        "kind": "diagnosis",
        "rig": rig,
        "base": values,
        "effects": list(effects),
    }
    return answer, model


def coulomb(torque: float) -> dict[str, Any]:
    return {
        "effect": "coulomb-friction",
        "location": "motor",
        "variant": "plain",
        "parameters": {"torque": torque},
    }


def study(campaign: Campaign, file: Path, *effects: dict[str, Any], joint: OwnJoint = JOINT) -> OwnModelStudy:
    return study_own_model(campaign, *diagnosed(effects), file, joint)
