"""Formulation of a slew by attitude and gimbal angles: the conserved momentum gives the body rates.

Without outer torque the body rates are a function of attitude and gimbal angles (eq. 1), and three
parameters describe the attitude. A node then has 3 + n states instead of 7 + n, for n gyros, no
condition at the end depends on others, and the program is smaller.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from ..optimal_control.hamiltonian import hamiltonian_spread
from ..optimal_control.model import OptimalControlProblem
from ..optimal_control.plan import ControlPlan, PhasePlan, Piecewise
from ..optimal_control.transcription.methods import Gauss
from .checks import slew_phase
from .dynamics import SlewMotion, names_of
from .lowered import rodrigues
from .model import SatelliteSlew
from .quaternions import product, rotation_matrix

__all__ = ["Reduced"]

Floats = NDArray[np.float64]

#: Additional nodes of an interval in the slew's plan, because attitude and rates are no polynomials there.
MORE = 4


@dataclass(frozen=True, eq=False)
class Reduced(Gauss):
    """Gauss collocation of attitude and gimbal angles, with body rates from the conserved momentum.

    Parameters are those of ``Transcription``. Meshes are refined until the slew's plan verifies.
    """

    model: SatelliteSlew  # type: ignore[assignment]

    name: ClassVar[str] = "reduced"
    summary: ClassVar[str] = "Gauss (LG) on attitude and gimbals; rates from the conserved momentum"
    begins_coarse: ClassVar[bool] = True

    @property
    def problem(self) -> OptimalControlProblem:
        """The slew with attitude and gimbal angles as the only states."""
        return self.model.reduced

    # -- plans -----------------------------------------------------------------------------------

    def _to_model(self, plan: ControlPlan) -> ControlPlan:
        """Return the slew's plan, with attitude and rates at some more nodes than the gimbal angles."""
        part = plan.phases[0]
        nodes = tuple(
            -np.cos(np.linspace(0.0, np.pi, positions.size + MORE))
            for positions in part.states.nodes
        )
        tables = []
        for k, positions in enumerate(nodes):
            values = part.states.on(k, positions)
            sigma, delta = values[:, :3], values[:, 3:]
            square = (sigma**2).sum(axis=1, keepdims=True)
            turn: Floats = np.hstack([1.0 - square, 2.0 * sigma]) / (1.0 + square)
            q = product(self.model.initial_attitude, turn)
            tables.append(np.hstack([q, self._rates(q, delta), delta]))
        states = Piecewise(part.states.knots, nodes, tuple(tables))
        names = names_of(self.model.gyro_count)
        return ControlPlan((PhasePlan(part.name, states, part.controls, *names),))

    def _rates(self, attitudes: Floats, gimbals: Floats) -> Floats:
        """Return the body rates with the conserved momentum, shape (n, 3), rad/s."""
        model = self.model
        body = np.swapaxes(rotation_matrix(attitudes), -1, -2) @ model.total_momentum
        wheels = SlewMotion.of(model).body_momentum(np.zeros(3), gimbals)
        return np.asarray(np.linalg.solve(model.inertia, (body - wheels).T).T, float)

    def _to_problem(self, plan: ControlPlan) -> ControlPlan:
        """Return the plan of the reduced problem."""
        part = slew_phase(plan, self.model.gyro_count)
        # Random starts have attitudes of other lengths than 1.
        lengths = [np.linalg.norm(table[:, :4], axis=1)[:, None] for table in part.states.values]
        tables = tuple(
            np.hstack([rodrigues(self.model, table[:, :4] / length), table[:, 7:]])
            for table, length in zip(part.states.values, lengths, strict=True)
        )
        states = Piecewise(part.states.knots, part.states.nodes, tables)
        phase = self.model.reduced.definition.phases[0]
        names = phase.state_names, phase.control_names
        return ControlPlan((PhasePlan(part.name, states, part.controls, *names),))

    def explained(self, plan: ControlPlan, point: Floats, duals: Floats) -> ControlPlan:
        """Return the plan with costates from the multipliers; those of the body rates are zero.

        The rates are no states of the reduced problem. The costates of the attitude are λ_q = (∂σ/∂q)ᵀ
        λ_σ, so that λ·ẋ and the Hamiltonian are those of the reduced problem.
        """
        part = self._with_costates(self._plan_at(point), duals).phases[0]
        costates = part.costates
        if costates is None:
            return plan
        tables = []
        for k, table in enumerate(costates.values):
            sigma = part.states.on(k, costates.nodes[k])[:, :3]
            square = (sigma**2).sum(axis=1, keepdims=True)
            # σ = v / (1 + c) for the quaternion (c, v), and 1 + c = 2 / (1 + σ·σ).
            half = 0.5 * (1.0 + square)
            along = -half * (sigma * table[:, :3]).sum(axis=1, keepdims=True)
            by_turn = np.hstack([along, half * table[:, :3]])
            by_attitude = product(self.model.initial_attitude, by_turn)
            tables.append(np.hstack([by_attitude, np.zeros((len(table), 3)), table[:, 3:]]))
        whole = Piecewise(costates.knots, costates.nodes, tuple(tables))
        return replace(plan, phases=(replace(plan.phases[0], costates=whole),))

    # -- refinement and other starts -------------------------------------------------------------

    def alternatives(self) -> Iterator[Any]:
        """Return no other meshes."""
        return iter(())

    def started(self, seed: int) -> Self:
        """Return the formulation at the random start of the program with all states.

        Starts drawn in σ led to worse optima: 5.72 instead of 5.47 s on ``satellite-slew/skew-30``.
        """
        return self.guessed(self._drawn(seed))

    def draw(self, seed: int) -> Floats:
        """Return the random start of :meth:`started` on the current mesh, without building a program."""
        return self.encode(self._drawn(seed))

    def _drawn(self, seed: int) -> ControlPlan:
        plan: ControlPlan = self.model.lower().formulate("gauss").started(seed)._start
        return plan

    def statistics(self, plan: ControlPlan) -> dict[str, float | int | str]:
        """Return the size of the mesh, the change of the objective, and the spread of the Hamiltonian."""
        result = super().statistics(plan)
        if plan.phases[0].costates is not None:
            reports = hamiltonian_spread(self.model.lower(), plan)
            result["hamiltonian_spread"] = reports[0].relative
        return result
