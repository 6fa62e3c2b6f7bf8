"""Identification of the paper's sub-models from any recordings.

Recordings are never joined. Standard errors are computed over blocks that are taken as
independent, because the samples of a drive are not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dart_hal.car.runs import finer
from dart_hal.core.errors import UsageError
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import PAPER, Vehicle
from dart_lab.identification.drive_form import check_duty
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.report import FileReport
from dart_lab.identification.submodels.delay import fit_delay
from dart_lab.identification.submodels.driving import StraightDriving, fit_straight_driving
from dart_lab.identification.submodels.friction_motor import make_longitudinal_fit
from dart_lab.identification.submodels.report import PARAMETER_UNITS, Ledger
from dart_lab.identification.submodels.steering import fit_steering
from dart_lab.identification.submodels.tyres import fit_tyres

# friction, motor, steering, delay, tyres.
SUBMODELS = tuple(PARAMETER_UNITS)
# Parameters that determine the slip angle in front.
STEERING_PARAMETERS = {"steering": tuple(PARAMETER_UNITS["steering"]),
                       "delay": ("steering_s", "steering_lag_s")}

__all__ = ["SUBMODELS", "fit_submodels"]


def fit_submodels(recordings: Sequence[Recording], names: Sequence[str] = SUBMODELS, *,
                  base: Vehicle = PAPER, mass: FittedParameter | None = None,
                  reference: Reference | None = None,
                  progress: Callable[[float, str], None] | None = None
                  ) -> tuple[dict[str, SubmodelFit], dict[str, FileReport]]:
    """Fit the sub-models ``names``; return (fits by name, report by file).

    base: geometry, mass and every value that is not fitted; mass [kg] replaces the base's, and
    its std enters the errors of all forces; reference: position of the markers, None: by date;
    progress(share, next sub-model). A sub-model without enough data keeps the base's values, not
    identifiable and not converged, with the reason in its notes. Raises UsageError for an unknown
    name, without a recording, and for friction, motor or delay of a speed loop.
    """
    unknown = [n for n in names if n not in SUBMODELS]
    if unknown or not names:
        raise UsageError(f"no sub-model {unknown[0]!r}" if unknown else "no sub-model named",
                         expected=", ".join(SUBMODELS))
    if not recordings:
        raise UsageError("no recording to fit", expected="at least one recording")
    check_duty(recordings, base, names)
    ledger = Ledger()
    fits: dict[str, SubmodelFit] = {}

    def report(name: str) -> None:
        if progress is not None:
            progress(len(fits) / len(names), name)
    if {"friction", "motor", "delay"} & set(names):
        report("straight driving")
        begin = time.process_time()
        found = fit_straight_driving(recordings, reference, base, mass, ledger,
                                     only_friction=not {"motor", "delay"} & set(names))
        cpu = time.process_time() - begin
        fits |= {n: make_longitudinal_fit(n, found, base, mass, cpu) for n in names
                 if n in ("friction", "motor")}
        if "delay" in names:
            report("delay")
            fits["delay"] = _fit_timing(recordings, reference, base, mass, found, ledger)
    if "steering" in names:
        report("steering")
        fits["steering"] = fit_steering(recordings, reference, base, ledger)
    if "tyres" in names:
        report("tyres")
        car = fitted_car(base, fits)
        variants = make_variants(car, fits)
        fits["tyres"] = fit_tyres(recordings, reference, base, car, variants, ledger)
    return {n: fits[n] for n in names}, ledger.reports()


def _fit_timing(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
                mass: FittedParameter | None, found: StraightDriving,
                ledger: Ledger) -> SubmodelFit:
    """Fit "delay" with own runs read at 50 Hz: messages of 0.1 s are too coarse for a delay."""
    fine = [finer(r) for r in recordings]
    if any(f is not r for f, r in zip(fine, recordings, strict=True)):
        found = fit_straight_driving(fine, reference, base, mass, Ledger())
    return fit_delay(fine, reference, base, found, ledger)


def fitted_car(base: Vehicle, fits: Mapping[str, SubmodelFit]) -> Vehicle:
    """Return the base with the fitted steering map and delay, where they are sound."""
    out = base
    if "steering" in fits and fits["steering"].sound:
        out = replace(out, steering=replace(out.steering, **fits["steering"].values()))
    if "delay" in fits and fits["delay"].sound:
        out = replace(out, delay=replace(out.delay, **fits["delay"].values()))
    return out


def make_variants(car: Vehicle, fits: Mapping[str, SubmodelFit]) -> list[Vehicle]:
    """Return the car with each independent error of its fitted steering map and steering delay."""
    out = []
    for section, names in STEERING_PARAMETERS.items():
        if section not in fits or not fits[section].sound:
            continue
        fit = fits[section]
        values = getattr(car, section)
        found = list(fit.parameters)
        use = [i for i, name in enumerate(found)
               if name in names and fit.parameters[name].identifiable]
        variance, axes = np.linalg.eigh(fit.covariance[np.ix_(use, use)])
        for error in (axes * np.sqrt(np.maximum(variance, 0.0))).T:
            moved = {found[i]: getattr(values, found[i]) + float(e)
                     for i, e in zip(use, error, strict=True)}
            # A delay is not negative.
            moved = {n: max(v, 0.0) if section == "delay" else v for n, v in moved.items()}
            out.append(replace(car, **{section: replace(values, **moved)}))
    return out
