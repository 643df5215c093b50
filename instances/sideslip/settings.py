"""The vehicle of the simulated drives."""

from __future__ import annotations

from ...models.sideslip.data import Vehicle

__all__ = ["VEHICLE"]

#: A car with the parameters of an exercise in Z. Yu, Automobile Theory (in Chinese, China Machine Press), to its
#: chapter on handling; stiffness for both tyres of an axle. The paper does not print its own parameters.
VEHICLE = Vehicle(
    mass=1818.2,
    yaw_inertia=3885.0,
    front=1.463,
    rear=1.585,
    cornering_front=62618.0,
    cornering_rear=110185.0,
)
