# %% [markdown]
# # Another lab's car: from its log to a named fault
#
# For an engineer with **a car and logs of their own**. The log here is a CSV file of a 1:10 car that this project never drove: motion capture and commands, 142 s
# (data set *zheng2022*, Apache 2.0, `docs/notebooks/data`). The same steps as commands are on the page [your own recordings](../how_to/own_recordings.md).
#
# The text of this notebook is `docs/notebooks/another_labs_car.py`.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import msgspec
import numpy as np

import dart_lab
from dart_hal import find_model, read_any
from dart_hal.recording.imported import write_imported
from dart_hal.vehicle.load import vehicle_of
from dart_lab import check_inputs, diagnose, evaluate, identify
from dart_lab.identification.write import build_model
from dart_lab.importing import check_data, convert_tables, guess_map, read_tables

plt.rcParams.update({"figure.dpi": 72, "axes.grid": True, "grid.alpha": 0.3})
LOG = Path(dart_lab.__file__).parents[2] / "docs" / "notebooks" / "data" / "zheng2022_day1.csv.gz"

# %% [markdown]
# ## Which column is what
#
# `guess_map` proposes a map from the names and from the data, each line with its evidence. What no data can tell is marked *TO ANSWER*.

# %%
(log,) = read_tables([LOG])
guess = guess_map([log])
print(guess.text)

# %% [markdown]
# ## Import
#
# The streams are compared with each other before anything is written. A reversed steering column, for example, is an error with its remedy.

# %%
data = convert_tables([log], guess.map, guess.text)
for finding in check_data(data):
    print(finding)
wrong = dict(log.columns, steering=-log.columns["steering"])
print()
for finding in check_data(convert_tables([type(log)("log", wrong)], guess.map)):
    if finding.severe:
        print(finding)


# %%
def record(columns, name):
    """Import columns of the log as two files: the first 60 % trains, the rest tests."""
    cut = round(0.6 * len(columns["steering"]))
    for part, rows in (("train", slice(0, cut)), ("test", slice(cut, None))):
        table = type(log)(name, {key: values[rows] for key, values in columns.items()})
        write_imported(convert_tables([table], guess.map), Path(f"{name}_{part}.mcap"))
    return read_any([f"{name}_train.mcap", f"{name}_test.mcap"])[0]


train, test = record(log.columns, "original")
print(train.marker)

# %% [markdown]
# ## A model from the sizes of the car
#
# Of this car only wheelbase and mass are known. All else starts at the values of DART, scaled, and is fitted to the first 60 % of the log.

# %%
start, _ = find_model("paper")
start = msgspec.structs.replace(start, body={"wheelbase": 0.325, "l_f": 0.1625, "l_r": 0.1625, "mass": 3.5, "yaw_inertia": 0.0638})
outcome = identify([train], start, joint=True)
model = build_model(outcome.fits, outcome.over(start), outcome.source, joint=outcome.joint).model
labels = {"vx": "speed [m/s]", "vy": "lateral velocity [m/s]", "yaw_rate": "yaw rate [rad/s]", "position": "position [m]"}
errors = {}
for name, m in (("sizes alone", start), ("fitted", model)):
    result = evaluate(vehicle_of(m), [test], limit=False)
    errors[name] = result.model.to_json()["1.0"]["pooled"]
errors["constant velocity"] = result.ctrv.to_json()["1.0"]["pooled"]
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
# The same log, but the steering acts 120 ms later than the log says. The model is that of the car without the fault.

# %%
late = dict(log.columns)
late["steering"] = np.concatenate([late["steering"][12:], np.full(12, late["steering"][-1])])
train, test = record(late, "late")
inputs = check_inputs([train], [test], vehicle_of(model))
found = diagnose(model, vehicle_of(model), inputs.train, inputs.test)
for claim in found.claims:
    for name, q in claim.quantities.items():
        print(f"{claim.title}: {name} {q.before:.0f} -> {q.after:.0f} +- {q.std:.0f} {q.unit}, probability {claim.probability:.2f}")
for cause in found.causes:
    print(cause.title, cause.parameters)
assert found.claims or found.causes

# %% [markdown]
# The delay is found with its size. The yaw inertia is found as well, and rightly so: it was a guess from mass and axles, and this car is more compact than the guess.
# `dart-hal car new` writes such a guess with its error, and the diagnosis may then move it.
