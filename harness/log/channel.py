"""A component's signals in a log: the channel of its rows, and the JSON Schema that describes them."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import orjson

JSON_TYPES = {"Real": "number", "Integer": "integer", "Boolean": "boolean"}
TYPES = {json_type: name for name, json_type in JSON_TYPES.items()}
SECOND = 1_000_000_000  # ns, the unit of time in a log

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Channel:
    """A component's signals, inputs then outputs: names, units, types (Real, Integer, Boolean), meanings."""

    component: str
    block: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    types: tuple[str, ...]
    meanings: tuple[str, ...]

    def schema(self) -> bytes:
        """The JSON Schema of a row."""
        signals = zip(self.names, self.units, self.types, self.meanings, strict=True)
        properties = {
            name: {"type": JSON_TYPES[kind], "unit": unit, "description": meaning}
            for name, unit, kind, meaning in signals
        }
        return json.dumps({"title": self.block, "type": "object", "properties": properties}).encode()

    @classmethod
    def from_schema(cls, component: str, block: str, schema: bytes) -> Channel:
        """What `schema` stated.

        Raises:
            ValueError: it is no schema of a row.
        """
        try:
            properties = orjson.loads(schema)["properties"]
            columns = [(p["unit"], TYPES[p["type"]], p["description"]) for p in properties.values()]
        except (orjson.JSONDecodeError, KeyError, TypeError, AttributeError):
            raise ValueError(f'the schema of "{component:.80}" does not describe rows') from None
        if not all(isinstance(text, str) for column in columns for text in column):
            raise ValueError(f'the schema of "{component:.80}" has a unit or a meaning that is not a text')
        units, types, meanings = zip(*columns, strict=True) if columns else ((), (), ())
        return cls(component, block, tuple(properties), units, types, meanings)
