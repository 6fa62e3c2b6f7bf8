"""One run of the identification, whichever way it was made: what a verb shows and writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec

from dart_hal.core.config import ModelFile, Quantity, plain
from dart_hal.core.config.model import Covariance
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.flat import LENGTHS, close_lengths, unit
from dart_hal.vehicle.flat import names as flat_names
from dart_hal.vehicle.flat import value as flat_value
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.sizes import CAR_FILE, list_stated_errors
from dart_lab.identification.fit import Estimate, Fit
from dart_lab.identification.mass import never_weighed, of_mass, weighed
from dart_lab.identification.report import FileReport, Published
from dart_lab.identification.write import SECTIONS, Source, rounded, why_unsound
from dart_lab.report.numbers import with_error

Progress = Callable[[float, str], None]
Skipped = Sequence[tuple[str, str]]
"""(file, reason) of files that could not be read."""
JOINT_FIT = f"{CAR_FILE}, joint fit"
"""Method of a size of car.toml that a joint fit has moved."""
MAX_SIZE_ERRORS = 2.0
"""Standard errors of car.toml by which a fit may move a size without a doubt."""
BODY_STD = {"mass": 0.02, "yaw_inertia": 0.1}
"""Relative standard error of a mass that nobody has weighed with the recordings, as experiments
have it, and of an inertia: m/12 (length^2 + width^2) of a car is good to a tenth."""


@dataclass(frozen=True, slots=True)
class Identification:
    """fits by sub-model (as_paper: also rows of its comparison), report by file.

    published: the values of the base that was used (as_paper: the paper's); compared: its name for
    published recordings of DART, else "base";
    derived: what the data identify
    where single parameters are not identifiable; source: for the file's provenance;
    joint: covariance across sub-models, where they were fitted together;
    mass [kg]: as weighed with the recordings, None = the base's was taken; nuisance: what a joint
    fit moved within the errors with which it was known, by full name.
    frames: marker frame by file, of the recordings with motion capture.
    """

    fits: Mapping[str, Fit]
    files: Mapping[str, FileReport]
    published: Mapping[str, Published]
    source: Source
    derived: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    joint: Covariance | None = None
    mass: Estimate | None = None
    frames: Mapping[str, Reference] = field(default_factory=dict)
    compared: str = PAPER.name
    nuisance: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """Whether any fit can be trusted."""
        return any(fit.sound for fit in self.fits.values())

    def over(self, base: ModelFile) -> ModelFile:
        """The base that the fits belong to: with the mass, inertia and effects they hang on."""
        stated = list_stated_errors(base)
        found = {name: Quantity(e.value, e.std, JOINT_FIT if name in stated else None)
                 for name, e in self.nuisance.items()}
        if self.mass is not None:
            found["body.mass"] = Quantity(self.mass.value, self.mass.std)

        def changed(section: str, table: Mapping[str, Any]) -> dict[str, Any]:
            return {**table, **{name.partition(".")[2]: q for name, q in found.items()
                                if name.startswith(f"{section}.")}}

        effects = tuple(msgspec.structs.replace(e, parameters=changed(e.name, e.parameters))
                        for e in base.effects)
        body = changed("body", base.body)
        # Of the lengths that a fit has moved, the remaining one closes the wheelbase.
        moved = {key: q.value for key in LENGTHS if (q := found.get(f"body.{key}")) is not None}
        lengths = close_lengths({key: plain(base.body[key]) for key in LENGTHS}, moved) if (
            moved) else {}
        body |= {key: length for key, length in lengths.items() if key not in moved}
        return msgspec.structs.replace(base, body=body, effects=effects)

    def to_json(self) -> dict[str, Any]:
        """``fits`` and ``files`` as ``dart-hal identify --json`` prints them."""
        return {"fits": {name: self._fit(name) for name in self.fits},
                "files": {file: {"used": r.used, "dropped": r.dropped, "why": list(r.why)}
                          for file, r in self.files.items()},
                "references": {file: r.to_json() for file, r in self.frames.items()}}

    def _fit(self, name: str) -> dict[str, Any]:
        fit = self.fits[name]
        out = {**fit.to_json(), "sound": fit.sound, "why_unsound": why_unsound(fit)}
        if name in self.published:
            paper = self.published[name]
            key = "paper" if self.compared == PAPER.name else "base"
            out[key] = {"parameters": dict(paper.values), "rmse": paper.rmse}
        out["derived"] = {key: {"value": e.value, "std": e.std, "unit": e.unit}
                          for key, e in self.derived.get(name, {}).items()}
        return out


def base_values(base: Vehicle, fit: Fit) -> Published:
    """Values of the base for the parameters of a fit, of those that have the same unit."""
    names = set(flat_names(base))
    return Published({key: float(flat_value(base, name)) for key, e in fit.parameters.items()
                      if (name := f"{fit.submodel}.{key}") in names and unit(base, name) == e.unit})


def identify(recordings: Sequence[Recording], base: ModelFile,
             submodels: Sequence[str] = SECTIONS, *, joint: bool = False,
             reference: Reference | None = None) -> Identification:
    """Fit the sub-models of a car to recordings.

    Args:
        recordings: as ``read_any`` gives them.
        base: the model to start from, as ``find_model`` gives it; what the recordings do not tell
            stays as it is there.
        submodels: some of ``friction``, ``motor``, ``steering``, ``delay``, ``tyres``.
        joint: fit all of them together on their prediction errors, from recordings with motion
            capture, instead of one after the other.
        reference: where the marker frame of the motion capture is; None: known or fitted.

    Returns:
        Values with standard errors, and which file was used for what.

    Raises:
        RecordingError: none of the recordings can be used.

    Example::

        from dart_hal import find_model, read_any
        from dart_lab import identify

        recordings, skipped = read_any(["recordings"])
        found = identify(recordings, find_model("paper")[0])
        print(found.fits["friction"].parameters)
    """
    if joint:
        return jointly(list(recordings), [], submodels, base, "identify()", reference)[0]
    return per_recording(list(recordings), [], submodels, vehicle_of(base), "identify()",
                         reference)[0]


def jointly(recordings: list[Recording], skipped: Skipped, names: Sequence[str], base: ModelFile,
            command: str, reference: Reference | None = None, progress: Progress | None = None
            ) -> tuple[Identification, list[Recording]]:
    """All sub-models in one fit on rollouts, from the recordings that have motion capture.

    recordings, skipped: as ``read_any`` gives them.

    Standard errors of the base are its prior, unless some of these recordings
    are already in them.

    Errors: RecordingError when none of them can be predicted.
    """
    from dart_lab.identification.shooting import fit_from_recordings

    mass = weighed(recordings)
    if mass is not None:
        base = _with_body(base, {"mass": mass})
    made, grids, unused = fit_from_recordings(recordings, vehicle_of(base), names, reference,
                                              progress, _known(base, recordings))
    used = {str(r.path): (r, g) for r, g in grids}
    files: dict[str, FileReport] = {}
    for r in recordings:
        file, why = str(r.path), [str(note) for note in r.notes]
        bad = int(used[file][1].bad.sum()) if file in used else 0
        taken = len(used[file][1]) - bad if file in used else 0
        files[file] = FileReport(taken, bad, (*why, *unused.get(file, ())), r.sha256)
    files |= {file: FileReport(0, 0, (f"skipped: {reason}",)) for file, reason in skipped}
    points = {file: (g.reference.lx, g.reference.theta, g.reference.ly)
              for file, (_, g) in used.items()}
    source = Source({f: r.sha256 for f, r in files.items() if r.used}, command, points,
                    "one fit of all sub-models by multiple shooting, errors over blocks")
    start = vehicle_of(base)
    published = {name: base_values(start, fit) for name, fit in made.fits.items()}
    fits = made.fits
    if sizes := describe_moved_sizes(base, made.nuisance):
        fits = {name: replace(fit, notes=(*fit.notes, sizes)) for name, fit in fits.items()}
    joint = Covariance(made.names, rounded(made.covariance))
    frames = {file: g.reference for file, (_, g) in used.items()}
    return (Identification(fits, files, published, source, joint=joint, frames=frames,
                           compared=_name_comparison(base.name, recordings),
                           nuisance=made.nuisance), recordings)


def describe_moved_sizes(base: ModelFile, fitted: Mapping[str, Estimate]) -> str:
    """State where a joint fit has moved the sizes of car.toml; "" without stated errors."""
    parts, doubtful = [], []
    for name, std in list_stated_errors(base).items():
        if name in fitted:
            key, found = name.partition(".")[2], fitted[name]
            before = plain(base.body[key])
            parts.append(f"{key} {before:.4g} +- {std:.2g} -> "
                         f"{with_error(found.value, found.std)} {found.unit}")
            if abs(found.value - before) > MAX_SIZE_ERRORS * std:
                doubtful.append(key)
    remedy = f"; measure again: {', '.join(doubtful)}" if doubtful else ""
    return f"sizes of car.toml: {', '.join(parts)}{remedy}" if parts else ""


def _name_comparison(base: str, recordings: Sequence[Recording]) -> str:
    """Return what the values are compared with: another car than DART has no published ones."""
    return base if all(r.published for r in recordings) else "base"


def _known(base: ModelFile, recordings: Sequence[Recording]) -> dict[str, float]:
    """Standard errors of the base by name; of its identified sections none that these recordings
    have made. A mass or an inertia without a stated error is as vague as ``BODY_STD``. Lengths
    have the errors that car.toml states."""
    seen = set(base.provenance.get("files", {}).values())
    again = bool(seen & {r.sha256 for r in recordings})
    tables: dict[str, Mapping[str, Any]] = {effect.name: effect.parameters
                                            for effect in base.effects}
    if not again:
        tables |= {section: getattr(base, section) for section in SECTIONS}
    known = {f"{section}.{key}": entry.std for section, table in tables.items()
             for key, entry in table.items() if isinstance(entry, Quantity)}
    vehicle = vehicle_of(base)
    for key, share in BODY_STD.items():
        entry = base.body.get(key)
        known[f"body.{key}"] = (entry.std if isinstance(entry, Quantity)
                                else share * float(flat_value(vehicle, f"body.{key}")))
    return known | list_stated_errors(base)


def _with_body(base: ModelFile, values: Mapping[str, Estimate]) -> ModelFile:
    """The base with values of its body, each with its standard error."""
    changed = {key: Quantity(e.value, e.std) for key, e in values.items()}
    return msgspec.structs.replace(base, body={**base.body, **changed})


def per_recording(recordings: list[Recording], skipped: Skipped, names: Sequence[str],
                  base: Vehicle, command: str, reference: Reference | None = None,
                  progress: Progress | None = None) -> tuple[Identification, list[Recording]]:
    """Every recording for itself, robust; also the recordings, for pictures.

    recordings, skipped: as ``read_any`` gives them.
    """
    from dart_lab.identification.submodels import fit_submodels

    mass = weighed(recordings)
    fits, reports = fit_submodels(recordings, names, base=of_mass(base, mass), mass=mass,
                                  reference=reference, progress=progress)
    if vague := never_weighed(recordings, base):
        fits = {name: replace(fit, notes=(*fit.notes, vague)) if name in ("friction", "motor")
                else fit for name, fit in fits.items()}
    files: dict[str, FileReport] = {}
    frames: dict[str, Reference] = {}
    for r in recordings:
        found = reports.get(str(r.path)) or reports.get(r.name)
        why = dict.fromkeys([*map(str, r.notes), *(found.why if found else ())])
        files[str(r.path)] = FileReport(found.used if found else 0, found.dropped if found else 0,
                                        tuple(why), r.sha256)
        if r.mocap is not None and r.marker is not None and files[str(r.path)].used:
            frames[str(r.path)] = r.marker
    files |= {file: FileReport(0, 0, (f"skipped: {reason}",)) for file, reason in skipped}
    points = {file: (r.lx, r.theta, r.ly) for file, r in frames.items()}
    source = Source({f: r.sha256 for f, r in files.items() if r.used}, command, points,
                    "per recording, robust, errors over blocks")
    published = {name: base_values(base, fit) for name, fit in fits.items()}
    return Identification(fits, files, published, source, mass=mass, frames=frames,
                          compared=_name_comparison(base.name, recordings)), recordings
