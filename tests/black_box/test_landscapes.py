"""The test functions of black boxes: their optima, and their formulas one by one."""

import math

import numpy as np
import pytest

from crosstrack.models.black_box import Named
from crosstrack.models.black_box.functions import Landscape


@pytest.mark.parametrize(
    ("name", "place", "least"),
    [
        *(("rastrigin", [0, 0, 0], 0), ("easom", [math.pi] * 2, -1), ("booth", [1, 3], 0)),
        *(("bohachevsky", [0, 0], 0), ("sum-squares", [0] * 4, 0), ("sphere", [0], 0)),
        *(("rosenbrock", [1] * 5, 0), ("ackley", [0] * 3, 0), ("step", [0.4, -0.4], 0)),
        ("constant", [7], 0),
    ],
)
def test_the_optima_of_the_test_functions(name, place, least):
    """Nothing nearby is lower, shifted and stretched too."""
    rng = np.random.default_rng(4)
    shift = rng.normal(size=len(place)) * 100
    for function, at in (
        (Named(name), np.array(place, float)),
        (Named(name, shift=shift, stretch=8.0), 8.0 * np.array(place, float) + shift),
    ):
        assert function.values(at[None]) == pytest.approx(least, abs=1e-10)
        near = at + rng.normal(size=(500, len(place))) * 10.0 ** rng.uniform(-3, 1, (500, 1))
        assert (function.values(near) >= least - 1e-10).all()
    assert set(Landscape) == {Landscape(one) for one in Landscape}


def test_the_test_functions_by_their_formulas_one_by_one():
    x, y = 0.7, -1.3
    cos, exp, pi = math.cos, math.exp, math.pi
    waves = x * x - 10 * cos(2 * pi * x) + y * y - 10 * cos(2 * pi * y) + 20
    far = -20 * exp(-0.2 * math.sqrt((x * x + y * y) / 2))
    plain = {
        "rastrigin": waves,
        "easom": -cos(x) * cos(y) * exp(-((x - pi) ** 2) - (y - pi) ** 2),
        "booth": (x + 2 * y - 7) ** 2 + (2 * x + y - 5) ** 2,
        "bohachevsky": x * x + 2 * y * y - 0.3 * cos(3 * pi * x) - 0.4 * cos(4 * pi * y) + 0.7,
        "sum-squares": x * x + 2 * y * y,
        "sphere": x * x + y * y,
        "rosenbrock": 100 * (y - x * x) ** 2 + (1 - x) ** 2,
        "ackley": far - exp((cos(2 * pi * x) + cos(2 * pi * y)) / 2) + 20 + math.e,
        "step": 1.0 + 1.0,
        "constant": 0.0,
    }
    assert set(plain) == set(Landscape)
    for name, value in plain.items():
        assert Named(name).values(np.array([[x, y]]))[0] == pytest.approx(value, abs=1e-12), name
