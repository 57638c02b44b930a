"""Model in the loop: blocks and whole systems as `control` systems, the reference that FMUs must equal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import control
import numpy as np

from models.kit.block import Block
from models.kit.model import Array, Model
from models.system import System


def control_system(
    block: type[Block], name: str, parameters: Mapping[str, float] | None = None
) -> control.NonlinearIOSystem:
    """The block as a discrete-time `control.NonlinearIOSystem` named `name`, for `control.interconnect`.

    Its state's start is `system.initial_state`. Inputs and outputs carry the flat names.
    """
    model = Model(block, parameters)
    model.initialize()
    initial = model.state.copy()

    def run(x: Array, u: Array) -> None:
        model.state[:] = x
        model.input[:] = u
        model.step()

    def update(t: float, x: Array, u: Array, params: Mapping[str, Any]) -> Array:
        run(x, u)
        return model.state.copy()

    if block.moore:

        def output(t: float, x: Array, u: Array, params: Mapping[str, Any]) -> Array:
            model.state[:] = x
            model.observe()
            return model.output.copy()
    else:

        def output(t: float, x: Array, u: Array, params: Mapping[str, Any]) -> Array:
            run(x, u)
            return model.output.copy()

    system = control.NonlinearIOSystem(
        update,
        output,
        inputs=block.flat_names("input"),
        outputs=block.flat_names("output"),
        states=block.flat_names("state"),
        dt=block.sample_time,
        name=name,
    )
    system.initial_state = initial
    return system


def interconnect(system: System, parameters: Mapping[str, Mapping[str, float]] | None = None) -> Any:
    """The whole system as one `control` system: the reference in Python.

    Args:
        parameters: values by component and flat name.

    Returns:
        A discrete-time `control.InterconnectedSystem`; its inputs are the unconnected inputs and its
        outputs all outputs, named `component_variable` (`control` allows no dots); `initial_state` is its
        state at t = 0 and `initial_input` the start values of its inputs.
    """
    systems = {
        c: control_system(block, c, (parameters or {}).get(c)) for c, block in system.components.items()
    }
    fed = {(link.target, link.target_variable) for link in system.links}
    free = [(c, n) for c, b in system.components.items() for n in b.flat_names("input") if (c, n) not in fed]
    outputs = [f"{c}.{n}" for c, b in system.components.items() for n in b.flat_names("output")]
    whole = control.interconnect(
        list(systems.values()),
        connections=[
            [f"{x.target}.{x.target_variable}", f"{x.source}.{x.source_variable}"] for x in system.links
        ],
        inplist=[f"{c}.{n}" for c, n in free],
        inputs=[f"{c}_{n}" for c, n in free],
        outlist=outputs,
        outputs=[name.replace(".", "_") for name in outputs],
        name=system.name,
        check_unused=False,
    )
    starts = {(c, n): v for c, b in system.components.items() for n, v in _starts(b)}
    whole.initial_input = np.array([starts[key] for key in free])
    whole.initial_state = np.concatenate([s.initial_state for s in systems.values()])
    return whole


def _starts(block: type[Block]) -> list[tuple[str, float]]:
    return [(n, s) for v in block.group("input") for n, s in zip(v.flat_names, v.start, strict=True)]
