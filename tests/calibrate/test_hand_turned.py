"""Units turned by hand: simulated logs with known truth, and a public recording where it is at hand."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from sagnac.calibrate import hand_turned, norm
from sagnac.calibrate.hand_gyros import _motion, _Rows
from sagnac.errors import DataError
from sagnac.observe.static import static_intervals
from sagnac.plan import Plan
from sagnac.recording import from_arrays, open_recording
from sagnac.sensors import Correction, Triad, correction
from sagnac.simulate.hand import simulate_hand_turned

SITE = Plan(gravity=9.80665)
# about the Xsens MTi of the public recording, in counts
S_A = np.array([[414.5, 0, 0], [1.5, 412.1, 0], [3.7, 8.8, 414.5]])
S_G = np.array([[4781.0, -42, -53], [-25, 4766, 150], [-75, 108, 4768]])
G = np.array([[0.1, 0.3, 0.64], [-1.3, 0.05, 0.83], [-0.7, -0.8, 0.25]])
ACCEL = Correction("accel", S_A, np.array([33124.0, 33275, 32364]), counts=True)
GYRO = Correction("gyro", S_G, np.array([32770.0, 32451, 32509]), G, counts=True)


def truth():
    accel, gyro = Triad("accel", counts=True), Triad("gyro", counts=True, full=True, g_sensitivity=True)
    out = dict(zip(accel.names, accel.pack(ACCEL.matrix, ACCEL.bias), strict=True))
    return out | dict(zip(gyro.names, gyro.pack(GYRO.matrix, GYRO.bias, G), strict=True))


def calibrated(time, accel, gyro, site=SITE, counts=("accel", "gyro")):
    return hand_turned.calibrate(from_arrays(time, accel, gyro, counts=counts), site)


@pytest.fixture(scope="module")
def log():
    return simulate_hand_turned(ACCEL, GYRO, np.random.default_rng(3), accel_noise=3.0, gyro_noise=23.0)


@pytest.fixture(scope="module")
def answer(log):
    return calibrated(*log)


def test_clean_log_gives_the_truth():
    """No noise: what is left is the trapezoid's error of 100 Hz integration, O(dt^2): 1e-4 of a turn at these rates."""
    found = calibrated(*simulate_hand_turned(ACCEL, GYRO, np.random.default_rng(1), shake=0.0))
    for name, value in truth().items():
        scale = abs(value) if "scale" in name or "bias" in name else 1.0
        limit = {"accel": 1e-9, "gyro": 2e-4}[name.split(".")[0]]
        assert abs(found[name].value - value) < limit * max(scale, 1.0), name


def test_noisy_log_agrees_within_its_uncertainty(answer):
    z = [(answer[n].value - v) / answer[n].standard_uncertainty for n, v in truth().items()]
    assert np.max(np.abs(z)) < 3.7  # 30 values: beyond by chance in 0.6 % of such tests
    assert answer.fit.residuals["rotation"].count == 23


@pytest.mark.statistical
def test_stated_uncertainty_is_true():
    """60 logs, 30 parameters: normalised errors have the right size for each sensor, and 95 % intervals hold overall."""
    z = []
    for seed in range(60):
        log = simulate_hand_turned(ACCEL, GYRO, np.random.default_rng(seed), accel_noise=3.0, gyro_noise=23.0)
        found = calibrated(*log)
        z.append([(found[n].value - v) / found[n].standard_uncertainty for n, v in truth().items()])
    z = np.array(z)
    assert 0.85 < np.sqrt(np.mean(z[:, :9] ** 2)) < 1.15  # 540 values, correlated within a run: 3 sigma is about 0.12
    assert 0.85 < np.sqrt(np.mean(z[:, 9:] ** 2)) < 1.15
    assert 0.93 < np.mean(np.abs(z) < 1.96) < 0.97


def frame_free(found):
    """Gains of the input axes and angles between them: what does not depend on the frame."""
    out = []
    for kind in ("accel", "gyro"):
        matrix = correction(found.values(), kind).matrix
        rows = matrix / np.linalg.norm(matrix, axis=1)[:, None]
        out.append((np.linalg.norm(matrix, axis=1), rows @ rows.T))
    return out


@pytest.mark.parametrize("offset", [0.0, 1e3, -1e6])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_scale_and_offset_of_raw_data_do_not_matter(log, answer, scale, offset):
    """Raw data times 1e-3 to 1e6, offset by up to 1e6 gains: the same answer; 1e6 gains leave 1e-16 * 1e6 of the data."""
    time, accel, gyro = log
    shift_a, shift_g = offset * 414.0 * scale, offset * 4780.0 * scale
    found = calibrated(time, accel * scale + shift_a, gyro * scale + shift_g)
    for kind, shift in (("accel", shift_a), ("gyro", shift_g)):
        ours, ref = correction(found.values(), kind), correction(answer.values(), kind)
        assert np.allclose(ours.matrix / scale, ref.matrix, rtol=1e-6, atol=1e-6 * ref.matrix.max())
        assert np.allclose((ours.bias - shift) / scale, ref.bias, rtol=0, atol=1e-6 * ref.matrix.max() * 10)
    assert found.fit.residuals["rotation"].rms == pytest.approx(answer.fit.residuals["rotation"].rms, rel=1e-5)


@pytest.mark.parametrize("signs", list(itertools.product((1, -1), repeat=3)))
def test_mirrored_gyros(log, answer, signs):
    """One or three reversed gyros keep their answer with a negative gain; two look like one accelerometer: refused."""
    time, accel, gyro = log
    if sum(s < 0 for s in signs) == 2:
        with pytest.raises(DataError, match="wrong sense of rotation: either accel_. reads minus"):
            calibrated(time, accel, gyro * signs)
        return
    found = calibrated(time, accel, gyro * signs)
    ref, ours = correction(answer.values(), "gyro"), correction(found.values(), "gyro")
    assert np.allclose(ours.matrix, np.array(signs)[:, None] * ref.matrix, rtol=1e-7, atol=1e-3)
    assert np.allclose(ours.bias, signs * ref.bias, atol=1e-5)
    assert any("wrong sense of rotation" in r for r in found.remarks) == (min(signs) < 0)


@pytest.mark.parametrize("signs", list(itertools.product((1, -1), repeat=3))[1:-1])
def test_mirrored_accelerometers_are_refused(log, signs):
    time, accel, gyro = log
    with pytest.raises(DataError, match="wrong sense of rotation"):
        calibrated(time, accel * signs, gyro)


def test_common_sign_of_the_accelerometers_is_said_to_be_assumed(answer):
    assert any("all accelerometer gains are taken as positive" in r for r in answer.remarks)


@pytest.mark.parametrize("order", list(itertools.permutations(range(3)))[1:])
def test_permuted_columns_of_one_sensor_are_named(log, order):
    time, accel, gyro = log
    with pytest.raises(DataError, match=r"gyro_. answers to rotation about"):
        calibrated(time, accel, gyro[:, order])
    with pytest.raises(DataError, match=r"gyro_. answers to rotation about"):
        calibrated(time, accel[:, order], gyro)


@pytest.mark.parametrize("order", list(itertools.permutations(range(3)))[1:])
def test_columns_permuted_alike_are_the_same_instrument(log, answer, order):
    """Cyclic: the same gains and angles. A swap makes the axes left-handed, which is said."""
    time, accel, gyro = log
    found = calibrated(time, accel[:, order], gyro[:, order])
    p = list(order)
    for (gains, angles), (ref_gains, ref_angles) in zip(frame_free(found), frame_free(answer), strict=True):
        assert np.allclose(gains, ref_gains[p], rtol=1e-7)
        assert np.allclose(angles, ref_angles[np.ix_(p, p)], atol=1e-7)
    left_handed = np.linalg.det(np.eye(3)[p]) < 0
    assert any("two swapped columns" in r for r in found.remarks) == left_handed


def test_si_readings_with_a_wrong_sign_are_refused():
    unity = [Correction(kind, np.eye(3), np.zeros(3)) for kind in ("accel", "gyro")]
    time, accel, gyro = simulate_hand_turned(*unity, np.random.default_rng(2), accel_noise=0.01, gyro_noise=0.001)
    good = calibrated(time, accel, gyro, counts=())
    assert abs(good["accel.scale_error.x"].value) < 4 * good["accel.scale_error.x"].standard_uncertainty
    with pytest.raises(DataError, match="all three gyros"):
        calibrated(time, accel, -gyro, counts=())
    with pytest.raises(DataError, match="labelled rad/s"):
        calibrated(time, accel, np.degrees(gyro), counts=())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda a, g: (a, np.where(np.arange(3) == 1, 32451.0, g)), "gyro"),
        (lambda a, g: (a, np.column_stack([g[:, 0], g[:, 1], g[:, 1]])), "gyros do not see three axes"),
        (lambda a, g: (np.where(np.arange(3) == 2, 32364.0, a), g), r"accel"),
        (lambda a, g: (a, np.clip(g, 32768 - 4000, 32768 + 4000)), "gyro_. is saturated"),
        (lambda a, g: (np.clip(a, None, 33275 + 3800), g), "accel_. is saturated"),
    ],
)
def test_dead_and_saturated_axes_are_named(log, change, said):
    time, accel, gyro = log
    with pytest.raises(DataError, match=said):
        calibrated(time, *change(np.round(accel), np.round(gyro)))


def test_too_few_attitudes_are_refused():
    time, accel, gyro = simulate_hand_turned(
        ACCEL, GYRO, np.random.default_rng(3), attitudes=7, accel_noise=3.0, gyro_noise=23.0
    )
    with pytest.raises(DataError, match="at least 9 well-spread positions; 7 different"):
        calibrated(time, accel, gyro)


def test_log_that_never_rests_is_refused():
    rng = np.random.default_rng(0)
    time = np.arange(6000) / 100
    moving = np.cumsum(rng.standard_normal((6000, 6)), axis=0) * 100
    with pytest.raises(DataError):
        calibrated(time, moving[:, :3], moving[:, 3:])


def test_gap_in_a_rotation_leaves_that_rotation_out(log, answer):
    time, accel, gyro = log
    found = static_intervals(from_arrays(time, accel, gyro).read())
    cut = np.arange(found.stop[4] + 40, found.start[5] - 40)
    keep = np.setdiff1d(np.arange(time.size), cut)
    gapped = calibrated(time[keep], accel[keep], gyro[keep])
    assert gapped.fit.residuals["rotation"].count == 22
    z = (gapped["gyro.scale_factor.x"].value - S_G[0, 0]) / gapped["gyro.scale_factor.x"].standard_uncertainty
    assert abs(z) < 4


def test_no_site_puts_the_spread_of_gravity_into_the_scale(log):
    found = calibrated(*log, site=None)
    relative = found["accel.scale_factor.x"].standard_uncertainty / found["accel.scale_factor.x"].value
    assert relative == pytest.approx(0.015 / 9.80665, rel=0.02)
    assert any("standard gravity assumed" in r for r in found.remarks)


def test_accelerometers_alone(log):
    time, accel, _ = log
    found = hand_turned.calibrate(from_arrays(time, accel, counts=("accel",)), SITE)
    assert set(found.values()) == {n for n in truth() if n.startswith("accel")}


def test_jacobians_equal_central_differences(log):
    """Rotation and rest rows to gyro parameters, and to the fixed accelerometer parameters, at a point off the solution."""
    time, accel, gyro = log
    recording = from_arrays(time, accel, gyro, counts=("accel", "gyro"))
    batch = recording.read()
    found = static_intervals(batch)
    means, plan = hand_turned.means_of(batch, found, SITE, recording.counts, "log")
    fit = norm.solve(means, plan).fit
    frame = Triad("accel", counts=True)
    matrix, bias, _ = frame.unpack(fit.value[:9])
    triad = Triad("gyro", counts=True, full=True, g_sensitivity=True)
    x = triad.pack(S_G * 1.001, GYRO.bias + 1.0, G + 0.1)
    rows = _Rows(_motion(batch, found, means, matrix, bias, 5e-5), triad, 1.0, 1e-3)
    jac = rows(x).jacobian
    sizes = np.abs(x) * 1e-6 + 1e-5
    for k in range(x.size):
        step = np.where(np.arange(x.size) == k, sizes, 0.0)
        seen = (rows(x + step).residual - rows(x - step).residual) / (2 * sizes[k])
        assert np.allclose(jac[:, k], seen, rtol=1e-5, atol=2e-6 * np.abs(seen).max()), triad.names[k]
    # the accelerometers inside the integral, which only the small G sees, are left out on purpose: rotations with G = 0
    for g_matrix, part in ((np.zeros((3, 3)), slice(0, 46)), (G, slice(46, None))):
        x = triad.pack(S_G * 1.001, GYRO.bias + 1.0, g_matrix)
        to_accel = rows.to_accel(x, matrix, frame, fit)
        for k in range(9):
            h = 1e-6 * max(abs(fit.value[k]), 1.0)
            both = []
            for sign in (1, -1):
                y = fit.value[:9].copy()
                y[k] += sign * h
                moved = _Rows(_motion(batch, found, means, *frame.unpack(y)[:2], 0.0), triad, 1.0, 1e-3)
                moved.basis = rows.basis  # the same two directions to look along
                both.append(moved(x).residual)
            seen = (both[0] - both[1])[part] / (2 * h)
            assert np.allclose(to_accel[part, k], seen, rtol=1e-5, atol=1e-6 * np.abs(seen).max()), frame.names[k]


# ---------------------------------------------------------------- the public recording of imu_tk (Tedaldi et al. 2014)


@pytest.fixture(scope="module")
def turned_log(public_data):
    return open_recording(public_data("xsens_mti_hand.csv"))


@pytest.fixture(scope="module")
def xsens(turned_log):
    return hand_turned.calibrate(turned_log, Plan(gravity=9.81744))


def test_public_recording_static_intervals(xsens):
    assert xsens.fit.residuals["static norm"].count == 38
    assert xsens.fit.residuals["rotation"].count == 37


def test_public_recording_agrees_with_imu_tk(xsens):
    """imu_tk's gains, biases, misalignments; its own choice of samples moves gains by 110 ppm and angles by 7e-4 rad, and ours
    are uncertain themselves: three of our standard uncertainties and those."""
    s = np.array([[414.47792, 0, 0], [1.46292, 412.10162, 0], [3.72257, 8.83099, 414.53790]])
    expected = dict(
        zip(
            Triad("accel", counts=True).names,
            Triad("accel", counts=True).pack(s, np.array([33124.1826, 33275.1794, 32364.4157])),
            strict=True,
        )
    )
    for name, value in expected.items():
        own = 3 * xsens[name].standard_uncertainty
        other = 110e-6 * value if "scale" in name else (7e-4 if "misalignment" in name else 0.25)
        assert abs(xsens[name].value - value) < own + other, name


def test_public_recording_gyros(xsens):
    """Residual at most 0.14 deg rms with g-sensitivity; gains near imu_tk's, z moved by about the 1060 ppm it cannot see."""
    assert xsens.fit.residuals["rotation"].rms <= 0.14
    gains = np.linalg.norm(correction(xsens.values(), "gyro").matrix, axis=1)
    assert np.allclose(gains[:2], [4778.447, 4772.169], rtol=1.2e-3)
    assert 700e-6 < 1 - gains[2] / 4776.031 < 1500e-6
    matrix = correction(xsens.values(), "gyro").matrix
    unit = matrix / gains[:, None]
    # imu_tk names angles between gyro axes against accelerometer axes 1, 2, 3 in its own frame: compare loosely
    angles = np.degrees(np.arccos([unit[0] @ unit[1], unit[0] @ unit[2], unit[1] @ unit[2]]))
    assert np.allclose(angles, [90.88452, 91.53368, 86.76643], atol=0.35)
    for row, col, least in (("y", "x", 10), ("z", "y", 10), ("y", "z", 10), ("x", "z", 10)):
        p = xsens[f"gyro.g_sensitivity.{row}{col}"]
        assert abs(p.value) > least * p.standard_uncertainty


def test_public_recording_uncertainties_equal_a_real_jackknife(xsens, turned_log):
    """Stated standard uncertainties of the accelerometers against 38 refits with one attitude left out: within a factor 1.5."""
    recording = turned_log
    batch = recording.read()
    found = static_intervals(batch)
    means, plan = hand_turned.means_of(batch, found, Plan(gravity=9.81744), recording.counts, "xsens")
    refits = []
    for out in range(38):
        keep = np.delete(np.arange(38), out)
        part = replace(
            means,
            segments=tuple(means.segments[k] for k in keep),
            **{name: getattr(means, name)[keep] for name in ("mid_time", "interval", "duration", "count")},
            mean={s: v[keep] for s, v in means.mean.items()},
            rounding={s: v[keep] for s, v in means.rounding.items()},
        )
        refits.append(norm.solve(part, plan).fit.value[:9])
    refits = np.array(refits)
    jackknife = np.sqrt(37 / 38 * ((refits - refits.mean(axis=0)) ** 2).sum(axis=0))
    stated = np.array([xsens[n].standard_uncertainty for n in Triad("accel", counts=True).names])
    assert np.all((stated / jackknife < 1.5) & (jackknife / stated < 1.5)), stated / jackknife
    white = np.array(xsens.fit.white[:9])
    assert np.all(jackknife > 2 * white)  # what white residuals would have claimed
