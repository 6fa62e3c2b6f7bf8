# %% [markdown]
# # An exercise for a class: four cars, hidden faults, and its marking
#
# For a **lecturer**. Four emulated cars drive in one room; then each group gets the recording of a car in which something may be wrong, and says what.
# The last part marks the answers. Nothing but a computer is needed: type `pip install -e '.[lab]'` in the checkout once, then run the cells from top to bottom.
#
# The text of this notebook is `docs/notebooks/exercise_for_a_class.py`.

# %%
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from dart_hal import Car, Fleet, find_model, read_run
from dart_lab import Floor, apply, check_inputs, conduct, diagnose, make_plan

plt.rcParams.update({"figure.dpi": 72, "axes.grid": True, "grid.alpha": 0.3})

# %% [markdown]
# ## Four cars in one room
#
# The numbers 1 to 4 are four cars with secrets of their own. `world` puts them into one room, `mocap` lets one motion capture see them. All get the same command:
# a steering of 0.15 rad at 0.6 m/s.

# %%
places = {"1": "0,-2.6,0", "2": "0,0.6,0", "3": "3.8,-2.6,0", "4": "3.8,0.6,0"}
urls = [f"sim://?nano=mock&seed={seed}&world=class&mocap=1&at={at}" for seed, at in places.items()]
ways = []
with Fleet.open(urls) as fleet:
    fleet.arm(waive=["CALIBRATION_MISSING"])
    for states in fleet.states(duration=18.0):
        poses = [state.estimate.pose for state in states]
        ways.append([(pose.x, pose.y) for pose in poses])
        for car in fleet.cars:
            car.drive_speed(steering=0.15, speed=0.6)
    assert not fleet.contacts
ways = np.array(ways[150:])  # once the room has seen how each car moves

figure, floor = plt.subplots(figsize=(7, 4))
for n, seed in enumerate(places):
    floor.plot(*ways[:, n].T, lw=1.5, label=f"car {seed}")
floor.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
floor.legend(fontsize=8, loc="center right")
figure.tight_layout()

# %% [markdown]
# The same command, four circles: no two cars steer alike before they are calibrated. That is the first lesson, and it takes a minute.
#
# ## What is hidden
#
# The next cell stays with you. Each group's car is the car of the paper and, in three of four, one fault of the [catalogue](../reference/effects.md).
# `NAMES` is what the sheet tells: the faults that may be there. One car has none: who always finds something loses points.

# %%
HIDDEN = {"A": None, "B": ("steering_lag", 0.12), "C": ("motor_gain", -0.15),
          "D": ("steering_backlash", 0.1)}
NAMES = ("steering_lag", "steering_backlash", "steering_gain", "steering_trim", "motor_gain",
         "quadratic_drag")


def url_of(fault):
    return "sim://?nano=mock" + (f"&effect={fault[0]}:{fault[1]}" if fault else "")


for group, fault in HIDDEN.items():
    with Car.open(url_of(fault), record=f"{group}.mcap") as car:
        conduct(car, make_plan("steps", car.files, Floor.parse("10"), None))
print(*sorted(path.name for path in Path().glob("*.mcap")))

# %% [markdown]
# ## What a group does
#
# It gets `X.mcap`, the sheet, and this: a recording opens like a car, `replay://` in place of `sim://`. Steps of the steering were driven at two speeds.

# %%
def seen(group):
    """t [s], steering command [rad], yaw rate [rad/s], speed [m/s], throttle [-]: (n, 5)."""
    with Car.open(f"replay://{group}.mcap") as car:
        return np.array([(s.t, s.applied.steering, s.yaw_rate or 0.0, s.speed, s.applied.throttle)
                         for s in car.states()])


figure, axes = plt.subplots(1, 2, figsize=(11, 3.6), width_ratios=(1.4, 1))
for group in HIDDEN:
    t, steering, rate, speed, throttle = seen(group).T
    steps = np.flatnonzero(np.abs(np.diff(steering)) > 0.15)
    first = next(k for k in steps if speed[k] > 0.5)
    shown = slice(first - 30, first + 160)
    axes[0].plot(t[shown] - t[first], rate[shown], lw=1.3, label=f"{group}")
    held = (np.abs(np.gradient(speed, t)) < 0.05) & (speed > 0.3) & (np.abs(steering) < 0.3)
    axes[1].plot(throttle[held], speed[held], ".", ms=2, alpha=0.5, label=f"{group}")
axes[0].set(xlabel="s after a step of the steering", ylabel="yaw rate [rad/s]")
axes[1].set(xlabel="throttle", ylabel="speed [m/s]")
for panel in axes:
    panel.legend(fontsize=8, markerscale=4)
figure.tight_layout()

# %% [markdown]
# ## The solution
#
# `diagnose` is given the model of the car as it should be, the recording, and the same six names. It is not told what is hidden.

# %%
file, known = find_model("paper")
pulse, lock = 0.013, 0.098  # s: wait for a PWM frame and the pulse; the servo's travel to its end
known = apply(replace(known, delay=replace(known.delay, steering_s=pulse, throttle_s=pulse)),
              "steering_rate_limit", k=lock)

solution = {}
for group in HIDDEN:
    sides = check_inputs([read_run(Path(f"{group}.mcap"))], [], known)
    found = diagnose(file, known, sides.train, sides.test, refit=False, only=NAMES, max_causes=1)
    cause = found.causes[0] if found.causes else None
    solution[group] = (cause.effect, cause.parameters["k"].value) if cause else None
    said = f"{cause.effect} {cause.parameters['k'].value:.3f}" if cause else "nothing is wrong"
    print(f"{group}: {said}")

# %% [markdown]
# ## The marking
#
# Two points for the name, a third one for a size within a fifth. Nothing where nothing is: three. These answers are examples; the last group is `diagnose` itself.

# %%
ANSWERS = {
    "first group": {"A": None, "B": ("steering_lag", 0.10), "C": ("motor_gain", -0.1),
                    "D": ("steering_gain", -0.2)},
    "second group": {"A": ("quadratic_drag", 0.1), "B": ("steering_backlash", 0.08),
                     "C": ("motor_gain", -0.16), "D": ("steering_backlash", 0.09)},
    "diagnose": solution,
}


def points(answer, fault):
    """Of three."""
    if answer is None or fault is None:
        return 3 * (answer is fault)
    named = answer[0] == fault[0]
    return 2 * named + (named and abs(answer[1] - fault[1]) <= 0.2 * abs(fault[1]))


print("              ", *(f"{group:>4s}" for group in HIDDEN), "   of", 3 * len(HIDDEN))
for name, answers in ANSWERS.items():
    marks = [points(answers[group], fault) for group, fault in HIDDEN.items()]
    print(f"{name:14s}", *(f"{mark:4d}" for mark in marks), f"{sum(marks):5d}")

# %% [markdown]
# ## Another class, another exercise
#
# - Other faults and sizes: the [catalogue](../reference/effects.md). Two at once: `effect=steering_lag:0.08,motor_gain:-0.1`. Without `only=` any of the catalogue may be named; it takes longer.
# - Faults of sensors and cables: `fail=imu:off@4s`, see [URLs of a car](../reference/urls.md).
# - Cars that talk to each other, and one STOP for all: [several cars](../how_to/fleet.md).
# - Why it does not name everything: [the method](../explanation/diagnosis_method.md), and [how often it is right](../results/campaign.md).
