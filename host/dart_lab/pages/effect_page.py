"""The page of the catalogue of effects, generated from its files."""

from __future__ import annotations

import textwrap

from dart_hal.vehicle.effect import EFFECT_STAGES, Effect, Parameter
from dart_hal.vehicle.effects import equation_text, order_key, own_effects

EFFECTS_HEAD = """# Effects

Each entry is one physical cause that a base model lacks. The simulator injects an effect, the
diagnosis looks for it, an extended `model.toml` contains it. At its null value an effect changes
no bit of the result. Several effects act in the order of the stages below, not in that of their
names in a file. Effects on forces need tyres: the kinematic bicycle has none and does not change.
Those on pulses, duty cycle and battery are refused for a motor with a speed loop
([drive forms](car-files.md#drive-forms)); the diagnosis does not try them there.

```toml
[[effects]]
name = "quadratic_drag"
parameters = { k = { value = 0.1, std = 0.02 } }
```

In a URL or an option: `quadratic_drag:0.1`, several with commas; where an effect has several
parameters, `encoder_ring:missing=0.05:phase=0.2`. *Sizes* are a small, a medium and a large
difference from null, of either sign if the interval allows it; the tests hide these. A fit keeps a
parameter between *from* and *to*. A size on an end of that interval, or outside its *physical*
range, is never accepted as a cause. This page is generated from `dart_hal/vehicle/effects/`
(`dart-hal wire --write`).
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
        parts.append(f"## {stage.capitalize()}\n\n{STAGE_TEXT[stage]}\n\n"
                     + " · ".join(f"[{e.name}](#{e.name})" for e in mine) + "\n")
        parts += [render_effect(e) for e in mine]
    return "\n".join(parts)


def render_effect(effect: Effect) -> str:
    """Return the section of an effect: physics, equation, parameters, distinguishing drive."""
    rows = "\n".join(map(_render_row, effect.parameters))
    confounders = ", ".join(f"[{name}](#{name})" for name in effect.confused_with)
    limit = " Not for a motor with a speed loop." if effect.duty_only else ""
    physics = textwrap.fill(f"The car {effect.title}. {effect.physics}{limit}", LINE_WIDTH)
    experiment = textwrap.fill(f"To distinguish them: {effect.experiment}", LINE_WIDTH)
    return f"""### {effect.name}

{physics}

```text
{equation_text(effect)}
```

| parameter | meaning | unit | null | from | to | physical | sizes |
|---|---|---|---|---|---|---|---|
{rows}

Looks like {confounders}.
{experiment}
"""


def _render_row(q: Parameter) -> str:
    unit = q.unit + (", per recording" if q.per_recording else "")
    cells = (f"`{q.name}`", q.meaning, unit, *map(_number, (q.null, q.low, q.high)),
             " to ".join(map(_number, q.physical_range)), " ".join(map(_number, q.sizes)))
    return "| " + " | ".join(cells) + " |"


def _number(v: float) -> str:
    return f"{v:g}"
