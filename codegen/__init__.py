"""Models to C: step functions and their struct headers, readable by a firmware engineer."""
