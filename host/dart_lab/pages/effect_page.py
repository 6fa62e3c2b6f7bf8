"""The page of the catalogue of effects, generated from its files."""

from __future__ import annotations

import textwrap

from dart_hal.vehicle.effect import EFFECT_STAGES, Effect, Parameter
from dart_hal.vehicle.effects import equation_text, order_key, own_effects

EFFECTS_HEAD = """# Effects

Each entry is one physical cause that a base model lacks. At null it changes no bit. Several
effects act in the order of the stages below. Option and URL: `quadratic_drag:0.1`, or with several
parameters `encoder_ring:missing=0.05:phase=0.2`; separate effects by commas.

![how often hidden effects are named](../pictures/diagnose_confusion.png)
[How they were hidden](../results/campaign.md).

```toml
[[effects]]
name = "quadratic_drag"
parameters = { k = { value = 0.1, std = 0.02 } }
```

| column, term | meaning |
|---|---|
| from, to | interval of a fit |
| physical | a size outside, or at the end of the interval, is never accepted as a cause |
| sizes | a small, a medium and a large difference from null; the tests hide either sign |
| looks like | effects with similar traces; each section has the drive that distinguishes them |
| not for speed loops | refused and not tried for a [speed loop](car-files.md#drive-forms) |

Effects on forces do not change the kinematic bicycle. Numbers with N or m in their unit are those
of a car of 1:10, see
[cars of another size](../explanation/diagnosis_method.md#cars-of-another-size).
Generated from `dart_hal/vehicle/effects/` (`dart-hal wire --write`).
"""

# Characters of a line of the page.
LINE_WIDTH = 120
STAGE_TEXT = {
    "command": "Between the program and the actuators.",
    "actuator": "Servo, linkage, ESC, motor and battery.",
    "force": "Forces on the car.",
    "motion": "Response of the car to the forces.",
    "measurement": "Errors of the sensors; the car moves as before.",
}


def render_effects() -> str:
    """Return the Markdown page of the catalogue, by stage and in the order in which effects act."""
    # In the order in which the effects act on a signal, which matters if several are active.
    effects = sorted(own_effects().values(), key=order_key)
    parts = [EFFECTS_HEAD]
    for stage in EFFECT_STAGES:
        mine = [e for e in effects if e.stage == stage]
        rows = [f"| {_link(e.name)} | {', '.join(map(_link, e.confused_with))} |" for e in mine]
        parts.append("\n".join([f"## {stage.capitalize()}", "", STAGE_TEXT[stage], "",
                                "| effect | looks like |", "|---|---|", *rows, ""]))
        parts += [render_effect(e) for e in mine]
    return "\n".join(parts)


def _link(name: str) -> str:
    """Return a link to the section of an effect."""
    return f"[{name}](#{name})"


def render_effect(effect: Effect) -> str:
    """Return the section of an effect: physics, equation, parameters, distinguishing drive."""
    rows = "\n".join(map(_render_row, effect.parameters))
    limit = " Not for speed loops." if effect.duty_only else ""
    physics = textwrap.fill(f"The car {effect.title}. {effect.physics}{limit}", LINE_WIDTH)
    experiment = textwrap.fill(f"To distinguish: {effect.experiment}", LINE_WIDTH)
    return f"""### {effect.name}

{physics}

```text
{equation_text(effect)}
```

| parameter | meaning | unit | null | from | to | physical | sizes |
|---|---|---|---|---|---|---|---|
{rows}

{experiment}
"""


def _render_row(q: Parameter) -> str:
    unit = q.unit + (", per recording" if q.per_recording else "")
    cells = (f"`{q.name}`", q.meaning, unit, *map(_number, (q.null, q.low, q.high)),
             " to ".join(map(_number, q.physical_range)), " ".join(map(_number, q.sizes)))
    return "| " + " | ".join(cells) + " |"


def _number(v: float) -> str:
    return f"{v:g}"
