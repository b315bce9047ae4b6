"""Quantities of a plan: a text with its unit in the file, SI in memory, and back."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, ValidationInfo

from .. import units
from ..errors import InputError

# SI unit -> unit that a person would write
_WRITTEN = {
    "angle": ("deg", math.pi / 180),
    "angular rate": ("deg/s", math.pi / 180),
}


def _each_reader(kind: str) -> Callable[[Any, ValidationInfo], Any]:
    """Reader of one quantity for all axes, or of three for x, y and z."""
    one = _reader(kind)

    def read(value: Any, info: ValidationInfo) -> Any:
        if not isinstance(value, list | tuple):
            return one(value, info)
        if len(value) != 3:
            raise ValueError(f"give one quantity for all axes or three for x, y, z; got {len(value)}")
        return tuple(one(v, info) for v in value)

    return read


def _reader(kind: str) -> Callable[[Any, ValidationInfo], float]:
    def read(value: Any, info: ValidationInfo) -> float:
        if isinstance(value, str):
            try:
                return units.parse(value, kind, "this key")
            except InputError as cause:
                raise ValueError(str(cause).removeprefix("this key: ")) from cause
        from_file = bool(info.context and info.context.get("file"))
        if isinstance(value, int | float) and not isinstance(value, bool) and (kind == "ratio" or not from_file):
            if not abs(value) <= sys.float_info.max:
                raise ValueError(
                    f"{value:.3g} is not finite" if isinstance(value, float) else "the number is too large"
                )
            return float(value)  # in Python, SI
        raise ValueError(f"write it as a text with its unit, for example {units.KINDS[kind][1]!r}; got {value!r}")

    return read


Angle = Annotated[float, BeforeValidator(_reader("angle")), Field(json_schema_extra={"kind": "angle"})]
Rate = Annotated[float, BeforeValidator(_reader("angular rate")), Field(json_schema_extra={"kind": "angular rate"})]
Time = Annotated[float, BeforeValidator(_reader("time")), Field(json_schema_extra={"kind": "time"})]
Length = Annotated[float, BeforeValidator(_reader("length")), Field(json_schema_extra={"kind": "length"})]
Acceleration = Annotated[
    float, BeforeValidator(_reader("acceleration")), Field(json_schema_extra={"kind": "acceleration"})
]
Ratio = Annotated[float, BeforeValidator(_reader("ratio")), Field(json_schema_extra={"kind": "ratio"})]
Quadratic = Annotated[
    float,
    BeforeValidator(_reader("quadratic coefficient")),
    Field(json_schema_extra={"kind": "quadratic coefficient"}),
]
GSquared = Annotated[
    float, BeforeValidator(_reader("g-squared sensitivity")), Field(json_schema_extra={"kind": "g-squared sensitivity"})
]
PerAxis = float | tuple[float, float, float]
"""One number for all axes, or three for x, y, z."""
Triple = tuple[Quadratic, Quadratic, Quadratic]


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError(f"{value:g} is negative; an uncertainty, bound or noise is a size")
    return value


SIZE = AfterValidator(_not_negative)


def _sizes(value: PerAxis) -> PerAxis:
    for v in value if isinstance(value, tuple) else (value,):
        _not_negative(v)
    return value


AccelDensity = Annotated[
    PerAxis,
    BeforeValidator(_each_reader("accelerometer noise density")),
    AfterValidator(_sizes),
    Field(json_schema_extra={"kind": "accelerometer noise density"}),
]
GyroDensity = Annotated[
    PerAxis,
    BeforeValidator(_each_reader("gyro noise density")),
    AfterValidator(_sizes),
    Field(json_schema_extra={"kind": "gyro noise density"}),
]
AccelInstability = Annotated[
    PerAxis,
    BeforeValidator(_each_reader("acceleration")),
    AfterValidator(_sizes),
    Field(json_schema_extra={"kind": "acceleration"}),
]
GyroInstability = Annotated[
    PerAxis,
    BeforeValidator(_each_reader("angular rate")),
    AfterValidator(_sizes),
    Field(json_schema_extra={"kind": "angular rate"}),
]
AccelWalk = Annotated[
    PerAxis,
    BeforeValidator(_each_reader("acceleration random walk")),
    AfterValidator(_sizes),
    Field(json_schema_extra={"kind": "acceleration random walk"}),
]
GyroWalk = Annotated[
    PerAxis,
    BeforeValidator(_each_reader("rate random walk")),
    AfterValidator(_sizes),
    Field(json_schema_extra={"kind": "rate random walk"}),
]


def plain(record: BaseModel) -> dict[str, Any]:
    """Table of texts with units, defaults left out."""
    out: dict[str, Any] = {}
    for name, info in type(record).model_fields.items():
        value = getattr(record, name)
        if value == info.default or value is None:
            continue
        out[name] = _plain_value(value, _kind(info))
    return out


def _kind(info: Any) -> str | None:
    for extra in [info.json_schema_extra, *(getattr(m, "json_schema_extra", None) for m in info.metadata)]:
        if isinstance(extra, dict) and "kind" in extra:
            return str(extra["kind"])
    text = repr(info.annotation)
    return next((kind for kind in units.KINDS if f"{{'kind': '{kind}'}}" in text), None)


def _plain_value(value: Any, kind: str | None) -> Any:
    if isinstance(value, BaseModel):
        return plain(value)
    if isinstance(value, tuple):
        return [_plain_value(v, kind) for v in value]
    if isinstance(value, float) and kind is not None:
        return _text(value, kind)
    return value


@lru_cache(maxsize=1024)  # campaigns write the same plan thousands of times
def _text(value: float, kind: str) -> str:
    """The shortest text that reads back as the same number, in degrees where that can be."""
    if kind in _WRITTEN:
        unit, size = _WRITTEN[kind]
        for shown in (round(value / size, 9), value / size):
            text = f"{shown!r} {unit}"
            if units.parse(text, kind) == value:
                return text
    return f"{value!r} {units.KINDS[kind][0]}".strip()
