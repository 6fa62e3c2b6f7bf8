"""From a command to a pulse on the pin, and what may stop it.

``Actuator`` (chain) drives servo and ESC through the PCA9685; ``Supervisor``
says what it may carry; ``arming`` says why a car does not arm. Importing this
package opens nothing and loads neither ServoKit nor scipy.
"""

from dart_hal.devices.actuation.arming import Caution, Facts, not_armed, refusals, warnings
from dart_hal.devices.actuation.chain import Actuator
from dart_hal.devices.actuation.counters import ActuatorCounters
from dart_hal.devices.actuation.guarded import Guard
from dart_hal.devices.actuation.pca9685 import Pca9685
from dart_hal.devices.actuation.plan import LIVE, RAW, Output
from dart_hal.devices.actuation.quantiser import Quantiser
from dart_hal.devices.actuation.states import ArmState, Event
from dart_hal.devices.actuation.steering_map import SteeringMap, steering_map
from dart_hal.devices.actuation.supervisor import Supervisor
from dart_hal.devices.actuation.trips import disarmed

__all__ = [
    "LIVE",
    "RAW",
    "Actuator",
    "ActuatorCounters",
    "ArmState",
    "Caution",
    "Event",
    "Facts",
    "Guard",
    "Output",
    "Pca9685",
    "Quantiser",
    "SteeringMap",
    "Supervisor",
    "disarmed",
    "not_armed",
    "refusals",
    "steering_map",
    "warnings",
]
