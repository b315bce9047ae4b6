"""Motion in closed form on the ellipsoid, with what a strapdown unit feels: the truth for navigation.

Nothing of it knows a navigation frame: position is the normal u of the ellipsoid and a height, in Earth-fixed axes, and
what is felt is differentiated by hand from ``r = (N + h) u - e^2 N u_z z``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sagnac.earth import EARTH_RATE, ELLIPSOID
from sagnac.frames import rot_x, rot_y, rot_z
from sagnac.navigate.state import State
from sagnac.navigate.wander import direction_cosines

AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Wave:
    """``start + slope t + sum of amplitude sin(frequency t + phase)``, with two derivatives."""

    start: float = 0.0
    slope: float = 0.0
    sines: tuple[tuple[float, float, float], ...] = ()

    def __call__(self, t):
        value, first, second = self.start + self.slope * t, np.full_like(t, self.slope), np.zeros_like(t)
        for amplitude, frequency, phase in self.sines:
            s, c = amplitude * np.sin(frequency * t + phase), amplitude * np.cos(frequency * t + phase)
            value, first, second = value + s, first + frequency * c, second - frequency**2 * s
        return value, first, second


def gravity(sine2, height):
    """Normal gravity of NIMA TR8350.2, equations 4-1 and 4-3."""
    a, e2, g_e, k, p, q = ELLIPSOID
    surface = g_e * (1 + k * sine2) / np.sqrt(1 - e2 * sine2)
    return surface * (1 - (p - q * sine2) * height / a + 3 * (height / a) ** 2)


@dataclass(frozen=True)
class Motion:
    """Angles rad, heights m.

    Latitude and longitude are those of the normal against axes that are turned by `tilt` from the Earth's; heading,
    pitch and roll are against east, north, up of those axes too. Without tilt they are the usual ones.
    """

    latitude: Wave
    longitude: Wave
    height: Wave = Wave()
    heading: Wave = Wave()
    pitch: Wave = Wave()
    roll: Wave = Wave()
    tilt: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))

    def at(self, t):
        """Normal, height, velocity and attitude in Earth-fixed axes; specific force and rate in body axes."""
        a, e2 = ELLIPSOID[:2]
        (lat, dlat, ddlat), (lon, dlon, ddlon) = self.latitude(t), self.longitude(t)
        h, dh, ddh = self.height(t)
        sl, cl, so, co = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
        tilt = np.array(self.tilt, dtype=float)
        east = np.stack([-so, co, 0 * so], -1) @ tilt.T
        north = np.stack([-sl * co, -sl * so, cl], -1) @ tilt.T
        u = np.stack([cl * co, cl * so, sl], -1) @ tilt.T
        along, across = (dlon * cl)[:, None], dlat[:, None]  # rates of the normal to the east and to the north
        du = along * east + across * north
        turning = np.stack([-dlat, dlon * cl, dlon * sl], -1)  # of east, north, up, in those axes
        # second derivative: of the two rates, and of east and north themselves
        ddu = (
            (ddlon * cl - dlon * dlat * sl)[:, None] * east
            + ddlat[:, None] * north
            + along * ((dlon * sl)[:, None] * north - (dlon * cl)[:, None] * u)
            + across * (-(dlon * sl)[:, None] * east - dlat[:, None] * u)
        )
        z, dz, ddz = u[:, 2], du[:, 2], ddu[:, 2]
        N = a / np.sqrt(1 - e2 * z * z)
        dN = N**3 * e2 * z * dz / a**2
        ddN = 3 * N**2 * dN * e2 * z * dz / a**2 + N**3 * e2 * (dz * dz + z * ddz) / a**2
        velocity = (dN + dh)[:, None] * u + (N + h)[:, None] * du - (e2 * (dN * z + N * dz))[:, None] * AXIS
        acceleration = (
            (ddN + ddh)[:, None] * u
            + 2 * (dN + dh)[:, None] * du
            + (N + h)[:, None] * ddu
            - (e2 * (ddN * z + 2 * dN * dz + N * ddz))[:, None] * AXIS
        )
        force = acceleration + 2 * EARTH_RATE * np.cross(AXIS, velocity) + gravity(z * z, h)[:, None] * u

        (psi, dpsi, _), (theta, dtheta, _), (phi, dphi, _) = self.heading(t), self.pitch(t), self.roll(t)
        inner = rot_x(theta) @ rot_y(phi)
        to_local = np.stack([east, north, u], -1)
        body = to_local @ rot_z(-psi) @ inner
        rate = np.einsum("nji,nj->ni", body, np.einsum("nij,nj->ni", to_local, turning) + EARTH_RATE * AXIS)
        rate += -dpsi[:, None] * inner[:, 2, :] + dtheta[:, None] * rot_y(phi)[:, 0, :]
        rate[:, 1] += dphi
        return u, h, velocity, body, np.einsum("nji,nj->ni", body, force), rate

    def state(self, t, wander=0.0):
        """True state at one time, with any wander angle."""
        u, h, velocity, body, _, _ = (v[0] for v in self.at(np.array([float(t)])))
        C_e_w = direction_cosines(np.arctan2(u[2], np.hypot(u[0], u[1])), np.arctan2(u[1], u[0]), wander)
        return State(C_e_w @ body, C_e_w @ velocity, C_e_w, h)

    def pieces(self, duration, frequency, nodes=3, size=50000, edges=None):
        """``(turns, pushes, steps)`` in pieces: Gauss-Legendre over each sample interval."""
        x, w = np.polynomial.legendre.leggauss(nodes)
        edges = np.arange(round(duration * frequency) + 1) / frequency if edges is None else edges
        for i in range(0, edges.size - 1, size):
            part = edges[i : i + size + 1]
            steps = np.diff(part)
            turns, pushes = np.zeros((steps.size, 3)), np.zeros((steps.size, 3))
            for node, weight in zip(x, w, strict=True):
                *_, force, rate = self.at(part[:-1] + 0.5 * (1 + node) * steps)
                turns += 0.5 * weight * steps[:, None] * rate
                pushes += 0.5 * weight * steps[:, None] * force
            yield turns, pushes, steps

    def samples(self, duration, frequency, **kwargs):
        """The same in one piece."""
        return tuple(np.concatenate(parts) for parts in zip(*self.pieces(duration, frequency, **kwargs), strict=True))

    def errors(self, state, t):
        """Sizes of the errors of horizontal position (m), height (m), velocity (m/s) and attitude (rad)."""
        u, h, velocity, body, _, _ = (v[0] for v in self.at(np.array([float(t)])))
        M = state.C_e_w
        twist = M.T @ state.C_b_w @ body.T
        turned = 0.5 * np.array([twist[2, 1] - twist[1, 2], twist[0, 2] - twist[2, 0], twist[1, 0] - twist[0, 1]])
        return (
            np.linalg.norm(np.cross(M[2], u)) * 6.37e6,
            abs(state.height - h),
            np.linalg.norm(M.T @ state.velocity - velocity),
            np.linalg.norm(turned),
        )
