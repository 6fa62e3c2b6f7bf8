# %% [markdown]
# # Calibrate, identify, evaluate, diagnose
#
# For a **PhD student** with a new car. You measure the steering of an emulated car, identify its model, see how well the model predicts, and find what changed in the car
# a week later. It needs no hardware: type `pip install -e '.[lab]'` in the checkout once, then run the cells from top to bottom.
# The [tutorial of the same course](../tutorials/own_car.md) does all of it with all parts and the firmware in the emulator.
#
# The text of this notebook is `docs/notebooks/calibrate_identify_diagnose.py`.

# %%
import json
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Image

from dart_hal import Car, Pursuit, figure_of_eight, plant_of

URL = "sim://?seed=11&mocap=1&nano=mock"
os.environ |= {"DART_HAL_URL": URL, "DART_CARS": "cars"}  # for every command below
os.environ |= {"FORCE_COLOR": "", "COLUMNS": "100"}  # which answers in plain text
plt.rcParams.update({"figure.dpi": 72, "axes.grid": True, "grid.alpha": 0.3})

# %% [markdown]
# Number 11 is a car with secrets: its steering, speed controller, encoder and IMU differ from every data sheet. For a real car the URL is `serial:///dev/ttyUSB0?i2c=1`;
# nothing else changes.
#
# ## Calibrate
#
# Slow circles to both sides, from lock to lock. Each angle comes with its standard error. `dart-hal calibrate all` measures every part; here the steering will do.

# %% language="sh"
# dart-hal calibrate steering --yes --plot steering.png 2>/dev/null

# %%
Image("steering.png", width=620)

# %% [markdown]
# The simulation knows the truth. On a real car nobody does.

# %% language="sh"
# dart-hal sim --reveal 2>/dev/null | grep -i steering

# %% [markdown]
# ## Identify
#
# A drive for identification must move what is to be identified: how the car rolls and pulls, how it answers and turns. This one steps the steering at two speeds, on a floor of 8 m x 8 m.
# `--joint` then fits all parameters at once, by predictions of one second; the motion capture is in the recording.

# %% language="sh"
# dart-hal experiment steps --yes --space 8 --out steps.mcap >/dev/null 2>&1
# dart-hal identify all --joint steps.mcap --base paper --out cars/sim-11/model.toml 2>/dev/null

# %% [markdown]
# *Identifiable: no* marks a number that this drive did not tell. The prediction below says whether that matters; more kinds of drive tell more ([experiments](../how_to/experiments.md)).
#
# ## Evaluate
#
# A fit looks good on its own data. So drive something else: figures of eight, by pure pursuit.

# %%
with Car.open(URL, cars="cars", record="eights.mcap") as car:
    car.arm()
    pose = next(car.states()).estimate.predict(car.now).pose
    path = figure_of_eight(0.9).moved(pose.x, pose.y, pose.yaw)
    pursuit = Pursuit(path, plant_of(car.files))
    for s in car.states(duration=30.0):
        car.drive_speed(steering=pursuit.steer(s.estimate.predict(car.now)), speed=1.0)

# %% [markdown]
# Then predict that drive from the logged commands alone. The table has the model's errors before the bar, those of constant velocity and yaw rate behind it.

# %% language="sh"
# for model in paper cars/sim-11/model.toml; do
#     echo "== $model"
#     dart-hal evaluate --model $model eights.mcap --plot $(basename $model .toml).png 2>/dev/null
# done

# %%
Image("model.png", width=620)

# %% [markdown]
# ## Something changes
#
# A week later the steering of the car has become slow. Nobody says so: the URL hides it from the programs.

# %% language="sh"
# export DART_HAL_URL="$DART_HAL_URL&effect=steering_lag:0.12"
# dart-hal experiment steps --yes --space 8 --out later.mcap >/dev/null 2>&1
# dart-hal diagnose --model cars/sim-11/model.toml --no-refit \
#     --train later.mcap --out extended.toml --json > found.json 2>/dev/null

# %%
found = json.loads(Path("found.json").read_text())
print(found["verdict"].replace("_", " "))
for cause in found["causes"]:
    sizes = ", ".join(f"{name} {k['value']:.3f} +- {k['std']:.3f} {k['unit']}"
                      for name, k in cause["parameters"].items())
    print(f"{cause['title']}: {cause['effect']}, {sizes}; probability {cause['probability']:.2f}")
    for line in cause["evidence"]:
        print(" ", line)

# %% [markdown]
# The identified model has a lag of its own, so the two add up to that of the steering, within their errors. The IMU of this car is turned indeed, and was not calibrated here.
# What the lag means in the data: the yaw rate after one step of the steering, before and after the change.

# %%
def step_of(recording):
    """t [s] and yaw rate [rad/s] about the first large step at speed."""
    with Car.open(f"replay://{recording}") as car:
        t, steering, rate, speed = np.array([
            (s.t, s.applied.steering, s.yaw_rate or 0.0, s.speed) for s in car.states()]).T
    first = next(k for k in np.flatnonzero(np.abs(np.diff(steering)) > 0.15) if speed[k] > 0.5)
    shown = slice(first - 30, first + 120)
    return t[shown] - t[first], rate[shown]


figure, axes = plt.subplots(figsize=(7, 3.2))
for recording, name in (("steps.mcap", "before"), ("later.mcap", "a week later")):
    axes.plot(*step_of(recording), lw=1.4, label=name)
axes.set(xlabel="s after a step of the steering", ylabel="yaw rate [rad/s]")
axes.legend(fontsize=8)
figure.tight_layout()

# %% [markdown]
# `extended.toml` is the model with its cause: simulators, controllers and `evaluate` take it like any other.
#
# ## Where to go from here
#
# - Every part of the car: `dart-hal calibrate all` ([calibrating](../how_to/calibration.md)).
# - What a diagnosis can and cannot know: [diagnosing](../how_to/diagnosis.md), [the method](../explanation/diagnosis_method.md).
# - Drive by the model: [a controller of your own](own_controller.ipynb).
