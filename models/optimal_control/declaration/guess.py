"""Guesses for the search of an optimal control: samples, functions or another plan."""

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
from .instants import Instants
from .terms import column, entries, middle, numbers

__all__ = ["After", "Guessed", "define_linked", "draw_lines", "sample_guess"]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX

#: Time and value of the next known point of each state, per entry; NaN if unknown.
After = Mapping[str, tuple[Floats, Floats]]

#: Number of samples of a function or of another plan.
SAMPLES = 201


class Guessed(Instants):
    """Guessed data of a phase: samples (fractions, table) or functions of time, by quantity.

    The key ``"time"`` holds the guessed times of both ends. States in `flown` are integrated with
    the guessed controls and with the feedback laws in `feedback`.
    """

    guessed: dict[str, Any]
    flown: set[str]
    feedback: dict[str, Symbol]

    def guess(self, plan: Any = None, *, time: Any = None, **values: Any) -> None:
        """Guess the states and controls of the phase, as a start of the search.

        Parameters
        ----------
        plan : ControlPlan, Solution or PhasePlan, optional
            Another plan. Its times, and its states and controls with equal names, are used as guess.
        time : array_like, optional
            Times of the samples in `values`, whose ends are guesses of free times. By default the
            samples are equidistant.
        **values : array_like or callable
            Guess of a state or control by name: samples (one row per sample for a vector), which are
            interpolated linearly, a constant, or a function of time.

        Raises
        ------
        InvalidData
            A name is unknown, or a value has another size or is not finite.
        """
        self.opened()
        result = {} if plan is None else _take_over(self, plan)
        fractions: Floats | None = None
        if time is not None:
            grid = _read_times(self, time)
            result["time"] = float(grid[0]), float(grid[-1])
            fractions = (grid - grid[0]) / (grid[-1] - grid[0])
        for name, value in values.items():
            quantity = self.states.get(name) or self.controls.get(name)
            if quantity is None:
                known = ", ".join(map(repr, [*self.states, *self.controls]))
                raise InvalidData(
                    f"guess of {name!r}: phase {self.name!r} has the states and controls {known}",
                    field=name,
                )
            # Functions are sampled once the phase's times are known.
            is_function = callable(value)
            result[name] = value if is_function else _table(name, value, quantity.size, fractions)
        self.guessed = self.guessed | result
        # A later guess replaces the simulated values of the same names.
        self.flown -= set(result)
        self.feedback = {name: law for name, law in self.feedback.items() if name not in result}

    def simulate(self, *, time: Any = None, **controls: Any) -> None:
        """Guess the motion that the dynamics produce with given controls.

        The simulation starts from the initial state, or from the guessed one if that is free: for a
        linked phase, the end of the previous one. Parameters have their guessed values. If the end is
        free and no `time` is given, the simulation ends when the final values are nearest. It runs
        when the problem is built.

        Parameters
        ----------
        time : array_like, optional
            Times of the samples in `controls`, from the start to the end of the simulation.
        **controls : array_like, callable or casadi expression
            Controls by name: a constant, samples, a function of time, or a feedback law, which is an
            expression in the phase's states, its time and parameters. Others keep their guess.

        Raises
        ------
        InvalidData
            A name is not a control, or a value has another size. When the problem is built: the
            simulation diverges, so that a state or rate is not finite.
        """
        for name in controls:
            known = [key for key, item in self.controls.items() if not item.algebraic]
            if name not in known:
                raise InvalidData(
                    f"simulate with {name!r}: phase {self.name!r} has the controls "
                    f"{', '.join(map(repr, known)) or 'none'}",
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
    """Return the times of samples, which must start and end within the bounds of the phase."""
    rule = "finite, increasing times"
    grid = numbers("time of a guess", time, rule)
    increasing = grid.ndim == 1 and grid.size >= 2 and np.isfinite(grid).all()
    if not increasing or not (np.diff(grid) > 0).all():
        raise InvalidData(f"time of a guess must be {rule}, got {show(time)}", field="time")
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
        names = [item.name for item in plan.phases]
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
    result: dict[str, Any] = {"time": (plan.start, plan.end)}
    for part, names_of in ((plan.states, plan.state_names), (plan.controls, plan.control_names)):
        table = part(np.clip(grid, plan.start, plan.end))
        for name, quantity in {**phase.states, **phase.controls}.items():
            entries = [
                k for k, item in enumerate(names_of) if item == name or item.startswith(f"{name}[")
            ]
            if len(entries) == quantity.size:
                result[name] = (places, table[:, entries])
    if len(result) == 1:
        known = ", ".join(map(repr, [*plan.state_names, *plan.control_names]))
        raise InvalidData(
            f"guess of phase {phase.name!r}: the plan has {known}, none of which the phase knows in "
            "that size",
            field="guess",
        )
    return result


def _times(phase: Guessed, begin: float = 0.0) -> tuple[float, float]:
    """Return the guessed times of a phase; by default from `begin` to the middle of the end's bounds."""
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
    """Return the phases, with guesses that continue across linked states.

    `define` creates a phase from the arguments of :func:`draw_lines`.
    """
    order = {phase.name: k for k, phase in enumerate(phases)}
    onward = [link for link in links if order[link[0].name] < order[link[1].name]]
    spans: dict[str, tuple[float, float]] = {}
    for phase in phases:
        begin = max([0.0, *(spans[a.name][1] for a, b, _ in onward if b is phase)])
        spans[phase.name] = _times(phase, begin)
    after: dict[str, dict[str, tuple[Floats, Floats]]] = {name: {} for name in order}
    for phase in reversed(phases):
        for _, second, names in (link for link in onward if link[0] is phase):
            later, span = after[second.name], spans[second.name]
            after[phase.name] |= {k: _known_next(second, k, span, later.get(k)) for k in names}
    defined: dict[str, Phase] = {}
    for phase in phases:
        before: dict[str, Floats] = {}
        for first, _, names in (link for link in onward if link[1] is phase):
            guess, states = defined[first.name].guess, defined[first.name].states
            cuts = np.cumsum([state.size for state in states])[:-1]
            ends = zip(states, np.split(guess.states[-1], cuts), strict=True)
            before |= {state.name: end for state, end in ends if state.name in names}
            spans[phase.name] = _times(phase, guess.end)
        defined[phase.name] = define(phase, spans[phase.name], before, after[phase.name])
    return tuple(defined.values())


def draw_lines(
    phase: Guessed, span: tuple[float, float], before: Mapping[str, Floats], after: After
) -> Guess:
    """Return the guess of a phase: given values, and straight lines for the others.

    A state moves between its fixed ends. A free state continues from the value `before` of the previous phase
    towards its next known value in later phases. An unknown value equals that of the other end, or the middle
    of its bounds, or 0 moved into the bounds.
    """
    values_of = {name: value for name, value in phase.guessed.items() if name != "time"}
    start, end = span
    places = {0.0, 1.0}
    for value in values_of.values():
        positions = np.linspace(0.0, 1.0, SAMPLES) if callable(value) else value[0]
        places.update(positions.tolist())
    fractions = np.array(sorted(places))
    tables: dict[str, list[Floats]] = {"states": [], "controls": []}
    for what in ("states", "controls"):
        for quantity in getattr(phase, what).values():
            if quantity.name in values_of:
                table = sample_guess(quantity, values_of[quantity.name], fractions, span)
            else:
                times, values = after.get(quantity.name, (np.nan, np.nan))
                known = before.get(quantity.name, np.full(quantity.size, np.nan))
                share = (end - start) / np.fmax(times - start, end - start)
                ends = _ends(quantity, known, values, share)
                table = ends[0] + fractions[:, None] * (ends[1] - ends[0])
            tables[what].append(table)
    empty = np.empty((fractions.size, 0))
    states, controls = (np.concatenate([*table, empty], axis=1) for table in tables.values())
    return Guess(start, end, fractions, states, controls)


def _known_next(
    phase: Guessed, name: str, span: tuple[float, float], later: tuple[Floats, Floats] | None
) -> tuple[Floats, Floats]:
    """Return time and value of the next known point of a state from the start of `phase`, per entry.

    The state is known at its fixed or guessed ends, and otherwise from `later`, the result for the
    next phase.
    """
    state = phase.states[name]
    if name in phase.guessed:
        value = sample_guess(state, phase.guessed[name], np.zeros(1), span)[0]
        return np.full(state.size, span[0]), value
    times, values = later or (np.full(state.size, np.nan), np.full(state.size, np.nan))
    for t, side in ((span[1], "final"), (span[0], "initial")):
        low, high = getattr(state, f"{side}_lower"), getattr(state, f"{side}_upper")
        times = np.where(low == high, t, times)
        values = np.where(low == high, low, values)
    return times, values


def sample_guess(
    quantity: Quantity, value: Any, fractions: Floats, span: tuple[float, float]
) -> Floats:
    """Return samples of the guess of one quantity, shape (fractions, size)."""
    name, size, rows = quantity.name, quantity.size, []
    if not callable(value):
        positions, samples = value
        return np.stack([np.interp(fractions, positions, column) for column in samples.T], axis=1)
    for t in (span[0] + fractions * (span[1] - span[0])).tolist():
        try:
            result = value(t)
        except Exception as error:
            raise InvalidData(
                f"guess of {name!r} fails at t = {t:g}: {type(error).__name__}: {error}", field=name
            ) from error
        rule = f"return {size} finite number{'s' * (size > 1)} at every time"
        row = numbers(f"guess of {name!r}", result, rule, "must").reshape(-1)
        if row.size != size or not np.isfinite(row).all():
            raise InvalidData(
                f"guess of {name!r} must {rule}, got {show(result)} at t = {t:g}", field=name
            )
        rows.append(row)
    return np.array(rows)


def _ends(quantity: Quantity, before: Floats, after: Any, share: Any) -> tuple[Floats, Floats]:
    """Return the values at both ends: fixed ones, those of the neighbours, or that of the other end.

    The value `after` the phase is approached by the `share` of the time that the phase takes.
    """
    first = quantity.initial_lower == quantity.initial_upper
    last = quantity.final_lower == quantity.final_upper
    begin = np.where(first, quantity.initial_lower, before)
    end = np.where(last, quantity.final_lower, np.nan)
    known = np.where(np.isnan(end), after, end)
    begin = np.where(np.isnan(begin), known, begin)
    begin = np.where(np.isnan(begin), middle(quantity.lower, quantity.upper), begin)
    end = np.where(np.isnan(end), begin + share * (after - begin), end)
    end = np.where(np.isnan(end), begin, end)
    return (
        np.clip(begin, quantity.initial_lower, quantity.initial_upper),
        np.clip(end, quantity.final_lower, quantity.final_upper),
    )
