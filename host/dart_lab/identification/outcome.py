"""Identification of a car: result, and the two methods (per recording, joint)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec

from dart_hal.core.config import EffectEntry, ModelFile, Quantity, plain
from dart_hal.core.config.model import MODEL_PARAMETERS, Covariance
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.flat import LENGTHS, close_lengths, unit
from dart_hal.vehicle.flat import names as flat_names
from dart_hal.vehicle.flat import value as flat_value
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.sizes import CAR_FILE, list_stated_errors
from dart_lab.identification.battery import find_mean_voltage, state_fade_law
from dart_lab.identification.drive_form import with_drive_of
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.mass import average_mass, note_unweighed, replace_mass
from dart_lab.identification.report import FileReport, Published
from dart_lab.identification.write import (
    SECTIONS,
    Source,
    round_covariance,
    was_fitted_to,
    why_unsound,
)
from dart_lab.report.numbers import with_error

Progress = Callable[[float, str], None]
Skipped = Sequence[tuple[str, str]]
"""(file, reason) of files that could not be read."""
# Method of a size of car.toml that a joint fit has changed.
JOINT_FIT = f"{CAR_FILE}, joint fit"
# [standard errors of car.toml] A joint fit may change a size by that without a caution.
MAX_SIZE_ERRORS = 2.0
# Relative standard errors of a mass that was not weighed with the recordings (as for experiments),
# and of an inertia: m/12 (length^2 + width^2) is good to a tenth.
BODY_STD = {"mass": 0.02, "yaw_inertia": 0.1}


@dataclass(frozen=True, slots=True)
class Identification:
    """Result of an identification.

    fits: by sub-model (as_paper: also rows of its comparison); files: report by file; published:
    values of the base (as_paper: of the paper); compared: their name for published recordings of
    DART, else "base"; source: for the file's provenance; derived: combinations that are
    identified where single parameters are not; joint: covariance across sub-models that were
    fitted together; mass [kg]: weighed with the recordings, None: the base's; frames: marker
    frames by file; nuisance: nuisance parameters of a joint fit by full name.
    """

    fits: Mapping[str, SubmodelFit]
    files: Mapping[str, FileReport]
    published: Mapping[str, Published]
    source: Source
    derived: Mapping[str, Mapping[str, FittedParameter]] = field(default_factory=dict)
    joint: Covariance | None = None
    mass: FittedParameter | None = None
    frames: Mapping[str, Reference] = field(default_factory=dict)
    compared: str = PAPER.name
    nuisance: Mapping[str, FittedParameter] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """Whether any fit is sound, and a joint fit identifies any parameter."""
        fits = self.fits.values()
        return any(fit.sound for fit in fits) and (
            self.joint is None or any(fit.identifies_any for fit in fits))

    def over(self, base: ModelFile) -> ModelFile:
        """Return the base with the mass, inertia, sizes and effects that the fits depend on."""
        stated = list_stated_errors(base)
        found = {name: Quantity(e.value, e.std, JOINT_FIT if name in stated else None)
                 for name, e in self.nuisance.items()}
        if self.mass is not None:
            found["body.mass"] = Quantity(self.mass.value, self.mass.std)
        return _insert_quantities(base, found)

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


def _insert_quantities(base: ModelFile, found: Mapping[str, Quantity]) -> ModelFile:
    """Return the base with these sizes and parameters of effects, by full name."""
    def insert(section: str, table: Mapping[str, Any]) -> dict[str, Any]:
        return {**table, **{name.partition(".")[2]: q for name, q in found.items()
                            if name.startswith(f"{section}.")}}

    added = map(EffectEntry, list_added_effects(base, found))
    effects = tuple(msgspec.structs.replace(e, parameters=insert(e.name, e.parameters))
                    for e in (*base.effects, *added))
    body = insert("body", base.body)
    # Of the lengths that a fit has moved, the remaining one closes the wheelbase.
    moved = {key: q.value for key in LENGTHS if (q := found.get(f"body.{key}")) is not None}
    lengths = close_lengths({key: plain(base.body[key]) for key in LENGTHS}, moved) if (
        moved) else {}
    body |= {key: length for key, length in lengths.items() if key not in moved}
    return msgspec.structs.replace(base, body=body, effects=effects)


def base_values(base: Vehicle, fit: SubmodelFit) -> Published:
    """Return the base's values of the parameters of a fit that have the same unit."""
    names = set(flat_names(base))
    return Published({key: float(flat_value(base, name)) for key, e in fit.parameters.items()
                      if (name := f"{fit.submodel}.{key}") in names and unit(base, name) == e.unit})


def identify(recordings: Sequence[Recording], base: ModelFile,
             submodels: Sequence[str] = SECTIONS, *, joint: bool = False,
             reference: Reference | None = None) -> Identification:
    """Fit the sub-models of a car to recordings.

    Args:
        recordings: as ``read_any`` gives them.
        base: the model to start from, as ``find_model`` gives it; it keeps the values that the
            recordings do not identify.
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
        return identify_jointly(list(recordings), [], submodels, base, "identify()", reference)[0]
    return identify_per_recording(list(recordings), [], submodels, vehicle_of(base), "identify()",
                                  reference)[0]


def identify_jointly(recordings: list[Recording], skipped: Skipped, names: Sequence[str],
                     base: ModelFile,
                     command: str, reference: Reference | None = None, progress: Progress
                     | None = None
                     ) -> tuple[Identification, list[Recording]]:
    """Fit all sub-models together to rollouts, from the recordings with motion capture.

    recordings, skipped: as ``read_any`` gives them. The standard errors of the base are its
    prior; of a base that was identified from some of these recordings, those before. A base of duty
    gets a speed loop where the recordings have speed commands. Raises RecordingError if no
    recording can be predicted, UsageError for a motor of another form than the recordings.
    """
    from dart_lab.identification.shooting import fit_from_recordings

    if was_fitted_to(base, recordings):
        base = _restore_prior(base)
    mass = average_mass(recordings)
    if mass is not None:
        base = _insert_quantities(base, {"body.mass": Quantity(mass.value, mass.std)})
    base = with_drive_of(base, recordings, names)
    known = _prior_errors(base)
    made, grids, unused = fit_from_recordings(recordings, vehicle_of(base), names, reference,
                                              progress, known)
    used = {str(r.path): (r, g) for r, g in grids}
    files: dict[str, FileReport] = {}
    for r in recordings:
        file = str(r.path)
        why = [str(note) for note in r.notes]
        bad = int(used[file][1].bad.sum()) if file in used else 0
        taken = len(used[file][1]) - bad if file in used else 0
        files[file] = FileReport(taken, bad, (*why, *unused.get(file, ())), r.sha256)
    files |= {file: FileReport(0, 0, (f"skipped: {reason}",)) for file, reason in skipped}
    points = {file: (g.reference.lx, g.reference.theta, g.reference.ly)
              for file, (_, g) in used.items()}
    start = vehicle_of(base)
    source = Source({f: r.sha256 for f, r in files.items() if r.used}, command, points,
                    "one fit of all sub-models by multiple shooting, errors over blocks",
                    find_mean_voltage([r for r, _ in grids]),
                    {name: (float(flat_value(start, name)),
                            *([known[name]] if name in known else []))
                     for name in (*made.names, *made.nuisance) if name in flat_names(start)})
    published = {name: base_values(start, fit) for name, fit in made.fits.items()}
    fits = made.fits
    if sizes := describe_moved_sizes(base, made.nuisance):
        fits = {name: replace(fit, notes=(*fit.notes, sizes)) for name, fit in fits.items()}
    if law := state_fade_law(start, [r for r, _ in grids]):
        fits = {name: replace(fit, notes=(*fit.notes, *law)) for name, fit in fits.items()}
    if added := describe_added_effects(base, made.nuisance):
        fits = {name: replace(fit, notes=(*fit.notes, added)) for name, fit in fits.items()}
    joint = Covariance(made.names, round_covariance(made.covariance))
    frames = {file: g.reference for file, (_, g) in used.items()}
    return (Identification(fits, files, published, source, joint=joint, frames=frames,
                           compared=_name_comparison(base.name, recordings),
                           nuisance=made.nuisance), recordings)


def describe_moved_sizes(base: ModelFile, fitted: Mapping[str, FittedParameter]) -> str:
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


def list_added_effects(base: ModelFile, fitted: Iterable[str]) -> list[str]:
    """Return the effects that a joint fit has added, from full names of fitted parameters."""
    has = {*MODEL_PARAMETERS, *(e.name for e in base.effects)}
    sections = dict.fromkeys(name.partition(".")[0] for name in fitted)
    return [section for section in sections if section not in has]


def describe_added_effects(base: ModelFile, fitted: Mapping[str, FittedParameter]) -> str:
    """State which effects a joint fit has added; "" without any."""
    added = list_added_effects(base, fitted)
    parts = [f"{name} = {with_error(found.value, found.std)} {found.unit}"
             for name, found in fitted.items() if name.partition(".")[0] in added]
    return f"added, because the data need it: {', '.join(parts)}" if parts else ""


def _name_comparison(base: str, recordings: Sequence[Recording]) -> str:
    """Return what the values are compared with: another car than DART has no published ones."""
    return base if all(r.published for r in recordings) else "base"


def _restore_prior(base: ModelFile) -> ModelFile:
    """Return the base as it was before its joint fit; without errors where that is unknown."""
    from dart_lab.identification.shooting.fit import BACK_EMF, BACK_EMF_NAME

    prior = base.provenance.get("prior", {})
    stated = list_stated_errors(base)

    def restore(section: str, table: Mapping[str, Any]) -> dict[str, Any]:
        return {key: entry if f"{section}.{key}" in stated else plain(entry)
                for key, entry in table.items()}

    tables = {section: restore(section, getattr(base, section)) for section in (*SECTIONS, "body")}
    effects = tuple(msgspec.structs.replace(e, parameters=restore(e.name, e.parameters))
                    for e in base.effects
                    if e.name != BACK_EMF or not prior or BACK_EMF_NAME in prior)
    for name, pair in prior.items():
        section, _, key = name.partition(".")
        if section in SECTIONS and key in tables[section]:
            tables[section][key] = Quantity(*pair) if len(pair) > 1 else pair[0]
    others = {name: Quantity(pair[0], pair[1], CAR_FILE if name in stated else None)
              for name, pair in prior.items() if name.partition(".")[0] not in SECTIONS}
    return _insert_quantities(msgspec.structs.replace(base, effects=effects, **tables), others)


def _prior_errors(base: ModelFile) -> dict[str, float]:
    """Return the standard errors of the base by name, as a prior.

    A mass or an inertia without an error has that of ``BODY_STD``. Lengths have the errors of
    car.toml.
    """
    tables: dict[str, Mapping[str, Any]] = {effect.name: effect.parameters
                                            for effect in base.effects}
    tables |= {section: getattr(base, section) for section in SECTIONS}
    known = {f"{section}.{key}": entry.std for section, table in tables.items()
             for key, entry in table.items() if isinstance(entry, Quantity)}
    vehicle = vehicle_of(base)
    for key, share in BODY_STD.items():
        entry = base.body.get(key)
        known[f"body.{key}"] = (entry.std if isinstance(entry, Quantity)
                                else share * float(flat_value(vehicle, f"body.{key}")))
    return known | list_stated_errors(base)


def identify_per_recording(recordings: list[Recording], skipped: Skipped, names: Sequence[str],
                           base: Vehicle, command: str, reference: Reference | None = None,
                           progress: Progress | None = None) -> tuple[Identification,
                                                                      list[Recording]]:
    """Fit the sub-models one by one; return the result, and the recordings for pictures.

    recordings, skipped: as ``read_any`` gives them.
    """
    from dart_lab.identification.submodels import fit_submodels

    mass = average_mass(recordings)
    fits, reports = fit_submodels(recordings, names, base=replace_mass(base, mass), mass=mass,
                                  reference=reference, progress=progress)
    if note := note_unweighed(recordings, base):
        fits = {name: replace(fit, notes=(*fit.notes, note)) if name in ("friction", "motor")
                else fit for name, fit in fits.items()}
    if law := state_fade_law(base, recordings):
        fits = {name: replace(fit, notes=(*fit.notes, *law)) if name == "motor" else fit
                for name, fit in fits.items()}
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
                    "per recording, robust, errors over blocks",
                    find_mean_voltage([r for r in recordings if files[str(r.path)].used]))
    published = {name: base_values(base, fit) for name, fit in fits.items()}
    return Identification(fits, files, published, source, mass=mass, frames=frames,
                          compared=_name_comparison(base.name, recordings)), recordings
