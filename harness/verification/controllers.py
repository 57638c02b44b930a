"""The page on controllers and dogs: each controller with each dog, over three waypoints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from harness.files import write_whole
from harness.sweep.sweep import plan_sweep
from harness.sweep.trials import TRIAL_TYPES
from harness.terminal import percent
from harness.trial.scenario import Disturbance, Scenario, load
from harness.verification.page import FULL, RESULTS, TEMPLATES
from harness.verification.runs import AIMS, DRAWN, LATE, Size, run
from harness.verification.streets import CROSSING
from harness.verification.tables import markdown

PAGE = "controllers.md"
HEADING = "plant.heading -> controller.heading"
BIAS, NOISE = 5.0, 3.0  # deg
HALF_WIDTH = 2.5  # m, of streets
TIRED = ("canine_all_day.start_fatigue=0.7", "canine_all_day.habituation_gain=0")


@dataclass(frozen=True)
class Leading:
    """A controller as it leads.

    Attributes:
        vary: the parameter of a sweep with a single point.
        name: of the controller.
    """

    reading: str
    settings: tuple[str, ...] = ()
    vary: str = "cmec.moving_deviation=49:49"
    name: str = "cmec"


@dataclass(frozen=True)
class Led:
    """A dog, and what is around it and its controller.

    Attributes:
        around: changes the scenario.
    """

    settings: tuple[str, ...] = ()
    plant: str | None = None
    around: Callable[[Scenario], Scenario] = lambda scenario: scenario


def in_streets(scenario: Scenario) -> Scenario:
    """Streets along the first leg, and across it in the direction of the turn."""
    return replace(scenario, streets=CROSSING.streets(scenario, HALF_WIDTH))


def with_bias(scenario: Scenario) -> Scenario:
    """A heading that reads too far to the right, and noisy."""
    bias = Disturbance(HEADING, "offset", 0.0, value=BIAS)
    return replace(scenario, faults=(bias, Disturbance(HEADING, "noise", 0.0, value=NOISE)))


CONTROLLERS = {
    "predecessor": Leading("field", vary="quarter_turn.max_turns=2:2", name="quarter_turn"),
    "CMEC, calibrated": Leading("calibrated"),
    "CMEC, field": Leading("field"),
    **{f"field, {name}": Leading("field", aim) for name, aim in AIMS.items() if aim},
    "field, learnt drift and lead": Leading("field", ("cmec=aim_off_lead",)),
}
DOGS = {
    "Table 5.1, means": Led(),
    "speeds drawn, `table_5_1`": Led(DRAWN),
    "0.3 s late": Led(LATE),
    "tired": Led(TIRED, plant="canine_all_day"),
    "in streets": Led(around=in_streets),
    "heading 5 deg off": Led(around=with_bias),
}


def rate(leading: Leading, led: Led, trials: int) -> float:
    """The share of trials that succeed, of the four types alike."""
    rates = []
    for name in TRIAL_TYPES["three"]:
        sweep = plan_sweep(
            led.around(replace(load(name), system="cts")),
            vary=(leading.vary,),
            trials=trials,
            reading=leading.reading,
            settings=(*leading.settings, *led.settings),
            plant=led.plant,
            controller=leading.name,
        )
        rates.append(run(sweep).table[0].success_rate)
    return sum(rates) / len(rates)


def write(folder: Path = RESULTS, size: Size = FULL) -> None:
    """Write the page.

    Raises:
        FileError: it cannot be written.
    """
    rows = [
        [name, *(percent(rate(leading, led, size.street)) for leading in CONTROLLERS.values())]
        for name, led in DOGS.items()
    ]
    text = TEMPLATES.get_template(f"{PAGE}.jinja").render(
        size=size, table=markdown(["dog", *CONTROLLERS], rows), bias=BIAS, noise=NOISE, half_width=HALF_WIDTH
    )
    write_whole(folder / PAGE, text.encode())
