"""Static alignment from recordings: true uncertainties, what is refused, and a real laser-gyro log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from swaying_case import DEGREE, HOUR, STILL, UG, Unit, Wave, phi_of, spoilt, together, waves

from sagnac.align import static
from sagnac.align.result import loads
from sagnac.align.static.checks import sound
from sagnac.align.static.coarse import inertial
from sagnac.align.static.fit import Data, look, loose, rows, settled, stated
from sagnac.align.static.model import collect
from sagnac.align.static.noise import found_noise
from sagnac.errors import DataError, InputError
from sagnac.frames import attitude_matrix
from sagnac.navigate.stream import Piece
from sagnac.recording import from_arrays

GYRO_NOISE, ACCEL_NOISE = 0.002 * DEGREE / 60, 10 * UG
EPS, NAB = np.full(3, 0.01 * HOUR), np.full(3, 50 * UG)


def recording_of(piece, name="parked", alter=lambda f, w: (f, w)):
    """A recording of means over the sample intervals: the first sample is only there to say when they begin."""
    f, w = alter(piece.pushes / piece.steps[:, None], piece.turns / piece.steps[:, None])
    first = [np.vstack([v[:1], v]) for v in (f, w)]
    return from_arrays(np.concatenate([[piece.begin], piece.time]), *first, name=name)


def unit_of(seed, sway=1e-3, heave=2e-3):
    rng = np.random.default_rng(seed)
    angles = (rng.uniform(0, 2 * np.pi), *rng.normal(0, 0.05, 2))
    return rng, Unit(angles=angles, sway=waves(rng, 1.5, 3, sway), heave=waves(rng, 1.5, 3, heave))


def sample(seed=0, duration=60, frequency=50, **more):
    """A good recording of a swaying unit."""
    rng, unit = unit_of(seed, **more)
    piece = spoilt(unit.increments(duration, frequency), rng, 0.5 * EPS, -0.5 * NAB, GYRO_NOISE, ACCEL_NOISE)
    return unit, piece


@pytest.fixture(scope="module")
def parked():
    """The unit, its increments and its alignment."""
    unit, piece = sample()
    return (
        unit,
        piece,
        static.align(recording_of(piece), unit.place, meaning="mean", gyro_noise=GYRO_NOISE, accel_noise=ACCEL_NOISE),
    )


@pytest.fixture(scope="module")
def tilting():
    """A unit whose tilt changes as people move about in the vehicle: that shows which gyro axis is which."""
    rng = np.random.default_rng(8)
    unit = Unit(angles=(1.0, 0.02, -0.03), sway=together(waves(rng, 1.5, 3, 1e-4), waves(rng, 0.02, 0.1, 5e-4)))
    return unit, spoilt(unit.increments(120, 50), rng, 0.5 * EPS, -0.5 * NAB, GYRO_NOISE, ACCEL_NOISE)


# ------------------------------------------------------------------------------------------------- what is found


def test_result_holds_the_attitude_at_the_end(parked):
    unit, _, found = parked
    assert (found.kind, found.method, found.time) == ("static", "maximum likelihood", 60.0)
    C = attitude_matrix(*(found[n].value for n in ("heading", "pitch", "roll")))
    off = phi_of(C, unit.C_b_n(60.0))
    sigma = [found[f"attitude_error.{a}"].standard_uncertainty for a in "xyz"]
    assert np.abs(off / sigma).max() < 4
    place = {v.name: v.value for v in found.place}
    assert (place["latitude"], place["longitude"], place["height"]) == (
        unit.place.latitude,
        unit.place.longitude,
        380.0,
    )
    sway = unit.heave(np.array(60.0), 1)
    for i, name in enumerate(("v_east", "v_north", "v_up")):
        value = next(v for v in found.place if v.name == name)
        assert abs(value.value - sway[i]) < 5 * value.standard_uncertainty + 1e-4
        assert abs(value.value - sway[i]) < 0.3 * np.abs(unit.heave(np.linspace(0, 60, 999), 1)).max()


def test_result_reads_back(parked):
    found = parked[2]
    assert loads(found.to_json()) == found
    text = found.summary()
    for words in ("Static alignment", "heading", "gyro.bias.x", "not observed", "at rest"):
        assert words in text


def test_heading_and_level_uncertainties_are_the_floors(parked):
    """methods.md section 5: nab / g and, with noise and time besides, at least eps_E / (w_e cos L)."""
    unit, _, found = parked
    level = 50 * UG / unit.place.gravity
    for axis in "xy":
        assert found[f"attitude_error.{axis}"].standard_uncertainty == pytest.approx(level, rel=0.03)
    floor = 0.01 * HOUR / unit.place.rate[1]
    assert found["heading"].standard_uncertainty > floor
    shorter = [m.standard_uncertainty[2] for m in found.course]
    assert shorter == sorted(shorter, reverse=True)
    assert shorter[-1] == pytest.approx(found["attitude_error.z"].standard_uncertainty)


def test_what_rest_does_not_show_is_said(parked):
    found = parked[2]
    names = {n.name for n in found.not_observed}
    assert {"accel.bias.x", "accel.bias.y", "gyro.bias.z"} <= names
    assert "accel.bias.z" not in names
    east = [n for n in found.not_observed if n.name in ("gyro.bias.x", "gyro.bias.y")]
    assert all("along east" in n.reason and "half round" in n.shown_by for n in east)
    assert next(o for o in found.observed if o.name == "accel.bias.z").final < 0.2 * 50 * UG


def test_long_enough_alignment_names_the_gyros_share():
    unit, piece = sample(duration=300, frequency=20, sway=1e-4, heave=1e-4)
    found = static.align(recording_of(piece), unit.place, meaning="mean", gyro_noise=1e-9, accel_noise=ACCEL_NOISE)
    assert any("gyros' bias along east" in r for r in found.remarks)


def test_biases_that_are_not_stated_are_said_to_be_assumed(parked):
    remarks = " ".join(parked[2].remarks)
    assert "gyro bias taken to be 0.01 deg/h" in remarks
    assert "accelerometer bias taken to be 50 ug" in remarks


def test_gyrocompass_at_rest_agrees_with_the_fine_method():
    unit = Unit(angles=(2.0, 0.1, -0.05))
    recording = recording_of(unit.increments(60, 20))
    options = {"meaning": "mean", "gyro_bias": EPS, "accel_bias": NAB}
    means = static.align(recording, unit.place, method="gyrocompass", **options)
    fine = static.align(recording, unit.place, gyro_noise=1e-9, accel_noise=1e-7, **options)
    for name in ("heading", "pitch", "roll"):
        assert means[name].value == pytest.approx(fine[name].value, abs=2e-7)
    assert means.method == "gyrocompass"
    assert means["attitude_error.z"].standard_uncertainty > 0.01 * HOUR / unit.place.rate[1]


def test_gyrocompass_says_when_the_unit_sways_too_much():
    unit, piece = sample(sway=5e-3)
    with pytest.raises(DataError, match="since the unit sways: use the method fine"):
        static.align(recording_of(piece), unit.place, meaning="mean", method="gyrocompass")


def test_part_of_a_recording(parked):
    unit, piece, _ = parked
    found = static.align(recording_of(piece), unit.place, start=10.0, stop=50.0, meaning="mean")
    assert (found.source[0].start, found.source[0].stop, found.time) == (10.0, 50.0, 50.0)
    C = attitude_matrix(*(found[n].value for n in ("heading", "pitch", "roll")))
    off = phi_of(C, unit.C_b_n(50.0))
    assert np.abs(off / [found[f"attitude_error.{a}"].standard_uncertainty for a in "xyz"]).max() < 4


def test_turned_half_round_beats_the_floor():
    rng, unit = unit_of(4, heave=5e-4)
    unit = Unit(unit.place, unit.angles, unit.sway, unit.heave, turn=(85.0, 95.0, np.pi))
    piece = spoilt(unit.increments(180, 100), rng, EPS, NAB, 0.0002 * DEGREE / 60, 2 * UG)
    found = static.align(
        recording_of(piece), unit.place, meaning="mean", gyro_noise=0.0002 * DEGREE / 60, accel_noise=2 * UG
    )
    floor = 0.01 * HOUR / unit.place.rate[1]
    sigma = np.array([found[f"attitude_error.{a}"].standard_uncertainty for a in "xyz"])
    assert sigma[2] < 0.5 * floor
    C = attitude_matrix(*(found[n].value for n in ("heading", "pitch", "roll")))
    assert np.abs(phi_of(C, unit.C_b_n(180.0)) / sigma).max() < 4
    assert found["gyro.bias.x"].standard_uncertainty < 0.5 * EPS[0]
    assert found["accel.bias.x"].standard_uncertainty < 0.2 * NAB[0]


# ------------------------------------------------------------------------------------------- true uncertainties


def errors_of(runs, noise_stated, duration=120, frequency=50):
    """Errors over standard uncertainties (runs, 12), and normalised squared errors (runs,)."""
    scores, squares = [], []
    for seed in range(runs):
        rng, unit = unit_of(seed)
        eps, nab = rng.normal(0, EPS), rng.normal(0, NAB)
        piece = spoilt(unit.increments(duration, frequency), rng, eps, nab, GYRO_NOISE, ACCEL_NOISE)
        blocks = collect([piece])
        C = inertial(blocks, unit.place.latitude)
        data, prior = Data.of(blocks, unit.place), loose(unit.place, C, EPS, NAB)
        known = {"gyro": GYRO_NOISE, "accel": ACCEL_NOISE} if noise_stated else {}
        table = rows(data, look(data, C, prior).C)
        noise = found_noise(data.middle, data.kernel, table, prior, unit.place.gravity, **known)
        found = settled(data, C, noise, stated(EPS, NAB))
        stop = np.array(float(blocks.end[-1]))
        e = [
            phi_of(found.C_b_n, unit.C_b_n(stop)),
            found.velocity - unit.heave(stop, 1),
            eps - found.eps,
            nab - found.nab,
        ]
        e = np.concatenate(e)
        scores.append(e / np.sqrt(np.diag(found.covariance)))
        squares.append(e @ np.linalg.solve(found.covariance, e))
    return np.array(scores), np.array(squares)


@pytest.mark.statistical
def test_uncertainties_are_true_with_stated_noise():
    """Units that sway by 1 mrad and 2 mm at 1.5 to 3 Hz: every rms over sigma, the normalised square and the coverage.

    Bands of 0.1 % each from the chi-square distribution of 60 runs; sway that is not quite white over the windows may add 10 % to
    an rms.
    """
    runs = 60
    scores, squares = errors_of(runs, noise_stated=True)
    low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], runs) / runs)
    rms = np.sqrt((scores**2).mean(axis=0))
    assert (rms > low).all()
    assert (rms < 1.1 * high).all()
    assert chi2.ppf(0.0005, 12 * runs) < squares.sum() < 1.1**2 * chi2.ppf(0.9995, 12 * runs)
    assert 0.93 < (np.abs(scores) < 1.96).mean() < 0.97


@pytest.mark.statistical
def test_uncertainties_with_noise_found_in_the_samples():
    """The same where the noise itself is estimated, from two minutes: it is known to some 10 % then, and sigma with it."""
    runs = 24
    scores, squares = errors_of(runs, noise_stated=False)
    low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], runs) / runs)
    rms = np.sqrt((scores**2).mean(axis=0))
    assert (rms > low / 1.2).all()
    assert (rms < 1.2 * high).all()
    assert squares.mean() < 1.2**2 * chi2.ppf(0.9995, 12 * runs) / runs
    assert 0.90 < (np.abs(scores) < 1.96).mean() < 0.98


# ------------------------------------------------------------------------------------------------ what is refused


def reversed_axes(*rows):
    return lambda f, w: (f @ np.diag(rows), w @ np.diag(rows))


def with_drive(f, w):
    f = f.copy()
    f[1000:1200, 1] += 0.5
    f[2000:2200, 1] -= 0.5
    return f, w


HOSTILE = {
    "accelerometers in g": (lambda f, w: (f / 9.80665, w), "look like g labelled m/s\\^2"),
    "accelerometers as if in g": (lambda f, w: (f * 9.80665, w), "look like m/s\\^2 labelled g"),
    "accelerometers dead": (lambda f, w: (f * 0, w), "mean specific force is 0 m/s\\^2"),
    "accelerometers read -g": (lambda f, w: (-f, w), "the accelerometers have the wrong sign"),
    "gyros reversed": (lambda f, w: (f, -w), "or the gyros have"),
    "gyros in deg/s": (lambda f, w: (f, w / DEGREE), "look like deg/s labelled rad/s"),
    "gyros as if in deg/s": (lambda f, w: (f, w * DEGREE), "look like rad/s labelled deg/s"),
    "gyros dead": (lambda f, w: (f, w * 0), "gyros say nothing at all"),
    "gyros of a tenth": (lambda f, w: (f, w + [0, 0, 3e-5]), "larger bias than stated"),
    "upside down": (reversed_axes(1, -1, -1), "upside down, or its axes are x forward"),
    "drives off": (with_drive, "did not stay at its place"),
    "an axis off by 10 mg": (lambda f, w: (f + [0, 0, 0.1], w), "accel biases of .* along the vertical"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_samples_are_named(case, parked):
    unit, piece, _ = parked
    alter, words = HOSTILE[case]
    with pytest.raises(DataError, match=words):
        static.align(recording_of(piece, "log.csv", alter), unit.place, meaning="mean")


AXES = {
    "gyro x reversed": (lambda f, w: (f, w * [-1, 1, 1]), "x = -gyro_x, y = gyro_y"),
    "gyro y reversed": (lambda f, w: (f, w * [1, -1, 1]), "x = gyro_x, y = -gyro_y"),
    "gyro x and y exchanged": (lambda f, w: (f, w[:, [1, 0, 2]]), "x = gyro_y, y = gyro_x"),
    "accelerometer x reversed": (lambda f, w: (f * [-1, 1, 1], w), "axes of one of them are exchanged or reversed"),
    "gyros in deg/h": (lambda f, w: (f, w * 3600), "look like deg/h labelled deg/s"),
}


@pytest.mark.parametrize("case", AXES)
def test_axes_that_do_not_fit_are_named(case, tilting):
    unit, piece = tilting
    alter, words = AXES[case]
    with pytest.raises(DataError, match=words):
        static.align(recording_of(piece, "log.csv", alter), unit.place, meaning="mean")


def test_tilting_unit_itself_is_fine(tilting):
    unit, piece = tilting
    found = static.align(recording_of(piece), unit.place, meaning="mean")
    C = attitude_matrix(*(found[n].value for n in ("heading", "pitch", "roll")))
    off = phi_of(C, unit.C_b_n(120.0))
    assert np.abs(off / [found[f"attitude_error.{a}"].standard_uncertainty for a in "xyz"]).max() < 4


def test_unit_high_above_its_roll_axis_is_fine():
    """2 m above the axis of a roll of 0.5 Hz the accelerometers feel the roll the other way round: the gyros are right."""
    sway = Wave(2 * np.pi * np.array([0.5]), np.array([[0.0, 0.0, 2e-3]]), np.zeros((1, 3)))
    heave = Wave(
        sway.w, np.array([[-4e-3, 0.0, 0.0]]), np.zeros((1, 3))
    )  # heading north: roll to the right, away to the left
    unit = Unit(angles=(0.0, 0.0, 0.0), sway=sway, heave=heave)
    found = static.align(recording_of(unit.increments(100, 50)), unit.place, meaning="mean")
    assert (
        np.abs(
            phi_of(attitude_matrix(*(found[n].value for n in ("heading", "pitch", "roll"))), unit.C_b_n(100.0))
        ).max()
        < 3e-5
    )


@pytest.mark.parametrize("alter", [lambda f, w: (f, -w), lambda f, w: (-f, w)])
def test_wrong_signs_at_perfect_rest(alter):
    """Nothing sways: only the Earth rate along the vertical tells."""
    unit = Unit()
    with pytest.raises(DataError, match="wrong sign"):
        static.align(recording_of(unit.increments(60, 20), "log.csv", alter), unit.place, meaning="mean")


def test_wrong_hemisphere_is_named(parked):
    unit, piece, _ = parked
    south = static.place_of(-unit.place.latitude, 0.0, 380.0)
    with pytest.raises(DataError, match="latitude has the wrong sign"):
        static.align(recording_of(piece), south, meaning="mean")


def test_wrong_latitude_is_named():
    unit, piece = sample(duration=120)
    other = static.place_of(unit.place.latitude + 3 * DEGREE, 0.0, 380.0)
    with pytest.raises(DataError, match=r"gyro biases of .* along north.*the rate is that of 34\.\d\d deg"):
        static.align(recording_of(piece), other, meaning="mean")


def test_upside_down_may_be_meant(parked):
    unit, piece, right_way = parked
    recording = recording_of(piece, alter=reversed_axes(1, -1, -1))
    found = static.align(recording, unit.place, meaning="mean", upside_down=True)
    assert abs(abs(found["roll"].value) - np.pi) < 0.2
    assert found["heading"].standard_uncertainty < 2 * right_way["heading"].standard_uncertainty


def test_gyros_that_find_no_north():
    unit, piece = sample()
    with pytest.raises(DataError, match="heading cannot be found"):
        static.align(recording_of(piece), unit.place, meaning="mean", gyro_bias=10 * HOUR)


def test_too_little_time_for_a_heading():
    unit, piece = sample(duration=12)
    with pytest.raises(DataError, match=r"heading cannot be found.*Take more time"):
        static.align(
            recording_of(piece), unit.place, meaning="mean", gyro_noise=GYRO_NOISE, accel_noise=20 * ACCEL_NOISE
        )


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"gyro_bias": -1.0}, "gyro bias"),
        ({"gyro_bias": [1.0, 2.0]}, "gyro bias"),
        ({"accel_bias": np.nan}, "accel bias"),
        ({"gyro_noise": 0.0}, "noise of 0.0 of the gyro"),
        ({"accel_noise": np.inf}, "noise of inf of the accel"),
        ({"start": 50.0, "stop": 20.0}, "no stretch of time"),
    ],
)
def test_nonsense_is_refused(parked, wrong, words):
    unit, piece, _ = parked
    with pytest.raises(InputError, match=words):
        static.align(recording_of(piece), unit.place, meaning="mean", **wrong)


def test_times_outside_the_samples(parked):
    unit, piece, _ = parked
    with pytest.raises(DataError, match="no samples between 100 s and 200 s: they go from 0 s to 60 s"):
        static.align(recording_of(piece), unit.place, meaning="mean", start=100.0, stop=200.0)


@pytest.mark.parametrize(
    ("latitude", "longitude", "height", "words"),
    [
        (2.0, 0, 0, "latitude"),
        (np.nan, 0, 0, "latitude"),
        (89.95 * DEGREE, 0, 0, "pole"),
        (0.5, 9.0, 0, "longitude"),
        (0.5, 0, 1e9, "height"),
    ],
)
def test_no_place_on_earth(latitude, longitude, height, words):
    with pytest.raises(InputError, match=words):
        static.place_of(latitude, longitude, height)


def test_one_triad_alone_is_refused():
    with pytest.raises(InputError, match="accel_x, accel_y, accel_z"):
        static.align(from_arrays(np.arange(10.0), gyro=np.zeros((10, 3))), static.place_of(0.5, 0, 0))


@pytest.mark.parametrize("meaning", ["mean", "instant"])
@pytest.mark.parametrize(("sensor", "axis", "times"), [("gyro", 1, 1e3), ("accel", 0, 1e3), ("accel", 2, -1e3)])
def test_an_absurd_sample_is_named(parked, sensor, axis, times, meaning):
    unit, piece, _ = parked
    batch = recording_of(piece).read()
    samples = {"accel": batch.accel.copy(), "gyro": batch.gyro.copy()}
    samples[sensor][1500, axis] = times * np.abs(samples[sensor]).max()
    spoilt = from_arrays(batch.time, samples["accel"], samples["gyro"], name="spiky")
    with pytest.raises(
        DataError, match=rf"spiky: {sensor}_{'xyz'[axis]} reads -?[\d.e+]+ .* about (29|30)\.?\d* s, .*stands alone"
    ):
        static.align(spoilt, unit.place, meaning=meaning)
    # it does not matter to an alignment before it
    assert static.align(spoilt, unit.place, meaning=meaning, stop=29.5).time == 29.5


@pytest.mark.parametrize("at", [0, 5, 30, 59])
def test_a_spike_is_seen_wherever_pieces_end_and_the_start_of_a_turn_is_none(at):
    rng = np.random.default_rng(5)
    turns, pushes = 1e-6 * rng.normal(size=(60, 3)), 1e-3 * rng.normal(size=(60, 3))
    spiky = turns.copy()
    spiky[at, 2] += 2e-3
    turning = turns.copy()
    turning[at:, 2] += 2e-3  # from one sample to the next
    time = 0.01 * np.arange(1.0, 61.0)
    for size in (1, 4, 13, 31, 60):
        cuts = [slice(a, min(a + size, 60)) for a in range(0, 60, size)]
        steps = np.full(60, 0.01)
        with pytest.raises(DataError, match=f"gyro_z reads .* about {time[at]:.9g} s"):
            list(sound((Piece(0.0, time[c], steps[c], spiky[c], pushes[c]) for c in cuts), "log"))
        if 10 < at < 50:
            assert len(list(sound((Piece(0.0, time[c], steps[c], turning[c], pushes[c]) for c in cuts), "log"))) == len(
                cuts
            )


def test_a_knock_that_rings_on_is_no_error_of_the_log(parked):
    # 5 m/s^2 and 0.2 rad/s at 12 Hz that die away in a tenth of a second, at 50 samples a second
    piece = parked[1]
    since = np.arange(60) / 50
    ring = (np.exp(-since / 0.1) * np.sin(2 * np.pi * 12 * since))[:, None]
    struck = piece.turns.copy(), piece.pushes.copy()
    struck[0][1500:1560] += 0.2 / 50 * ring
    struck[1][1500:1560] += 5.0 / 50 * ring
    list(sound([replace(piece, turns=struck[0], pushes=struck[1])], "struck"))


def test_gap_is_refused(parked):
    unit, piece, _ = parked
    recording = recording_of(piece)
    batch = recording.read()
    keep = (batch.time <= 20.0) | (batch.time > 21.0)
    holed = from_arrays(batch.time[keep], batch.accel[keep], batch.gyro[keep], name="holed")
    with pytest.raises(DataError, match=r"no samples from 20 s to 21.02 s.*--from, --to"):
        static.align(holed, unit.place, meaning="mean")
    # the gap does not matter to an alignment after it
    assert static.align(holed, unit.place, meaning="mean", start=21.02).source[0].start == 21.02


def test_still_wave_is_still():
    assert np.array_equal(STILL(np.arange(3.0)), np.zeros((3, 3)))
