"""Pictures of a sensitivity study: bars with intervals, FRF band, heat map over stiffness and damping."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jointscope.atomic import replaced_file, write_text
from jointscope.experiments.charts.chart import Chart, Panel, Series
from jointscope.experiments.sensitivity import outputs
from jointscope.experiments.sensitivity.analysis import Index
from jointscope.experiments.sensitivity.study import OUTPUTS, Study

TITLES = {
    "sobol": "share of the variance [-]: total (dark) and alone (light)",
    "morris": "mean absolute elementary effect, mu*",
    "local": "elasticity d ln y / d ln p [-]  (d y / d ln p [dB] for the prediction error)",
}


def _save(figure: Figure, path: Path) -> Path:
    with replaced_file(path) as temporary:
        figure.savefig(temporary, dpi=130, format="png")
    return path


def bars(study: Study, indices: tuple[Index, ...], path: Path) -> Path:
    """A tornado per output, the strongest factor on top."""
    shown = [name for name in study.outputs]
    figure = Figure(figsize=(4.2 * min(3, len(shown)), 3.1 * -(-len(shown) // 3)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(-(-len(shown) // 3), min(3, len(shown)))).ravel()
    for axis in axes[len(shown) :]:
        axis.set_visible(False)
    for axis, output in zip(axes, shown, strict=False):
        own = sorted((index for index in indices if index.output == output), key=lambda index: abs(index.total))
        at = np.arange(len(own))
        total = [index.total for index in own]
        axis.barh(
            at,
            total,
            xerr=[i.total_interval for i in own],
            color="#1f5a91",
            ecolor="#333333",
            capsize=2,
            height=0.62,
        )
        if study.method == "sobol":
            axis.barh(at, [index.first for index in own], color="#9cc3e6", height=0.28)
        axis.set_yticks(at, [index.factor.replace("_", " ") for index in own], fontsize=8)
        axis.axvline(0.0, color="#333333", lw=0.8)
        unit = f" [{OUTPUTS[output]}]" if study.method == "morris" else ""
        axis.set_title(output.replace("_", " ") + unit, fontsize=9)
        axis.tick_params(axis="x", labelsize=8)
    figure.suptitle(TITLES[study.method], fontsize=10)
    return _save(figure, path)


def frf_chart(study: Study) -> Chart:
    """Motor torque and hammer to arm acceleration over the studied ranges: 5-95 % band and the nominal line."""
    f = np.linspace(1.0, 100.0, 500)
    rng = np.random.default_rng(study.seed)
    p = {
        key: np.full((400, 1), float(getattr(study.nominal, key)))
        for key in type(study.nominal).__dataclass_fields__
    }
    for factor in study.factors:
        p[factor.name] = rng.uniform(factor.lower, factor.upper, (400, 1))
    nominal = {key: np.array([[float(getattr(study.nominal, key))]]) for key in p}
    panels = []
    for which, title, unit in (
        (0, "Hammer: q'' / T_L", "[rad/s² per N m]"),
        (1, "Motor: q'' / T_e", "[rad/s² per N m on the shaft]"),
    ):
        spread = np.abs(outputs.transfers(p, 2j * np.pi * f)[which])
        low, high = np.quantile(spread, (0.05, 0.95), axis=0)
        middle = np.abs(outputs.transfers(nominal, 2j * np.pi * f)[which][0])
        series = (
            Series(name="5-95 % of the studied range", x=f, y=high, low=low, look="faint"),
            Series(name="nominal", x=f, y=middle, look="recorded"),
        )
        panels.append(
            Panel(
                title=title,
                x_label="frequency [Hz]",
                y_label=unit,
                series=series,
                y_log=True,
                link="f",
                height=270,
            )
        )
    varied = ", ".join(factor.name.replace("_", " ") for factor in study.factors)
    return Chart(
        stem="frf-bands",
        label="Frequency response over the ranges",
        shows=f"What varying {varied} does to the two responses.",
        reading="where the band is wide the response follows the varied parameters; where it is a line it does not.",
        panels=tuple(panels),
    )


def heat_map(study: Study, path: Path) -> Path:
    """Prediction error [dB] when stiffness and damping are wrong by so many per cent."""
    K = np.linspace(-30.0, 30.0, 41)
    c = np.linspace(-80.0, 120.0, 41)
    grid = np.array(
        [[study.nominal.stiffness * (1 + a / 100), study.nominal.damping * (1 + b / 100)] for b in c for a in K]
    )
    error = np.concatenate(
        [
            outputs.evaluate(study.nominal, ("stiffness", "damping"), grid[at : at + 256])["prediction_error"]
            for at in range(0, len(grid), 256)
        ]
    )
    rows = np.column_stack([np.tile(K, c.size), np.repeat(c, K.size), error])
    lines = [",".join(f"{value:.6g}" for value in row) for row in rows]
    head = "stiffness_wrong_by_percent,damping_wrong_by_percent,prediction_error_dB"
    write_text(path.with_suffix(".csv"), "\n".join([head, *lines]) + "\n")
    figure = Figure(figsize=(7.0, 5.2), layout="constrained")
    axis = figure.subplots()
    image = axis.contourf(K, c, error.reshape(len(c), len(K)), levels=12, cmap="viridis")
    contours = axis.contour(
        K, c, error.reshape(len(c), len(K)), levels=[0.5, 1.0, 2.0, 3.0], colors="white", linewidths=0.9
    )
    axis.clabel(contours, fmt="%g dB", fontsize=8)
    figure.colorbar(image, ax=axis, label="rms error of the predicted spectrum, 10-75 Hz [dB]")
    axis.plot(0, 0, "+", color="white", ms=10)
    axis.set_xlabel("stiffness wrong by [%]")
    axis.set_ylabel("damping wrong by [%]")
    axis.set_title("what a wrong parameter costs the vibration prediction", fontsize=10)
    return _save(figure, path)
