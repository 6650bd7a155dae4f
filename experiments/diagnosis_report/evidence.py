"""The evidence, plot by plot, in the order in which a lab engineer would check the answer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jointscope.experiments.charts.chart import Chart, Missing, Panel, Series
from jointscope.experiments.charts.files import write_files
from jointscope.experiments.diagnosis_report.balance import balance
from jointscope.experiments.diagnosis_report.figures import against_level, against_motion, time_and_band
from jointscope.experiments.diagnosis_report.hits import hit_of, hits_chart, hits_unit
from jointscope.experiments.diagnosis_report.orders import orders_chart
from jointscope.experiments.diagnosis_report.responses import response_chart
from jointscope.experiments.diagnosis_report.traces import Models, Trace, telling
from jointscope.experiments.diagnosis_report.windup import windup_chart
from jointscope.experiments.page import Section

_AXES = {
    "wind-up": "rad", "wind-up-rate": "rad/s", "stiffness-by-angle": "rad", "velocity": "rad/s", "position": "rad", "time": "s",
    "motor-velocity": "rad/s at the output", "velocity-sign": "rad/s",
}  # fmt: skip


def evidence(models: Models, traces: Sequence[Trace], answer: dict[str, Any], folder: Path) -> list[Section]:
    """All sections; every chart's PNG and CSV are written to ``folder``."""
    corrected = bool(models.effects)
    hits = tuple(h for run in models.problem.runs if (h := hit_of(run.run)) is not None)
    unit = hits_unit(tuple(run.run for run in models.problem.runs))
    pairs = tuple(time_and_band(trace, corrected=corrected) for trace in telling(traces).values())
    responses = tuple(response_chart(models, traces, experiment) for experiment in ("hammer", "torque-sweep"))
    against_speed, against_position = against_motion(balance(models))
    black_box = black_box_chart(answer)
    sections = [
        Section(
            heading="Recorded and predicted",
            text=("The runs that show most, one per kind of experiment, held out where any were.",),
            tabs=pairs or (Missing("Recorded and predicted", "a recorded output"),),
        ),
        Section(heading="Hits and their force", charts=(hits_chart(hits, unit),)),
        Section(heading="Frequency response", tabs=responses),
        Section(heading="The reducer's loop", charts=(windup_chart(models),)),
        Section(
            heading="What the residual depends on",
            tabs=(
                against_speed,
                against_position,
                against_level(traces, corrected=corrected),
                orders_chart(models, traces, answer),
            ),
        ),
        *([Section(heading="A force without a name", charts=(black_box,))] if black_box is not None else []),
    ]
    for chart in charts_of(sections):
        write_files(chart, folder)
    return sections


def charts_of(sections: Sequence[Section]) -> Iterator[Chart]:
    """Every chart that is drawn."""
    for section in sections:
        yield from (c for c in (*section.charts, *section.tabs) if isinstance(c, Chart))


def black_box_chart(answer: dict[str, Any]) -> Chart | None:
    """The law of the nameless force that was fitted beside the named effects, or None where none was."""
    box = answer.get("black_box")
    if not box or not box.get("nodes") or not box.get("torque"):
        return None
    x, y = (np.asarray(box[key], dtype=np.float64) for key in ("nodes", "torque"))
    if x.shape != y.shape:
        return None
    on = str(box.get("depends_on") or "its variable")
    held = box.get("held_out_error")
    error = "" if held is None else f" Held-out error with it: {100.0 * held:.3g} %."
    return Chart(
        stem="black-box",
        label="A force without a name",
        shows=f"A force at the {box['location']} that may be any function of the {on}, nine nodes, fitted to the same runs: "
        f"what flexibility alone buys, beside the named law.{error}",
        reading="a named effect is worth more than this flexibility where its held-out error is lower; the curve's shape "
        "(a step, a slope, a dead zone, a bend) says which law to look for.",
        panels=(
            Panel(
                title="Its law",
                x_label=f"{on} [{_AXES.get(on, 'SI')}]",
                y_label="force or torque at the output [N m]",
                series=(Series(name="fitted force", x=x, y=y, look="recorded"),),
                height=260,
            ),
        ),
    )
