"""All sub-models of the paper on its own folders, in the order of its tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.fit import Estimate, Fit
from dart_lab.identification.outcome import Identification
from dart_lab.identification.report import FileReport, Published
from dart_lab.identification.write import Source

from .delay import Correlation, fit_delay
from .folders import FOLDERS, JoinedRows, read_folder
from .problem import CurveProblem, solve
from .problems import (
    coasting,
    fast,
    friction_problem,
    motion,
    motor_problem,
    steering_problem,
)
from .tyres import (
    FRONT,
    front_problem,
    front_problem_tanh,
    front_problem_without_e,
    rear_problem,
    rear_problem_with_offset,
    tyre_data,
)

NAMES = tuple(FOLDERS)


@dataclass(slots=True)
class AsPaper:
    """fits by name: the sub-models and, for the tyres, every row of the comparison.

    published: the paper's values beside them. derived: quantities that the
    data identify where single parameters are not identifiable. problems, rows,
    correlation: what was fitted, for pictures and benchmarks.
    """

    fits: dict[str, Fit] = field(default_factory=dict)
    files: dict[str, FileReport] = field(default_factory=dict)
    published: dict[str, Published] = field(default_factory=dict)
    derived: dict[str, dict[str, Estimate]] = field(default_factory=dict)
    problems: dict[str, CurveProblem] = field(default_factory=dict)
    rows: dict[str, JoinedRows] = field(default_factory=dict)
    correlation: Correlation | None = None


def fit_as_paper(root: str | Path, names: Sequence[str] = NAMES) -> AsPaper:
    """Fit the sub-models ``names`` to their folders below ``root``.

    With several names a folder that cannot be used is listed in ``files`` and
    left out. Errors: RecordingError when nothing is left.
    """
    out = AsPaper()
    refused: list[RecordingError] = []
    for name in names:
        try:
            rows = read_folder(root, FOLDERS[name], "B" if name == "tyres" else "A")
            STEPS[name](out, rows)
        except RecordingError as err:
            refused.append(err)
            place = Path(root) / FOLDERS[name]
            out.files[err.read or str(place)] = FileReport(
                0, 0, (f"{name} not fitted: {err.what}",))
        else:
            out.rows[name] = rows
    if not out.fits:
        raise refused[0]
    return out


def as_paper(root: Path, names: Sequence[str], command: str
             ) -> tuple[Identification, AsPaper]:
    """The paper's own way on its folders below root; also what was fitted, for pictures."""
    made = fit_as_paper(root, names)
    digests = {file: report.sha256 for file, report in made.files.items() if report.used}
    source = Source(digests, command, method="preprocessing of the paper, plain least squares")
    return Identification(made.fits, made.files, made.published, source, made.derived), made


def _solve(out: AsPaper, problem: CurveProblem) -> Fit:
    fit = solve(problem)
    out.fits[problem.submodel] = fit
    out.problems[problem.submodel] = problem
    if problem.paper is not None:
        out.published[problem.submodel] = Published(
            dict(zip(problem.names, problem.paper, strict=True)), problem.paper_rmse)
    return fit


def _friction(out: AsPaper, rows: JoinedRows) -> None:
    _solve(out, friction_problem(rows))
    use = coasting(rows, motion(rows)[1])
    out.files |= rows.reports(use, "friction: throttle open, or force below -4 N")


def _motor(out: AsPaper, rows: JoinedRows) -> None:
    _solve(out, motor_problem(rows))
    out.files |= rows.reports(np.ones(len(rows), dtype=bool), "")


def _steering(out: AsPaper, rows: JoinedRows) -> None:
    _solve(out, steering_problem(rows))
    out.files |= rows.reports(fast(rows), "steering: below 0.8 m/s")


def _delay(out: AsPaper, rows: JoinedRows) -> None:
    out.fits["delay"], out.correlation = fit_delay(rows)
    out.published["delay"] = Published({"steering_s": PAPER.delay.steering_s}, None)
    out.files |= rows.reports(fast(rows), "delay: below 0.8 m/s")


def _tyres(out: AsPaper, rows: JoinedRows) -> None:
    data = tyre_data(rows)
    front, rear = _solve(out, front_problem(data)), _solve(out, rear_problem(data))
    out.derived["tyres_front"] = {"front_stiffness_BCD": stiffness(front)}
    for problem in (front_problem_without_e(data), front_problem_tanh(data),
                    front_problem(tyre_data(rows, 0.0), "tyres_front_yaw0"),
                    rear_problem_with_offset(data)):
        _solve(out, problem)
    out.fits["tyres"] = together(front, rear)
    out.derived["tyres"] = out.derived["tyres_front"]
    ours = {**out.published["tyres_front"].values, **out.published["tyres_rear"].values}
    out.published["tyres"] = Published(ours, _pooled(out))
    out.files |= rows.reports(data.used, "tyres: outside 5 to 58.7 s")


STEPS: dict[str, Callable[[AsPaper, JoinedRows], None]] = {
    "friction": _friction, "motor": _motor, "steering": _steering, "delay": _delay,
    "tyres": _tyres}


def stiffness(front: Fit) -> Estimate:
    """Cornering stiffness BCD of the front tyre [N/rad], which the data do tell."""
    d, c, b = (front.parameters[name].value for name in FRONT[:3])
    gradient = np.array([b * c, b * d, c * d, 0.0])
    variance = float(gradient @ front.covariance @ gradient)
    return Estimate(b * c * d, float(np.sqrt(variance)), "N/rad")


def together(front: Fit, rear: Fit) -> Fit:
    """Both axles as one sub-model: residuals pooled, no covariance between them."""
    n = front.n + rear.n
    k = len(front.parameters)
    covariance: FloatArray = np.zeros((k + 1, k + 1))
    covariance[:k, :k], covariance[k:, k:] = front.covariance, rear.covariance
    rmse = float(np.sqrt((front.n * front.loss + rear.n * rear.loss) / n))
    told = ("front D and C cannot be told apart by one turning direction: judge the fit by rmse "
            "and by the stiffness BCD",)
    return replace(front, submodel="tyres", parameters={**front.parameters, **rear.parameters},
                   covariance=covariance, n=n, rmse=rmse, at_bound=front.at_bound + rear.at_bound,
                   converged=front.converged and rear.converged,
                   cpu_s=front.cpu_s + rear.cpu_s, notes=told)


def _pooled(out: AsPaper) -> float:
    """What the paper's values leave at both axles, which have as many rows."""
    front, rear = out.published["tyres_front"].rmse, out.published["tyres_rear"].rmse
    assert front is not None
    assert rear is not None
    return float(np.sqrt(0.5 * (front**2 + rear**2)))
