"""The page of the catalogue of effects, generated from its files."""

from __future__ import annotations

import textwrap

from dart_hal.vehicle.effect import EFFECT_STAGES, Effect, Parameter
from dart_hal.vehicle.effects import equation_text, order_key, own_effects

HEAD = """# Effects

What a base model lacks, one physical cause per entry. The simulator injects an effect, the
diagnosis looks for it, an extended `model.toml` carries it. At its null value an effect changes
nothing, to the last bit. Several act in the order of the stages below, whichever was named first.
Those on forces need tyres: the kinematic bicycle has none and does not change.

```toml
[[effects]]
name = "quadratic_drag"
parameters = { k = { value = 0.1, std = 0.02 } }
```

In a URL or an option: `quadratic_drag:0.1`, several with commas; where an effect has several
parameters, `encoder_ring:missing=0.05:phase=0.2`. *Sizes* are a small, a medium and a large
departure from null, of either sign where the interval allows it: what the tests hide. A fit may
move a parameter *from* .. *to*. A size on an end of that interval, or outside its *physical* range,
is never accepted as a cause. This page is
generated from `dart_hal/vehicle/effects/` (`dart-hal wire --write`).
"""

WIDTH = 120  # characters of a line of the page
STAGE_TEXT = {
    "command": "Between the program and the actuators.",
    "actuator": "Servo, linkage, ESC, motor and battery.",
    "force": "What acts on the car.",
    "motion": "What the forces move.",
    "measurement": "What the sensors make of it; the car moves as before.",
}


def render_effects() -> str:
    """Markdown page of the catalogue, by stage and in the order in which effects act."""
    effects = sorted(own_effects().values(), key=order_key)
    parts = [HEAD]
    for stage in EFFECT_STAGES:
        mine = [e for e in effects if e.stage == stage]
        parts.append(f"## {stage.capitalize()}\n\n{STAGE_TEXT[stage]}\n\n"
                     + " · ".join(f"[{e.name}](#{e.name})" for e in mine) + "\n")
        parts += [section(e) for e in mine]
    return "\n".join(parts)


def section(of: Effect) -> str:
    """One effect: sentence, physics, equation, parameters, and what tells it apart."""
    rows = "\n".join(map(_row, of.parameters))
    alike = ", ".join(f"[{name}](#{name})" for name in of.confused_with)
    said = textwrap.fill(f"The car {of.title}. {of.physics}", WIDTH)
    apart = textwrap.fill(f"To tell them apart: {of.experiment}", WIDTH)
    return f"""### {of.name}

{said}

```text
{equation_text(of)}
```

| parameter | meaning | unit | null | from | to | physical | sizes |
|---|---|---|---|---|---|---|---|
{rows}

Looks like {alike}.
{apart}
"""


def _row(q: Parameter) -> str:
    unit = q.unit + (", per recording" if q.per_recording else "")
    cells = (f"`{q.name}`", q.meaning, unit, *map(_number, (q.null, q.low, q.high)),
             " to ".join(map(_number, q.physical_range)), " ".join(map(_number, q.sizes)))
    return "| " + " | ".join(cells) + " |"


def _number(v: float) -> str:
    return f"{v:g}"
