"""Sums of squared differences of cumulative sums: what Allan, modified Allan and Hadamard variances are made of.

A cumulative sum over a long record grows, and its digits are lost where neighbours are subtracted. So it is kept in
blocks: each block is summed from zero, less its own level where the record drifts. What it starts from is kept apart, as a
multiple of a power of two (the quantum) that is coarse enough for all combinations of starts to be exact, and a small rest.
A difference is then one of small numbers plus a combination of starts that is a polynomial of degree 2 at most over a stretch
of neighbours. The loops over such stretches are what the compiler makes vector instructions of.
"""

from __future__ import annotations

import numba as nb
import numpy as np

_LONG = 16  # blocks, half a MiB: what factors of up to that many look at is in the second cache
_SUMS = {"reassoc", "contract", "nsz"}  # sums may be made in any order, side by side


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def _sum(values):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(values.size):
        total += values[i]
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _largest(bits):  # type: ignore[no-untyped-def]
    """Largest magnitude, of floating-point numbers seen as integers: in their order, and what is no number is above all."""
    most = np.int64(0)
    for i in range(bits.size):
        most = max(most, bits[i] & np.int64(0x7FFFFFFFFFFFFFFF))
    return most


@nb.njit(cache=True, nogil=True, error_model="numpy")
def survey(values, reference, block, first, last, out):  # type: ignore[no-untyped-def]
    """Sum and largest magnitude of samples less a reference.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
    reference : ndarray, shape (axes,)
    block : int
        Rows that are taken at a time.
    first, last : int
        Blocks of rows, the last one excluded.
    out : ndarray, shape (2, axes)
        Filled. The sum is not finite where a sample is not.
    """
    y, magnitude = np.empty(block), np.empty(1)
    out[:] = 0.0
    for b in range(first, last):
        start, size = b * block, min(block, values.shape[0] - b * block)
        for a in range(values.shape[1]):
            for i in range(size):
                y[i] = np.float64(values[start + i, a]) - reference[a]
            magnitude.view(np.int64)[0] = _largest(y[:size].view(np.int64))
            out[0, a] += _sum(y[:size])
            out[1, a] = max(out[1, a], magnitude[0])


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sum_blocks(values, reference, quantum, order, block, first, last, local, ends):  # type: ignore[no-untyped-def]
    """Cumulative sums within blocks, each from zero and less its level.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
    reference : ndarray, shape (axes,)
        Subtracted from the samples.
    quantum : ndarray, shape (axes,)
        What levels are multiples of.
    order : int
        1, ``x[j] = y[0] + ... + y[j-1]``, or 2, ``w[j] = x[0] + ... + x[j-1]``.
    block : int
        Points in a block.
    first, last : int
        Blocks, the last one excluded.
    local : ndarray, shape (axes, n + order)
        Filled: the sum of that order at each point.
    ends : ndarray, shape (blocks, 3, axes)
        Filled: first and second sum over a whole block, and its level: zero where the samples scatter around the
        reference, else their mean.
    """
    points = local.shape[1]
    n = values.shape[0]
    y, magnitude = np.zeros(block), np.empty(1)
    for b in range(first, last):
        start, size = b * block, min(block, points - b * block)
        inside = max(min(size, n - start), 0)
        for a in range(values.shape[1]):
            for i in range(inside):
                y[i] = np.float64(values[start + i, a]) - reference[a]
            y[inside:] = 0.0
            magnitude.view(np.int64)[0] = _largest(y.view(np.int64))
            mean = _sum(y) / max(inside, 1)
            level = 0.0 if abs(mean) < 0.1 * magnitude[0] else np.rint(mean / quantum[a]) * quantum[a]
            for i in range(inside):
                y[i] -= level
            x, w = 0.0, 0.0
            if order == 1:
                for i in range(size):
                    local[a, start + i] = x
                    x += y[i]
            else:
                for i in range(size):
                    local[a, start + i] = w
                    # the step from second sum j to j + 1 is x[j], and from x[j] to x[j + 1] it is y[j]
                    w += x
                    x += y[i]
            ends[b, 0, a], ends[b, 1, a], ends[b, 2, a] = x, w, level


@nb.njit(cache=True, nogil=True, error_model="numpy")
def chain_blocks(ends, block, quanta, starts):  # type: ignore[no-untyped-def]
    """What the sums of each block start from.

    At point t of a block, the sums are ``x = X + x' + L t + local`` and
    ``w = W + w' + (X + x') t + L t (t - 1) / 2 + local``.

    Parameters
    ----------
    ends : ndarray, shape (blocks, 3, axes)
        See :func:`sum_blocks`.
    block : int
        A power of two.
    quanta : ndarray, shape (2, axes)
        Of the first and of the second sums.
    starts : ndarray, shape (axes, 5, blocks)
        Filled: X, a multiple of its quantum, the rest x', W and w' likewise, and the level L.
    """
    for a in range(ends.shape[2]):
        q, p = quanta[0, a], quanta[1, a]
        x, dx, w, dw = 0.0, 0.0, 0.0, 0.0
        for b in range(ends.shape[0]):
            level = ends[b, 2, a]
            starts[a, 0, b], starts[a, 1, b], starts[a, 2, b], starts[a, 3, b], starts[a, 4, b] = x, dx, w, dw, level
            # each step is exact, since the block is a power of two, and so is what its multiple of the quantum leaves
            step, bent = x * block, level * (0.5 * block * (block - 1.0))
            first, second = np.rint(step / p) * p, np.rint(bent / p) * p
            rest = dw + dx * block + ends[b, 1, a] + ((step - first) + (bent - second))
            more = np.rint(rest / p) * p
            w, dw = w + (first + second + more), rest - more
            step = level * block
            first = np.rint(step / q) * q
            rest = dx + ends[b, 0, a] + (step - first)
            more = np.rint(rest / q) * q
            x, dx = x + (first + more), rest - more


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def _second(a, b, c, start):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(a.size):
        d = a[i] - 2.0 * b[i] + c[i] + start
        total += d * d
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def _second_linear(a, b, c, start, slope, ramp):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(a.size):
        d = a[i] - 2.0 * b[i] + c[i] + (start + slope * ramp[i])
        total += d * d
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def _third(a, b, c, d, start):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(a.size):
        e = (d[i] - a[i]) + 3.0 * (b[i] - c[i]) + start
        total += e * e
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_SUMS)
def _third_bent(a, b, c, d, start, slope, bend, ramp):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(a.size):
        e = (d[i] - a[i]) + 3.0 * (b[i] - c[i]) + (start + ramp[i] * (slope + bend * ramp[i]))
        total += e * e
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _second_from(local, starts, block, tile, m, ramp):  # type: ignore[no-untyped-def]
    """Sum of the squares whose i lies in one block, in stretches over which none of the other points leaves its own."""
    X, rests, L = starts[0], starts[1], starts[4]
    i, stop = tile * block, min((tile + 1) * block, local.size - 2 * m)
    total = 0.0
    while i < stop:
        p, q = i + m, i + 2 * m
        u, v = p // block, q // block
        size = min(stop - i, (u + 1) * block - p, (v + 1) * block - q)
        a, b, c = i - tile * block, p - u * block, q - v * block
        # sums of multiples of quanta are exact, so they cancel without loss
        fixed = (X[tile] + X[v]) - 2.0 * X[u]
        moved = (L[tile] * a + L[v] * c) - 2.0 * L[u] * b
        start = (fixed + moved) + (rests[tile] - 2.0 * rests[u] + rests[v])
        slope = (L[tile] + L[v]) - 2.0 * L[u]
        s0, s1, s2 = local[i : i + size], local[p : p + size], local[q : q + size]
        if slope == 0.0:
            total += _second(s0, s1, s2, start)
        else:
            total += _second_linear(s0, s1, s2, start, slope, ramp)
        i += size
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def add_second(local, starts, block, factors, first, last, out):  # type: ignore[no-untyped-def]
    """Sums of squares of ``x[i] - 2 x[i+m] + x[i+2m]``.

    Short factors all go through one block before the next one: what they look at is in the cache. What long ones look at
    comes from memory, so each of them goes through all blocks in one run.

    Parameters
    ----------
    local, starts : ndarray, shape (points,), (5, blocks)
        One axis of :func:`sum_blocks` and :func:`chain_blocks`, of order 1.
    block : int
    factors : ndarray of int, shape (k,)
        The m, ascending.
    first, last : int
        Blocks that i lies in, the last one excluded.
    out : ndarray, shape (blocks, k)
        Filled.
    """
    ramp = np.arange(np.float64(block))
    short = np.searchsorted(factors, _LONG * block)
    for tile in range(first, last):
        for f in range(short):
            out[tile, f] = _second_from(local, starts, block, tile, factors[f], ramp)
    for f in range(short, factors.size):
        for tile in range(first, last):
            out[tile, f] = _second_from(local, starts, block, tile, factors[f], ramp)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _joined(s0, s1, s2, s3):  # type: ignore[no-untyped-def]
    return (s3 - s0) + 3.0 * (s1 - s2)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _third_from(local, starts, block, order, tile, m, ramp):  # type: ignore[no-untyped-def]
    """Sum of the squares whose i lies in one block, in stretches over which none of the other points leaves its own."""
    X, dX, W, dW, L = starts[0], starts[1], starts[2], starts[3], starts[4]
    i, stop = tile * block, min((tile + 1) * block, local.size - 3 * m)
    total = 0.0
    while i < stop:
        p, q, r = i + m, i + 2 * m, i + 3 * m
        u, v, w = p // block, q // block, r // block
        size = min(stop - i, (u + 1) * block - p, (v + 1) * block - q, (w + 1) * block - r)
        a, b, c, d = i - tile * block, p - u * block, q - v * block, r - w * block
        # sums of multiples of quanta are exact, so they cancel without loss
        at = _joined(X[tile], X[u], X[v], X[w])
        turned = _joined(L[tile] * a, L[u] * b, L[v] * c, L[w] * d)
        rest = _joined(dX[tile], dX[u], dX[v], dX[w])
        level = _joined(L[tile], L[u], L[v], L[w])
        if order == 1:
            start, slope, bend = (at + turned) + rest, level, 0.0
        else:
            one = _joined(W[tile], W[u], W[v], W[w])
            two = _joined(X[tile] * a, X[u] * b, X[v] * c, X[w] * d)
            three = _joined(
                L[tile] * (0.5 * a * (a - 1)), L[u] * (0.5 * b * (b - 1)), L[v] * (0.5 * c * (c - 1)),
                L[w] * (0.5 * d * (d - 1)),
            )  # fmt: skip
            both = one + two
            lost = (one - (both - (both - one))) + (two - (both - one))  # by rounding it (Knuth's two-sum)
            small = _joined(dW[tile], dW[u], dW[v], dW[w])
            small += _joined(dX[tile] * a, dX[u] * b, dX[v] * c, dX[w] * d)
            start = ((both + three) + lost) + small
            slope, bend = (at + (turned - 0.5 * level)) + rest, 0.5 * level
        s0, s1, s2, s3 = local[i : i + size], local[p : p + size], local[q : q + size], local[r : r + size]
        if slope == 0.0 and bend == 0.0:
            total += _third(s0, s1, s2, s3, start)
        else:
            total += _third_bent(s0, s1, s2, s3, start, slope, bend, ramp)
        i += size
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def add_third(local, starts, block, order, factors, first, last, out):  # type: ignore[no-untyped-def]
    """Sums of squares of ``s[i+3m] - 3 s[i+2m] + 3 s[i+m] - s[i]``, of first or of second sums s.

    Parameters
    ----------
    order : int
        1 or 2, which sums those in `local` are.
    local, starts, block, factors, first, last, out : see :func:`add_second`
    """
    ramp = np.arange(np.float64(block))
    short = np.searchsorted(factors, _LONG * block)
    for tile in range(first, last):
        for f in range(short):
            out[tile, f] = _third_from(local, starts, block, order, tile, factors[f], ramp)
    for f in range(short, factors.size):
        for tile in range(first, last):
            out[tile, f] = _third_from(local, starts, block, order, tile, factors[f], ramp)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def stream(values, axis, reference, span, order, chunk, factors, doubled, tails, kept, unread, sums):  # type: ignore[no-untyped-def]
    """Take samples through a pyramid of levels, each of averages over two of the level below.

    The differences of a level are sampled differences of the record: level l knows the cumulative sum at every 2^l-th
    sample (first sums), and for second sums its values are what makes theirs so.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
    axis : int
    reference : float
        Subtracted from the samples.
    span : int
        2 or 3: differences as in :func:`add_second` or :func:`add_third`.
    order : int
        1 or 2: of first or of second sums.
    chunk : int
        Samples that are taken at a time; sums do not depend on how the record is parted at its multiples.
    factors : ndarray of int, shape (k,)
        In samples of a level.
    doubled : int
        Index of the first factor that levels above the lowest use.
    tails : ndarray, shape (levels, t)
        Last values of each level, those that the longest difference needs; in place as all that follow.
    kept : ndarray of int, shape (levels,)
        How many there are.
    unread : ndarray of int, shape (levels,)
        How many of them the next level has not taken.
    sums : ndarray, shape (levels, k)
        Sums of squared differences.
    """
    levels, room = tails.shape
    z, s = np.empty(room + chunk), np.empty(room + chunk + 2)
    fresh = np.empty(chunk)
    taken = order + 1  # values that make one of the next level
    for start in range(0, values.shape[0], chunk):
        new = min(chunk, values.shape[0] - start)
        for i in range(new):
            fresh[i] = values[start + i, axis] - reference
        for level in range(levels):
            if new == 0:
                break
            have = kept[level]
            total = have + new
            z[:have] = tails[level, :have]
            z[have:total] = fresh[:new]
            common = np.mean(z[:total])  # no difference sees it
            x, w = 0.0, 0.0
            for i in range(total + order):
                s[i] = x if order == 1 else w
                w += x
                if i < total:
                    x += z[i] - common
            for f in range(0 if level == 0 else doubled, factors.size):
                m = factors[f]
                length = span * m - order + 1  # values that one difference is made of
                a = max(0, have - length + 1)  # those that end before the new values were counted before
                size = total - length + 1 - a
                if size <= 0:
                    continue
                if span == 2:
                    sums[level, f] += _second(
                        s[a : a + size], s[a + m : a + m + size], s[a + 2 * m : a + 2 * m + size], 0.0
                    )
                else:
                    b, c, d = a + m, a + 2 * m, a + 3 * m
                    sums[level, f] += _third(s[a : a + size], s[b : b + size], s[c : c + size], s[d : d + size], 0.0)
            at, new = have - unread[level], 0
            while at + taken <= total:
                if order == 1:
                    fresh[new] = 0.5 * (z[at] + z[at + 1])
                else:
                    fresh[new] = 0.25 * (z[at] + z[at + 2]) + 0.5 * z[at + 1]
                at += 2
                new += 1
            unread[level] = total - at
            kept[level] = min(room, total)
            tails[level, : kept[level]] = z[total - kept[level] : total]
