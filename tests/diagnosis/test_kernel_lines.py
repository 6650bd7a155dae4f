"""What repeats with the turn in the compiled joint: its sine, and what of it the momentum balance sees."""

import sys
from pathlib import Path

import numpy as np

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.kernel.laws import turned

sys.path.insert(0, str(Path(__file__).parent))
from packed_joint import packed, run  # type: ignore[import-not-found]


def test_a_line_is_its_sine_however_the_argument_gets_there():
    """Expanded about an angle nearby: slow and fast, backwards, and by leaps; what is held is taken anew on the way."""
    rng = np.random.default_rng(2)
    path = np.concatenate(
        [
            np.linspace(0.0, 3.0, 400),
            np.linspace(3.0, -40.0, 300),
            rng.uniform(-1e3, 1e3, 300),
            [7.0, 7.0, 7.25, 6.75],
        ]
    )
    mem = np.array([1e9, 0.0, 0.0])
    told = np.array([turned(arg, mem, 0) for arg in path])
    assert np.max(np.abs(told - np.column_stack([np.sin(path), np.cos(path)]))) < 2e-8
    assert mem[0] != 1e9


def test_kinematic_error_cancels_in_the_momentum_balance_and_ripple_does_not():
    """J_M q_s'' + J_L q'' = tau: T_S is internal, whatever it does; ripple is an outside torque."""
    drive = lambda t: np.full(t.size, 20.0)  # noqa: E731
    for number, unbalanced in ((dict(N_TE=1), False), (dict(N_RIPPLE=1), True)):
        P, S = packed(MOTOR=k.MOTOR_FREE, C=50.0, **number)
        if unbalanced:
            P[k.RIPPLE_0 : k.RIPPLE_0 + 4] = (2.0, 0.0, 141.0, 0.3)
        else:
            P[k.TE_0 : k.TE_0 + 4] = (5e-5, 141.0, 0.0, 0.3)
        _, out = run(P, S, um=drive, x=(0, 0.2, 0, 0.2))
        balance = 9.1 * out[:, k.X_AS] + 3.0 * out[:, k.X_A] - 20.0
        assert (np.abs(balance).max() > 1.0) == unbalanced
        if not unbalanced:
            assert np.ptp(out[:, k.X_TS][1000:]) > 1.0  # the error is there all the same
            assert np.abs(balance).max() < 1e-9
