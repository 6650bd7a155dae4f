"""What a child must show over its parent: beyond chance, in runs that were not fitted, and enough to matter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

REAL = 30.0  # nats beyond the Occam cost: on five draws nothing below 50 was named right, on an outside null 43 nats were wrong
UNASKED = 0.5  # of what is asked of the fitted runs, where the held-out ones give all of it by themselves
REAL_FURTHER = 25.0  # the same of any further effect, which has the rest of an imperfect law to feed on
OF_PARENT = (
    0.03  # and of the parent's own gain over the base, less where the parent explains nothing of that channel, or the
    # child nearly all that the parent leaves there
)
IN_EVIDENCE = 0.3  # of the parent's gain, fitted and held out, that makes a further effect beyond doubt
CARRIES_OVER = 0.06  # held-out gain over what the same kind of runs gained in the fit, per sample
AS_FORETOLD = 0.3  # and over what a true child would gain there
AGREES = 0.7  # of what was foretold, with which nothing in proportion is asked: not all runs show an effect alike
TELLING = 15.0  # nats that must be foretold for that
HELD = 3.0  # nats that held-out runs must gain at least
LOSING_MOST = 0.1  # the same where most held-out runs lose
TOO_MUCH = 3.5  # times what was foretold, gained on the held-out runs: an effect of one size can't
LOSING = 0.3  # nats lost on the held-out runs that lose, over nats gained on those that gain, or due
MATERIAL = 0.002  # rms of what is explained over the signal's rms, in the channel and experiment that show it most
SHARES = (0.0, 0.4, 0.4)  # of all that is explained, in rms, what a first, second, third effect must add
SHARE_BESIDE_EXACT = (
    0.3  # the same beside laws that have one form only: they leave nothing of their own to be explained
)
SHARE_OF_EXACT = 0.1  # or this where every held-out run that can tell gains what was foretold
SHARE_AND_EVIDENCE = (0.2, 0.12)  # or both this share and this much of the parent's gain
REST = 0.9  # or this of the energy that the parent leaves: no stand-in for a form's error gets that far
REST_OF_EXACT = 0.5  # the same beside laws that have one form only
REAL_BESIDE = (
    60.0  # nats of a second effect that is believed for what no other form of the first could explain ...
)
OWN_FORM = 0.6  # ... and this share of its gain, to first order
FORMS = 3.0  # or for gaining so many times what the first one's best forms differ by ...
ALIKE = 10.0  # ... which is so many nats at least
WITNESSES = 3  # held-out runs that must be able to tell, for either
MATERIAL_BESIDE = 0.004  # the same as MATERIAL of such a one
EVIDENT = 200.0  # nats of a force without a name that is too weak to matter, and yet is there beyond doubt
REAL_UNREACHED = 200.0  # nats asked of the fitted runs then
LOST_UNREACHED = 30.0  # nats that the held-out runs may lose then: the base's parameters move a little


def share_needed(parents: int, *, exact: bool) -> float:
    """Share of all that is explained that an effect beside ``parents`` others must add, ``exact`` if each has one form."""
    needed = SHARES[min(parents, len(SHARES) - 1)]
    return min(needed, SHARE_BESIDE_EXACT) if exact else needed


@dataclass(frozen=True, eq=False)
class Comparison:
    """A child against a parent.

    Attributes:
        gain: Likelihood gain on the fitted runs net of Occam [nats].
        held_gain: On the held-out runs [nats]; ``nan`` without any.
        expected_held: What the gain of each kind of fitted runs would make of it, sample for sample [nats].
        foretold_held: Half the squared distance of the two predictions of the held-out runs, whitened: what the gain
            there is on average if the child is true, and the loss if its parent is [nats].
        share_of_runs: Held-out runs that gain, of those that could show it (of all where none could).
        votes: How many those are.
        lost: Nats of the held-out runs that lose, positive.
        material: Largest rms of what the child explains beyond the parent, over the signal's, of any channel [-].
        share: The same over what the child explains beyond the base, in that channel [-].
        parents: Effects of the parent: a further effect must explain more, since what a law of the right name but the
            wrong form leaves is always explained by something.
        parent_gain: The parent's gain over the base, fitted and held out [nats].
        unreached: Whether no held-out run can show what the child adds: an effect of one place (a stop), or what
            several fitted runs show apart from each other.
        rest: Of the energy that the parent leaves in the channel of ``material``, what the child explains [-].
        exact: Whether the parent's laws have one form only, so that no wrong one can be left.
        from_outside: Whether all that the child adds comes from outside the rig, which may be stronger in one run than in
            another: what is foretold then says less of what must be gained.
    """

    gain: float
    held_gain: float
    expected_held: float
    foretold_held: float
    share_of_runs: float
    lost: float
    material: float
    share: float
    parents: int
    parent_gain: float
    unreached: bool = False
    rest: float = 0.0
    exact: bool = False
    from_outside: bool = False
    votes: int = 0

    @property
    def real(self) -> bool:
        """Beyond chance on the fitted runs, or half so on them where the held-out ones are by themselves."""
        of_parent = OF_PARENT * self.parent_gain * (1.0 - self.share**2) * (1.0 - self.rest)
        needed = REAL if self.parents == 0 else max(REAL_FURTHER, of_parent)
        return self.beyond(needed)

    def beyond(self, needed: float) -> bool:
        """Whether the fitted runs gain what is asked [nats], or half of it and the held-out ones all of it."""
        return self.gain > needed or (self.gain > UNASKED * needed and self.held_gain > needed)

    @property
    def carries_over(self) -> bool:
        """Held-out runs agree; vacuous without any."""
        if math.isnan(self.held_gain):
            return True
        if self.unreached:
            return self.gain > REAL_UNREACHED and self.lost < LOST_UNREACHED
        due = max(self.held_gain + self.lost, self.foretold_held)
        agrees = self.foretold_held > TELLING and self.held_gain > AGREES * self.foretold_held
        proportion = 0.0 if agrees else CARRIES_OVER * self.expected_held
        as_foretold = AS_FORETOLD * self.foretold_held
        enough = max(HELD, proportion, min(as_foretold, REAL) if self.from_outside else as_foretold)
        losing = LOSING if self.share_of_runs >= 0.5 else LOSING_MOST
        much = self.foretold_held > TELLING and self.held_gain > TOO_MUCH * self.foretold_held
        return self.held_gain > enough and self.lost < losing * due and not much

    @property
    def stands(self) -> bool:
        """Real, carried over, and material or there beyond doubt."""
        held = 0.0 if math.isnan(self.held_gain) else self.held_gain
        much = self.gain + held > IN_EVIDENCE * self.parent_gain
        needed = share_needed(self.parents, exact=self.exact)
        both = self.share > SHARE_AND_EVIDENCE[0] and self.gain + held > SHARE_AND_EVIDENCE[1] * self.parent_gain
        nearly_all = self.rest > (REST_OF_EXACT if self.exact else REST)
        alone = self.exact and self.share > SHARE_OF_EXACT and self.material > MATERIAL_BESIDE and self.witnessed
        return (
            self.real
            and self.carries_over
            and (self.material > MATERIAL or self.evident)
            and (self.share > needed or much or both or nearly_all or alone)
        )

    @property
    def stands_but_for_size(self) -> bool:
        """Whether it would stand if it were large enough to matter."""
        return replace(self, material=max(self.material, 2.0 * MATERIAL)).stands

    @property
    def beside(self) -> bool:
        """Whether a second effect with too little of the evidence may be believed for being none of the first one's forms.

        Held-out runs must gain what was foretold, each of them.
        """
        return self.perhaps_beside and self.as_foretold

    @property
    def as_foretold(self) -> bool:
        """Whether the held-out runs gain what was foretold, most of them."""
        agrees = AGREES < self.held_gain / max(self.foretold_held, HELD) < 1.0 / AGREES
        return agrees and self.share_of_runs >= AGREES

    @property
    def witnessed(self) -> bool:
        """The same, by several runs that can tell."""
        return self.as_foretold and self.votes >= WITNESSES

    @property
    def perhaps_beside(self) -> bool:
        """Whether it is real enough for that; where the first one does nothing it may be seen by itself.

        What the first one's form leaves in the other runs says nothing of a second effect there.
        """
        much = self.gain > REAL_BESIDE and self.material > MATERIAL_BESIDE
        return self.parents == 1 and much and self.carries_over

    @property
    def evident(self) -> bool:
        """There beyond doubt, be it ever so small: much evidence, and held-out runs that gain what was foretold."""
        agrees = self.held_gain > AGREES * self.foretold_held
        return self.gain > EVIDENT and self.material > 0.0 and self.carries_over and agrees
