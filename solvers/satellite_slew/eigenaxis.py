"""``slew-pseudo-inverse``, ``slew-singularity-robust`` and ``slew-generalised``: an eigenaxis slew.

One rotation about one axis, its rate going up, along and down, flown by a steering law: what is
done without optimal control. A plan comes back whether or not the gyros stayed away from
singularities; verification says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...jit import clock
from ...models.satellite_slew.model import SatelliteSlew
from ...models.satellite_slew.profile import EigenaxisProfile
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Option, Request, Termination
from .closed_loop import ClosedLoop, Flight
from .steering import GeneralisedInverse, PseudoInverse, RobustInverse, SteeringLaw

__all__ = ["Generalised", "PseudoInverseSteering", "SingularityRobust"]

#: Peak rates that are tried, by the rate limit, from the fastest on; how much slower than the best
#: a turn is when the scan ends, and how many peak rates around the best are tried after it.
SHARES = (1.0, 0.85, 0.7, 0.6, 0.5, 0.4, 0.25, 0.12, 0.05)
WORSE, REFINEMENTS = 1.1, 5
#: Attempts to find the acceleration at which the actuators' limits are just kept.
ATTEMPTS = 8
#: What is gained by a further attempt at the least, relative.
NEAR = 1.01
#: The part of the actuators' limits that the search aims at, lest rounding exceed them.
AIM = 0.999
#: How far the rates may exceed their limits in the coarse flights of the search, relative: gimbal
#: rates are cut off at theirs.
SLACK, CUT = 1e-6, 2e-3
#: A load that is none: the satellite need not move.
STILL = 1e-9
#: Steps of the search and of the plan, s.
COARSE, FINE = 0.2, 0.05
#: Part of the tolerance that the end of the plan may use up.
END = 0.3


@dataclass(frozen=True, eq=False)
class _Found:
    """A turn that was flown, and whether it kept all limits."""

    loop: ClosedLoop
    flight: Flight
    kept: bool

    @property
    def duration(self) -> float:
        """How long the turn lasts, s."""
        return self.loop.profile.duration


class EigenaxisSteering(Backend):
    """Base of the steering laws on an eigenaxis bang-coast-bang turn.

    The peak rate is the highest at which the gyros keep away from singularities, unless it is
    given; the acceleration the highest that their rates and the torque limit allow. After the turn
    feedback and null motion settle what is left, so the plan ends where it should.
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
            "gyros from singularities. One that is given is flown as it is.",
            float, lower=1e-3, upper=1.0,
        ),
        "acceleration": Option(
            1.0,
            "Highest acceleration of the turn, by what the torque limit allows; with a peak_rate it "
            "is flown as it is.",
            float, lower=1e-6, upper=1.0,
        ),
    }  # fmt: skip

    #: The steering law, made of the backend's further options in their order.
    law: ClassVar[type[SteeringLaw]]

    def run(self, problem: SatelliteSlew, request: Request) -> Answer:
        """Search for the fastest turn, fly it, and return its plan."""
        begin = clock()
        own = [name for name in self.options if name not in EigenaxisSteering.options]
        law = self.law(*(request.options[name] for name in own))
        search = _Search(problem, law, request)
        given = request.options["peak_rate"]
        found = search.fastest() if given is None else search.flown(given, search.most, 0.0)
        statistics: dict[str, float | int | str] = {"flights": search.flights}
        if found is None:
            limit = request.control.reason or Limit.INTERRUPTED
            return Answer(
                Termination.NO_SOLUTION, limit,
                seconds={"solve": clock() - begin}, statistics=statistics,
                message="the search was stopped",
            )  # fmt: skip
        flight = found.loop.fly(search.latest, FINE)
        plan = flight.plan(problem.planned_gimbal_rate)
        statistics |= {
            "peak rate, rad/s": found.loop.profile.reached,
            "acceleration, rad/s²": found.loop.profile.acceleration,
            "end of the turn, s": found.loop.profile.duration,
            "final time, s": flight.knots[-1],
            "least singularity measure": flight.measure,
        }
        return Answer(
            Termination.FEASIBLE, None, plan,
            seconds={"solve": clock() - begin}, statistics=statistics,
            message=_message(problem, found.kept, flight),
        )  # fmt: skip


def _message(problem: SatelliteSlew, kept: bool, flight: Flight) -> str:
    if not flight.settled:
        return "the satellite has not settled within the time range"
    if flight.measure < problem.singularity_limit:
        return (
            f"the gyros come as near to a singularity as det(A A') = {flight.measure:.3g}, below "
            f"{problem.singularity_limit:g}"
        )
    return "" if kept else "the limits of rate or torque were not kept in the search"


def _farthest(places: list[float], centre: float) -> float:
    return max(places, key=lambda place: abs(place - centre))


class _Search:
    """The search for the fastest turn that keeps the limits."""

    def __init__(self, model: SatelliteSlew, law: SteeringLaw, request: Request) -> None:
        self.model, self.law, self.request = model, law, request
        self.latest = float(model.time_range[1])
        self.axis, self.angle = model.turn
        self.flights = 0
        #: The highest acceleration of the turn, rad/s².
        self.most = (
            AIM
            * request.options["acceleration"]
            * model.planned_torque
            / float(model.magnitudes(model.inertia @ self.axis).max())
        )

    def fastest(self) -> _Found | None:
        """Return the fastest turn that keeps all limits, or the slowest tried where none does.

        A higher peak rate leaves less acceleration, so the best is somewhere in between.
        """
        tried: dict[float, _Found] = {}
        for share in SHARES:
            found = self.at(share)
            if found is None:
                return None
            tried[share] = found
            best = self._best(tried)
            if best is not None and found.kept and found.duration > WORSE * tried[best].duration:
                break
        best = self._best(tried)
        if best is None:
            return tried[min(tried)]
        for _ in range(REFINEMENTS):
            shares = sorted(tried)
            place = shares.index(best)
            beside = [shares[k] for k in (place - 1, place + 1) if 0 <= k < len(shares)]
            share = 0.5 * (best + _farthest(beside, best))
            found = self.at(share)
            if found is None:
                return None
            tried[share] = found
            best = self._best(tried) or best
        return tried[best]

    @staticmethod
    def _best(tried: Mapping[float, _Found]) -> float | None:
        kept = [share for share, found in tried.items() if found.kept]
        return min(kept, key=lambda share: tried[share].duration, default=None)

    def at(self, share: float) -> _Found | None:
        """Return the turn with a peak rate of `share` of the limit, as fast as the actuators allow."""
        top, push, too_hard = self.most, self.most, np.inf
        best: _Found | None = None
        for _ in range(ATTEMPTS):
            if self.request.control.stopped:
                return None
            found = self.flown(share, push, self.model.singularity_limit)
            load = found.flight.load
            if found.kept:
                best = found
            elif load > 1.0:
                too_hard = push
            else:
                return best or found  # not the acceleration is what is wrong
            # The load grows with the acceleration, and in proportion as long as nothing saturates.
            wanted = push * AIM / max(load, STILL)
            if best is not None and (wanted < push * NEAR or push >= top):
                return best
            low = best.loop.profile.acceleration if best is not None else 0.0
            push = min(wanted if low < wanted < too_hard else 0.5 * (low + too_hard), top)
        return best or found

    def flown(self, share: float, push: float, least: float) -> _Found:
        """Fly a turn coarsely, and say whether all limits were kept.

        It is broken off where the measure of singularity falls below `least`.
        """
        self.flights += 1
        model = self.model
        peak = share * model.rate_limit / float(model.magnitudes(self.axis).max())
        profile = EigenaxisProfile(model.initial_attitude, self.axis, self.angle, peak, push)
        loop = ClosedLoop(model, self.law, profile, END * min(self.request.tolerance, 1e-3))
        latest = min(self.latest, max(profile.duration, COARSE))
        flight = loop.fly(latest, COARSE, least_measure=least)
        kept = (
            flight.measure >= model.singularity_limit
            and flight.torque <= 1.0
            and flight.gimbal_rate <= 1.0 + CUT
            and flight.rate <= 1.0 + SLACK
        )
        return _Found(loop, flight, kept)


class PseudoInverseSteering(EigenaxisSteering):
    """The pseudo-inverse of Moore and Penrose on an eigenaxis turn."""

    name = "slew-pseudo-inverse"
    summary = "eigenaxis turn, gyros steered by the pseudo-inverse; ours"
    law = PseudoInverse


_DAMPED: Mapping[str, Option] = {
    **EigenaxisSteering.options,
    "damping": Option(0.01, "λ0, the damping at a singularity.", float, lower=0.0, upper=10.0),
    "decay": Option(10.0, "μ: the damping is λ0 exp(-μ det(A A')).", float, lower=0.0, upper=1e3),
}


class SingularityRobust(EigenaxisSteering):
    """The singularity-robust inverse on an eigenaxis turn."""

    name = "slew-singularity-robust"
    options: ClassVar[Mapping[str, Option]] = _DAMPED
    summary = "eigenaxis turn, gyros steered by the singularity-robust inverse; ours"
    law = RobustInverse


class Generalised(EigenaxisSteering):
    """The generalised singularity-robust inverse on an eigenaxis turn."""

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
