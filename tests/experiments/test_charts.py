"""One description, three outputs: what the page draws is what the CSV holds."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from jointscope.experiments.charts.chart import Chart, Heat, Panel, Series, domain
from jointscope.experiments.charts.files import columns, plain, write_files
from jointscope.experiments.charts.looks import LOOKS
from jointscope.experiments.charts.svg import FULL, chart_markup, look_rules, thinned
from jointscope.experiments.charts.ticks import label, round_step, ticks


def chart(*panels, columns=1):
    return Chart(stem="c", label="label", shows="Shows.", reading="so.", panels=panels, columns=columns)


def panel(*series, **rest):
    return Panel(title="T", x_label="x [s]", y_label="y [m]", series=series, **rest)


def points(path):
    """The absolute points of a line's path."""
    found = []
    for piece in path.split("M")[1:]:
        numbers = [int(n) for n in re.findall(r"-?\d+", piece)]
        x, y = numbers[:2]
        found.append((x, y))
        for dx, dy in zip(numbers[2::2], numbers[3::2], strict=False):
            x, y = x + dx, y + dy
            found.append((x, y))
    return np.array(found)


def lines(markup):
    root = ElementTree.fromstring(markup)
    box = next(e for e in root.iter("svg") if e.get("class") == "box")
    return [e.get("d") for e in box.iter("path") if e.get("data-s") is not None]


@pytest.mark.parametrize("log", [False, True])
def test_a_drawn_line_gives_back_its_numbers(log):
    x = np.linspace(1.0, 3.0, 50)
    y = np.exp(2.0 * x)
    one = panel(Series(name="a", x=x, y=y, look="recorded"), y_log=log)
    (x0, x1), (y0, y1) = domain(one)
    (d,) = lines(chart_markup(chart(one)))
    u, v = points(d).T / FULL
    back = y0 + (1.0 - v) * (y1 - y0)
    assert x0 + u * (x1 - x0) == pytest.approx(x, abs=2e-5 * (x1 - x0))
    assert (10.0**back if log else back) == pytest.approx(y, rel=1e-3, abs=2e-5 * y.max())


def test_a_gap_breaks_the_line_and_nothing_negative_stands_on_a_logarithmic_axis():
    y = np.array([1.0, 2.0, np.nan, 3.0, -1.0, 4.0, 5.0])
    (d,) = lines(chart_markup(chart(panel(Series(name="a", x=np.arange(7.0), y=y, look="base"), y_log=True))))
    assert d.count("M") == 3 and len(points(d)) == 5


def test_thinning_keeps_ends_order_and_every_peak():
    x = np.arange(100_000.0)
    y = np.sin(x / 300.0)
    y[54_321] = 9.0
    u, v = thinned(x, y, 2000)
    assert u.size <= 2100 and np.all(np.diff(u) > 0.0)
    assert u[0] == x[0] and u[-1] == x[-1] and v.max() == 9.0 and v.min() == y.min()


def test_every_look_is_told_apart_without_colour_among_those_drawn_together():
    for names in (("recorded", "base", "corrected", "noise"), ("level-1", "level-2", "level-3", "level-4"),
                  ("motor-order", "output-order", "noise")):  # fmt: skip
        assert len({LOOKS[name].dash for name in names}) == len(names)
    assert all(f".s.{name}{{" in look_rules() for name in LOOKS)


def test_series_are_named_once_in_the_legend_and_switch_every_panel():
    s = Series(name="a & b", x=np.arange(3.0), y=np.arange(3.0), look="base")
    other = Series(name="c", x=np.arange(3.0), y=np.arange(3.0), look="corrected")
    root = ElementTree.fromstring(chart_markup(chart(panel(s, other), panel(s), columns=2)))
    keys = [b for b in root.iter("button")]
    assert ["".join(b.itertext()) for b in keys] == ["a & b", "c"]
    assert [p.get("data-s") for p in root.iter("path") if p.get("data-s")] == ["0", "1", "0"]


def test_a_map_covers_its_cells_once_and_leaves_gaps_empty():
    value = np.array([[0.0, 1.0, np.nan], [2.0, 2.0, 3.0]])
    heat = Heat(np.arange(4.0), np.arange(3.0), value, "dB")
    root = ElementTree.fromstring(chart_markup(chart(panel(heat=heat))))
    cells = [c for p in root.iter("path") if p.get("class") == "heat" for c in p.get("d").split("z") if c]
    area = 0
    for cell in cells:
        a, b, c, d = (int(n) for n in re.findall(r"-?\d+", cell)[:4])
        area += abs((c - a) * (d - b))
    assert area == pytest.approx(FULL**2 * 5 / 6, rel=1e-3)


def test_the_csv_holds_every_series_and_shares_an_abscissa(tmp_path):
    x = np.arange(5.0)
    both = chart(panel(Series(name="a", x=x, y=x**2, look="base"), Series(name="b", x=x, y=-x, look="corrected")))
    table = columns(both)
    assert list(table) == ["x_s", "a_y_m", "b_y_m"] and np.array_equal(table["a_y_m"], x**2)
    write_files(both, tmp_path)
    assert np.array_equal(np.genfromtxt(tmp_path / "c.csv", delimiter=",", names=True)["b_y_m"], -x)
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")


def test_names_for_a_header_keep_their_units():
    assert plain("q'' [rad/s²] (95 %)") == "q_dd_rad_s2_95_percent"


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-3e-6, 4e-6), (0.2, 1e7), (99.99, 100.01)])
def test_ticks_lie_inside_are_round_and_all_different(low, high):
    found = ticks(low, high, log=False, most=6)
    assert 2 <= len(found) <= 8 and all(low - 1e-9 <= at <= high + 1e-9 for at, _ in found)
    assert len({text for _, text in found}) == len(found)
    assert found[1][0] - found[0][0] == pytest.approx(round_step(found[1][0] - found[0][0]))


@pytest.mark.parametrize(("low", "high"), [(-6.0, 3.0), (0.0, 1.2), (1.0, 1.3)])
def test_ticks_of_a_logarithmic_axis_say_their_value(low, high):
    for at, text in ticks(low, high, log=True, most=6):
        assert float(text) == pytest.approx(10.0**at, rel=0.02)


def test_labels_are_short():
    assert [label(v, 1.0) for v in (0.0, 0.5, -2.0, 1e6, 2.5e-7)] == ["0", "0.5", "-2", "1e6", "2.5e-7"]


def test_the_legend_of_a_png_goes_where_no_points_are():
    from matplotlib.figure import Figure

    from jointscope.experiments.charts.png import emptiest_corner

    x = np.linspace(0.0, 1.0, 50)
    for y, corner in ((x, "upper left"), (1.0 - x, "upper right"), (np.where(x > 0.2, 1.0, x), "lower right")):
        drawn = panel(Series(name="a", x=x, y=y, look="base", mark="o"))
        ax = Figure().subplots()
        ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        assert emptiest_corner(ax, drawn) == corner
