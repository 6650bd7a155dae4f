"""From a study to sensitivities: local elasticities against closed form, Morris screening, Sobol indices with intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.sensitivity.study import OUTPUTS, Study

Array = NDArray[np.float64]
Evaluate = Callable[[Array], Array]

LOCAL_STEP = 1e-4  # of the value: central differences, error of the order of its square


@dataclass(frozen=True, kw_only=True)
class Index:
    """One sensitivity of one output to one factor.

    Attributes:
        total: Sobol total index [-], Morris mu* [unit of the output], or local elasticity d ln y / d ln p [-]
            (d y / d ln p [dB] for the prediction error).
        total_interval: Half width of its 95 % interval; 0 for local ones.
        first: Sobol first-order index [-] or Morris sigma [unit of the output]; ``nan`` for local ones.
        first_interval: Half width of its 95 % interval.
    """

    output: str
    factor: str
    total: float
    total_interval: float = 0.0
    first: float = float("nan")
    first_interval: float = 0.0


def problem(study: Study) -> dict[str, Any]:
    """The study in SALib's terms."""
    return {
        "num_vars": len(study.factors),
        "names": [factor.name for factor in study.factors],
        "bounds": [[factor.lower, factor.upper] for factor in study.factors],
    }


def _seed(study: Study) -> int:
    return study.seed + 1  # SALib takes 0 for "no seed"


def draw(study: Study) -> Array:
    """The parameter sets to evaluate [SI], shape (n, factors): N (k + 2) for Sobol, N (k + 1) for Morris, 2 k + 1 local."""
    if study.method == "local":
        centre = np.array([getattr(study.nominal, factor.name) for factor in study.factors])
        steps = np.vstack([np.zeros(len(centre)), *(s * np.diag(centre * LOCAL_STEP) for s in (1.0, -1.0))])
        return np.asarray(centre + steps)
    if study.method == "morris":
        from SALib.sample import morris

        return np.asarray(morris.sample(problem(study), study.samples, num_levels=8, seed=_seed(study)))
    from SALib.sample import sobol

    return np.asarray(sobol.sample(problem(study), study.samples, calc_second_order=False, seed=_seed(study)))


def _local(study: Study, table: Array) -> list[Index]:
    k = len(study.factors)
    indices = []
    for column, output in enumerate(OUTPUTS):
        base, up, down = table[0, column], table[1 : k + 1, column], table[k + 1 :, column]
        slope = (up - down) / (2.0 * LOCAL_STEP)
        if output == "prediction_error":
            slope = (up + down) / (2.0 * LOCAL_STEP)  # zero at the nominal set and grows both ways
        elif base != 0.0:
            slope = slope / base
        indices += [
            Index(output=output, factor=factor.name, total=float(value))
            for factor, value in zip(study.factors, slope, strict=True)
        ]
    return indices


def analyse(study: Study, sample: Array, table: Array) -> tuple[Index, ...]:
    """Sensitivities of the watched outputs.

    Args:
        study: As evaluated.
        sample: From ``draw``, shape (n, factors).
        table: From ``evaluate_sample``, shape (n, len(OUTPUTS)).

    Returns:
        One index per watched output and factor.
    """
    if study.method == "local":
        return tuple(index for index in _local(study, table) if index.output in study.outputs)
    indices = []
    columns: tuple[Array, Array, Array, Array]
    for column, output in enumerate(OUTPUTS):
        if output not in study.outputs:
            continue
        y = table[:, column]
        if study.method == "morris":
            from SALib.analyze import morris

            found = morris.analyze(problem(study), sample, y, num_levels=8, seed=_seed(study))
            columns = (found["mu_star"], found["mu_star_conf"], found["sigma"], np.zeros(len(study.factors)))
        elif np.ptp(y) == 0.0:  # an output that nothing moves has no variance to share out
            columns = (np.zeros(len(study.factors)),) * 4
        else:
            from SALib.analyze import sobol

            found = sobol.analyze(problem(study), y, calc_second_order=False, seed=_seed(study))
            columns = (found["ST"], found["ST_conf"], found["S1"], found["S1_conf"])
        indices += [
            Index(
                output=output,
                factor=f.name,
                total=float(a),
                total_interval=float(b),
                first=float(c),
                first_interval=float(d),
            )
            for f, a, b, c, d in zip(study.factors, *columns, strict=True)
        ]
    return tuple(indices)


def sentence(study: Study, indices: tuple[Index, ...], output: str) -> str:
    """What the numbers of one output mean, in words."""
    own = sorted((index for index in indices if index.output == output), key=lambda index: -abs(index.total))
    first = own[0]
    name = first.factor.replace("_", " ")
    what = output.replace("_", " ")
    if study.method == "sobol":
        if first.total <= 0.0:
            return f"Nothing in these ranges moves the {what}."
        rest = [index.factor.replace("_", " ") for index in own if index.total + index.total_interval < 0.01]
        idle = f" {', '.join(rest).capitalize()} may stay rough: each explains less than 1 %." if rest else ""
        return (
            f"The {what} varies mostly through the {name}: {min(100 * first.total, 100.0):.0f} % of its variance "
            f"(± {100 * first.total_interval:.0f} % at 95 %).{idle}"
        )
    if study.method == "morris":
        return f"Across its range the {name} moves the {what} most, by {first.total:.3g} {OUTPUTS[output]} on average."
    unit = "dB" if output == "prediction_error" else "%"
    return f"One per cent more {name} changes the {what} by {first.total * (0.01 if unit == 'dB' else 1.0):+.3g} {unit}."
