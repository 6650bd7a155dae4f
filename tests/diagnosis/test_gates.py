"""The gates between a gain and a name: what noise gives, what a fit alone gives, what a further effect must add."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import adjudicate, verdict
from jointscope.diagnosis.adequacy import Adequacy
from jointscope.diagnosis.containment import contains
from jointscope.diagnosis.effects import REGISTRY, STRANGERS
from jointscope.diagnosis.gates import Comparison
from jointscope.diagnosis.outside import lead_asked
from jointscope.diagnosis.verdict import TEMPERATURE, distance, rank, temperature

FOUND = Comparison(
    gain=200.0, held_gain=80.0, expected_held=90.0, foretold_held=85.0, share_of_runs=1.0, lost=0.0, material=0.02,
    share=1.0, parents=0, parent_gain=0.0,
)  # fmt: skip
FURTHER = replace(FOUND, parents=1, parent_gain=2000.0, share=0.25)


@pytest.mark.parametrize(
    ("lead", "held_gain", "material", "said"),
    [
        (40.0, 80.0, 0.01, "unknown"),
        (5.0, 80.0, 0.01, "effects"),
        (40.0, 1.0, 0.01, "effects"),
        (40.0, 80.0, 1e-3, "effects"),
    ],
)
def test_physics_outside_the_table_names_nothing_and_must_lead(monkeypatch, lead, held_gain, material, said):
    """By 15 nats, with held-out runs that agree, and it must matter; else the effect of the table is named."""
    law = next(s for s in STRANGERS if s.name == "rubbing")
    listed, other = stand_in("hysteresis@transmission", ""), stand_in("rubbing@transmission", "")
    other.hypothesis.specs = (law,)
    judged = (SimpleNamespace(names=(), predictions=()), listed, other)
    scores = {listed.names: 500.0, other.names: 500.0 + lead}
    monkeypatch.setattr(verdict, "standing", lambda judgement: [listed])
    monkeypatch.setattr(verdict, "score", lambda judgement, j: scores[j.names])
    monkeypatch.setattr(verdict, "compare", lambda *_: replace(FOUND, held_gain=held_gain, material=material))
    monkeypatch.setattr(verdict, "distance", lambda *_: 100.0)
    monkeypatch.setattr(verdict, "adequacy_of", lambda *_: Adequacy((), 1.0, 0.0, 0.0))
    noise = SimpleNamespace(blocks={})
    decision = verdict.decide(
        SimpleNamespace(judged=judged, base=judged[0], noise=noise, objective=SimpleNamespace(prepared=()))
    )
    assert decision.verdict == said
    assert decision.chosen is (judged[0] if said == "unknown" else listed)


@pytest.mark.parametrize(("numbers", "asked"), [(1, 100.0), (2, 15.0)])
def test_a_listed_law_of_more_numbers_that_explains_less_has_no_lead(numbers, asked):
    """Of a law of as few numbers another form may explain as much; one of more numbers has had its form."""
    stranger, listed = stand_in("rubbing@transmission", ""), stand_in("base-compliance@base", "")
    stranger.hypothesis.specs[0].parameters = (1,)
    listed.hypothesis.specs[0].parameters = (1,) * numbers
    assert lead_asked(5000.0, stranger, [(4900.0, listed), (-0.7, SimpleNamespace(names=()))]) == asked


def test_a_mode_as_broad_as_a_search_allows_and_a_breakaway_of_many_times_the_friction_are_something_else():
    mount = next(s for s in REGISTRY if s.variant == "turning-mount")
    stribeck = next(s for s in REGISTRY if s.name == "stribeck-friction")
    assert mount.sensible((20.0, 0.01, 0.1)) and not mount.sensible((20.0, 0.01, 0.2))
    assert stribeck.sensible((1.0, 1.5, 0.01)) and not stribeck.sensible((1.0, 6.0, 0.01))


def test_belief_is_tempered_by_what_is_explained():
    """One per cent of a large gain is what a law of the wrong form costs."""
    assert temperature(-1.0) == temperature(100.0) == TEMPERATURE
    assert temperature(1e5) == pytest.approx(1e3)


def stand_in(name, variant, chi2=0.0, w=()):
    """As much of a judged hypothesis as telling two apart looks at."""
    spec = SimpleNamespace(
        name=name.partition("@")[0], location=name.partition("@")[2], variant=variant, parameters=()
    )
    return SimpleNamespace(
        names=(name,), hypothesis=SimpleNamespace(specs=(spec,)), chi2=chi2, fit=SimpleNamespace(
            w=np.array(w), x=None, coordinates=SimpleNamespace(unpack=lambda x: (None, ()))
        ),
        left_held=(),
    )  # fmt: skip


def test_a_set_must_beat_a_simpler_one_that_is_no_part_of_it_by_more_than_a_wrong_form_leaves(monkeypatch):
    """Two effects 2 % ahead of one other effect: what a form that is a little wrong leaves pays for a second name."""
    values = {(): 0.0, ("a@load",): 1000.0, ("b@load", "c@load"): 1020.0}
    judged = [SimpleNamespace(names=names) for names in values]
    judgement = SimpleNamespace(judged=judged, base=judged[0])
    monkeypatch.setattr(verdict, "standing", lambda j: judged[1:])
    monkeypatch.setattr(verdict, "score", lambda j, one: values[one.names])
    monkeypatch.setattr(verdict, "contains", lambda outer, inner: False)
    monkeypatch.setattr(verdict, "_belief", lambda j, best: [v for v, _ in best.values()])
    monkeypatch.setattr(verdict, "compare", lambda *_: None)
    assert rank(judgement)[0].names == ("a@load",)
    values["b@load", "c@load"] = 1090.0
    assert rank(judgement)[0].names == ("a@load",)
    values["b@load", "c@load"] = 1130.0
    assert rank(judgement)[0].names == ("b@load", "c@load")


def test_an_error_that_its_own_past_foretells_is_no_noise():
    """But an angle's, which integrates what noise its torque has."""
    key, angle = (("torque-sweep", False, quantity) for quantity in ("linear-acceleration", "angle"))
    noise = SimpleNamespace(marginal=12.0, sigma=2.0)
    judgement = SimpleNamespace(noise=SimpleNamespace(blocks={key: noise, angle: noise}))
    for told, size, found in ((key, 0.05, 6.0), (key, 0.01, 0.0), (angle, 0.05, 0.0)):
        block = SimpleNamespace(key=told, base=size**2)
        assert verdict.foreseen(judgement, SimpleNamespace(blocks=[block])) == pytest.approx(found)


def test_a_law_contains_another_at_its_own_place_only():
    coulomb, stribeck = stand_in("coulomb-friction@load", "plain"), stand_in("stribeck-friction@load", "gaussian")
    assert contains(stribeck, coulomb) and not contains(coulomb, stribeck)
    assert not contains(stand_in("stribeck-friction@motor", "gaussian"), coulomb)
    base = stand_in("base-compliance@base", "turning-mount")
    assert contains(stand_in("neighbour-flexibility@neighbour", "carrier"), base)
    assert not contains(stand_in("neighbour-flexibility@neighbour", "absorber"), base)


def test_the_true_of_two_laws_leads_by_their_distance():
    """w = truth - prediction: for the truth w is noise, for the other noise + d, and half of |d|^2 is the lead."""
    rng = np.random.default_rng(1)
    noise, d = rng.standard_normal(4000), np.zeros(4000)
    d[:100] = 1.5
    one = stand_in("a@load", "", float(noise @ noise), noise)
    other = stand_in("b@load", "", float((noise + d) @ (noise + d)), noise + d)
    judgement = SimpleNamespace(
        objective=SimpleNamespace(whiteners=[SimpleNamespace(sizes=(4000,))], slices=(slice(0, 4000),))
    )
    apart = distance(judgement, one, other)
    assert apart == pytest.approx(0.5 * d @ d, rel=0.1)
    assert 0.5 * (other.chi2 - one.chi2) == pytest.approx(apart, abs=4.0 * math.sqrt(2.0 * apart))


@pytest.mark.parametrize(("apart", "sure"), [(100.0, True), (1e4, False), (10.0, False)])
def test_a_lead_counts_by_how_far_the_two_are_apart(monkeypatch, apart, sure):
    """30 nats of 20 thousand: decisive where two predict almost alike, nothing where data lie between or they are the same."""
    judged = (
        SimpleNamespace(names=()),
        stand_in("delay@acquisition", ""),
        stand_in("sensor-gain@acquisition", ""),
    )
    scores = {"delay@acquisition": 20000.0, "sensor-gain@acquisition": 19970.0}
    monkeypatch.setattr(verdict, "standing", lambda judgement: judged[1:])
    monkeypatch.setattr(verdict, "score", lambda judgement, j: scores[j.names[0]])
    monkeypatch.setattr(verdict, "compare", lambda *_: None)
    monkeypatch.setattr(verdict, "distance", lambda *_: apart)
    top = rank(SimpleNamespace(judged=judged, base=judged[0]))[0]
    assert top.names == ("delay@acquisition",) and (top.probability > 0.99) is sure


@pytest.mark.parametrize(
    ("experiment", "gain", "revealed"),
    [
        ("speed-motion", 140.0, False),
        ("speed-motion", 400.0, True),
        ("hammer", 140.0, True),
        ("free", 140.0, True),
    ],
)
def test_what_experiments_are_not_made_for_takes_more(monkeypatch, experiment, gain, revealed):
    """140 nats of a loop in motions alone were what a current loop left."""
    run = SimpleNamespace(run=SimpleNamespace(experiment=experiment))
    judgement = SimpleNamespace(objective=SimpleNamespace(prepared=(run,)), held=SimpleNamespace(prepared=()))
    spec = SimpleNamespace(name="hysteresis", location="transmission", revealed_by=("hammer", "torque-sweep"))
    child = SimpleNamespace(hypothesis=SimpleNamespace(specs=(spec,)))
    monkeypatch.setattr(adjudicate, "compare", lambda *_: SimpleNamespace(gain=gain))
    assert adjudicate._revealed(judgement, child, (SimpleNamespace(names=()),)) is revealed


def test_the_law_that_contains_another_must_lead_it(monkeypatch):
    judged = (
        SimpleNamespace(names=()),
        stand_in("coulomb-friction@load", "plain"),
        stand_in("stribeck-friction@load", "gaussian"),
    )
    monkeypatch.setattr(verdict, "standing", lambda judgement: judged[1:])
    monkeypatch.setattr(verdict, "compare", lambda *_: None)
    monkeypatch.setattr(verdict, "distance", lambda *_: 40.0)
    monkeypatch.setattr(verdict, "left_open", lambda *_: False)
    for inner, lead, named in (
        (4e3, 5.0, "coulomb-friction@load"),
        (4e3, 30.0, "stribeck-friction@load"),
        (2e6, 30.0, "coulomb-friction@load"),  # 1.5e-5 of what the narrower one explains: no form is exact to that
        (2e6, 200.0, "stribeck-friction@load"),
    ):
        scores = {"coulomb-friction@load": inner, "stribeck-friction@load": inner + lead}
        monkeypatch.setattr(verdict, "score", lambda judgement, j, scores=scores: scores[j.names[0]])
        assert rank(SimpleNamespace(judged=judged, base=judged[0]))[0].names == (named,)


def none_said():
    fit = SimpleNamespace()
    return verdict.Decision("none", SimpleNamespace(names=()), 0.9, (), None, (), fit)


@pytest.mark.parametrize(
    ("gain", "held", "foretold", "material", "said"),
    [
        (100.0, 40.0, 40.0, 0.01, "unknown"),
        (35.0, 40.0, 40.0, 0.01, "none"),  # not beyond doubt
        (100.0, 40.0, 40.0, 0.001, "none"),  # too weak to matter
        (300.0, 150.0, 160.0, 0.001, "unknown"),  # too weak to matter, and there beyond doubt
        (300.0, 150.0, 160.0, 0.0003, "none"),  # there, and less than the best of records holds
        (300.0, 80.0, 160.0, 0.001, "none"),  # much of it does not carry over
        (300.0, 150.0, 160.0, 0.0, "none"),  # no more than the echo of a log's noise
    ],
)
def test_a_force_without_a_name_takes_evidence(monkeypatch, gain, held, foretold, material, said):
    against = Comparison(gain, held, 0.0, foretold, 1.0, 0.0, material, 1.0, 0, 0.0)
    monkeypatch.setattr(verdict, "compare", lambda *_: against)
    table = SimpleNamespace(names=("latent-law@load",))
    found = verdict.with_unknown_force(SimpleNamespace(), none_said(), table)
    assert found.verdict == said
    assert (found.chosen is table) is (said == "unknown")


def judged_under(noise):
    """A judgement of no runs, as far as a verdict asks for its noise."""
    return SimpleNamespace(
        base=SimpleNamespace(predictions=()), objective=SimpleNamespace(prepared=()), noise=noise
    )


@pytest.mark.parametrize(
    ("error", "innovation", "grows"),
    [
        (0.1, 0.7, 0.68),  # a small error that grows with the signal
        (0.9, 0.7, 0.0),  # white noise for the most part: its envelope is its own
        (0.9, 0.2, 0.68),  # most of the record is an error that repeats itself
    ],
)
def test_an_envelope_of_noise_says_nothing_of_the_model(error, innovation, grows):
    key = ("speed-motion", False, "linear-acceleration", "arm", "tangential", 0.8, 1024.0)
    noise = SimpleNamespace(grown=0.68, marginal=1.0, sigma=innovation)
    nothing = SimpleNamespace(prepared=()), SimpleNamespace(predictions=())
    judgement = SimpleNamespace(noise=SimpleNamespace(blocks={key: noise}), objective=nothing[0], base=nothing[1])
    fit = SimpleNamespace(blocks=(SimpleNamespace(key=key, base=error**2),))
    assert verdict.grows_with_signal(judgement, fit) == grows


@pytest.mark.parametrize(
    ("touched", "left", "material", "said"),
    [
        (0.0, 0.013, 0.005, "unknown"),  # what runs have in common is left as it was
        (0.0, 0.013, 0.085, "effects"),  # something faint is left in hits, beside a strong effect of motions
        (0.4, 0.013, 0.085, "unknown"),  # it acts there, and most is left
        (0.58, 0.013, 0.085, "unknown"),  # less than three fifths of it explained
        (0.62, 0.013, 0.005, "effects"),
        (0.9, 0.013, 0.005, "effects"),
        (0.0, 0.008, 0.005, "effects"),
    ],
)
def test_what_is_left_where_an_effect_does_not_act_is_not_held_against_it(
    monkeypatch, touched, left, material, said
):
    block = SimpleNamespace(
        key="hits",
        excess=0.02,
        model=0.0,
        explained=touched,
        base_common=4e-4,
        model_common=4e-4 * (1.0 - touched),
    )
    top = verdict.Ranked(
        ("torque-ripple@motor",), 0.99, 500.0, SimpleNamespace(names=("torque-ripple@motor",)), None
    )
    monkeypatch.setattr(verdict, "rank", lambda _: [top])
    fit = Adequacy((block,), touched, left, left)
    monkeypatch.setattr(verdict, "adequacy_of", lambda *_: fit)
    monkeypatch.setattr(verdict, "compare", lambda *_: replace(FOUND, material=material))
    noise = SimpleNamespace(blocks={"an angle": SimpleNamespace(grown=0.02, marginal=1.0, sigma=1.0)})
    assert verdict.decide(judged_under(noise)).verdict == said


@pytest.mark.parametrize(
    ("kappa", "explained", "said"),
    [(0.2, 0.8, "effects"), (0.3, 0.8, "unknown"), (0.3, math.nan, "unknown"), (0.3, 0.99, "effects")],
)
def test_what_leaves_a_third_of_an_angle_is_no_answer(monkeypatch, kappa, explained, said):
    """A drive whose law was not found leaves an error that grows with the motion, and a weight that feeds on it.

    A stop that explains nearly all is an answer, though its rebound is not met to a third.
    """
    top = verdict.Ranked(("gravity@load",), 0.99, 2700.0, SimpleNamespace(names=("gravity@load",)), None)
    monkeypatch.setattr(verdict, "rank", lambda _: [top])
    monkeypatch.setattr(verdict, "adequacy_of", lambda *_: Adequacy((), explained, 0.0, 0.0))
    noise = SimpleNamespace(blocks={"an angle": SimpleNamespace(grown=kappa, marginal=1.0, sigma=1.0)})
    assert verdict.decide(judged_under(noise)).verdict == said


@pytest.mark.parametrize(("explained", "said"), [(0.96, "effects"), (0.5, "unknown")])
def test_what_differs_from_take_to_take_is_not_held_against_what_all_takes_share(monkeypatch, explained, said):
    """Slips of a stick: a wind-up that no model foretells to a quarter, of which all takes have a tenth part in common."""
    top = verdict.Ranked(
        ("stribeck-friction@motor",), 0.99, 2e4, SimpleNamespace(names=("stribeck-friction@motor",)), None
    )
    monkeypatch.setattr(verdict, "rank", lambda _: [top])
    block = SimpleNamespace(key="a wind-up", base=1.0, model=0.5, excess=0.9, explained=explained)
    monkeypatch.setattr(verdict, "adequacy_of", lambda *_: Adequacy((block,), 0.8, 1.0, 0.2))
    noise = SimpleNamespace(blocks={"a wind-up": SimpleNamespace(grown=0.27, marginal=3.0, sigma=1.0)})
    assert verdict.decide(judged_under(noise)).verdict == said
