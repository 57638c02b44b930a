"""Whole trials with a plant of 1 ms and a controller of 0.2 s made elsewhere, through mapping files."""

import json
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pytest

from harness.cosim.loop import Array, Simulation
from harness.cosim.stepping import Loop, Order
from harness.log.log import read_log
from harness.trial.prepare import Prepared, prepared
from harness.trial.request import Changes, build_missing, requested
from harness.trial.scenario import Scenario
from tests.harness.command import canine
from tests.harness.cosim.tiny_fmu import V, strict, tiny_fmu

LOOPS: tuple[Loop, ...] = get_args(Loop)
SCENARIO = Scenario("straight", system="cts", waypoints=((25.0, 0.0),), duration=4.0)
# a dog that runs north at 18 km/h on FORWARD, and stands otherwise; v[2] counts its steps
DOG = [V("cmd", "input", "Integer"), V("x", unit="m"), V("steps", "local"), V("y", unit="m")]
DOG += [V("psi", unit="rad"), V("v", unit="km/h")]
RUNS = "v[5] = v[0] == 1 ? 18 : 0; v[1] += v[5] / 3.6 * h;"
DOG_TOML = """[inputs]
command = "cmd"
[outputs]
north = "x"
east = "y"
heading = "psi"
speed = { name = "v", factor = 0.2777777777777778 }
"""
# a leader that says FORWARD up to 93 dm, and then STOP
LEADER = [V("place", "input"), V("order", type="Integer"), V("steps", "local")]
LEADS = "v[1] = v[0] < 93 ? 1 : 2;"
LEADER_TOML = """[inputs]
north = { name = "place", factor = 10.0 }
[outputs]
command = "order"
"""


def dog(folder: Path, *, version: int, step: float, fixed: bool = True) -> Path:
    """The dog, and its mapping file."""
    path = folder / "dog.fmu"
    path.with_suffix(".toml").write_text(DOG_TOML)
    made = step if fixed else 0.04
    return tiny_fmu(
        path, DOG, strict(made) + RUNS, version=version, depends=False, step_size=step, fixed=fixed
    )


def leader(folder: Path, *, version: int, step: float) -> Path:
    """The leader, and its mapping file."""
    path = folder / "leader.fmu"
    path.with_suffix(".toml").write_text(LEADER_TOML)
    return tiny_fmu(path, LEADER, strict(step) + LEADS, version=version, step_size=step, fixed=True)


def north_of(ready: Prepared, order: Order, loop: Loop) -> list[float]:
    """The dog's place on each tick of 4 s."""
    places: list[Array] = []
    with Simulation(ready.system, ready.plan.values, order, plants=ready.plants, loop=loop) as simulation:
        column = [quantity.name for quantity in simulation.columns("plant")].index("x")
        simulation.run(duration=4.0, record=lambda _, values: places.append(values["plant"][:, column]))
    return [float(place) for place in np.concatenate(places)]


# north_k = 0.2 k m up to the tick on which STOP is there: 9.4 m (k = 47) is the first place beyond 9.3 m, and
# 10 m (k = 50) the first that a leader of 0.2 s sees. In jacobi order its first FORWARD is there when its
# first step has ended, on tick 5, or 1. It sees 10 m on tick 55, or 9.4 m on 48; STOP is there on 60, or 49.
@pytest.mark.parametrize("version", ["2", "3"])
@pytest.mark.parametrize(
    ("order", "step", "moves"),
    [
        ("sequential", 0.2, range(0, 50)),
        ("sequential", 0.04, range(0, 47)),
        ("jacobi", 0.2, range(5, 60)),
        ("jacobi", 0.04, range(1, 49)),
    ],
)
def test_a_dog_of_1_ms_is_led_by_a_controller_of_200_ms(
    tmp_path: Path, version: Literal["2", "3"], order: Order, step: float, moves: range
) -> None:
    swaps = {
        "plant": dog(tmp_path, version=int(version), step=0.001),
        "controller": leader(tmp_path, version=5 - int(version), step=step),
    }
    with requested(SCENARIO, Changes(order, version, swaps=swaps)) as request:
        build_missing(request)
        with prepared(request) as ready:
            native, python = (north_of(ready, order, loop) for loop in LOOPS)
    # then the dog has moved by 0.2 m on each of the ticks on which it gets FORWARD
    assert native == pytest.approx([0.2 * len([m for m in moves if m < k]) for k in range(101)], abs=1e-9)
    assert native == python


def test_wiring_tells_rates_and_the_age_of_what_is_held(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text('system = "cts"\nwaypoints = [[25.0, 0.0]]\n')
    swaps = [
        *("--plant", dog(tmp_path, version=2, step=0.001)),
        *("--controller", leader(tmp_path, version=3, step=0.2)),
    ]
    _, text, _ = canine(capsys, "wiring", "my.toml", *swaps)
    lines = [line.rsplit("  ", 1) for line in text.splitlines()]
    assert lines[0] == [
        "sequential, every 0.04 s: controller (every 5 ticks), then command_module, "
        "then plant (40 steps a tick)"
    ]
    delays = {what.strip(): delay for what, delay in lines[2:]}
    assert delays["controller.command -> plant.command  (controller.order -> plant.cmd)"] == "0 to 4 ticks"
    assert delays["plant.north -> controller.north  * 10  (plant.x -> controller.place)"] == "1 tick"
    _, text, _ = canine(capsys, "wiring", "my.toml", *swaps, "--json")
    wiring = json.loads(text)
    assert wiring["rates"] == {
        "controller": {"every": 5, "substeps": 1},
        "command_module": {"every": 1, "substeps": 1},
        "plant": {"every": 1, "substeps": 40},
    }
    assert {
        "link": "controller.command -> plant.command", "variables": ["order", "cmd"],
        "factor": 1.0, "offset": 0.0, "table": [], "ticks": 0, "most_ticks": 4,
    } in wiring["links"]  # fmt: skip
    factors = {link["link"]: link["factor"] for link in wiring["links"]}
    assert factors["plant.north -> controller.north"] == 10.0


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ('signal = "plant.x"', 'has no output "x"; as its role calls it: "plant.north"'),
        (
            'signal = "controller.command -> plant.comand"',
            "its links are controller.command -> command_module.command, controller.command -> plant.command",
        ),
        ('signal = "plant"', 'has no output ""; name one, such as "plant.north", or state kind = "stall"'),
    ],
)
def test_a_fault_by_another_name_than_the_roles_is_refused_with_that(
    fault: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(
        f'system = "cts"\nwaypoints = [[25.0, 0.0]]\n[[fault]]\nat = 1\nkind = "off"\n{fault}\n'
    )
    status, _, error = canine(capsys, "wiring", "my.toml", "--plant", dog(tmp_path, version=2, step=0.04))
    assert status == 2
    assert text in " ".join(error.split())


@pytest.mark.parametrize(
    ("step", "fixed", "text"),
    [
        (0.001, True, "a fixed step of 0.001 s: 40 steps a tick of 0.04 s"),
        (0.2, True, "a fixed step of 0.2 s: every 5 ticks of 0.04 s"),
        (0.04, True, "a fixed step of 0.04 s: every tick of 0.04 s"),
        (0.001, False, "any step: every tick of 0.04 s"),
    ],
)
def test_check_tells_how_an_fmu_is_stepped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], step: float, fixed: bool, text: str
) -> None:
    path = dog(tmp_path, version=2, step=step, fixed=fixed)
    for role, fits in ((["--role", "plant"], "; fits the plant role"), ([], "")):
        assert canine(capsys, "check", path, *role)[:2] == (
            0,
            f"dog.fmu: FMI 2 co-simulation, 1 input, 4 outputs, 0 parameters; {text}; runs, resets{fits}\n",
        )


def test_a_step_that_fits_no_tick_fails_the_check_of_a_role_and_the_trial_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = dog(tmp_path, version=3, step=0.03)
    told = "dog.fmu has a fixed step of 0.03 s; expected a whole multiple or fraction of the tick of 0.04 s"
    for command in (("check", path, "--role", "plant"), ("run", "two_waypoint", "--plant", path)):
        status, _, error = canine(capsys, *command)
        assert status == 1
        assert f"plant {told} of our blocks: export it with 0.02 or 0.04 s" in error
    # and without a role it runs alone, with a note
    status, text, error = canine(capsys, "check", path)
    counts = "1 input, 4 outputs, 0 parameters"
    assert status == 0
    assert text == f"dog.fmu: FMI 3 co-simulation, {counts}; a fixed step of 0.03 s; runs, resets\n"
    assert told in error


def test_a_log_of_several_rates_runs_again_to_the_same_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = dog(tmp_path, version=3, step=0.008)
    Path("my.toml").write_text('system = "cts"\nwaypoints = [[25.0, 0.0]]\nduration = 3.0\n')
    assert canine(capsys, "run", "my.toml", "--plant", path, "--out", "a")[0] == 0
    assert canine(capsys, "run", "a/trial.mcap", "--out", "b")[0] == 0
    logs = [read_log(Path(name, "trial.mcap")) for name in "ab"]
    assert len(logs[0].time) == 76
    assert logs[0]["plant.north"][-1] > 1.0
    for component, values in logs[0].values.items():
        assert np.array_equal(values, logs[1].values[component])
