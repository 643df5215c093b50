"""Where the search for an optimal control starts: samples, functions or another answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import casadi
import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData
from ...fields import show
from ..definition import Guess, Phase, Quantity
from ..piecewise import EDGE
from ..plan import ControlPlan, PhasePlan
from .terms import column, entries, middle, numbers

__all__ = ["After", "Guessed", "define_linked", "draw_lines", "sample_guess"]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX

#: By state: when and with which value it goes on, an entry each; NaN where nothing is known.
After = Mapping[str, tuple[Floats, Floats]]

#: Samples that are taken of a function or of another answer.
SAMPLES = 201


class Guessed:
    """What is guessed of a phase: by quantity samples, (fractions, table), or a function of time.

    ``"time"`` are the guessed times of both ends. States in `flown` are those of the flight that
    the guessed controls make, with those in `feedback`.
    """

    name: str
    bounds: tuple[float, float, float, float]
    opened: Callable[[], Any]
    states: dict[str, Quantity]
    controls: dict[str, Quantity]
    guessed: dict[str, Any]
    flown: set[str]
    feedback: dict[str, Symbol]

    def guess(self, plan: Any = None, *, time: Any = None, **values: Any) -> None:
        """Guess the course, as a start for the search.

        Parameters
        ----------
        plan : ControlPlan, Solution or PhasePlan, optional
            Another answer: what bears the same names is taken over, its times included.
        time : array_like, optional
            Times of the samples given in `values`; its ends are guesses of free times. Without it,
            samples are spread evenly.
        **values : array_like or callable
            For a state or control by name: samples (a row each for a vector), which are joined
            linearly, one value throughout, or a function of time.
        """
        self.opened()
        found = {} if plan is None else _take_over(self, plan)
        fractions: Floats | None = None
        if time is not None:
            grid = _read_times(self, time)
            found["time"] = float(grid[0]), float(grid[-1])
            fractions = (grid - grid[0]) / (grid[-1] - grid[0])
        for name, value in values.items():
            quantity = self.states.get(name) or self.controls.get(name)
            if quantity is None:
                known = ", ".join(map(repr, [*self.states, *self.controls]))
                raise InvalidData(
                    f"guess of {name!r}: phase {self.name!r} has the states and controls {known}",
                    field=name,
                )
            # A function stays one until the phase's times are known.
            whole = callable(value)
            found[name] = value if whole else _table(name, value, quantity.size, fractions)
        self.guessed = self.guessed | found
        # What is guessed after a flight replaces that part of it.
        self.flown -= set(found)
        self.feedback = {name: law for name, law in self.feedback.items() if name not in found}

    def simulate(self, *, time: Any = None, **controls: Any) -> None:
        """Guess the motion that the dynamics make with controls of one's own.

        The flight starts from the initial state, where it is free from the guessed one: at the end
        of the phase before, if the two are linked. Parameters have their guesses. Where the end is
        free and no `time` is given, the flight ends where its final values are nearest. It is flown
        when the problem is built.

        Parameters
        ----------
        time : array_like, optional
            Times of the samples given in `controls`, from the start to the end of the flight.
        **controls : array_like, callable or casadi expression
            By name: one value throughout, samples, a function of time, or a feedback, which is an
            expression in the phase's states, its time and parameters. Others keep their guess.

        Raises
        ------
        InvalidData
            What is given is no control, or has another size. When the problem is built: the flight
            breaks down, as no state or rate is finite any more.
        """
        for name in controls:
            if name not in self.controls:
                raise InvalidData(
                    f"simulate with {name!r}: phase {self.name!r} has the controls "
                    f"{', '.join(map(repr, self.controls)) or 'none'}",
                    field=name,
                )
        laws = {
            name: column(f"feedback of {name!r}", value)
            for name, value in controls.items()
            if isinstance(value, casadi.MX | casadi.SX)
        }
        for name, law in laws.items():
            if law.numel() != self.controls[name].size:
                raise InvalidData(
                    f"feedback of {name!r} must have {entries(self.controls[name].size)}, got "
                    f"{law.numel()}",
                    field=name,
                )
        self.guess(time=time, **{k: v for k, v in controls.items() if k not in laws})
        self.feedback |= laws
        self.flown = set(self.states)


PhaseT = TypeVar("PhaseT", bound=Guessed)


def _read_times(phase: Guessed, time: Any) -> Floats:
    """Return the times of samples, which begin and end when the phase may."""
    wanted = "finite, increasing times"
    grid = numbers("time of a guess", time, wanted)
    increasing = grid.ndim == 1 and grid.size >= 2 and np.isfinite(grid).all()
    if not increasing or not (np.diff(grid) > 0).all():
        raise InvalidData(f"time of a guess must be {wanted}, got {show(time)}", field="time")
    for what, t, (low, high) in (
        ("begin", grid[0], phase.bounds[:2]),
        ("end", grid[-1], phase.bounds[2:]),
    ):
        slack = EDGE * max(1.0, abs(low), abs(high))
        if not low - slack <= t <= high + slack:
            raise InvalidData(
                f"time of a guess must {what} in [{low:g}, {high:g}], as phase {phase.name!r} does, "
                f"got {t:g}",
                field="time",
            )
    return grid


def _table(name: str, value: Any, size: int, fractions: Floats | None) -> tuple[Floats, Floats]:
    table = numbers(f"guess of {name!r}", value, "numbers or a function of time")
    if not np.isfinite(table).all():
        raise InvalidData(f"guess of {name!r} must be finite, got {show(value)}", field=name)
    if table.ndim == 0 or (table.ndim == 1 and size > 1 and table.size == size):
        return np.array([0.0, 1.0]), np.broadcast_to(table, (2, size)).copy()
    if table.ndim == 1 and size == 1:
        table = table[:, None]
    if table.ndim != 2 or table.shape[1] != size or table.shape[0] < 2:
        raise InvalidData(
            f"guess of {name!r} must be one value, or samples of shape (samples, {size}), got shape "
            f"{np.shape(value)}",
            field=name,
        )
    places = np.linspace(0.0, 1.0, len(table)) if fractions is None else fractions
    if len(places) != len(table):
        raise InvalidData(
            f"guess of {name!r} has {len(table)} samples for {len(places)} times", field=name
        )
    return places, table


def _take_over(phase: Guessed, value: Any) -> dict[str, Any]:
    plan = getattr(value, "plan", value)
    if isinstance(plan, ControlPlan):
        names = [one.name for one in plan.phases]
        if phase.name not in names and len(names) > 1:
            raise InvalidData(
                f"guess of phase {phase.name!r}: the plan has the phases "
                f"{', '.join(map(repr, names))}; give one of them",
                field="guess",
            )
        plan = plan.phase(phase.name) if phase.name in names else plan.phases[0]
    if not isinstance(plan, PhasePlan):
        raise InvalidData(
            f"a guess must be a plan or a solution that has one, got {show(value)}", field="guess"
        )
    places = np.linspace(0.0, 1.0, SAMPLES)
    grid = plan.start + places * plan.duration
    found: dict[str, Any] = {"time": (plan.start, plan.end)}
    for part, names_of in ((plan.states, plan.state_names), (plan.controls, plan.control_names)):
        table = part(np.clip(grid, plan.start, plan.end))
        for name, quantity in {**phase.states, **phase.controls}.items():
            entries = [
                k for k, one in enumerate(names_of) if one == name or one.startswith(f"{name}[")
            ]
            if len(entries) == quantity.size:
                found[name] = (places, table[:, entries])
    if len(found) == 1:
        known = ", ".join(map(repr, [*plan.state_names, *plan.control_names]))
        raise InvalidData(
            f"guess of phase {phase.name!r}: the plan has {known}, none of which the phase knows in "
            "that size",
            field="guess",
        )
    return found


def _times(phase: Guessed, begin: float = 0.0) -> tuple[float, float]:
    """Return the guessed times of a phase: given ones, else from `begin` to the middle of the end's."""
    start_lower, start_upper, end_lower, end_upper = phase.bounds
    start, end = phase.guessed.get("time", (begin, 0.5 * (end_lower + end_upper)))
    start = float(np.clip(start, start_lower, start_upper))
    end = float(np.clip(end, end_lower, end_upper))
    return start, end if end > start else start + 0.5 * (end_upper - start)


def define_linked(
    phases: Sequence[PhaseT],
    links: Sequence[tuple[PhaseT, PhaseT, Sequence[str]]],
    define: Callable[[PhaseT, tuple[float, float], Mapping[str, Floats], After], Phase],
) -> tuple[Phase, ...]:
    """Return the phases, whose guesses go on from one to the next where states are linked.

    `define` makes a phase, given what :func:`draw_lines` is.
    """
    order = {one.name: k for k, one in enumerate(phases)}
    onward = [link for link in links if order[link[0].name] < order[link[1].name]]
    spans: dict[str, tuple[float, float]] = {}
    for one in phases:
        begin = max([0.0, *(spans[a.name][1] for a, b, _ in onward if b is one)])
        spans[one.name] = _times(one, begin)
    after: dict[str, dict[str, tuple[Floats, Floats]]] = {name: {} for name in order}
    for one in reversed(phases):
        for _, second, names in (link for link in onward if link[0] is one):
            later, span = after[second.name], spans[second.name]
            after[one.name] |= {k: _known_next(second, k, span, later.get(k)) for k in names}
    made: dict[str, Phase] = {}
    for one in phases:
        before: dict[str, Floats] = {}
        for first, _, names in (link for link in onward if link[1] is one):
            guess, states = made[first.name].guess, made[first.name].states
            cuts = np.cumsum([state.size for state in states])[:-1]
            ends = zip(states, np.split(guess.states[-1], cuts), strict=True)
            before |= {state.name: end for state, end in ends if state.name in names}
            spans[one.name] = _times(one, guess.end)
        made[one.name] = define(one, spans[one.name], before, after[one.name])
    return tuple(made.values())


def draw_lines(
    phase: Guessed, span: tuple[float, float], before: Mapping[str, Floats], after: After
) -> Guess:
    """Return the guess of a phase: what was given, and straight lines for the rest.

    A state goes from its initial to its final value where they are fixed. Where they are free, it
    goes on from the phase before, towards what is known of it in the phases after; a value of which
    nothing is known is the other end's, or the middle of its bounds, or 0 moved into them.

    Parameters
    ----------
    phase : Guessed
        The phase.
    span : tuple of float
        Guessed times of its two ends.
    before : mapping
        By state, the guess at the end of the phase before, which is linked to this one.
    after : mapping
        By state, the value that it has next in the phases after, NaN where nothing is known, and when.
    """
    given = {name: value for name, value in phase.guessed.items() if name != "time"}
    start, end = span
    places = {0.0, 1.0}
    for value in given.values():
        many = np.linspace(0.0, 1.0, SAMPLES) if callable(value) else value[0]
        places.update(many.tolist())
    fractions = np.array(sorted(places))
    tables: dict[str, list[Floats]] = {"states": [], "controls": []}
    for what in ("states", "controls"):
        for quantity in getattr(phase, what).values():
            if quantity.name in given:
                table = sample_guess(quantity, given[quantity.name], fractions, span)
            else:
                times, values = after.get(quantity.name, (np.nan, np.nan))
                known = before.get(quantity.name, np.full(quantity.size, np.nan))
                share = (end - start) / np.fmax(times - start, end - start)
                ends = _ends(quantity, known, values, share)
                table = ends[0] + fractions[:, None] * (ends[1] - ends[0])
            tables[what].append(table)
    empty = np.empty((fractions.size, 0))
    return Guess(
        start,
        end,
        fractions,
        np.concatenate([*tables["states"], empty], axis=1),
        np.concatenate([*tables["controls"], empty], axis=1),
    )


def _known_next(
    phase: Guessed,
    name: str,
    span: tuple[float, float],
    later: tuple[Floats, Floats] | None,
) -> tuple[Floats, Floats]:
    """Return when and where a state is known next, from the start of `phase` on, an entry each.

    At its ends it is known where it is fixed or guessed, and from `later` on by the phases after.
    """
    one = phase.states[name]
    if name in phase.guessed:
        value = sample_guess(one, phase.guessed[name], np.zeros(1), span)[0]
        return np.full(one.size, span[0]), value
    times, values = later or (np.full(one.size, np.nan), np.full(one.size, np.nan))
    for t, side in ((span[1], "final"), (span[0], "initial")):
        low, high = getattr(one, f"{side}_lower"), getattr(one, f"{side}_upper")
        times = np.where(low == high, t, times)
        values = np.where(low == high, low, values)
    return times, values


def sample_guess(
    quantity: Quantity, value: Any, fractions: Floats, span: tuple[float, float]
) -> Floats:
    """Return samples of what was given for one quantity, (fractions, size)."""
    if callable(value):
        return _sample(
            quantity.name, value, span[0] + fractions * (span[1] - span[0]), quantity.size
        )
    own, samples = value
    return np.stack(
        [np.interp(fractions, own, samples[:, k]) for k in range(quantity.size)], axis=1
    )


def _sample(name: str, function: Any, times: Floats, size: int) -> Floats:
    rows = []
    for t in times.tolist():
        try:
            value = function(t)
        except Exception as error:
            raise InvalidData(
                f"guess of {name!r} fails at t = {t:g}: {type(error).__name__}: {error}", field=name
            ) from error
        wanted = f"return {size} finite number{'s' * (size > 1)} at every time"
        row = numbers(f"guess of {name!r}", value, wanted, "must").reshape(-1)
        if row.size != size or not np.isfinite(row).all():
            raise InvalidData(
                f"guess of {name!r} must {wanted}, got {show(value)} at t = {t:g}", field=name
            )
        rows.append(row)
    return np.array(rows)


def _ends(one: Quantity, before: Floats, after: Any, share: Any) -> tuple[Floats, Floats]:
    """Return the values at both ends: fixed ones, else from the neighbours, else the other end's.

    What is known after the phase, `after`, is reached by the `share` that the phase has of the way.
    """
    first = one.initial_lower == one.initial_upper
    last = one.final_lower == one.final_upper
    begin = np.where(first, one.initial_lower, before)
    end = np.where(last, one.final_lower, np.nan)
    known = np.where(np.isnan(end), after, end)
    begin = np.where(np.isnan(begin), known, begin)
    begin = np.where(np.isnan(begin), middle(one.lower, one.upper), begin)
    end = np.where(np.isnan(end), begin + share * (after - begin), end)
    end = np.where(np.isnan(end), begin, end)
    return (
        np.clip(begin, one.initial_lower, one.initial_upper),
        np.clip(end, one.final_lower, one.final_upper),
    )
