"""A linearised session as one Gaussian with its whole covariance, to hold the factored algebra against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.posterior.linearised import OWN
from fingermodel.diagnosis.posterior.optimum import Optimum

Floats = NDArray[np.float64]


def dense(fit: Optimum, node: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Readings (n,) and covariance (n, n) of everything that acts at a node."""
    values, n = fit.hyper.values(node), len(fit.residual)
    covariance, y = np.zeros((n, n)), fit.residual.copy()
    for rows, blocks in fit.session.fitted_noise.covariances(values.scatter, values.noise, ()):
        covariance[rows[:, :, None], rows[:, None, :]] = blocks
    tares = fit.session.tares[fit.session.fitted]
    covariance += tares @ tares.T
    for name in [*fit.acting(node), OWN]:
        columns = fit.block(name, fit.session.fitted, fit.slopes)
        covariance += fit.widths([name], node) ** 2 * columns @ columns.T
        y += columns @ fit.place(name)
    return y, covariance
