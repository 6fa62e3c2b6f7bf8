"""The page of all keys of model.toml, generated from the classes that read them."""

from __future__ import annotations

import inspect
import math
from dataclasses import MISSING, Field, fields
from typing import Any

from dart_hal.core.config.model import MODEL_KEYS
from dart_hal.vehicle.file import PARAMETER_CLASSES
from dart_hal.vehicle.parameters import AxleTyres, Motor, PaperTyres, SpeedLoop
from dart_hal.vehicle.scale import REFERENCE_MASS

HEAD = f"""# Keys of model.toml

A `model.toml` is a model of one car. `dart-hal identify`, `experiment --out-model` and `diagnose
--out` write it, `--model` and `--base` read it. All units are SI, angles are in rad. A parameter is
a number, or a value with its standard error:

```toml
[body]
mass = {{ value = 3.5, std = 0.02, method = "car.toml" }}

[friction]
a = 1.72
```

`name`, `kind` and `[body]` are required. Another section, or a key of one, that is missing has the
value of the set `paper`. A fit
keeps a parameter within its *bounds*, and a file outside of them is refused. Bounds marked with *m*
are those of a car of {REFERENCE_MASS:g} kg. A fit of a heavier or lighter car widens them by the
ratio of the masses, and a file may go beyond them by a factor of 1000. The sizes of a car come from
[car.toml](car-files.md#a-car-that-is-known-by-recordings). This page is generated from
`dart_hal/vehicle/parameters.py` (`dart-hal wire --write`).

| key | type | meaning |
|---|---|---|
"""
NOTES = {
    "body": """`l_f + l_r` is the wheelbase. The mass over the cube of the wheelbase must be 10 to
3000 kg/m3, and the yaw inertia 0.05 to 20 times `mass l_f l_r`: other values have a wrong unit.
Sizes whose `method` begins with `car.toml` have the standard error that the owner states: a joint
fit and a diagnosis may move them. Others are fixed, but mass and yaw inertia in a joint fit.
""",
    "steering": """With c = s + s0 and a smooth switch w from right (0) to left (1) at c = 0:
delta = w a_left tanh(k_left c) + (1 - w) a_right tanh(k_right c).
""",
    "tyres": """One of two forms. The form by axle is used where the file has `rear_D`. Slip angles
are in rad; published values per degree are multiplied by 180/pi.
""",
    "motor": """One of two [drive forms](car-files.md#drive-forms), which `forms.motor` names.
"""}
# Sections of several forms: title and class of each.
SECTION_FORMS: dict[str, dict[str, Any]] = {
    "motor": {"duty: the throttle is a duty cycle": Motor,
              "speed: the throttle is a commanded speed": SpeedLoop},
    "tyres": {"The form of the paper": PaperTyres, "By axle": AxleTyres}}


def render_model_file() -> str:
    """Markdown page of the keys of model.toml, section by section."""
    parts = [HEAD + "\n".join(f"| `{key}` | {kind} | {meaning} |"
                              for key, (kind, meaning) in MODEL_KEYS.items()) + "\n"]
    for section, kind in PARAMETER_CLASSES.items():
        parts += [f"## {section}\n", _describe(kind), NOTES.get(section, ""), _table(kind)]
    for section, forms in SECTION_FORMS.items():
        parts += [f"## {section}\n", NOTES[section]]
        for title, kind in forms.items():
            parts += [f"### {title}\n", _describe(kind), _table(kind)]
    parts += ["## effects\n",
              "The names of effects, their parameters, units and bounds are those of the "
              "[catalogue](effects.md).\n"]
    return "\n".join(part for part in parts if part)


def _describe(kind: Any) -> str:
    """The equation of a group, as its class states it."""
    return f"```text\n{inspect.cleandoc(kind.__doc__ or '').replace('``', '')}\n```\n"


def _table(kind: Any) -> str:
    rows = "\n".join(map(_row, fields(kind)))
    return ("| key | meaning | unit | from | to | default |\n|---|---|---|---|---|---|\n"
            f"{rows}\n")


def _row(f: Field[Any]) -> str:
    meta = f.metadata
    scale = " *m*" if "of_mass" in meta else ""
    bounds = (_number(meta["low"]) + scale * (meta["low"] != 0.0),
              _number(meta["high"]) + scale * math.isfinite(meta["high"]))
    default = "-" if f.default is MISSING else _number(float(f.default))
    return f"| `{f.name}` | {meta['meaning']} | {meta['unit']} | {' | '.join(bounds)} | {default} |"


def _number(value: float) -> str:
    return "none" if math.isinf(value) else f"{value:g}"
