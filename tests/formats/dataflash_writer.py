"""DataFlash logs from ArduPilot's LogStructure.h, and the arithmetic by which ArduPilot corrects samples before it logs them."""

from __future__ import annotations

import struct

import numpy as np

HEAD = b"\xa3\x95"
_PACK = {"B": "B", "I": "I", "Q": "Q", "f": "f", "H": "H", "N": "16s", "i": "i"}
MESSAGES = {
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default"),
    "IMU": (70, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "ACC": (71, "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"),
    "GYR": (72, "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"),
    "ATT": (73, "Qffff", "TimeUS,Roll,Pitch,Yaw,Err"),
    "DSF": (74, "QIHIIII", "TimeUS,Dp,Blk,Bytes,FMn,FMx,FAv"),
}
OLD = {  # before 2021: a message for each instance
    "PARM": (64, "QNf", "TimeUS,Name,Value"),
    "IMU": (70, "QffffffIIf", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,ErrG,ErrA,Temp"),
    "IMU2": (75, "QffffffIIf", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,ErrG,ErrA,Temp"),
}
PARAMETERS = {
    "AHRS_ORIENTATION": 0.0,
    "INS_ACCOFFS_X": 0.125,
    "INS_ACCOFFS_Y": -0.25,
    "INS_ACCOFFS_Z": 0.5,
    "INS_ACCSCAL_X": 1.01,
    "INS_ACCSCAL_Y": 0.995,
    "INS_ACCSCAL_Z": 1.002,
    "INS_GYROFFS_X": 0.01,
    "INS_GYROFFS_Y": -0.02,
    "INS_GYROFFS_Z": 0.03,
    "INS_ACCEL_FILTER": 20.0,
    "INS_GYRO_FILTER": 40.0,
    "INS_TCAL1_ENABLE": 0.0,
}
THERMAL = {
    "INS_TCAL1_ENABLE": 1.0,
    "INS_TCAL1_TMIN": 10.0,
    "INS_TCAL1_TMAX": 60.0,
    "INS_ACC1_CALTEMP": 28.0,
    "INS_GYR1_CALTEMP": 31.0,
    **{
        f"INS_TCAL1_{s}{k}_{a}": float(np.float32((1 + i + 3 * k) * (-1) ** i * scale / 10.0**k))
        for s, scale in (("ACC", 3e4), ("GYR", 2e3))
        for k in (1, 2, 3)
        for i, a in enumerate("XYZ")
    },
}


def definition(name, kind, form, labels, length=None):
    length = 3 + struct.calcsize("<" + "".join(_PACK[c] for c in form)) if length is None else length
    content = struct.pack("<BB4s16s64s", kind, length, name.encode(), form.encode(), labels.encode())
    return HEAD + b"\x80" + content


def definitions(messages=None):
    own = HEAD + b"\x80" + struct.pack("<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    return own + b"".join(definition(name, *spec) for name, spec in (messages or MESSAGES).items())


def message(name, *values, messages=None):
    kind, form, _ = (messages or MESSAGES)[name]
    return HEAD + bytes([kind]) + struct.pack("<" + "".join(_PACK[c] for c in form), *values)


def parameter(name, value, time=0, messages=None):
    more = (value,) if messages is None else ()
    return message("PARM", time, name.encode(), value, *more, messages=messages)


def imu(time, gyro, accel, temperature=30.0, instance=0):
    return message("IMU", time, instance, *gyro, *accel, 1, 2, temperature, 1, 1, 1000, 1000)


def log(times, gyro, accel, temperature=30.0, *, parameters=None, instances=(0,)):
    """A log of IMU messages as they are to be logged, with what ArduPilot writes before and between them."""
    out = [definitions(), *(parameter(n, v) for n, v in (PARAMETERS if parameters is None else parameters).items())]
    warm = np.broadcast_to(temperature, np.shape(times))
    for k, time in enumerate(times):
        out += [imu(int(time), gyro[k], accel[k], warm[k], i) for i in instances]
        if k % 5 == 2:
            out.append(message("ATT", int(time), 0.1, 0.2, 0.3, 0.0))
    return b"".join(out)


def corrected(kind, raw, temperature, p):
    """What ArduPilot makes of a raw sample: AP_InertialSensor_Backend.cpp, one number after the other, in single precision."""
    f = np.float32
    part, offset = {"accel": ("ACC", "INS_ACCOFFS_"), "gyro": ("GYR", "INS_GYROFFS_")}[kind]
    v = [f(x) for x in raw]
    for i, axis in enumerate("XYZ"):
        if p.get("INS_TCAL1_ENABLE") == 1.0:
            c = [f(p[f"INS_TCAL1_{part}{k}_{axis}"]) for k in (1, 2, 3)]
            low, high = f(p["INS_TCAL1_TMIN"]), f(p["INS_TCAL1_TMAX"])

            def polynomial(t, c=c, low=low, high=high):
                t = min(max(f(t), low), high) - f(35.0)
                return (c[0] + (c[1] + c[2] * t) * t) * t * f(1e-6)

            v[i] -= polynomial(temperature)
            v[i] += polynomial(p[f"INS_{part}1_CALTEMP"])
        v[i] -= f(p[offset + axis])
        if kind == "accel":
            v[i] *= f(p[f"INS_ACCSCAL_{axis}"])
    return np.array(rotated(int(p["AHRS_ORIENTATION"]), *v), dtype=np.float32)


def rotated(orientation, x, y, z):
    """Vector3::rotate, AP_Math/vector3.cpp, for some of its cases."""
    half = np.float32(0.70710678118654757)
    cases = {
        0: lambda: (x, y, z),
        1: lambda: (half * (x - y), half * (x + y), z),
        2: lambda: (-y, x, z),
        3: lambda: (-half * (x + y), half * (x - y), z),
        4: lambda: (-x, -y, z),
        6: lambda: (y, -x, z),
        8: lambda: (x, -y, -z),
        9: lambda: (half * (x + y), half * (x - y), -z),
        10: lambda: (y, x, -z),
        12: lambda: (-x, y, -z),
        14: lambda: (-y, -x, -z),
        15: lambda: (half * (x - y), -half * (x + y), -z),
        16: lambda: (x, -z, y),
        18: lambda: (z, x, y),
        20: lambda: (x, z, -y),
        24: lambda: (z, y, -x),
        25: lambda: (-z, y, x),
        26: lambda: (-y, -x, -z),
        28: lambda: (y, -z, -x),
        33: lambda: (-y, -z, x),
        36: lambda: (z, -x, -y),
        37: lambda: (-z, -x, y),
        38: lambda: (
            0.143039 * x + 0.368776 * y - 0.918446 * z,
            -0.332133 * x - 0.856289 * y - 0.395546 * z,
            -0.932324 * x + 0.361625 * y,
        ),
        39: lambda: (half * (x - z), y, half * (x + z)),
    }
    return cases[orientation]()
