"""What can go wrong, told to the person at the rig.

Two kinds only, and the command line turns each into its exit status: the input cannot be used
(:class:`InputError`, 2) or it was read well but does not support a result (:class:`DataError`, 1).
"""

from __future__ import annotations


class SagnacError(Exception):
    """Base of every error that Sagnac raises on purpose."""

    exit_status = 1


class InputError(SagnacError):
    """A file, option or unit that cannot be used as it stands (exit status 2)."""

    exit_status = 2


class DataError(SagnacError):
    """Readable data that do not support the result asked for (exit status 1)."""

    exit_status = 1
