"""All sub-models of the paper on its own folders, in the order of its tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.outcome import Identification
from dart_lab.identification.report import FileReport, Published
from dart_lab.identification.write import Source

from .delay import Correlation, fit_delay
from .folders import FOLDERS, JoinedRows, read_folder
from .problem import CurveProblem, solve
from .problems import (
    friction_problem,
    is_coasting,
    is_fast,
    motion,
    motor_problem,
    steering_problem,
)
from .tyres import (
    FRONT_NAMES,
    front_problem,
    front_problem_tanh,
    front_problem_without_e,
    rear_problem,
    rear_problem_with_offset,
    tyre_data,
)

PAPER_SUBMODELS = tuple(FOLDERS)


@dataclass(slots=True)
class AsPaper:
    """Fits by name: the sub-models and, for the tyres, every row of the comparison.

    published: the paper's values. derived: combinations that are identified where single
    parameters are not. problems, rows, correlation: fitted data, for pictures and benchmarks.
    """

    fits: dict[str, SubmodelFit] = field(default_factory=dict)
    files: dict[str, FileReport] = field(default_factory=dict)
    published: dict[str, Published] = field(default_factory=dict)
    derived: dict[str, dict[str, FittedParameter]] = field(default_factory=dict)
    problems: dict[str, CurveProblem] = field(default_factory=dict)
    rows: dict[str, JoinedRows] = field(default_factory=dict)
    correlation: Correlation | None = None


def fit_as_paper(root: str | Path, names: Sequence[str] = PAPER_SUBMODELS) -> AsPaper:
    """Fit the sub-models ``names`` to their folders below ``root``.

    With several names an unusable folder is listed in ``files`` and skipped. Raises
    RecordingError if no sub-model was fitted.
    """
    out = AsPaper()
    refused: list[RecordingError] = []
    for name in names:
        try:
            rows = read_folder(root, FOLDERS[name], "B" if name == "tyres" else "A")
            FITS[name](out, rows)
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
    """Repeat the paper's fits on its folders below root; return also the data, for pictures."""
    made = fit_as_paper(root, names)
    digests = {file: report.sha256 for file, report in made.files.items() if report.used}
    source = Source(digests, command, method="preprocessing of the paper, plain least squares")
    return Identification(made.fits, made.files, made.published, source, made.derived), made


def _fit_problem(out: AsPaper, problem: CurveProblem) -> SubmodelFit:
    fit = solve(problem)
    out.fits[problem.submodel] = fit
    out.problems[problem.submodel] = problem
    if problem.paper is not None:
        out.published[problem.submodel] = Published(
            dict(zip(problem.names, problem.paper, strict=True)), problem.paper_rmse)
    return fit


def _fit_friction(out: AsPaper, rows: JoinedRows) -> None:
    _fit_problem(out, friction_problem(rows))
    use = is_coasting(rows, motion(rows)[1])
    out.files |= rows.reports(use, "friction: throttle open, or force below -4 N")


def _fit_motor(out: AsPaper, rows: JoinedRows) -> None:
    _fit_problem(out, motor_problem(rows))
    out.files |= rows.reports(np.ones(len(rows), dtype=bool), "")


def _fit_steering(out: AsPaper, rows: JoinedRows) -> None:
    _fit_problem(out, steering_problem(rows))
    out.files |= rows.reports(is_fast(rows), "steering: below 0.8 m/s")


def _fit_delay(out: AsPaper, rows: JoinedRows) -> None:
    out.fits["delay"], out.correlation = fit_delay(rows)
    out.published["delay"] = Published({"steering_s": PAPER.delay.steering_s}, None)
    out.files |= rows.reports(is_fast(rows), "delay: below 0.8 m/s")


def _fit_tyres(out: AsPaper, rows: JoinedRows) -> None:
    data = tyre_data(rows)
    front, rear = _fit_problem(out, front_problem(data)), _fit_problem(out, rear_problem(data))
    out.derived["tyres_front"] = {"front_stiffness_BCD": front_stiffness(front)}
    for problem in (front_problem_without_e(data), front_problem_tanh(data),
                    front_problem(tyre_data(rows, 0.0), "tyres_front_yaw0"),
                    rear_problem_with_offset(data)):
        _fit_problem(out, problem)
    out.fits["tyres"] = combine_axles(front, rear)
    out.derived["tyres"] = out.derived["tyres_front"]
    ours = {**out.published["tyres_front"].values, **out.published["tyres_rear"].values}
    out.published["tyres"] = Published(ours, _pool_published_rmse(out))
    out.files |= rows.reports(data.used, "tyres: outside 5 to 58.7 s")


FITS: dict[str, Callable[[AsPaper, JoinedRows], None]] = {
    "friction": _fit_friction, "motor": _fit_motor, "steering": _fit_steering, "delay": _fit_delay,
    "tyres": _fit_tyres}


def front_stiffness(front: SubmodelFit) -> FittedParameter:
    """Return the front tyre's cornering stiffness BCD [N/rad], which is identifiable."""
    d, c, b = (front.parameters[name].value for name in FRONT_NAMES[:3])
    gradient = np.array([b * c, b * d, c * d, 0.0])
    variance = float(gradient @ front.covariance @ gradient)
    return FittedParameter(b * c * d, float(np.sqrt(variance)), "N/rad")


def combine_axles(front: SubmodelFit, rear: SubmodelFit) -> SubmodelFit:
    """Combine both axles to one sub-model: residuals pooled, no covariance between them."""
    n = front.n + rear.n
    k = len(front.parameters)
    covariance: FloatArray = np.zeros((k + 1, k + 1))
    covariance[:k, :k] = front.covariance
    covariance[k:, k:] = rear.covariance
    rmse = float(np.sqrt((front.n * front.loss + rear.n * rear.loss) / n))
    note = ("front D and C cannot be separated by one turning direction: judge the fit by rmse "
            "and by the stiffness BCD")
    return replace(front, submodel="tyres", parameters={**front.parameters, **rear.parameters},
                   covariance=covariance, n=n, rmse=rmse, at_bound=front.at_bound + rear.at_bound,
                   converged=front.converged and rear.converged,
                   cpu_s=front.cpu_s + rear.cpu_s, notes=(note,))


def _pool_published_rmse(out: AsPaper) -> float:
    """Return the pooled rmse of the paper's values at both axles, which have equal rows."""
    front, rear = out.published["tyres_front"].rmse, out.published["tyres_rear"].rmse
    assert front is not None
    assert rear is not None
    return float(np.sqrt(0.5 * (front**2 + rear**2)))
