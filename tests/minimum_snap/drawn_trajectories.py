"""Random trajectories without bounds: any pattern of what is fixed, durations of ratios up to 1e6."""

import numpy as np

from crosstrack.models import MinimumDerivative


def drawn(seed, most=1000):
    """Return a model of 2 to `most` segments, drawn by `seed`."""
    rng = np.random.default_rng([16, seed])
    segments = int(np.exp(rng.uniform(np.log(2), np.log(most + 0.999))))
    order, axes = int(rng.integers(2, 6)), int(rng.integers(1, 3))
    ratio = 10 ** rng.uniform(0, 6)
    law = rng.integers(4)
    share = rng.uniform(size=segments)
    if law == 1:
        share = rng.integers(0, 2, segments).astype(float)
    elif law == 2:
        share = np.linspace(0, 1, segments)
    elif law == 3:
        share = (rng.uniform(size=segments) < 0.1).astype(float)
    durations = ratio**share * 10 ** rng.uniform(-2, 2)
    times = np.concatenate([[0.0], np.cumsum(durations)])
    durations = np.diff(times)
    steps = rng.normal(size=(segments + 1, axes))
    if rng.random() < 0.4:
        steps[1:] *= (durations / durations.mean())[:, None]
    waypoints = np.cumsum(steps, axis=0) * 10 ** rng.uniform(-2, 3)
    if rng.random() < 0.4:
        waypoints[rng.random(waypoints.shape) < rng.choice([0.1, 0.5, 0.9])] = np.inf
    derivatives = None
    if rng.random() < 0.6:
        fixed = rng.random((segments + 1, order - 1, axes)) < rng.choice([0.1, 0.5, 0.9])
        local = np.minimum(np.append(durations, np.inf), np.append(np.inf, durations))
        values = rng.normal(size=fixed.shape)
        kind = rng.integers(3)
        if kind == 0:
            values /= local[:, None, None] ** np.arange(1, order)[:, None]
        elif kind == 1:
            values /= durations.mean() ** np.arange(1, order)[:, None]
        else:
            values *= 0.0
        derivatives = np.where(fixed, values, np.inf)
    start = end = None
    if derivatives is not None or rng.random() < 0.3:
        # Free ends: `derivatives` contains their fixed values.
        start = end = np.full((1, axes), np.inf)
    return MinimumDerivative(
        waypoints,
        times,
        order=order,
        start=start,
        end=end,
        derivatives=derivatives,
        name=f"drawn {seed}",
    )
