"""HTML page of ``dart-hal calibrate --html``: the data with their fit, then one line per value."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dart_hal.calibration.measured import FitGraph, Measured, unit_of
from dart_hal.calibration.plot import model_pulses
from dart_hal.calibration.result import Result, SteeringResult
from dart_hal.core.config import Calibration, CarFiles, DriveTable, Quantity
from dart_hal.core.types import INTERVAL_90
from dart_lab.pages.report_page import MIN_CHANGE_Z
from dart_lab.report import charts, page, svg
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import significant, with_error


@dataclass(frozen=True, slots=True)
class MeasuredValue:
    """One measured value; previous: the value and standard error that it replaces, NaN for none."""

    name: str
    value: float
    std: float
    unit: str
    previous: float = math.nan
    previous_std: float = math.nan

    def verdict(self) -> str:
        """State whether the value is new, as before or changed."""
        if not math.isfinite(self.previous):
            return "new"
        z = abs(self.value - self.previous) / (math.hypot(self.std, self.previous_std) or math.inf)
        if z <= MIN_CHANGE_Z:
            return "as before"
        return f"changed by {significant(self.value - self.previous)}{self.unit}"

    def format_value(self) -> str:
        """Return the value with the half-width of its 90 % interval and its unit."""
        return f"{with_error(self.value, INTERVAL_90 * self.std)}{self.unit}"


def write_page(found: Sequence[Result], *, path: Path, files: CarFiles | None,
               previous: Calibration | None, command: str) -> Path:
    """Write the page of one or more results.

    files: of the car; None for results of recordings. previous: calibration that the results
    replace. Errors: OSError.
    """
    values = [value for result in found for value in list_values(result, previous)]
    # The steering map is the picture of a whole calibration.
    shown = sorted(found, key=lambda result: not isinstance(result, SteeringResult))
    graphs = [picture for result in shown if (picture := _draw_data(result, files))]
    first = graphs[0] if graphs else _draw_values(values)
    car = files.config.name if files else str(getattr(found[0], "car", "")) if found else ""
    # Later sections are for readers who want to know more than the verdict.
    sections = {
        "values": ("Values", table(("value", "measured, 90 % interval", "verdict"),
                                   [(_breakable(v.name), v.format_value(), v.verdict())
                                    for v in values], 1)),
        "details": ("Details", join([
            *(page.foldable(f"Data of {result.verb}", _details(result)) for result in found),
            *(page.foldable("Data and fit", picture) for picture in graphs[1:]),
            *([page.foldable("All values and their intervals", _draw_values(values))]
              if graphs and values else [])])),
        "made": ("How this was made", join([
            el("p", el("code", command)),
            page.download({result.verb: result.to_json() for result in found},
                          "calibration.json")]))}
    top = el("div", el("div", first), _verdict(found, values), class_="pair")
    return page.write(path, page.page(f"calibration of {car}", f"Calibration of {car}", top,
                                      sections))


def _verdict(found: Sequence[Result], values: Sequence[MeasuredValue]) -> Html:
    """Return the box: what was measured, what changed, what needs attention."""
    changed = [v.name for v in values if v.verdict().startswith("changed")]
    lead = (f"{', '.join(result.verb for result in found) or 'Nothing'}: {len(values)} "
            f"value{'' if len(values) == 1 else 's'} measured.")
    lines = [line for result in found for line in result.summary().lines]
    # An indented line is a detail of the fit above it, or a caution.
    cautions = [line.strip() for line in lines if line.startswith("  caution:")]
    fits = [line for line in lines if not line.startswith("  ")]
    return page.card(
        el("p", lead, class_="big"),
        page.text(f"Changed beyond {MIN_CHANGE_Z:.0f} standard errors: {', '.join(changed)}."
                  if changed else ""),
        page.notices(cautions), page.items(fits if len(found) == 1 else ()),
        good=bool(found) and not cautions)


def _breakable(name: str) -> Html:
    """Return the name of a value that may break after its table and its words, for a phone."""
    return join(part for piece in re.split(r"(?<=[._])", name) for part in (piece, el("wbr")))


def list_values(result: Result, previous: Calibration | None) -> list[MeasuredValue]:
    """Return the single values of a result, and the ends of a steering map."""
    if isinstance(result, SteeringResult):
        return _steering_values(result, previous)
    if not isinstance(result, Measured):
        # A procedure of another package: its own table is under the details.
        return []
    old = previous.quantities() if previous is not None else {}
    out = []
    for name, q in result.quantities.items():
        if isinstance(q, Quantity):
            past = old.get(name)
            known: tuple[float, ...] = ((past.value, past.std) if isinstance(past, Quantity)
                                        else ())
            out.append(MeasuredValue(name, q.value, q.std, unit_of(name), *known))
    for name, drive in result.others.items():
        if isinstance(drive, DriveTable):
            past_drive = previous.throttle.drive if previous is not None else None
            # The previous curve is read at the speeds of the new one.
            for speed, pulse, std in zip(drive.speed, drive.pulse_us, drive.std_us, strict=True):
                known = () if past_drive is None else (
                    float(np.interp(speed, past_drive.speed, past_drive.pulse_us)),
                    float(np.interp(speed, past_drive.speed, past_drive.std_us)))
                out.append(MeasuredValue(f"{name} at {speed:.2f} m/s", pulse, std, " us", *known))
    return out


def _steering_values(result: SteeringResult, previous: Calibration | None) -> list[MeasuredValue]:
    """Return the angles at full right, straight and full left, and the backlash."""
    past = previous.steering if previous is not None else None
    out = []
    for words, i in (("full right", 0), ("command 0", int(np.argmin(np.abs(result.command)))),
                     ("full left", len(result.command) - 1)):
        known: tuple[float, ...] = ()
        # Compared at the same pulse: the command of a pulse depends on the map.
        if past is not None and past.map is not None and result.pulse_us is not None:
            pulse = float(result.pulse_us[i])
            known = (float(np.interp(pulse, past.map.pulse_us, past.map.angle_rad)),
                     float(np.interp(pulse, past.map.pulse_us, past.map.std_rad)))
        out.append(MeasuredValue(f"angle at {words}", float(result.angle[i]),
                                 float(result.angle_std[i]), " rad", *known))
    if result.backlash is not None:
        known = ((past.backlash.value, past.backlash.std)
                 if past is not None and past.backlash is not None else ())
        out.append(MeasuredValue("backlash", result.backlash.value, result.backlash.std, " rad",
                                 *known))
    return out


def _details(result: Result) -> Html:
    """Return the table of the terminal and all notes."""
    summary = result.summary()
    rows = [(_breakable(name), *values) for name, *values in summary.rows]
    return join([table(summary.columns, rows, 1, summary.title),
                 page.items(line.strip() for line in summary.lines)])


def _draw_values(values: Sequence[MeasuredValue]) -> Html:
    """Draw every value with its interval, and the value before."""
    if not values:
        return Html()
    # Values of different units share a picture, so each is drawn relative to its far end.
    rows = [charts.IntervalRow(v.name, v.value, INTERVAL_90 * v.std, v.previous, v.format_value())
            for v in values]
    entries = [("after", "measured, 90 % interval")]
    if any(math.isfinite(v.previous) for v in values):
        entries.append(("before", "before"))
    return join([svg.legend(entries), page.figure(
        "What was measured; the wider a line, the less is known", charts.draw_intervals(
            "values with intervals", "relative to the far end of the interval", rows))])


def _draw_data(result: Result, files: CarFiles | None) -> Html:
    """Draw measurements, fit and interval; empty for a result without them."""
    if isinstance(result, SteeringResult):
        return _draw_steering(result)
    graph = getattr(result, "graph", None) or _throttle_graph(result, files)
    if graph is None:
        return Html()
    return _draw_graph(graph)


def _draw_graph(graph: FitGraph) -> Html:
    """Draw the points under the fit; of many points some, evenly."""
    step = -(-len(graph.x) // charts.MAX_CURVE_POINTS)
    x = graph.x[::step]
    nothing = np.full(len(x), math.nan)
    return join([svg.legend([("before", graph.points_name), ("after", graph.curve_name)]),
                 page.figure(graph.title, charts.draw_lines(
                     graph.title, graph.x_label, graph.y_label,
                     [charts.Series(x, graph.y[::step], nothing, "before", joined=False),
                      charts.Series(graph.fit_x, graph.fit_y, graph.half, "after",
                                    marked=len(graph.fit_x) == 1)]))])


def _throttle_graph(result: Result, files: CarFiles | None) -> FitGraph | None:
    """Return the pulses that keep a speed, next to those of the model; None for other results."""
    drive = getattr(result, "others", {}).get("throttle.drive")
    if not isinstance(drive, DriveTable) or files is None:
        return None
    speed = np.array(drive.speed)
    pulse = np.array(drive.pulse_us) - files.neutral_us
    return FitGraph("Pulse that keeps a speed", "speed [m/s]", "pulse - neutral [us]",
                 speed, model_pulses(files, speed) - files.neutral_us,
                 speed, pulse, INTERVAL_90 * np.array(drive.std_us),
                 points_name="model", curve_name="measured, 90 % interval")


def _draw_steering(result: SteeringResult) -> Html:
    """Draw the samples and the map with its 90 % interval."""
    series = []
    entries = []
    if result.samples is not None:
        command, angle, direction = result.samples
        step = -(-len(command) // charts.MAX_CURVE_POINTS)
        for side, style, words in ((1.0, "before", "reached from the right"),
                                   (-1.0, "refit", "reached from the left"),
                                   (0.0, "other", "first of a run")):
            rows = np.flatnonzero(direction == side)[::step]
            if len(rows):
                entries.append((style, words))
                series.append(charts.Series(command[rows], np.degrees(angle[rows]),
                                            np.full(len(rows), math.nan), style, joined=False))
    # The map is drawn below the samples, so that both can be compared.
    half = np.degrees(INTERVAL_90 * result.angle_std)
    series.insert(0, charts.Series(result.command, np.degrees(result.angle), half, "after",
                                   marked=False))
    return join([svg.legend([*entries, ("after", "map, 90 % interval")]),
                 page.figure("Steering map over the measurements", charts.draw_lines(
                     "steering map", "steering command, +1 = full left",
                     "road-wheel angle [deg]", series))])

