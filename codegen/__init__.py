"""Models to C: step functions and their struct headers, readable by a firmware engineer."""

import models  # noqa: F401 - notes the time before the files here are read
