"""All names of the kit that the pictures of the problems share.

A picture writes its title with :func:`title_of`, opens a :class:`Scene`, places axes in it, draws layers of
:mod:`.layers` on maps and :class:`Panel` objects over time, and adds a legend. An animation opens a
:class:`Stage` and plays a function of the frame::

    result = kit.verified_plan(model, plan, Route, tolerance)
    scene = kit.Scene(kit.title_of(model, parts, result, title), result, size, (6.0, 5.0))
    axes = scene.axes(0.7, 0.9, 0.2, scene.head)
    scale = kit.dress_map(axes, low, high)
    scene.legend(kit.draw_ends(axes, start * scale, goals * scale))
    return scene.figure
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..verification import TOLERANCE
from . import curves, layers, loads, motion, options, panels, pins, scene, style
from .curves import *  # noqa: F403
from .layers import *  # noqa: F403
from .loads import *  # noqa: F403
from .motion import *  # noqa: F403
from .options import *  # noqa: F403
from .panels import *  # noqa: F403
from .pins import *  # noqa: F403
from .scene import *  # noqa: F403
from .style import *  # noqa: F403

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation as FuncAnimation
    from matplotlib.figure import Figure as Figure

__all__ = ["TOLERANCE"]
__all__ += curves.__all__
__all__ += layers.__all__
__all__ += loads.__all__
__all__ += motion.__all__
__all__ += options.__all__
__all__ += panels.__all__
__all__ += pins.__all__
__all__ += scene.__all__
__all__ += style.__all__
