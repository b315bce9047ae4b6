"""The one estimator: whitened Gauss-Newton with priors, and every answer a laboratory asks of it.

Notation
    p        parameters, named; some with a prior, some nuisance
    r(p)     whitened residual, observed minus predicted over its standard deviation
    J        dr/dp
    C        (J'J + P)^-1 with P the prior information: the white covariance
    s        segment: samples of one segment are not independent, so segments are the clusters

Positions have local unknowns (the true direction of the input in each position). They are eliminated by
:func:`eliminate` before the estimator sees the rows, which leaves the same estimate and the same covariance as
solving for them (Golub & Pereyra 1973, variable projection).
"""

from __future__ import annotations

from .budget import SCATTER, Effects, contributions, scatter
from .problem import Estimate, Influence, Model, Parameter, Rows, eliminate
from .solve import estimate, settle
from .uncertainty import CONSISTENT
from .unseen import combination, null_space

__all__ = [
    "CONSISTENT",
    "SCATTER",
    "Effects",
    "Estimate",
    "Influence",
    "Model",
    "Parameter",
    "Rows",
    "combination",
    "contributions",
    "eliminate",
    "estimate",
    "null_space",
    "scatter",
    "settle",
]
