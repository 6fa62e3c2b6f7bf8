"""Standard errors of a fit with few blocks and many parameters."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dart_lab.identification.objective import covariance


def fit_blocks(rng, blocks, rows, parameters):
    """Least squares of independent rows whose disturbance is common to a block."""
    block = np.repeat(np.arange(blocks), rows)
    jacobian = rng.normal(size=(blocks, parameters))[block]
    jacobian += 0.5 * rng.normal(size=jacobian.shape)
    disturbance = rng.normal(size=blocks)[block] + 0.5 * rng.normal(size=blocks * rows)
    x, *_ = np.linalg.lstsq(jacobian, disturbance, rcond=None)
    residual = disturbance - jacobian @ x
    normal = jacobian.T @ jacobian + 1e-6 * np.eye(parameters)
    point = SimpleNamespace(x=x, residual=residual, jacobian=jacobian, normal=normal,
                            irls_weight=np.ones(len(residual)),
                            space=SimpleNamespace(prior_precision=0.0))
    scores = np.zeros((blocks, parameters))
    np.add.at(scores, block, jacobian * residual[:, None])
    bread = np.linalg.inv(normal)
    return x, covariance(point, block), bread @ scores.T @ scores @ bread


@pytest.mark.slow
def test_few_blocks_with_many_parameters_have_honest_errors():
    """The plain sandwich is the control: its errors are too small there."""
    rng = np.random.default_rng(0)
    honest, plain = [], []
    for _ in range(200):
        x, corrected, sandwich = fit_blocks(rng, 28, 6, 14)
        honest.append(np.abs(x) / np.sqrt(np.diag(corrected)) < 1.645)
        plain.append(np.abs(x) / np.sqrt(np.diag(sandwich)) < 1.645)
    assert 0.85 < np.mean(honest) < 0.95
    assert np.mean(plain) < 0.80
