"""Write the pages: all of them, or those that are named.

python -m harness.verification
python -m harness.verification habituation      and print what the field's counts say of the gain
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence

from harness.verification import controllers, habituation, page, streets

PAGES: Mapping[str, Callable[[], str | None]] = {
    "verification": page.write,
    "streets": streets.write,
    "controllers": controllers.write,
    "habituation": habituation.write,
}


def main(names: Sequence[str]) -> int:
    """Write pages by their names, all without any; the exit status."""
    if unknown := [name for name in names if name not in PAGES]:
        sys.stderr.write(f'there is no page "{unknown[0]}"; expected one of {", ".join(PAGES)}\n')
        return 2
    for name in names or PAGES:
        if text := PAGES[name]():
            sys.stdout.write(f"{text}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
