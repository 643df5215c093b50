"""Certified paths within bounds: Newton's method on the path and the instants of contact together.

The interior point identifies the active bounds but not the exact instants, and the objective is
insensitive to the shape of long segments next to short ones. At the optimum the path touches a bound
at local extremes, each with a multiplier ("force") λ > 0. With ``n_s`` the row of an instant s,
``C'C y + Σ λ n_s = 0`` and ``n_s y = b``. An extreme moves with the path,
``ds = n'_s dy / |n''_s y|``, so the Newton system of y has an additional term for each contact,
``λ / |n''_s y| n'_s' n'_s`` (the reduced Hessian of semi-infinite programs: Hettich and Kortanek,
SIAM Review 35, 1993). The last step proves the path, as in :mod:`~.banded` without bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.instants import Instants, outside
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.polynomials import derived, horner
from .banded import added, knot_forces
from .chain import Chain
from .chain_kernels import bound_gradient, factorise, row_values, solve_factors
from .hermite import has_one_optimum, jets_to_coefficients, table_of
from .interior_kernels import STOPPED
from .interior_state import State
from .moment_kernels import differentiate

__all__ = ["CERTIFIED", "Certified", "certify_chain", "uncertifiable"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Largest last Newton step of a certified path, as a share of the extent.
CERTIFIED = 1e-7
#: Newton's method stops after a step below this share of the extent.
DONE = 1e-11
#: Largest numbers of Newton steps per set of contacts, and of sets per interior-point iterate.
STEPS, ROUNDS = 15, 6
#: Relative complementarities for further interior-point iterations if its last iterate does not
#: determine the contacts. Forces on long segments are 1e-18 of those on segments 400 times shorter.
DEPTHS = (1e-14, 1e-18, 1e-22)
#: Smallest violation that adds rows to these iterates. Newton's method corrects smaller violations.
ROUGH = 1e-6
#: Weight of a contact's row relative to the curvature along it. The next step removes its residual.
WEIGHT = 1e6
#: Instants closer than this, in scaled time, are one contact: initially, and at extremes.
NEAR, SAME = 3e-2, 1e-2
#: Largest change of the instant of an extreme in one step, and rounding error of an instant.
FAR, SNAP = 0.1, 1e-9
_ULP = float(np.finfo(float).eps)


class Certified(NamedTuple):
    """Path that Newton's method converges to."""

    #: Coefficients in ascending powers of s, shape (segments, 2r, axes).
    powers: Floats
    #: J, and a bound on its distance from the optimum.
    objective: float
    gap: float
    #: Largest change of a scaled derivative in the last step, as a share of the extent.
    correction: float
    #: Number of contacts.
    contacts: int


class _Contacts(NamedTuple):
    """Instants of contact: side 1 at upper and -1 at lower bounds, and the force λ on the path.

    If ``flat``, the path coincides with the bound on the whole segment and the instants are fixed.
    """

    at: Instants
    side: Floats
    force: Floats
    flat: Bools

    def taken(self, index: Ints) -> _Contacts:
        return _Contacts(
            self.at.taken(index), self.side[index], self.force[index], self.flat[index]
        )

    def joined(self, other: _Contacts) -> _Contacts:
        parts = (np.concatenate([a, b]) for a, b in zip(self[1:], other[1:], strict=True))
        return _Contacts(self.at.joined(other.at), *parts)

    def owners(self) -> Ints:
        """Return a number for each contact, equal for the same bound, segment, axis and side."""
        number: Ints = 2 * self.at.row + (self.side > 0.0)
        return number

    def merged(self, reach: float) -> _Contacts:
        """Merge contacts of the same owner closer than `reach`, sorted by segment, except flat ones."""
        if not self.side.size:
            return self
        owners = self.owners()
        order = np.lexsort((self.at.s, owners))
        ours, owners = self.taken(order), owners[order]
        apart = (np.diff(owners) != 0) | (np.diff(ours.at.s) >= reach) | ours.flat[1:]
        group = np.concatenate([[0], np.cumsum(apart)])
        weight = np.abs(ours.force) + 1e-300
        s = np.bincount(group, weight * ours.at.s) / np.bincount(group, weight)
        first = np.flatnonzero(np.concatenate([[True], apart]))
        entry = ours.taken(first)
        return entry._replace(
            at=entry.at._replace(s=s), force=np.bincount(group, ours.force).astype(float)
        )


def uncertifiable(model: MinimumDerivative) -> str:
    """Return the reason why paths of `model` cannot be certified, or an empty string."""
    least = 2 * model.order - 1
    if model.degree > least:
        return f"the degree {model.degree} is above 2 order - 1 = {least}"
    for axis in range(model.dimensions):
        fixed = np.isfinite(model.jets[:, :, axis])
        if not has_one_optimum(model.durations, fixed, model.order_weights, model.order - 1):
            return (
                f"what is fixed on axis {axis} leaves motions that cost nothing, so the optimum may "
                "not be unique"
            )
    return ""


def certify_chain(state: State, threshold: float) -> Certified | None:
    """Return the certified path of a solved chain, or None without proof.

    The interior point continues from its last iterate if necessary. `threshold` is the largest
    violation between the instants, in the scale of the verification.
    """
    for depth in (None, *DEPTHS):
        if depth is not None and not _deeper(state, depth):
            return None
        result = _refined(state, threshold)
        if result is not None:
            return result
    return None


def _deeper(state: State, depth: float) -> bool:
    """Reduce the barrier to `depth` and add rows at violations. Return False if stopped."""
    if state.descend(depth)[0] == STOPPED:
        return False
    fresh, _ = state.find_violations(ROUGH)
    if fresh is None:
        return True
    state.now = state.add(fresh, [state.now])[0]
    return state.descend(depth)[0] != STOPPED


@np.errstate(all="ignore")  # an overflow yields NaN, which proves nothing
def _refined(state: State, threshold: float) -> Certified | None:
    """Solve with the contacts of the iterate. Drop those with negative force, add violated ones."""
    path = _Path(state.chain, state.now.knots)
    contacts = _flattened(_pressing(state, path.stiffness).merged(NEAR), state.chain)
    for _ in range(ROUNDS):
        contacts = path.settle(contacts, state.flag)
        if state.flag[0] != 0 or not path.correction <= 1.0 / _ULP:
            return None
        pulls = contacts.force < 0.0
        if pulls.any():
            contacts = contacts.taken(np.flatnonzero(~pulls))
            continue
        fresh = path.violations(threshold)
        if fresh.side.size:
            contacts = contacts.joined(fresh)
            continue
        if not path.correction <= CERTIFIED:
            return None
        objective = float(path.objective.sum())
        gap = path.gap + 32.0 * _ULP * objective
        return Certified(path.powers(), objective, gap, path.correction, contacts.side.size)
    return None


def _pressing(state: State, stiffness: Floats) -> _Contacts:
    """Return the contacts whose force, times their compliance, exceeds their slack."""
    posed, (slack, z) = state.posed, state.now[2:]
    segment = state.chain.limits.segment[state.held.row]
    give = _compliance(posed.rows, segment, posed.fixed, stiffness * state.scale**2)
    parts = []
    for side in (0, 1):
        at = np.flatnonzero(np.isfinite(posed.edge[side]) & (z[side] * give > slack[side]))
        force = z[side, at] / state.scale**2
        flat = np.zeros(at.size, bool)
        sign = np.full(at.size, 2.0 * side - 1.0)
        parts.append(_Contacts(state.held.taken(at), sign, force, flat))
    return parts[0].joined(parts[1])


def _compliance(rows: Floats, segment: Ints, fixed: Bools, stiffness: Floats) -> Floats:
    """Return the displacement of each row per unit force, from the curvatures at its knots alone."""
    free = np.where(np.concatenate([fixed[segment], fixed[segment + 1]], axis=1), 0.0, rows)
    squares = free[:, : 2 * fixed.shape[1]] ** 2
    local = np.concatenate([stiffness[segment], stiffness[segment + 1]], axis=1)
    against = (squares * local).sum(axis=1)
    give: Floats = squares.sum(axis=1) ** 2 / np.where(against > 0.0, against, np.inf)
    return give


def _flattened(contacts: _Contacts, chain: Chain) -> _Contacts:
    """Mark the contacts of polynomials that touch a bound more often than their degree allows."""
    if not contacts.side.size:
        return contacts
    orders = chain.limits.derivative[contacts.at.row]
    roots = np.where((contacts.at.s > NEAR) & (contacts.at.s < 1.0 - NEAR), 2.0, 1.0)
    owners = contacts.owners()
    flat = np.bincount(owners, roots)[owners] > chain.model.degree - orders
    return contacts._replace(flat=flat)


@dataclass(frozen=True)
class _Posed:
    """Rows of contacts, sorted by segment: weighted values, and slopes for the moving extremes."""

    contacts: _Contacts
    value: Ints
    rows: Floats
    target: Floats
    weight: Floats
    start: Ints
    factors: Floats
    last: Floats


class _Path:
    """Jets of a chain in twice the digits, with their Newton steps."""

    def __init__(self, chain: Chain, knots: Floats) -> None:
        self.chain, self.axes = chain, len(chain.axes)
        model = chain.model
        self.order, self.count = model.order, model.segments
        self.durations = np.array(model.durations)
        self.table = table_of(model.order_weights)
        self.fixed, given = chain.start(self.durations)
        self.cost = chain.cost(self.durations)
        self.unit = chain.units(self.durations)
        self.jets = self._jets(np.where(self.fixed, given, knots))
        self.lows = np.zeros_like(self.jets)
        squares, n = np.einsum("kcp,kcp->kp", self.cost, self.cost), chain.jets
        self.stiffness = np.zeros((self.count + 1, n))
        self.stiffness[:-1] += squares[:, :n]
        self.stiffness[1:] += squares[:, n : 2 * n]
        self.correction, self.gap = np.inf, np.inf
        self.pull = self._pull()

    def _jets(self, knots: Floats) -> Floats:
        """Return jets, shape (axes, segments, 2, r), of the chain's coordinates of knots."""
        own = (knots / self.unit).reshape(self.count + 1, self.axes, self.order).swapaxes(0, 1)
        return np.ascontiguousarray(np.stack([own[:, :-1], own[:, 1:]], axis=2))

    def _knots(self) -> Floats:
        jets = self.jets + self.lows
        own = np.concatenate([jets[:, :, 0], jets[:, -1:, 1]], axis=1)
        knots: Floats = own.swapaxes(0, 1).reshape(self.count + 1, -1) * self.unit
        return knots

    def _pull(self) -> Floats:
        """Return minus half the gradient of J with respect to the knots."""
        forces, rests = np.empty_like(self.jets), np.empty_like(self.jets)
        self.moments = np.empty((self.axes, self.count, len(self.table.rows)))
        self.objective = np.empty(self.axes)
        differentiate(
            self.durations, self.table.rows, self.table.factors, self.table.orders, self.jets,
            self.lows, forces, rests, self.moments, self.objective,
        )  # fmt: skip
        knots = knot_forces(forces, rests, self.order).swapaxes(0, 1).reshape(self.count + 1, -1)
        pull: Floats = np.where(self.fixed, 0.0, -knots / self.unit)
        return pull

    def powers(self) -> Floats:
        """Return the coefficients in ascending powers of s, shape (segments, 2r, axes)."""
        powers = jets_to_coefficients(self.durations, self.jets, self.moments[..., -self.order :])
        powers[:, 0] += self.chain.origin
        return powers

    def settle(self, contacts: _Contacts, flag: NDArray[np.int8]) -> _Contacts:
        """Take Newton steps until they are rounding errors. Return the contacts at the extremes."""
        before = np.inf
        for step in range(STEPS):
            posed = self._posed(*self._located(contacts))
            contacts = self._stepped(posed)
            stuck = step > 5 and not self.correction < 0.5 * before
            if not self.correction > DONE or stuck or flag[0] != 0:
                break
            before = min(before, self.correction)
        return contacts

    def _located(self, contacts: _Contacts) -> tuple[_Contacts, Floats]:
        """Return the contacts moved to the nearest extremes, and their curvatures (0: fixed)."""
        contacts = contacts.merged(SAME)
        polynomials = self.chain.limits.polynomials(self.powers(), self.durations)
        height = polynomials[contacts.at.row][:, :, None] * contacts.side[:, None, None]
        slope, bend = derived(height, 1), derived(height, 2)
        first = s = contacts.at.s
        low, high = np.maximum(first - FAR, 0.0), np.minimum(first + FAR, 1.0)
        for _ in range(6):
            curve = horner(bend, s[:, None])[:, 0]
            move = -horner(slope, s[:, None])[:, 0] / np.where(curve < 0.0, curve, -np.inf)
            s = np.clip(s + np.clip(move, -0.5 * FAR, 0.5 * FAR), low, high)
        s = np.where(
            contacts.flat, first, np.where(s < SNAP, 0.0, np.where(s > 1.0 - SNAP, 1.0, s))
        )
        sharp = -horner(bend, s[:, None])[:, 0]
        moves = ~contacts.flat & (s > 0.0) & (s < 1.0) & (sharp > 0.0) & (contacts.force > 0.0)
        return contacts._replace(at=contacts.at._replace(s=s)), np.where(moves, sharp, 0.0)

    def _posed(self, contacts: _Contacts, sharp: Floats) -> _Posed:
        chain = self.chain
        held = chain.imposed(contacts.at)
        rows, share = chain.rows(self.durations, held)
        moves = np.flatnonzero(sharp)
        moving = chain.imposed(contacts.at.taken(moves), slope=True)
        slopes, size = chain.rows(self.durations, moving)
        target = np.where(contacts.side > 0.0, held.limits.upper, -held.limits.lower) * share
        # Forces belong to normalised rows.
        spring = contacts.force[moves] * share[moves] / (sharp[moves] * size**2)
        segment = np.concatenate([held.limits.segment, moving.limits.segment])
        order = np.argsort(segment, kind="stable")
        segment, n = segment[order], chain.jets
        rows = np.concatenate([rows, slopes])
        rows *= np.concatenate([contacts.side, contacts.side[moves]])[:, None]
        rows = np.ascontiguousarray(rows[order])
        bend = np.concatenate([np.zeros(contacts.side.size), spring])[order]
        stiffness = self.stiffness.copy()
        np.add.at(stiffness, segment, bend[:, None] * rows[:, :n] ** 2)
        np.add.at(stiffness, segment + 1, bend[:, None] * rows[:, n : 2 * n] ** 2)
        give = _compliance(rows, segment, self.fixed, stiffness)
        place = np.argsort(order)
        value = place[: contacts.side.size]
        weight = np.sqrt(bend)
        weight[value] = np.sqrt(WEIGHT / np.where(give > 0.0, give, np.inf))[value]
        start = np.searchsorted(segment, np.arange(self.count + 1)).astype(np.int64)
        factors, last = np.zeros((self.count, n, 2 * n)), np.zeros((n, n))
        factorise(self.cost, rows, start, weight, self.fixed, factors, last)
        targets = np.concatenate([target, np.zeros(moves.size)])[order]
        return _Posed(contacts, value, rows, targets, weight, start, factors, last)

    def _stepped(self, posed: _Posed) -> _Contacts:
        """Take one Newton step and return the contacts with the new forces."""
        inner = np.zeros((self.count, 0))
        square = posed.weight**2
        off = row_values(posed.rows, posed.start, self._knots(), inner) - posed.target
        force = np.zeros(square.size)
        force[posed.value] = posed.contacts.force
        right = self.pull.copy()
        bound_gradient(posed.rows, posed.start, -(force + square * off), right, inner)
        right[self.fixed] = 0.0
        knots = right.copy()
        solve_factors(posed.factors, posed.last, self.fixed, knots, inner)
        after = force + square * (off + row_values(posed.rows, posed.start, knots, inner))
        self.gap = abs(float((right * knots).sum()))
        self.gap += 2.0 * float(np.abs(after * off)[posed.value].sum())
        step = self._jets(knots)
        self.jets, self.lows = added(self.jets, self.lows, step)
        moved = np.abs(step * self.durations[:, None, None] ** np.arange(self.order))
        self.correction = float(moved.max() / self.chain.model.position_scale.max())
        self.pull = self._pull()
        return posed.contacts._replace(force=after[posed.value])

    def violations(self, threshold: float) -> _Contacts:
        """Return contacts without force at extremes that violate bounds by more than `threshold`."""
        limits = self.chain.limits
        polynomials = limits.polynomials(self.powers(), self.durations)
        at, _ = outside(polynomials, limits, threshold)
        value = horner(polynomials[at.row][:, :, None], at.s[:, None])[:, 0]
        side = np.where(value > limits.upper[at.row], 1.0, -1.0)
        return _Contacts(at, side, np.zeros(at.s.size), np.zeros(at.s.size, bool))
