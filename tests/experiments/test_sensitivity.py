"""Sensitivity studies: known elasticities, known Sobol indices, the same numbers however they were computed."""

import numpy as np
import pytest

from jointscope.errors import InputError
from jointscope.experiments.sensitivity import analysis, outputs
from jointscope.experiments.sensitivity.evaluate import evaluate_sample
from jointscope.experiments.sensitivity.study import OUTPUTS, Factor, Study, read_study
from jointscope.models.joint import hammer_accelerance, load_acceleration_per_torque
from jointscope.models.paper import paper_rig

JOINT = paper_rig().joint
STIFFNESS = Factor(name="stiffness", lower=0.8 * JOINT.stiffness, upper=1.2 * JOINT.stiffness)
RATIO = Factor(name="efficiency", lower=0.6, upper=0.8)


def local(*factors):
    study = Study(nominal=JOINT, factors=factors, method="local")
    table = np.column_stack(
        list(outputs.evaluate(JOINT, tuple(f.name for f in factors), analysis.draw(study)).values())
    )
    return {(i.output, i.factor): i.total for i in analysis.analyse(study, analysis.draw(study), table)}


def test_transfer_functions_are_the_closed_forms_of_the_model_room():
    """The vectorised forms agree with (7), (11) and (17) to rounding."""
    s = 2j * np.pi * np.linspace(0.5, 120.0, 60)
    p = {key: np.array([[float(getattr(JOINT, key))]]) for key in type(JOINT).__dataclass_fields__}
    hammer, motor = outputs.transfers(p, s)
    eta_n = JOINT.efficiency * JOINT.reduction_ratio
    np.testing.assert_allclose(hammer[0], hammer_accelerance(JOINT, s), rtol=1e-12)
    np.testing.assert_allclose(motor[0], eta_n * load_acceleration_per_torque(JOINT, s), rtol=1e-12)


def test_frequencies_have_elasticity_one_half_in_stiffness_and_nothing_in_efficiency():
    """w = sqrt(K/J): d ln w / d ln K = 1/2; a linear response grows with its input's gain, elasticity 1."""
    found = local(STIFFNESS, RATIO)
    assert found["antiresonance", "stiffness"] == pytest.approx(0.5, abs=1e-6)
    assert found["resonance", "stiffness"] == pytest.approx(0.5, abs=1e-6)
    assert found["antiresonance", "efficiency"] == 0.0
    assert found["sweep_peak", "efficiency"] == pytest.approx(1.0, abs=1e-6)
    assert found["sweep_band_rms", "efficiency"] == pytest.approx(1.0, abs=1e-6)
    assert found["hammer_peak", "efficiency"] == 0.0


def test_a_damped_transform_has_no_periodic_images():
    """The hit's response starts at rest and rings down at zeta w of the analytic oscillator."""
    grid = outputs.damped_grid(1024.0, 3.0)
    p = {key: np.array([[float(getattr(JOINT, key))]]) for key in type(JOINT).__dataclass_fields__}
    hit = outputs.response(outputs.transfers(p, grid.s)[0], outputs.hammer_force(grid.times), grid)[0]
    decay = (JOINT.damping + JOINT.load_damping) / (2.0 * JOINT.load_inertia)
    early, late = (np.sqrt(np.mean(hit[at : at + 256] ** 2)) for at in (100, 612))
    assert late / early == pytest.approx(np.exp(-decay * 0.5), rel=0.02)


def test_a_sobol_study_of_one_mattering_factor_gives_it_all_the_variance():
    """The anti-resonance ignores the efficiency: indices 1 and 0 within their intervals."""
    study = Study(nominal=JOINT, factors=(STIFFNESS, RATIO), outputs=("antiresonance",), samples=128)
    sample = analysis.draw(study)
    table = np.column_stack(list(outputs.evaluate(JOINT, ("stiffness", "efficiency"), sample).values()))
    stiffness, efficiency = analysis.analyse(study, sample, table)
    assert abs(stiffness.total - 1.0) <= stiffness.total_interval + 0.02
    assert abs(efficiency.total) <= efficiency.total_interval + 1e-12
    assert "stiffness" in analysis.sentence(study, (stiffness, efficiency), "antiresonance")


def test_resumed_and_parallel_studies_are_bit_for_bit_the_serial_one(tmp_path):
    """Blocks are fixed: neither the number of workers nor an interruption changes a number."""
    study = Study(nominal=JOINT, factors=(STIFFNESS, RATIO), samples=64)
    sample = analysis.draw(study)
    serial = evaluate_sample(study, sample, tmp_path / "a", workers=1)
    for lost in list((tmp_path / "a").iterdir())[:1]:
        lost.unlink()
    assert np.array_equal(evaluate_sample(study, sample, tmp_path / "a", workers=1), serial)
    assert np.array_equal(evaluate_sample(study, sample, tmp_path / "b", workers=2), serial)
    assert serial.shape == (len(sample), len(OUTPUTS))


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('format = "x"', "format"),
        ('format = "jointscope-sensitivity/1"\nsample = 3', "sample"),
        ('format = "jointscope-sensitivity/1"\n[parameters.mass]\nrelative = 0.1', "parameters.mass"),
        ('format = "jointscope-sensitivity/1"\n[parameters.stiffness]\nrelative = 1.5', "stiffness.relative"),
        (
            'format = "jointscope-sensitivity/1"\n[parameters.stiffness]\nlower = 2\nupper = 1',
            "parameters.stiffness",
        ),
        ('format = "jointscope-sensitivity/1"', "parameters"),
        ('format = "jointscope-sensitivity/1"\noutputs = ["noise"]', "parameters"),
        ("format = [", "not TOML"),
    ],
)
def test_a_bad_study_is_refused_with_its_key(tmp_path, text, key):
    """One line that names file and key."""
    path = tmp_path / "study.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=key) as refusal:
        read_study(path, JOINT)
    assert "study.toml" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_mujoco_agrees_with_the_closed_form_on_a_subset():
    """Accelerations within 0.2 %: the two engines share no code but the joint's parameters."""
    from jointscope.experiments.sensitivity.engine import evaluate_mujoco

    values = np.array([[JOINT.stiffness, JOINT.damping], [1.15 * JOINT.stiffness, 0.5 * JOINT.damping]])
    closed = outputs.evaluate(JOINT, ("stiffness", "damping"), values)
    stepped = evaluate_mujoco(JOINT, ("stiffness", "damping"), values)
    for name in OUTPUTS:
        np.testing.assert_allclose(stepped[name], closed[name], rtol=2e-3, err_msg=name)
