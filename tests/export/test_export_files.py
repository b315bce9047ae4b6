"""What stands in the files: names, units, uncertainties, and what each target is told."""

from __future__ import annotations

import json
import re

import export_consumers as consumers
import numpy as np
import pytest
from export_units import calibration, names

from sagnac.errors import InputError
from sagnac.export import Exported, Options, export
from sagnac.export.noise import parse

UG, DEG = 9.80665e-6, np.pi / 180
NOISE = {"accel_density": 8e-4, "accel_random_walk": 2e-5, "gyro_density": 9e-5, "gyro_random_walk": 1e-6}
GIVEN = Options(noise=NOISE, rate=200.0)
VALUES = {
    name: {"scale_error": 0.02, "misalignment": 0.01, "bias": 0.2, "g_sensitivity": 1e-4}[name.split(".")[1]]
    for kind in ("accel", "gyro")
    for name in names(kind, full=True, counts=False, g=kind == "gyro")
}


def text(cal, target, options=GIVEN) -> str:
    return export(cal, target, options).files[""].decode()


def parameters(content: str) -> dict[str, float]:
    """Name and value of either parameter file."""
    rows = [re.split(r"[\t,]", line) for line in content.splitlines() if not line.startswith("#")]
    return {(r[2] if len(r) == 5 else r[0]): float(r[3] if len(r) == 5 else r[1]) for r in rows}


def test_px4_identifiers_and_slots():
    cal = calibration(VALUES)
    without = parameters(text(cal, "px4"))
    assert sorted(without) == sorted(
        [f"CAL_ACC0_{a}{w}" for a in "XYZ" for w in ("OFF", "SCALE")] + [f"CAL_GYRO0_{a}OFF" for a in "XYZ"]
    )
    options = Options(device_id={"accel": 1310988, "gyro": 1311244}, instance=2)
    with_id = parameters(text(cal, "px4", options))
    assert (with_id["CAL_ACC2_ID"], with_id["CAL_GYRO2_ID"]) == (1310988, 1311244)
    assert any("CAL_ACC0_ID and CAL_GYRO0_ID not in the file" in r for r in export(cal, "px4").remarks)
    assert not any("_ID" in r for r in export(cal, "px4", options).remarks)
    with pytest.raises(InputError, match="slots 0 to 3"):
        export(cal, "px4", Options(instance=4))


def test_px4_takes_no_reversed_axis():
    values = {f"accel.scale_error.{a}": -2.0 for a in "xyz"}
    with pytest.raises(InputError, match="positive scales"):
        export(calibration(values), "px4")


def test_px4_small_offsets_get_a_word():
    """Accelerometer.cpp at 9abd968e: set_offset leaves a change of less than 0.01 out."""
    small = calibration({f"gyro.bias.{a}": 1e-3 for a in "xyz"})
    assert any("gyro offsets change less than 0.01" in remark for remark in export(small, "px4").remarks)
    large = calibration({f"gyro.bias.{a}": 0.1 for a in "xyz"})
    assert not any("change less" in remark for remark in export(large, "px4").remarks)


def test_ardupilot_instances_and_temperature():
    cal = calibration(VALUES)
    first = parameters(text(cal, "ardupilot", Options(temperature=298.15)))
    second = parameters(text(cal, "ardupilot", Options(temperature=298.15, instance=2)))
    axes = [f"_{a}" for a in "XYZ"]
    assert sorted(first) == sorted(
        [f"INS_{w}{a}" for w in ("ACCOFFS", "ACCSCAL", "GYROFFS") for a in axes]
        + ["INS_ACC1_CALTEMP", "INS_GYR1_CALTEMP"]
    )
    assert sorted(second) == sorted(
        [f"INS_{w}{a}" for w in ("ACC2OFFS", "ACC2SCAL", "GYR2OFFS") for a in axes]
        + ["INS_ACC2_CALTEMP", "INS_GYR2_CALTEMP"]
    )
    assert first["INS_GYR1_CALTEMP"] == 25.0
    for number in (4, 5):  # names of AP_InertialSensor_Params.cpp
        found = parameters(text(cal, "ardupilot", Options(temperature=298.15, instance=number)))
        parts = [f"{w}{a}" for w in ("ACCOFFS", "ACCSCAL", "GYROFFS") for a in axes]
        assert sorted(found) == sorted([f"INS{number}_{p}" for p in (*parts, "ACC_CALTEMP", "GYR_CALTEMP")])
        assert list(found.values()) == list(first.values())
    for number in (0, 6):
        with pytest.raises(InputError, match="instances 1 to 5"):
            export(cal, "ardupilot", Options(instance=number))


def of_log(name, *chosen, more=()):
    """A calibration from these choices of logs of this format."""
    source = [{"file": f"{k}", "format": name, "select": which} for k, which in enumerate(chosen)]
    return calibration(VALUES, source=[*source, *more])


LOGS = [
    ("ardupilot", "ArduPilot DataFlash", "RAW/1", "INS_ACC2OFFS_X", 2, "INS_ACCOFFS_X", 1),
    ("ardupilot", "ArduPilot DataFlash", "IMU/4", "INS5_ACCOFFS_X", 5, "INS_ACC3OFFS_X", 3),
    ("px4", "PX4 ULog", "2", "CAL_ACC2_XOFF", 2, "CAL_ACC1_XOFF", 1),
    ("px4", "PX4 ULog", "FIFO/1", "CAL_ACC1_XOFF", 1, "CAL_ACC0_XOFF", 0),
]


@pytest.mark.parametrize(("target", "log", "chosen", "own", "number", "other", "differing"), LOGS)
def test_the_sensor_that_the_calibration_is_of_is_written(target, log, chosen, own, number, other, differing):
    cal = of_log(log, chosen, more=[{"file": "plan.toml", "role": "plan"}])
    instance = chosen[-1]
    assert own in parameters(text(cal, target, Options()))
    (told,) = [r for r in export(cal, target).remarks if "instance" in r]
    assert told == f"the calibration is of instance {instance} of the log: written are {own}, ... (--instance {number})"
    assert own in parameters(text(cal, target, Options(instance=number)))
    assert not any("instance" in r for r in export(cal, target, Options(instance=number)).remarks)
    done = export(cal, target, Options(instance=differing))
    assert other in parameters(done.files[""].decode())
    assert f"# {done.remarks[0]}" in done.files[""].decode().splitlines()
    assert any(
        r.startswith(f"the calibration is of instance {instance} of the log, --instance {number}, and")
        and r.endswith(f"--instance {differing} asks for another: {other}, ...")
        for r in done.remarks
    )


@pytest.mark.parametrize(("target", "log", "first"), [("px4", "PX4 ULog", "CAL_ACC0_XOFF"), LOGS[0][:2] + LOGS[0][5:6]])
def test_a_sensor_that_is_not_known_is_said(target, log, first):
    """Other formats, several recordings of different sensors, choices that are no number."""
    others = [
        calibration(VALUES),
        of_log("CSV", None),
        of_log("ROS 1 bag", "/imu/1"),
        of_log({"px4": "ArduPilot DataFlash", "ardupilot": "PX4 ULog"}[target], "1"),
        of_log(log, "1", "0"),
        of_log(log, None),
        of_log(log, "RAW/²"),
        of_log(log, "1" * 5000),
    ]
    for cal in others:
        assert first in parameters(text(cal, target, Options()))
        assert any(f"written are {first}, ..., of the first; --instance" in r for r in export(cal, target).remarks)
        assert not any("does not tell" in r for r in export(cal, target, Options(instance=1)).remarks)
    assert not any("does not tell" in r for r in export(of_log(log, "1", "1"), target).remarks)


def test_a_calibration_of_gyros_names_their_parameters():
    cal = calibration({f"gyro.bias.{a}": 0.1 for a in "xyz"})
    assert any("INS_GYROFFS_X, ..." in r for r in export(cal, "ardupilot").remarks)
    assert any("CAL_GYRO0_XOFF, ..." in r for r in export(cal, "px4").remarks)


def test_px4_changes_its_offsets_by_itself():
    """VehicleIMU.cpp and GyroCalibration.cpp, on by default."""
    (told,) = [r for r in export(calibration(VALUES), "px4").remarks if "SENS_IMU_AUTOCAL" in r]
    assert told.endswith("unless SENS_IMU_AUTOCAL is 0, and those of the gyros at rest unless IMU_GYRO_CAL_EN is 0")
    accel = calibration({f"accel.bias.{a}": 0.1 for a in "xyz"})
    assert not any("IMU_GYRO_CAL_EN" in r for r in export(accel, "px4").remarks)


def test_ardupilot_temperature_of_the_recording():
    cal = calibration(VALUES, environment={"temperature": {"mean": 310.15, "minimum": 309.0, "maximum": 311.0}})
    assert parameters(text(cal, "ardupilot"))["INS_ACC1_CALTEMP"] == 37.0
    assert not any("CALTEMP" in remark for remark in export(cal, "ardupilot").remarks)
    assert any("--temperature" in remark for remark in export(calibration(VALUES), "ardupilot").remarks)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"accel.scale_error.x": 0.3}, "0.8 to 1.2"),
        ({"accel.scale_error.x": -2.0}, "0.8 to 1.2"),
        ({"accel.bias.y": 11.0}, "up to 9.80665"),
    ],
)
def test_ardupilot_limits(values, words):
    """AccelCalibrator::accept_result."""
    start = {f"accel.{t}.{a}": 0.0 for t in ("scale_error", "bias") for a in "xyz"}
    with pytest.raises(InputError, match=words):
        export(calibration(start | values), "ardupilot")


def test_ardupilot_says_what_its_firmware_will_do():
    start = {f"accel.{t}.{a}": 0.0 for t in ("scale_error", "bias") for a in "xyz"}
    assert any("refuses to arm" in r for r in export(calibration(start), "ardupilot").remarks)
    assert any("3.5" in r for r in export(calibration(start | {"accel.bias.x": 4.0}), "ardupilot").remarks)
    assert any("INS_GYR_CAL" in r for r in export(calibration(VALUES), "ardupilot").remarks)


def test_kalibr_noise():
    """80 ug/sqrt(Hz) at 200 Hz is 11.1 mm/s^2 a sample: 80e-6 * 9.80665 * sqrt(200)."""
    options = Options(
        noise=parse(
            {
                "accel_density": "80 ug/sqrt(Hz)",
                "accel_random_walk": "2e-5 m/s^3/sqrt(Hz)",
                "gyro_density": "0.3 deg/sqrt(h)",
                "gyro_random_walk": "3 deg/h/sqrt(h)",
            }
        ),
        rate=200.0,
        topic="/cam/imu",
    )
    found = consumers.kalibr_noise(text(calibration(VALUES), "kalibr", options).encode())
    assert found["accelerometer"] == (pytest.approx(80 * UG * np.sqrt(200), rel=1e-12), 2e-5)
    assert found["gyroscope"][0] == pytest.approx(0.3 * DEG / 60 * np.sqrt(200), rel=1e-12)
    assert found["gyroscope"][1] == pytest.approx(3 * DEG / 3600 / 60, rel=1e-12)
    assert "rostopic: /cam/imu" in text(calibration(VALUES), "kalibr", options)


def test_noise_of_the_calibration_counts_unless_given():
    noise = {
        "accel": {"density": [1e-3, 3e-3, 2e-3], "unit": "m/s^2/sqrt(Hz)", "origin": "plan"},
        "gyro": {"density": [1e-4, 1e-4, 1e-4], "unit": "rad/s/sqrt(Hz)", "origin": "recording"},
    }
    values = {f"{k}.bias.{a}": 0.1 for k in ("accel", "gyro") for a in "xyz"}
    cal = calibration(values, noise=noise)
    walks = {name: value for name, value in NOISE.items() if name.endswith("walk")}
    found = consumers.kalibr_noise(text(cal, "kalibr", Options(noise=walks, rate=1.0)).encode())
    assert found["accelerometer"][0] == pytest.approx(3e-3, rel=1e-14)  # the noisiest axis
    given = consumers.kalibr_noise(
        text(cal, "kalibr", Options(noise=walks | {"accel_density": 5e-3}, rate=1.0)).encode()
    )
    assert given["accelerometer"][0] == 5e-3


def test_random_walks_of_a_noise_test_need_not_be_given():
    triple = {"density": [1e-3, 3e-3, 2e-3], "origin": "noise test"}
    noise = {
        "accel": triple | {"unit": "m/s^2/sqrt(Hz)", "walk": [1e-5, 0.0, 2e-5]},  # one axis showed none
        "gyro": triple | {"unit": "rad/s/sqrt(Hz)", "walk": [3e-7, 3e-7, 1e-7], "instability": [1e-5, 1e-5, 0.0]},
    }
    cal = calibration({f"{k}.bias.{a}": 0.1 for k in ("accel", "gyro") for a in "xyz"}, noise=noise)
    found = consumers.kalibr_noise(text(cal, "kalibr", Options(rate=100.0)).encode())
    assert found["accelerometer"] == pytest.approx((3e-3 * 10, 2e-5), rel=1e-12)
    assert found["gyroscope"][1] == pytest.approx(3e-7, rel=1e-12)
    none = {k: {key: v for key, v in level.items() if key != "walk"} for k, level in noise.items()}
    with pytest.raises(InputError, match=r"accel_random_walk, gyro_random_walk. `sagnac noise --into` finds"):
        export(
            calibration({f"{k}.bias.{a}": 0.1 for k in none for a in "xyz"}, noise=none), "kalibr", Options(rate=1.0)
        )


@pytest.mark.parametrize("target", ["kalibr", "openvins", "vins"])
def test_a_walk_that_a_noise_test_did_not_see_is_offered_with_a_number(target):
    triple = {"density": [1e-3, 1e-3, 1e-3], "origin": "noise test", "walk": [0.0, 0.0, 0.0]}
    noise = {
        "accel": triple | {"unit": "m/s^2/sqrt(Hz)", "walk_limit": [1e-5, 3e-5, 2e-5]},
        "gyro": triple | {"unit": "rad/s/sqrt(Hz)", "instability": [2e-5, 1e-5, 0.0]},
    }
    cal = calibration({f"{k}.bias.{a}": 0.1 for k in ("accel", "gyro") for a in "xyz"}, noise=noise)
    with pytest.raises(InputError) as refused:
        export(cal, target, Options(rate=100.0))
    said = str(refused.value)
    assert "--noise accel_random_walk='3e-05 m/s^3/sqrt(Hz)'" in said  # the limit of the worst axis
    assert "--noise gyro_random_walk='3.06e-07 rad/s^2/sqrt(Hz)'" in said  # sqrt(3) (0.6643 2e-5)^2 / 1e-3
    assert "its noise test saw none, it stays below that" in said
    assert "`sagnac noise --into`" not in said  # that was done
    walks = parse(dict(re.findall(r"--noise (\w+)='([^']+)'", said)))
    export(cal, target, Options(rate=100.0, noise=walks))


@pytest.mark.parametrize("target", ["kalibr", "openvins", "vins"])
def test_rate_is_needed(target):
    with pytest.raises(InputError, match="--rate"):
        export(calibration(VALUES), target, Options(noise=NOISE))


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        ({"gyro": "1 deg/h"}, "there are accel_density"),
        ({"gyro_density": "1 deg/h"}, "not in rad/s/sqrt"),
        ({"gyro_density": "-1 rad/s/sqrt(Hz)"}, "more than zero"),
        ({"gyro_density": "much"}, "cannot read"),
    ],
)
def test_noise_that_is_none(noise, words):
    with pytest.raises(InputError, match=words):
        parse(noise)


def test_vins_numbers_give_back_the_densities():
    """integration_base.h: the variance of a bias grows by (W dt)^2 a step, and must grow by walk^2 a second."""
    cal = calibration(VALUES, site={"gravity": 9.8123, "gravity_source": "measured\nhere"})
    found = consumers.vins(export(cal, "vins", GIVEN).files[""])
    dt = 1 / 200
    assert (found["gyr_w"] * dt) ** 2 / dt == pytest.approx(NOISE["gyro_random_walk"] ** 2, rel=1e-12)
    assert (found["acc_w"] * dt) ** 2 / dt == pytest.approx(NOISE["accel_random_walk"] ** 2, rel=1e-12)
    assert found["acc_n"] ** 2 * dt == pytest.approx(NOISE["accel_density"] ** 2, rel=1e-12)
    assert found["gyr_n"] ** 2 * dt == pytest.approx(NOISE["gyro_density"] ** 2, rel=1e-12)
    assert found["g_norm"] == 9.8123


@pytest.mark.parametrize("target", ["kalibr-intrinsics", "openvins", "openvins-rpng"])
def test_rotations_need_a_right_handed_frame(target):
    values = VALUES | {"accel.scale_error.x": -2.0}
    with pytest.raises(InputError, match="left-handed"):
        export(calibration(values), target, GIVEN)
    with pytest.raises(InputError, match="one of them"):
        export(calibration({f"gyro.bias.{a}": 0.1 for a in "xyz"}), target, GIVEN)


def test_a_triangular_unit_stays_in_its_frame():
    """Kalibr's frame and OpenVINS' are then the calibration's: no rotation, exactly."""
    values = {name: value for name, value in VALUES.items() if name[-2:] not in ("xy", "xz", "yz")}
    for target, fields in (("kalibr-intrinsics", ("T_i_b",)), ("openvins", ("R_IMUtoACC", "R_IMUtoGYRO"))):
        done = export(calibration(values), target, GIVEN)
        read = consumers.opencv_yaml if target == "openvins" else consumers.yaml_1_1
        imu = read(done.files[""])["imu0"]
        for field in fields:
            assert np.array_equal(imu[field], np.eye(len(imu[field])))
        assert not any("arcsec" in remark for remark in done.remarks)
    turned = export(calibration(VALUES), "kalibr-intrinsics", GIVEN)
    assert any("arcsec" in remark and "T_i_b" in remark for remark in turned.remarks)


def test_kalibr_intrinsics_without_noise():
    done = export(calibration(VALUES), "kalibr-intrinsics")
    imu = consumers.yaml_1_1(done.files[""])["imu0"]
    assert "update_rate" not in imu
    assert not any("noise" in key for key in imu)
    assert any("--noise and --rate" in remark for remark in done.remarks)


def test_standard_uncertainties_stand_beside_the_numbers():
    """PX4's offset is the bias: its uncertainty is that of the calibration; the gain of a unit without cross terms is 1/S."""
    values = {f"accel.{t}.{a}": v for t, v in (("scale_error", 0.25), ("bias", 0.1)) for a in "xyz"}
    cal = calibration(values, sigma=[1e-3] * 3 + [2e-5] * 3)
    content = text(cal, "px4")
    assert "# CAL_ACC0_XOFF: standard uncertainty 2.0e-05 m/s^2" in content
    assert "# CAL_ACC0_ZSCALE: standard uncertainty 6.4e-04 1" in content  # 1e-3 / 1.25^2
    for target in ("ardupilot", "ros", "kalibr-intrinsics", "imu_tk", "openvins", "c"):
        full = calibration(VALUES, sigma=1e-6)
        for part in export(full, target, GIVEN).files.values():
            assert b"tandard uncertaint" in part


def test_matlab_and_json_carry_the_covariance():
    cal = calibration(VALUES, sigma=1e-6)
    data = json.loads(export(cal, "json").files[""])
    n = len(data["entries"])
    assert np.shape(data["covariance"]) == (n, n)
    sigma = {e["name"]: e["standard_uncertainty"] for e in data["entries"]}
    assert sigma["gyro.bias.x"] == pytest.approx(1e-6, rel=1e-12)
    import io

    from scipy.io import loadmat, whosmat

    content = export(cal, "matlab").files[""]
    mat = loadmat(io.BytesIO(content), simplify_cells=True)
    assert np.array_equal(mat["covariance"], data["covariance"])
    assert list(mat["names"]) == [e["name"] for e in data["entries"]]
    assert np.array_equal(mat["values"], [e["value"] for e in data["entries"]])
    assert {"accel", "gyro", "names", "units"} <= {name for name, _, _ in whosmat(io.BytesIO(content))}
    assert any("f * gyro.g_sensitivity" in line for line in mat["about"])
    assert loadmat(io.BytesIO(content))["gyro"]["bias"][0, 0].shape == (1, 3)  # a row: it is taken from rows of samples


@pytest.mark.parametrize("target", ["px4", "ardupilot", "ros", "imu_tk", "openvins", "c", "vins", "kalibr"])
def test_names_of_a_unit_cannot_leave_their_comment(target):
    unit = {"model": "Gyro*/ int x;\n1\t1\tCAL_ACC0_XOFF\t5\t9", "serial": "№ 5\r\nINS_ACCOFFS_X,7"}
    cal = calibration(VALUES, unit=unit)
    for content in export(cal, target, GIVEN).files.values():
        lines = content.decode("ascii").splitlines()
        (named,) = [line for line in lines if "Gyro" in line]
        assert named.startswith(("# ", " * "))
        assert "*/" not in named
        assert sum("INS_ACCOFFS_X,7" in line for line in lines) == 1


def test_topics():
    with pytest.raises(InputError, match="topic"):
        export(calibration(VALUES), "kalibr", Options(noise=NOISE, rate=1.0, topic="/imu: 3"))


def test_two_files_get_two_names(tmp_path):
    done = export(calibration(VALUES), "imu_tk")
    assert [p.name for p in done.save(tmp_path / "unit.calib")] == ["unit_acc.calib", "unit_gyro.calib"]
    assert (tmp_path / "unit_acc.calib").read_bytes() == done.files["_acc"]
    one = Exported({"": b"x"}, ())
    assert one.save(tmp_path / "new" / "a.h") == (tmp_path / "new" / "a.h",)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["new", "unit_acc.calib", "unit_gyro.calib"]
    assert "holds the whole calibration" in one.summary()


def test_summary_starts_with_what_matters_most():
    done = export(calibration(VALUES), "px4")
    sizes = [d.size for d in done.dropped if d.sensor == "gyro"]
    assert sizes == sorted(sizes, reverse=True)
    assert done.to_dict()["dropped"][0]["unit"] == "m/s^2"
    assert done.to_dict()["at"] == {"specific_force": 9.80665, "angular_rate": pytest.approx(100 * DEG)}
