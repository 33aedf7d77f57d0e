"""A Gaussian process: what a few runs say of a number everywhere in the ranges of some parameters.

Constant mean, covariance Matern 5/2 with a length for each parameter, independent noise (Rasmussen & Williams
2006, ISBN 0-262-18253-X, equations 2.25, 2.26 and 4.17). Lengths, variance and noise are the most probable
ones (their section 5.4.1) under wide log-normal priors, without which few runs would fit any length.
"""

from dataclasses import dataclass, replace
from math import log, pi, sqrt

import numpy as np

from swath.core.errors import Extra
from swath.signals import F64

PRIORS = {"length": (0.5, 1.0), "variance": (0.5, 1.0), "noise": (0.1, 1.0)}  # median, sd of the logarithm
STARTS = (0.3, 1.0)  # lengths that the fit begins from [shares of a range]
WIDEST = 4.0  # sd of the logarithm from the median at which the fit ends


@dataclass(frozen=True)
class GaussianProcess:
    """Fitted to values at points of the unit cube, (n, d).

    mean: of the values
    lengths: (d,)
    variance: of the function
    noise: sd of the values
    factor: lower Cholesky factor of the covariance of the values, (n, n)
    weights: (n,)
    """

    points: F64
    values: F64
    mean: float
    lengths: F64
    variance: float
    noise: float
    factor: F64
    weights: F64

    def predict(self, at: F64) -> tuple[F64, F64]:
        """Mean and standard deviation of the function, without noise, at points (m, d)."""
        from scipy.linalg import solve_triangular

        across = self.variance * matern(_distance(at, self.points, self.lengths))
        mean = self.mean + across @ self.weights
        known = solve_triangular(self.factor, across.T, lower=True)
        return mean, np.sqrt(np.maximum(self.variance - np.sum(known**2, axis=0), 0.0))

    def and_at(self, point: F64, value: float) -> "GaussianProcess":
        """The process with one value more; lengths, variance and noise stay as they are."""
        points, values = np.vstack([self.points, point]), np.append(self.values, value)
        return _made(points, values, self.mean, self.lengths, self.variance, self.noise)

    def left_out(self) -> F64:
        """For each value: the mean that the others give for it, (n,) (equation 5.12)."""
        from scipy.linalg import cho_solve

        inverse = cho_solve((self.factor, True), np.eye(len(self.values)))
        return self.values - self.weights / np.diag(inverse)


def fit(points: F64, values: F64) -> GaussianProcess:
    """The process of some values (n,) at points of the unit cube (n, d). MissingExtra without scipy."""
    with Extra("test", "swath test search"):
        from scipy.optimize import minimize
    count = points.shape[1]
    mean = float(np.mean(values))
    medians = np.array([PRIORS["length"][0]] * count + [PRIORS["variance"][0], PRIORS["noise"][0]])
    widths = np.array([PRIORS["length"][1]] * count + [PRIORS["variance"][1], PRIORS["noise"][1]])
    centre = np.log(medians)
    squares = (points[:, None, :] - points[None, :, :]) ** 2

    def cost(logs: F64) -> float:
        prior = 0.5 * float(np.sum(((logs - centre) / widths) ** 2))
        return prior - _evidence(squares, values - mean, np.exp(logs))

    found = []
    for length in STARTS:
        begin = np.where(np.arange(count + 2) < count, log(length), centre)
        bounds = list(zip(centre - WIDEST * widths, centre + WIDEST * widths, strict=True))
        found.append(minimize(cost, begin, method="L-BFGS-B", bounds=bounds))
    scales: F64 = np.exp(min(found, key=lambda result: float(result.fun)).x)
    return _made(points, values, mean, scales[:count], float(scales[-2]), float(scales[-1]))


def matern(distance: F64) -> F64:
    """Covariance of the Matern class with nu = 5/2 at distances in lengths, 1 at 0 (equation 4.17)."""
    r = sqrt(5.0) * distance
    return np.asarray((1.0 + r + r**2 / 3.0) * np.exp(-r))


def _evidence(squares: F64, values: F64, scales: F64) -> float:
    """Logarithm of the marginal likelihood (equation 2.30). squares: of differences (n, n, d)."""
    *lengths, variance, noise = scales
    distance = np.sqrt(squares @ (1.0 / np.square(lengths)))
    covariance = variance * matern(distance) + (noise**2 + 1e-9) * np.eye(len(values))
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return -1e9
    half = np.linalg.solve(factor, values)
    return float(-0.5 * half @ half - np.sum(np.log(np.diag(factor))) - 0.5 * len(values) * log(2.0 * pi))


def _made(
    points: F64, values: F64, mean: float, lengths: F64, variance: float, noise: float
) -> GaussianProcess:
    from scipy.linalg import cho_solve

    covariance = variance * matern(_distance(points, points, lengths))
    factor = np.asarray(np.linalg.cholesky(covariance + (noise**2 + 1e-9) * np.eye(len(values))), np.float64)
    blank = GaussianProcess(points, values, mean, lengths, variance, noise, factor, np.zeros(len(values)))
    return replace(blank, weights=cho_solve((factor, True), values - mean))


def _distance(a: F64, b: F64, lengths: F64) -> F64:
    """Distances in lengths of points (n, d) and (m, d), (n, m)."""
    a, b = a / lengths, b / lengths
    return np.asarray(np.sqrt(np.maximum(((a[:, None, :] - b[None, :, :]) ** 2).sum(axis=2), 0.0)))
