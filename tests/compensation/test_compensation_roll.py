"""Compensation of a roll-isolated rig: the truth from clean data, the published figures from noisy ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sagnac.calibrate import calibrate
from sagnac.calibration import Calibration, Fit, Site, Software, named
from sagnac.compensation import apply
from sagnac.compensation.roll_isolated import COLUMNS, stream
from sagnac.errors import DataError, InputError
from sagnac.frames import rot_x
from sagnac.recording import from_arrays, open_recording
from sagnac.results import covariance_rows
from sagnac.rigs.roll_isolated import (
    DELAY,
    ECCENTRICITY,
    HALF_ANGLE,
    MOUNT_PITCH,
    MOUNT_YAW,
    PHASE,
    RollRig,
    encoder_reading,
    mount,
)
from sagnac.simulate.roll_isolated import (
    BIAS_STABILITY,
    PARAMETERS,
    PUBLISHED,
    Motion,
    published_check,
    published_plan,
    recording_of,
    simulate,
)

DEG = math.pi / 180
TRUTH = PUBLISHED | {
    DELAY: 1e-3, ECCENTRICITY[0]: 0.1 * DEG, ECCENTRICITY[3]: -0.05 * DEG, "gyro.bias.x": 1e-4, "gyro.bias.z": -2e-4,
    "gyro.scale_error.x": 2e-3, "gyro.scale_error.y": -1e-3,
}  # fmt: skip
CHECK = published_check(hold=5.0)


def calibration_of(truth):
    """A calibration with exactly these parameters."""
    units = {"gyro.bias": "rad/s", "gyro.scale": "1", DELAY: "s"}
    given = [next((u for n, u in units.items() if name.startswith(n)), "rad") for name in PARAMETERS]
    none = np.zeros((len(PARAMETERS),) * 2)
    return Calibration(
        method="roll-isolated",
        parameters=named(PARAMETERS, given, np.array([truth.get(n, 0.0) for n in PARAMETERS]), none),
        covariance=covariance_rows(none),
        fit=Fit(chi2=0.0, degrees_of_freedom=0, residual_rms=1.0, converged=True, iterations=1),
        site=Site(gravity=9.8),
        software=Software(version="0"),
        created="2026-01-01T00:00:00+00:00",
    )


def compensated(calibration, recording):
    """Time, gyro and the further columns of a whole recording."""
    parts = list(stream(calibration, recording))
    out = {name: np.concatenate([v[name] for _, v in parts]) for name in ("gyro", *COLUMNS)}
    return np.concatenate([b.time for b, _ in parts]), out


def clean(plan=CHECK, truth=TRUTH, **options):
    options = {"density": 0.0, "encoder_bits": None, "earth": (0.0, 0.0, 0.0)} | options
    return recording_of(simulate(plan, truth, np.random.default_rng(1), **options))


def amplitude(values, phase):
    """Amplitude of what goes with a phase, beside a slow drift."""
    slow = np.linspace(-1, 1, phase.size)
    basis = np.column_stack([np.cos(phase), np.sin(phase), np.ones(phase.size), slow, slow**2])
    return float(np.hypot(*np.linalg.lstsq(basis, values, rcond=None)[0][:2]))


def test_clean_data_give_the_true_rates_spin_and_attitude():
    """While the carrier spins: roll rate of the swing alone, the spin, and no yaw or pitch.

    The encoder's angle comes from quadratics over 0.1 s, whose ends at the change of spin are left out.
    """
    time, out = compensated(calibration_of(TRUTH), clean())
    motion = Motion.of(CHECK, 2 * DEG, 1.7)
    here = (time > 5.2) & (time < 9.8)
    swung, rate = motion.swing(time)
    spin, turned = motion.spin.at(time)
    gyro, spin_found, yaw, pitch, inner, roll = (out[n][here] for n in ("gyro", *COLUMNS))
    # on the spin axis: w - de/dt, and the cylinder itself rolls at w cos a - de/dt
    extra = spin[here] * (1 - math.cos(TRUTH[HALF_ANGLE]))
    np.testing.assert_allclose(gyro[:, 0], rate[here] + extra, atol=2e-6)
    assert np.abs(gyro[:, 1:]).max() < 2e-5  # of 0.18 rad/s across the axis
    np.testing.assert_allclose(spin_found, spin[here], atol=1e-3)
    assert max(np.abs(np.diff(yaw)).max(), np.abs(np.diff(pitch)).max()) < 1e-7
    assert amplitude(np.degrees(yaw), motion.angle(time[here], RollRig.of(TRUTH))) < 1e-6
    np.testing.assert_allclose(np.unwrap(roll) - np.unwrap(roll)[0], turned[here] - turned[here][0], atol=2e-5)
    # the cylinder's roll is what the rate integrates to
    expected = swung + np.concatenate([[0.0], np.cumsum(np.diff(turned))]) * (1 - math.cos(TRUTH[HALF_ANGLE]))
    np.testing.assert_allclose(inner - inner[0], (expected - expected[here][0])[here], atol=1e-5)


def test_published_case_after_compensation():
    """[ZHANG15] at 3600 deg/s, swing of 2 deg at 1.7 Hz, 14 bit encoder.

    Before: periodic rate of 10 deg/s and, integrated, 0.32 deg peak to peak. After, by the publication: 1.5 deg/s and 0.05
    deg; here less than 0.1 deg/s and 0.01 deg, with the angles as a noisy calibration found them.
    """
    plan, check = published_plan(hold=30.0), published_check()
    rng = np.random.default_rng(2)
    truth = TRUTH | {"gyro.scale_error.y": 5e-3, "gyro.scale_error.z": -8e-3}
    options = {"drift": BIAS_STABILITY}
    cal = calibrate("roll-isolated", recording_of(simulate(plan, truth, rng, **options)), plan)
    recording = recording_of(simulate(check, truth, rng, **options))
    time, out = compensated(cal, recording)
    here = (time >= 5.0) & (time < 65.0)
    rig = RollRig.of(truth)
    spin = Motion.of(check, 2 * DEG, 1.7).angle(time[here], rig)
    lines = {"spin": spin, "twice spin": 2 * spin, "swing": 2 * math.pi * 1.7 * time[here]}
    raw = recording.read().gyro[here]
    for axis in (1, 2):
        assert 10.0 < math.degrees(amplitude(raw[:, axis], spin)) < 10.5
        for line, phase in lines.items():
            assert math.degrees(amplitude(out["gyro"][here, axis], phase)) < 0.1, line
    before = math.degrees(amplitude(np.cumsum(raw[:, 1]) / 1000.0, spin))
    assert 2 * before == pytest.approx(0.33, abs=0.01)
    for angle in ("yaw [rad]", "pitch [rad]"):
        for line, phase in lines.items():
            assert 2 * math.degrees(amplitude(out[angle][here], phase)) < 0.01, line
    assert np.degrees(out["carrier_rate [rad/s]"][here]).mean() == pytest.approx(3600.0, abs=0.05)


def test_attitude_of_a_carrier_that_yaws_and_pitches():
    """The unit on a carrier that also turns across its axis, every angle known: attitudes to 1e-6 rad over 6 s."""
    rig = RollRig(0.05, -0.03, 0.02, 0.7, 2e-3, (0.01, 0.0, -0.004, 0.0))
    time = np.arange(1, 6001) / 1000.0
    start = time[0]

    def angles(t):
        s = t - start
        return 0.2 * np.sin(0.9 * s) ** 2, 0.3 * np.sin(0.7 * s), 20.0 * t, 20.0 * t - 0.1 * np.sin(9.0 * s)

    tilt = Rotation.from_rotvec(rig.half_angle * np.array([0.0, -np.sin(rig.phase), np.cos(rig.phase)]))

    def cylinder(t):
        yaw, pitch, roll, e = angles(t)
        carrier = Rotation.from_euler("YZX", np.stack([yaw, pitch, roll], axis=1))
        return carrier * tilt.inv() * Rotation.from_matrix(rot_x(-e))

    h = 1e-4
    rates = (cylinder(time - h).inv() * cylinder(time + h)).as_rotvec() / (2 * h)
    gyro = rates @ mount(rig.mount_yaw, rig.mount_pitch).T
    encoder = np.mod(encoder_reading(angles(time + rig.delay)[3], rig), 2 * np.pi)
    truth = {
        MOUNT_YAW: 0.05, MOUNT_PITCH: -0.03, HALF_ANGLE: 0.02, PHASE: 0.7, DELAY: 2e-3, ECCENTRICITY[0]: 0.01,
        ECCENTRICITY[2]: -0.004,
    }  # fmt: skip
    _, out = compensated(calibration_of(truth), from_arrays(time, gyro=gyro, rig={"encoder": encoder}))
    yaw, pitch, roll, e = angles(time)
    # its ends: the quadratics reach over 0.05 s there
    np.testing.assert_allclose(out["yaw [rad]"], yaw, atol=2e-5)
    np.testing.assert_allclose(out["pitch [rad]"], pitch, atol=2e-5)
    np.testing.assert_allclose(np.exp(1j * out["carrier_roll [rad]"]), np.exp(1j * roll), atol=2e-4)
    np.testing.assert_allclose(np.exp(1j * out["inner_roll [rad]"]), np.exp(1j * (roll - e)), atol=2e-5)
    body = Rotation.from_euler("YZX", np.stack([yaw, pitch, roll], axis=1))
    w = (body[:-1].inv() * body[1:]).as_rotvec()[100:-100, 0] * 1000.0
    np.testing.assert_allclose(out["carrier_rate [rad/s]"][100:-101], w, atol=2e-3)


def test_pieces_make_no_difference():
    recording = recording_of(simulate(CHECK, TRUTH, np.random.default_rng(1), frequency=200.0))
    whole = compensated(calibration_of(TRUTH), recording)[1]
    for size in (1, 7, 400):
        batches = list(simulate(CHECK, TRUTH, np.random.default_rng(1), frequency=200.0, chunk=size))
        pieces = compensated(calibration_of(TRUTH), replace(recording, _stream=lambda _, b=batches: iter(b)))[1]
        for name, values in whole.items():
            turned = values - pieces[name]
            np.testing.assert_allclose(turned - 2 * np.pi * np.round(turned / 2 / np.pi), 0.0, atol=1e-10, err_msg=name)


def test_gaps_are_stepped_over():
    whole = clean()
    b = whole.read()
    keep = (b.time < 7.0) | (b.time > 7.1)
    cut = from_arrays(b.time[keep], gyro=b.gyro[keep], rig={"encoder": b.rig["encoder"][keep]})
    first, second = (compensated(calibration_of(TRUTH), r)[1] for r in (whole, cut))
    far = (b.time < 6.9) | (b.time > 7.2)
    np.testing.assert_allclose(second["gyro"][far[keep]], first["gyro"][far], atol=1e-9)
    # the rate is taken to change steadily over the gap: 0.1 s of a swing
    assert np.abs(second["inner_roll [rad]"][-1] - first["inner_roll [rad]"][-1]) < 0.02


def test_short_recordings_have_attitudes_too():
    b = clean().read()
    for n in (1, 2, 3, 4, 11):
        at = slice(5500, 5500 + n)
        recording = from_arrays(b.time[at], gyro=b.gyro[at], rig={"encoder": b.rig["encoder"][at]})
        _, out = compensated(calibration_of(TRUTH), recording)
        assert all(np.isfinite(v).all() and len(v) == n for v in out.values())
        assert out["yaw [rad]"][0] == out["pitch [rad]"][0] == out["inner_roll [rad]"][0] == 0.0


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_files(tmp_path, ending):
    rows = apply(calibration_of(TRUTH), clean(), tmp_path / f"out.{ending}")
    back = open_recording(tmp_path / f"out.{ending}")
    assert back.other == COLUMNS
    batch = back.read()
    assert rows == batch.time.size
    np.testing.assert_allclose(
        batch.gyro, compensated(calibration_of(TRUTH), clean())[1]["gyro"], rtol=1e-9, atol=1e-12
    )
    assert "encoder" in batch.rig


def test_what_cannot_be_compensated_is_refused():
    b = clean().read()
    cal = calibration_of(TRUTH)
    with pytest.raises(InputError, match="needs the column 'encoder"):
        compensated(cal, from_arrays(b.time, gyro=b.gyro))
    with pytest.raises(InputError, match="raw counts"):
        compensated(cal, from_arrays(b.time, gyro=b.gyro, rig={"encoder": b.rig["encoder"]}, counts=("gyro",)))
    with pytest.raises(DataError, match=r"encoder turns by \d+ deg from sample to sample"):
        compensated(cal, from_arrays(b.time[::47], gyro=b.gyro[::47], rig={"encoder": b.rig["encoder"][::47]}))
    with pytest.raises(DataError, match="no gyro parameters"):
        compensated(replace_parameters(cal), clean())


def replace_parameters(cal):
    kept = [p for p in cal.parameters if not p.name.startswith("gyro")]
    return cal.model_copy(update={"parameters": tuple(kept)})
