"""The error catalogue: every error that a user can get, with its remedy.

Each class has a code, the likely cause and the command to type; the code that raises it adds what
was found. Each class also inherits the builtin exception that a caller would expect.
``CATALOGUE`` lists all classes; the documentation is generated from it.
"""

from __future__ import annotations

from typing import ClassVar


class DartHalError(Exception):
    """Base of all errors of this library.

    ``what``: one sentence with the facts; ``found``: the actual value; ``expected``: the required
    value; ``likely``: probable cause; ``remedy``: command to type; ``read``: the file concerned.
    """

    code: ClassVar[str] = "D-000"
    likely_default: ClassVar[str] = ""
    remedy_default: ClassVar[str] = ""

    def __init__(self, what: str, *, found: str = "", expected: str = "", likely: str = "",
                 remedy: str = "", read: str = "") -> None:
        self.what = what
        self.found = found
        self.expected = expected
        self.likely = likely or self.likely_default
        self.remedy = remedy or self.remedy_default
        self.read = read
        super().__init__(what)

    def __str__(self) -> str:
        lines = [f"error {self.code}: {self.what}"]
        lines += [f"  {name:<8} : {text}".replace("\n", "\n" + " " * 13)
                  for name, text in self._parts().items() if text]
        return "\n".join(lines)

    def as_json(self) -> dict[str, str]:
        """Return the object that every verb prints under "error" with ``--json``."""
        return {"code": self.code, "what": self.what, **self._parts()}

    def _parts(self) -> dict[str, str]:
        return {"found": self.found, "expected": self.expected, "likely": self.likely,
                "try": self.remedy, "read": self.read}


class UnknownScheme(DartHalError, ValueError):
    """A URL whose scheme no backend serves."""

    code = "D-LINK-01"
    remedy_default = "use sim://, serial:///dev/ttyUSB0, hwgrep://VID:PID, avr:// or replay://FILE"


class PortMissing(DartHalError, OSError):
    """The serial port does not exist, or did not appear in time."""

    code = "D-LINK-02"
    likely_default = "cable not plugged in, or another name after replugging"
    remedy_default = ("ls /dev/ttyUSB* /dev/ttyACM* ; then "
                      "dart-hal doctor --url 'serial:///dev/ttyUSB0?i2c=1'")


class PortBusy(DartHalError, OSError):
    """Another process has opened the port."""

    code = "D-LINK-03"
    likely_default = "a second dart-hal, a serial monitor or ModemManager has it open"
    remedy_default = "close that program, then run the command again"


class NoHello(DartHalError, TimeoutError):
    """No identification was received at any baud rate."""

    code = "D-LINK-05"
    likely_default = "no DART firmware on the Nano, another baud rate, or a charge-only USB cable"
    remedy_default = "dart-hal flash ; then dart-hal doctor"


class LinkLost(DartHalError, ConnectionError):
    """The stream stopped or the port vanished."""

    code = "D-LINK-06"
    likely_default = ("cable pulled out, Nano without power, its USB bridge reset, or this program "
                      "suspended")
    remedy_default = "plug it in again, then dart-hal doctor"


class NoScan(DartHalError, TimeoutError):
    """The port of the lidar is open, but no packet of a known model is received."""

    code = "D-LIDAR-01"
    likely_default = ("its motor does not turn (no 5 V at the adapter), its cable to the adapter "
                      "is loose, or it is another device")
    remedy_default = "dart-hal find ; serial:///dev/dart-lidar, without model= and baud="


class NoImage(DartHalError, TimeoutError):
    """An open camera sends no images."""

    code = "D-CAM-01"
    likely_default = ("it was unplugged, its USB hub is without power, or it hangs")
    remedy_default = "plug it in again; v4l2-ctl --list-devices ; dart-hal doctor --camera usb:0"


class PortDenied(DartHalError, PermissionError):
    """The user has no permission to open the port."""

    code = "D-LINK-07"
    likely_default = "the user is not in the group that owns the port (dialout)"
    remedy_default = "sudo usermod -aG dialout $USER ; then log in again"


class BusError(DartHalError, OSError):
    """An I2C transaction failed. ``part``: the failed part, as in the reasons of ``arm()``."""

    code = "D-I2C-01"
    part = "write"
    likely_default = "loose jumper, wrong bus number, or the board has no power"
    remedy_default = "dart-hal doctor"


class BusMissing(BusError):
    """``i2c=auto`` finds no bus, or several."""

    code = "D-I2C-07"
    part = "absent"
    likely_default = "I2C is switched off, a bridge is unplugged, or the board is not a known one"
    remedy_default = ("sudo modprobe i2c-dev ; on a Raspberry Pi sudo raspi-config nonint do_i2c 0 "
                      "; then dart-hal find, and i2c=N for the bus of your header")


class PcaMissing(BusError):
    """No PCA9685 answers at its address."""

    code = "D-I2C-02"
    part = "absent"
    likely_default = "address jumpers set (0x41..0x7f), or VCC not powered from the 3.3 V pin"
    remedy_default = "dart-hal doctor ; then [pwm] address in car.toml"


class PcaFault(BusError):
    """The PCA9685 does not store what was written."""

    code = "D-I2C-03"
    part = "mode"
    likely_default = "brown-out of the board, or a second program writes to it"
    remedy_default = "check the board's 3.3 V and end other programs on the bus; dart-hal doctor"


class PcaBusy(BusError):
    """Another program drives this PCA9685, through this or another Nano."""

    code = "D-I2C-04"
    likely_default = "two programs for one car, or two cars' URLs with the same i2c= and address"
    remedy_default = ("end that program (dart-hal stop), or give this car its own bus: i2c=N, "
                      "[pwm] address in car.toml")


class NotPca(BusError):
    """The device at the address is no PCA9685; nothing was written to it."""

    code = "D-I2C-05"
    likely_default = "another bus: some computers have a power monitor at 0x40 of bus 1"
    remedy_default = ("i2c=7 on an Orin Nano, whose header pins 3 and 5 are bus 7; "
                      "ls /dev/i2c-* ; sudo i2cdetect -y N shows the devices of each")


class PcaClaimed(BusError):
    """A kernel driver uses the PCA9685's address; nothing was written."""

    code = "D-I2C-06"
    likely_default = "the wrong bus, with a part of the computer at 0x40, or a device tree overlay"
    remedy_default = ("i2c=7 on an Orin Nano, whose header pins 3 and 5 are bus 7; for an overlay "
                      "of a PCA9685: remove it, the kernel must not drive it")


class BatteryUnmeasured(DartHalError, OSError):
    """The Nano measures no voltage of a battery at its A0."""

    code = "D-BAT-01"
    likely_default = "a wire of the divider is off, or another ratio or number of cells"
    remedy_default = "docs/build_guide/06_wiring.md, section Options"


class BadCommand(DartHalError, ValueError):
    """A command is not a finite number; the car is set to neutral.

    causes: of ``pulses()`` only, names of the causes of the trip that ended ``raw()``.
    """

    code = "D-CMD-01"
    remedy_default = "check the controller's output before drive()"
    causes: tuple[str, ...] = ()


class NotArmed(DartHalError, RuntimeError):
    """``arm()`` failed; ``reasons``: the names of all causes."""

    code = "D-ARM-01"
    remedy_default = "dart-hal doctor"

    def __init__(self, what: str, *, reasons: tuple[str, ...] = (), remedy: str = "",
                 found: str = "") -> None:
        self.reasons = reasons
        super().__init__(what, found=found or ", ".join(reasons), remedy=remedy)


class Disarmed(DartHalError, RuntimeError):
    """A command to a car that a trip has disarmed; ``causes``: names of the causes.

    Raised by every command until ``arm()`` or ``stop()`` is called. With
    ``Car.open(raise_on_trip=False)``, ``Applied.limited`` states it instead.
    """

    code = "D-ARM-02"
    remedy_default = "remove the cause, then call car.arm() again"

    def __init__(self, what: str, *, causes: tuple[str, ...] = (), remedy: str = "",
                 found: str = "") -> None:
        self.causes = causes
        super().__init__(what, found=found or ", ".join(causes), remedy=remedy)


class ConfigError(DartHalError, ValueError):
    """A file of the car is invalid; the message names file and key."""

    code = "D-FILE-01"
    remedy_default = "correct the key in the message, or compare with cars/dart-01"


class OtherCar(ConfigError):
    """A calibration that belongs to another car."""

    code = "D-FILE-02"
    likely_default = "the file was copied from another car's folder"
    remedy_default = "dart-hal calibrate steering"


class NotMonotone(ConfigError):
    """A steering map that cannot be inverted."""

    code = "D-FILE-03"
    remedy_default = "dart-hal calibrate steering"


class FileTrouble(DartHalError, OSError):
    """A file or folder cannot be written, read or created."""

    code = "D-FILE-04"
    likely_default = "no permission, no such folder, or the disk is full"
    remedy_default = "check the path with ls -ld and the space with df, or use another one"


class RecordingError(DartHalError, ValueError):
    """A recording cannot be read or used; the message names the file."""

    code = "D-REC-01"
    remedy_default = "make a new recording with dart-hal record"


class EndOfRecording(LinkLost):
    """A replay has reached the end of its recording; this is no fault."""

    code = "D-REC-02"
    likely_default = "the whole run was read"
    remedy_default = "record a longer run, or read fewer States"


class LogError(DartHalError, ValueError):
    """``Car.log`` does not accept a name or a value; nothing of the call was recorded."""

    code = "D-REC-04"
    likely_default = "text, None, or rows of unequal length among the numbers"
    remedy_default = 'car.log("mpc/cost", 1.5), car.log("mpc/plan", array) or a dict of those'


class FetchFailed(DartHalError, ConnectionError):
    """The published recordings could not be downloaded."""

    code = "D-REC-03"
    likely_default = "no network, or a source with other files"
    remedy_default = "dart-hal data fetch --from DIR"


class CalibrationFailed(DartHalError, RuntimeError):
    """The measurement has no reliable result; nothing was written."""

    code = "D-CAL-01"
    remedy_default = "remove the cause that found names, then run the same calibration again"


class ExperimentFailed(DartHalError, RuntimeError):
    """A drive cannot be planned on this floor, or the car did not follow it."""

    code = "D-EXP-01"
    remedy_default = "remove the cause that found names, then run the same experiment again"


class ClusterFailed(DartHalError, ConnectionError):
    """A cluster cannot be used: no scheduler, too few workers, other software, or lost midway."""

    code = "D-CLUS-01"
    likely_default = "the scheduler does not run, a firewall, or another port"
    remedy_default = "dask scheduler ; on each computer: dask worker ADDRESS --nthreads 1"


class EmulatorMissing(DartHalError, RuntimeError):
    """The emulator of the firmware cannot be used on this computer."""

    code = "D-SIM-01"
    likely_default = "simavr or the AVR compiler is not installed, or the bridge was not built"
    remedy_default = "make firmware ; or use sim://?nano=mock"


class FlashFailed(DartHalError, RuntimeError):
    """avrdude could not write the firmware."""

    code = "D-FLASH-01"
    remedy_default = "dart-hal flash --port PORT ; hold reset, release it when avrdude starts"


class UsageError(DartHalError, ValueError):
    """An option or argument is invalid."""

    code = "D-USE-01"
    remedy_default = "dart-hal VERB --help ; in Python: help(NAME)"


class UnknownAttribute(DartHalError, AttributeError):
    """A program sets an attribute that a car does not have."""

    code = "D-USE-03"
    likely_default = "the program was written for another library, where this moves the car"
    remedy_default = "car.drive(steering=..., throttle=...)"


class ScriptFailed(DartHalError, RuntimeError):
    """The user's script raised an error; the car was stopped."""

    code = "D-USE-02"
    remedy_default = "correct the script at the line in the message"


class PluginFailed(DartHalError, RuntimeError):
    """The entry point of another package raised an error; the message names both."""

    code = "D-PLUG-01"
    likely_default = "an error or a missing part of that package, not of DART-HAL"
    remedy_default = "check the URL and what it connects to; report the rest to that package"


class InternalError(DartHalError, RuntimeError):
    """An error of this program."""

    code = "D-BUG-01"
    likely_default = "an error in DART-HAL, not in your input"
    remedy_default = "run it again with DART_HAL_DEBUG=1 and report what it prints"


def _list_subclasses(cls: type[DartHalError]) -> list[type[DartHalError]]:
    found = []
    for sub in cls.__subclasses__():
        found += [sub, *_list_subclasses(sub)]
    return found


CATALOGUE: dict[str, type[DartHalError]] = {c.code: c for c in _list_subclasses(DartHalError)}
