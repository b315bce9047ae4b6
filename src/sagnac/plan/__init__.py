"""What was done with the unit: site, unit, rig and segments, read from TOML.

Every quantity in the file is a text with its unit; in memory, and in Python calls, everything is SI. Writing a plan
and reading it back gives an equal plan.
"""

from .quantities import Angle, Rate, Time
from .records import AXES, Limits, Noise, Plan, Rig, Segment, Unit
from .toml import from_table, load, read_toml

__all__ = [
    "AXES",
    "Angle",
    "Limits",
    "Noise",
    "Plan",
    "Rate",
    "Rig",
    "Segment",
    "Time",
    "Unit",
    "from_table",
    "load",
    "read_toml",
]
