"""Exponents and correlation dimensions of systems with known values, from several starts.

The table shows the means over the starts, the worst relative error (for a dimension, the worst difference), and the
mean claimed deviation. It marks systems without a scaling region from every start. Run with ``make bench``, or::

    pytest tests/benchmarks/attractor/test_known_systems.py -s
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crosstrack.instances.attractor.systems import generate
from crosstrack.solvers.attractor.correlation import CorrelationDimension
from crosstrack.solvers.attractor.exponents import Kantz, Rosenstein
from crosstrack.solvers.contract.backend import Request

#: System, period, delay, dimension, Theiler window, the known exponent and correlation dimension.
SYSTEMS = (
    ("logistic", 1.0, 1, 2, 1, np.log(2), 1.0),
    ("henon", 1.0, 1, 2, 1, 0.4192, 1.21),
    ("lorenz", 0.05, 3, 4, 30, 0.9056, 2.05),
    ("rossler", 0.3, 5, 3, 20, 0.0714, 1.99),
)
SIZES = (2_000, 5_000, 20_000, 100_000)
STARTS = 5
#: What must hold with 20,000 samples: relative errors of exponents by backend and system, differences of dimensions.
TOLERANCES = {
    ("rosenstein", "logistic"): 0.05,
    ("rosenstein", "henon"): 0.05,
    ("rosenstein", "lorenz"): 0.10,
    ("rosenstein", "rossler"): 0.25,
    ("kantz", "logistic"): 0.05,
    ("kantz", "henon"): 0.05,
    ("kantz", "lorenz"): 0.15,
    ("kantz", "rossler"): 0.25,
    ("correlation-dimension", "henon"): 0.05,
    ("correlation-dimension", "lorenz"): 0.10,
}


@pytest.mark.timeout(0)
@pytest.mark.parametrize(
    "backend", [Rosenstein(), Kantz(), CorrelationDimension()], ids=lambda one: one.name
)
def test_known_systems(backend: Any, capsys: Any) -> None:
    dimension = isinstance(backend, CorrelationDimension)
    lines = ["", f"{backend.name}, {STARTS} starts: mean, worst error, mean deviation claimed"]
    lines += ["| system | known | " + " | ".join(f"{count:,}" for count in SIZES) + " |"]
    lines += ["|---" * (len(SIZES) + 2) + "|"]
    for name, period, delay, columns, theiler, exponent, correlation in SYSTEMS:
        known, cells = (correlation if dimension else exponent), []
        options = backend.checked_options(
            {"delay": delay, "dimension": columns, "theiler": theiler}
        )
        for count in SIZES:
            found = []
            for seed in range(STARTS):
                model = generate(name, count, seed=seed, period=period)
                answer = backend.run(model.blinded(), Request(options=options))
                found.append(answer.point.correlation or answer.point.exponent)
            some = [one for one in found if one is not None]
            if not some:
                cells.append("none")
                continue
            values = np.array([one.value for one in some])
            errors = np.abs(values - known) / (1.0 if dimension else known)
            claimed = np.mean([one.deviation for one in some])
            few = "" if len(some) == STARTS else f", {STARTS - len(some)} none"
            worst = f"{errors.max():.2f}" if dimension else f"{errors.max():.1%}"
            cells.append(f"{values.mean():.4f} ({worst}) ± {claimed:.4f}{few}")
            if count == 20_000 and (backend.name, name) in TOLERANCES:
                assert len(some) == STARTS, (name, count)
                assert errors.max() <= TOLERANCES[backend.name, name], (name, count, values)
        lines.append(f"| {name} | {known:.4g} | " + " | ".join(cells) + " |")
        with capsys.disabled():
            print("\n".join(lines[-4:] if len(lines) == 4 else lines[-1:]), flush=True)
