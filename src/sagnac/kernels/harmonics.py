"""Sums of samples against harmonics of a turning angle, and a look at extremes, in one pass over the samples."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

LOW, HIGH, AT_LOW, AT_HIGH, RUN_LOW, RUN_HIGH, LONGEST_LOW, LONGEST_HIGH, SQUARED_STEPS, FINEST, LAST = range(11)
"""Columns of the state of :func:`look`."""

PART = 512
"""Samples that are summed at once against the table; a block has up to four such parts."""
_HALF = PART // 2
_QUICK = {"reassoc", "contract"}  # sums may be taken in any order: several lanes at once


@nb.njit(cache=True, nogil=True, error_model="numpy")
def regular_blocks(clock, size, step, tolerance):  # type: ignore[no-untyped-def]
    """Whether the samples of each block follow each other in equal steps.

    Parameters
    ----------
    clock : ndarray, shape (n,), s
    size : int
        Samples in a block; the last one may have fewer.
    step, tolerance : float, s
        How far a sample may be off the even grid that begins with the first one of its block.

    Returns
    -------
    ndarray of bool, shape (blocks,)
    """
    out = np.empty((clock.size + size - 1) // size, dtype=np.bool_)
    for b in range(out.size):
        piece = clock[b * size : min((b + 1) * size, clock.size)]
        start, off = piece[0], 0
        for j in range(piece.size):
            off += abs(piece[j] - start - j * step) > tolerance
        out[b] = off == 0
    return out


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _one_by_one(values, th, tau, centre, reference, e, sums, squares, moments, count):  # type: ignore[no-untyped-def]
    """Sums of one sample of all axes, at the angle th."""
    order, powers, tail = reference.shape[1] // 2, moments.shape[0], reference.shape[1]
    _powers(th, e)
    factor = 1.0
    for p in range(powers if count else 0):
        for h in range(e.size):
            moments[p, h] += factor * e[h]
        factor *= tau
    for a in range(values.size):
        v = values[a] - centre[a]
        r = v - reference[a, 0]
        sums[a, 0] += v
        for h in range(order):
            c, s = e[h + 1].real, e[h + 1].imag
            r -= reference[a, 1 + 2 * h] * c + reference[a, 2 + 2 * h] * s
            sums[a, 1 + 2 * h] += v * c
            sums[a, 2 + 2 * h] += v * s
            if powers > 1:
                sums[a, tail + 2 * h] += tau * v * c
                sums[a, tail + 2 * h + 1] += tau * v * s
        squares[a] += r * r


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _powers(th, out):  # type: ignore[no-untyped-def]
    """``exp(i m th)`` for m = 0, 1, ..."""
    out[0] = 1.0
    if out.size > 1:
        out[1] = complex(math.cos(th), math.sin(th))
    for m in range(2, out.size):
        out[m] = out[m // 2] * out[m - m // 2]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _touch(samples, begin):  # type: ignore[no-untyped-def]
    """Load of every cache line of a part, so that all of them are under way at once; in plain order, one by one. Returns zero."""
    total = 0.0
    for i in range(begin, begin + PART, 8):
        total += samples[i]
    return 0.0 * total


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _fold(samples, begin, zero, even, odd):  # type: ignore[no-untyped-def]
    """Even and odd part of a block about its middle; sum, and sum of squares."""
    middle = np.uint64(begin + _HALF)
    below = middle - np.uint64(1)
    total, squares, twice = 0.0, 0.0, 2.0 * zero
    for i in range(_HALF):
        j = np.uint64(i)  # an index that cannot be negative needs no check, and the loop runs in lanes
        v, u = samples[middle + j], samples[below - j]
        x, y = (v - twice) + u, v - u
        even[i], odd[i] = x, y
        total += x
        squares += x * x + y * y
    return total, 0.5 * squares


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _against(even, odd, rows, out):  # type: ignore[no-untyped-def]
    """Sums of pairs of rows of the table, the first of even functions, the second of odd ones."""
    for h in range(0, rows.shape[0], 2):
        first, second = rows[h], rows[h + 1]
        x, y = 0.0, 0.0
        for j in range(_HALF):
            x += even[j] * first[j]
            y += odd[j] * second[j]
        out[h], out[h + 1] = x, y


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _turned(sums, e, tau, out):  # type: ignore[no-untyped-def]
    """Add sums about one angle and time (0) to those about another, from which they are apart by ``exp(i h th) = e`` and tau."""
    top = 2 * e.size - 1
    out[0] += sums[0]
    for h in range(1, e.size):
        c, s, j = e[h].real, e[h].imag, 2 * h - 1
        x, y = c * sums[j] - s * sums[j + 1], s * sums[j] + c * sums[j + 1]
        out[j] += x
        out[j + 1] += y
        if sums.size > top:
            j += top - 1
            out[j] += tau * x + c * sums[j] - s * sums[j + 1]
            out[j + 1] += tau * y + s * sums[j] + c * sums[j + 1]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def _block(values, begin, end, centre, table, rotor, scratch, sums, squares):  # type: ignore[no-untyped-def]
    """Sums of all axes over a block of samples about the middle of four parts, and the sums of squares."""
    buffer, even, odd, near = scratch
    axes, top = values.shape[1], 2 * rotor.shape[1] - 1
    flat, rows, rows_tau, out, out_tau = values.reshape(-1), table[: top - 1], table[top - 1 :], near[1:], near[top:]
    sums[:] = 0.0
    squares[:] = 0.0
    for q in range(rotor.shape[0]):
        first, last = begin + q * PART, min(begin + (q + 1) * PART, end)
        if first >= last:
            break
        for a in range(axes):
            source, at = buffer, 0
            if axes == 1 and last - first == PART:
                source, at = flat, first
                squares[a] += _touch(flat, first)
            else:
                for j in range(last - first):
                    buffer[j] = values[first + j, a]
                for j in range(last - first, PART):
                    buffer[j] = centre[a]
            total, more = _fold(source, at, centre[a], even, odd)
            near[0] = total
            squares[a] += more
            _against(even, odd, rows, out)
            if near.size > top:
                _against(odd, even, rows_tau, out_tau)
            _turned(near, rotor[q], rotor[q, 0].imag, sums[a])


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def harmonic_sums(  # type: ignore[no-untyped-def]
    values,
    size,
    turn,
    starts,
    regular,
    clock,
    angle,
    table,
    rotor,
    moment,
    centre,
    reference,
    squared,
    sums,
    squares,
    moments,
    time_sums,
    count,
):
    """Sums of the samples less a constant against ``1, cos h th, sin h th`` (and ``tau cos h th, tau sin h th``).

    A regular block is summed in four parts against one table of sines and cosines about the middle of a part, for which the
    samples are folded there (even and odd part); the sums are turned to the angle of the part in the block, and those of the
    block to its own. Other blocks are summed sample by sample. The sum of squares is that of the difference from a reference
    signal, taken block by block, so that a signal much larger than the noise costs few digits.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
    size : int
        Samples in a block, up to four times `PART`; the last block may have fewer.
    turn : ndarray, shape (7,)
        Time, angle, rate: th(t) = turn[1] + turn[2] (t - turn[0]). Zero of tau. Sample interval. Cells in a second, counted
        from turn[0], and the cell of the first row of the outputs.
    starts : ndarray, shape (blocks,), s
        Time of the first sample of each block.
    regular : ndarray of bool, shape (blocks,)
        Whether the samples of the block are evenly spaced and go by the turn.
    clock, angle : ndarray, shape (n,) or (0,), s and rad
        Time and th of each sample, read for blocks that are not regular; without `angle` the turn gives th.
    table : ndarray, shape (k - 1, PART / 2)
        Upper half of the table: cos, sin of the harmonics, then tau cos, tau sin.
    rotor : ndarray of complex, shape (4, order + 1)
        exp(i h th) in the middle of each part, th zero in the middle of four parts; in place of h = 0, i times tau there.
    moment : ndarray of complex, shape (2, powers, 2 order + 1)
        Sums of ``tau^p exp(i m th)`` over a block and over the last one, tau and th zero in the middle of four parts; powers is
        1, or 3 for the terms with tau.
    centre : ndarray, shape (axes,)
        Subtracted from the samples.
    reference : ndarray, shape (axes, 2 order + 1)
        Coefficients of the reference signal for the samples less `centre`.
    squared : ndarray of complex, shape (axes, 2 order + 1)
        Series of its square: the real part of the sum of ``squared[m] exp(i m th)``.
    sums : ndarray, shape (cells, axes, k)
    squares : ndarray, shape (axes,)
    moments : ndarray of complex, shape (cells, powers, 2 order + 1)
    time_sums : ndarray, shape (cells,)
        Of tau, to the length of a block. All of these are added to; the last two only where `count` is true.
    count : bool
    """
    n, k, powers, top = values.shape[0], sums.shape[2], moment.shape[1], moment.shape[2]
    scratch = np.zeros(PART), np.empty(_HALF), np.empty(_HALF), np.empty(k)
    local, whole, rest = np.empty((squares.size, k)), np.empty(k), np.empty(squares.size)
    e, z = np.ones(top, dtype=np.complex128), np.ones(top, dtype=np.complex128)
    few = e[: rotor.shape[1]]
    start, phase, rate, zero, step, cells_per_second, first_cell = turn
    for b in range(starts.size):
        begin, end = b * size, min((b + 1) * size, n)
        row = min(max(int((starts[b] - start) * cells_per_second - first_cell), 0), sums.shape[0] - 1)
        if count:
            time_sums[row] += (end - begin) * (starts[b] - zero + 0.5 * (end - begin - 1) * step)
        if not regular[b]:
            for i in range(begin, end):
                th = angle[i] if angle.size > 0 else phase + rate * (clock[i] - start)
                _one_by_one(
                    values[i], th, clock[i] - zero, centre, reference, e, sums[row], squares, moments[row], count
                )
            continue
        middle = starts[b] + 0.5 * (4 * PART - 1) * step
        _powers(phase + rate * (middle - start), e)
        w, t = 0 if end - begin == size else 1, middle - zero
        for h in range(top):
            z[h] = e[h] * moment[w, 0, h]
        for h in range(top if count else 0):
            moments[row, 0, h] += z[h]
            if powers > 1:
                once = e[h] * moment[w, 1, h]
                moments[row, 1, h] += t * z[h] + once
                moments[row, 2, h] += t * (t * z[h] + 2.0 * once) + e[h] * moment[w, 2, h]
        _block(values, begin, end, centre, table, rotor, scratch, local, rest)
        for a in range(squares.size):
            whole[:] = 0.0
            _turned(local[a], few, t, whole)
            for h in range(top):
                rest[a] += squared[a, h].real * z[h].real - squared[a, h].imag * z[h].imag
                rest[a] -= 2.0 * reference[a, h] * whole[h]
            squares[a] += rest[a]
            for h in range(k):
                sums[row, a, h] += whole[h]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def look(values, state, fresh):  # type: ignore[no-untyped-def]
    """Extremes, runs of equal samples there, and steps from sample to sample.

    Parameters
    ----------
    values : ndarray, shape (n, axes), n > 0
    state : ndarray, shape (axes, 11)
        Of the samples so far, columns as named in this module; changed in place.
    fresh : bool
        Whether these are the first samples.
    """
    piece = np.empty(513)
    for a in range(values.shape[1]):
        s = state[a]
        if fresh:
            s[:] = 0.0
            s[LOW], s[HIGH], s[FINEST], s[LAST] = math.inf, -math.inf, math.inf, values[0, a]
        for begin in range(0, values.shape[0], 512):
            m = min(512, values.shape[0] - begin)
            piece[0] = s[LAST]
            for j in range(m):
                piece[j + 1] = values[begin + j, a]
            s[LAST] = piece[m]
            # counting runs in lanes; only a block that comes up to an extreme is gone through sample by sample
            low, high, finest, squares = s[LOW], s[HIGH], s[FINEST], 0.0
            lowest, highest, closer = 0, 0, 0
            for j in range(m):
                v = piece[j + 1]
                step = abs(v - piece[j])
                squares += step * step
                lowest += v <= low
                highest += v >= high
                closer += (step > 0.0) & (step < finest)
            s[SQUARED_STEPS] += squares
            if closer > 0:
                for j in range(m):
                    step = abs(piece[j + 1] - piece[j])
                    if step > 0.0:
                        s[FINEST] = min(s[FINEST], step)
            if highest == 0:
                s[RUN_HIGH] = 0.0
            else:
                for j in range(1, m + 1):
                    if piece[j] > s[HIGH]:
                        s[HIGH] = piece[j]
                        s[AT_HIGH] = s[RUN_HIGH] = s[LONGEST_HIGH] = 0.0
                    at = piece[j] == s[HIGH]
                    s[AT_HIGH] += at
                    s[RUN_HIGH] = s[RUN_HIGH] + 1.0 if at else 0.0
                    s[LONGEST_HIGH] = max(s[LONGEST_HIGH], s[RUN_HIGH])
            if lowest == 0:
                s[RUN_LOW] = 0.0
            else:
                for j in range(1, m + 1):
                    if piece[j] < s[LOW]:
                        s[LOW] = piece[j]
                        s[AT_LOW] = s[RUN_LOW] = s[LONGEST_LOW] = 0.0
                    at = piece[j] == s[LOW]
                    s[AT_LOW] += at
                    s[RUN_LOW] = s[RUN_LOW] + 1.0 if at else 0.0
                    s[LONGEST_LOW] = max(s[LONGEST_LOW], s[RUN_LOW])
