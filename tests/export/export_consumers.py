"""What the other software makes of a sample, written from its own source and from nothing of ours.

Each function takes the content of a file and readings (n, 3), and gives the corrected samples by sensor. The sources are named in
docs/export.md.
"""

from __future__ import annotations

import io
import json
import re
import subprocess

import numpy as np
from ruamel.yaml import YAML


def px4(content: bytes, y: dict, slot: int = 0) -> dict:
    """QGroundControl's ParameterManager::readParametersFromStream, then calibration::Accelerometer and Gyroscope::Correct."""
    store: dict[str, object] = {}
    for line in content.decode().splitlines():
        if not line.startswith("#"):
            fields = line.split("\t")
            assert len(fields) == 5, line
            vehicle, component, name, value, kind = fields
            assert (vehicle, component) == ("1", "1")
            assert len(name) <= 16  # MAVLink's param_id
            store[name] = {9: np.float32, 6: np.int32}[int(kind)](value)

    def vector(sensor: str, what: str) -> np.ndarray:
        return np.array([store[f"CAL_{sensor}{slot}_{axis}{what}"] for axis in "XYZ"], dtype=float)

    out = {}
    if "accel" in y:
        out["accel"] = (y["accel"] - vector("ACC", "OFF")) * vector("ACC", "SCALE")
    if "gyro" in y:
        out["gyro"] = y["gyro"] - vector("GYRO", "OFF")
    return out


def ardupilot(content: bytes, y: dict, instance: str = "") -> dict:
    """MAVProxy's reading of a .param file (name and value, commas or blanks), then AP_InertialSensor_Backend."""
    store = {}
    for line in content.decode().splitlines():
        if line.strip() and not line.strip().startswith("#"):
            name, value = line.replace(",", " ").split()
            assert len(name) <= 16
            store[name] = np.float32(value)

    def vector(prefix: str) -> np.ndarray:
        return np.array([store[f"{prefix}_{axis}"] for axis in "XYZ"], dtype=float)

    out = {}
    if "accel" in y:
        out["accel"] = (y["accel"] - vector(f"INS_ACC{instance}OFFS")) * vector(f"INS_ACC{instance}SCAL")
    if "gyro" in y:
        out["gyro"] = y["gyro"] - vector(f"INS_GYR{instance}OFFS" if instance else "INS_GYROFFS")
    return out


def imu_calib(content: bytes, y: dict) -> dict:
    """AccelCalib::loadCalib and applyCalib; the gyros pass."""
    node = yaml_1_1(content)
    assert len(node["SM"]) == 9
    assert len(node["bias"]) == 3
    SM = np.zeros((3, 3))
    for i in range(9):
        SM[i // 3, i % 3] = node["SM"][i]
    return {"accel": y["accel"] @ SM.T - np.array(node["bias"]), "gyro": y.get("gyro")}


def imu_tk(files: dict[str, bytes], y: dict) -> dict:
    """CalibratedTriad_::load (21 numbers, then nothing more is read) and unbiasNormalize."""
    out = {}
    for kind, tag in (("accel", "_acc"), ("gyro", "_gyro")):
        if kind in y:
            words = files[tag].decode().split()[:21]
            numbers = [float(word) for word in words]
            T, K, B = np.reshape(numbers[:9], (3, 3)), np.reshape(numbers[9:18], (3, 3)), np.array(numbers[18:])
            assert np.array_equal(K, np.diag(np.diag(K)))
            ms = T @ K
            out[kind] = (y[kind] - B) @ ms.T
    return out


def kalibr_intrinsics(content: bytes, y: dict, biases: dict | None = None) -> dict:
    """IccScaledMisalignedImu's error terms, solved for the body's specific force and rate; its biases come from elsewhere."""
    imu = yaml_1_1(content)["imu0"]
    assert imu["model"] == "scale-misalignment"
    T_i_b = np.array(imu["T_i_b"])
    C_i_b = T_i_b[:3, :3]
    M_accel, M_gyro, A, C_gyro_i = (
        np.array(imu["accelerometers"]["M"]),
        *(np.array(imu["gyroscopes"][key]) for key in ("M", "A", "C_gyro_i")),
    )
    for M in (M_accel, M_gyro):
        assert not np.triu(M, 1).any()
    for C in (C_i_b, C_gyro_i):
        assert np.allclose(C @ C.T, np.eye(3), rtol=0, atol=1e-14)
        assert np.linalg.det(C) > 0
    biases = biases or {"accel": np.zeros(3), "gyro": np.zeros(3)}
    force = np.linalg.solve(M_accel @ C_i_b, (y["accel"] - biases["accel"]).T).T
    C_gyro_b = C_gyro_i @ C_i_b
    rest = y["gyro"] - biases["gyro"] - force @ (A @ C_gyro_b).T
    return {"accel": force, "gyro": np.linalg.solve(M_gyro @ C_gyro_b, rest.T).T}


def kalibr_noise(content: bytes) -> dict:
    """kalibr_common ConfigReader ImuParameters: discrete deviations of one sample, and random walks."""
    data = yaml_1_1(content)
    assert isinstance(data["rostopic"], str)
    assert data["update_rate"] > 0
    out = {}
    for sensor in ("accelerometer", "gyroscope"):
        density, walk = data[f"{sensor}_noise_density"], data[f"{sensor}_random_walk"]
        assert density > 0
        assert walk > 0
        out[sensor] = (density / np.sqrt(1.0 / data["update_rate"]), walk)
    return out


def openvins(content: bytes, y: dict, biases: dict | None = None) -> dict:
    """VioManagerOptions::print_and_load_state (rotations pass through quaternions) and Propagator's correction."""
    imu = opencv_yaml(content)["imu0"]
    for field in ("accelerometer_noise_density", "gyroscope_random_walk", "update_rate"):
        assert imu[field] > 0
    Tw, Ta, Tg, R_IMUtoACC, R_IMUtoGYRO = (
        np.array(imu[key]) for key in ("Tw", "Ta", "Tg", "R_IMUtoACC", "R_IMUtoGYRO")
    )
    Dw, Da = np.linalg.solve(Tw, np.eye(3)), np.linalg.solve(Ta, np.eye(3))
    # the state keeps six numbers of each: what stands in the other half is lost
    keep = {"kalibr": np.tril, "rpng": np.triu}[imu["model"]]
    Dw, Da = keep(Dw), keep(Da)
    for R in (R_IMUtoACC, R_IMUtoGYRO):
        assert np.allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-14)
        assert np.linalg.det(R) > 0
    biases = biases or {"accel": np.zeros(3), "gyro": np.zeros(3)}
    a = (y["accel"] - biases["accel"]) @ (R_IMUtoACC.T @ Da).T
    w = (y["gyro"] - biases["gyro"] - a @ Tg.T) @ (R_IMUtoGYRO.T @ Dw).T
    return {"accel": a, "gyro": w}


def vins(content: bytes) -> dict:
    """readParameters of VINS-Mono: ACC_N, GYR_N, ACC_W, GYR_W, G.z."""
    settings = opencv_yaml(content)
    return {key: float(settings[key]) for key in ("acc_n", "gyr_n", "acc_w", "gyr_w", "g_norm")}


def matlab(content: bytes, y: dict) -> dict:
    """The lines of the documentation, one row a sample."""
    from scipy.io import loadmat

    data = loadmat(io.BytesIO(content), simplify_cells=True)
    out = {}
    if "accel" in y:
        out["accel"] = (y["accel"] - data["accel"]["bias"]) @ data["accel"]["matrix"].T
    if "gyro" in y:
        gyro = data["gyro"]
        out["gyro"] = (y["gyro"] - gyro["bias"] - out["accel"] @ gyro["g_sensitivity"].T) @ gyro["matrix"].T
    return out


def plain_json(content: bytes, y: dict) -> dict:
    data = json.loads(content)
    out = {}
    for kind, raw in y.items():
        own = {key: np.array(value) for key, value in data[kind].items() if isinstance(value, list)}
        x = raw - own["bias"]
        if kind == "gyro":
            x = x - out["accel"] @ own["g_sensitivity"].T
        out[kind] = x @ own["matrix"].T
    return out


_MAIN = """
#include <stdio.h>
#include "correction.h"
int main(void)
{
    REAL y[3], z[3], f[3], w[3];
    double v[6];
    while (scanf("%lf %lf %lf %lf %lf %lf", v, v + 1, v + 2, v + 3, v + 4, v + 5) == 6) {
        int i;
        for (i = 0; i < 3; ++i) { y[i] = (REAL)v[i]; z[i] = (REAL)v[3 + i]; }
        ACCEL(y, f);
        GYRO(z, f, w);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g\\n", (double)f[0], (double)f[1], (double)f[2],
               (double)w[0], (double)w[1], (double)w[2]);
    }
    return 0;
}
"""


def c_program(content: bytes, y: dict, folder, compiler: str, precision: str = "double", language: str = "c") -> dict:
    """Compile the header, strictly, and run it over the samples."""
    (folder / "correction.h").write_bytes(content)
    (folder / "main.c").write_text(_MAIN)
    suffix = {"double": "", "float": "f"}[precision]
    standard = {"c": "-std=c99", "c++": "-std=c++11"}[language]
    names = [f"-DREAL={precision}", f"-DACCEL=imu_accel{suffix}", f"-DGYRO=imu_gyro{suffix}"]
    strict = ["-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-ffp-contract=off"]
    command = [compiler, "-x", language, standard, *strict, *names, "main.c", "-o", "correct"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    lines = "\n".join(" ".join(f"{v:.17g}" for v in row) for row in np.hstack([y["accel"], y["gyro"]]))
    done = subprocess.run(["./correct"], cwd=folder, input=lines, text=True, check=True, capture_output=True)
    result = np.array([[float(v) for v in line.split()] for line in done.stdout.splitlines()])
    return {"accel": result[:, :3], "gyro": result[:, 3:]}


def yaml_1_1(content: bytes):
    """YAML as PyYAML and yaml-cpp read it; a float without a point is an error here, PyYAML takes it for a text."""
    reader = YAML(typ="safe", pure=True)
    reader.version = (1, 1)
    return reader.load(content.decode())


def opencv_yaml(content: bytes):
    """cv::FileStorage: the first line must be its own directive."""
    first, rest = content.decode().split("\n", 1)
    assert re.fullmatch(r"%YAML:1\.0", first)
    return yaml_1_1(rest.encode())
