"""Records that lost single samples: lost ones filled from their neighbours, and differences that no loss lies in."""

from __future__ import annotations

import numba as nb
import numpy as np

_PLACES = 4  # of a piece at which a loss is tried out


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _tried(values, lost, reach):  # type: ignore[no-untyped-def]
    """Mean square of what filling does to a sum, where nothing is lost; NaN where the piece is too short to try."""
    width = 2 * reach + lost
    places = min(values.size // width, _PLACES)
    total = 0.0
    for place in range(places):
        at = place * (values.size // places)
        beside, inside = 0.0, 0.0
        reference = values[at]
        for i in range(at, at + width):
            if at + reach <= i < at + reach + lost:
                inside += values[i] - reference
            else:
                beside += values[i] - reference
        total += (inside - beside * lost / (2 * reach)) ** 2
    return total / places if places else np.nan


@nb.njit(cache=True, nogil=True, error_model="numpy")
def fill_lost(values, lengths, lost, least, out, sums):  # type: ignore[no-untyped-def]
    """Fill each loss with the mean of its nearest neighbours, as many on each side as were lost and `least` at least.

    With white noise of one sample as unit, a loss of g samples filled from r neighbours adds ``v = g + g^2 / r`` to the
    variance of a sum over it and its neighbours. What it adds in the noise at hand is tried out where nothing is lost.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Those that are there.
    lengths : ndarray of int, shape (k,)
        Samples of the pieces between the losses, their sum n.
    lost : ndarray of int, shape (k - 1,)
        Samples lost after each piece but the last.
    least : int
    out : ndarray, shape (n + sum of lost,)
        Filled.
    sums : ndarray, shape (4,)
        Added to: the variances v of all losses, those of the losses that could be tried out, what they came to there, and by
        how much sums that end near a loss see less of it, per sample of such a sum (white noise).
    """
    at, to = 0, 0
    for j in range(lengths.size):
        n = lengths[j]
        out[to : to + n] = values[at : at + n]
        at, to = at + n, to + n
        if j + 1 == lengths.size:
            break
        g = lost[j]
        if g == 0:
            continue
        reach = max(least, g)
        before, after = min(reach, n), min(reach, lengths[j + 1])
        reference, total = values[at - 1], 0.0
        for i in range(at - before, at + after):
            total += values[i] - reference
        many = before + after
        out[to : to + g] = reference + total / many
        to += g
        v = g + g * g / many
        sums[0] += v
        # sums of distances: neighbours to lost ones, and of lost ones to each other
        far = 0.5 * g * (before * (g + before) + after * (g + after))
        sums[3] += (2.0 * far + g * (g * g - 1) / 3.0) / many
        found = _tried(values[at - n : at], g, reach)
        if np.isnan(found):
            found = _tried(values[at : at + lengths[j + 1]], g, reach)
        if not np.isnan(found):
            sums[1] += v
            sums[2] += found * v / (g + g * g / (2.0 * reach))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def add_pieces(values, lengths, least, most, span, order, factors, steps, sums):  # type: ignore[no-untyped-def]
    """Sums of squared differences within pieces, as in :mod:`sagnac.kernels.allan`, for pieces that are short.

    Parameters
    ----------
    values : ndarray, shape (n,)
    lengths : ndarray of int, shape (k,)
        Samples of the pieces, one after the other, their sum n.
    least, most : int
        Pieces of fewer or of more samples are left out.
    span : int
        2 or 3: differences as in :func:`sagnac.kernels.allan.add_second` or :func:`sagnac.kernels.allan.add_third`.
    order : int
        1 or 2: of first or of second sums.
    factors : ndarray of int, shape (f,)
        Ascending; a piece takes those of which it holds the span twice.
    steps : ndarray of int, shape (f,)
        Samples from one difference to the next.
    sums : ndarray, shape (f,)
        Added to.
    """
    s = np.empty(most + 2)
    at = 0
    for n in lengths:
        first = at
        at += n
        if n < least or n > most:
            continue
        reference, total = values[first], 0.0
        for i in range(first, at):
            total += values[i] - reference
        mean = reference + total / n
        x, w = 0.0, 0.0
        for i in range(n + order):
            s[i] = x if order == 1 else w
            w += x
            if i < n:
                x += values[first + i] - mean
        for f in range(factors.size):
            m = factors[f]
            if 2 * span * m > n:
                break
            squares = 0.0
            if span == 2:
                for i in range(0, n + order - 2 * m, steps[f]):
                    d = s[i] - 2.0 * s[i + m] + s[i + 2 * m]
                    squares += d * d
            else:
                for i in range(0, n + order - 3 * m, steps[f]):
                    d = (s[i + 3 * m] - s[i]) + 3.0 * (s[i + m] - s[i + 2 * m])
                    squares += d * d
            sums[f] += squares
