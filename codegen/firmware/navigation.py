"""From the instruments to the estimate: which estimator a program has, and where its inputs come from.

An estimator's inputs have the names of the sensors' outputs. By these names navigation.h copies what the
instruments measure. With an AHRS, roll, pitch and heading are the AHRS's instead of the inertial unit's own.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.cmec import Cmec
from models.command_module import CommandModule
from models.errors import DeclarationError
from models.four_state import FourState
from models.kit.block import Block
from models.kit.declaration import flatten
from models.local_plane import LocalPlane
from models.watchdog import Watchdog

FIELD = 4.9e-5  # T: the inertial unit's unit of magnetic fields, the field where it was calibrated
# C by the input that it feeds, from a sample of the inertial unit
SAMPLE: dict[str, str] = {
    **{
        f"{kind}_{axis}": f"mt_value(&m->imu, MT_{kind.upper()}_{axis.upper()})"
        for kind in ("accel", "gyro")
        for axis in "xyz"
    },
    **{f"mag_{axis}": f"TESLA * mt_value(&m->imu, MT_MAG_{axis.upper()})" for axis in "xyz"},
    **{f"{angle}_meas": f"mt_value(&m->imu, MT_{angle.upper()})" for angle in ("roll", "pitch", "heading")},
}
# likewise from a fix of the receiver
FIX: dict[str, str] = {
    "gps_north": "m->local_plane.out.north",
    "gps_east": "m->local_plane.out.east",
    "gps_speed": "PER_MILLE * (float)fix->speed",
    "gps_course": "COURSE * (float)fix->course",
    "gps_h_acc": "PER_MILLE * (float)fix->h_acc",
    "gps_s_acc": "PER_MILLE * (float)fix->s_acc",
}
FACTORS: dict[str, tuple[str, str]] = {
    "PER_MILLE": ("0.001f", "mm to m, mm/s to m/s"),
    "COURSE": ("1.74532925e-7f", "1e-5 deg to rad"),
    "TESLA": (f"{FIELD:g}f", "the inertial unit's unit of magnetic fields, where it was calibrated"),
}
FIXED = "gps_fix"  # the input that says whether there is a fix


@dataclass(frozen=True)
class Navigation:
    """The estimator of a program, and what comes before it.

    Attributes:
        estimator: a block with the outputs of the role.
        ahrs: a block that finds roll, pitch and heading from raw samples; None takes the inertial unit's.
    """

    estimator: type[Block] = FourState
    ahrs: type[Block] | None = None

    @property
    def name(self) -> str:
        """As it is written: `four_state`, `four_state+ahrs`."""
        return self.estimator.title() + ("+ahrs" if self.ahrs else "")

    @property
    def options(self) -> str:
        """Of the command line."""
        return f"--estimator {self.estimator.title()}" + (" --ahrs" if self.ahrs else "")

    @property
    def chain(self) -> dict[str, type[Block]]:
        """Its blocks by their member of `onboard`, in the order of their steps."""
        return ({"ahrs": self.ahrs} if self.ahrs else {}) | {"estimator": self.estimator}

    @property
    def blocks(self) -> dict[str, type[Block]]:
        """The members of `onboard` in onboard.h that are blocks."""
        return {
            "local_plane": LocalPlane,
            **self.chain,
            "watchdog": Watchdog,
            "controller": Cmec,
            "command_module": CommandModule,
        }

    def of_sample(self, member: str) -> dict[str, str]:
        """The C that feeds a block's inputs from a sample of the inertial unit, by input."""
        return {
            name: self._shared(name, member) or SAMPLE[name]
            for name in self._inputs(member)
            if name in SAMPLE and name not in self.of_ahrs(member)
        }

    def of_fix(self, member: str) -> dict[str, str]:
        """Likewise from a fix."""
        return {name: self._shared(name, member) or FIX[name] for name in self._inputs(member) if name in FIX}

    def of_ahrs(self, member: str) -> dict[str, str]:
        """Likewise from the AHRS, if there is one before it."""
        if self.ahrs is None or member == "ahrs":
            return {}
        from_ahrs = self.ahrs.flat_names("output")
        return {name: f"m->ahrs.out.{name}" for name in self._inputs(member) if name in from_ahrs}

    def factors(self) -> dict[str, tuple[str, str]]:
        """Those of FACTORS that its C needs: their values and meanings."""
        c = " ".join(
            text for member in self.chain for text in (self.of_sample(member) | self.of_fix(member)).values()
        )
        return {name: factor for name, factor in FACTORS.items() if f"{name} *" in c}

    def has_fix(self, member: str) -> bool:
        """Does a block ask whether there is a fix?"""
        return FIXED in self._inputs(member)

    def _inputs(self, member: str) -> list[str]:
        return self.chain[member].flat_names("input")

    def _shared(self, name: str, member: str) -> str:
        """The AHRS's input of the same name: copying it saves a conversion."""
        shared = self.ahrs is not None and member != "ahrs" and name in self.ahrs.flat_names("input")
        return f"m->ahrs.in.{name}" if shared else ""

    def __post_init__(self) -> None:
        for member, block in self.chain.items():
            known = {*SAMPLE, *FIX, FIXED, *self.of_ahrs(member)}
            for name, variable in flatten(block.group("input")):
                if name not in known and not variable.has_start:
                    raise DeclarationError(
                        f'{block.title()}: no instrument on board gives its input "{name}"; '
                        f"expected one of {', '.join(sorted(known))}"
                    )


DEFAULT = Navigation()
