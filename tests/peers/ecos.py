"""A package run by ecos (C++, through ecospy)."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from ecospy import EcosSimulation

package, job_file, rows_file = sys.argv[1:]
job = json.loads(Path(job_file).read_text())
rows = []
with EcosSimulation(job["step"], ssp_path=package) as simulation:
    if not simulation.init(parameter_set="initialValues"):
        sys.exit(f"ecos does not initialize {package}")
    get = {"Real": simulation.get_real, "Integer": simulation.get_integer, "Boolean": simulation.get_bool}
    for _ in range(job["ticks"] + 1):
        rows.append([float(get[kind](f"{part}::{name}")) for part, name, kind in job["outputs"]])
        simulation.step()
np.save(rows_file, np.array(rows))
