"""Curves of an embedding by loops over all pairs, which tests compare the checks with."""

import math

import numpy as np


def plain_divergence(states, theiler, ahead, radius=None):
    """The mean logarithm of the distance from neighbours, by loops over all pairs."""
    last = len(states) - ahead[-1]
    sums, counts = np.zeros(len(ahead)), np.zeros(len(ahead))
    for i in range(last):
        best, near = math.inf, []
        for j in range(last):
            apart = sum((a - b) ** 2 for a, b in zip(states[i], states[j], strict=True))
            if abs(i - j) <= theiler or apart == 0:
                continue
            if radius is not None and apart <= radius**2:
                near.append(j)
            elif radius is None and apart < best:
                best, near = apart, [j]
        for k, step in enumerate(ahead if near else ()):
            mean = np.mean([math.dist(states[i + step], states[j + step]) for j in near])
            if mean > 0:
                sums[k] += math.log(mean)
                counts[k] += 1
    with np.errstate(invalid="ignore"):
        return sums / counts


def plain_sums(states, theiler, radii):
    """The share of pairs within each radius by their largest difference, by loops over all pairs."""
    within, pairs = np.zeros(len(radii)), 0
    for i in range(len(states)):
        for j in range(len(states)):
            if abs(i - j) > theiler:
                pairs += 1
                apart = max(abs(a - b) for a, b in zip(states[i], states[j], strict=True))
                within += apart <= radii
    return within / pairs


def fitted(x, y):
    """The slope of the line of least squares."""
    return float(np.polyfit(x, y, 1)[0])


def plain_rows(states, theiler, ahead):
    """The logarithm of the distance from the first nearest neighbour, one row per state; NaN for 0."""
    last, rows = len(states) - ahead[-1], []
    for i in range(last):
        apart = ((states[:last] - states[i]) ** 2).sum(axis=1)
        apart[apart == 0] = math.inf
        apart[max(i - theiler, 0) : i + theiler + 1] = math.inf
        j = int(apart.argmin())
        moved = [math.dist(states[i + step], states[j + step]) for step in ahead]
        if math.isfinite(apart[j]):
            rows.append([math.log(one) if one > 0 else math.nan for one in moved])
    return np.array(rows)


def scatter(x, rows):
    """The standard error of the slope of the mean row, by leaving out every row once."""
    slopes = [fitted(x, np.nanmean(np.delete(rows, k, axis=0), axis=0)) for k in range(len(rows))]
    return math.sqrt((len(rows) - 1) * np.var(slopes))
