"""Logs that lost single samples: bridged, they tell what the complete log does."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from sagnac.errors import DataError
from sagnac.noise.curves.allan import KINDS, SPAN, octaves, variances
from sagnac.noise.curves.bridges import LEAST, MOST, SHORT, Added, Losses, Pieces, Run, losses, of_runs
from sagnac.noise.curves.confidence import degrees_of_freedom
from sagnac.noise.curves.streamed import Stream
from sagnac.noise.gather import gather, spectrum_of, variances_of
from sagnac.noise.identification.fit import fit, model
from sagnac.noise.identification.identify import _octaves
from sagnac.noise.identification.model_covariance import layout
from sagnac.noise.study import study
from sagnac.recording import from_arrays

DT = 0.01


def lose(n, share, most, rng):
    """Which samples stay, where runs of 1 to `most` are lost."""
    keep = np.ones(n, dtype=bool)
    for at in np.flatnonzero(rng.random(n) < share / (0.5 * (1 + most))):
        keep[at : at + rng.integers(1, most + 1)] = False
    keep[[0, -1]] = True
    return keep


def run_of(y, keep):
    at = np.flatnonzero(keep)
    lost = np.diff(at) - 1
    ends = np.concatenate([np.flatnonzero(lost) + 1, [at.size]])
    return Run(y[keep], np.diff(ends, prepend=0), lost[lost > 0])


def given(runs):
    return losses([n for r in runs for n in r.lost.tolist()], sum(r.values.size for r in runs))


def noise(kind, n, rng):
    """White noise, a walk, or flicker noise (Kasdin 1995)."""
    white = rng.normal(size=n)
    if kind == "white":
        return white
    if kind == "walk":
        return np.cumsum(white)
    steps = np.arange(1, n)
    response = np.concatenate([[1.0], np.cumprod((steps - 0.5) / steps)])
    return np.fft.irfft(np.fft.rfft(white, 2 * n) * np.fft.rfft(response, 2 * n), 2 * n)[:n]


# ------------------------------------------------------------------------------------------------- what filling does


def weights(kind, m):
    """Of the samples in one difference, so that its square is the variance."""
    one = np.ones(m)
    if kind == "hadamard":
        return np.concatenate([one, -2.0 * one, one]) / (m * np.sqrt(6.0))
    pair = np.concatenate([-one, one])
    return (np.convolve(pair, one) / m if kind == "modified" else pair) / (m * np.sqrt(2.0))


def operator(run, n):
    """What each sample that is there adds to the filled ones, shape (n, there)."""
    columns = []
    for k in range(run.values.size):
        unit = np.zeros(run.values.size)
        unit[k] = 1.0
        columns.append(sparse.coo_array(Added().fill(unit, run.lengths, run.lost)[:, None]))
    return sparse.hstack(columns).tocsr()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("share", "most"), [(0.02, 3), (0.01, 20)])
def test_what_filling_adds_to_white_noise_is_known(kind, share, most):
    """Sum over all differences of the squares of what each sample weighs in them, against the closed form."""
    n = 4000
    keep = lose(n, share, most, np.random.default_rng(3))
    run = run_of(np.zeros(n), keep)
    begin = given([run]).begin
    filled = operator(run, n)
    added = Added()
    added.fill(np.random.default_rng(1).normal(size=run.values.size), run.lengths, run.lost)
    added.over(n)
    added._sums[2] = added._sums[1]  # of unit variance, not what 30 places make of it
    for m in (begin, 4 * begin):
        own = weights(kind, m)
        count = n - own.size + 1
        differences = sparse.diags_array([np.full(count, w) for w in own], offsets=range(own.size), shape=(count, n))
        true = float((differences.tocsr() @ filled).power(2).sum()) / count
        clean = float(own @ own)
        told = float(added.at(kind, np.array([m]))[0])
        # a tenth of what is added, at the ends of the log and where losses are close together
        assert true - clean == pytest.approx(told, abs=0.12 * (true - clean) + 1e-3 * clean)


def test_a_line_stays_a_line_and_a_constant_a_constant():
    run = run_of(9.8 + 1e-3 * np.arange(2000.0), lose(2000, 0.02, 1, np.random.default_rng(2)))
    filled = Added().fill(run.values, run.lengths, run.lost)
    assert filled == pytest.approx(9.8 + 1e-3 * np.arange(2000.0), abs=2.1e-3)  # neighbours of a piece of one sample
    assert np.median(np.abs(filled - 9.8 - 1e-3 * np.arange(2000.0))) < 1e-12
    run = run_of(np.full(2000, 9.8), lose(2000, 0.02, 3, np.random.default_rng(2)))
    assert np.array_equal(Added().fill(run.values, run.lengths, run.lost), np.full(2000, 9.8))


def test_what_is_lost_is_counted():
    found = losses([1, 1, 2, 10], 1386)
    assert (found.lost, found.places, found.longest, found.share) == (14, 4, 10, 0.01)
    assert found.usual == pytest.approx(106 / 14)
    assert found.begin == 61  # eight times the usual loss
    assert found.bridged
    assert losses([1], 10**6).begin == 32
    assert losses([60, 1], 10**6).begin == 473
    assert not losses([], 100).bridged
    assert not losses([60], 1000).bridged  # 5.7 %


# ------------------------------------------------------------------------------------------------- pieces


@pytest.mark.parametrize("kind", KINDS)
def test_pieces_are_told_by_all_differences_within_them(kind):
    rng = np.random.default_rng(4)
    lengths = np.array([3, 8, 50, 700, 9, 5000, 2, 50])
    y = rng.normal(size=lengths.sum()) + 9.8
    pieces = Pieces(kind, 1, "exact", per_octave=2)
    pieces.add(0, y, lengths)
    found = pieces.result(0, 1.0)
    assert found is not None
    own = [p for p in np.split(y, np.cumsum(lengths)[:-1]) if LEAST <= p.size <= 4096]
    assert found.samples == sum(p.size for p in own)
    for i, m in enumerate(found.factors.tolist()):
        parts = [variances(p, 1.0, [m], kind) for p in own if p.size >= 2 * SPAN[kind] * m]
        assert found.count[i] == sum(p.count[0] for p in parts)
        assert found.variance[i, 0] == pytest.approx(sum(p.count[0] * p.variance[0, 0] for p in parts) / found.count[i])
    assert sum(found.often) == len(own)
    assert np.array_equal(sum(counts for _, counts in found.stretches), found.count)


def test_no_pieces_tell_nothing():
    pieces = Pieces("allan", 1, "exact", per_octave=2)
    pieces.add(0, np.zeros(9), np.array([4, 5]))
    assert pieces.result(0, 1.0) is None


# ------------------------------------------------------------------------------------------------- logs


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_lost_is_what_it_was(kind):
    y = np.random.default_rng(5).normal(size=5000)
    run = Run(y, np.array([y.size]), np.zeros(0, dtype=np.int64))
    found = of_runs([run], 1.0, kind, given([run]), per_octave=2)
    plain = variances(y, 1.0, octaves(5000, kind, per_octave=2), kind)
    assert found.variance == pytest.approx(plain.variance, rel=1e-14)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("memory", [2**31, 0])
def test_a_log_goes_on_to_its_length(kind, memory):
    n, rng = 60_000, np.random.default_rng(6)
    y = np.stack([noise(k, n, rng) for k in ("white", "flicker", "walk")], axis=1)
    keep = lose(n, 0.01, 3, rng)
    keep[20_000:22_000] = False
    time = DT * np.arange(n)
    found = gather(from_arrays(time[keep], gyro=y[keep]), kinds=(kind,), memory=memory)
    whole = np.ones(n, dtype=bool)
    whole[20_000:22_000] = False
    complete = gather(from_arrays(time[whole], gyro=y[whole]), kinds=(kind,), memory=memory)
    assert found.losses.lost == pytest.approx(whole.sum() - keep.sum(), abs=10)  # some at the gap
    assert complete.losses.places == 0
    assert found.interval == pytest.approx(DT, rel=1e-4)
    assert found.samples == keep.sum()
    for axis in range(3):
        own, full = variances_of(found, axis, kind), variances_of(complete, axis, kind)
        assert own.factors[-1] > full.factors[-1] / 1.5
        common = np.isin(own.factors, full.factors)
        assert common.sum() > 0.9 * common.size
        ratio = own.variance[common, 0] / full.variance[np.isin(full.factors, own.factors), 0]
        # white noise is told by other samples where some are lost: a part of its uncertainty
        uncertain = np.sqrt(2.0 / degrees_of_freedom(own)[common, 0])
        assert np.all(np.abs(ratio - 1.0) < 2.5 * uncertain + 0.005)


def test_a_stream_hardly_depends_on_how_it_comes():
    """But for the places at which long pieces are cut."""
    n, rng = 150_000, np.random.default_rng(7)
    y = rng.normal(size=(n, 2))
    run = run_of(np.arange(float(n)), lose(n, 0.005, 3, rng))
    ends = np.cumsum(run.lengths).tolist()
    rows = y[run.values.astype(int)]
    results = []
    for size in (10**6, 777):
        stream = Stream(1.0, 2, ("allan",), per_octave=2, shortest=64)
        first = 0
        for i, end in enumerate(ends):
            for at in range(first, end, size):
                stream.add(rows[at : min(at + size, end)])
            if i < len(run.lost):
                stream.loss(int(run.lost[i]))
            first = end
        results.append(stream.done()["allan"][1].result(given([run])))
    assert np.array_equal(results[0].factors, results[1].factors)
    assert results[0].variance == pytest.approx(results[1].variance, rel=0.01)
    exact = of_runs([Run(rows[:, 1], run.lengths, run.lost)], 1.0, "allan", given([run]), per_octave=2)
    few = int((exact.factors < 16).sum())
    assert results[0].variance[:few] == pytest.approx(exact.variance[:few], rel=0.002)
    assert results[0].factors[-1] > exact.factors[-1] / 1.5


def test_too_many_losses_part_the_log_and_it_is_said():
    n, rng = 40_000, np.random.default_rng(8)
    keep = lose(n, 0.09, 1, rng)
    gyro, time = rng.normal(size=(n, 3)), DT * np.arange(n)
    found = study(from_arrays(time[keep], gyro=gyro[keep]))
    gap = next(d for d in found.disturbances if d.kind == "gap")
    assert "too many to be bridged (at most 5%)" in gap.text
    assert found["gyro_x"].curve.tau[-1] < 100 * DT
    assert found.interval == pytest.approx(DT, rel=5e-3)


def test_what_is_bridged_is_said():
    n, rng = 40_000, np.random.default_rng(9)
    gyro, time = rng.normal(size=(n, 3)), DT * np.arange(n)
    keep = np.ones(n, dtype=bool)
    keep[1000:35_000:500] = False
    found = study(from_arrays(time[keep], gyro=gyro[keep]))
    gap = next(d for d in found.disturbances if d.kind == "gap")
    assert gap.text == (
        "68 samples lost in 68 places (0.17%, 1 in a row at most): bridged for averaging times that are long against this, "
        "from 0.32 s on"
    )
    assert found["gyro_x"].curve.tau[-1] > 64.0
    spectrum = found["gyro_x"].spectrum
    assert spectrum is not None
    assert spectrum.frequency[0] < 0.02
    keep[20_000:20_065] = False
    found = study(from_arrays(time[keep], gyro=gyro[keep]))
    gap = next(d for d in found.disturbances if d.kind == "gap")
    assert "1 gap, 0.66 s in all, the longest of 0.66 s at 199.99 s: the stretches between" in gap.text


def test_pulses_take_their_angle_along():
    """Of pure quantisation noise each lost sample takes an angle away: nothing is bridged there, what pieces tell stays exact."""
    n, rng = 100_000, np.random.default_rng(10)
    y = np.diff(rng.normal(size=n + 1))
    run = run_of(y, lose(n, 0.01, 1, rng))
    found = of_runs([run], 1.0, "allan", given([run]), per_octave=1)
    assert 64 <= found.factors[-1] < 1000
    full = variances(y, 1.0, found.factors)
    few = found.factors <= 64
    assert found.variance[few] == pytest.approx(full.variance[few], rel=0.05)


def test_a_dead_axis_is_named_bridged_or_not():
    run = run_of(np.ones(20_000), lose(20_000, 0.01, 1, np.random.default_rng(11)))
    with pytest.raises(DataError, match="are the same"):
        of_runs([run], 1.0, "allan", given([run]), per_octave=1)


def test_limits_go_together():
    assert 0.0 < MOST <= 0.1
    assert Losses(1, 1, SHORT, 0.001, SHORT).begin <= 8 * SHORT


# ------------------------------------------------------------------------------------------------- statistics

LEVELS = {"white": 1.0, "instability": 2e-3, "walk": 2e-6}


def mixed(n, rng):
    """Samples of these levels: flicker noise of spectrum 1 / (2 pi f) has the level 2 pi of that of unit steps."""
    out = rng.normal(size=n) + np.sqrt(LEVELS["walk"]) * noise("walk", n, rng)
    return out + np.sqrt(LEVELS["instability"]) * noise("flicker", n, rng)


@pytest.mark.statistical
@pytest.mark.parametrize(("share", "gap"), [(0.01, False), (0.001, False), (0.01, True)])
def test_the_terms_are_those_of_the_complete_log(share, gap):
    """60 logs of 2^16 samples: error and coverage of the levels against the complete ones.

    Of 60 intervals of 95 % at least 51 hold the truth in 99.6 of 100 cases. The errors of both go together, and their
    root mean squares differ by what 1 % less of samples, or a gap, takes: 12 % bounds it.
    """
    n, rng, logs = 1 << 16, np.random.default_rng(12), 60
    truth = np.array(list(LEVELS.values()))
    off = {"lost": [], "full": []}
    inside = {"lost": 0, "full": 0}
    for _ in range(logs):
        y = mixed(n, rng)
        keep = lose(n, share, 3, rng)
        ends = ((0, 30_000), (33_000, n)) if gap else ((0, n),)
        runs = [run_of(y[a:b], keep[a:b]) for a, b in ends]
        both = {
            "lost": of_runs(runs, 1.0, "allan", given(runs), per_octave=1),
            "full": variances(y, 1.0, octaves(n)),
        }
        for name, v in both.items():
            used = _octaves(v)
            found = fit(model(layout(v, used), tuple(LEVELS)), np.ascontiguousarray(v.variance[used, 0]))
            off[name].append(found.levels / truth - 1.0)
            inside[name] = inside[name] + (np.abs(found.levels - truth) < 1.96 * np.sqrt(np.diag(found.covariance)))
    error = {k: np.sqrt(np.square(v).mean(axis=0)) for k, v in off.items()}
    assert np.all(error["lost"] < (1.25 if gap else 1.12) * error["full"])
    assert np.all(inside["lost"][:2] >= 51)
    assert np.all(inside["lost"] >= inside["full"] - 4)


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ["white", "flicker", "walk"])
@pytest.mark.parametrize("share", [0.01, 0.001])
def test_the_curve_is_that_of_the_complete_log(kind, share):
    """Mean over 60 logs of the ratio of variances: one, within four times the scatter that it shows."""
    n, rng = 1 << 14, np.random.default_rng(13)
    ratios = []
    for _ in range(60):
        y = noise(kind, n, rng)
        run = run_of(y, lose(n, share, 3, rng))
        found = of_runs([run], 1.0, "allan", given([run]), per_octave=1)
        full = variances(y, 1.0, octaves(n))
        kept = np.isin(full.factors, found.factors)
        row = np.full(full.factors.size, np.nan)
        row[kept] = found.variance[:, 0] / full.variance[kept, 0]
        ratios.append(row)
    told = np.array(ratios)
    mean, spread = np.nanmean(told, axis=0), np.nanstd(told, axis=0) / np.sqrt(np.isfinite(told).sum(axis=0))
    assert np.isfinite(told[:, -1]).all()
    assert np.all(np.abs(mean - 1.0) < 4.0 * spread + 5e-4)


def test_a_spectrum_with_the_temperature_taken_off_is_filled_too():
    from sagnac.noise.gather import Correction

    n, rng = 40_000, np.random.default_rng(14)
    time = DT * np.arange(n)
    keep = lose(n, 0.005, 2, rng)
    gyro = rng.normal(size=(n, 3))
    found = gather(from_arrays(time[keep], gyro=gyro[keep]))
    plain = spectrum_of(found, 0)
    corrected = spectrum_of(found, 0, Correction(time[::100], np.sin(time[::100] / 100.0), np.array([1e-9, 0.0, 0.0])))
    assert plain is not None
    assert corrected is not None
    assert corrected.density[:, 0] == pytest.approx(plain.density[:, 0], rel=1e-3)
    assert plain.density[plain.frequency < 5.0].mean() == pytest.approx(2 * DT, rel=0.1)


def test_one_loss_in_a_log_with_gaps_leaves_the_other_stretches_whole():
    """What the run with the loss tells across it is not taken for another stretch of half as many differences."""
    starts, each = 21_000 * np.arange(10)[:, None], 20_000
    time = (starts + np.arange(each)).ravel() * 0.01
    rng = np.random.default_rng(3)
    keep = np.arange(time.size) != 9 * each + 7777
    found = variances_of(gather(from_arrays(time[keep], gyro=rng.normal(size=(time.size, 3))[keep])), 0, "allan")
    own = [s for s in layout(found, _octaves(found)).stretches if s.samples == each and s.counts[0] > 0]
    assert [(s.often, s.counts[0]) for s in own] == [(9, each - 1)]  # SP 1065: n + 1 - 2 m differences of each, m = 1


def test_a_stream_tells_all_differences_beside_a_rare_loss():
    n, rng = 150_000, np.random.default_rng(8)
    y, keep = rng.normal(size=(n, 1)), np.arange(n) != 1000
    stream = Stream(1.0, 1, ("allan",), per_octave=2, shortest=64)
    stream.add(y[:1000])
    stream.loss(1)
    stream.add(y[1001:])
    run = run_of(y[:, 0], keep)
    found = stream.done()["allan"][0].result(given([run]))
    assert found.count[0] > 0.999 * n
