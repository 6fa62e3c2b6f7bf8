"""Paths in two windows of the test recordings: the worst one and the median one.

    1. The position errors of one model at the end of all windows order them.
    2. The window with the largest finite error and the one in the middle are taken.
    3. Every model is rolled out in these two, from the measured state with the logged commands.
    4. All paths are turned so that the measured car starts at (0, 0) and heads along x.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.cases import correct_poses
from dart_lab.identification.evaluation.prediction import CHANNELS
from dart_lab.identification.prediction import rollout
from dart_lab.identification.prediction.windows import WINDOW_LENGTH

from .error_summaries import PathWindow
from .gains import RecordingSet

MEASURED = "measured"
# Samples between points: 15 cm at 3 m/s, finer than a line of the picture shows.
PATH_POINT_SPACING = 5
POSITION = CHANNELS.index("position")


def find_paths(test: RecordingSet, models: Mapping[str, Vehicle], chosen_by: str
               ) -> tuple[PathWindow, ...]:
    """Find the worst and the median window of the test recordings, with the path of each model.

    models: as they predict from the logs of the test recordings; chosen_by: the one whose
    position errors order the windows. Empty without motion capture, and where no prediction is
    finite.
    """
    errors = test.errors(models[chosen_by])
    if errors is None or test.prepared is None:
        return ()
    position = errors[-1, POSITION]
    order = np.argsort(position, kind="stable")
    order = order[np.isfinite(position[order])]
    if not len(order):
        return ()
    picked = {"worst": int(order[-1]), "median": int(order[(len(order) - 1) // 2])}
    return tuple(_window(test, models, chosen_by, kind, index, float(position[index]))
                 for kind, index in picked.items())


def _window(test: RecordingSet, models: Mapping[str, Vehicle], chosen_by: str, kind: str,
            index: int, error: float) -> PathWindow:
    """Roll all models out in the window with number ``index`` of all test recordings."""
    assert test.prepared is not None
    cases = test.prepared.cases
    ends = np.cumsum([len(case) for case in cases])
    number = int(np.searchsorted(ends, index, side="right"))
    case = cases[number]
    start = int(case.windows.start[index - int(ends[number]) + len(case)])
    samples = np.arange(0, WINDOW_LENGTH + 1, PATH_POINT_SPACING)
    origin = rollout.states(case.grid, np.array([start]))[:, 0]
    paths = {MEASURED: _from_start(rollout.states(case.grid, start + samples)[:2], origin)}
    for name, p in models.items():
        freed, = correct_poses(p, [case], test.evidence.l_r)
        one = [(freed.grid, np.array([start]))]
        states = rollout.predict(apply_parameter_effects(p), one, [int(k) for k in samples[1:]])
        predicted = states[:, :2, 0].T
        first = rollout.measured_states(one, (0,))[0, :2]
        paths[name] = _from_start(np.concatenate([first, predicted], axis=1), origin)
    return PathWindow(kind, chosen_by, error, int(ends[-1]), case.file,
                      round(start * SAMPLE, 2), PATH_POINT_SPACING * SAMPLE, paths)


def _from_start(xy: FloatArray, origin: FloatArray) -> FloatArray:
    """Turn positions (2, n) into the axes of a car whose state is ``origin`` (6,)."""
    dx, dy = xy - origin[:2, None]
    c, s = np.cos(origin[2]), np.sin(origin[2])
    return np.stack([c * dx + s * dy, c * dy - s * dx])
