"""From a command to a pulse on the pin, and what may stop it.

``Actuator`` (chain) drives servo and ESC through the PCA9685. ``Supervisor`` decides what the pins
may carry. ``arming`` lists why a car does not arm. Importing this package opens nothing and loads
neither ServoKit nor scipy.
"""

from dart_hal.devices.actuation.arming import (
    Caution,
    Facts,
    list_cautions,
    not_armed_error,
    refusals,
)
from dart_hal.devices.actuation.chain import Actuator
from dart_hal.devices.actuation.counters import ActuatorCounters
from dart_hal.devices.actuation.guarded import Guard
from dart_hal.devices.actuation.pca9685 import Pca9685
from dart_hal.devices.actuation.plan import LIVE_DEMAND, RAW_DEMAND, PinDemand
from dart_hal.devices.actuation.quantiser import Quantiser
from dart_hal.devices.actuation.states import ArmState, Event
from dart_hal.devices.actuation.steering_map import SteeringMap, steering_map
from dart_hal.devices.actuation.supervisor import Supervisor
from dart_hal.devices.actuation.trips import disarmed_error

__all__ = [
    "LIVE_DEMAND",
    "RAW_DEMAND",
    "Actuator",
    "ActuatorCounters",
    "ArmState",
    "Caution",
    "Event",
    "Facts",
    "Guard",
    "Pca9685",
    "PinDemand",
    "Quantiser",
    "SteeringMap",
    "Supervisor",
    "disarmed_error",
    "list_cautions",
    "not_armed_error",
    "refusals",
    "steering_map",
]
