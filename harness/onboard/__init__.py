"""The firmware in the loop: the onboard computer with its instruments and its radio."""

ROLES = ("estimator", "controller", "command_module")  # the components whose place it takes
