"""Which of an animal's parameters a scenario states, as a fit gives them, and which are still assumed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from harness.fit.tracks import RATES, STATISTICS
from models.canine import Canine

MEANS = tuple(statistic.key for statistic in STATISTICS if statistic.published)
FITTED = (*MEANS, *(f"{name}_deviation" for name in MEANS), *RATES)  # what `canine fit` gives (Table 5.1)


def stated_and_assumed(
    addresses: Iterable[str], owners: Collection[str], names: Sequence[str] = FITTED
) -> tuple[list[str], list[str]]:
    """Of an animal's parameters those that are stated, and the others.

    Args:
        addresses: of the scenario's parameters, `block.name`; the name of a set states nothing of an animal.
        owners: by what the animal is addressed, beside `canine` and `plant`.
        names: of the parameters.
    """
    known = {*owners, Canine.title(), "plant"}
    parts = [address.partition(".") for address in addresses]
    stated = {name for owner, _, name in parts if owner in known}
    return [name for name in names if name in stated], [name for name in names if name not in stated]
