"""A package run by libcosim (C++, through libcosimpy), which shows nothing before the first step."""

from __future__ import annotations

import json
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver

package, job_file, rows_file = sys.argv[1:]
job = json.loads(Path(job_file).read_text())
log_output_level(CosimLogLevel.WARNING)
rows = [[np.nan] * len(job["outputs"])]
with tempfile.TemporaryDirectory() as folder:
    with zipfile.ZipFile(package) as archive:
        archive.extractall(folder)
    execution = CosimExecution.from_ssp_file(folder, round(job["step"] * 1e9))  # ns
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    get = {
        "Real": observer.last_real_values,
        "Integer": observer.last_integer_values,
        "Boolean": observer.last_boolean_values,
    }
    index = {part: execution.slave_index_from_instance_name(part) for part, _, _ in job["outputs"]}
    reference = {
        (part, variable.name.decode()): variable.reference
        for part, number in index.items()
        for variable in execution.slave_variables(number)
    }
    for _ in range(job["ticks"]):
        execution.step()
        rows.append(
            [get[kind](index[part], [reference[part, name]])[0] for part, name, kind in job["outputs"]]
        )
np.save(rows_file, np.array(rows, dtype=np.float64))
