"""Drive the track with the nominal car and with fifty drawn ones; plot where they go.

Needs gymnasium and matplotlib: pip install -e '.[gym,plot]'

    python examples/plot_laps.py [laps.png]
"""

import sys

import gymnasium
import numpy as np
from matplotlib.figure import Figure

from dart_hal import track_named

CARS, FIRST, STEPS, SPEED = 50, 60, 305, 1.5  # steps: a lap, behind what they start with
GAINS = 4.1, 0.06, 0.30, 0.64  # found by learn_to_follow.py


def steer(seen):
    """Actions (n, 2): pursuit of the point 0.6 m ahead, speed held by a gain."""
    x, y = seen["x_0.6"], seen["y_0.6"]
    steering = GAINS[0] * 0.347 * y / (x**2 + y**2) - GAINS[1] * seen["yaw_rate"]
    throttle = GAINS[2] + GAINS[3] * (seen["reference_speed"] - seen["speed"])
    return np.clip(np.stack([throttle, steering], axis=1), -1.0, 1.0).astype(np.float32)


def drive(n, randomise):
    """s, offset, speed, x, y over one lap, (steps, n) each."""
    env = gymnasium.make_vec("dart_lab.sim.gym:DartCar-v0", num_envs=n, speed=SPEED, episode=60.0)
    seen, _ = env.reset(seed=1, options={"randomise": randomise})
    rows = []
    for k in range(FIRST + STEPS):
        action = steer(dict(zip(env.names, seen.T, strict=True)))
        seen, _, ended, _, info = env.step(action)
        assert not ended.any(), "a car left the track"
        if k >= FIRST:
            rows.append([info["s"], info["offset"], info["speed"], *env.cars.state[:2]])
    return np.array(rows).transpose(1, 0, 2)


track = track_named("vicon")
s, offset, speed, x, y = drive(1, False)
many_s, many, *_ = drive(CARS, True)

figure = Figure(figsize=(10.0, 4.6), layout="constrained")
left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.25])
middle = np.array([track.x, track.y])
normal = 0.3 * np.array([-np.sin(track.heading), np.cos(track.heading)])
rim = np.concatenate([middle + normal, (middle + normal)[:, :1], (middle - normal)[:, :1],
                      (middle - normal)[:, ::-1]], axis=1)
left.fill(*rim, color="#dddddd", lw=0)
left.plot(track.x, track.y, color="#888888", lw=0.8)
points = left.scatter(x, y, c=speed, s=5, cmap="viridis", zorder=3)
figure.colorbar(points, ax=left, label="speed [m/s]", shrink=0.8)
left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
left.set_title("one lap of the nominal car", loc="left", fontsize=10)

order = np.argsort(many_s.ravel() % track.length)
at, off = (many_s.ravel() % track.length)[order], 100 * many.ravel()[order]
right.plot(at, off, ".", color="#0072b2", ms=1.2, alpha=0.35)
right.plot([], [], "o", color="#0072b2", ms=4, label=f"{CARS} drawn cars, {len(at):,} samples")
lap = np.argsort(s[:, 0] % track.length)
right.plot((s[:, 0] % track.length)[lap], 100 * offset[lap, 0], color="#d55e00", lw=1.6,
           label="the nominal car")
for k in np.flatnonzero(np.diff(track.curvature)):
    right.axvline(k * track.spacing, color="#cccccc", lw=0.8, zorder=0)
right.set(xlabel="along the track [m]; grey: where its curvature changes",
          ylabel="offset of the rear axle, + = left [cm]", ylim=(-9.0, 6.0))
right.set_title("sensors, servo and disturbance as in DartCar-v0", loc="left", fontsize=10)
right.legend(fontsize=8, loc="lower right", markerscale=1.5)
right.grid(alpha=0.3)
path = sys.argv[1] if len(sys.argv) > 1 else "laps.png"
figure.savefig(path, dpi=110)
print(f"{path}: rms offset {100 * np.sqrt(np.mean(offset**2)):.1f} cm, of the drawn cars "
      f"{100 * np.sqrt(np.mean(many**2)):.1f} cm, at most {100 * np.abs(many).max():.1f} cm")
