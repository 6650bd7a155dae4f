"""The paper's mismatches: what is concealed exists, brings about what is stated, and the page says what was said."""

from __future__ import annotations

import numpy as np
import pytest

from jointscope.experiments.mismatches.causes import mismatches, plan_of
from jointscope.experiments.mismatches.reproduction import page
from jointscope.experiments.mismatches.telling import Curve, Told, _held_out, predicted
from jointscope.models.joint import hammer_accelerance
from jointscope.models.paper import paper
from jointscope.prediction.scores import band_score
from jointscope.prediction.spectra import Spectrum
from jointscope.sim.concealed import catalogue
from jointscope.sim.concealed.rehearsal import clean_channels

ALL = mismatches()
KEYS = [mismatch.key for mismatch in ALL]


def test_the_four_statements_of_the_paper():
    """Each once, each with causes that the generator has, in experiments that the campaign holds."""
    assert len(set(KEYS)) == 4
    laws = {(f"{law.effect}@{law.location}", law.law) for law in catalogue.LISTED}
    for mismatch in ALL:
        assert mismatch.kind in mismatch.kinds
        assert mismatch.shown[0] <= mismatch.band[0] < mismatch.band[1] <= mismatch.shown[1]
        for cause in mismatch.causes:
            assert (cause.label, cause.law) in laws


@pytest.mark.parametrize("mismatch", ALL, ids=KEYS)
def test_largest_runs_are_held_out_and_every_experiment_has_both(mismatch):
    """What is predicted was not fitted, and goes to the largest level."""
    plan, _ = plan_of(mismatch, np.random.default_rng(0), quick=True)
    held = _held_out(plan.takes)
    for kind in mismatch.kinds:
        of_kind = {i for i, take in enumerate(plan.takes) if take.kind == kind}
        assert held & of_kind
        assert of_kind - held


def test_the_concealed_friction_is_worth_the_papers_damping():
    """Equivalent viscous damping of Coulomb friction, 4 T/(pi w A), is the paper's surplus at amplitudes that the hits reach."""
    mismatch = ALL[KEYS.index("damping-97-percent-high")]
    torque, joint = mismatch.causes[0].values["torque"], mismatch.rig.joint
    surplus = paper().table2_identified.damping - joint.damping
    w = np.sqrt(joint.stiffness / joint.load_inertia)
    amplitude = 4.0 * torque / (np.pi * w * surplus)
    plan, _ = plan_of(mismatch, np.random.default_rng(0), quick=True)
    peaks = [
        take.force * mismatch.rig.hammer_radius * take.pulse * 2.0 / np.pi / (joint.load_inertia * w)
        for take in plan.takes
    ]
    assert min(peaks) < amplitude < max(peaks)


def test_the_concealed_mount_raises_the_response_below_15_hz():
    """With it, a hit's response has more below 15 Hz than the plain rig's (checked against the closed form too)."""
    mismatch = ALL[KEYS.index("sweep-low-below-15-hz")]
    plan, _ = plan_of(mismatch, np.random.default_rng(0), quick=True)
    index = max((i for i, t in enumerate(plan.takes) if t.kind == "hammer"), key=lambda i: plan.takes[i].force)
    effect = mismatch.causes[0].effect(plan.setting)
    size = []
    for effects in ((), (effect,)):
        made = clean_channels(mismatch.rig, plan, index, effects)
        F, A = np.fft.rfft(made["force"]), np.fft.rfft(made["acceleration"] - made["acceleration"][0])
        f = np.fft.rfftfreq(made["force"].size, 1.0 / plan.devices.daq_rate)
        band = (f > 7.0) & (f < 15.0)
        size.append(float(np.sqrt(np.mean(np.abs(A[band] / F[band]) ** 2))))
    rig = mismatch.rig
    s = np.asarray(2j * np.pi * f[band], dtype=np.complex128)
    exact = np.abs(hammer_accelerance(rig.joint, s)) * rig.hammer_radius * rig.accelerometer_radius
    assert size[0] == pytest.approx(float(np.sqrt(np.mean(exact**2))), rel=0.1)
    assert size[1] > 1.3 * size[0]


def _told(named: bool) -> Told:
    f = np.arange(0.0, 100.0, 0.5)
    flat = np.ones(f.size, dtype=np.complex128)
    mismatch = ALL[0]
    M, B, A = Spectrum(f, flat), Spectrum(f, 0.5 * flat), Spectrum(f, 0.98 * flat)
    scores = [band_score(M, P, *mismatch.band) for P in (B, A)]
    label = mismatch.causes[0].label if named else "delay@acquisition"
    effect, location = label.split("@")
    diagnosis = {
        "verdict": "effects", "verdict_probability": 0.9, "held_out": None,
        "effects": [{"effect": effect, "location": location, "probability": 0.9,
                     "parameters": {"frequency": {"value": 11.0, "unit": "Hz", "interval95": [10.0, 12.0]}}}],
    }  # fmt: skip
    return Told(mismatch, diagnosis, (Curve("r1", M, B, A, *scores),), None)


def test_what_is_said_is_judged_and_shown():
    """Right and wrong names, the bias before and after, and that this proves sufficiency only."""
    right, wrong = _told(True), _told(False)
    assert right.named and not wrong.named
    assert right.bias("before") == pytest.approx(-6.02, abs=0.01)
    assert right.error("after") == pytest.approx(0.175, abs=0.01)
    text = page([right, wrong])
    assert "does not show what happened in that laboratory" in text
    assert "bias -6.02 dB" in text
    assert "delay@acquisition" in text


def test_predictions_share_the_time_column_with_slower_streams(tmp_path):
    """Empty cells belong to other streams; a wrong number of samples is refused."""
    file = tmp_path / "r1.csv"
    file.write_text("time,acceleration,motor_angle\n0.0,1.0,2.0\n0.001,3.0,\n0.0015,,4.0\n")
    assert predicted(file, 2) == pytest.approx([1.0, 3.0])
    with pytest.raises(Exception, match="2 samples"):
        predicted(file, 3)
