"""A diagnosed model applied to new runs: every declared output channel from the run's inputs alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.model_file import read_model_json
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

    problem = prepare_inputs(campaign)
    _, theta, effects = read_model_json(model, problem)
    predictions: dict[str, list[tuple[Signal, NDArray[np.float64]]]] = {}
    for run in problem.runs:
        signals = {(s.device, s.stream.channels.index(s.channel)): s for s in run.run.signals}
        arrays = free_prediction(run, theta, effects, problem)
        predictions[run.run.id] = [
            (signals[output.channel], output.polarity * (np.asarray(y, dtype=np.float64) + output.offset))
            for output, y in zip(run.declared, arrays, strict=True)
        ]
    return predictions
