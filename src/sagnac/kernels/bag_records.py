"""Where the records of a stretch of a log lie: ROS 1 bag (format 2.0) and MCAP, which chain records by their lengths."""

from __future__ import annotations

import numba as nb

DONE, CUT, MALFORMED, STOPPED = 0, 1, 2, 3
"""Why a scan ended: at the end or with a full table, a record goes beyond the end, one cannot be, one to be read otherwise."""


@nb.njit(cache=True, nogil=True)
def _u32(data, at):  # type: ignore[no-untyped-def]
    low = nb.int64(data[at]) | nb.int64(data[at + 1]) << 8
    return low | nb.int64(data[at + 2]) << 16 | nb.int64(data[at + 3]) << 24


@nb.njit(cache=True, nogil=True)
def _u64(data, at):  # type: ignore[no-untyped-def]
    """Negative from 2^63 on."""
    return _u32(data, at) | _u32(data, at + 4) << 32


@nb.njit(cache=True, nogil=True)
def scan_ros1(data, at, out):  # type: ignore[no-untyped-def]  # noqa: PLR0911 (one for every reason to stop)
    """Records of a ROS 1 bag up to the first chunk.

    A record is the length of its header, fields ``name=value`` with a length before each, the length of its data and the
    data (wiki.ros.org/Bags/Format/2.0).

    Parameters
    ----------
    data : ndarray of uint8, shape (n,)
    at : int
        Where the first record begins.
    out : ndarray of int64, shape (m, 6)
        Filled with op, connection, time [ns], first byte of the data, byte after the data, first byte of the record; -1
        where a record has no connection or time.

    Returns
    -------
    count, at, status : int
        Records found, byte after the last of them, and why the scan ended.
    """
    n = data.size
    count = 0
    while at < n and count < out.shape[0]:
        if n - at < 4:
            return count, at, CUT
        field = at + 4
        stop = field + _u32(data, at)
        if stop > n:
            return count, at, CUT
        op, connection, time = -1, nb.int64(-1), nb.int64(-1)
        while field < stop:
            if stop - field < 4:
                return count, at, MALFORMED
            size = _u32(data, field)
            field += 4
            if size > stop - field:
                return count, at, MALFORMED
            if size == 4 and data[field] == 111 and data[field + 1] == 112 and data[field + 2] == 61:  # op=
                op = nb.int64(data[field + 3])
            elif size == 9 and data[field] == 99 and data[field + 3] == 110 and data[field + 4] == 61:  # conn=
                connection = _u32(data, field + 5)
            elif size == 13 and data[field] == 116 and data[field + 1] == 105 and data[field + 4] == 61:  # time=
                time = _u32(data, field + 5) * 1000000000 + _u32(data, field + 9)
            field += size
        if op == 5:
            return count, at, STOPPED
        if op < 0 or (op == 2 and (connection < 0 or time < 0)) or (op == 7 and connection < 0):
            return count, at, MALFORMED
        if n - stop < 4:
            return count, at, CUT
        first = stop + 4
        last = first + _u32(data, stop)
        if last > n:
            return count, at, CUT
        out[count, 0], out[count, 1], out[count, 2] = op, connection, time
        out[count, 3], out[count, 4], out[count, 5] = first, last, at
        count += 1
        at = last
    return count, at, DONE


@nb.njit(cache=True, nogil=True)
def scan_mcap(data, at, out):  # type: ignore[no-untyped-def]
    """Records of an MCAP file up to the first chunk or the footer.

    A record is one byte that tells its kind, eight that tell its length, and its content (mcap.dev/spec).

    Parameters
    ----------
    data : ndarray of uint8, shape (n,)
    at : int
        Where the first record begins.
    out : ndarray of int64, shape (m, 6)
        Filled with op, channel, log time [ns], first byte of the content (of a message: of what the channel sent), byte
        after it, first byte of the record; -1 where a record is no message.

    Returns
    -------
    count, at, status : int
        As :func:`scan_ros1`.
    """
    n = data.size
    count = 0
    while at < n and count < out.shape[0]:
        op = nb.int64(data[at])
        if op in (2, 6):
            return count, at, STOPPED
        if n - at < 9:
            return count, at, CUT
        first = at + 9
        size = _u64(data, at + 1)
        if size < 0 or size > n - first:
            return count, at, CUT
        last = first + size
        channel, time = nb.int64(-1), nb.int64(-1)
        if op == 0 or (op == 5 and size < 22):
            return count, at, MALFORMED
        if op == 5:
            channel = nb.int64(data[first]) | nb.int64(data[first + 1]) << 8
            time = _u64(data, first + 6)
            first += 22
        out[count, 0], out[count, 1], out[count, 2] = op, channel, time
        out[count, 3], out[count, 4], out[count, 5] = first, last, at
        count += 1
        at = last
    return count, at, DONE
