"""Values of all types in one block of memory: what is shared, what is copied, and what a row holds."""

import numpy as np
import pytest

from harness.cosim.fmu import Access, FmuDescription
from harness.cosim.layout import Layout, Slot
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink
from harness.cosim.stepping import Order
from harness.cosim.wiring import wire
from models.kit.declaration import Type
from tests.harness.cosim.descriptions import fmu, quantity

SINGLE = Access("Float32", np.float32)
SHORT = Access("Int16", np.int16)
FLAG = Access("Boolean", np.uint8)

SOURCE = fmu(
    "source",
    quantity("n", type=Type.INTEGER, access=SHORT),
    quantity("a"),
    quantity("single", access=SINGLE),
    quantity("b"),
    quantity("flag", type=Type.BOOLEAN, access=FLAG),
    quantity("c"),
    feedthrough=False,
)
TARGET = fmu(
    "target",
    quantity("free", "input"),
    quantity("a", "input"),
    quantity("c", "input"),
    quantity("n", "input", Type.INTEGER, access=Access("Int64", np.int64)),
    quantity("flag", "input", Type.BOOLEAN, access=FLAG),
    quantity("y"),
)


def layout(*links: ScaledLink, order: Order = "sequential") -> Layout:
    fmus: dict[str, FmuDescription] = {"target": TARGET, "source": SOURCE}
    components = {name: FmuComponent(name, description.path) for name, description in fmus.items()}
    return Layout(links, fmus, wire(FmuSystem("toy", components, links), fmus, order), order)


def same(name: str, factor: float = 1.0) -> ScaledLink:
    return ScaledLink("source", name, "target", name, factor)


ALL = (same("a"), same("c"), same("n"), same("flag"))


def slot_of(slots: list[Slot], name: str) -> Slot:
    return next(slot for slot in slots if name in {q.name for q in slot.quantities})


def fill(block: Layout) -> None:
    """a, b, c = 1.5, 2.5, 3.5, single = 0.1, n = -7, flag = 1, free = 9, y = -0.0."""
    values = {"a": 1.5, "b": 2.5, "c": 3.5, "single": 0.1, "n": -7, "flag": 1, "free": 9, "y": -0.0}
    for slot in [*block.outputs, *block.inputs]:
        block.view(slot)[:] = [values[q.name] for q in slot.quantities]
    for transfer in block.transfers:
        if gather := block.gather(transfer):
            function, arguments = gather
            function(*arguments)


def test_values_of_equal_type_that_one_component_reads_are_shared() -> None:
    # given a and c, between which the source declares b
    block = layout(*ALL)
    reals = next(t for t in block.transfers if t.quantities[0].name == "a")
    # then they lie together and the target reads them from the source
    assert [q.name for q in reals.quantities] == ["a", "c"]
    assert reals.slot is None
    assert reals.place == (slot_of(block.outputs, "a"), [1, 2])  # after b, which nobody reads


def test_values_of_another_type_are_cast_into_a_slot_of_their_own() -> None:
    block = layout(*ALL)
    fill(block)
    numbers = next(t for t in block.transfers if t.quantities[0].name == "n")
    assert numbers.slot is not None
    assert numbers.slot.type == "int64"
    assert block.view(numbers.slot).tolist() == [-7]


def test_values_are_converted_on_the_way() -> None:
    block = layout(same("a", 2.0), *ALL[1:])
    fill(block)
    reals = next(t for t in block.transfers if t.quantities[0].name == "a")
    assert reals.slot is not None
    assert block.view(reals.slot).tolist() == [3.0, 3.5]


@pytest.mark.parametrize(("order", "copied"), [("sequential", False), ("jacobi", True)])
def test_values_that_are_replaced_before_they_are_read_are_copied(order: Order, copied: bool) -> None:
    # given a source that answers within the tick
    chain = {"first": fmu("first", quantity("y")), "last": fmu("last", quantity("u", "input"))}
    components = {name: FmuComponent(name, description.path) for name, description in chain.items()}
    links = (ScaledLink("first", "y", "last", "u"),)
    wiring = wire(FmuSystem("toy", components, links), chain, order)
    # when, then
    [transfer] = Layout(links, chain, wiring, order).transfers
    assert transfer.is_run
    assert (transfer.slot is not None) == copied


def test_every_value_lies_at_a_multiple_of_its_size_and_alone() -> None:
    block = layout(*ALL, order="jacobi")
    slots = [*block.outputs, *block.inputs, *(t.slot for t in block.transfers if t.slot)]
    assert all(block.address(slot) % slot.size == 0 for slot in slots)
    taken = [place for slot in slots for place in range(slot.offset, slot.end)]
    assert len(taken) == len(set(taken))
    assert max(taken) < len(block.block)


def test_real_outputs_lie_together() -> None:
    block = layout(*ALL)
    fill(block)
    doubles, singles = block.reals()
    assert sorted(doubles.tolist()) == [-0.0, 1.5, 2.5, 3.5]
    assert singles.tolist() == [np.float32(0.1)]


def test_a_row_holds_inputs_then_outputs_of_each_component() -> None:
    # given two copies of the block, with another value of a in the second
    block = layout(*ALL)
    fill(block)
    rows = np.stack([block.block, block.block])
    reals = slot_of(block.outputs, "a")
    start = reals.offset + [q.name for q in reals.quantities].index("a") * reals.size
    rows[1, start : start + 8] = np.array([8.5]).view(np.uint8)
    # when
    values = block.values(rows)
    # then
    assert [q.name for q in block.columns("target")] == ["free", "a", "c", "n", "flag", "y"]
    assert values["target"].tolist() == [[9, 1.5, 3.5, -7, 1, -0.0], [9, 8.5, 3.5, -7, 1, -0.0]]
    assert np.signbit(values["target"][:, 5]).all()
    assert values["source"].tolist() == [[-7, a, float(np.float32(0.1)), 2.5, 1, 3.5] for a in (1.5, 8.5)]
