"""Packages of others, from the command to the log: each number here is derived by hand."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest

from fmus.folder import build_folder
from harness.log.log import read_log
from harness.trial.request import Request, build_missing
from harness.trial.scenario import load
from tests.harness.command import canine
from tests.harness.cosim.ssp.packages import (
    Files,
    bind,
    binding,
    component,
    connection,
    entry,
    enumerations,
    linear,
    mapping,
    package,
    parameters,
    ssd,
    system,
    table,
    units,
)  # fmt: skip
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

EXPERIMENT = '<ssd:DefaultExperiment startTime="10" stopTime="12"/>'


@pytest.fixture(scope="module")
def nested(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ramp in one system whose length, in km, goes to a scale in another; beside it a count, and a clock.

    ramp: y grows by `rate` a tick. scale: y = gain * u, side is what it is given.
    """
    folder = tmp_path_factory.mktemp("nested")
    ramp = tiny_fmu(
        folder / "ramp.fmu", [V("rate", "parameter"), V("y", unit="km"), V("n", type="Integer"), V("now")],
        "v[1] += v[0]; v[2] = (int)(v[2] + 1) % 3; v[3] = t + h;", depends=False,
    )  # fmt: skip
    scale = tiny_fmu(
        folder / "scale.fmu",
        [V("u", "input", unit="m"), V("gain", "parameter"), V("side", "input", "Integer"), V("y"), V("n", type="Integer")],  # noqa: E501
        "v[3] = v[1] * v[0]; v[4] = v[2];", version=3,
    )  # fmt: skip
    left = system(
        "left", component("ramp", "rate parameter", "y output Real km", "n output Integer"),
        ports="length output Real km, n output Integer",
        links=connection("ramp.y", "length", linear(2)) + connection("ramp.n", "n"),
    )  # fmt: skip
    deep = system(
        "deep", component("scale", "u input Real m", "gain parameter", "side input Integer"),
        ports="length input Real m, gain parameter, n input Integer",
        links=connection("length", "scale.u") + connection("gain", "scale.gain")
        + connection("n", "scale.side", table("Integer", _1=7)),
    )  # fmt: skip
    right = system(
        "right", deep, ports="length input, n input Integer",
        links=connection("length", "deep.length", linear(1, 5))
        + connection("n", "deep.n", table("Integer", _2=1)),
    )  # fmt: skip
    bound = bind(
        binding(
            source="resources/sets/all.ssv", mapped='<ssd:ParameterMapping source="resources/sets/all.ssm"/>'
        )
    )
    links = connection("left.length", "right.length") + connection("left.n", "right.n")
    root = system("root", left, right, bindings=bound, links=links)
    files: Files = {
        "resources/ramp.fmu": ramp,
        "resources/scale.fmu": scale,
        "resources/sets/all.ssv": parameters(speed="Real 0.25", amount="Real 1.5", unused="Integer 1"),
        "resources/sets/all.ssm": mapping(
            entry("speed", "left.ramp.rate", linear(2)), entry("amount", "right.deep.gain")
        ),
    }
    return package(folder / "toy.ssp", ssd(root, units("m", "km"), EXPERIMENT), files)


def scenario(path: Path, system: Path, more: str = "") -> Path:
    path.write_text(f'system = "{system}"\nduration = 0.4\n{more}')
    return path


def test_a_nested_package_runs_as_its_package_states(
    nested: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # when
    toml = scenario(tmp_path / "mine.toml", nested)
    status, _, err = canine(capsys, "run", toml, "--out", tmp_path / "out", "--json")
    # then
    assert status == 0
    log = read_log(tmp_path / "out" / "trial.mcap")
    ticks = range(11)
    assert list(log.values) == ["left.ramp", "right.deep.scale"]
    assert log.time.tolist() == [k * 0.04 for k in ticks]
    # the rate is 2 * 0.25; y the plant's state at t_k
    assert log["left.ramp.y"].tolist() == [0.5 * k for k in ticks]
    assert log["left.ramp.now"].tolist() == [0.0, *(10 + k * 0.04 + 0.04 for k in ticks[:-1])]
    # 2 y in km; at the boundary of "deep" 2000 y in m, and then 5 more of those
    assert log["right.deep.scale.u"].tolist() == [1000 * k + 5 for k in ticks]
    assert log["right.deep.scale.y"].tolist() == [1.5 * (1000 * k + 5) for k in ticks]
    # the count 0 1 2: 2 becomes 1 on the first connection, and 1 becomes 7 on the next
    assert log["right.deep.scale.n"].tolist() == [(0, 7, 7)[k % 3] for k in ticks]
    # and what the user should know is noted
    notes = json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]
    for text in (
        "its FMUs begin at 10 s, the trial's time and its log at 0 s",
        "its experiment takes 2 s, the trial 0.4 s",
        'connection right.length -> right.deep.length: "km" is converted to "m", times 1000, '
        "in addition to its LinearTransformation",
        "no picture: the log lacks plant.north and plant.east",
    ):
        assert sum(text in note for note in notes) == 1
        assert text in " ".join(err.split())


def test_names_in_nested_systems_are_set_like_any_other(
    nested: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    toml = scenario(tmp_path / "mine.toml", nested, '[parameters]\n"right.deep.scale.gain" = 2\n')
    out = tmp_path / "out"
    arguments = ("--set", "left.ramp.rate=1", "--out", out)
    assert canine(capsys, "run", toml, *arguments)[0] == 0
    log = read_log(out / "trial.mcap")
    assert log["left.ramp.y"].tolist() == [float(k) for k in range(11)]
    assert log["right.deep.scale.y"].tolist() == [2 * (2000 * k + 5) for k in range(11)]
    status, _, err = canine(capsys, "run", toml, "--set", "right.deep.scale.gian=1", "--out", out)
    assert status == 2
    assert 'right.deep.scale scale.fmu has no parameter "gian"; did you mean "gain"?' in " ".join(err.split())


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
def test_both_loops_and_a_log_run_again_give_the_same_bits(
    nested: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], order: str
) -> None:
    toml = scenario(tmp_path / "mine.toml", nested)
    logs = []
    for name, target, loop in [
        ("native", toml, "native"),
        ("python", toml, "python"),
        ("again", tmp_path / "native" / "trial.mcap", "native"),
    ]:
        arguments = ("--loop", loop, "--order", order, "--out", tmp_path / name)
        assert canine(capsys, "run", target, *arguments)[0] == 0
        logs.append((tmp_path / name / "trial.mcap").read_bytes())
    assert logs[0] == logs[1] == logs[2]


@pytest.mark.parametrize("version", [2, 3])
def test_our_own_fmus_give_the_same_bits_from_another_start_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], version: int
) -> None:
    # given our own package, and its twin whose experiment starts at 10.3 s
    build_missing(Request(load("two_waypoint")))
    own = build_folder() / f"full.fmi{version}.ssp"
    with zipfile.ZipFile(own) as archive:
        archive.extractall(tmp_path / "twin")
    structure = tmp_path / "twin" / "SystemStructure.ssd"
    shifted = structure.read_text().replace('startTime="0.0"', 'startTime="10.3"')
    assert shifted != structure.read_text()
    structure.write_text(shifted)
    # when
    for name, target in (("own", own), ("twin", structure)):
        toml = scenario(tmp_path / f"{name}.toml", target, "waypoints = [[20.0, 0.0]]\n")
        assert canine(capsys, "run", toml, "--out", tmp_path / name)[0] == 0
    # then
    logs = [read_log(tmp_path / name / "trial.mcap") for name in ("own", "twin")]
    assert logs[0].time.tolist() == logs[1].time.tolist() == [k * 0.04 for k in range(11)]
    assert {n: v.tobytes() for n, v in logs[0].values.items()} == {
        n: v.tobytes() for n, v in logs[1].values.items()
    }


def test_a_variant_runs_and_its_log_runs_it_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given a package whose default gives k = 1 and whose variant k = 2, by an enumeration's item
    fmu = tiny_fmu(
        tmp_path / "a.fmu", [V("k", "parameter", "Integer"), V("y")], "v[1] = v[0];", depends=False
    )

    def structure(item: str) -> str:
        stated = parameters(enumerations("ssv", E={"ONE": 1, "TWO": 2}), k=f"Enumeration {item} E")
        return ssd(system("r", component("a", bindings=bind(binding(stated)))))

    files: Files = {"Other.ssd": structure("TWO"), "resources/a.fmu": fmu}
    path = package(tmp_path / "toy.ssp", structure("ONE"), files)
    for target, expected in [
        (path, 1.0),
        (path / "Other.ssd", 2.0),
        (tmp_path / "Other" / "trial.mcap", 2.0),
    ]:
        out = tmp_path / ("again" if target.suffix == ".mcap" else target.stem)
        if target.suffix != ".mcap":
            target = scenario(tmp_path / f"{target.stem}.toml", target)  # noqa: PLW2901
        assert canine(capsys, "run", target, "--out", out)[0] == 0
        assert read_log(out / "trial.mcap")["a.y"][-1] == expected


def test_a_package_alone_is_run_from_the_command_line(
    nested: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = canine(capsys, "wiring", nested)
    assert status == 0
    assert [line.split() for line in out.splitlines()[2:]] == [
        ["left.ramp.y", "->", "right.deep.scale.u", "*", "2000", "+", "5", "1", "tick"],
        ["left.ramp.n", "->", "right.deep.scale.side", "2", "as", "7,", "1", "as", "7", "1", "tick"],
    ]
    status, _, err = canine(capsys, "run", nested.parent / "no.ssp" / "Other.ssd")
    assert status == 2
    assert "there is no package" in err
