"""A C header (C99, C++) with the correction as inline functions, in double and in single precision."""

from __future__ import annotations

from ..frames import Array
from ..sensors import INPUT
from .canonical import Canonical, Linear
from .loss import lost, whole
from .record import Exported, Options
from .wording import encoded, header, real, single, spread

_GUARD = "SAGNAC_IMU_CORRECTION_H"
_PRECISIONS = {"double": "", "float": "f"}


def build(canonical: Canonical, options: Options) -> Exported:  # noqa: ARG001 - every builder takes the options
    """The header: ``imu_accel(y, u)`` and ``imu_gyro(y, f, u)``, and ``imu_accelf``, ``imu_gyrof`` in single precision."""
    dropped = lost(canonical.triads, {k: whole(t) for k, t in canonical.triads.items()})
    about = header(canonical, dropped)
    lines = ["/*", *(f" * {line}".rstrip() for line in about), " */", f"#ifndef {_GUARD}", f"#define {_GUARD}", ""]
    for kind, triad in canonical.triads.items():
        lines += _about(canonical, kind)
        for precision, suffix in _PRECISIONS.items():
            lines += [*_function(triad, precision, suffix), ""]
    return Exported({"": encoded([*lines, f"#endif /* {_GUARD} */"])}, dropped)


def _about(canonical: Canonical, kind: str) -> list[str]:
    triad = canonical.triads[kind]
    unit = "count" if triad.counts else INPUT[kind]
    text = {
        "accel": f"Specific force u [m/s^2] of accelerometer readings y [{unit}]: u = M (y - b)",
        "gyro": f"Angular rate u [rad/s] of gyro readings y [{unit}] and specific force f [m/s^2]: u = M (y - b - G f)",
    }[kind]
    matrix, bias = (canonical.uncertainty(lambda t, part=part: getattr(t[kind], part)) for part in ("matrix", "bias"))  # type: ignore[misc]
    lines = [f" * Standard uncertainties of M: {spread(matrix)}", f" * of b: {spread(bias)}"]
    if kind == "gyro":
        lines.append(f" * of G: {spread(canonical.uncertainty(lambda t: t[kind].g_matrix))}")
    return [f"/* {text}", *lines, " */"]


def _function(triad: Linear, precision: str, suffix: str) -> list[str]:
    gyro = triad.kind == "gyro"
    force = f"const {precision} f[3], " if gyro else ""
    return [
        f"static inline void imu_{triad.kind}{suffix}(const {precision} y[3], {force}{precision} u[3])",
        "{",
        *_constant("M", triad.matrix, precision),
        *_constant("b", triad.bias, precision),
        *(_constant("G", triad.g_matrix, precision) if gyro else []),
        f"    {precision} x[3];",
        "    int i;",
        "    for (i = 0; i < 3; ++i) {",
        "        x[i] = y[i] - b[i]" + (" - (G[i][0] * f[0] + G[i][1] * f[1] + G[i][2] * f[2]);" if gyro else ";"),
        "    }",
        "    for (i = 0; i < 3; ++i) {",
        "        u[i] = M[i][0] * x[0] + M[i][1] * x[1] + M[i][2] * x[2];",
        "    }",
        "}",
    ]


def _constant(name: str, values: Array, precision: str) -> list[str]:
    def text(row: Array) -> str:
        return ", ".join(real(v) if precision == "double" else f"{single(v)}f" for v in row)

    if values.ndim == 1:
        return [f"    static const {precision} {name}[3] = {{{text(values)}}};"]
    rows = [f"        {{{text(row)}}}," for row in values]
    return [f"    static const {precision} {name}[3][3] = {{", *rows, "    };"]
