"""Write the page about tracking: `python -m harness.studies [RECORDING [UNIT [PATH]]]`."""

import sys
from pathlib import Path

from harness.studies.page import write

if __name__ == "__main__":
    recording, unit, path, *_ = [*map(Path, sys.argv[1:]), None, None, None]
    write(recording, unit, path)
