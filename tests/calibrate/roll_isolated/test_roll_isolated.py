"""Roll-isolated calibration: exact on clean data, at the bound on noisy data, derivatives, refusals with their reason."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sagnac.calibrate import calibrate
from sagnac.calibrate.roll_isolated import _parameters, first_noise, steady_segments
from sagnac.calibrate.roll_isolated.model import RollModel
from sagnac.calibrate.roll_isolated.start import closed_form, look
from sagnac.errors import DataError, InputError
from sagnac.plan import Limits, Noise
from sagnac.recording import from_arrays
from sagnac.rigs.roll_isolated import DELAY, ECCENTRICITY, HALF_ANGLE, MOUNT_PITCH, MOUNT_YAW, PHASE
from sagnac.simulate.roll_isolated import (
    BIAS_STABILITY,
    DENSITY,
    PARAMETERS,
    PUBLISHED,
    published_plan,
    recording_of,
    simulate,
)

DEG = math.pi / 180
TRUTH = PUBLISHED | {
    DELAY: 1e-3,
    "gyro.bias.x": 1.5e-4,
    "gyro.bias.y": -1e-4,
    "gyro.scale_error.x": 2e-3,
    ECCENTRICITY[0]: 0.1 * DEG,
    ECCENTRICITY[3]: -0.05 * DEG,
}


def short(**options):
    return published_plan(**({"hold": 5.0, "move": 1.0} | options))


def changed(plan, rig=None, **unit):
    return plan.model_copy(
        update={
            "rig": plan.rig.model_copy(update=rig or {}),
            "unit": plan.unit.model_copy(update=unit),
        }
    )


def log(plan, truth=TRUTH, seed=1, **options):
    return recording_of(simulate(plan, truth, np.random.default_rng(seed), **({"frequency": 500.0} | options)))


def edited(recording, change):
    """The same recording with time, gyro and encoder changed."""
    b = recording.read()
    time, gyro, encoder = change(b.time.copy(), b.gyro.copy(), b.rig["encoder"].copy())
    return from_arrays(time, gyro=gyro, rig={} if encoder is None else {"encoder": encoder})


def misses(calibration, truth=TRUTH):
    """Errors in standard uncertainties."""
    return {
        p.name: (p.value - truth.get(p.name, 0.0)) / p.standard_uncertainty
        for p in calibration.parameters
        if p.standard_uncertainty > 0
    }


# -------------------------------------------------------------------------------------------------- values


def test_clean_data_give_the_truth():
    """No noise, no rounding, no Earth rate.

    What is left: the local quadratic's error in the swing, 2e-5 of it, which shows in delay and phase; and in the half-angle,
    which only the prior of 1 % keeps from trading against the scales of y and z, a hundredth of its uncertainty.
    """
    plan = changed(short(), {"encoder_resolution": 0.0, "rate_uncertainty": 0.0}, noise=Noise(), limits=Limits())
    cal = calibrate("roll-isolated", log(plan, density=0.0, encoder_bits=None, earth=(0.0, 0.0, 0.0)), plan)
    for name, limit in {
        MOUNT_YAW: 1e-7, MOUNT_PITCH: 1e-7, HALF_ANGLE: 1e-6, PHASE: 2e-5, DELAY: 1e-7, "gyro.bias.x": 1e-9, "gyro.bias.y": 1e-7,
        "gyro.bias.z": 1e-7, "gyro.scale_error.x": 1e-6, **dict.fromkeys(ECCENTRICITY, 1e-7),
    }.items():  # fmt: skip
        assert abs(cal[name].value - TRUTH.get(name, 0.0)) < limit, name


def test_published_case():
    """[ZHANG15]: angles to a hundredth of a degree, delay of 1 ms to 10 us with a 14 bit encoder and 60 s segments."""
    plan = published_plan()
    cal = calibrate("roll-isolated", log(plan, frequency=1000.0, drift=BIAS_STABILITY), plan)
    for name in (MOUNT_YAW, MOUNT_PITCH, HALF_ANGLE):
        assert abs(cal[name].value - TRUTH[name]) < 0.005 * DEG
    assert abs(cal[PHASE].value - TRUTH[PHASE]) < 0.1 * DEG
    assert abs(cal[DELAY].value - 1e-3) < 10e-6
    assert cal[DELAY].standard_uncertainty < 5e-6
    assert max(abs(z) for z in misses(cal).values()) < 3.5
    assert cal.fit.p_value > 0.01
    assert set(cal.values()) == set(PARAMETERS)
    # gravity plays no part, and is that of the site
    assert "WGS-84" in cal.site.gravity_source


def test_closed_form_of_the_publication():
    """Its two stages, with an encoder that is perfect: 0.001 deg in the angles."""
    plan = short(encoder_delay=0.0)
    found = closed_form(look(log(plan, PUBLISHED), plan))
    for name in (MOUNT_YAW, MOUNT_PITCH, HALF_ANGLE):
        assert abs(found[name] - PUBLISHED[name]) < 1e-3 * DEG
    assert abs(found[PHASE] - PUBLISHED[PHASE]) < 0.1 * DEG


@pytest.mark.parametrize(
    ("truth", "options"),
    [
        ({DELAY: 20e-3}, {}),
        ({DELAY: -5e-3}, {}),
        ({ECCENTRICITY[0]: 2 * DEG}, {}),
        ({HALF_ANGLE: 3 * DEG, MOUNT_YAW: 5 * DEG, MOUNT_PITCH: -4 * DEG}, {}),
        ({PHASE: 179.99 * DEG}, {}),
        ({}, {"spins": (-6480.0,)}),
        ({}, {"spins": (6480.0, -3000.0)}),
    ],
)
def test_other_rigs(truth, options):
    plan = short(**options)
    errors = misses(calibrate("roll-isolated", log(plan, TRUTH | truth), plan), TRUTH | truth)
    errors[PHASE] = math.remainder(errors[PHASE], 2 * math.pi / 2e-3)
    assert max(abs(z) for z in errors.values()) < 4.0


def test_two_speeds_tell_delay_from_phase_without_a_swing():
    plan = short(spins=(6480.0, 3111.0))
    cal = calibrate("roll-isolated", log(plan, swing_amplitude=0.0), plan)
    assert max(abs(z) for z in misses(cal).values()) < 4.0
    assert cal[DELAY].standard_uncertainty < 5e-5


def test_a_stated_delay_is_kept():
    plan = short(encoder_delay=1e-3)
    cal = calibrate("roll-isolated", log(plan, swing_amplitude=0.0), plan)
    assert cal[DELAY].value == 1e-3
    assert cal[DELAY].standard_uncertainty == 0.0
    assert max(abs(z) for z in misses(cal).values()) < 4.0
    assert len(cal.fit.white) == len(cal.parameters)


def test_a_stated_delay_that_the_swing_contradicts_is_noted():
    plan = short(encoder_delay=0.0)
    cal = calibrate("roll-isolated", log(plan), plan)
    note = next(r for r in cal.remarks if "swing shows" in r)
    assert "read 1.0" in note or "read 0.9" in note
    assert "plan states 0 ms" in note


def test_noise_and_step_are_found_where_the_plan_states_none():
    stated, silent = short(), changed(short(), {"encoder_resolution": 0.0}, noise=Noise())
    first, second = (calibrate("roll-isolated", log(stated), p) for p in (stated, silent))
    for a, b in zip(first.parameters, second.parameters, strict=True):
        assert abs(a.value - b.value) < 0.2 * a.standard_uncertainty
        assert b.standard_uncertainty == pytest.approx(a.standard_uncertainty, rel=0.1)


def test_noise_stated_far_too_small_gives_way():
    plan = changed(short(), {"encoder_resolution": 2 * math.pi / 2**18}, noise=Noise(gyro=DENSITY / 4))
    cal = calibrate("roll-isolated", log(short()), plan)
    assert any("times the noise stated" in r for r in cal.remarks)
    assert any("rig.encoder_resolution" in r for r in cal.remarks)
    right = calibrate("roll-isolated", log(short()), short())
    for a, b in zip(cal.parameters, right.parameters, strict=True):
        assert a.standard_uncertainty == pytest.approx(b.standard_uncertainty, rel=0.1)


def test_earth_rate_is_in_the_uncertainty_of_the_bias():
    plan = changed(short(), limits=Limits(gyro_scale=0.01))
    cal = calibrate("roll-isolated", log(plan), plan)
    # a component of a vector of unknown direction
    assert cal["gyro.bias.x"].standard_uncertainty > plan.earth_rate / math.sqrt(3)
    without = calibrate(
        "roll-isolated", log(plan, earth=(0.0, 0.0, 0.0)), plan.model_copy(update={"earth_rate": 1e-15})
    )
    assert without["gyro.bias.x"].standard_uncertainty < 0.6 * cal["gyro.bias.x"].standard_uncertainty


def test_what_the_plan_does_not_state_is_noted():
    plan = changed(short(), {"rate_uncertainty": 0.0, "angle_uncertainty": 1e-3}, limits=Limits())
    remarks = " ".join(calibrate("roll-isolated", log(plan), plan).remarks)
    for key in ("gyro_scale", "gyro_drift", "rate_uncertainty", "angle_uncertainty"):
        assert key in remarks


def test_the_rate_axis_of_the_inner_stage():
    """A cylinder askew on the rate table shows as a mounting angle; the plan's axis_uncertainty is then in it."""
    plan = changed(short(), {"axis_uncertainty": 0.01})
    cal = calibrate("roll-isolated", log(plan), plan)
    plain = calibrate("roll-isolated", log(plan), short())
    for name in (MOUNT_YAW, MOUNT_PITCH):  # the swing in the spin stage still sees them
        assert cal[name].standard_uncertainty > 1.2 * plain[name].standard_uncertainty
    assert max(abs(z) for z in misses(cal).values()) < 4.0


def test_no_cone_is_no_failure():
    cal = calibrate("roll-isolated", log(short(), TRUTH | {HALF_ANGLE: 0.0}), short())
    assert any("no larger than its uncertainty" in r for r in cal.remarks)
    assert 0 <= cal[HALF_ANGLE].value < 4 * cal[HALF_ANGLE].standard_uncertainty


def test_gaps_are_bridged():
    def cut(t, g, e):
        keep = ((t < 14.0) | (t > 14.4)) & ((t < 2.0) | (t > 2.05))
        return t[keep], g[keep], e[keep]

    cal = calibrate("roll-isolated", edited(log(short()), cut), short())
    assert max(abs(z) for z in misses(cal).values()) < 4.0
    assert cal.fit.p_value > 0.01


def test_slow_disturbances_count():
    """A bias that swings by 0.05 deg/s in 3 s is no white noise: parts of the segment disagree, and the uncertainty says so."""

    def wander(t, g, e):
        g[:, 1] += 0.05 * DEG * np.sin(2 * np.pi * t / 3)
        return t, g, e

    plan = published_plan(hold=10.0, move=1.0)
    plain = calibrate("roll-isolated", log(plan), plan)
    cal = calibrate("roll-isolated", edited(log(plan), wander), plan)
    assert cal.fit.p_value < 1e-6
    assert cal.fit.uncertainty == "delete-one-segment"
    assert cal["gyro.bias.y"].standard_uncertainty > plain["gyro.bias.y"].standard_uncertainty


def test_robust_turns_down_a_disturbed_part():
    def knock(t, g, e):
        g[(t > 15.0) & (t < 15.3), 1:] += 2 * DEG
        return t, g, e

    recording = edited(log(short()), knock)
    plain, robust = (calibrate("roll-isolated", recording, short(), robust=r) for r in (False, True))
    for name in (HALF_ANGLE, "gyro.bias.y", "gyro.bias.z"):
        assert abs(robust[name].value - TRUTH.get(name, 0.0)) <= abs(plain[name].value - TRUTH.get(name, 0.0))
    assert max(abs(z) for z in misses(robust).values()) < 5.0


def test_rounding_that_repeats_itself_is_noted():
    """3000 deg/s at 500 Hz: 60 readings a turn, the same ones in every turn; their errors do not average out."""
    plan = short(spins=(3000.0,), encoder_delay=0.0)
    truth = PUBLISHED | {HALF_ANGLE: 0.0}  # which would let the encoder turn a trifle more slowly than the carrier
    cal = calibrate("roll-isolated", log(plan, truth, swing_amplitude=0.0), plan)
    assert any("stands on 60 of its steps only" in r for r in cal.remarks)
    assert max(abs(misses(cal, truth)[n]) for n in ECCENTRICITY) < 4.0
    # 60 rounding errors of step / sqrt(12): sqrt(2 / 60) of that in a harmonic
    floor = plan.rig.encoder_resolution / math.sqrt(12) * math.sqrt(2 / 60)
    assert cal[ECCENTRICITY[2]].standard_uncertainty == pytest.approx(floor, rel=0.2)


def test_the_pieces_that_a_recording_comes_in_do_not_matter():
    whole = log(short(), chunk=1 << 20)
    batches = list(simulate(short(), TRUTH, np.random.default_rng(1), frequency=500.0, chunk=333))
    from dataclasses import replace

    pieces = replace(whole, _stream=lambda _: iter(batches))
    first, second = (calibrate("roll-isolated", r, short()) for r in (whole, pieces))
    for a, b in zip(first.parameters, second.parameters, strict=True):
        assert abs(a.value - b.value) < 1e-4 * a.standard_uncertainty


# ------------------------------------------------------------------------------------------------ derivatives


def model_of(plan, truth, **options):
    recording = log(plan, truth, **options)
    seen = look(recording, plan)
    noise, _ = first_noise(seen, plan)
    parameters = _parameters(seen, plan)
    names = tuple(p.name for p in parameters)
    model = RollModel(
        recording, plan.segment, names, {}, noise, seen.interval, seen.half, steady_segments(seen, noise), {}, blocks=4
    )
    start = np.array([truth.get(p.name, p.start) for p in parameters])
    return model, parameters, start


@pytest.mark.parametrize("truth", [TRUTH, TRUTH | {HALF_ANGLE: 3 * DEG, MOUNT_YAW: 5 * DEG, MOUNT_PITCH: -4 * DEG}])
def test_derivatives_of_all_rows_to_all_parameters(truth):
    """Central differences of 1e-4 of what matters; of the eccentricity a product of three angles is left out."""
    plan = changed(published_plan(hold=1.0, move=0.5), {"axis_uncertainty": 1e-3})
    model, parameters, x = model_of(plan, truth, frequency=200.0)

    def channels(x):
        return {
            (p.segment, p.time[0], c): rows for p in model.pieces(model.values(x)) for c, rows in p.channels.items()
        }

    base = channels(x)
    for i, p in enumerate(parameters):
        step = np.where(np.arange(x.size) == i, 1e-5 if p.name == PHASE else 1e-4 * p.scale, 0.0)
        up, down = channels(x + step), channels(x - step)
        for key, (names, rows) in base.items():
            numeric = (up[key][1][-1] - down[key][1][-1]) / (2 * step[i])
            ours = rows[names.index(p.name)] if p.name in names else np.zeros_like(numeric)
            size = max(np.abs(numeric).max(), 1e-3 / p.scale)
            left_out = 10 * abs(truth[MOUNT_PITCH] * truth[HALF_ANGLE]) if p.name in ECCENTRICITY else 0.0
            assert np.abs(numeric - ours).max() < (2e-4 + left_out) * size, (p.name, key)


def test_reduced_rows_keep_all_information():
    """Estimate and information of the reduced rows against all rows one under the other."""
    model, _, x = model_of(published_plan(hold=1.0, move=0.5), TRUTH, frequency=200.0)
    rows = model.rows(x)
    information, gradient, squares = np.zeros((x.size, x.size)), np.zeros(x.size), 0.0
    for p in model.pieces(model.values(x)):
        for names, values in p.channels.values():
            jac = np.zeros((values.shape[1], x.size))
            for k, n in enumerate(names):
                if n in model.names:
                    jac[:, model.names.index(n)] = values[k]
            information += jac.T @ jac
            gradient += jac.T @ values[-1]
            squares += values[-1] @ values[-1]
    scale = np.sqrt(np.diag(information))
    np.testing.assert_allclose(
        rows.jacobian.T @ rows.jacobian / np.outer(scale, scale), information / np.outer(scale, scale), atol=1e-9
    )
    np.testing.assert_allclose(
        rows.jacobian.T @ rows.residual / scale, gradient / scale, atol=1e-8 * math.sqrt(squares)
    )
    assert rows.residual @ rows.residual + rows.left == pytest.approx(squares, rel=1e-10)
    assert sum(dof for _, dof in model.left().values()) + rows.residual.size == sum(
        v.shape[1] for p in model.pieces(model.values(x)) for _, v in p.channels.values()
    )


# --------------------------------------------------------------------------------------------------- refusals


def refused(plan, change=None, match="", error=DataError, truth=TRUTH, run=None, **options):
    recording = log(run or plan, truth, **options)
    with pytest.raises(error, match=match):
        calibrate("roll-isolated", recording if change is None else edited(recording, change), plan)


def with_segments(plan, which=slice(None), **update):
    segments = [s.model_copy(update=update.get(s.name.replace(" ", "_"), {})) for s in plan.segment[which]]
    return plan.model_copy(update={"segment": tuple(segments)})


def test_a_missing_stage_is_named():
    plan = short()
    refused(with_segments(plan, slice(2, 3)), match='no segment of stage = "inner"', run=plan)
    refused(with_segments(plan, slice(0, 2)), match='no segment of stage = "spin"', run=plan)


def test_one_sense_of_the_inner_stage_is_named_with_what_it_confounds():
    plan = short()
    refused(
        with_segments(plan, slice(0, 3, 2)),
        match=r"one sense only.*gyro\.bias\.y and rig\.mount_pitch, gyro\.bias\.z and rig\.mount_yaw",
        run=plan,
    )


def test_delay_and_phase_that_cannot_be_told_apart_are_named():
    refused(short(), match=r"rig\.cone_phase - 6480 deg/s \* rig\.encoder_delay", swing_amplitude=0.0)
    refused(short(spins=(6480.0, 6500.0)), match=r"cannot tell the two apart", swing_amplitude=0.0)


def test_wrong_signs_are_named():
    def flip(t, g, e, which):
        if which == "encoder":
            return t, g, np.mod(-e, 2 * math.pi)
        g[:, "xyz".index(which)] *= -1
        return t, g, e

    plan = short()
    refused(plan, lambda *a: flip(*a, "encoder"), "encoder counts the other way: it turns at -6")
    refused(plan, lambda *a: flip(*a, "x"), "wrong sign of inner_rate, or of the gyro_x column")
    refused(plan, lambda *a: flip(*a, "y"), "turns against the encoder: gyro_y and gyro_z")
    refused(with_segments(plan, spin_1={"spin_rate": -6480 * DEG}), match="wrong sign of spin_rate$", run=plan)
    refused(
        with_segments(plan, spin_1={"spin_rate": -6480 * DEG}),
        match="spin_rate, or the encoder",
        run=plan,
        swing_amplitude=0.0,
    )
    both = short(spins=(-6480.0,))
    refused(plan, lambda *a: flip(*a, "encoder"), "both spin_rate and the encoder", run=both)
    turned = {"inner_+": {"inner_rate": -280 * DEG}}
    refused(with_segments(plan, **turned), match="wrong sign of inner_rate", run=plan)


def test_wrong_columns_units_and_rates_are_named():
    plan = short()
    refused(plan, lambda t, g, e: (t, g[:, [1, 0, 2]], e), "gyro_y sees most of it, not gyro_x")
    refused(plan, lambda t, g, e: (t, np.degrees(g), e), r"unit is deg/s, not rad/s")
    refused(plan, lambda t, g, e: (t, np.radians(g), e), r"unit is rad/s, not deg/s")
    refused(plan, lambda t, g, e: (t, 1.4 * g, e), r"check unit, scale, inner_rate")
    refused(
        with_segments(plan, spin_1={"spin_rate": 6000 * DEG}),
        match="spin_rate is 6000 deg/s, but the encoder",
        run=plan,
    )
    refused(plan, lambda t, g, e: (t, g, None), "needs the column 'encoder", InputError)
    refused(plan, lambda t, g, e: (t, g[:, [0, 2, 1]], e), "gyro_z are swapped")

    def quiet_in_spin(t, g, e):
        g[t > 13, 0] *= 0.3
        return t, g, e

    refused(plan, quiet_in_spin, r"changes its rate by -3\.\d+ deg/s where -1")


def test_encoder_that_jumps_is_named_with_time_and_row():
    def jump(t, g, e):
        return t, g, np.mod(e + np.where(t > 15.0, 3 * DEG, 0.0), 2 * math.pi)

    def stuck(t, g, e):
        e[7600:7604] = e[7600]
        return t, g, e

    refused(short(), jump, r"encoder jumps by 3(\.\d+)? deg .* at 15\.002 s \(row 7501\)")
    refused(short(), stuck, r"encoder jumps by .* \(row 760\d\)")


def test_turns_too_few_or_too_fast_to_count_are_refused():
    refused(short(spins=(180.0,)), match=r"2\.\d turns of the carrier are too few")
    refused(short(), match=r"makes 0\.9 turns from sample to sample", frequency=20.0)


def test_segments_outside_the_data_and_other_rigs_are_refused():
    refused(short(hold=20.0), match="holds samples from|holds no sample", run=short(hold=2.0))
    refused(short(), lambda t, g, e: (t[:100], g[:100], e[:100]), match="holds no sample|only in")
    plan = short()
    empty = plan.model_copy(update={"segment": ()})
    refused(empty, match=r"no \[\[segment\]\]", run=plan)
    table = changed(plan).model_copy(update={"rig": type(plan.rig)(), "segment": ()})
    refused(table, match="roll-isolated", error=InputError, run=plan)


def test_a_delay_out_of_reach_is_refused():
    refused(short(), truth=TRUTH | {DELAY: 40e-3}, match="more than the 25 ms")


def test_a_saturated_gyro_is_refused():
    refused(short(), match=r"gyro_x stands at 270 deg/s through segment 'inner \+'", full_scale=270 * DEG)


# -------------------------------------------------------------------------------------------------- statistics


@pytest.mark.statistical
def test_estimates_reach_the_bound_and_intervals_hold():
    """1000 runs of 3 s segments at 100 Hz.

    Biases, scales, delay, eccentricity, swing, Earth rate, drift and the rates' own error are drawn anew each time, as the plan
    states them. RMSE over bound: sampling error 2.2 %, so 1.08 is 3.6 of them. Coverage: 0.7 %. The squared error weighed with
    the stated covariance is chi-square of 15 degrees of freedom: its mean over 1000 runs is known to 0.17, the band is 3.3.
    """
    plan = published_plan(hold=3.0, move=0.5)
    errors, sigmas, white, squares, p_values = [], [], [], [], []
    for k in range(1000):
        rng = np.random.default_rng(5000 + k)
        truth = PUBLISHED | {"gyro.scale_error.x": 2e-3, DELAY: rng.normal(1e-3, 3e-4)}
        truth |= {f"gyro.bias.{a}": 3 * BIAS_STABILITY * rng.standard_normal() for a in "xyz"}
        truth |= {f"gyro.scale_error.{a}": 0.01 * rng.standard_normal() for a in "yz"}
        truth |= {n: 0.05 * DEG * rng.standard_normal() for n in ECCENTRICITY}
        common = 1e-4 * rng.standard_normal()
        run = plan.model_copy(update={"segment": tuple(
            s.model_copy(update={
                "inner_rate": s.inner_rate * (1 + common), "spin_rate": s.spin_rate * (1 + 1e-4 * rng.standard_normal())
            }) for s in plan.segment
        )})  # fmt: skip
        earth = plan.earth_rate / math.sqrt(3) * rng.standard_normal(3)
        recording = recording_of(
            simulate(run, truth, rng, frequency=100.0, drift=BIAS_STABILITY, earth=tuple(earth),
                     swing_frequency=rng.uniform(1.5, 1.9), swing_amplitude=rng.uniform(1.8, 2.2) * DEG)
        )  # fmt: skip
        cal = calibrate("roll-isolated", recording, plan)
        error = np.array([p.value - truth.get(p.name, 0.0) for p in cal.parameters])
        errors.append(error)
        sigmas.append([p.standard_uncertainty for p in cal.parameters])
        white.append(cal.fit.white)
        size = np.sqrt(np.diag(cal.matrix))
        scaled = error / size
        squares.append(scaled @ np.linalg.solve(cal.matrix / np.outer(size, size), scaled))
        p_values.append(cal.fit.p_value)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(white), axis=0))
    assert ratio.max() < 1.08
    assert ratio.min() > 0.92
    coverage = np.mean(np.abs(errors) < 1.96 * np.array(sigmas), axis=0)
    assert coverage.min() > 0.93
    assert coverage.max() < 0.97
    assert abs(np.mean(squares) - 15) < 3.3 * math.sqrt(30 / 1000)
    assert abs(np.mean(np.array(p_values) < 0.5) - 0.5) < 3.3 * 0.5 / math.sqrt(1000)
