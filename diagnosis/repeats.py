"""What does not repeat is no physics: the last word where a noisy torque log drives every run.

The noise of a log passes through the model, and a law that bends it gains by what each take has of its own: a loop of
0.014 N m gained 474 nats in three motions, 168 in a fourth, of which no part was common to takes that were driven alike.
Where something else drives some runs, they agree or they don't; where nothing does, only what takes have in common is left.
But a difference of 3.5e-4 of the signal's energy (play of a microradian, sweeps of several levels) is one of 0.8e-4 in common,
with a standard error of 0.9e-4: takes seldom tell, and what sweeps are made to show is believed without them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jointscope.diagnosis.adjudicate import Judgement
from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.effects.spec import made_to_show
from jointscope.diagnosis.problem import PreparedRun
from jointscope.diagnosis.verdict import Decision, nothing_named

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec

TOLD = 2.0  # standard errors of what takes share, beyond which an effect that they should share is missed


def with_what_repeats(judgement: Judgement, decision: Decision) -> Decision:
    """``none`` in place of a name, where all that the base leaves differs from take to take of what a log drives.

    Accelerometers decide where there are any: an angle follows whatever moves it. What acts in runs of its own, or at
    another phase in each (a vibration; an order of a shaft that starts elsewhere), does not repeat either: it keeps its name.
    So does what these experiments are made to show, unless takes of one excitation would share it visibly.
    """
    runs = (*judgement.objective.prepared, *judgement.held.prepared)
    if decision.verdict != "effects" or not all(map(driven_by_noise, runs)):
        return decision
    own = any(map(_acts_anew, decision.chosen.hypothesis.specs))
    blocks = decision.adequacy.blocks
    telling = [block for block in blocks if block.key[2] in ACCELERATIONS] or list(blocks)
    told = telling != [] and all(math.isfinite(block.base_common) for block in telling)
    missed = any(block.claimed > TOLD * block.error for block in telling)
    hardly = not all(made_to_show(spec, runs) for spec in decision.chosen.hypothesis.specs)
    if own or not told or not (missed or hardly) or decision.adequacy.base_left > 0.0:
        return decision
    return nothing_named(decision, judgement.base)


def _acts_anew(spec: EffectSpec) -> bool:
    """Whether a law does something else in each take of one excitation."""
    return spec.run_weights is not None or spec.profiled > 0 or spec.family == "periodic"


def driven_by_noise(run: PreparedRun) -> bool:
    """Whether a torque log with noise in it moves the motor of a run."""
    return run.motor_moves and run.motor is not None and run.motor.noise > 0.0
