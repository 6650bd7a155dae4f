r"""An error split among its causes: the Shapley value of each.

Mending causes one after another gives each a share that depends on the order, since errors of several causes don't add.
The mean over all orders,
    phi_i = sum_{S not i} |S|! (k - |S| - 1)! / k! [E(S) - E(S + i)],
is the one split that adds up to E(none) - E(all), gives nothing to a cause whose mending changes nothing, and treats
equal causes equally (Shapley 1953).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import combinations


def shapley(causes: Sequence[str], error: Callable[[frozenset[str]], float]) -> dict[str, float]:
    """Share of each cause in ``error(none mended) - error(all mended)``.

    Args:
        causes: Their names.
        error: Error with a set of causes mended; called once per set.
    """
    known = {frozenset(s): error(frozenset(s)) for k in range(len(causes) + 1) for s in combinations(causes, k)}
    total, found = len(causes), {}
    for cause in causes:
        others = [c for c in causes if c != cause]
        found[cause] = sum(
            math.factorial(k) * math.factorial(total - k - 1) / math.factorial(total)
            * (known[frozenset(s)] - known[frozenset((*s, cause))])
            for k in range(total) for s in combinations(others, k)
        )  # fmt: skip
    return found
