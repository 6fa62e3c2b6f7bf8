"""The equations have no branches: numbers that refuse to be compared pass through."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from dart_hal.vehicle import (
    SETS,
    adapt,
    make_acceleration,
    make_kinematic,
    make_slip,
    make_steering,
)


class Symbol:
    """Computes like a float but has no truth value and no order, as a symbol has none."""

    __slots__ = ("value",)

    def __init__(self, value):
        self.value = value.value if isinstance(value, Symbol) else float(value)

    def _refuse(self, *_):
        raise TypeError("a branch on a symbol")

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __float__ = _refuse

    def __neg__(self):
        return Symbol(-self.value)


def _binary(name):
    def forward(self, other):
        return Symbol(getattr(self.value, name)(Symbol(other).value))

    return forward


for _name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv"):
    setattr(Symbol, f"__{_name}__", _binary(f"__{_name}__"))


def _lift(function):
    return lambda *args: Symbol(function(*(Symbol(a).value for a in args)))


SYMBOLIC = SimpleNamespace(
    fmin=_lift(min), fmax=_lift(max),
    **{n: _lift(getattr(math, n)) for n in ("sin", "cos", "tan", "atan", "atan2", "tanh", "exp",
                                            "sqrt", "fabs", "floor")})


@pytest.mark.parametrize("vehicle", SETS.values(), ids=SETS)
@pytest.mark.parametrize("form", ["all_speeds", "paper", "upstream"])
def test_dynamic_equations(vehicle, form):
    state = (1.2, -0.1, 2.0, 0.3, 0.15)
    symbols = make_acceleration(vehicle, SYMBOLIC, form)(*map(Symbol, state))
    assert [s.value for s in symbols] == pytest.approx(
        make_acceleration(vehicle, math, form)(*state), rel=1e-12)


@pytest.mark.parametrize("vehicle", SETS.values(), ids=SETS)
def test_kinematic_equations_and_steering_map(vehicle):
    args = (0.3, 1.2, 2.0, 0.4, 0.0, 0.2)
    symbols = make_kinematic(vehicle, SYMBOLIC)(*map(Symbol, args))
    assert [s.value for s in symbols] == pytest.approx(make_kinematic(vehicle)(*args), rel=1e-12)
    curve = make_steering(vehicle.steering, SYMBOLIC)
    assert curve(Symbol(0.4)).value == make_steering(vehicle.steering)(0.4)


def test_a_namespace_that_lacks_a_function_is_refused():
    with pytest.raises(AttributeError):
        adapt(SimpleNamespace(sin=math.sin))


def test_unknown_slip_form_is_refused():
    with pytest.raises(ValueError, match="no slip angles"):
        make_slip(SETS["paper"].body, form="printed")
