"""Vehicle of the simulated drives."""

from __future__ import annotations

from ...models.sideslip.data import Vehicle

__all__ = ["VEHICLE"]

#: Car with the parameters of an exercise in the chapter on handling of Z. Yu, Automobile Theory (in Chinese, China
#: Machine Press). The stiffness is that of both tyres of an axle. The paper does not print its parameters.
VEHICLE = Vehicle(
    mass=1818.2, yaw_inertia=3885.0, front=1.463, rear=1.585, cornering_front=62618.0,
    cornering_rear=110185.0,
)  # fmt: skip
