"""Of laws of one set of names that are as good as each other the simplest is given."""

from types import SimpleNamespace

import pytest

from jointscope.diagnosis import verdict


@pytest.mark.parametrize(
    ("scores", "named"),
    [
        ({"power": 2.0e9 + 5e3, "cubic": 2.0e9}, "cubic"),  # as good, by fewer numbers
        ({"power": 2.0e9 + 5e4, "cubic": 2.0e9}, "power"),
        ({"power": 900.0, "cubic": 880.0}, "power"),
        ({"power": 880.0, "cubic": 900.0}, "cubic"),
        ({"power": -12.0, "cubic": -24.0}, "power"),
    ],
)
def test_of_laws_of_one_name_that_are_as_good_the_one_of_fewest_numbers_is_given(scores, named):
    numbers = {"cubic": 7, "power": 9}
    fits = [
        (value, SimpleNamespace(law=law, fit=SimpleNamespace(coordinates=SimpleNamespace(n=numbers[law]))))
        for law, value in scores.items()
    ]
    assert verdict._of_fewest_numbers(fits)[1].law == named
