"""Onboard: the firmware in the loop, in the place of estimator, controller and command module.

In: the sensors' signals, the operator's wishes. Out: the animal's command, the program's memory, telemetry.

`stand_in` takes the components' places in the loop. `instruments` turns signals into the units' bytes and
`radio` messages into frames, which `garbage` spoils on their way; `operator` is the operator's laptop.
`processors/` runs the program, natively or simulated. `memory` names the words of its memory, `tones` the
command that is played.
"""

ROLES = ("estimator", "controller", "command_module")  # the components whose place it takes
IN_FIRMWARE = ("ahrs", *ROLES)  # those whose blocks are in its firmware
