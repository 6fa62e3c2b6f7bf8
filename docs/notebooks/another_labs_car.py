# %% [markdown]
# # Another lab's car: from its log to a named fault
#
# For an engineer with **a car and logs of their own**. The log here is a CSV file of a 1:10 car that this project never drove: motion capture and commands, 142 s
# (data set *zheng2022*, Apache 2.0, `docs/notebooks/data`). A car with a speed loop follows. The page [your own recordings](../how_to/own_recordings.md) explains each step.
#
# The text of this notebook is `docs/notebooks/another_labs_car.py`. The log is cut in two: the first 60 % trains, the rest tests.

# %%
import gzip
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import dart_lab

plt.rcParams.update({"figure.dpi": 72, "axes.grid": True, "grid.alpha": 0.3})
LOG = Path(dart_lab.__file__).parents[2] / "docs" / "notebooks" / "data" / "zheng2022_day1.csv.gz"
header, *rows = gzip.decompress(LOG.read_bytes()).decode().splitlines()
names = header.split(",")
values = np.array([row.split(",") for row in rows], dtype=float)


def write_log(table, name):
    """Write the first 60 % of a log for training, and the rest for the test."""
    cut = round(0.6 * len(table))
    for part, chosen in (("train", table[:cut]), ("test", table[cut:])):
        np.savetxt(f"{name}_{part}.csv", chosen, fmt="%.7f", delimiter=",", header=header, comments="")


write_log(values, "original")
x, y, throttle, steering = (values[:, names.index(n)] for n in ("vicon x", "vicon y", "throttle", "steering"))
figure, (path, commands) = plt.subplots(1, 2, figsize=(11, 3.5))
path.plot(x, y, lw=0.8)
path.set(title="path of the marker [m]", aspect="equal")
commands.plot(values[:3000, 0] - values[0, 0], steering[:3000], label="steering")
commands.plot(values[:3000, 0] - values[0, 0], throttle[:3000], label="throttle")
commands.set(title="commands of the first 30 s", xlabel="time [s]")
commands.legend()
plt.show()

# %% [markdown]
# ## Which column is what
#
# `--guess` proposes a map from the names and from the data, each line with its evidence. What the data do not contain is marked *TO ANSWER*.

# %% language="sh"
# dart-hal data import original_train.csv --guess --out map.toml 2>/dev/null
# cat map.toml

# %% [markdown]
# ## Import
#
# The streams are compared with each other before anything is written: a reversed steering column is an error that states its remedy. Of this car only wheelbase and mass are known; `car new`
# estimates the rest, with its error.

# %% language="sh"
# mkdir -p cars
# dart-hal car new other --wheelbase 0.325+-0.002 --mass 3.5+-0.05 --l-f 0.1625+-0.01 --max-steering 0.5+-0.05 --cars cars 2>/dev/null
# for part in train test; do
#     dart-hal data import original_$part.csv --map map.toml --car other --cars cars --out $part.mcap 2>/dev/null | tail -4
# done
# sed 's/value = "steering"/value = {column = "steering", sign = -1}/' map.toml > reversed.toml
# dart-hal data import original_train.csv --map reversed.toml --out wrong.mcap 2>&1 | grep -A4 error || true

# %% [markdown]
# ## A model of the car
#
# The fit starts at the sizes of the car, and at the values of DART for all else. It is tested on the rest of the log.

# %% language="sh"
# dart-hal identify all --joint train.mcap --car other --cars cars --base paper --out model.toml >/dev/null 2>&1
# dart-hal evaluate test.mcap --model paper --car other --cars cars --json > start.json 2>/dev/null
# dart-hal evaluate test.mcap --model model.toml --json > fitted.json 2>/dev/null

# %%
start, fitted = (json.loads(Path(name).read_text()) for name in ("start.json", "fitted.json"))
errors = {"sizes alone": start["horizons"]["1.0"]["pooled"], "fitted": fitted["horizons"]["1.0"]["pooled"],
          "constant velocity": fitted["ctrv"]["1.0"]["pooled"]}
labels = {"vx": "speed [m/s]", "vy": "lateral velocity [m/s]", "yaw_rate": "yaw rate [rad/s]", "position": "position [m]"}
figure, axes = plt.subplots(1, 4, figsize=(12, 3))
for ax, (key, label) in zip(axes, labels.items(), strict=True):
    ax.bar(list(errors), [e[key] for e in errors.values()], color=["#bbb", "#06c", "#e80"])
    ax.set_title(label)
    ax.tick_params(axis="x", rotation=20)
figure.suptitle("errors 1 s ahead on the rest of the log")
figure.tight_layout()
plt.show()

# %% [markdown]
# ## A fault hidden in the log
#
# The same log, but the steering acts 120 ms later than logged. The model is that of the car without the fault.

# %%
late = values.copy()
late[:-12, names.index("steering")] = values[12:, names.index("steering")]
write_log(late, "late")

# %% language="sh"
# for part in train test; do
#     dart-hal data import late_$part.csv --map map.toml --car other --cars cars --out late_$part.mcap >/dev/null 2>&1
# done
# dart-hal diagnose --model model.toml --train late_train.mcap --test late_test.mcap --json > found.json 2>/dev/null

# %%
found = json.loads(Path("found.json").read_text())
for claim in found["parameters"]:
    for name, q in claim["quantities"].items():
        print(f"{claim['title']}: {name} {q['before']:.0f} -> {q['after']:.0f} +- {q['std']:.0f} {q['unit']}")
for cause in found["causes"]:
    k = cause["parameters"]["k"]
    print(f"cause: {cause['effect']} {k['value']:.3f} +- {k['std']:.3f} {k['unit']}")

# %% [markdown]
# ## A second car, with a speed loop
#
# An F1TENTH car of the University of Pennsylvania (2022, MIT licence, `docs/notebooks/data/LICENSE_f1tenth`), with encoder and IMU. Its column `throttle` is a commanded speed in an unknown
# unit, and its slow drive `ds3` had a speed limit. The checks of the import state limits by the poses, and that the accelerometer is mounted across.

# %%
for name in ("ds3", "ds4"):
    Path(f"{name}.csv").write_bytes(gzip.decompress(LOG.with_name(f"f1tenth_{name}.csv.gz").read_bytes()))

# %% language="sh"
# dart-hal data import ds4.csv --guess --out any.toml 2>/dev/null | grep accelerometer
# sed 's/kind = "duty"/kind = "speed"/' any.toml > unscaled.toml
# for name in ds4 ds3; do
#     NO_COLOR=1 dart-hal data import $name.csv --map unscaled.toml --out $name.mcap 2>/dev/null | grep "^throttle: .*scale"
# done

# %% [markdown]
# By the encoder, which reads 1.2 times the speed of the poses, a command of 1 is 5.3 m/s, and the limit of the slow drive 1.3 m/s. With both in the maps, the study fits the slow drive and tests on the fast one.

# %% language="sh"
# sed 's/value = "throttle"/value = {column = "throttle", scale = 5.3}/' unscaled.toml > ds4.toml
# sed 's/kind = "speed"/&\nlimit = 1.3/' ds4.toml > ds3.toml
# dart-hal car new penn --wheelbase 0.32+-0.002 --mass 3.33+-0.05 --l-f 0.208+-0.01 --max-steering 0.45+-0.05 --drive all --cars cars >/dev/null 2>&1
# for name in ds3 ds4; do
#     dart-hal data import $name.csv --map $name.toml --car penn --cars cars --out f1tenth_$name.mcap >/dev/null 2>&1
# done
# dart-hal study f1tenth_ds3.mcap f1tenth_ds4.mcap --car penn --cars cars --json > study.json 2>/dev/null

# %%
stages = json.loads(Path("study.json").read_text())["stages"]
pooled = stages["validation"]["facts"]["pooled"]
print("rms error 1 s ahead on the fast drive")
print(" " * 26 + "".join(f"{name:>19}" for name in pooled))
for key, label in labels.items():
    print(f"{label:26}" + "".join(f"{e[key]:19.2f}" for e in pooled.values()))
print()
print(stages["diagnosis"]["verdict"])
print("\n".join(stages["diagnosis"]["lines"][:4]))
