"""The draws' catalogues are apart: what a test draw conceals beyond the textbook was never seen in development."""

from __future__ import annotations

import importlib
import inspect

import pytest

from jointscope.sim.concealed import catalogue, rigs
from jointscope.sim.concealed.law import Law

OPEN = ("development", "calibration")


def names(laws: tuple[Law, ...]) -> set[str]:
    return {law.law for law in laws}


def parts(law: Law) -> set[str]:
    """The code behind a law: what it installs, loops or hands to the chain."""
    hooks = (law.install, law.loop, law.chain)
    return {f"{hook.__module__}.{hook.__qualname__}" for hook in hooks if hook is not None}


def test_unlisted_effects_of_the_test_draw_are_other_effects():
    """No unlisted effect of the test draw occurs in development or calibration, by name, law or code."""
    test = catalogue.laws("test", unlisted=True)
    assert len({law.effect for law in test}) >= 4
    for draw in OPEN:
        known = catalogue.laws(draw, unlisted=True)
        assert not {law.effect for law in test} & {law.effect for law in known}
        assert not names(test) & names(known)
        assert not {law.loop for law in test if law.loop} & {law.loop for law in known if law.loop}
        assert not set.union(*map(parts, test)) & set.union(*map(parts, known))


@pytest.mark.parametrize("draw", OPEN)
def test_departing_laws_of_the_test_draw_are_other_laws(draw):
    """Under one name and place, no departing law is in the test draw and in another one."""

    def departing(which: str) -> set[tuple[str, str, str]]:
        return {(law.effect, law.location, law.law) for law in catalogue.laws(which) if law.departs}

    assert departing("test")
    assert not departing("test") & departing(draw)
    textbook = set.union(*(parts(law) for law in catalogue.laws("test") if not law.departs))
    of_test, known = (
        set.union(*(parts(law) for law in catalogue.laws(which) if law.departs)) - textbook
        for which in ("test", draw)
    )
    assert of_test
    assert not of_test & known


def test_every_departing_law_of_the_test_has_code_of_its_own():
    """Other equations, not other numbers in the same ones: something in it is written in the test's own module."""
    home = "jointscope.sim.concealed.departures_of_the_test"
    for law in catalogue.laws("test"):
        if law.departs:
            hooks = (law.install, law.loop, law.chain, law.shape)
            assert home in {hook.__module__ for hook in hooks if hook is not None}, law.law


def test_textbook_laws_are_in_every_draw():
    """The matched half is the same everywhere, so that the gap to the mismatched half means something."""
    textbook = [{(law.effect, law.location, law.law) for law in catalogue.laws(draw) if not law.departs}
                for draw in (*OPEN, "test")]  # fmt: skip
    assert textbook[0] == textbook[1] == textbook[2]


def test_every_effect_has_a_textbook_law_and_most_a_departing_one_in_the_test():
    """Every listed name can be concealed in the test draw; at least two thirds also by a law of other equations."""
    labels = {f"{law.effect}@{law.location}" for law in catalogue.laws("test")}
    departing = {f"{law.effect}@{law.location}" for law in catalogue.laws("test") if law.departs}
    assert labels == {f"{law.effect}@{law.location}" for law in catalogue.laws("development")}
    assert 3 * len(departing) >= 2 * len(labels)


def test_what_the_test_draw_uses_is_not_used_by_the_open_modules():
    """The test's families live in modules that no open law's module imports."""
    from jointscope.sim.concealed import departures_of_the_test, equations_of_the_test, unlisted_of_the_test

    hidden = {module.__name__ for module in (departures_of_the_test, equations_of_the_test, unlisted_of_the_test)}
    for law in (*catalogue.laws("development"), *catalogue.laws("development", unlisted=True)):
        for hook in (law.install, law.loop, law.chain, law.shape, law.span):
            assert getattr(hook, "__module__", "") not in hidden
    for module in hidden:
        assert "development" not in inspect.getsource(importlib.import_module(module)).split('"""')[2]


def test_ranges_of_the_nuisances_grow_from_draw_to_draw():
    """Test rigs go beyond those of development on every side."""
    known, test = rigs.RANGES["development"], rigs.RANGES["test"]
    for name in ("stiffness", "frequency", "inertia_ratio", "windup", "noise"):
        (a, b), (low, high) = getattr(known, name), getattr(test, name)
        assert low <= a and b <= high
        assert (low, high) != (a, b)


def test_rivals_know_every_listed_label():
    """Nobody is without a look-alike, and nobody is his own."""
    labels = {f"{law.effect}@{law.location}" for law in catalogue.LISTED}
    for label in sorted(labels):
        assert catalogue.rivals(label), label
        assert label not in catalogue.rivals(label)
        assert set(catalogue.rivals(label)) <= labels
    for law in catalogue.UNLISTED:
        assert set(catalogue.rivals(f"{law.effect}@{law.location}")) <= labels
