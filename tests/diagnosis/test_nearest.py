"""The trial that comes nearest to the data is found without finishing those that are beyond it already."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import Objective, whitened
from jointscope.diagnosis.predict import predict_outputs


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("first", [0, 3])
def test_the_nearest_trial_is_the_one_of_least_misfit(problem, truth, workers, first):
    """Whatever the number of threads and the order; runs of a trial that is worse than another one are not simulated."""
    simulated = []

    def predict(run, theta, effects, whole):
        simulated.append(run.run.id)
        return predict_outputs(run, theta, effects, whole)

    k = problem.base.names.index("stiffness")
    trials = []
    for factor in np.roll([0.7, 1.3, 0.98, 1.001, 1.5, 0.8, 2.0, 0.5], first):
        theta = truth.copy()
        theta[k] *= factor
        trials.append((theta, ()))
    with ThreadPoolExecutor(workers) as pool:
        own = Objective(problem, predict, (0, 1, 2), pool)
        own = whitened(own, white(own.prepared), None)
        costs = [own.misfit(*trial) for trial in trials]
        simulated.clear()
        assert own.nearest(trials) == int(np.argmin(costs))
        assert len(simulated) < 3 * len(trials)
        assert own.nearest([trials[0], trials[0]]) == 0
