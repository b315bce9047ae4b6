"""Sums of samples against harmonics of a turning angle, and a look at extremes, in one pass over the samples.

The samples of a long record come from memory, at a pace of their own: what is computed with them is free as long as it goes on
while the next ones are loaded.
"""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

LOW, HIGH, AT_LOW, AT_HIGH, RUN_LOW, RUN_HIGH, LONGEST_LOW, LONGEST_HIGH, SQUARED_STEPS, FINEST, LAST = range(11)
"""Columns of the state of :func:`look`."""

_QUICK = {"reassoc", "contract"}  # sums may be taken in any order: several lanes at once


def _prefetch_code(_, array, index):  # type: ignore[no-untyped-def]
    """Begin to load the cache line of an element, which need not exist, without waiting for it."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        data = make_array(signature.args[0])(context, builder, arguments[0]).data  # type: ignore[no-untyped-call]
        number = ir.IntType(32)
        address = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [address.type, number, number, number])
        prefetch = builder.module.declare_intrinsic("llvm.prefetch", (address.type,), kind)
        builder.call(prefetch, [address, number(0), number(3), number(1)])  # to read, into the nearest cache, data
        return context.get_dummy_value()

    return types.void(array, index), generate


_prefetch: Any = intrinsic(_prefetch_code)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _fetch(samples, begin, lines):  # type: ignore[no-untyped-def]
    """Begin to load some cache lines; returns where the next one begins."""
    for i in range(lines):
        _prefetch(samples, begin + 8 * i)
    return begin + 8 * lines


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


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=_QUICK)
def harmonic_sums(  # type: ignore[no-untyped-def] # noqa: PLR0915 - apart from its callers the loops lose their lanes
    values,
    size,
    turn,
    starts,
    regular,
    clock,
    angle,
    table,
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

    A regular block is summed against one table of sines and cosines about the middle of a full block, for which the samples
    are folded there (even and odd part), and the block's sums are turned to its angle. Other blocks are summed sample by
    sample. The sum of squares is that of the difference from a reference signal, taken block by block, so that a signal
    much larger than the noise costs few digits.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
    size : int
        Samples in a block, no more than the table's; the last block may have fewer.
    turn : ndarray, shape (7,)
        Time, angle, rate: th(t) = turn[1] + turn[2] (t - turn[0]). Zero of tau. Sample interval. Cells in a second, counted
        from turn[0], and the cell of the first row of the outputs.
    starts : ndarray, shape (blocks,), s
        Time of the first sample of each block.
    regular : ndarray of bool, shape (blocks,)
        Whether the samples of the block are evenly spaced and go by the turn.
    clock, angle : ndarray, shape (n,) or (0,), s and rad
        Time and th of each sample, read for blocks that are not regular; without `angle` the turn gives th.
    table : ndarray, shape (k - 1, half)
        Upper half of the table: cos, sin of the harmonics, then tau cos, tau sin.
    moment : ndarray of complex, shape (2, powers, 2 order + 1)
        Sums of ``tau^p exp(i m th)`` over a block and over the last one, tau and th zero in the middle of the table; powers is
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
    n, axes = values.shape
    k, powers, top, half = sums.shape[2], moment.shape[1], moment.shape[2], table.shape[1]
    order, last = top // 2, np.uint64(half - 1)
    buffer, even, odd, local = np.zeros(2 * half), np.empty(half), np.empty(half), np.empty(k)
    e, z = np.ones(top, dtype=np.complex128), np.ones(top, dtype=np.complex128)
    start, phase, rate, zero, step, cells_per_second, first_cell = turn
    flat = values.reshape(-1)
    # while one block is worked on the next one is loaded, some cache lines before each loop: their number in flight is limited
    lines = half // (4 * (1 + k // 2)) + 1
    for b in range(starts.size):
        begin = b * size
        m = min(size, n - begin)
        ahead = (begin + size) * axes
        row = min(max(int((starts[b] - start) * cells_per_second - first_cell), 0), sums.shape[0] - 1)
        if count:
            time_sums[row] += m * (starts[b] - zero + 0.5 * (m - 1) * step)
        if not regular[b]:
            for i in range(begin, begin + m):
                th = angle[i] if angle.size > 0 else phase + rate * (clock[i] - start)
                _one_by_one(
                    values[i], th, clock[i] - zero, centre, reference, e, sums[row], squares, moments[row], count
                )
            continue
        if axes == 1:
            # what is still under way, all of it at once
            touched = 0.0
            for i in range(begin, begin + m, 8):
                touched += flat[i]
            squares[0] += 0.0 * touched
        middle = starts[b] + (half - 0.5) * step
        w, t = 0 if m == size else 1, middle - zero
        _powers(phase + rate * (middle - start), e)
        for h in range(top):
            z[h] = e[h] * moment[w, 0, h]
        for h in range(top if count else 0):
            moments[row, 0, h] += z[h]
            if powers > 1:
                once = e[h] * moment[w, 1, h]
                moments[row, 1, h] += t * z[h] + once
                moments[row, 2, h] += t * (t * z[h] + 2.0 * once) + e[h] * moment[w, 2, h]
        for a in range(axes):
            level = centre[a]
            if axes == 1 and m == 2 * half:
                piece = flat[begin : begin + m]
            else:
                for j in range(m):
                    buffer[j] = values[begin + j, a]
                for j in range(m, 2 * half):
                    buffer[j] = level
                piece = buffer
            ahead = _fetch(flat, ahead, lines)
            total, rest = 0.0, 0.0
            for i in range(half):
                p = np.uint64(i)  # an index that cannot be negative needs no check, and the loop runs in lanes
                v, u = piece[np.uint64(half) + p] - level, piece[last - p] - level
                even[i], odd[i] = v + u, v - u
                total += v + u
                rest += v * v + u * u
            local[0] = total
            for h in range(order):
                ahead = _fetch(flat, ahead, lines)
                row_c, row_s = table[2 * h], table[2 * h + 1]
                c, s = 0.0, 0.0
                for j in range(half):
                    c += even[j] * row_c[j]
                    s += odd[j] * row_s[j]
                local[1 + 2 * h], local[2 + 2 * h] = c, s
            for h in range(order, 2 * order if powers > 1 else 0):
                ahead = _fetch(flat, ahead, lines)
                row_c, row_s = table[2 * h], table[2 * h + 1]
                c, s = 0.0, 0.0
                for j in range(half):
                    c += odd[j] * row_c[j]
                    s += even[j] * row_s[j]
                local[1 + 2 * h], local[2 + 2 * h] = c, s
            # turn the sums to the angle of the block, and take the reference out of the squares
            sums[row, a, 0] += total
            rest += squared[a, 0].real * z[0].real - 2.0 * reference[a, 0] * total
            for h in range(1, top, 2):
                ch, sh = e[h // 2 + 1].real, e[h // 2 + 1].imag
                c, s = ch * local[h] - sh * local[h + 1], sh * local[h] + ch * local[h + 1]
                sums[row, a, h] += c
                sums[row, a, h + 1] += s
                rest -= 2.0 * (reference[a, h] * c + reference[a, h + 1] * s)
                if powers > 1:
                    q = h + top - 1
                    sums[row, a, q] += t * c + ch * local[q] - sh * local[q + 1]
                    sums[row, a, q + 1] += t * s + sh * local[q] + ch * local[q + 1]
            for h in range(1, top):
                rest += squared[a, h].real * z[h].real - squared[a, h].imag * z[h].imag
            squares[a] += rest


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
