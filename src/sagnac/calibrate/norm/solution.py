"""The solution of a norm calibration: what the fit was made of, and what follows from it by the way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...estimate import Estimate
from ...frames import Array
from .. import budget
from .case import Case
from .model import NormModel


class Solution(NamedTuple):
    """The fit with what it was made of, and the fit and model that weigh by the stated noise where these differ."""

    fit: Estimate
    model: NormModel
    case: Case
    stated: tuple[Estimate, NormModel]

    def budget(self) -> dict[str, Array]:
        """Standard uncertainties of all parameters by source."""
        fit, model = self.stated
        return budget.of_fit(fit, model.rows, model.effects(fit.value))

    def directions(self) -> Array:
        """Most likely direction of up or of the outer axis in b, (n, 3)."""
        out = np.zeros((len(self.case.rates), 3))
        for group in self.model.groups:
            out[group.index] = self.model.locals(group, self.fit.value).a
        return out
