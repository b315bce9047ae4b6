"""One table of samples: which column is what, in which unit, streamed in SI.

A :class:`Recording` is opened, not loaded: :meth:`Recording.batches` reads the file piece by piece, checks every
sample, and hands out SI (or counts, when no nominal scale is known).
"""

from .clock import EPOCH
from .columns import Channel, header_parts, nominal_scale
from .opened import open_recording
from .record import GAP, SENSORS, Batch, Recording, from_arrays, sample_interval

__all__ = [
    "EPOCH",
    "GAP",
    "SENSORS",
    "Batch",
    "Channel",
    "Recording",
    "from_arrays",
    "header_parts",
    "nominal_scale",
    "open_recording",
    "sample_interval",
]
