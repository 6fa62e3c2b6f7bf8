"""Evaluate laws of effects on every engine that carries them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dart_hal.vehicle.channels import Stepper, transform_signal
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effect import SIGNAL_CHANNELS, Forces, Now, PureDelay
from dart_hal.vehicle.effects import activate, add_effects, catalogue
from dart_hal.vehicle.flat import bind, names, stack, value, values
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.namespace import ARRAY, SCALAR, adapt
from dart_hal.vehicle.native.build import Variant, compile_kernel
from dart_hal.vehicle.native.call import align_coefficients, call
from dart_hal.vehicle.native.emit import body, source
from dart_hal.vehicle.native.library import _load_function
from dart_hal.vehicle.native.model import evaluate_coefficients, record
from dart_hal.vehicle.native.trace import Graph, evaluate
from dart_hal.vehicle.steering import make_steering
from dart_hal.vehicle.tyres import make_tyres
from tests.vehicle.effects.laws import FORCE_INPUTS, LAW_CARS, LAW_SAMPLE_TIME, LAWS

QUANTITIES = {
    "angle": lambda p, f, s: make_steering(p.steering, f)(s),
    "f_m": lambda p, f, tau, v: make_motor(p.motor, f)(tau, v),
    "f_f": lambda p, f, v: make_friction(p.friction, f)(v, 0.0),
    "f_yf": lambda p, f, alpha: make_tyres(p.tyres, p.body, f)[0](alpha),
    "f_yr": lambda p, f, alpha: make_tyres(p.tyres, p.body, f)[1](alpha)}
"""What a law of a changed parameter is about: road-wheel angle of a command [rad]; force of the
motor, of friction, and of the front and the rear tyres [N]."""


def kind_of(law):
    """Return which hook of the effect the law is about: force, signals or vehicle."""
    if set(law.state) <= set(Forces._fields) and set(law.expected) <= set(Forces._fields):
        return "force"
    series = set(law.expected) <= set(SIGNAL_CHANNELS) & set(law.state)
    return "signals" if series else "vehicle"


def laws_of(name, kind):
    """Return the laws of an effect about one of its hooks."""
    return [law for law in LAWS if law.effect == name and kind_of(law) == kind]


def channels_of(name):
    """Return the channels that the laws of an effect are about."""
    return {channel for law in laws_of(name, "signals") for channel in law.expected}


def find_failures(law, results, engine):
    """Compare results by name with what the law expects; return one line for each difference."""
    lines = []
    for name, expected in law.expected.items():
        error = np.abs(np.asarray(results[name], dtype=float) - np.asarray(expected))
        limit = law.tolerance * np.maximum(1.0, np.abs(expected))
        if not (error <= limit).all():
            lines.append(f"{engine}: {law.effect} {dict(law.values)} at {dict(law.state)} gives "
                         f"{name} = {results[name]}, not {expected}")
    return lines


# forces: fields of Forces by name

def expected_forces(law):
    """Return the law with every field of Forces in its expectation: the others do not change."""
    return replace(law, expected=FORCE_INPUTS | law.state | law.expected)


def evaluate_forces(tested, law):
    hook = tested.force(LAW_CARS[law.car], SCALAR, *activate(tested, law.values).values)
    return hook(Forces(**(FORCE_INPUTS | law.state)))._asdict()


def evaluate_forces_together(tested, laws):
    """Evaluate the laws of one car as one batch: values and states are arrays (n,)."""
    cars = stack([add_effects(LAW_CARS[law.car], (activate(tested, law.values),)) for law in laws])
    rows = {k: np.array([(FORCE_INPUTS | law.state)[k] for law in laws]) for k in Forces._fields}
    hook = tested.force(cars, ARRAY, *cars.effects[0].values)
    out = [np.broadcast_to(v, len(laws)) for v in hook(Forces(**rows))]
    return [dict(zip(Forces._fields, column, strict=True)) for column in zip(*out, strict=True)]


def evaluate_forces_of_symbols(tested, law):
    """Evaluate the graph of the equation, in which parameters and state are symbols."""
    graph = Graph()
    car = add_effects(LAW_CARS[law.car], (activate(tested, law.values),))
    symbols = bind(car, graph.symbol)
    hook = tested.force(symbols, graph.namespace(), *symbols.effects[0].values)
    out = [v if hasattr(v, "index") else graph.constant(v)
           for v in hook(Forces(*map(graph.symbol, Forces._fields)))]
    numbers = {k: min(v, 1e30) for k, v in values(car).items()} | FORCE_INPUTS | law.state
    results = evaluate(graph, tuple(v.index for v in out), numbers, SCALAR)
    return dict(zip(Forces._fields, results, strict=True))


def evaluate_forces_of_casadi(tested, law, casadi):
    """Evaluate the equation over casadi's symbols; also return its slope at the state and at 0."""
    x = casadi.SX.sym("x", len(Forces._fields))
    hook = tested.force(LAW_CARS[law.car], adapt(casadi), *activate(tested, law.values).values)
    out = casadi.vertcat(*hook(Forces(*casadi.vertsplit(x))))
    state = [(FORCE_INPUTS | law.state)[k] for k in Forces._fields]
    at_rest = [1.0 if k == "cos_d" else 0.0 for k in Forces._fields]
    slope = casadi.Function("slope", [x], [casadi.jacobian(out, x)])
    results = np.array(casadi.Function("forces", [x], [out])(state)).ravel()
    return (dict(zip(Forces._fields, results, strict=True)),
            np.array([slope(state).full(), slope(at_rest).full()]))


def evaluate_forces_compiled(effects, laws, folder):
    """Evaluate laws of one form of car in a compiled kernel with all effects, a lane for each.

    In each lane the effects of other laws are at their null. Returns the fields by name, per lane.
    """
    cars = [add_effects(LAW_CARS[law.car],
                        [activate(tested, law.values if tested.name == law.effect else {})
                                     for tested in effects]) for law in laws]

    def make(symbol, f):
        p = bind(cars[0], symbol)

        def step(*state):
            q = Forces(*state[:len(Forces._fields)])
            for effect in p.effects:
                q = effect.effect.force(p, f, *effect.values)(q)
            return tuple(q)

        return step

    traced = record("laws", make, Forces._fields, ("first", "second"))
    path = compile_kernel(source([body(traced)]), Variant(64, True), folder)
    lanes = stack(cars)
    numbers = {name: value(lanes, name) for name in names(lanes)}
    start = np.array([[(FORCE_INPUTS | law.state)[k] for law in laws] for k in Forces._fields])
    unused = np.zeros((1, len(laws)))
    h = align_coefficients(evaluate_coefficients(traced, numbers, len(laws)), np.float64)
    out = call(_load_function(path, "laws"), h,
               start, unused, unused, [1], 1)[0]
    return [dict(zip(Forces._fields, column, strict=True)) for column in out.T]


# signals: series by channel

def _now(law, n):
    """Return what a hook may know; the voltage of the battery only if the law has it."""
    return Now(**{k: np.asarray(law.state.get(k, np.zeros(n)), dtype=float) for k in Now._fields
                  if k != "voltage" or k in law.state})


def _series(law, channel):
    """Return the series of a channel as arrays, a tuple of them where it has several."""
    rows = np.asarray(law.state[channel], dtype=float)
    return tuple(rows) if rows.ndim == 2 else rows


def _length(series):
    return len(series[0] if isinstance(series, tuple) else series)


def evaluate_series(tested, law):
    p = add_effects(LAW_CARS[law.car], (activate(tested, law.values),))
    series = {c: _series(law, c) for c in law.expected}
    return {c: transform_signal(p, c, s, _now(law, _length(s)), LAW_SAMPLE_TIME) for c,
            s in series.items()}


def evaluate_series_in_lanes(tested, law):
    """Evaluate two cars in one batch; the second is heavier and at the null of the effect.

    Returns the series of the first, and the largest change of the second.
    """
    car = LAW_CARS[law.car]
    heavier = replace(car, body=replace(car.body, mass=car.body.mass + 0.5))
    both = stack([add_effects(car, (activate(tested, law.values),)),
                  add_effects(heavier, (activate(tested, {}),))])
    results = {}
    changes = [0.0]
    for channel in law.expected:
        series = _series(law, channel)
        out = np.array(transform_signal(both, channel, series, _now(law, _length(series)),
                                        LAW_SAMPLE_TIME))
        results[channel] = out[..., 0]
        changes.append(np.abs(out[..., 1] - np.array(series)).max())
    return results, max(changes)


def evaluate_step_by_step(tested, law):
    """Evaluate one sample after the other, as a simulator does; {} where it needs the future."""
    p = add_effects(LAW_CARS[law.car], (activate(tested, law.values),))
    results = {}
    for channel in law.expected:
        hook = tested.signals[channel]
        if isinstance(hook, PureDelay) and hook.seconds(*activate(tested, law.values).values) < 0.0:
            return {}
        series = _series(law, channel)
        now = _now(law, _length(series))
        stepper = Stepper(p, channel, LAW_SAMPLE_TIME)
        rows = list(zip(*series, strict=True)) if isinstance(series, tuple) else series.tolist()
        results[channel] = np.array([
            stepper(row, Now(*(None if series is None else series[i] for series in now)))
            for i, row in enumerate(rows)]).T
    return results


# parameters: parameters and quantities by name

def expected_parameters(law):
    """Return the law with every parameter of the car in its expectation: the others stay."""
    if law.state:
        return law
    old = {k: min(v, 1e30) for k, v in values(LAW_CARS[law.car]).items()}
    return replace(law, expected=old | law.expected)


def _quantities(p, f, law, convert):
    if not law.state:
        return {k: value(p, k) for k in names(p)}
    state = {k: convert(v) for k, v in law.state.items()}
    return {k: QUANTITIES[k](p, f, **state) for k in law.expected}


def evaluate_parameters(tested, law):
    p = apply_parameter_effects(add_effects(LAW_CARS[law.car], (activate(tested, law.values),)))
    return _quantities(p, SCALAR, law, float)


def evaluate_parameters_in_lanes(tested, law):
    """Evaluate two cars in one batch; the second has the values of the null."""
    p = apply_parameter_effects(stack([add_effects(LAW_CARS[law.car], (activate(tested, v),))
                                       for v in (law.values, {})]))
    results = _quantities(p, ARRAY, law, np.asarray)
    return {k: np.broadcast_to(v, 2)[0] for k, v in results.items()}


def evaluate_parameters_of_symbols(tested, law):
    graph = Graph()
    car = add_effects(LAW_CARS[law.car], (activate(tested, law.values),))
    symbols = apply_parameter_effects(bind(car, graph.symbol))
    results = _quantities(symbols, graph.namespace(), law, graph.constant)
    numbers = {k: min(v, 1e30) for k, v in values(car).items()}
    return dict(zip(results, evaluate(graph, tuple(v.index for v in results.values()), numbers,
                                      SCALAR), strict=True))


def check_effect(tested):
    """Return what of the laws of an effect plain floats and series do not satisfy; [] = nothing.

    ``of`` may be an effect that is not in the catalogue: a broken one.
    """
    failures = []
    for law in laws_of(tested.name, "force"):
        failures += find_failures(expected_forces(law), evaluate_forces(tested, law), "math")
    for law in laws_of(tested.name, "signals"):
        failures += find_failures(law, evaluate_series(tested, law), "series")
        steps = evaluate_step_by_step(tested, law)
        failures += find_failures(law, steps, "step by step") if steps else []
    for law in laws_of(tested.name, "vehicle"):
        failures += find_failures(expected_parameters(law), evaluate_parameters(tested, law),
                                  "math")
    return failures


def force_effects():
    """Return the effects of the catalogue that change forces."""
    return [tested for tested in catalogue().values() if tested.force]
