"""A fault of one accelerometer of two: what the other reads stays, and the same fault of both is the fault of all."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.effects.one_sensor import named, one_sensor_laws
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.twins import BY_EYE, MOST, foreknown

NEAR, FAR = 0.55, 0.95
VALUES = {
    "radial": (0.1,), "mount": (150.0, 0.1), "bandwidth": (200.0,), "clip": (5.0,), "compressing": (5.0, 2.0),
    "accelerometer": (1.1,), "mount-limited": (150.0, 0.1, 4.0),
}  # fmt: skip


def law(problem, variant):
    return next(s for s in catalogue(problem) if s.variant == variant and s.location == "acquisition")


def readings(problem, run, *effects):
    found = predict_outputs(run, problem.base.start, effects, problem)
    return {o.radius: y for o, y in zip(run.outputs, found, strict=True) if o.quantity == "linear-acceleration"}


def test_one_accelerometer_has_no_fault_of_its_own(problem):
    assert one_sensor_laws(problem) == ()
    assert not any("-at-" in s.variant for s in catalogue(problem))


@pytest.mark.parametrize("variant", VALUES)
def test_what_the_other_reads_stays(two, variant):
    run = two.runs[0]
    plain = readings(two, run)
    own = ActiveEffect(law(two, f"{variant}-at-{FAR:g}"), VALUES[variant])
    seen = readings(two, run, own)
    assert np.array_equal(seen[NEAR], plain[NEAR])
    assert np.max(np.abs(seen[FAR] - plain[FAR])) > 1e-3 * np.max(np.abs(plain[FAR]))


@pytest.mark.parametrize("variant", VALUES)
def test_the_same_fault_of_both_is_the_fault_of_all(two, variant):
    run = two.runs[0]
    both = [ActiveEffect(law(two, f"{variant}-at-{r:g}"), VALUES[variant]) for r in (NEAR, FAR)]
    all_of_them = readings(two, run, ActiveEffect(law(two, variant), VALUES[variant]))
    for radius, y in readings(two, run, *both).items():
        np.testing.assert_allclose(y, all_of_them[radius], rtol=1e-12, atol=1e-12)


def test_places_are_told_by_where_they_are(two):
    """The order of the channels says nothing, and a model file names the radius."""
    turned = replace(two, runs=tuple(replace(r, outputs=tuple(reversed(r.outputs))) for r in two.runs))
    assert {s.variant for s in one_sensor_laws(turned)} == {s.variant for s in one_sensor_laws(two)}
    assert len(one_sensor_laws(two)) == 2 * len(VALUES)
    found = named("sensor-resonance", f"mount-at-{FAR:g}")
    assert found is not None and found.variant == f"mount-at-{FAR:g}"
    assert (
        named("sensor-resonance", "mount-at-the-tip") is None
    )  # a damaged model file is refused as of no version
    assert named("sensor-resonance", "mount") is None and named("gravity", f"mount-at-{FAR:g}") is None


def test_a_tilt_that_shows_by_its_cosine_alone_is_likelier_a_gain(two):
    tilt = law(two, "radial")
    assert foreknown([ActiveEffect(tilt, (0.0,))]) == 0.0
    assert foreknown([ActiveEffect(tilt, (BY_EYE,))]) == pytest.approx(-0.5)
    assert foreknown([ActiveEffect(tilt, (0.5,))]) == -MOST
    assert foreknown([ActiveEffect(law(two, "accelerometer"), (0.93,))]) == 0.0
