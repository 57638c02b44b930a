"""The worker process and its supervisor, started by `process`."""

import os
import sys

from harness.cosim.worker.supervisor import supervise

if __name__ == "__main__":
    connection, memory, size = map(int, sys.argv[1:])
    supervise([connection, memory])

    from harness.cosim.worker.main import main  # not for the supervisor, which should stay small

    main(connection, memory, size)
    os._exit(0)  # what an FMU left to be run at the end has no place here
