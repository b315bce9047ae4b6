"""The one estimator: whitened Gauss-Newton with priors, and every answer a laboratory asks of it.

Notation (methods: one estimator)
    p        parameters, named; some with a prior, some nuisance
    r(p)     whitened residual, observed minus predicted over its standard deviation
    J        dr/dp
    C        (J'J + P)^-1 with P the prior information: the white covariance
    s        segment: samples of one segment are not independent, so segments are the clusters

Positions have local unknowns (the true direction of the input in each position). They are eliminated by
:func:`eliminate` before the estimator sees the rows, which leaves the same estimate and the same covariance as
solving for them (Golub & Pereyra 1973, variable projection).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import DataError

Array = NDArray[np.float64]

CONSISTENT = 0.01
"""Below this chi-square probability the stated noise does not explain the scatter between segments."""
_RANK = 1e-9
_MANY = 10  # degrees of freedom from which a delete-one figure is steadier than one common factor


@dataclass(frozen=True)
class Parameter:
    """One unknown.

    Attributes
    ----------
    name, unit : str
    start : float
        Start value.
    scale : float
        A size that matters: a combination of parameters that the data leave uncertain by more than this, in all
        parameters together, counts as not observed.
    prior, prior_sigma : float
        Mean and standard deviation of what is known beforehand (infinite: nothing).
    nuisance : bool
        Solved for but not reported.
    """

    name: str
    unit: str
    start: float
    scale: float
    prior: float = 0.0
    prior_sigma: float = np.inf
    nuisance: bool = False


class Rows(NamedTuple):
    """Whitened residuals at one parameter vector.

    Attributes
    ----------
    residual : ndarray, shape (n,)
    jacobian : ndarray, shape (n, k)
        Derivative of the residual.
    segment : ndarray of int, shape (n,)
        Segment of each row.
    """

    residual: Array
    jacobian: Array
    segment: NDArray[np.intp]


Model = Callable[[Array], Rows]


class Influence(NamedTuple):
    """What one segment does to the result."""

    segment: str
    leverage: float
    """Parameters' worth of information that the segment carries (sum over segments: the number of parameters)."""
    chi2: float
    """Its share of the chi-square."""
    shift: float
    """Largest change of a parameter, in its standard uncertainties, when the segment is left out."""
    parameter: str
    """The parameter that changes most."""


@dataclass(frozen=True)
class Estimate:
    """Result of :func:`estimate`.

    Attributes
    ----------
    parameters : tuple of Parameter
    value : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
        The honest one: `used` says which.
    white, cluster, jackknife : ndarray, shape (k,), or None
        Standard uncertainties from the stated noise alone, from the scatter of whole segments (bias-reduced
        sandwich, CR2), and from leaving out one segment at a time.
    used : str
        ``white``, ``scaled`` or ``delete-one-segment``.
    chi2, p_value, condition : float
    degrees_of_freedom, iterations : int
    residual : ndarray, shape (n,)
    segment : ndarray of int, shape (n,)
    influence : tuple of Influence
    weights : ndarray, shape (segments,)
        One unless the robust option turned a segment down.
    gain : ndarray, shape (k, n)
        Change of the estimate for a change of each residual, ``-C J'``.
    """

    parameters: tuple[Parameter, ...]
    value: Array
    covariance: Array
    white: Array
    cluster: Array | None
    jackknife: Array | None
    used: str
    chi2: float
    p_value: float
    degrees_of_freedom: int
    condition: float
    iterations: int
    residual: Array
    segment: NDArray[np.intp]
    influence: tuple[Influence, ...]
    weights: Array
    gain: Array = field(repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names in the order of `value`."""
        return tuple(p.name for p in self.parameters)

    @property
    def sigma(self) -> Array:
        """Standard uncertainties, the square root of the covariance's diagonal."""
        return np.sqrt(np.diag(self.covariance))

    def consider(self, jacobian: Array, covariance: Array) -> tuple[Estimate, Array]:
        """Add the uncertainty of quantities that were held fixed in the fit.

        Parameters
        ----------
        jacobian : ndarray, shape (n, c)
            Derivative of the whitened residuals to the fixed quantities.
        covariance : ndarray, shape (c, c)
            Of the fixed quantities.

        Returns
        -------
        Estimate
            With the covariance enlarged.
        ndarray, shape (k, c)
            Covariance between the estimate and the fixed quantities.
        """
        sensitivity = self.gain @ jacobian
        cross = sensitivity @ covariance
        return replace(self, covariance=self.covariance + cross @ sensitivity.T), cross


def eliminate(residual: Array, jacobian: Array, local: Array) -> tuple[Array, Array]:
    """Project out unknowns that belong to one segment only.

    Parameters
    ----------
    residual : ndarray, shape (s, n)
    jacobian : ndarray, shape (s, n, k)
    local : ndarray, shape (s, n, l)
        Derivative of the residual to the segment's own unknowns, l < n.

    Returns
    -------
    residual : ndarray, shape (s, n - l)
    jacobian : ndarray, shape (s, n - l, k)
    """
    basis, _ = np.linalg.qr(local, mode="complete")
    complement = np.swapaxes(basis[..., local.shape[-1] :], -1, -2)
    return (complement @ residual[..., None])[..., 0], complement @ jacobian


def null_space(jacobian: Array, names: Sequence[str], threshold: float = _RANK) -> tuple[float, list[str]]:
    """Condition of a column-scaled Jacobian, and what it cannot see in words.

    Parameters
    ----------
    jacobian : ndarray, shape (n, k)
    names : sequence of str
    threshold : float
        Smallest singular value, relative to the largest, that counts as seen.

    Returns
    -------
    condition : float
    unseen : list of str
        Combinations such as ``0.71 accel.bias.z - 0.71 accel.scale_error.z``.
    """
    length = np.linalg.norm(jacobian, axis=0)
    dead = length == 0.0
    unseen = [name for name, d in zip(names, dead, strict=True) if d]
    alive = np.flatnonzero(~dead)
    if alive.size == 0:
        return np.inf, unseen
    scaled = jacobian[:, alive] / length[alive]
    if scaled.shape[0] < scaled.shape[1]:
        scaled = np.vstack([scaled, np.zeros((scaled.shape[1] - scaled.shape[0], scaled.shape[1]))])
    _, values, right = np.linalg.svd(scaled, full_matrices=False)
    for value, vector in zip(values, right, strict=True):
        if value <= threshold * values[0]:
            unseen.append(combination(vector / length[alive], [names[int(i)] for i in alive]))
    condition = np.inf if unseen else float(values[0] / values[-1])
    return condition, unseen


def combination(vector: Array, names: Sequence[str]) -> str:
    """A direction in parameter space in words, largest part first."""
    vector = vector / np.linalg.norm(vector)
    order = np.argsort(-np.abs(vector))
    parts = [i for i in order if abs(vector[i]) > 0.15 * abs(vector[order[0]])]
    first = np.sign(vector[parts[0]])
    text = ""
    for i in parts:
        weight = first * vector[i]
        sign = "" if not text and weight > 0 else (" + " if weight > 0 else " - ")
        text += f"{sign}{abs(weight):.2g} {names[int(i)]}"
    return text


def estimate(
    parameters: Sequence[Parameter],
    model: Model,
    segments: Sequence[str],
    *,
    noise_known: bool = True,
    robust: bool = False,
    max_iterations: int = 60,
) -> Estimate:
    """Fit named parameters to whitened residuals.

    Parameters
    ----------
    parameters : sequence of Parameter, length k
    model : callable
        Takes the parameter vector (k,), returns :class:`Rows`.
    segments : sequence of str
        Names that ``Rows.segment`` points into.
    noise_known : bool
        Whether the whitening used the true noise; otherwise its size comes from the residuals.
    robust : bool
        Turn down segments that disagree with the rest (Huber weights on whole segments).
    max_iterations : int

    Returns
    -------
    Estimate

    Raises
    ------
    DataError
        When the data do not determine the parameters (the message names the combination), when there is nothing
        left to judge the noise by, or when the iteration does not settle.
    """
    parameters, model = tuple(parameters), _remembering(model)
    weights = np.ones(len(segments))
    x = np.array([p.start for p in parameters])
    _refuse_unseen(parameters, model(x))
    iterations = 0
    for _ in range(20 if robust else 1):
        weighted = _weighted(model, weights)
        x, used, settled = _gauss_newton(parameters, weighted, x, max_iterations)
        if not settled:
            raise DataError(f"the fit did not settle in {used} iterations: no result is better than a wrong one")
        iterations += used
        previous, weights = weights, _huber(model(x), len(segments)) if robust else weights
        if np.allclose(previous, weights, atol=1e-3):
            break
    return _judge(
        parameters, _weighted(model, weights)(x), x, segments, weights, noise_known and not robust, iterations
    )


def settle(parameters: Sequence[Parameter], model: Model, *, max_iterations: int = 15) -> tuple[Parameter, ...]:
    """Better start values from a simpler model of the same parameters, without judging them.

    Parameters
    ----------
    parameters : sequence of Parameter
    model : callable
        See :func:`estimate`.
    max_iterations : int

    Returns
    -------
    tuple of Parameter
        The same with new start values.
    """
    x, _, _ = _gauss_newton(parameters, model, np.array([p.start for p in parameters]), max_iterations)
    return tuple(replace(p, start=float(v)) for p, v in zip(parameters, x, strict=True))


def _remembering(model: Model) -> Model:
    """The same model, which does not compute twice in a row for one and the same vector."""
    last: list[tuple[Array, Rows]] = []

    def rows(x: Array) -> Rows:
        if not last or not np.array_equal(last[0][0], x):
            last[:] = [(x.copy(), model(x))]
        return last[0][1]

    return rows


def _weighted(model: Model, weights: Array) -> Model:
    if np.all(weights == 1.0):
        return model

    def rows(x: Array) -> Rows:
        r, jac, seg = model(x)
        w = np.sqrt(weights[seg])
        return Rows(r * w, jac * w[:, None], seg)

    return rows


def _huber(rows: Rows, count: int) -> Array:
    n = np.maximum(np.bincount(rows.segment, minlength=count), 1)
    size = np.sqrt(np.bincount(rows.segment, rows.residual**2, minlength=count) / n)
    present = np.bincount(rows.segment, minlength=count) > 0
    limit = 2.0 * max(float(np.median(size[present])), 1e-300) / 0.674
    return np.minimum(1.0, limit / np.maximum(size, 1e-300))


def _prior_rows(parameters: Sequence[Parameter], x: Array) -> tuple[Array, Array]:
    sigma = np.array([p.prior_sigma for p in parameters])
    known = np.flatnonzero(np.isfinite(sigma))
    jac = np.zeros((known.size, x.size))
    jac[np.arange(known.size), known] = 1.0 / sigma[known]
    mean = np.array([p.prior for p in parameters])
    return (x[known] - mean[known]) / sigma[known], jac


def _stacked(parameters: Sequence[Parameter], rows: Rows, x: Array) -> tuple[Array, Array]:
    prior_r, prior_j = _prior_rows(parameters, x)
    return np.concatenate([rows.residual, prior_r]), np.vstack([rows.jacobian, prior_j])


def _refuse_unseen(parameters: Sequence[Parameter], rows: Rows) -> float:
    """Condition of the problem at these rows; refused when a combination does not show in them at all."""
    _, jac = _stacked(parameters, rows, np.array([p.start for p in parameters]))
    if not np.all(np.isfinite(jac)):
        raise DataError("the start values make no sense of these data: the model is not finite there")
    scale = np.array([p.scale for p in parameters])
    condition, unseen = null_space(jac * scale, [p.name for p in parameters])
    if unseen:
        raise DataError(
            f"the data cannot tell these apart (a change along each leaves every reading as it is): {'; '.join(unseen)}. "
            "Add positions or rates that excite them."
        )
    return condition


def _gauss_newton(parameters: Sequence[Parameter], model: Model, x: Array, limit: int) -> tuple[Array, int, bool]:
    """Gauss-Newton with step halving; stops when a step moves no residual and no parameter any more."""
    scale = np.array([p.scale for p in parameters])
    r, jac = _stacked(parameters, model(x), x)
    before = np.inf
    for iteration in range(1, limit + 1):
        step = scale * np.linalg.lstsq(jac * scale, -r, rcond=None)[0]
        cost, fraction = r @ r, 1.0
        for _ in range(12):
            trial = x + fraction * step
            new_r, new_jac = _stacked(parameters, model(trial), trial)
            new_cost = new_r @ new_r
            if np.isfinite(new_cost) and new_cost <= cost * (1 + 1e-9) + 1e-18:
                break
            fraction /= 2
        else:
            return x, iteration, _at_the_bottom(jac, step, r)
        moved, size = float(np.linalg.norm(jac @ step)), max(1.0, float(np.sqrt(cost)))
        x, r, jac = trial, new_r, new_jac
        if moved < 1e-9 * size or 0.9 * before < moved < 1e-3 * size:  # nothing moves any more, or only rounding does
            return x, iteration, True
        before = moved
    return x, limit, False


def _at_the_bottom(jac: Array, step: Array, r: Array) -> bool:
    """Whether a step of which no fraction lowers the cost is only rounding; on a slope the model does not describe the data."""
    return float(np.linalg.norm(jac @ step)) < 1e-4 * max(1.0, float(np.linalg.norm(r)))


def _judge(
    parameters: tuple[Parameter, ...],
    rows: Rows,
    x: Array,
    segments: Sequence[str],
    weights: Array,
    noise_known: bool,
    iterations: int,
) -> Estimate:
    from scipy.special import chdtrc

    _, jac = _stacked(parameters, rows, x)
    scale = np.array([p.scale for p in parameters])
    names = [p.name for p in parameters]
    condition = _refuse_unseen(parameters, rows)
    _, values, right = np.linalg.svd(jac * scale, full_matrices=False)
    half = right.T / values * scale[:, None]
    white = half @ half.T
    # data rows only: a prior so wide that it adds nothing must not pass for an observation that fits
    used_up = float(np.einsum("ni,ij,nj->", rows.jacobian, white, rows.jacobian))
    chi2, dof = float(rows.residual @ rows.residual), rows.residual.size - round(used_up)
    if dof <= 0 and not noise_known:
        raise DataError("as many unknowns as readings and no stated noise: nothing is left to judge the uncertainty by")
    p_value = float(chdtrc(dof, chi2)) if dof > 0 else 1.0
    consistent = noise_known and p_value >= CONSISTENT
    factor = 1.0 if consistent else max(chi2 / max(dof, 1), 0.0 if not noise_known else 1.0)
    _refuse_vague(values / np.sqrt(factor) if factor > 0 else values, right, scale, names)
    moves, cluster = _delete_one(rows, white, len(segments))
    _, prior_jac = _prior_rows(parameters, x)
    beforehand = white @ (prior_jac.T @ prior_jac) @ white  # what the priors' own uncertainty contributes
    cluster = None if cluster is None else cluster + beforehand
    jackknife = None if moves is None else _jackknife(moves) + beforehand
    covariance, used = (white - beforehand) * factor + beforehand, "white" if consistent else "scaled"
    if not consistent and jackknife is not None and dof >= _MANY:
        covariance, used = jackknife, "delete-one-segment"
    return Estimate(
        parameters=parameters,
        value=x,
        covariance=covariance,
        white=np.sqrt(np.diag(white)),
        cluster=None if cluster is None else np.sqrt(np.diag(cluster)),
        jackknife=None if jackknife is None else np.sqrt(np.diag(jackknife)),
        used=used,
        chi2=chi2,
        p_value=p_value,
        degrees_of_freedom=dof,
        condition=condition,
        iterations=iterations,
        residual=rows.residual,
        segment=rows.segment,
        influence=_influence(rows, white, moves, covariance, segments, names),
        weights=weights,
        gain=-white @ rows.jacobian.T,
    )


def _refuse_vague(values: Array, right: Array, scale: Array, names: Sequence[str]) -> None:
    """Refuse a combination that is seen in principle but left wider than anything of use."""
    vague = [
        f"{combination(v * scale, names)} (left uncertain by {1 / s:.2g} of what would be of any use)"
        for s, v in zip(values, right, strict=True)
        if s < 1.0
    ]
    if vague:
        raise DataError(
            f"the data say next to nothing about: {'; '.join(vague)}. Add positions or rates that excite it."
        )


def _groups(rows: Rows, count: int) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Segments with equally many rows, batched: (segment indices (g,), row indices (g, n))."""
    order = np.argsort(rows.segment, kind="stable")
    sizes = np.bincount(rows.segment, minlength=count)
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    out = []
    for size in np.unique(sizes[sizes > 0]):
        which = np.flatnonzero(sizes == size)
        out.append((which, order[starts[which][:, None] + np.arange(size)]))
    return out


def _delete_one(rows: Rows, white: Array, count: int) -> tuple[Array | None, Array | None]:
    """Change of the estimate without each segment (exact in the linear model), and the CR2 sandwich.

    Bell & McCaffrey 2002 for CR2; the change is C J_s' (I - H_ss)^-1 r_s by the matrix inversion lemma.
    """
    moves, sandwich = [], np.zeros_like(white)
    for _, index in _groups(rows, count):
        jac, res = rows.jacobian[index], rows.residual[index]
        back = white @ np.swapaxes(jac, -1, -2)
        left, vectors = np.linalg.eigh(np.eye(index.shape[1]) - jac @ back)
        if left.min() < 1e-7:  # without this segment the parameters are not determined
            return None, None
        turned = (np.swapaxes(vectors, -1, -2) @ res[..., None])[..., 0]
        moves.append((back @ (vectors @ (turned / left)[..., None]))[..., 0])
        half = (back @ (vectors @ (turned / np.sqrt(left))[..., None]))[..., 0]
        sandwich += half.T @ half
    return np.vstack(moves), sandwich


def _jackknife(moves: Array) -> Array:
    m = len(moves)
    centred = moves - moves.mean(axis=0)
    return np.asarray((m - 1) / m * centred.T @ centred)


def _influence(
    rows: Rows, white: Array, moves: Array | None, covariance: Array, segments: Sequence[str], names: Sequence[str]
) -> tuple[Influence, ...]:
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    leverage = np.bincount(
        rows.segment, np.einsum("ni,ij,nj->n", rows.jacobian, white, rows.jacobian), minlength=len(segments)
    )
    chi2 = np.bincount(rows.segment, rows.residual**2, minlength=len(segments))
    shift = {}
    if moves is not None:
        order = np.concatenate([which for which, _ in _groups(rows, len(segments))])
        for which, move in zip(order, moves, strict=True):
            worst = int(np.argmax(np.abs(move) / sigma))
            shift[int(which)] = (float(np.abs(move[worst]) / sigma[worst]), names[worst])
    return tuple(
        Influence(segments[i], float(leverage[i]), float(chi2[i]), *shift.get(int(i), (np.inf, "")))
        for i in np.unique(rows.segment)
    )
