"""The sub-models of the paper identified from any recordings, each the right way.

Per recording and never across the joins of files; standard errors from blocks
that are taken as independent, because the samples of a drive are not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from dart_hal.car.runs import finer
from dart_hal.core.errors import UsageError
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import PAPER, Vehicle
from dart_lab.identification.fit import Estimate, Fit
from dart_lab.identification.report import FileReport
from dart_lab.identification.submodels.delay import fit_delay
from dart_lab.identification.submodels.driving import Driving, drive
from dart_lab.identification.submodels.friction_motor import longitudinal_fit
from dart_lab.identification.submodels.report import UNITS, Ledger
from dart_lab.identification.submodels.steering import fit_steering
from dart_lab.identification.submodels.tyres import fit_tyres

SUBMODELS = tuple(UNITS)
"""friction, motor, steering, delay, tyres."""

__all__ = ["SUBMODELS", "fit_submodels"]


def fit_submodels(recordings: Sequence[Recording], names: Sequence[str] = SUBMODELS, *,
                  base: Vehicle = PAPER, mass: Estimate | None = None,
                  reference: Reference | None = None,
                  progress: Callable[[float, str], None] | None = None
                  ) -> tuple[dict[str, Fit], dict[str, FileReport]]:
    """(fits by name in the order asked for, report by file).

    base: geometry, mass and every value that is not fitted; mass [kg] instead
    of the base's, its std enters the errors of all forces; reference: where
    the markers sat, None = by date; progress(share, what comes now). What the
    recordings cannot tell comes back as the base's values, not identifiable,
    not converged, with the reason in its notes. Errors: UsageError for an
    unknown name or no recording.
    """
    unknown = [n for n in names if n not in SUBMODELS]
    if unknown or not names:
        raise UsageError(f"no sub-model {unknown[0]!r}" if unknown else "no sub-model named",
                         expected=", ".join(SUBMODELS))
    if not recordings:
        raise UsageError("no recording to fit", expected="at least one recording")
    ledger = Ledger()
    fits: dict[str, Fit] = {}

    def tell(name: str) -> None:
        if progress is not None:
            progress(len(fits) / len(names), name)
    if {"friction", "motor", "delay"} & set(names):
        tell("straight driving")
        begin = time.process_time()
        found = drive(recordings, reference, base, mass, ledger,
                      only_friction=not {"motor", "delay"} & set(names))
        cpu = time.process_time() - begin
        fits |= {n: longitudinal_fit(n, found, base, mass, cpu) for n in names
                 if n in ("friction", "motor")}
        if "delay" in names:
            tell("delay")
            fits["delay"] = _timing(recordings, reference, base, mass, found, ledger)
    if "steering" in names:
        tell("steering")
        fits["steering"] = fit_steering(recordings, reference, base, ledger)
    if "tyres" in names:
        tell("tyres")
        fits["tyres"] = fit_tyres(recordings, reference, base, fitted_car(base, fits), ledger)
    return {n: fits[n] for n in names}, ledger.reports()


def _timing(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
            mass: Estimate | None, found: Driving, ledger: Ledger) -> Fit:
    """Fit "delay", runs of our own at 50 Hz: in messages of 0.1 s no delay shows."""
    fine = [finer(r) for r in recordings]
    if any(f is not r for f, r in zip(fine, recordings, strict=True)):
        found = drive(fine, reference, base, mass, Ledger())
    return fit_delay(fine, reference, base, found, ledger)


def fitted_car(base: Vehicle, fits: Mapping[str, Fit]) -> Vehicle:
    """base with the steering map and delay found along, where they are sound."""
    out = base
    if "steering" in fits and fits["steering"].sound:
        out = replace(out, steering=replace(out.steering, **fits["steering"].values()))
    if "delay" in fits and fits["delay"].sound:
        out = replace(out, delay=replace(out.delay, **fits["delay"].values()))
    return out
