"""What goes into an export and what comes out of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..files import write_atomically

FORCE = 9.80665
"""Specific force that the sizes of dropped terms are stated for, m/s^2: 1 g, in any direction."""
RATE = 1.7453292519943295
"""Angular rate that they are stated for, rad/s: 100 deg/s, about any axis."""
SIZES = "largest error at 1 g and 100 deg/s in any direction"
"""What the sizes are."""


@dataclass(frozen=True)
class Options:
    """What a target needs and a calibration does not hold.

    Attributes
    ----------
    noise : mapping of str to float
        ``accel_density`` [m/s^2/sqrt(Hz)], ``accel_random_walk`` [m/s^3/sqrt(Hz)], ``gyro_density`` [rad/s/sqrt(Hz)],
        ``gyro_random_walk`` [rad/s^2/sqrt(Hz)]; they count before those of the calibration.
    rate : float, Hz, optional
        Samples per second.
    topic : str
        ROS topic of the samples.
    device_id : mapping of str to int
        Identifiers of the autopilot's ``accel`` and ``gyro``.
    instance : int, optional
        Which of the autopilot's sensors, as its parameters count: PX4 from 0, ArduPilot from 1. By default that of the recording
        that the calibration was made from, or the first where this is not known.
    temperature : float, K, optional
        Of the calibration; counts before the recording's.
    """

    noise: Mapping[str, float] = field(default_factory=dict)
    rate: float | None = None
    topic: str = "/imu0"
    device_id: Mapping[str, int] = field(default_factory=dict)
    instance: int | None = None
    temperature: float | None = None


@dataclass(frozen=True)
class Dropped:
    """A part of the calibration that the target cannot hold.

    Attributes
    ----------
    sensor : str
        ``accel`` or ``gyro``.
    what : str
    size : float
        The largest error that it leaves, in any direction, at :data:`FORCE` and :data:`RATE`.
    unit : str
        Of `size`: m/s^2 or rad/s.
    in_noise : float or None
        Size over the unit's own white noise averaged over one second (that of its quietest axis); None when the calibration
        states no noise.
    """

    sensor: str
    what: str
    size: float
    unit: str
    in_noise: float | None

    def line(self) -> str:
        """One line of text."""
        noise = "" if self.in_noise is None else f", {float(f'{self.in_noise:.3g}'):g} times the noise of 1 s"
        return f"{self.sensor} {self.what}: {self.size:.3g} {self.unit}{noise}"


@dataclass(frozen=True)
class Exported:
    """Files for the target, and what is not in them.

    Attributes
    ----------
    files : dict of str to bytes
        What is appended to the stem of the file's name (empty where there is one file), and the content.
    dropped : tuple of Dropped
    remarks : tuple of str
    """

    files: dict[str, bytes]
    dropped: tuple[Dropped, ...]
    remarks: tuple[str, ...] = ()

    def paths(self, out: str | Path) -> dict[Path, bytes]:
        """Content by file: `out` itself, or, of several files, `out` with ``_acc`` and the like before its ending."""
        out = Path(out)
        return {out.with_name(f"{out.stem}{tag}{out.suffix}"): content for tag, content in self.files.items()}

    def save(self, out: str | Path) -> tuple[Path, ...]:
        """Write each file whole or not at all.

        Raises
        ------
        InputError
            When the folder cannot be written.
        """
        for path, content in self.paths(out).items():
            with write_atomically(path) as temporary:
                temporary.write_bytes(content)
        return tuple(self.paths(out))

    def to_dict(self) -> dict[str, Any]:
        """What was dropped and remarked, for JSON."""
        return {
            "dropped": [
                {"sensor": d.sensor, "what": d.what, "size": d.size, "unit": d.unit, "in_noise": d.in_noise}
                for d in self.dropped
            ],
            "at": {"specific_force": FORCE, "angular_rate": RATE},
            "remarks": list(self.remarks),
        }

    def summary(self) -> str:
        """What was dropped and remarked, as text."""
        lines = [f"  note: {remark}" for remark in self.remarks]
        if self.dropped:
            known = any(d.in_noise is not None for d in self.dropped)
            lines += [f"  not held by the target, {SIZES}{'' if known else ' (the calibration states no noise)'}:"]
            lines += [f"    {d.line()}" for d in self.dropped]
        return "\n".join(lines or ["  the target holds the whole calibration"])
