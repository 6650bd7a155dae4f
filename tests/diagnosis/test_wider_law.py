"""Where a single effect was decided, the law that contains it is begun from its own numbers once more."""

from types import SimpleNamespace

import pytest

from jointscope.diagnosis import second_look


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("coulomb-friction",), True),
        (("stribeck-friction",), False),  # nothing contains it
        (("coulomb-friction", "backlash"), False),  # sets have their forms tried in the search
        ((), False),
    ],
)
def test_the_law_that_contains_a_single_effect_is_begun_from_it_and_kept_where_it_explains_more(
    monkeypatch, names, found
):
    def hypothesis(specs, chi2):
        return SimpleNamespace(specs=specs, fit=SimpleNamespace(chi2=chi2))

    parent = hypothesis(tuple(SimpleNamespace(name=n, location="load") for n in names), 1000.0)
    laws = [SimpleNamespace(name="stribeck-friction", location=place) for place in ("load", "motor")]
    asked = []
    more, no_more = hypothesis((laws[0],), 950.0), hypothesis((laws[0],), 970.0)
    monkeypatch.setattr(second_look, "candidates_for", lambda problem, specs: asked.extend(specs))
    monkeypatch.setattr(second_look, "grown", lambda *_: [more, no_more])
    judgement = SimpleNamespace(objective=SimpleNamespace(problem=None), base=SimpleNamespace(fit=None), judged=())
    assert second_look._wider(judgement, parent, laws, None) == ([more] if found else [])
    assert asked == (laws[:1] if found else [])
