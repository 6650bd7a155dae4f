"""``model.json`` as another version wrote it is refused in one line, never read as something else."""

from dataclasses import asdict

import pytest

from jointscope.diagnosis.model_file import KIND, read_model_json
from jointscope.errors import RefusedError

LINE = {"amplitude": 1e-5, "order": 1.0, "phase": 0.3}


def model_of(problem, **parameters):
    effect = {"effect": "transmission-error", "location": "transmission", "variant": "motor-order-harmonic"}
    base = dict(zip(problem.base.names, map(float, problem.base.start), strict=True))
    return {
        "kind": KIND,
        "rig": asdict(problem.rig),
        "base": base,
        "effects": [{**effect, "parameters": parameters}],
    }


def test_harmonics_in_shares_are_not_read_as_angles(problem):
    """They were shares of the amplitude under other names once."""
    with pytest.raises(RefusedError, match=r"parameters\.second_sine is missing; diagnose the campaign again"):
        read_model_json(model_of(problem, **LINE, harmonic_sine=0.2, harmonic_cosine=0.1), problem)


def test_what_was_written_is_read(problem):
    harmonics = {"second_sine": 1e-6, "second_cosine": 0.0, "third_sine": 0.0, "third_cosine": 2e-6}
    _, theta, (effect,) = read_model_json(model_of(problem, **LINE, **harmonics), problem)
    assert effect.values == (1e-5, 1.0, 0.3, 1e-6, 0.0, 0.0, 2e-6)
    assert theta == pytest.approx(problem.base.start)
