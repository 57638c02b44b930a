"""Named sets of sensors and pack: known parameters within their ranges, and what each set is for."""

from __future__ import annotations

import pytest

from models.canine import Canine
from models.kit.declaration import Parameter, flatten
from models.kit.model import Model
from models.profile import Profile
from models.recorded import Recorded
from models.sensors import Sensors
from models.sets import SETS


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("plant", [Canine, Profile, Recorded])
def test_a_set_fits_every_plant_with_a_pack_and_the_sensors(name: str, plant: type[Canine]) -> None:
    assert SETS[name].keys() == {"plant", "sensors"}
    Model(plant, SETS[name]["plant"])  # refuses unknown names and values out of range
    Model(Sensors, SETS[name]["sensors"])


def test_the_ideal_set_has_the_noise_of_appendix_d_and_no_other() -> None:
    """D.12 to D.14, with the declared values where the set names none."""
    declared = dict(flatten(list(Sensors.variables(Parameter).values())))
    values = {name: variable.start[0] for name, variable in declared.items()} | SETS["ideal"]["sensors"]
    deg = 3.141592653589793 / 180
    assert (values["gps_position_noise"], values["gps_speed_noise"]) == (0.1, 0.05)  # D.12
    assert (values["gyro_noise"], values["gyro_bias[1]"]) == pytest.approx((0.1 * deg, 0.1 * deg))  # D.13
    assert (values["accel_noise"], values["accel_bias[1]"]) == (1.0, 0.1)  # D.14
    silent = ("gps_wander", "attitude_noise", "heading_noise", "mag_noise", "multipath_rate", "attitude_lean")
    assert [values[name] for name in silent] == [0] * 6
    assert SETS["ideal"]["plant"] == {"shaking": 0}
