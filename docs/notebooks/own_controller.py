# %% [markdown]
# # A controller of your own, and what a model is worth
#
# For a **control engineer**. You write a controller, drive the emulated car with it, identify a model from that very drive, and give the model to a
# predictive controller. It needs no hardware; on a real car only `URL` changes. Type `pip install -e '.[lab]'` in the checkout once, then run the cells from top to bottom.
#
# The text of this notebook is `docs/notebooks/own_controller.py`.

# %%
import os
from dataclasses import replace
from math import atan, pi, remainder
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from dart_hal import (
    Car,
    Follower,
    Phase,
    Rules,
    find_model,
    model_of,
    plant_of,
    save_model,
    track_named,
)

URL = "sim://?nano=mock&mocap=1&vehicle=upstream-2024"
TRACK = track_named("racetrack_vicon_2")
os.environ |= {"FORCE_COLOR": "", "COLUMNS": "100"}  # commands answer in plain text
plt.rcParams.update({"figure.dpi": 72, "axes.grid": True, "grid.alpha": 0.3})
print(f"{TRACK.length:.2f} m, tightest bend {1 / np.abs(TRACK.curvature).max():.2f} m")

# %% [markdown]
# ## Your controller
#
# This one is Stanley's (G. Hoffmann et al., 2007): steer the heading error away, and the distance from the path by an arctangent. It is a class with one method; put yours in its place.
# `s.estimate.predict(car.now)` is the pose that the motion capture, the wheels and the gyro give for this very moment. `TRACK.closest`
# finds the arc length along the path, `TRACK.offset` the distance to its left.

# %%
class Stanley:
    """Steering angle [rad] from the pose of the front axle."""

    def __init__(self, path, wheelbase, gain):
        self.path, self.wheelbase, self.gain = path, wheelbase, gain
        self.s = 0.0

    def steer(self, motion):
        yaw = motion.pose.yaw
        x = motion.pose.x + self.wheelbase * np.cos(yaw)
        y = motion.pose.y + self.wheelbase * np.sin(yaw)
        self.s = self.path.closest(x, y, self.s)
        turned = remainder(yaw - self.path.interpolate(self.s).heading, 2 * pi)
        left = self.path.offset(x, y, self.s)
        return -turned - atan(self.gain * left / max(motion.speed, 0.3))


def drive(gain, seconds, throttle, record=None):
    """Rows (t, x, y, offset of the rear axle, speed) of a drive by Stanley."""
    rows = []
    with Car.open(URL, record=record) as car:
        car.arm()
        motion = next(car.states()).estimate.predict(car.now)
        path = TRACK.moved(motion.pose.x, motion.pose.y, motion.pose.yaw)
        law, s, begun = Stanley(path, car.files.config.geometry.wheelbase, gain), 0.0, car.now
        for state in car.states(duration=seconds):
            motion, t = state.estimate.predict(car.now), car.now - begun
            car.drive(steering=law.steer(motion), throttle=throttle(t))
            s = path.closest(motion.pose.x, motion.pose.y, s)
            offset = path.offset(motion.pose.x, motion.pose.y, s)
            rows.append((t, motion.pose.x, motion.pose.y, offset, motion.speed))
    return np.array(rows), path


def rms(offset):
    return 100.0 * float(np.sqrt(np.mean(np.square(offset))))

# %% [markdown]
# Two gains, each for some 20 s. The throttle alternates, so that the drive can tell motor and friction apart later: a drive for identification has to move what it is to identify.

# %%
def steps(t):
    return 0.36 if int(t / 1.5) % 2 else 0.24


runs = {gain: drive(gain, 45.0 if gain == 1.5 else 20.0, steps, f"stanley-{gain}.mcap")
        for gain in (1.5, 8.0)}

figure, (floor, way) = plt.subplots(1, 2, figsize=(11, 3.8), width_ratios=(1, 1.5))
for gain, (rows, path) in runs.items():
    rows = rows[150:]  # until then the room learns where on the car the marker sits
    floor.plot(rows[:, 1], rows[:, 2], lw=1)
    way.plot(rows[:, 0], 100 * rows[:, 3], lw=1,
             label=f"gain {gain}: {rms(rows[:1850, 3]):.1f} cm rms")
floor.plot(path.x, path.y, "k--", lw=0.8)
floor.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
way.set(xlabel="t [s]", ylabel="left of the path [cm]", xlim=(0, 20))
way.legend(fontsize=8)
figure.tight_layout()

# %% [markdown]
# The wheels answer late: the small gain runs wide in the bends, the large one swings. This is where a model helps.
#
# ## A model from this drive
#
# `identify all --joint` fits friction, motor, steering, delays and tyres at once, by predictions of one second. It begins at the paper's values.
# The table says of each number how sure it is; *no* marks what this drive did not tell.

# %% language="sh"
# dart-hal identify all --joint stanley-1.5.mcap stanley-8.0.mcap --base paper --out identified.toml 2>/dev/null

# %% [markdown]
# ## Contouring control by three models
#
# The same predictive controller ([method](../explanation/mpc.md)) at 1.5 m/s: by the paper's model, by the identified one, and by the truth, which only an emulated
# car can tell. A model belongs to a car by lying in the folder of the car's name.

# %%
def lap(model, speed=1.5):
    """(rows (x, y, offset, way), Follower) of two laps; the first finds where the marker sits."""
    with Car.open(URL) as car:
        name = car.files.config.name
    home = Path("by") / model.name / name
    home.mkdir(parents=True, exist_ok=True)
    save_model(model_of(replace(model, name=name)), home / "model.toml")
    with Car.open(URL, cars=home.parent) as car:
        follower = Follower(TRACK, plant_of(car.files), speed, "mpcc",
                            Rules(laps=2, duration=60.0, lane=1.0, here=True))
        car.arm()
        for state in car.states(duration=90.0):
            steering, wanted = follower.answer(state.estimate.predict(car.now))
            if follower.phase is Phase.ENDED:
                break
            car.drive_speed(steering=steering, speed=wanted)
    return follower.driven.table[:, [1, 2, 3, 6]], follower


models = {"the paper's": "paper", "identified": "identified.toml", "the truth": "upstream-2024"}
laps = {name: lap(replace(find_model(where)[1], name=name.replace(" ", "-")))
        for name, where in models.items()}

# %%
figure, (floor, way) = plt.subplots(1, 2, figsize=(11, 3.8), width_ratios=(1, 1.5))
for name, (rows, follower) in laps.items():
    along = rows[:, 3] - follower.begun_at - TRACK.length
    x, y, offset, _ = rows[along > 0].T
    floor.plot(x, y, lw=1)
    way.plot(along[along > 0], 100 * offset, lw=1, label=f"{name}: {rms(offset):.1f} cm rms")
    print(f"{name:12s} {rms(offset):4.1f} cm rms, {100 * np.abs(offset).max():4.1f} at most, "
          f"lap of {follower.driven.lap_times[-1]:.2f} s")
floor.plot(follower.path.x, follower.path.y, "k--", lw=0.8)
floor.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
way.set(xlabel="way along the track [m]", ylabel="left of the path [cm]")
way.legend(fontsize=8)
figure.tight_layout()

# %% [markdown]
# ## Where to go from here
#
# - On a real car: `URL = "serial:///dev/ttyUSB0?i2c=1"`, poses by [motion capture](../how_to/poses.md) or [lidar](../how_to/localising.md); first the [first drive of a built car](../build_guide/10_first_drive.md).
# - A tracker of your own in `dart-hal follow`'s place: `Follower(path, plant, speed, lambda path, plant: Yours(path, plant))`, see [following](../how_to/following.md).
# - When a model is not enough: [first diagnosis](../tutorials/first_diagnosis.md) names what it lacks.
