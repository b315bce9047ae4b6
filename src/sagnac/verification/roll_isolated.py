"""Check a roll-isolated calibration on a recording that its fit has not seen.

What the model leaves of the readings is resolved into lines: the mean of each gyro, the swing, the spin and twice the spin on
gyros y and z; once and twice a turn, delay and scale between encoder and gyro x. Each line has a cause, see :data:`CAUSES`.
Their amplitudes together pass or fail by one chi-square, with the covariance of the calibration, the noise of the new
recording and what else differs from recording to recording (spin rate, drift of the biases, Earth rate). Slow noise that the
plan states weighs as in the calibration, and has moved the biases since, see :func:`moved_variance`.

The residual spectrum is searched for lines besides; those that lie at none of these frequencies are reported as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..calibrate.roll_isolated import first_noise, nuisances, seen_noise, steady_segments
from ..calibrate.roll_isolated.model import RollModel
from ..calibrate.roll_isolated.rows import Channel, Piece
from ..calibrate.roll_isolated.start import Look, look
from ..calibrate.slow import SlowNoise, slow_noise
from ..calibration import Calibration
from ..errors import DataError, InputError
from ..estimate import Parameter, settle
from ..files import sha256
from ..frames import Array
from ..observe.spectrum import SpectrumSums, find_lines, folded
from ..plan import Plan
from ..printed import printed
from ..recording import EPOCH, Recording
from ..results import Source
from ..rigs.roll_isolated import DELAY, ECCENTRICITY, HALF_ANGLE, PHASE
from . import PASS, Check, Verification

CAUSES = {
    "mean": "bias, or mounting angles where the cylinder turns",
    "x mean": "bias or scale of gyro x, or inner_rate",
    "swing": "mounting angles (pitch shows on y, yaw on z)",
    "spin in phase": "half-angle of the cone",
    "spin across": "phase of the cone, or delay of the encoder",
    "spin backward": "scales of gyros y and z that differ, or axes that are not square",
    "twice spin": "eccentricity of the encoder, once a turn",
    "encoder 1x": "eccentricity of the encoder, once a turn",
    "encoder 2x": "eccentricity of the encoder, twice a turn",
    "encoder delay": "delay of the encoder, which the swing shows",
    "x scale": "scale of gyro x, which the swing shows against the encoder",
}
"""What may cause each line."""
_NOTED = 3.0  # standard uncertainties from which a line is explained
_LOUD = 1.5  # times what is stated, from which the noise is the data's own, as in the fit
_UNITS = {"encoder 1x": "rad", "encoder 2x": "rad", "encoder delay": "s", "x scale": "1"}
# parameters of the encoder's rows whose columns are lines there
_IN_ENCODER = {
    "encoder 1x": ECCENTRICITY[:2],
    "encoder 2x": ECCENTRICITY[2:],
    "encoder delay": (DELAY,),
    "x scale": ("gyro.scale_error.x",),
}


def verify(calibration: Calibration, recording: Recording, plan: Plan | None) -> Verification:
    """Compare a recording of a roll-isolated rig with what a calibration says of it.

    Parameters
    ----------
    calibration : Calibration
        By roll-isolated.
    recording : Recording
    plan : Plan
        Of the recording, with segments of either stage.

    Returns
    -------
    Verification
        Checks are amplitudes of lines; those of several components (cosine and sine, two gyros) are sizes without sign.

    Raises
    ------
    InputError
        When there is no plan, or columns are missing.
    DataError
        When signs, rates or the encoder are not as the plan says.
    """
    if plan is None:
        raise InputError("roll-isolated needs a plan (--plan) that says when the carrier spun, and how fast")
    seen = look(recording, plan)
    model, parameters = _settled(calibration, recording, plan, seen)
    lines = _Lines(model, {p.name: p.start for p in parameters}, seen)
    known, remarks = _since(calibration, recording, plan, seen)
    amplitude, covariance = lines.solve(calibration, known, parameters)
    from scipy.special import chdtrc

    chi2 = float(amplitude @ np.linalg.solve(covariance, amplitude))
    p_value = float(chdtrc(amplitude.size, chi2))
    checks = lines.checks(amplitude, covariance)
    remarks += _explained(checks, plan, calibration.values())
    remarks += _spectra(lines, seen)
    return Verification(checks, chi2, amplitude.size, p_value, p_value >= PASS, None, tuple(remarks))


def _settled(
    calibration: Calibration, recording: Recording, plan: Plan, seen: Look
) -> tuple[RollModel, tuple[Parameter, ...]]:
    """Model with the calibration's parameters, and what the new recording says of its own: spin rates, drifts."""
    parameters: tuple[Parameter, ...] = tuple(nuisances(seen, plan))
    noise, stated = first_noise(seen, plan)
    steady = steady_segments(seen, noise)
    names = tuple(p.name for p in parameters)
    repeated = {s.segment.name: s.repeated for s in seen.of("spin")}
    model = RollModel(
        recording,
        plan.segment,
        names,
        calibration.values(),
        noise,
        seen.interval,
        seen.half,
        steady,
        repeated,
        blocks=1,
    )
    parameters = settle(parameters, model.rows, max_iterations=2)
    model.rows(np.array([p.start for p in parameters]))
    found, _ = seen_noise(model, noise, stated)
    slow = slow_noise(plan, "gyro")
    if slow is None:
        return model.with_noise(found), parameters
    if stated[0]:  # what slow noise leaves over is no more white noise than was stated
        longest = max(s.count for s in seen.seen) * seen.interval
        inside = slow.mean_variance(np.array([seen.interval]), longest)[0] * seen.interval
        loud = found.gyro > _LOUD * np.sqrt(noise.gyro**2 + inside)
        found = replace(found, gyro=np.where(loud, found.gyro, noise.gyro))
    return replace(model.with_noise(found), slow=slow), parameters


def _since(calibration: Calibration, recording: Recording, plan: Plan, seen: Look) -> tuple[Array, list[str]]:
    """Covariance of the calibration at the time of a recording, whose biases slow noise has moved since, and a word on it."""
    slow, out, remarks = slow_noise(plan, "gyro"), calibration.matrix.copy(), []
    if slow is None:
        return out, []
    source = next((s for s in calibration.source if s.role == "recording"), Source(file=""))
    first, last = seen.span
    # as long as this one where nothing is said
    start, stop = (first, last) if source.start is None or source.stop is None else (source.start, source.stop)
    if not _one_clock(source, recording, first):
        start, stop = first - (stop - start), first
        remarks.append(
            "how long ago the calibration was made is not known: the slow noise that the plan states is counted as if this "
            "recording had followed at once. What a bias may have changed besides goes to unit.limits.gyro_drift"
        )
    names = list(calibration.values())
    at = [names.index(f"gyro.bias.{a}") for a in "xyz"]
    out[at, at] += moved_variance(slow, (start, stop), seen.span)
    return out, remarks


def _one_clock(source: Source, recording: Recording, now: float) -> bool:
    """Whether the times of a calibration's recording and of another can be compared: of one file, or both since an epoch."""
    if source.start is not None and min(source.start, now) > EPOCH:
        return True
    return source.sha256 is not None and recording.path is not None and source.sha256 == sha256(recording.path)


def moved_variance(slow: SlowNoise, before: tuple[float, float], now: tuple[float, float]) -> Array:
    """Variance of the difference of two means of slow noise, shape (3,).

    Of the generalised covariance R of :mod:`sagnac.calibrate.slow` and intervals I and J, the sum of the means of R(t - s) over
    I x I and J x J less twice that over I x J. These are second differences of what is R when differentiated twice,
    ``-B^2 / pi (u^2 ln |u| / 2 - 3 u^2 / 4) - K^2 |u|^3 / 12``. For two means over T seconds whose middles are D >> T apart it
    comes to ``2 B^2 / pi (ln(D / T) + 3 / 2) + K^2 (D - T / 3)``.

    Parameters
    ----------
    slow : SlowNoise
    before, now : tuple of float, s
        Begin and end of either.
    """
    flicker = walk = 0.0
    for (a, b), (c, d), times in ((before, before, 1.0), (now, now, 1.0), (before, now, -2.0)):
        u = np.abs([b - c, a - d, a - c, b - d])
        weight = times / ((b - a) * (d - c)) * np.array([1.0, 1.0, -1.0, -1.0])
        flicker -= float(weight @ (u**2 * (np.log(np.where(u > 0, u, 1.0)) / 2.0 - 0.75))) / math.pi
        walk -= float(weight @ u**3) / 12.0
    return slow.instability**2 * flicker + slow.walk**2 * walk


@dataclass(frozen=True)
class _Lines:
    """Lines of every segment as further columns of the rows."""

    model: RollModel
    values: Mapping[str, float]
    seen: Look

    def names(self) -> list[tuple[int, str, int]]:
        """Segment, line and component of each amplitude."""
        out: list[tuple[int, str, int]] = []
        for i, s in enumerate(self.model.segments):
            if s.stage == "inner":
                out += [(i, f"{axis} mean", 0) for axis in "xyz"]
                continue
            lines = {
                "y mean": 1,
                "z mean": 1,
                "spin in phase": 1,
                "spin across": 1,
                "spin backward": 2,
                "twice spin": 4,
            }
            lines |= {"encoder 1x": 2, "encoder 2x": 2}
            if s.name not in self.model.steady:
                lines |= {"y swing": 1, "z swing": 1, "encoder delay": 1, "x scale": 1}
            out += [(i, line, c) for line, count in lines.items() for c in range(count)]
        return out

    def columns(self, piece: Piece) -> dict[str, Channel]:
        """Columns of the lines in the channels of a piece; the residual falls by what a line explains."""
        if piece.roll_rate is None or piece.angle is None:
            one = -np.ones((1, piece.time.size))
            sigma = self.model.noise.gyro / math.sqrt(self.model.interval)
            return {a: ((_key(piece.segment, f"{a} mean", 0),), one / s) for a, s in zip("xyz", sigma, strict=True)}
        along = self._across(piece, piece.roll_rate, piece.angle)
        out = {}
        for i, axis in enumerate("yz"):
            names = tuple(_key(piece.segment, *n) for n in along)
            out[axis] = names, -np.stack([v[i] for v in along.values()]) / piece.sigma[i]
        names, rows = piece.channels["encoder"]
        own = {
            _key(piece.segment, line, c): rows[names.index(n)]
            for line, parameters in _IN_ENCODER.items()
            for c, n in enumerate(parameters)
        }
        out["encoder"] = tuple(own), np.stack(list(own.values()))
        return out

    def _across(self, piece: Piece, roll_rate: Array, angle: Array) -> dict[tuple[str, int], tuple[Array, Array]]:
        """Lines on y and z, each with its column on both."""
        seen = self.seen.seen[piece.segment]
        phase = angle + self.model.values(np.zeros(len(self.model.names)))[PHASE]
        c, s, c2, s2 = np.cos(phase), np.sin(phase), np.cos(2 * phase), np.sin(2 * phase)
        one, none = np.ones(angle.size), np.zeros(angle.size)
        # scaled to the amplitude of a sinusoidal swing, so that the line has its size
        swing = (roll_rate - float(seen.mean[0])) / max(math.sqrt(2.0 * seen.swing_variance), 1e-300)
        out = {
            ("y mean", 0): (one, none),
            ("z mean", 0): (none, one),
            ("y swing", 0): (swing, none),
            ("z swing", 0): (none, swing),
            ("spin in phase", 0): (c, s),
            ("spin across", 0): (-s, c),
            ("spin backward", 0): (c, -s),
            ("spin backward", 1): (s, c),
        }
        return out | {("twice spin", k): v for k, v in enumerate(((c2, s2), (-s2, c2), (c2, -s2), (s2, c2)))}

    def solve(self, calibration: Calibration, known: Array, parameters: tuple[Parameter, ...]) -> tuple[Array, Array]:
        """Amplitudes of the lines with their covariance, which contains the calibration's, `known`."""
        lines = [_key(*n) for n in self.names()]
        own = [p.name for p in parameters]
        names = (*lines, *own, *calibration.values())
        fixed = {**dict.fromkeys(lines, 0.0), **calibration.values()}
        model = replace(self.model, names=names, further=self.columns, _left={})
        x = np.array([0.0] * len(lines) + [p.start for p in parameters] + [fixed[n] for n in calibration.values()])
        rows = model.rows(x)
        m, k = len(lines), len(own)
        # errors of the calibration in units of their own standard deviations; fixed ones have none
        size, axes = np.linalg.eigh(known / np.outer(*[_scale(calibration)] * 2))
        half = _scale(calibration)[:, None] * axes * np.sqrt(np.maximum(size, 0.0))
        prior = np.array([p.prior_sigma for p in parameters])
        design = np.hstack([rows.jacobian[:, : m + k], rows.jacobian[:, m + k :] @ half])
        weights = np.concatenate([np.zeros(m), 1.0 / prior, np.ones(half.shape[1])])
        offset = np.concatenate([np.zeros(m), [p.start / s for p, s in zip(parameters, prior, strict=True)]])
        stacked = np.vstack([design, np.diag(weights)[weights > 0]])
        right = np.concatenate([rows.residual, np.append(offset, np.zeros(half.shape[1]))[weights > 0]])
        weight = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
        q, r = np.linalg.qr(stacked / weight)
        inverse = np.linalg.inv(r) / weight[:, None]
        solution = -inverse @ (q.T @ right)
        if not np.all(np.isfinite(solution)):
            raise DataError("the recording does not determine its own spin rates; nothing can be compared")
        return solution[:m], (inverse @ inverse.T)[:m, :m]

    def checks(self, amplitude: Array, covariance: Array) -> tuple[Check, ...]:
        """One check a line."""
        found: dict[tuple[int, str], list[int]] = {}
        for i, (segment, line, _) in enumerate(self.names()):
            found.setdefault((segment, line), []).append(i)
        out = []
        for (segment, line), at in found.items():
            here, own = amplitude[at], covariance[np.ix_(at, at)]
            value = float(here[0]) if len(at) == 1 else float(np.linalg.norm(here))
            sigma = math.sqrt(float(np.trace(own)))  # of a size: its root mean square
            out.append(Check(self.model.segments[segment].name, line, value, sigma, _UNITS.get(line, "rad/s")))
        return tuple(out)


def _key(segment: int, line: str, component: int) -> str:
    return f"line.{segment}.{line}.{component}"


def _scale(calibration: Calibration) -> Array:
    sigma = np.array([p.standard_uncertainty for p in calibration.parameters])
    return np.where(sigma > 0, sigma, 1.0)


def _explained(checks: tuple[Check, ...], plan: Plan, values: Mapping[str, float]) -> list[str]:
    """What the lines that stand out mean."""
    out = []
    spins = {s.name: s.spin_rate for s in plan.segment}
    for c in checks:
        if abs(c.z) < _NOTED:
            continue
        cause = CAUSES.get(c.what) or CAUSES[c.what.rpartition(" ")[2]]
        size, _, unit = printed(c.residual, abs(c.residual) / 30, c.unit)
        spin = spins[c.segment]
        where = {"spin": 1.0, "twice": 2.0}.get(c.what.split()[0])
        at = "" if where is None else f" at {abs(spin) * where / (2 * math.pi):.4g} Hz"
        text = f"segment {c.segment!r}, {c.what}: {size} {unit}{at}, {abs(c.z):.3g} standard uncertainties: {cause}"
        across = spin * math.sin(values.get(HALF_ANGLE, 0.0))
        if c.what == "spin across" and across:
            text += f" ({math.degrees(c.residual / across):.3g} deg)"
        if c.what == "spin in phase":
            text += f" ({math.degrees(c.residual / spin):.2g} deg)"
        out.append(text)
    return out


def _spectra(lines: _Lines, seen: Look) -> list[str]:
    """Lines of the residual spectra of y and z, named, segment by segment."""
    sums: dict[int, tuple[SpectrumSums, SpectrumSums]] = {}
    for piece in lines.model.pieces(lines.model.values(np.array(list(lines.values.values())))):
        if piece.roll_rate is None:
            continue
        count = seen.seen[piece.segment].count
        pair = sums.setdefault(
            piece.segment, (SpectrumSums.fitting(count, seen.interval), SpectrumSums.fitting(count, seen.interval))
        )
        pair[0].add(np.stack([piece.channels[a][1][-1] * s for a, s in zip("yz", piece.sigma, strict=True)], axis=-1))
        pair[1].add(piece.roll_rate[:, None])
    out = []
    for at, (across, roll) in sums.items():
        segment, result, rolled = lines.model.segments[at], across.result(), roll.result()
        if result is None or rolled is None:
            continue
        spin = abs(segment.spin_rate) / (2.0 * math.pi)
        known = {
            "spin (cone, or the encoder's angle)": folded(spin, seen.interval),
            "twice spin (eccentricity of the encoder)": folded(2.0 * spin, seen.interval),
        }
        if segment.name not in lines.model.steady:
            swings = [line for line in find_lines(rolled, 0, {}) if line.frequency > 0]
            known |= _with_swing(spin, max(swings, key=lambda line: line.amplitude).frequency, seen) if swings else {}
        for channel, axis in enumerate("yz"):
            out += [
                f"segment {segment.name!r}, residual spectrum of gyro_{axis}: {math.degrees(line.amplitude):.3g} deg/s at "
                f"{line.frequency:.4g} Hz, {line.loudness:.3g} times the noise: "
                f"{line.name or 'no line of the model, so vibration or a disturbance'}"
                for line in find_lines(result, channel, known)
                if line.frequency > 0
            ]
    return out


def _with_swing(spin: float, swing: float, seen: Look) -> dict[str, float]:
    """Lines that a swing makes, alone and with the cone."""
    return {
        "swing (mounting angles)": swing,
        "spin less swing (delay of the encoder)": folded(spin - swing, seen.interval),
        "spin and swing (delay of the encoder)": folded(spin + swing, seen.interval),
    }
