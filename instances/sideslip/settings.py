"""What the paper prints of its two roads, and the vehicle that stands for its own."""

from __future__ import annotations

from typing import NamedTuple

from ...models.sideslip.data import Vehicle

__all__ = ["TABLE_3", "VEHICLE", "Errors"]

#: A car with the parameters of an exercise in Z. Yu, Automobile Theory (in Chinese, China Machine Press), to its
#: chapter on handling; stiffness for both tyres of an axle. The paper's own parameters are lost.
VEHICLE = Vehicle(
    mass=1818.2,
    yaw_inertia=3885.0,
    front=1.463,
    rear=1.585,
    cornering_front=62618.0,
    cornering_rear=110185.0,
)


class Errors(NamedTuple):
    """A row of table 3.

    Parameters
    ----------
    row : int
        Its number.
    speed : float
        Of the vehicle, km/h.
    mean, deviation : float
        Of the error of the angle, degrees.
    """

    row: int
    speed: float
    mean: float
    deviation: float


#: Table 3 by road.
TABLE_3 = {
    "lane-change": Errors(1, 80.0, 0.0295, 0.0424),
    "serpentine": Errors(2, 65.0, 0.0377, 0.0498),
}
