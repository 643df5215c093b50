"""The same answers without Numba: assembled by NumPy, factorised by SciPy's banded Cholesky.

``solver()`` gives the compiled solver where Numba can be imported, and this one elsewhere.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.special
from numpy.typing import NDArray

from .hermite import (
    MOST_REFINEMENTS,
    REFINED,
    WORST,
    Info,
    Outcome,
    Solved,
    Table,
    has_one_optimum,
    jets_to_coefficients,
    patterns,
    scaled_jets,
    table_of,
)

log = logging.getLogger("crosstrack")

__all__ = ["Solver", "solve_hermite", "solver"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


class Solver(NamedTuple):
    """Two functions, and whether they are compiled."""

    solve_hermite: Callable[[Floats, Floats, Bools, Floats, int], Solved]
    jets_to_coefficients: Callable[..., Floats]
    compiled: bool


def solver(*, compiled: bool | None = None) -> Solver:
    """Return the compiled solver, or this one where Numba is missing.

    Parameters
    ----------
    compiled : bool, optional
        True raises ImportError where Numba is missing; False never compiles.
    """
    if compiled is not False:
        try:
            from . import banded
        except ImportError as error:
            if compiled:
                raise
            log.info("minimum_snap: without Numba (%s)", error)
        else:
            return Solver(banded.solve_hermite, banded.jets_to_coefficients, True)
    return Solver(solve_hermite, jets_to_coefficients, False)


def solve_hermite(
    durations: Floats, values: Floats, fixed: Bools, weights: Floats, continuity: int
) -> Solved:
    """Minimise ∫ Σ_j w_j (x^(j))² dt: see ``banded.solve_hermite``."""
    durations = np.asarray(durations, np.float64)
    fixed = np.asarray(fixed, np.bool_)
    weights = np.asarray(weights, np.float64)
    values = np.where(fixed, np.asarray(values, np.float64), 0.0)
    axes, knots, order = values.shape
    table = table_of(weights)
    jets, objective = np.empty((axes, knots - 1, 2, order)), np.empty(axes)
    groups = list(patterns(fixed))
    info: Info = {
        "outcome": Outcome.SOLVED,
        "residual": 0.0,
        "refinements": 0,
        "factorisations": len(groups),
        "pivot": None,
        "method": "scipy",
        "lows": None,
    }
    for members in groups:
        pattern = fixed[members[0]]
        unique = has_one_optimum(durations, pattern, weights, continuity)
        if unique is None:
            # Pivots hold squares, and half the digits: the motions without cost tell more.
            unique = _holds_all(durations, pattern, weights, continuity)
        outcome, pivot = Outcome.NOT_UNIQUE, None
        if unique is not False:
            front = _Fronts(durations, pattern, table, continuity)
            pivot = front.factorise()
            if pivot is None:
                own = _begin(values[members], pattern)
                residual, steps = front.descend(own)
                jets[members] = own
                objective[members] = front.evaluate(own)[0]
                outcome = Outcome.SOLVED if residual <= WORST else Outcome.ILL_CONDITIONED
                info["residual"] = max(info["residual"], residual)
                info["refinements"] = max(info["refinements"], steps - 1)
            else:
                outcome = Outcome.ILL_CONDITIONED
        if outcome is not Outcome.SOLVED:
            info["outcome"], info["residual"] = outcome, np.inf
            info["pivot"] = None if pivot is None else (int(members[0]), *pivot)
            jets[:], objective[:] = np.nan, np.nan
            break
    return Solved(jets, objective, info)


def _holds_all(durations: Floats, pattern: Bools, weights: Floats, continuity: int) -> bool:
    """Return whether no piecewise polynomial free of cost vanishes with all that is fixed.

    Such a polynomial has a degree below the least order with a weight. Segment by segment, what
    binds it is made triangular; what is left over binds the next one.
    """
    least = int(np.flatnonzero(weights)[0]) + 1
    orders, powers = np.arange(pattern.shape[1])[:, None], np.arange(least)[None]
    ends = scipy.special.poch(powers - orders + 1.0, orders) * (powers >= orders)
    starts = ends * (powers == orders)
    bound = np.empty((0, least))
    for k, long in enumerate(durations):
        units = long**-orders
        here = np.concatenate([bound, (starts * units)[pattern[k]], (ends * units)[pattern[k + 1]]])
        rows = np.concatenate([here, np.zeros_like(here)], axis=1)
        if k + 1 < len(durations):
            joined = ~pattern[k + 1] & (orders[:, 0] <= continuity)
            after = starts * durations[k + 1] ** -orders
            both = np.concatenate([ends * units, -after], axis=1)[joined]
            rows = np.concatenate([rows, both])
        sizes = np.linalg.norm(rows, axis=1)
        rows = rows[sizes > 0] / sizes[sizes > 0, None]
        if len(rows) < least:
            return False
        triangle: Floats = np.asarray(np.linalg.qr(rows, mode="r"), np.float64)
        if np.linalg.matrix_rank(triangle[:least, :least], tol=1e-10) < least:
            return False
        bound = triangle[least:, least:]
        bound = bound[np.abs(bound).max(axis=1, initial=0.0) > 1e-12]
    return True


def _begin(values: Floats, pattern: Bools) -> Floats:
    """Return jets with what is fixed; free positions take the fixed one before, the rest is 0."""
    state = values.copy()
    held = np.flatnonzero(pattern[:, 0])
    if held.size:
        place = np.searchsorted(held, np.arange(len(pattern)), "right") - 1
        state[:, :, 0] = values[:, held[np.maximum(place, 0)], 0]
    return np.stack([state[:, :-1], state[:, 1:]], axis=2)


#: Derivatives smaller than this, beside what the jets at their ends could make, are rounding.
_DIGITS = 1e-9


class _Fronts:
    """The Hessian of one pattern: what a segment has for itself apart from what knots share."""

    def __init__(self, durations: Floats, pattern: Bools, table: Table, continuity: int) -> None:
        self.order = pattern.shape[1]
        self.shared = continuity + 1
        self.durations, self.table = durations, table
        r, s = self.order, self.shared
        self.units = durations[:, None] ** np.tile(np.arange(r), 2)
        self.free = ~np.concatenate([pattern[:-1], pattern[1:]], axis=1)
        self.free_shared = ~pattern[:, :s]
        # Free positions are rounded as they stand, not as they differ.
        self.loose = not pattern[:, 0].all()
        self.own = np.array([*range(s, r), *range(r + s, 2 * r)], np.int64)
        self.joint = np.array([*range(s), *range(r, r + s)], np.int64)

    def factorise(self) -> tuple[int, int] | None:
        """Factorise; return knot and order of the pivot that fails, or None."""
        table, s = self.table, self.shared
        scale = table.gram_weights * self.durations[:, None] ** (1.0 - 2.0 * table.gram_orders)
        local = np.einsum("kj,jpq->kpq", scale, table.grams)
        local *= self.units[:, :, None] * self.units[:, None, :]
        local *= self.free[:, :, None] & self.free[:, None, :]
        joint = local[:, self.joint[:, None], self.joint]
        diagonal = np.einsum("kpp->kp", joint)
        sums = np.zeros((len(local) + 1, s))
        sums[:-1] += diagonal[:, :s]
        sums[1:] += diagonal[:, s:]
        if self.own.size:
            inner = local[:, self.own[:, None], self.own]
            size = np.sqrt(np.einsum("kpp->kp", inner))
            held = ~self.free[:, self.own]
            size[held] = 1.0
            inner /= size[:, :, None] * size[:, None, :]
            inner[:, np.arange(self.own.size), np.arange(self.own.size)] = 1.0
            weakest = np.linalg.eigvalsh(inner)[:, 0]
            if weakest.min() <= 0.0:
                return int(weakest.argmin()), s
            mixed = local[:, self.own[:, None], self.joint]
            self.inner = inner
            self.size = size
            self.mixed = mixed
            self.lifted = np.linalg.solve(inner, mixed / size[:, :, None]) / size[:, :, None]
            joint = joint - np.einsum("kop,koq->kpq", mixed, self.lifted)
        # Lower banded form: unknown knot * s + i, and 1 in the place of what is fixed.
        band = np.zeros((2 * s, s * (len(local) + 1)))
        for p in range(2 * s):
            for q in range(p + 1):
                start = q if q < s else s + q - s
                stop = start + s * len(local)
                band[p - q, start:stop:s] += joint[:, p, q]
        flat = self.free_shared.ravel()
        band[0, ~flat] = 1.0
        self.scale = np.ones(flat.size)
        self.scale[flat] = np.sqrt(sums.ravel()[flat])
        for d in range(2 * s):
            band[d, : flat.size - d] /= self.scale[d:] * self.scale[: flat.size - d]
        try:
            self.factor = scipy.linalg.cholesky_banded(band, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            return 0, 0
        return None

    def evaluate(self, jets: Floats) -> tuple[Floats, Floats, Floats]:
        """Return J of each axis, half the gradient of each side, and how large it might be."""
        table = self.table
        scaled = scaled_jets(self.durations, jets)
        moments = scaled @ table.rows.T
        factors = table.factors * self.durations[:, None] ** (1.0 - 2.0 * table.orders)
        forces = factors * moments
        objective = np.einsum("akn,akn->ak", forces, moments).sum(axis=1)
        sides = (forces @ table.rows) * self.units
        # A derivative may vanish at all knots: its terms say how large it is between.
        sizes = np.zeros_like(sides)
        for n, row in enumerate(np.abs(table.rows)):
            np.maximum(sizes, np.abs(forces[:, :, n, None]) * row, out=sizes)
        sizes *= self.units
        # There are no more digits than these: jumps below them are not to be told from none.
        largest = np.abs(table.rows).max(axis=1)
        strength = (factors * largest) @ np.abs(table.rows) * self.units
        amount = np.abs(scaled).sum(axis=2)
        if self.loose:
            amount += np.abs(jets[:, :, 0, 0])
        sizes = np.maximum(sizes, _DIGITS * strength * amount[..., None])
        return objective, sides, sizes

    def descend(self, jets: Floats) -> tuple[float, int]:
        """Take Newton steps until the jumps are rounding; return the residual and the steps."""
        r, s = self.order, self.shared
        axes, count = jets.shape[:2]
        before, steps = np.inf, 0
        while True:
            _, sides, sizes = self.evaluate(jets)
            sides = sides * self.free
            gradient = np.zeros((axes, count + 1, s))
            gradient[:, :-1] += sides[:, :, :s]
            gradient[:, 1:] += sides[:, :, r : r + s]
            jumps = np.zeros((axes, r))
            jumps[:, :s] = np.abs(gradient).max(axis=1)
            jumps[:, s:] = np.abs(sides).reshape(axes, count, 2, r).max(axis=(1, 2))[:, s:]
            most = sizes.reshape(axes, count, 2, r).max(axis=(1, 2))
            ratio = np.divide(jumps, most, out=np.zeros_like(jumps), where=most > 0)
            residual = float(ratio.max())
            stalled = steps > 1 and not residual < 0.5 * before
            if residual <= REFINED or steps == MOST_REFINEMENTS + 1 or stalled:
                return residual, steps
            before = residual
            steps += 1
            if self.own.size:
                force = np.einsum("kop,ako->akp", self.lifted, sides[:, :, self.own])
                gradient[:, :-1] -= force[:, :, :s]
                gradient[:, 1:] -= force[:, :, s:]
            right = -gradient.reshape(axes, -1) / self.scale * self.free_shared.ravel()
            found = scipy.linalg.cho_solve_banded((self.factor, True), right.T, check_finite=False)
            change = (found.T / self.scale).reshape(axes, count + 1, s)
            jets[:, :, 0, :s] += change[:, :-1]
            jets[:, :, 1, :s] += change[:, 1:]
            if self.own.size:
                both = np.concatenate([change[:, :-1], change[:, 1:]], axis=2)
                pull = -sides[:, :, self.own] - np.einsum("kop,akp->ako", self.mixed, both)
                held = np.linalg.solve(
                    self.inner, np.moveaxis(pull / self.size, 0, 2)
                )  # (count, own, axes)
                moved = np.moveaxis(held, 2, 0) / self.size * self.free[:, self.own]
                jets[:, :, 0, s:] += moved[:, :, : r - s]
                jets[:, :, 1, s:] += moved[:, :, r - s :]
