"""The commands of `canine` about the program on board; `command_line` adds them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from codegen.firmware.targets import SIMULATED, TARGETS, find_target
from harness.console import (
    build_status,
    end_interrupted,
    json_of,
    out,
    print_note,
    progress_bar,
    say_where,
    short,
)
from harness.cosim.stepping import DURATION
from harness.options import Seed, Settings
from harness.pil import SCENARIO
from models.errors import CanineError, UsageError

Constants = Annotated[
    bool, typer.Option("--constants", help="parameters are constants, not fields that can be set")
]

OnboardEstimator = Annotated[
    str | None, typer.Option("--estimator", metavar="NAME", help="of ours; by default the scenario's")
]
OnboardAhrs = Annotated[
    bool,
    typer.Option(
        "--ahrs",
        help="attitude by canine_ahrs, not by the inertial unit itself; its gyroscopes must not saturate",
    ),
]


def write_firmware(
    target: Annotated[str, typer.Option(help=f"one of {', '.join(TARGETS)}")],
    folder: Annotated[Path, typer.Option("--out", file_okay=False, metavar="DIR", help="where it is put")],
    *,
    key: Annotated[
        Path | None, typer.Option("--key", metavar="FILE", help="the vest's radio key, by `canine keygen`")
    ] = None,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="without a key: whoever has such a radio can command the vest")
    ] = False,
    parameters: Annotated[
        str, typer.Option(metavar="SCENARIO.toml", help="whose parameters it gets; start values by default")
    ] = "",
    settings: Settings = None,
    constants: Constants = False,
    estimator: OnboardEstimator = None,
    ahrs: OnboardAhrs = False,
) -> None:
    """Write the sources of the onboard program for a processor: estimator, controller, drivers, main loop.

    \b
    canine firmware --target stm32f405 --key vest.key --out firmware
    canine firmware --target rabbit4000 --key vest.key --parameters my.toml --constants --out firmware
                                                  my.toml without a reading, or with "guarded": with limits
    canine firmware --target host --insecure --set cmec.moving_deviation=37 --out firmware
    canine firmware --target cortex-m4f --key vest.key --estimator canine_tracker --ahrs --out firmware

    Waypoints come by radio, not with the parameters. The key is written into key.c, which only its owner may
    read.
    """
    from codegen.firmware import bundle
    from codegen.firmware.key import read
    from harness.trial.firmware import firmware_of

    if (key is None) != insecure:
        raise UsageError(
            f"{'both --key and' if insecure else 'neither --key nor'} --insecure given, expected one: "
            "--key FILE with the vest's radio key (`canine keygen` makes one), or --insecure for a program "
            "that obeys whoever has such a radio"
        )
    processor = find_target(target)
    secret = read(key, print_note) if key else None
    navigation, values = firmware_of(parameters, settings or [], estimator, ahrs=ahrs, note=print_note)
    paths = bundle.write(processor, folder, values, navigation, constants=constants, key=secret)
    typer.echo(f"{len(paths)} files for {processor.processor} in {short(folder)}: see README.md there")
    if secret is None:
        print_note("INSECURE: whoever has such a radio can command this vest; its telemetry says so")
    if not values.get("controller", {}).get("guarded"):
        print_note(
            "WITHOUT LIMITS: cmec.guarded is off, so most rules of models/SAFETY.md do not hold. Not for an "
            'animal: leave out the scenario\'s reading, or write reading = "guarded"'
        )


def keygen(
    file: Annotated[Path, typer.Option("--out", dir_okay=False, metavar="FILE", help="a new file")] = Path(
        "vest.key"
    ),
) -> None:
    """Make a vest's radio key: 128 random bits, in a file that only its owner may read.

    \b
    canine keygen --out rex.key
    canine firmware --target stm32f405 --key rex.key --out firmware

    Whoever has the file can command the vest: keep it off shared disks, out of repositories and mail. A vest
    and its laptop have one key, another vest another. An existing file is not overwritten.
    """
    from codegen.firmware.key import write_new

    write_new(file)
    typer.echo(f"{short(file)}: a new radio key. Whoever can read it can command the vest")


def processor_in_the_loop(
    scenario: Annotated[str, typer.Argument(metavar="[SCENARIO.toml]")] = SCENARIO,
    *,
    target: Annotated[str, typer.Option(help=f"one of {', '.join(SIMULATED)}")],
    seed: Seed = None,
    settings: Settings = None,
    constants: Constants = False,
    estimator: OnboardEstimator = None,
    ahrs: OnboardAhrs = False,
    folder: Annotated[
        Path | None, typer.Option("--out", file_okay=False, help="by default out/pil-<target>")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the report as JSON")] = False,
) -> None:
    """Run the firmware on a simulated processor and compare every tick with this machine's, bit by bit.

    \b
    canine pil --target cortex-m4f
    canine pil three_waypoint --target rabbit4000 --seed 7
    canine pil --target cortex-m4f --estimator canine_tracker --ahrs

    It leaves pil.json with what a tick costs, and the trial's files as `canine run` does.
    """
    from harness.pil import compare
    from harness.trial import trial
    from harness.trial.request import Changes

    changes = Changes(settings=settings or [], seed=seed, estimator=estimator, ahrs=ahrs)
    place = folder or compare.default_folder(target, changes)
    with (
        build_status("building the FMUs") as done,
        progress_bar("trial [s]", DURATION, quiet=as_json) as progress,
    ):
        try:
            result = compare.run(
                target, scenario, changes, place, constants=constants, built=done, progress=progress
            )
        except KeyboardInterrupt as interrupt:
            end_interrupted(interrupt, trial.what_is_left(place))
    for note in result["trial"]["notes"]:
        print_note(note)
    if as_json:
        typer.echo(json_of(result))
    else:
        compare.show(result, out())
        say_where(place)


def prove_rules(
    chosen: Annotated[list[str] | None, typer.Argument(metavar="[RULE|PROOF]...")] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="print the verdicts as JSON")] = False,
) -> None:
    """Prove what the C that ships does, whatever its inputs are: the safety rules, and what they rest on.

    \b
    canine prove 3                                rule 3 of models/SAFETY.md
    canine prove watchdog cmec.aim                a unit of the C, or one proof
    canine prove                                  all of them: minutes

    The model checker CBMC does it; where it is missing it is fetched from Debian (30 MB). For any parameters,
    and for what can be reached, the solver z3 does it on the controller's model: guided-canine[z3] has it.
    """
    from tempfile import TemporaryDirectory

    from codegen.firmware import proving

    proofs = proving.find(chosen or [])
    verdicts = []
    with TemporaryDirectory() as folder:
        proving.write_sources(Path(folder))
        for proof in proofs:
            verdict = proving.prove(proof, Path(folder))
            verdicts.append(verdict)
            if not as_json:
                typer.echo(verdict.text())
    if as_json:
        typer.echo(json_of([verdict.facts() for verdict in verdicts]))
    if failed := [v.proof.name for v in verdicts if v.failed]:
        raise CanineError(f"{len(failed)} of {len(verdicts)} proofs fail: {', '.join(failed)}")
