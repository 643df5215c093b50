"""Write the picture and the animation of README.md: ``python docs/_ext/crosstrack_film.py``."""

from __future__ import annotations

from pathlib import Path

from matplotlib.animation import PillowWriter
from PIL import Image, ImageSequence

import crosstrack as ct
from crosstrack.models.fleet_mission.plot import animate_mission

STATIC = Path(__file__).resolve().parents[1] / "_static"
#: Instances of the picture and of the animation.
PICTURE, MISSION = "error-correction/7", "fleet-mission/example"
#: Length of the animation (s), frames per second, and quality of the images in percent.
LENGTH, RATE, QUALITY = 30, 6, 40


def main() -> None:
    """Solve both instances, and write ``route.webp`` and ``mission.webp``."""
    model = ct.load(PICTURE)
    figure = ct.plot(model, ct.solve(model, seed=0))
    figure.savefig(STATIC / "route.webp", dpi=100, pil_kwargs={"quality": 80})
    mission = ct.load(MISSION)
    film = animate_mission(
        mission, ct.solve(mission, seed=0), frames=LENGTH * RATE, interval=1000 / RATE, size=(6, 5)
    )
    path = STATIC / "mission.webp"
    film.save(path, writer=PillowWriter(fps=RATE), dpi=80)
    with Image.open(path) as images:
        first, *rest = (image.copy() for image in ImageSequence.Iterator(images))
    first.save(
        path,
        save_all=True,
        append_images=rest,
        duration=1000 // RATE,
        loop=0,
        quality=QUALITY,
        minimize_size=True,
    )


if __name__ == "__main__":
    main()
