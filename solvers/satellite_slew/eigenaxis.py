"""``slew-pseudo-inverse``, ``slew-singularity-robust`` and ``slew-generalised``: an eigenaxis slew.

A rotation about one axis with a trapezoidal rate, simulated with a steering law: the practice without
optimal control. A plan is returned even if the gyros come near a singularity; the verification reports
the violation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...errors import UnsupportedFormulation
from ...jit import clock
from ...models.satellite_slew.model import SatelliteSlew
from ...models.satellite_slew.profile import EigenaxisProfile
from ..contract.backend import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Limit,
    Option,
    Request,
    Termination,
)
from ..contract.control import Control
from .closed_loop import ClosedLoop, Flight
from .steering import GeneralisedInverse, PseudoInverse, RobustInverse, SteeringLaw

__all__ = ["Generalised", "PseudoInverseSteering", "SingularityRobust"]

#: Trial peak rates as shares of the rate limit, fastest first; ratio to the best duration at which the
#: scan ends; and number of further peak rates around the best one.
SHARES = (1.0, 0.85, 0.7, 0.6, 0.5, 0.4, 0.25, 0.12, 0.05)
WORSE, REFINEMENTS = 1.1, 5
#: Number of attempts to find the acceleration at which the actuators reach their limits.
ATTEMPTS = 8
#: Smallest relative gain of a further attempt.
NEAR = 1.01
#: Share of the actuators' limits at which the search aims, so that rounding does not exceed them.
AIM = 0.999
#: Accepted relative excess over the limits in the coarse flights of the search: for rates, and for
#: gimbal rates, which saturate.
SLACK, CUT = 1e-6, 2e-3
#: Load below which the satellite does not have to move.
STILL = 1e-9
#: Steps of the search and of the plan, s.
COARSE, FINE = 0.2, 0.05
#: Share of the tolerance for the error at the end of the plan.
END = 0.3
#: Time that the flight of the plan and its verification take, as a multiple of the time of as many steps
#: in the search (2.3 to 2.4 measured).
RESERVE = 2.5
#: Seconds for the flight of the plan after a stop request, and for a run with a time limit, which keeps
#: the reserve. A flight of a minute takes half a second.
EXTRA, EXTRA_IN_TIME = 1.0, 0.2


@dataclass(frozen=True, eq=False)
class _Trial:
    """Simulated rotation, and whether it satisfied all limits."""

    loop: ClosedLoop
    flight: Flight
    feasible: bool

    @property
    def duration(self) -> float:
        """Duration of the rotation, s."""
        return self.loop.profile.duration


class EigenaxisSteering(Backend):
    """Base of the steering laws on an eigenaxis bang-coast-bang rotation.

    The peak rate is the highest one at which the gyros avoid singularities, unless it is given. The
    acceleration is the highest one that the limits of gimbal rates and torque allow. After the
    rotation, feedback and null motion remove the remaining error, so that the plan ends at the
    target.
    """

    accepts = SatelliteSlew
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "peak_rate": Option(
            None,
            "Highest rate of the turn by the rate limit; by default the highest that keeps the "
            "gyros from singularities. A given value is used unchanged.",
            float, lower=1e-3, upper=1.0,
        ),
        "acceleration": Option(
            1.0,
            "Highest acceleration of the turn, by what the torque limit allows; with a peak_rate it "
            "is used unchanged.",
            float, lower=1e-6, upper=1.0,
        ),
    }  # fmt: skip

    #: Steering law, created from the backend's further options in their order.
    law: ClassVar[type[SteeringLaw]]

    def refuses(self, problem: SatelliteSlew) -> str:
        """Return the field that a rotation from rest to rest does not support; empty if none."""
        for name, rates in (("initial_rate", problem.begin_rate), ("final_rate", problem.end_rate)):
            if rates.any():
                return f"{self.name} rotates from rest to rest: it does not support {name}"
        return ""

    def run(self, problem: SatelliteSlew, request: Request) -> Answer:
        """Return the plan of the fastest rotation that satisfies the limits."""
        if reason := self.refuses(problem):
            raise UnsupportedFormulation(reason)
        begin = clock()
        own_options = [name for name in self.options if name not in EigenaxisSteering.options]
        law = self.law(*(request.options[name] for name in own_options))
        search = _Search(problem, law, request)
        peak_rate = request.options["peak_rate"]
        trial = search.fastest() if peak_rate is None else search.flown(peak_rate, search.most, 0.0)
        limit = Limit.TIME if search.is_cut else request.control.limit
        statistics: dict[str, float | int | str] = {"flights": search.flights}
        ending = _ending(request.control, EXTRA if request.time_limit is None else EXTRA_IN_TIME)
        flight = None if trial is None else trial.loop.fly(search.latest, FINE, ending=ending)
        if trial is None or flight is None or (not flight.settled and ending()):
            return Answer(
                Termination.NO_SOLUTION, request.control.limit,
                seconds={"solve": clock() - begin}, statistics=statistics,
                message=f"the {'search' if flight is None else 'flight of the plan'} was stopped",
            )  # fmt: skip
        plan = flight.plan(problem.planned_gimbal_rate)
        statistics |= {
            "peak rate, rad/s": trial.loop.profile.reached,
            "acceleration, rad/s²": trial.loop.profile.acceleration,
            "end of the turn, s": trial.loop.profile.duration,
            "final time, s": flight.knots[-1],
            "least singularity measure": flight.measure,
        }
        return Answer(
            Termination.FEASIBLE, limit, plan,
            seconds={"solve": clock() - begin}, statistics=statistics,
            message=_message(problem, trial.feasible, flight),
        )  # fmt: skip


def _ending(control: Control, extra: float) -> Callable[[], bool]:
    """Return a function that returns True `extra` seconds after it first noticed a stop request."""
    noticed: list[float] = []

    def ending() -> bool:
        if control.stopped and not noticed:
            noticed.append(clock())
        return bool(noticed) and clock() - noticed[0] > extra

    return ending


def _message(problem: SatelliteSlew, is_feasible: bool, flight: Flight) -> str:
    if not flight.settled:
        return "the satellite has not settled within the time range"
    if flight.measure < problem.singularity_limit:
        return (
            f"the gyros come as near to a singularity as det(A A') = {flight.measure:.3g}, below "
            f"{problem.singularity_limit:g}"
        )
    return "" if is_feasible else "the limits of rate or torque were not kept in the search"


class _Search:
    """Search for the fastest rotation that satisfies the limits."""

    def __init__(self, model: SatelliteSlew, law: SteeringLaw, request: Request) -> None:
        self.model, self.law, self.request = model, law, request
        self.latest = float(model.time_range[1])
        self.axis, self.angle = model.turn
        self.begin = clock()
        self.flights = self.steps = 0
        #: Shortest duration of a feasible rotation, s.
        self.shortest = np.inf
        self.is_cut = False
        #: Highest acceleration of the rotation, rad/s².
        self.most = (
            AIM
            * request.options["acceleration"]
            * model.planned_torque
            / float(model.magnitudes(model.inertia @ self.axis).max())
        )

    def is_over(self) -> bool:
        """Return whether a stop was requested, or the time left is needed for the best plan."""
        limit = self.request.time_limit
        if self.request.control.stopped or limit is None or not np.isfinite(self.shortest):
            return self.request.control.stopped
        share = 1.0 + RESERVE * self.shortest / FINE / self.steps
        self.is_cut = (clock() - self.begin) * share > limit
        return self.is_cut

    def fastest(self) -> _Trial | None:
        """Return the fastest rotation within all limits, or the slowest trial if there is none.

        A higher peak rate leaves less acceleration, so the optimum is an intermediate rate. A stopped
        search returns the best rotation so far, or None.
        """
        trials: dict[float, _Trial] = {}
        for share in SHARES:
            if self.is_over():
                break
            trial = self.at(share)
            if trial is None:
                break
            trials[share] = trial
            best = self._best(trials)
            if (
                best is not None
                and trial.feasible
                and trial.duration > WORSE * trials[best].duration
            ):
                break
        best = self._best(trials)
        if best is None:
            return None if self.request.control.stopped else trials[min(trials)]
        for _ in range(REFINEMENTS):
            if self.is_over():
                break
            shares = sorted(trials)
            place = shares.index(best)
            beside = [shares[k] for k in (place - 1, place + 1) if 0 <= k < len(shares)]
            farthest = beside[int(np.argmax([abs(item - best) for item in beside]))]
            share = 0.5 * (best + farthest)
            trial = self.at(share)
            if trial is None:
                break
            trials[share] = trial
            best = self._best(trials) or best
        return trials[best]

    @staticmethod
    def _best(tried: Mapping[float, _Trial]) -> float | None:
        feasible = [share for share, trial in tried.items() if trial.feasible]
        return min(feasible, key=lambda share: tried[share].duration, default=None)

    def at(self, share: float) -> _Trial | None:
        """Return the rotation with the peak rate `share` of the limit and the highest acceleration.

        A stopped search returns the best rotation so far that satisfies all limits, or None.
        """
        limit, push, too_hard = self.most, self.most, np.inf
        best: _Trial | None = None
        for _ in range(ATTEMPTS):
            if self.is_over():
                return best
            trial = self.flown(share, push, self.model.singularity_limit)
            load = trial.flight.load
            if trial.feasible:
                best = trial
            elif load > 1.0:
                too_hard = push
            else:
                return best or trial  # the acceleration is not the cause of the violation
            # The load grows with the acceleration, proportionally as long as nothing saturates.
            proposed = push * AIM / max(load, STILL)
            if best is not None and (proposed < push * NEAR or push >= limit):
                return best
            low = best.loop.profile.acceleration if best is not None else 0.0
            push = min(proposed if low < proposed < too_hard else 0.5 * (low + too_hard), limit)
        return best or trial

    def flown(self, share: float, push: float, least: float) -> _Trial:
        """Simulate a rotation coarsely, and check all limits.

        The flight is aborted if the singularity measure falls below `least`.
        """
        self.flights += 1
        model = self.model
        peak = share * model.rate_limit / float(model.magnitudes(self.axis).max())
        profile = EigenaxisProfile(model.initial_attitude, self.axis, self.angle, peak, push)
        loop = ClosedLoop(model, self.law, profile, END * min(self.request.tolerance, 1e-3))
        latest = min(self.latest, max(profile.duration, COARSE))
        flight = loop.fly(latest, COARSE, least_measure=least)
        feasible = (
            flight.measure >= model.singularity_limit
            and flight.torque <= 1.0
            and flight.gimbal_rate <= 1.0 + CUT
            and flight.rate <= 1.0 + SLACK
        )
        self.steps += len(flight.steps)
        if feasible:
            self.shortest = min(self.shortest, profile.duration)
        return _Trial(loop, flight, feasible)


class PseudoInverseSteering(EigenaxisSteering):
    """Moore-Penrose pseudo-inverse on an eigenaxis rotation."""

    name = "slew-pseudo-inverse"
    summary = "eigenaxis turn, gyros steered by the pseudo-inverse; ours"
    law = PseudoInverse


_DAMPED: Mapping[str, Option] = {
    **EigenaxisSteering.options,
    "damping": Option(0.01, "λ0, the damping at a singularity.", float, lower=0.0, upper=10.0),
    "decay": Option(10.0, "μ: the damping is λ0 exp(-μ det(A A')).", float, lower=0.0, upper=1e3),
}


class SingularityRobust(EigenaxisSteering):
    """Singularity-robust inverse on an eigenaxis rotation."""

    name = "slew-singularity-robust"
    options: ClassVar[Mapping[str, Option]] = _DAMPED
    summary = "eigenaxis turn, gyros steered by the singularity-robust inverse; ours"
    law = RobustInverse


class Generalised(EigenaxisSteering):
    """Generalised singularity-robust inverse on an eigenaxis rotation."""

    name = "slew-generalised"
    options: ClassVar[Mapping[str, Option]] = {
        **_DAMPED,
        "amplitude": Option(
            0.1, "ε of the oscillating entries off the diagonal.", float, lower=0.0, upper=0.49
        ),
        "frequency": Option(
            float(np.pi / 2), "ω of the oscillating entries, rad/s.", float, lower=0.0, upper=100.0
        ),
    }
    summary = "eigenaxis turn, gyros steered by the generalised robust inverse; ours"
    law = GeneralisedInverse
