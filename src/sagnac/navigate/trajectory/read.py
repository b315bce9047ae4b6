"""A course from the table of a file: its keys checked one by one, and its legs checked to go together."""

from __future__ import annotations

from ...errors import InputError
from ...quantities import checked
from .course import Course
from .profile import Profile


def from_table(table: object, name: str = "course") -> Course:
    """A course from the table ``[trajectory]`` of a TOML file.

    Parameters
    ----------
    table : dict
    name : str
        Of the file, for messages.

    Raises
    ------
    InputError
        With the key at fault (``trajectory.leg.0.duration``) and what to write instead; also when the legs do not go together:
        a speed below zero, a bank that no vehicle holds.
    """
    course = checked(Course, table, name, "trajectory")
    try:
        Profile.of(course)
    except InputError as cause:
        raise InputError(f"{name}: {cause}") from cause
    return course
