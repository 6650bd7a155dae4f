"""Simulate, identify and predict: section 4 of the paper in numbers."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.six_axis.plans import driven_plan, hammer_plan, joints_plan
from jointscope.experiments.six_axis.results import (
    HammerResult,
    InertiaCheck,
    PredictionResult,
    SixAxisResult,
    TorqueResult,
)
from jointscope.experiments.six_axis.speed import measure_speed
from jointscope.experiments.six_axis.windup import kr300_windup
from jointscope.identification.arm_spots import Spot, read_spots
from jointscope.identification.frf import from_spectra
from jointscope.identification.hit_spectra import Hit, read_hit
from jointscope.identification.joint_stiffness import Belief, JointFit, identify_joints
from jointscope.identification.modal_physics import EquivalentModes, equivalent_modes, explain_modes
from jointscope.identification.model_file import BaseModel, Term
from jointscope.models.arm.agreement import compare_engines
from jointscope.models.arm.build import ElasticArm, build_arm, with_reducers
from jointscope.models.arm.linear import joint_values, linear_arm
from jointscope.models.arm.reference import Reference, arm_reference
from jointscope.prediction.arm import predict_arm
from jointscope.prediction.closed_form import predicted_spectrum
from jointscope.prediction.currents import envelope_torque, torque_from_currents
from jointscope.prediction.scores import band_score
from jointscope.prediction.spectra import Spectrum, spectrum
from jointscope.progress import track
from jointscope.recordings.campaign import Nameplate, Run
from jointscope.recordings.motor_torque import motor_torque
from jointscope.sim.arm.campaign import ArmRecording, arm_campaign, simulate_arm
from jointscope.sim.arm.plan import ELBOW, HIT_UPPER_ARM, JOINT, UPPER_ARM, ArmPlan

Real = NDArray[np.float64]

BAND = (5.0, 80.0)  # Hz, in which predictions are compared
FIT_BAND = (4.0, 50.0)  # Hz; the paper fits 0-50 Hz, below 4 Hz its FRF holds nothing but noise
_CLEAR = 10.0 ** (30.0 / 20.0)
_TERM_DAMPING = 2.0  # N m s/rad, b_m and b_l of the paper's prediction


def measure(seed: int) -> SixAxisResult:
    """Everything of section 4, from scratch."""
    started, busy = time.perf_counter(), time.process_time()
    rng = np.random.default_rng(seed)
    plan = hammer_plan()
    truth = build_arm(plan.truth)
    reference = arm_reference(truth)
    hammer = measure_hammer(plan, truth, reference, rng)
    lab = build_arm(plan.lab)
    plan_joints = joints_plan()
    made = track(
        simulate_arm(plan_joints, rng), "hits at two points", sum(s.hammer.hits for s in plan_joints.spots)
    )
    spots = read_joint_spots(plan_joints, lab, made)
    joints = fit_joints(spots, lab)
    driven = driven_plan()
    recordings = list(track(simulate_arm(driven, rng), "joint 2 driven", 4))
    rig = arm_campaign(driven, ()).rig
    torque = tuple(measure_torque(r, rig, reference) for r in recordings)
    identified = with_reducers(
        lab, {e.joint: e.value for e in joints.stiffness}, {e.joint: e.value for e in joints.damping}
    )
    prediction = tuple(
        measure_prediction(r, rig, identified, hammer.modes) for r in track(recordings, "predict", len(recordings))
    )
    values = joint_values(truth)
    exact = {name: (float(values.stiffness[k]), float(values.damping[k])) for k, name in enumerate(truth.rotors)}
    return SixAxisResult(
        hammer=hammer,
        agreement=compare_engines(truth, reference, plan.truth.posture),
        joints=joints,
        true_joints={name: exact[name] for name in (JOINT, ELBOW)},
        torque=torque,
        prediction=prediction,
        speed=measure_speed(truth, plan.truth.posture),
        windup=kr300_windup(seed),
        currents=recordings[-1].run,
        seconds=time.perf_counter() - started,
        processor_seconds=time.process_time() - busy,
        inertia=check_inertia(reference, fit_joints(spots, lab, Belief(inertia=0.1)), plan.truth.posture),
    )


def measure_hammer(
    plan: ArmPlan, truth: ElasticArm, reference: Reference, rng: np.random.Generator
) -> HammerResult:
    """20 hits on joint 2's link: FRF, sum of modes, what the modes are."""
    campaign = arm_campaign(plan, tuple(r.run for r in track(simulate_arm(plan, rng), "hits on joint 2", 20)))
    usable = [hit for run in campaign.runs if isinstance(hit := read_hit(run, campaign.rig), Hit)]
    modes = equivalent_modes(usable, campaign.rig, FIT_BAND)
    hits = [hit.spectrum for hit in usable]
    frf = from_spectra(
        hits[0].frequency, np.array([h.input for h in hits]), np.array([h.output[0] / h.sensor[0] for h in hits])
    )
    posture = plan.truth.posture
    values = joint_values(truth)
    linear = linear_arm(reference, posture, values, {})
    inside = (frf.frequency >= 2.0) & (frf.frequency <= 100.0)
    frequency = np.arange(2.0, 100.0, 0.05)
    s = np.asarray(2j * np.pi * frequency, dtype=np.complex128)
    exact = linear.accelerance(
        s,
        linear.on_links(reference.rows(posture, HIT_UPPER_ARM)[0]) / 0.50,
        linear.on_links(reference.rows(posture, UPPER_ARM.probe)[0]) / 0.55,
    )
    measured = np.interp(frequency, frf.frequency[inside], frf.h1[inside].real) + 1j * np.interp(
        frequency, frf.frequency[inside], frf.h1[inside].imag
    )
    return HammerResult(
        modes=modes,
        physics=explain_modes(modes, reference, posture, values, JOINT),
        frequency=frequency,
        measured=measured,
        exact=exact,
        summed=modes.fit.model.response(s)[0],
        first=campaign.runs[0],
    )


def read_joint_spots(plan: ArmPlan, lab: ElasticArm, made: Iterable[ArmRecording]) -> tuple[Spot, ...]:
    """Hits at two points in two postures, with what the lab's model says of each."""
    return read_spots(arm_campaign(plan, tuple(r.run for r in made)), arm_reference(lab))[0]


def fit_joints(spots: Sequence[Spot], lab: ElasticArm, belief: Belief | None = None) -> JointFit:
    """K and c of single joints, starting at the lab's rough figures."""
    rough = joint_values(lab)
    return identify_joints(
        spots, lab.rotors, rough.stiffness, rough.damping, (JOINT, ELBOW), belief=belief or Belief(), band=FIT_BAND
    )


def check_inertia(reference: Reference, fit: JointFit, posture: Mapping[str, float]) -> InertiaCheck:
    """Pinocchio's load inertia about joint 2 beside the hits' own."""
    k = reference.joints.index(JOINT)
    locked = float(reference.locked_inertia(posture)[k])
    factor, low, high = fit.inertia_factor
    return InertiaCheck(
        locked=locked, unlocked=float(reference.unlocked_inertia(posture)[k]), identified=factor * locked,
        low=low * locked, high=high * locked,
    )  # fmt: skip


def measure_torque(recording: ArmRecording, rig: Nameplate, reference: Reference) -> TorqueResult:
    """T_e of one run from currents alone, with the rotor's angle, and by the paper's envelope."""
    run = recording.run
    holding = float(reference.gravity(run.posture)[reference.joints.index(JOINT)]) / float(
        rig.reduction_ratio or 1.0
    )
    found = torque_from_currents(run, rig, holding, JOINT)
    park = motor_torque(run, rig)
    assert park is not None and recording.take.torque is not None
    true = recording.take.torque[: found.values.size]
    envelope = envelope_torque(run, rig, JOINT)

    def error(values: Real) -> float:
        return float(np.sqrt(np.mean((values - true) ** 2) / np.mean(true**2)))

    return TorqueResult(
        run=run.id, times=found.times, true=true, vector=found.values, park=park.values, envelope=envelope,
        errors={"vector": error(found.values), "park": error(park.values), "envelope": error(np.sign(true[0]) * envelope)},
        doubts=tuple((d.start, d.end) for d in found.doubts),
    )  # fmt: skip


def measure_prediction(
    recording: ArmRecording, rig: Nameplate, identified: ElasticArm, modes: EquivalentModes
) -> PredictionResult:
    """Acceleration of joint 2's link, predicted in three forms from the same currents, against the truth."""
    run = recording.run
    column = UPPER_ARM.probe.name
    multi = predict_arm(identified, rig, run)
    locked: dict[str, str] = {name: "locked" for name in identified.rotors if name != JOINT}
    alone = predict_arm(identified, rig, replace(run, hold={**locked, JOINT: run.hold[JOINT]}))  # type: ignore[dict-item]
    assert multi.torque is not None
    rate = 1024.0
    recorded, true = _samples(run, column), _samples(recording.truth, column)
    size = true.size // 2 + 1
    drive = spectrum(multi.torque, multi.torque.size / (true.size / rate))
    parallel = predicted_spectrum(
        parallel_model(rig, modes), Spectrum(drive.frequency[:size], drive.amplitude[:size]), 0.55
    )
    noise_free = spectrum(true, rate)
    predicted = {
        "parallel": Spectrum(noise_free.frequency, parallel.amplitude),
        "alone": spectrum(alone.channel(column).values, rate),
        "multi-joint": spectrum(multi.channel(column).values, rate),
    }
    mask = np.abs(noise_free.amplitude) > _CLEAR * _noise_floor(recorded - true, rate)
    scores = {name: band_score(noise_free, found, *BAND, mask) for name, found in predicted.items()}
    return PredictionResult(
        run=run.id, experiment=run.experiment, frequency=noise_free.frequency, measured=spectrum(recorded, rate).amplitude,
        true=noise_free.amplitude, predicted={name: found.amplitude for name, found in predicted.items()}, scores=scores,
        clear=scores["multi-joint"].share,
    )  # fmt: skip


def parallel_model(rig: Nameplate, modes: EquivalentModes) -> BaseModel:
    """The paper's prediction for several modes: two-inertia joints in parallel, each with the motor's parameters."""
    joint: Mapping[str, float] = {
        "motor_inertia": float(rig.motor_inertia or 0.0), "reducer_inertia": float(rig.reducer_inertia or 0.0),
        "reduction_ratio": float(rig.reduction_ratio or 1.0), "motor_damping": _TERM_DAMPING,
        "load_damping": _TERM_DAMPING, "efficiency": float(rig.efficiency or 1.0),
    }  # fmt: skip
    terms = tuple(
        Term(inertia=m.inertia.value, damping=m.damping.value, stiffness=m.stiffness.value)
        for m in modes.modes[:2]
    )
    return BaseModel(rig=rig, joint=joint, terms=terms, joint_name=JOINT)


def _samples(run: Run, column: str) -> Real:
    return next(s for s in run.signals if s.channel.column == column).samples


def _noise_floor(noise: Real, rate: float) -> float:
    """Root mean square amplitude of one bin of a white ``noise`` through the same estimator."""
    found = spectrum(noise, rate)
    inside = found.band(*BAND)
    return float(np.sqrt(np.mean(np.abs(found.amplitude[inside]) ** 2)))
