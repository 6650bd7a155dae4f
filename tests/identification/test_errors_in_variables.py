"""The likelihood: its inverse covariance, its gradient, and that it has no bias where H1 has."""

import numpy as np
import pytest

from jointscope.identification.errors_in_variables import InverseCovariance, Scatter, whiten
from jointscope.identification.hit_scatter import random_effect
from jointscope.identification.hit_spectra import Hit, read_hit
from jointscope.identification.modal_model import single_mode


def test_woodbury_is_the_inverse() -> None:
    columns = np.random.default_rng(0).standard_normal((30, 4))
    full = np.linalg.inv(np.eye(30) + columns @ columns.T)
    np.testing.assert_allclose(InverseCovariance(columns)(np.eye(30)), full, atol=1e-12)


@pytest.mark.parametrize("truncated", [False, True])
def test_the_gradient_is_the_derivative_of_the_profiled_cost(make_campaign, truncated: bool) -> None:
    """Envelope theorem: with the force corrected, -2 J' C^-1 r is exact though C depends on the parameters."""
    from dataclasses import replace

    campaign = make_campaign(hits=1, force=0.05)
    hit = read_hit(campaign.runs[0], campaign.rig)
    assert isinstance(hit, Hit)
    spectrum = replace(hit.spectrum.in_band((10.0, 60.0)), truncated=truncated)
    noise = np.full(spectrum.output.shape, 0.3 * float(np.abs(spectrum.output).mean()))
    scatter = Scatter()
    at = single_mode(b1=0.33, a1=20.0, a2=6.4e4)

    def cost(vector: np.ndarray) -> float:
        white = whiten(at.with_vector(vector), spectrum, noise, scatter)
        return float(white.residual @ white.solver()(white.residual))

    white = whiten(at, spectrum, noise, scatter)
    gradient = -2.0 * white.sensitivity.T @ white.solver()(white.residual)
    for k, value in enumerate(at.vector()):
        step = 1e-5 * value
        up, down = at.vector(), at.vector()
        up[k] += step
        down[k] -= step
        assert gradient[k] == pytest.approx((cost(up) - cost(down)) / (2 * step), rel=2e-3)


def test_a_random_effect_is_found_where_it_is_and_nil_where_it_is_not() -> None:
    rng = np.random.default_rng(1)
    noise = rng.uniform(0.5, 1.5, 400)
    values = rng.standard_normal(400) * noise
    assert random_effect(values + 2.0 * rng.standard_normal(400), noise) == pytest.approx(4.0, rel=0.25)
    assert random_effect(values, noise) < 0.15
    assert random_effect(values[:1], noise[:1]) == 0.0
