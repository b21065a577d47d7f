"""A linearised session as one Gaussian with its whole covariance, to hold the factored algebra against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.posterior.linearised import OWN
from fingermodel.diagnosis.posterior.optimum import Optimum

Floats = NDArray[np.float64]


def dense(fit: Optimum, node: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Fitted readings (n,) and covariance (n, n) of everything that acts at a node."""
    y, covariance = dense_of_all(fit, node)
    fitted = fit.session.fitted
    return y[fitted], covariance[np.ix_(fitted, fitted)]


def dense_of_all(fit: Optimum, node: tuple[int, ...]) -> tuple[Floats, Floats]:
    """The same of all readings; those of validation cases are linearised about the fit."""
    session, values, n = fit.session, fit.hyper.values(node), len(fit.session.rows)
    reading, unseen_slopes = fit.unseen_about(fit.x)
    y, slopes = np.empty(n), np.empty((n, len(fit.theta)))
    y[session.fitted], y[~session.fitted] = fit.residual, session.measured[~session.fitted] - reading
    slopes[session.fitted], slopes[~session.fitted] = fit.slopes, unseen_slopes
    every = np.ones(n, dtype=bool)
    covariance = session.changes.tares @ session.changes.tares.T
    for rows, blocks in session.noise_of(every).covariances(values.errors, ()):
        covariance[rows[:, :, None], rows[:, None, :]] += blocks
    for name in [*fit.acting(node), OWN]:
        columns = fit.block(name, every, slopes)
        covariance += fit.widths([name], node) ** 2 * columns @ columns.T
        y += columns @ fit.place(name)
    return y, covariance
