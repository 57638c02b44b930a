"""Which of a log's signals are those that arrived of the sensors."""

from harness.log.arrived import arrived, disturbed, receiver
from harness.log.channel import Channel
from harness.trial.scenario import Disturbance, Scenario

GPS = {"gps_fix": "", "gps_north": "m", "gps_east": "m"}
SENSORS = {**GPS, "accel_z": "m/s2", "pitch_meas": "rad"}


def channel(component: str, signals: dict[str, str]) -> Channel:
    nothing = ("",) * len(signals)
    return Channel(component, component, tuple(signals), tuple(signals.values()), nothing, nothing)


def log_of(*signals: str) -> dict[str, dict[str, str]]:
    """The records of a trial with a fault of each of these signals."""
    faults = tuple(Disturbance(signal, "off", 1.0) for signal in signals)
    return {"scenario": {"toml": Scenario("my", faults=faults).text()}}


CHANNELS = [channel("sensors", SENSORS), channel("estimator", {**GPS, "pitch_meas": "rad", "north": "m"})]


def test_without_a_fault_of_the_sensors_their_own_signals_arrived() -> None:
    for records in ({}, log_of(), log_of("controller.command"), {"scenario": {"toml": "fault = 3"}}):
        assert set(arrived(CHANNELS, records).values()) == {f"sensors.{name}" for name in SENSORS}
        assert receiver(CHANNELS, records) == "sensors"


def test_of_a_disturbed_signal_the_estimators_input_is_what_arrived() -> None:
    records = log_of("sensors.gps_north -> estimator.gps_north", "radio")
    assert disturbed(records) == {"sensors.gps_north", "radio"}
    signals = arrived(CHANNELS, records)
    assert signals["gps_north"] == "estimator.gps_north"
    assert receiver(CHANNELS, records) == "estimator"
    # and what it does not take is the sensors'
    assert signals["accel_z"] == "sensors.accel_z"


def test_an_input_of_another_unit_or_from_another_source_is_not_what_arrived() -> None:
    records = log_of("sensors.gps_north")
    feet = [CHANNELS[0], channel("estimator", {**GPS, "gps_north": "ft"})]
    assert arrived(feet, records)["gps_north"] == "sensors.gps_north"
    assert receiver(feet, records) == "sensors"
    ahrs = [*CHANNELS, channel("ahrs", {"pitch_meas": "rad"})]
    assert arrived(CHANNELS, records)["pitch_meas"] == "estimator.pitch_meas"
    assert arrived(ahrs, records)["pitch_meas"] == "sensors.pitch_meas"
