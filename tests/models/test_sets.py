"""Named sets of parameters: known ones within their ranges, and what each set is for."""

from __future__ import annotations

import pytest

from models.canine import Canine
from models.errors import UsageError
from models.kit.declaration import Parameter, flatten
from models.kit.model import Model
from models.profile import Profile
from models.recorded import Recorded
from models.sensors import Sensors
from models.sets import DOGS, LEADERS, SETS, find_set, sets_of


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


def test_the_dog_of_table_5_1_has_every_deviation_of_the_table() -> None:
    # given the deviations that the table prints, and the search of 5.3.7.1
    dog = {v.name: v.start[0] for v in Canine.group("parameter")} | DOGS["table_5_1"]["plant"]
    deg = 3.141592653589793 / 180
    # then
    names = ("cruise_speed", "speeding_up", "slowing_down", "right_turn_rate", "left_turn_rate", "drift")
    printed = (1.49, 0.67, 1.31, 37.66 * deg, 41.13 * deg, 1.62 * deg)
    assert tuple(dog[f"{name}_deviation"] for name in names) == pytest.approx(printed)
    assert (dog["bumper_search_min"], dog["bumper_search_max"]) == (1, 5)
    Model(Canine, DOGS["table_5_1"]["plant"])


def test_a_component_has_the_sets_that_state_something_of_it() -> None:
    assert sets_of("plant").keys() == {*SETS, *DOGS}
    assert "measured" not in sets_of("sensors")  # it leaves the sensors as they are
    assert sets_of("command_module") == {}


def test_a_controller_that_aims_off_knows_the_drift_of_table_5_1_and_hardly_any_response_time() -> None:
    dog = {variable.name: variable.start[0] for variable in Canine.group("parameter")}
    drift, deviation = dog["drift"], dog["drift_deviation"]
    assert LEADERS["aim_off"]["controller"] == {"drift": drift, "drift_sd": deviation}
    assert LEADERS["aim_off_mean"]["controller"] == {"drift": drift}
    response = {"response_time": 0.1, "response_sd": 0.2}
    assert LEADERS["aim_off_lead"]["controller"] == LEADERS["aim_off"]["controller"] | response


@pytest.mark.parametrize(
    ("component", "name", "known", "error"),
    [
        ("plant", "table_51", {"drift"}, 'no set "table_51" of parameters of the plant; did you mean "table'),
        ("command_module", "ideal", set(), "of the command_module; there is none"),
        ("plant", "ideal", {"drift"}, 'the set "ideal" has shaking, which it has not'),
    ],
)  # fmt: skip
def test_a_set_that_does_not_fit_is_refused(component: str, name: str, known: set[str], error: str) -> None:
    with pytest.raises(UsageError, match=error):
        find_set(component, name, known)
