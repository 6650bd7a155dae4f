"""Measure the simulator's own error, so that it is known before anything is concluded from a simulation.

One pulse of motor torque on the free joint and one hammer hit on the braked one are stepped in MuJoCo and sampled by
the same functions that `jointscope simulate` uses. The frequency responses are compared with the closed form of the
two-inertia joint (Li et al., Sensors 2022, 22(16), 6170, Equations 7 and 19) from 0.5 to 100 Hz.

Exit code 0 when every error is within 0.1 % in magnitude and 0.1 degree in phase, else 1.

examples:
  jointscope selfcheck
  jointscope selfcheck --json
"""

from __future__ import annotations

import argparse


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--json", action="store_true", help="for machines: one line, magnitude errors relative")
    parser.add_argument(
        "--timestep",
        type=float,
        default=None,
        metavar="S",
        help="step to be tried [s]; the simulator's own by default",
    )


def run(options: argparse.Namespace) -> int:
    """Measure and print; 1 when a limit is exceeded."""
    import json
    from dataclasses import asdict

    from jointscope.errors import JointscopeError
    from jointscope.models.paper import paper_rig
    from jointscope.sim.calibration import MAGNITUDE_LIMIT, PHASE_LIMIT, calibrate
    from jointscope.sim.stepping import TIMESTEP

    timestep = TIMESTEP if options.timestep is None else options.timestep
    if not 1e-6 <= timestep <= 1e-3:
        raise JointscopeError(f"--timestep {timestep}: choose between 1e-6 and 1e-3 s")
    found = calibrate(paper_rig(), timestep)
    if options.json:
        print(json.dumps(asdict(found)))
        return 0 if found.passed else 1
    print(f"FRF of the stepped model against the closed form, 0.5-100 Hz, step {timestep:g} s")
    for name, deviation in (("motor torque", found.motor), ("hammer", found.hammer)):
        print(
            f"  {name:<13} magnitude {100.0 * deviation.magnitude_error:.4f} %   phase {deviation.phase_error_deg:.4f} deg"
            f"   {'ok' if deviation.within_limits else 'TOO LARGE'}"
        )
    print(f"limits: {100.0 * MAGNITUDE_LIMIT:g} % and {PHASE_LIMIT:g} deg")
    return 0 if found.passed else 1
