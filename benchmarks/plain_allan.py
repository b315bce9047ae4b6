"""Plain twin of the Allan variances: cumulative sums in the longest floating-point numbers there are, one line of NumPy each."""

from __future__ import annotations

import numpy as np


def variance(values, factor, kind, stride=1):
    """Mean of the squared differences that begin at every `stride`-th sample.

    Parameters
    ----------
    values : ndarray, shape (n,)
    factor : int
    kind : str
        ``allan``, ``modified`` or ``hadamard``.
    stride : int
    """
    m, y = factor, np.asarray(values, dtype=np.longdouble)
    x = np.concatenate([[0], np.cumsum(y - y.mean())])
    if kind == "allan":
        d, scale = x[2 * m :] - 2 * x[m : len(x) - m] + x[: len(x) - 2 * m], 2.0 * m**2
    else:
        s = x if kind == "hadamard" else np.concatenate([[0], np.cumsum(x)])
        n = len(s) - 3 * m
        d = s[3 * m :] - 3 * s[2 * m : 2 * m + n] + 3 * s[m : m + n] - s[:n]
        scale = 6.0 * m**2 if kind == "hadamard" else 2.0 * float(m) ** 4
    return float((d[::stride] ** 2).mean() / scale)
