"""What goes into the estimator and what comes out: records, and the elimination of local unknowns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
    rest : ndarray, shape (segments,), or None
        Squares of further residuals of each segment that no small change of a parameter moves, as they are left over when
        long lists of rows are reduced by QR. They count when steps are weighed, so that the cost is that of all residuals, and
        not in the chi-square, where they would drown what segments say about each other.
    """

    residual: Array
    jacobian: Array
    segment: NDArray[np.intp]
    rest: Array | None = None

    @property
    def left(self) -> float:
        """Sum of `rest`."""
        return 0.0 if self.rest is None else float(self.rest.sum())


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
    rows: int | None = None
    """Whitened readings of the segment: its chi-square is expected to be `rows` less `leverage`."""


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


def prior_rows(parameters: Sequence[Parameter], x: Array) -> tuple[Array, Array]:
    """Priors as whitened observations: residual (m,) and derivative (m, k)."""
    sigma = np.array([p.prior_sigma for p in parameters])
    known = np.flatnonzero(np.isfinite(sigma))
    jac = np.zeros((known.size, x.size))
    jac[np.arange(known.size), known] = 1.0 / sigma[known]
    mean = np.array([p.prior for p in parameters])
    return (x[known] - mean[known]) / sigma[known], jac


def stacked(parameters: Sequence[Parameter], rows: Rows, x: Array) -> tuple[Array, Array]:
    """Data and priors one under the other: residual and derivative."""
    prior_r, prior_j = prior_rows(parameters, x)
    return np.concatenate([rows.residual, prior_r]), np.vstack([rows.jacobian, prior_j])
