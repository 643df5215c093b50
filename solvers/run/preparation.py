"""Models prepared once and used repeatedly: the dispatch of :func:`crosstrack.prepare`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, overload

from numpy.typing import ArrayLike

from ...errors import InvalidData
from ...models.black_box.model import BlackBoxMinimisation
from ...models.conversion import as_model
from ...models.flight.model import Flight
from ...models.grid_path.gridmap import GridMap
from ...models.grid_path.model import GridPath
from ...models.optimal_control.model import OptimalControlProblem
from ...models.sideslip.model import SideslipEstimation
from ..black_box.asking import AskTell, prepare_black_box
from ..contract.limits import Limits
from ..flight.replanning import PreparedFlight, prepare_flight
from ..grid_path.prepared import PreparedMap, prepare_map
from ..optimal_control.prepared import TAKEN, PreparedSolver, prepare_control
from ..sideslip.online import OnlineFilter, prepare_sideslip

__all__ = ["prepare"]


@overload
def prepare(problem: OptimalControlProblem, **options: Any) -> PreparedSolver: ...
@overload
def prepare(problem: Flight) -> PreparedFlight: ...
@overload
def prepare(problem: BlackBoxMinimisation, backend: str = "auto", **options: Any) -> AskTell: ...
@overload
def prepare(
    problem: GridMap | GridPath, *, weights: ArrayLike | None = None, radius: float = 0.0
) -> PreparedMap: ...
@overload
def prepare(
    problem: SideslipEstimation, backend: str = "kalman-filter", *, history: float = 0.0
) -> OnlineFilter: ...
def prepare(
    problem: Any,
    backend: str | None = None,
    *,
    formulation: str | None = None,
    mesh: Any = None,
    tolerance: float | None = None,
    time_limit: float | None = None,
    limits: Limits | None = None,
    backend_options: Mapping[str, Any] | None = None,
    structured: bool | None = None,
    **options: Any,
) -> Any:
    """Build an optimal control problem on a fixed mesh once, to solve it for other data by a call.

    It serves model-predictive control and parameter studies. The mesh is not refined, and plans are
    verified only on request (``step.verification()``). A flight is prepared for replanning in the air, and a
    map for many verified shortest paths. A sideslip model becomes a filter that follows a drive sample by sample,
    and a black box a search by ask and tell.

    Parameters
    ----------
    problem : OptimalControlProblem, Flight, GridMap, GridPath, SideslipEstimation or BlackBoxMinimisation
        Problem with data declared by ``ocp.data(…)``. A flight accepts no options, a map the options
        ``weights`` and ``radius`` of :class:`~crosstrack.solvers.grid_path.PreparedMap`, a sideslip model the
        option ``history`` of :class:`~crosstrack.solvers.sideslip.OnlineFilter`, a black box the options `seed`,
        `evaluations`, `target`, `warm_start` and `backend_options`.
    backend : str, optional
        Backend that uses CasADi: ``"ipopt"`` (default), ``"sqpmethod"`` …; see :func:`crosstrack.backends`.
        For a sideslip model ``"kalman-filter"`` (default) or ``"unscented-filter"``, for a black box any of its
        searches.
    formulation : str, optional
        Name of the transcription; by default that of the problem.
    mesh : Solution, ControlPlan, Mesh or sequence of float, optional
        Ends of the intervals, as fractions from 0 to 1. A solution or plan provides mesh and guess.
    tolerance : float, optional
        Largest violation of a scaled row, and tolerance of the backend (default 1e-6).
    time_limit : float, optional
        Time limit of a search in seconds, if supported; a repeated step may take twice as long.
    limits : Limits, optional
        Record with the tolerance and the time limit.
    backend_options : mapping, optional
        Options of the backend.
    structured : bool, optional
        Whether steps from an earlier step use an interior-point method on the structure of the intervals;
        the backend solves the others, and those on which it does not converge. By default it is used
        with ``"ipopt"`` for programs of one phase without path equations. True requires it.
    **options
        Options of the transcription: `intervals`, `degree` …

    Returns
    -------
    PreparedSolver, ``PreparedFlight``, PreparedMap, OnlineFilter or AskTell
        Solver; ``solver(x0=…, warm=True)`` returns a :class:`Step`.

    Raises
    ------
    UnsupportedFormulation
        The problem is not an optimal control problem.
    UnknownName, UnsupportedOption, BackendMissing, BackendBroken, InvalidData
        A name, option, package or value is not available or not allowed.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import OptimalControlProblem
    >>> ocp = OptimalControlProblem("brake")
    >>> x0 = ocp.data("x0", 2, value=[1.0, 0.0])
    >>> phase = ocp.phase(time=(0, 2))
    >>> x, u = phase.state("x", 2, initial=x0), phase.control("u", lower=-3, upper=3)
    >>> phase.dynamics({x: [x[1], u]})
    >>> ocp.minimise(phase.integral(x[0] ** 2 + 0.1 * u**2))
    >>> solver = ct.prepare(ocp, intervals=5, degree=4)
    >>> first, second = solver(), solver(x0=[0.9, -0.1], warm=True)
    >>> first.ok, second.ok, second.objective < first.objective
    (True, True, True)
    """
    given = dict(options, formulation=formulation, mesh=mesh, tolerance=tolerance, limits=limits)
    given.update(time_limit=time_limit, backend_options=backend_options, structured=structured)
    given.update(backend=backend)
    given = {name: value for name, value in given.items() if value is not None}
    if isinstance(problem, GridMap | GridPath):
        return prepare_map(problem, **given)
    try:
        model = as_model(problem)
    except InvalidData as error:
        raise InvalidData(f"{TAKEN}: {error}", field="problem") from None
    if isinstance(model, BlackBoxMinimisation):
        return prepare_black_box(model, **given)
    if isinstance(model, Flight):
        return prepare_flight(model, **given)
    if isinstance(model, SideslipEstimation):
        return prepare_sideslip(model, **given)
    return prepare_control(model, **given)
