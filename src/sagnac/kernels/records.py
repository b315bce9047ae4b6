"""Walks over the records of binary logs: where each one begins, told by its own length and nothing else.

The records follow one another without gaps, so that the place of one is known only after the one before it: a loop that
NumPy has no word for. Each walk stops before the first byte that it cannot account for.
"""

from __future__ import annotations

import numba as nb
import numpy as np

UNFINISHED = 0
"""The last record goes on behind the end of the data, or nothing is left."""
FULL = 1
"""The lists that the walk fills are full."""
CONTROL = 2
"""A record that changes how later ones are read stands here."""
DAMAGED = 3
"""What stands here is no record."""

_SYNC = np.array([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12], dtype=np.uint8)


@nb.njit(cache=True, nogil=True)
def walk_ulog(data, at, shortest, longest, wanted, places, kinds):  # type: ignore[no-untyped-def]
    """Data records of a ULog file.

    A record is its length (two bytes, little endian, without these three), a letter, and the content. Records ``D`` (data)
    begin with two bytes that say what they hold.

    Parameters
    ----------
    data : ndarray of uint8
    at : int
        Where the first record begins.
    shortest, longest : ndarray of int32, shape (65536,)
        Bytes that data of each kind may have; -1 for kinds that nobody announced.
    wanted : ndarray of uint8, shape (65536,)
        Not zero for the kinds to be listed.
    places : ndarray of int64, shape (n,)
        Filled with where the data of the wanted records begin.
    kinds : ndarray of uint16, shape (n,)
        Filled with their kinds.

    Returns
    -------
    at : int
        Where the walk stopped, at the beginning of a record.
    count : int
        Records listed.
    why : int
        One of the constants of this module; `CONTROL` at the letters A, B, F and O.
    """
    count, why = 0, UNFINISHED
    while at + 3 <= data.size:
        size = np.int64(data[at]) | (np.int64(data[at + 1]) << 8)
        letter = data[at + 2]
        end = at + 3 + size
        why = DAMAGED
        if size == 0:
            break
        if letter == 68:  # D: data
            if size < 2:
                break
            if at + 5 > data.size:
                why = UNFINISHED
                break
            kind = np.int64(data[at + 3]) | (np.int64(data[at + 4]) << 8)
            if shortest[kind] < 0 or size - 2 < shortest[kind] or size - 2 > longest[kind]:
                break
            if wanted[kind] != 0 and end <= data.size:
                if count == places.size:
                    why = FULL
                    break
                places[count] = at + 5
                kinds[count] = kind
                count += 1
        elif letter in (65, 66, 70, 79):  # A, B, F, O
            why = UNFINISHED if end > data.size else CONTROL
            break
        elif letter == 83:  # S: eight known bytes, and more in later versions perhaps
            known = size >= 8
            for i in range(min(8, data.size - at - 3)):
                known = known and data[at + 3 + i] == _SYNC[i]
            if not known:
                break
        elif not (65 <= letter <= 90 or 97 <= letter <= 122):  # records of later versions are letters too
            break
        why = UNFINISHED
        if end > data.size:
            break
        at = end
    return at, count, why


@nb.njit(cache=True, nogil=True)
def walk_dataflash(data, at, lengths, wanted, places, kinds):  # type: ignore[no-untyped-def]
    """Messages of a DataFlash log.

    A message is 0xA3, 0x95, its kind, and the content; the whole length of each kind was told by a definition.

    Parameters
    ----------
    data : ndarray of uint8
    at : int
        Where the first message begins.
    lengths : ndarray of int32, shape (256,)
        Bytes of a message of each kind, heads included; 0 for kinds that nobody defined.
    wanted : ndarray of uint8, shape (256,)
        Not zero for the kinds to be listed.
    places : ndarray of int64, shape (n,)
        Filled with where the contents of the wanted messages begin.
    kinds : ndarray of uint8, shape (n,)
        Filled with their kinds.

    Returns
    -------
    at : int
        Where the walk stopped, at the beginning of a message.
    count : int
        Messages listed.
    why : int
        One of the constants of this module; `CONTROL` at a definition.
    """
    count, why = 0, UNFINISHED
    while at + 3 <= data.size:
        kind = data[at + 2]
        end = at + lengths[kind]
        if data[at] != 0xA3 or data[at + 1] != 0x95 or lengths[kind] < 3:
            why = DAMAGED
            break
        if end > data.size:
            break
        if kind == 0x80:
            why = CONTROL
            break
        if wanted[kind] != 0:
            if count == places.size:
                why = FULL
                break
            places[count] = at + 3
            kinds[count] = kind
            count += 1
        at = end
    left = data.size - at
    if (left > 0 and data[at] != 0xA3) or (left > 1 and data[at + 1] != 0x95):
        why = DAMAGED
    return at, count, why


@nb.njit(cache=True, nogil=True)
def gather(data, places, size):  # type: ignore[no-untyped-def]
    """Equally long pieces of data, one after the other.

    Parameters
    ----------
    data : ndarray of uint8
    places : ndarray of int64, shape (n,)
        Where they begin.
    size : int
        Bytes of each.

    Returns
    -------
    ndarray of uint8, shape (n, size)
    """
    out = np.empty((places.size, size), dtype=np.uint8)
    for k in range(places.size):
        at = places[k]
        for i in range(size):
            out[k, i] = data[at + i]
    return out
