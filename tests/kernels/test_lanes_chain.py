"""The chain of many slaves against the filter for one, and what must come out where there is nothing to find."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sagnac.align import config as settings
from sagnac.align.filter import Filter, Reference
from sagnac.align.model import layout_of
from sagnac.align.monte_carlo.chain import Chain
from sagnac.frames import rotation_matrix, rotation_vector, skew
from sagnac.kernels.lanes import LANES
from sagnac.kernels.lanes_chain import turn_covariance
from sagnac.navigate.state import State

SLOT = [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 5]  # of the states of the short form in the kernel's rows


def configuration(method, **changes):
    table = {
        "method": method,
        "gate": "off",
        "initial": {
            "misalignment": ["0.2 deg", "0.2 deg", "0.5 deg"],
            "velocity": "0.2 m/s",
            "gyro_bias": "0.01 deg/h",
            "accel_bias": "50 ug",
        },
        "noise": {"gyro": "0.001 deg/sqrt(h)", "accel": "0.833 ug/sqrt(Hz)", "velocity": "0.01 m/s"},
        "trajectory": {
            "latitude": "60 deg",
            "longitude": "108 deg",
            "height": "20 m",
            "speed": "10 m/s",
            "heading": "70 deg",
            "leg": [
                {"duration": "5 s", "turn_rate": "3 deg/s", "climb": "1 m/s", "ease": "1 s"},
                {"duration": "15 s", "turn_rate": "-3 deg/s", "ease": "1 s"},
            ],
        },
    }
    return settings.from_table(table | changes)


def quiet(config):
    """The chain without any noise that is drawn."""
    chain = Chain.of(config, config, 50.0)
    chain.drawn[:] = 0.0
    return chain


@pytest.mark.parametrize("method", ["wander", "geographic"])
def test_a_lane_is_the_filter_for_one(method):
    """20 s with turns and a climb, errors of three times their sigma, no noise: every number of the filter."""
    config = configuration(method)
    chain = quiet(config)
    chain.sizes[:] *= 3.0
    (group,) = chain.start(LANES, 5)
    first = [group.state.reshape(-1, LANES)[:, i].copy() for i in range(2)]
    biases, to_master = group.biases.reshape(6, LANES).copy(), group.to_master
    pieces = list(chain.pieces(chain.marks([20.0])))
    for piece in pieces:
        chain.advance(group, piece)
    n, states = len(chain.names), layout_of(config)
    for i in range(2):
        numbers = first[i]
        C_b_w, C_e_w = Rotation.from_quat(numbers[:4]).as_matrix(), numbers[7:16].reshape(3, 3)
        # rate and force at the start are only for a delay or a lever arm
        start = State(C_b_w, numbers[4:7], C_e_w, numbers[16])
        one = Filter(config, states, start, np.zeros(3), np.array([0.0, 0.0, 9.8]))
        time = 0.0
        for piece in pieces:
            for k, velocity in enumerate(piece.velocities):
                own = slice(k * chain.count, (k + 1) * chain.count)
                steps = piece.steps[own]
                turns = piece.turns[own] @ to_master[i] + steps[:, None] * biases[:3, i]
                pushes = piece.pushes[own] @ to_master[i] + steps[:, None] * biases[3:, i]
                one.advance(turns, pushes, steps, piece.heights[own])
                time += steps.sum()
                truth = chain.trajectory.state(time)
                latitude, longitude, _ = truth.place
                one.match(Reference(float(latitude), float(longitude), np.array([*velocity, 0.0])))
                one.feed_back()
        P = group.P.reshape(11, 11, LANES)[:, :, i]
        sigma = np.sqrt(np.diag(P)[SLOT[:n]])
        scaled = P[np.ix_(SLOT[:n], SLOT[:n])] / np.outer(sigma, sigma)
        np.testing.assert_allclose(scaled, one.P[:n, :n] / np.outer(sigma, sigma), rtol=0, atol=1e-7)
        ours, theirs = group.state.reshape(-1, LANES)[:17, i], one.navigator.numbers[:17]
        # In w the one filter turns the master's velocity by the angle between the two frames, the other by the slave's
        # wander angle. They differ by the convergence of meridians over the position error, 1e-7 rad: 1e-6 m/s.
        near = 1.0 if method == "wander" else 0.0
        np.testing.assert_allclose(
            ours[:4] * np.sign(ours[3]), theirs[:4] * np.sign(theirs[3]), rtol=0, atol=1e-12 + 1e-8 * near
        )
        np.testing.assert_allclose(ours[4:7], theirs[4:7], rtol=0, atol=1e-11 + 2e-6 * near)
        np.testing.assert_allclose(ours[7:], theirs[7:], rtol=1e-12, atol=1e-12 + 1e-7 * near)
        left = group.biases.reshape(6, LANES)[:, i]
        np.testing.assert_allclose(biases[:3, i] - left[:3], one.gyro_bias, rtol=1e-4, atol=1e-16)
        np.testing.assert_allclose(biases[3:, i] - left[3:], one.accel_bias, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("method", ["wander", "geographic"])
def test_without_any_error_there_is_nothing_to_correct(method):
    """Zero test: ideal slaves, ideal master, 20 s of turns and climb."""
    chain = quiet(configuration(method))
    chain.sizes[:] = 0.0
    groups = chain.start(LANES, 1)
    for piece in chain.pieces(chain.marks([20.0])):
        chain.advance(groups[0], piece)
    errors, _, aside = chain.compare(groups, chain.truth(200))
    # what two-sample groups leave at 50 Hz where a turn is eased in: 1e-7 m/s and 1e-9 rad; the gains make biases of it
    assert np.abs(errors[:, :2]).max() < 1e-6
    assert np.abs(errors[:, 2:5]).max() < 1e-8
    assert aside.max() < 1e-4  # of 200 m at 3 deg/s with the velocity of the middle of 0.04 s: (w h)^2 / 24, 4e-5 m
    assert np.abs(groups[0].biases).max() < 1e-6


def test_covariances_turn_with_the_correction():
    """``log(exp(p + d) exp(-p))`` of small d, differentiated, for corrections up to 0.3 rad."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((11, 11, LANES))
    P = np.einsum("ikl,jkl->ijl", root, root)
    P = 0.5 * (P + P.transpose(1, 0, 2))
    x = np.zeros((11, LANES))
    x[2:5] = rng.uniform(-0.2, 0.2, (3, LANES))
    turned = P.copy().ravel()
    turn_covariance(turned, x.ravel())
    turned = turned.reshape(11, 11, LANES)
    np.testing.assert_array_equal(turned, turned.transpose(1, 0, 2))
    h = 1e-5
    for i in range(LANES):
        taken = x[2:5, i]
        J = np.eye(11)
        for j in range(3):
            ends = [
                rotation_vector(rotation_matrix(taken + s * h * np.eye(3)[j]) @ rotation_matrix(-taken))
                for s in (1, -1)
            ]
            J[2:5, 2 + j] = (ends[0] - ends[1]) / (2 * h)
        # the series breaks off at a^4 / 840 times [p x]^2 / 6: 1e-8 at 0.3 rad
        np.testing.assert_allclose(turned[:, :, i], J @ P[:, :, i] @ J.T, rtol=0, atol=2e-7)
        assert np.abs(J[2:5, 2:5] - np.eye(3) - 0.5 * skew(taken)).max() < 0.03


def test_what_a_lane_draws_is_its_own():
    """The same runs in another order of groups, and with other runs beside them."""
    chain = Chain.of(configuration("wander"), configuration("wander"), 20.0)
    pieces = list(chain.pieces(chain.marks([3.0])))
    few, many = chain.start(LANES, 9), chain.start(3 * LANES, 9)
    for group in [*many[::-1], *few]:
        for piece in pieces:
            chain.advance(group, piece)
    for name in ("state", "P", "biases", "nis"):
        np.testing.assert_array_equal(getattr(few[0], name), getattr(many[0], name))
    assert not np.array_equal(many[0].state, many[1].state)


def test_pieces_of_the_motion_make_no_difference():
    chain = Chain.of(configuration("wander"), configuration("wander"), 20.0)
    ends = []
    for marks in ([3.0], [0.1, 0.4, 1.0, 2.9, 3.0]):
        (group,) = chain.start(LANES, 2)
        for piece in chain.pieces(chain.marks(marks)):
            chain.advance(group, piece)
        ends.append(group.state)
    # increments from other panels of the trajectory, to rounding
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-10, atol=1e-10)


def test_drawn_noise_has_the_size_that_is_asked_for():
    """Biases that walk from zero, nothing else drawn, a filter that believes in no bias: their spread after 10 s."""
    base = configuration("wander")
    noise = base.noise.model_copy(update={"gyro_walk": 1e-8, "accel_walk": 1e-5})
    config = base.model_copy(update={"noise": noise})
    chain = Chain.of(base, config, 20.0)
    chain.sizes[:] = 0.0
    chain.drawn[[0, 1, 4]] = 0.0
    chain.prior[5:] = chain.prior[:, 5:] = 0.0
    groups = chain.start(64 * LANES, 4)
    for piece in chain.pieces(chain.marks([10.0])):
        for group in groups:
            chain.advance(group, piece)
    biases = np.stack([g.biases.reshape(6, LANES) for g in groups], axis=1).reshape(6, -1)
    expected = np.repeat([1e-8, 1e-5], 3) * math.sqrt(10.0)
    # 1024 runs: a standard deviation is known to 2.2 %
    np.testing.assert_allclose(biases.std(axis=1), expected, rtol=0.08)
