"""Fit six parameters to one recording by exact gradients, and compare with `dart-hal identify`.

Windows of 1 s of the recording are predicted from their measured start. JAX differentiates the
predicted speeds with respect to friction and motor, and Gauss-Newton steps follow these gradients.
Needs JAX: pip install -e '.[jax]'

    python examples/jax/fit_by_gradients.py [RECORDING]
"""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import savgol_filter

from dart_hal import find_model, read_any
from dart_hal.vehicle.flat import make_setter, value
from dart_lab import identify
from dart_lab.sim.jax import rollout

jax.config.update("jax_enable_x64", True)
RECORDED = Path(__file__).parents[2] / "tests" / "recorded" / "data" / "81_throttle_ramps"
NAMES = ("friction.a", "friction.b", "friction.c", "motor.d", "motor.e", "motor.g")
WIDTHS = np.array([0.7, 0.7, 0.3, 0.7, 0.7, 0.7])  # prior: of the logarithms; of c in N s/m
IS_LOG = np.array([True, True, False, True, True, True])
DT, WINDOW, EVERY, READ = 0.01, 100, 50, np.array([10, 25, 50, 75, 100])  # s; samples
ERRORS = np.array([0.15, 0.05, 0.4])  # of a first model after a second: m/s, m/s, rad/s
SLOWEST, ROBUST, ROUNDS = 0.3, 2.0, 25  # m/s; typical errors; Gauss-Newton steps
REPEATED = len(READ) * 5.0 / (EVERY * DT)  # read-outs within 5 s count as a single one


def cut_windows(recording, frame, base):
    """Starts (8, n), commands (2, WINDOW, n) and measured speeds (len(READ), 3, n) of windows."""
    mocap, sent = recording.mocap, recording.messages
    t = np.arange(mocap.t[0], mocap.t[-1], DT)
    pose = [np.interp(t, mocap.t, v) for v in (mocap.x, mocap.y, mocap.yaw)]
    rates = [savgol_filter(v, 15, 2, deriv=1, delta=DT) for v in pose]
    pose[2] = pose[2] + frame.theta
    x, y, v_x, v_y = frame.centre(base.body.l_r, pose, rates)
    # A command holds until the next one, and the actuators follow it with their lags.
    row = np.clip(np.searchsorted(sent.arrival, t, side="right") - 1, 0, None)
    commands = np.stack([sent.throttle[row], sent.steering[row]])
    share = 1.0 - np.exp(-DT / np.array([base.delay.throttle_lag_s, base.delay.steering_lag_s]))
    behind = np.zeros_like(commands)
    for k in range(1, len(t)):
        behind[:, k] = behind[:, k - 1] + share * (commands[:, k - 1] - behind[:, k - 1])
    start = np.arange(EVERY, len(t) - WINDOW - EVERY, EVERY)
    start = start[np.all([v_x[start + k] > SLOWEST for k in (0, *READ)], axis=0)]
    inside = start[None] + np.arange(WINDOW)[:, None]
    motion = np.stack([x, y, pose[2], v_x, v_y, rates[2], *behind])
    return motion[:, start], commands[:, inside], np.moveaxis(
        motion[3:6][:, start[None] + READ[:, None]], 0, 1)


def fit(base, starts, commands, measured):
    """Values (6,) and standard errors (6,) of NAMES."""
    usual = np.array([value(base, name) for name in NAMES])
    vehicle = make_setter(base, NAMES)

    def numbers(z):
        """Parameters from z, in prior standard deviations around the base."""
        return jnp.where(IS_LOG, usual * jnp.exp(WIDTHS * z * IS_LOG), usual + WIDTHS * z)

    def errors(z):
        error = rollout(vehicle(numbers(z)), starts, *commands)[READ - 1, 3:6] - measured
        return error, error

    slopes_and_errors = jax.jit(jax.jacfwd(errors, has_aux=True))
    scale = ERRORS[:, None]
    z = np.zeros(len(NAMES))
    for k in range(ROUNDS):
        slopes, error = map(np.asarray, slopes_and_errors(z))
        if k and k % 5 == 0:  # from the sixth step on the errors count by their own size
            scale = 1.4826 * np.median(np.abs(error), axis=2, keepdims=True)
        r = (error / scale).ravel()
        J = (slopes / scale[..., None]).reshape(len(r), -1)
        # Large residuals count less than their square (soft L1); the prior pulls to z = 0.
        weight = 1.0 / np.sqrt(1.0 + (r / ROBUST) ** 2)
        hessian = J.T @ (weight[:, None] * J) + REPEATED * np.eye(len(z))
        step = -np.linalg.solve(hessian, J.T @ (weight * r) + REPEATED * z)
        z = z + step * min(1.0, 1.0 / np.abs(step).max())
    std = np.sqrt(REPEATED * np.diag(np.linalg.inv(hessian)))
    return np.asarray(numbers(z)), std * np.diag(jax.jacfwd(numbers)(z))


def main(recorded):
    """Print both fits; return the differences in standard errors of `dart-hal identify`."""
    model, base = find_model("upstream-2024")
    recording = read_any([recorded])[0][0]
    found = identify([recording], model, ["friction", "motor"], joint=True)
    frame = next(iter(found.frames.values()))
    values, std = fit(base, *cut_windows(recording, frame, base))
    print(f"{'':12}{'base':>9}{'by gradients':>19}{'dart-hal identify':>21}   difference")
    differences = {}
    for i, name in enumerate(NAMES):
        group, key = name.split(".")
        other = found.fits[group].parameters[key]
        differences[name] = abs(values[i] - other.value) / other.std
        print(f"{name:12}{value(base, name):9.3f}{values[i]:11.3f} +-{abs(std[i]):5.2f}"
              f"{other.value:13.3f} +-{other.std:5.2f}{differences[name]:9.2f} standard errors")
    return differences


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else RECORDED)
