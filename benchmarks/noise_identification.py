"""Coefficients of noise against their bounds: 200 simulated logs of each of four sensors, ours and as ordinary tools do.

Run by hand with ``python noise_identification.py``; ``python noise_identification.py 40 laser`` takes 40 logs of the sensors
with that in their names. Errors are root mean squares of relative errors, over two bounds: Cramer-Rao (of the whole record, by
any method) and that of generalised least squares of the Allan variances at octaves. A coefficient that is not found counts as
zero. What ordinary tools do: N read at 1 s, B at the lowest point, Q at the shortest time, K and R on slopes through the longest;
and a fit of all terms to the logarithms of the variances, unweighted, started at the truth.
"""

from __future__ import annotations

import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from scipy.optimize import least_squares

from sagnac import units
from sagnac.noise.curves.allan import Variances, octaves, variances
from sagnac.noise.identification import bound
from sagnac.noise.identification.identify import deviations, identify
from sagnac.noise.identification.terms import FLOOR, TERMS, level
from sagnac.noise.identification.terms import units as units_of
from sagnac.noise.requirement import requirement
from sagnac.simulate.noise import AxisNoise, NoiseModel

SAMPLES = 1 << 20
CASES = {  # sensor, interval [s], coefficients in datasheet units
    "MEMS gyro, 100 Hz, 2.9 h": (
        "gyro",
        0.01,
        {"quantisation": 1.2, "white": 0.3, "instability": 8.0, "walk": 100.0},
    ),
    "ring laser gyro, 10 Hz, 29 h": ("gyro", 0.1, {"quantisation": 0.5, "white": 0.003, "instability": 0.01}),
    "accelerometer, 100 Hz, 2.9 h": ("accel", 0.01, {"white": 100.0, "markov": 80.0, "markov_time": 10.0}),
    "drifting gyro, 10 Hz, 29 h": ("gyro", 0.1, {"white": 0.003, "instability": 0.01, "ramp": 0.02}),
}


def coefficients(sensor, given):
    out = {}
    for key, size in given.items():
        inside, sheet = units_of(key, sensor)
        out[key] = size if key == "markov_time" else size / units.convert(1.0, inside, sheet)
    return out


def samples(truth, interval, seed, count=SAMPLES):
    """A log by the package's simulator; flicker noise over a band that is wider than the log at both ends."""
    markov = ((truth["markov"], truth["markov_time"]),) if "markov" in truth else ()
    model = NoiseModel(
        truth.get("white", 0.0),
        truth.get("instability", 0.0),
        (0.5 * interval, 10.0 * count * interval),
        truth.get("walk", 0.0),
        markov,
    )
    out = np.zeros(count)
    AxisNoise(model, interval, seed, (0,)).add(out)
    residues = np.random.default_rng([seed, 1]).standard_normal(count + 1) * truth.get("quantisation", 0.0)
    out += np.diff(residues) / interval
    out += truth.get("ramp", 0.0) * interval * np.arange(count)
    return out


def read_off(v, names):
    """What tools read off the plot."""
    deviation, tau = v.deviation[:, 0], v.tau
    out = {
        "white": float(np.exp(np.interp(0.0, np.log(tau), np.log(deviation)))),
        "instability": float(deviation.min()) / FLOOR,
        "quantisation": float(deviation[0]) * tau[0] / math.sqrt(3.0),
        "walk": float(deviation[-1] * math.sqrt(3.0 / tau[-1])),
        "ramp": float(deviation[-1] * math.sqrt(2.0) / tau[-1]),
    }
    return {key: out.get(key, math.nan) for key in names}


def least(v, truth, interval):
    """Unweighted least squares of the logarithms, started at the truth."""
    keys = list(truth)
    start = np.log([truth[k] for k in keys])
    logs = np.log(v.variance[:, 0])

    def off(p):
        parts = deviations(dict(zip(keys, np.exp(p), strict=True)), v.tau, interval)
        return np.log(sum(d**2 for d in parts.values())) - logs

    return dict(zip(keys, np.exp(least_squares(off, start, bounds=(start - 15, start + 15)).x), strict=True))


def one(task):
    truth, interval, seed, count = task
    dense = variances(samples(truth, interval, seed, count), interval, octaves(count, per_octave=5))
    # octaves are among the fifths of octaves
    pick = np.isin(dense.factors, octaves(count))
    v = Variances("allan", interval, count, dense.factors[pick], dense.variance[pick], dense.count[pick], "exact")
    spent = time.perf_counter()
    got = identify(v)
    spent = time.perf_counter() - spent
    found = {c.key: (c.value, c.lower <= truth.get(c.key, 0.0) <= c.upper) for c in got.coefficients}
    return found, got.p_value, read_off(dense, truth), least(dense, truth, interval), spent


def study(truth, interval, runs, pool, count=SAMPLES):
    """Root mean square errors over the Cramer-Rao bound, and the rest of the table, by coefficient."""
    results = list(pool.map(one, [(truth, interval, seed, count) for seed in range(runs)]))
    decay = interval / truth["markov_time"] if "markov" in truth else 0.0
    names, told = bound.information({k: level(k, x, interval) for k, x in truth.items() if k in TERMS}, count, decay)
    best = dict(zip(names, np.sqrt(np.diag(np.linalg.inv(told))), strict=True))
    ours = requirement(truth, interval, np.array([count * interval]))
    rows = []
    for key, true in truth.items():
        limit = best[key] * (1.0 if key == "markov_time" else 0.5)
        found = [r[0].get(key, (0.0, False)) for r in results]
        errors = [np.array([f[0] for f in found]), *(np.array([r[i][key] for r in results]) for i in (2, 3))]
        rms = [float(np.sqrt(np.mean((e / true - 1.0) ** 2))) for e in errors]
        rows.append(
            (
                key,
                limit,
                float(ours.relative[0, ours.keys.index(key)]),
                rms,
                float(np.mean([key in r[0] for r in results])),
                float(np.mean([f[1] for f in found])),
            )
        )
    wrong = float(np.mean([bool(set(r[0]) - set(truth)) for r in results]))
    poor = float(np.mean([r[1] < 0.05 for r in results]))
    return rows, wrong, poor, float(np.median([r[4] for r in results]))


def main():
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print(f"{runs} logs of {SAMPLES} samples each; errors over the Cramer-Rao bound (and over that of least squares)")
    head = ("coefficient", "bound", "ours", "coverage", "found", "read off", "log-log fit")
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    wanted = sys.argv[2] if len(sys.argv) > 2 else ""
    with ProcessPoolExecutor(2) as pool:
        for name, (sensor, interval, given) in CASES.items():
            if wanted not in name:
                continue
            rows, wrong, poor, spent = study(coefficients(sensor, given), interval, runs, pool)
            print(f"| {name} | | | | | | |")
            for key, limit, own, rms, seen, cover in rows:
                print(
                    f"| {key} {given[key]:g} {units_of(key, sensor)[1]} | {100 * limit:.2f} % "
                    f"| {rms[0] / limit:.2f} ({rms[0] / own:.2f}) | {100 * cover:.1f} % | {100 * seen:.1f} % "
                    f"| {rms[1] / limit:.1f} | {rms[2] / limit:.1f} |"
                )
            print(
                f"| (a term too many: {100 * wrong:.1f} %; p < 0.05: {100 * poor:.1f} %; {spent:.2f} s each) "
                "| | | | | | |",
                flush=True,
            )


if __name__ == "__main__":
    main()
