"""The words of this project, each with the place in the code that holds it; a test keeps the places true."""

from __future__ import annotations

from typing import NamedTuple


class Term(NamedTuple):
    """A word, what it means, and where it is: (name in the code, file)."""

    word: str
    meaning: str
    places: tuple[tuple[str, str], ...]


TERMS: dict[str, tuple[Term, ...]] = {
    "Systems": (
        Term(
            "block",
            "a class that declares a model: its variables, and the updates of its tick as methods",
            (("Block", "models/kit/block.py"),),
        ),
        Term(
            "tick",
            "the time in which every component is stepped once",
            (("TICK", "models/kit/timing.py"), ("Program", "models/kit/tracing.py")),
        ),
        Term(
            "role",
            "what a place needs: plant (the animal), sensors, estimator, controller, command module",
            (("Role", "harness/cosim/roles.py"),),
        ),
        Term(
            "component",
            "a place in a system, named after its role and taken by a block, or by an FMU",
            (("components", "models/system.py"), ("FmuComponent", "harness/cosim/ssp/system.py")),
        ),
        Term(
            "link",
            "from an output of a component to an input of another; one between FMUs may convert units",
            (("Link", "models/kit/link.py"), ("ScaledLink", "harness/cosim/ssp/system.py")),
        ),
        Term(
            "system",
            "components and the links between them, as blocks, or as FMUs in an .ssp package",
            (("System", "models/system.py"), ("FmuSystem", "harness/cosim/ssp/system.py")),
        ),
        Term(
            "FMU",
            "a model in a file that any simulation tool can run; ours are built from blocks",
            (("build_fmu", "fmus/build.py"), ("FmuDescription", "harness/cosim/fmu.py")),
        ),
        Term(
            "instance",
            "a component at work, with values: of a block in Python, or of an FMU",
            (("Model", "models/kit/model.py"), ("FmuInstance", "harness/cosim/fmu.py")),
        ),
    ),
    "Trials": (
        Term(
            "scenario",
            "what happens in a trial, as a user writes it: waypoints, parameters, failures by time",
            (("Scenario", "harness/trial/scenario.py"),),
        ),
        Term("plan", "the same resolved to SI units for one system", (("Plan", "harness/trial/plan.py"),)),
        Term("trial", "one run of a plan from the start to its end", (("run", "harness/trial/trial.py"),)),
        Term(
            "reading",
            "the parameters that stand for one way to read the dissertation",
            (("READINGS", "models/readings.py"),),
        ),
    ),
    "Motion": (
        Term(
            "heading",
            "where the body looks; clockwise from north, as all directions",
            (("body_heading", "models/plant.py"), ("held_heading", "models/given_heading.py")),
        ),
        Term(
            "course", "where it moves", (("gps_course", "models/sensors.py"), ("course", "models/plant.py"))
        ),
        Term("slip", "course less heading", (("side_slip", "models/plant.py"),)),
        Term(
            "wheel slip",
            "of a robot's wheel: 1 less its ground speed over its rim speed",
            (("wheel_slip", "models/differential_drive.py"),),
        ),
        Term("bearing", "where another place lies", (("bearing", "models/plant.py"),)),
        Term(
            "deviation",
            "h, the bearing of the target less the heading: how far to turn, to the right if positive",
            (("deviation", "models/cmec.py"),),
        ),
        Term(
            "`_deviation`",
            "in a name: the standard deviation of what is drawn for the dog; `_sd` in an estimate",
            (("drift_deviation", "models/canine.py"), ("north_sd", "models/estimator.py")),
        ),
        Term(
            "waypoint",
            "a place to lead the animal to; names of trials count the start too, as the dissertation does",
            (("waypoint_north", "models/cmec.py"), ("MAX_WAYPOINTS", "models/cmec.py")),
        ),
        Term("home", "where the animal is recalled to: the start", (("home_north", "models/cmec.py"),)),
        Term("target", "the waypoint aimed at, or home", (("target_north", "models/cmec.py"),)),
        Term(
            "fix",
            "one position and speed from the GPS receiver, four a second",
            (("fix", "models/sensors.py"), ("judge", "models/estimator.py")),
        ),
        Term(
            "outage",
            "a time without fixes",
            (("outage_start", "models/sensors.py"), ("Outage", "harness/replay/outage.py")),
        ),
    ),
    "Estimation": (
        Term(
            "estimator",
            "an extended Kalman filter that tells position, speed and heading between fixes",
            (("Estimator", "models/estimator.py"), ("ESTIMATORS", "models/system.py")),
        ),
        Term(
            "innovation",
            "a measurement less what the filter expects; its square over its variance is near 1",
            (("Correction", "models/kit/ekf.py"), ("innovation", "models/four_state.py")),
        ),
        Term(
            "gate",
            "how far off a fix may be and still be believed",
            (("gate", "models/estimator.py"), ("judge", "models/estimator.py")),
        ),
        Term(
            "sigma",
            "the deviation of the acceleration that the filter allows for, in its process noise Q",
            (("sigma", "models/estimator.py"), ("sigma_constant", "models/estimator.py")),
        ),
        Term(
            "pseudo-measurement",
            "something known that nobody measured, such as speed 0 of an animal at rest",
            (("Measurement", "models/kit/ekf.py"), ("rest", "models/canine_tracker.py")),
        ),
        Term(
            "slip",
            "course less heading: an offset, and a lead in time by which the course is ahead in a turn",
            (("slip", "models/canine_tracker.py"),),
        ),
        Term(
            "rehearsal",
            "an outage of the speed that the tracker imagines while it has fixes, to learn from its end",
            (("imagine", "models/canine_tracker.py"), ("compare", "models/canine_tracker.py")),
        ),
    ),
    "Control": (
        Term("mode", "what the controller is doing", (("Mode", "models/modes.py"),)),
        Term("command", "what the animal is told", (("Command", "models/commands.py"),)),
        Term("status", "how the trial stands; some end it", (("Status", "models/commands.py"),)),
        Term(
            "anomaly",
            "a way in which the animal disobeys, or a reason why the controller does not lead",
            (("Anomaly", "models/modes.py"),),
        ),
        Term(
            "telemetry",
            "what the vest tells the operator by radio",
            (("Telemetry", "codegen/firmware/telemetry.py"),),
        ),
    ),
}

TRAILS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "A stop at a waypoint is decided": (
        ("decide", "models/cmec.py", "goes to STOP_AT_WAYPOINT when the target is near enough"),
        ("answer", "models/cmec.py", "gives the command STOP in that mode"),
        ("advance", "models/cmec.py", "aims at the next waypoint once the animal has stopped"),
    ),
    "A fix enters the filter": (
        ("judge", "models/estimator.py", "accepts or rejects it"),
        ("correct", "models/estimator.py", "updates state and covariance by an accepted one"),
        ("recover", "models/estimator.py", "begins anew at the first, or after many rejected ones"),
    ),
    "A row reaches the log": (
        ("NativeWalk", "harness/cosim/walk.py", "has a loop in C make the calls of each tick"),
        ("Simulation", "harness/cosim/loop.py", "hands the rows over by the batch"),
        ("LogRows", "harness/trial/contents.py", "arranges them by component"),
        ("LogWriter", "harness/log/writer.py", "writes them to the file"),
    ),
}


def page() -> str:
    """The glossary in Markdown."""
    lines = ["## Words", ""]
    for title, terms in TERMS.items():
        lines += [f"| {title.lower()} | what it is | where it is |", "|---|---|---|"]
        for term in terms:
            places = ", ".join(_place(name, path) for name, path in term.places)
            lines.append(f"| **{term.word}** | {term.meaning} | {places} |")
        lines.append("")
    for title, steps in TRAILS.items():
        lines.append(
            f"**{title}**: " + "; ".join(f"{_place(n, path)} {does}" for n, path, does in steps) + "."
        )
        lines.append("")
    return "\n".join(lines)


def _place(name: str, path: str) -> str:
    return f"`{name}` in [{path}](../{path})"
