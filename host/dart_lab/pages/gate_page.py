"""The page of the gates of a diagnosis, generated from their list."""

from __future__ import annotations

from dart_lab.diagnosis.gates import GATES, STAGES, Candidate
from dart_lab.diagnosis.policy import USUAL

GATES_HEAD = """# Gates of the diagnosis

An effect of the [catalogue](effects.md) becomes an accepted cause if it passes all of these, in
this order. [How the diagnosis finds a cause](../explanation/diagnosis_method.md) derives the
quantities, [the ablation](../results/ablation.md) measures what changes without each gate. This
page is generated from `dart_lab/diagnosis/gates.py` (`dart-hal wire --write`).
"""
# A candidate that fails every gate: the page shows the message of each.
EXAMPLE = Candidate(chosen="grip", impossible="k = 1.2 is outside its "
                    "physical range 0 to 1 share", cost=(0.996, 0.98, 1.01))


def render_gates() -> str:
    """Return the Markdown page of all gates, by stage."""
    lines = [GATES_HEAD,
             "| judged | gate | an effect passes if | message of the report otherwise |",
             "|---|---|---|---|"]
    for gate in GATES:
        lines.append(f"| {STAGES[gate.stage]} | {gate.name} | {gate.condition(USUAL)} "
                     f"| {gate.message(EXAMPLE)} |")
    return "\n".join(lines) + "\n"
