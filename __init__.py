"""Declare planning problems as their papers state them, solve them and verify every plan.

::

    import crosstrack as ct

    model = ct.load("error-correction/7")
    best = ct.solve(model)
    print(best.plan, best.gap, best.verification)
    print(ct.compare([model], ["label-setting", "two-stage", "highs"], time_limit=60))

:mod:`crosstrack.models` holds the models, :mod:`crosstrack.solvers` the backends and
:mod:`crosstrack.instances` the catalogue. Solvers and scientific libraries are imported at first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .lazy import attach
from .version import __version__ as __version__

if TYPE_CHECKING:
    from . import errors as errors, instances as instances, models as models, solvers as solvers
    from .errors import CrosstrackError as CrosstrackError
    from .instances.catalogue import load as load
    from .models.flight.corridors import corridor as corridor
    from .models.optimal_control.declaration.tables import table as table
    from .models.plots import plot as plot
    from .solvers.bench.running import bench as bench
    from .solvers.contract.limits import Limits as Limits
    from .solvers.contract.solution import Solution as Solution
    from .solvers.contract.states import backends as backends
    from .solvers.flight.planning import plan_flight as plan_flight
    from .solvers.report.view.page import Page as Page, show as show
    from .solvers.run.crosscheck import Comparison as Comparison, compare as compare
    from .solvers.run.diagnosis import Diagnosis as Diagnosis, diagnose as diagnose
    from .solvers.run.dispatch import solve as solve
    from .solvers.run.fronts import Front as Front
    from .solvers.run.pareto import front as front
    from .solvers.run.preparation import prepare as prepare
    from .solvers.run.verification import verify as verify

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
    __all__ = sorted(["__version__", *__all__])
