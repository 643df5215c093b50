"""What several test modules of the slew use."""

import numpy as np

BETA = np.deg2rad(54.73)


FULL = [[228.0, 3.0, -5.0], [3.0, 188.0, 7.0], [-5.0, 7.0, 176.0]]


def close(have, want, tolerance=1e-12):
    np.testing.assert_allclose(have, want, rtol=0, atol=tolerance)
