"""A diagnosed model applied to new runs: every declared output channel from the run's inputs alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.model_file import read_model_json, sensor_of
from jointscope.recordings.campaign import Campaign, Signal


def predict_campaign(
    model: Mapping[str, Any], campaign: Campaign
) -> dict[str, list[tuple[Signal, NDArray[np.float64]]]]:
    """Predict every run of ``campaign`` by the model of a ``model.json`` of kind "diagnosis".

    Args:
        model: The file's content.
        campaign: Inputs are read; output columns may be absent.

    Returns:
        Per run id, one (signal, prediction) for every channel with ``role = "output"`` in file order; the prediction
        has one value per sample of its stream, in the channel's SI unit.

    Raises:
        RefusedError: The model is of another kind or version, or no run holds an input.
    """
    from jointscope.diagnosis.predict import free_prediction
    from jointscope.diagnosis.prepare import prepare_inputs
    from jointscope.diagnosis.seen_weight import weightless
    from jointscope.diagnosis.starts import inverted
    from jointscope.diagnosis.unscaled import rescaled

    problem = prepare_inputs(campaign)
    _, theta, effects = read_model_json(model, problem)
    predictions: dict[str, list[tuple[Signal, NDArray[np.float64]]]] = {}
    for run in problem.runs:
        signals = {(s.device, s.stream.channels.index(s.channel)): s for s in run.run.signals}
        stated = {o.channel: _stated(model, sensor_of(run.run, signals[o.channel])) for o in run.declared}
        run = weightless(run, {c for c, s in stated.items() if not s.get("weighs", True)})
        arrays = free_prediction(run, theta, effects, problem)
        predictions[run.run.id] = []
        for declared, y in zip(run.declared, arrays, strict=True):
            signal, known = signals[declared.channel], stated[declared.channel]
            output = inverted(declared, run) if known.get("polarity", 1.0) < 0.0 else declared
            output = rescaled(output, known.get("scale", 1.0))
            predictions[run.run.id].append((signal, output.recorded(y) + known.get("offset", 0.0)))
    return predictions


def _stated(model: Mapping[str, Any], sensor: Mapping[str, Any]) -> dict[str, Any]:
    """What the model's file says of a sensor; nothing where it is as it should be."""
    return next((s for s in model.get("sensors", ()) if sensor.items() <= s.items()), {})
