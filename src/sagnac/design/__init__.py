"""What a plan can see before it is run, and better plans.

``check`` predicts every uncertainty of a plan, ``optimise`` picks positions, rates, g levels and dwell from candidates.
"""

from __future__ import annotations

from .check import PlanCheck, check
from .optimise import Optimised, optimise
from .spec import Spec, load_spec

__all__ = ["Optimised", "PlanCheck", "Spec", "check", "load_spec", "optimise"]
