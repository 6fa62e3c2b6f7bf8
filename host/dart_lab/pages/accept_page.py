"""Sentences, table rows, JSON and the HTML page of ``dart-hal accept``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dart_hal.calibration.acceptance import (
    AGREEMENT_SHARE,
    AGREEMENT_SIGMAS,
    AcceptanceOutcome,
    Measurand,
    agrees,
)
from dart_lab.report import page
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import significant, with_error

INTERRUPTED = "interrupted"
NOT_MEASURED = "not measured"
DIFFERS = "differs"
COLUMNS = ("value", "measured", "emulator", "")


@dataclass(frozen=True, slots=True)
class AcceptanceReport:
    """Outcomes of all steps on the car, and of the same steps on the emulated car.

    about: origin of both: URLs, board, firmware, versions, time.
    """

    outcomes: tuple[AcceptanceOutcome, ...]
    predicted: tuple[AcceptanceOutcome, ...]
    about: Mapping[str, Any]

    @property
    def is_interrupted(self) -> bool:
        """Whether the operator ended the check early."""
        return any(o.reason == INTERRUPTED for o in self.outcomes)

    @property
    def has_failed(self) -> bool:
        """Whether a step failed."""
        return any(o.status == "failed" for o in self.outcomes)

    def lead(self) -> str:
        """Return the verdict: steps measured, failed and skipped, and values that differ."""
        return f"{self.describe_steps()}; {self.describe_agreement()}"

    def describe_steps(self) -> str:
        """Return how many steps were measured, and which failed or were skipped."""
        number = {status: [o.step.title for o in self.outcomes if o.status == status]
                  for status in ("measured", "failed", "skipped")}
        sentences = [f"{len(number['measured'])} of {len(self.outcomes)} steps measured"]
        sentences += [f"{status}: {', '.join(titles)}" for status, titles in number.items()
                      if status != "measured" and titles]
        return "; ".join(sentences)

    def describe_agreement(self) -> str:
        """Return how many values are as predicted."""
        # Only values that both cars have can agree or differ.
        pairs = [(f, self._prediction(f)) for o in self.outcomes for f in o.findings]
        verdicts = [agrees(f, p) for f, p in pairs if p is not None]
        compared = [v for v in verdicts if v is not None]
        return (f"{compared.count(True)} of {len(compared)} values are as the emulated "
                f"car predicts, within {AGREEMENT_SIGMAS:.0f} standard errors and "
                f"{AGREEMENT_SHARE:.0%}, or as much as sound parts differ")

    def first_step(self) -> str:
        """Return what to do first: repeat a step that failed, look at a value, or drive."""
        # A failed step comes first: later values may depend on it.
        for outcome in self.outcomes:
            if outcome.status == "failed":
                return outcome.remedy or f"repeat {outcome.step.title}: {outcome.reason}"
        # All steps were done: the first value that differs from the emulated car's.
        for outcome in self.outcomes:
            for title, measured, predicted, remark in self.rows(outcome):
                if remark == DIFFERS:
                    return f"look at {title}: measured {measured}, predicted {predicted}"
        return "dart-hal calibrate all"

    def describe_status(self, outcome: AcceptanceOutcome) -> str:
        """Return what became of a step, with the reason and the remedy."""
        return "; ".join(part for part in (
            outcome.status, outcome.reason, f"try: {outcome.remedy}" if outcome.remedy else "")
            if part)

    def rows(self, outcome: AcceptanceOutcome) -> list[tuple[str, str, str, str]]:
        """Return title, measured value, predicted value and remark of each value of a step."""
        return [(f.title, _text(f), _text(self._prediction(f)), self._remark(f))
                for f in outcome.findings]

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object: one entry per step with its values; null for what is missing."""
        return {**self.about, "verdict": self.lead(), "steps": [
            {"id": o.step.name, "title": o.step.title, "status": o.status, "reason": o.reason,
             "try": o.remedy, "duration_s": o.seconds,
             "values": [self._value(f) for f in o.findings]} for o in self.outcomes]}

    def _value(self, finding: Measurand) -> dict[str, Any]:
        predicted = self._prediction(finding)
        return {"id": finding.key, "title": finding.title, "unit": finding.unit,
                "measured": finding.value, "std": finding.std,
                "predicted": predicted.value if predicted else None,
                "predicted_std": predicted.std if predicted else None,
                "agrees": agrees(finding, predicted) if predicted else None}

    def _prediction(self, finding: Measurand) -> Measurand | None:
        return next((f for o in self.predicted for f in o.findings if f.key == finding.key), None)

    def _remark(self, finding: Measurand) -> str:
        predicted = self._prediction(finding)
        verdict = agrees(finding, predicted) if predicted else None
        return "" if verdict is None else "as predicted" if verdict else DIFFERS


def _text(finding: Measurand | None) -> str:
    """Return a value with its standard error and unit."""
    if finding is None or finding.value is None:
        return NOT_MEASURED if finding is not None else "not predicted"
    if isinstance(finding.value, str):
        return finding.value
    number = (with_error(finding.value, finding.std) if finding.std
              else significant(finding.value, 4))
    return f"{number} {finding.unit}".strip()


def write_page(report: AcceptanceReport, path: Path, answer: Mapping[str, Any]) -> Path:
    """Write the page. Errors: OSError."""
    about = report.about
    # One section per step in the order of the check; the origin is last, with the JSON file.
    sections = {o.step.name: (o.step.title, _section(report, o)) for o in report.outcomes}
    sections["origin"] = ("Origin", join((
        table(("", ""), [(name, _plain(value)) for name, value in about.items()]),
        page.download(answer, f"accept-{about['car']}.json"))))
    heading = f"Acceptance of {about['car']}"
    return page.write(path, page.page(heading, heading, page.card(
        el("p", report.lead()), good=not report.has_failed), sections))


def _section(report: AcceptanceReport, outcome: AcceptanceOutcome) -> Html:
    return join((el("p", report.describe_status(outcome)),
                 page.small_print(outcome.step.task),
                 table(COLUMNS, report.rows(outcome), 1)))


def _plain(value: object) -> str:
    return "; ".join(map(str, value)) if isinstance(value, list) else str(value)
