"""Step a diagnosis' held-out runs in MuJoCo, with and without the effect it named.

  jointscope diagnose bench-a --out out/diagnosis
  jointscope confirm out/diagnosis

A diagnosis fits and judges its effects with a reduced model of its own. DIR also holds that model as MJCF, base.xml and
augmented.xml, and in effects.json the laws that MJCF has no element for (faults of the recording among them). This
command runs both on the inputs of the runs that were kept back and compares them with what was recorded: the error that
the effect takes away must be 0.9 to 1.1 of what the diagnosis claims. Nothing of the diagnosis' own code takes part.

DIR then holds
  confirm.json   errors per run and channel, the gain, and its ratio to the reduced model's
  confirm.png    recorded, base and augmented, in time and frequency

Exit code 0 when confirmed, 1 when the ratio is outside, 2 when there is nothing to confirm (no effect, no held-out run).
"""

from __future__ import annotations

import argparse
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("directory", type=Path, metavar="DIR", help="folder written by jointscope diagnose")
    parser.add_argument(
        "--campaign", type=Path, default=None, help="the recordings, where they have moved since the diagnosis"
    )
    parser.add_argument(
        "--timestep",
        type=float,
        default=None,
        metavar="S",
        help="of MuJoCo [s] (default: 1e-4, finer for modes above 100 Hz)",
    )
    parser.add_argument("--no-picture", action="store_true", help="write confirm.json only")
    parser.add_argument("--json", action="store_true", help="print confirm.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Confirm; 1 when MuJoCo's gain is not the diagnosis'."""
    import json

    from jointscope.atomic import write_text
    from jointscope.errors import JointscopeError
    from jointscope.experiments.confirm import (
        LIMITS,
        confirm,
        confirmation_json,
        write_confirmation,
    )

    if options.timestep is not None and not 1e-6 <= options.timestep <= 1e-3:
        raise JointscopeError(f"--timestep {options.timestep}: choose between 1e-6 and 1e-3 s")
    found = confirm(options.directory, campaign=options.campaign, timestep=options.timestep)
    text = json.dumps(confirmation_json(found), indent=2, allow_nan=False) + "\n"
    if options.no_picture:
        write_text(options.directory / "confirm.json", text)
    else:
        write_confirmation(found, options.directory)
    if options.json:
        print(text, end="")
        return 0 if found.confirmed else 1
    print(f"{', '.join(found.effects)}: held-out runs in MuJoCo, step {found.timestep:g} s")
    print(f"  {'run':20} {'channel':28} {'base':>8} {'with':>8}   (RMS error over RMS recorded [-])")
    for check in found.checks:
        print(
            f"  {check.run[:20]:20} {check.channel[:28]:28} {check.base_error:8.4f} {check.augmented_error:8.4f}"
        )
    print(f"  {'mean':20} {'MuJoCo':28} {found.base_error:8.4f} {found.augmented_error:8.4f}")
    print(f"  {'':20} {'reduced model':28} {found.reduced_base_error:8.4f} {found.reduced_augmented_error:8.4f}")
    verdict = "confirmed" if found.confirmed else f"NOT confirmed (limits {LIMITS[0]:g} to {LIMITS[1]:g})"
    print(f"gain {found.gain:.4f} of {found.reduced_gain:.4f}, ratio {found.ratio:.3f}: {verdict}")
    return 0 if found.confirmed else 1
