"""What the runs of a campaign do: one module a kind of run, and the task that the engine runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from .. import chunks
from ..spec import Campaign
from .about import About
from .outcome import Cell

__all__ = ["About", "Cell", "Task", "prepare"]


class Task(chunks.Task, Protocol):
    """A task of the engine that says what its rows are about."""

    @property
    def about(self) -> About:
        """What the rows are about."""

    def row(self, index: int) -> dict[str, Cell]:
        """One run, with its number and its status."""


def prepare(campaign: Campaign, say: Callable[[str], object] | None = None) -> Task:
    """The task of a campaign.

    Parameters
    ----------
    campaign : Campaign
    say : callable, optional
        Takes a line on what is done meanwhile.

    Raises
    ------
    DataError
        When no run could give a result.
    """
    if campaign.is_fleet:
        from .fleet import prepare as of_fleet

        return of_fleet(campaign)
    from .simulated import prepare as of_simulation

    return of_simulation(campaign, say)
