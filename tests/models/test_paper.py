"""The paper's printed numbers agree with each other and are data, not code."""

import pytest

from jointscope.models.joint import antiresonance, series_stiffness
from jointscope.models.paper import paper, paper_rig, printed_agreement


@pytest.mark.parametrize("figure", printed_agreement(), ids=lambda f: f"{f.where}, {f.quantity}")
def test_printed_tables_follow_from_printed_equations(figure):
    """(21) on (26) is Table 2 and (24) on (27) is Table 4, within the rounding of the printed coefficients."""
    assert abs(figure.relative_error) <= 0.007


def test_printed_equation_25_divides_by_the_wrong_coefficient():
    """K~ = a2/b1; dividing a2 by a1, as (25) is printed, misses Table 4 by orders of magnitude."""
    term, column = paper().equation27[0], paper().table4[0]
    assert term.stiffness == pytest.approx(column.stiffness, rel=1e-6)
    assert term.a2 / term.a1 < 0.02 * column.stiffness


def test_reference_stiffness_is_a_catalogue_figure():
    """168,449.59 N m/rad is 49 N m/arcmin."""
    import math

    assert paper().table1.reducer_stiffness == pytest.approx(49.0 * 60.0 * 180.0 / math.pi, rel=1e-6)


def test_reference_damping_is_two_per_cent_of_critical():
    """30.27 N m s/rad is 2 zeta sqrt(K J) with zeta = 2 % and the reference K and J."""
    reference = paper().table2_reference
    assert reference.damping == pytest.approx(0.04 * (reference.stiffness * reference.inertia) ** 0.5, rel=1e-3)


def test_ratio_fits_the_printed_speed():
    """n = 141 brings the arm through 120 degrees in 2.4 s of triangular speed at 246 rad/s on the motor."""
    import math

    n = paper().inferred["reduction_ratio"]
    assert math.radians(120.0) / 1.2 * n == pytest.approx(246.0, rel=1e-3)


def test_rig_rings_where_its_figures_say():
    """sqrt(K/J_L) of the identified figures is 40.3 Hz."""
    assert antiresonance(paper_rig().joint) / 6.283185307 == pytest.approx(40.3, abs=0.05)


def test_stiffness_in_series_is_below_its_softest_part():
    """1/K = sum of 1/K_i (1)."""
    assert series_stiffness(2.0, 2.0) == 1.0
    assert series_stiffness(1e5, 1e12) == pytest.approx(1e5, rel=1e-6)
