"""SSP packages as other tools might write them: a few lines of XML, checked against the standard's schema."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import fmpy
import pytest
from lxml import etree

from harness.cosim.archive import ArchiveError, XmlError
from harness.cosim.ssp import FmuSystem, SspError, open_ssp
from tests.harness.cosim.tiny_fmu import V, description

SCHEMAS = Path(fmpy.__file__).parent / "ssp" / "schema"
NAMES = {"ssd": "Description", "ssc": "Common", "ssv": "ParameterValues", "ssm": "ParameterMapping"}
XMLNS = " ".join(f'xmlns:{p}="http://ssp-standard.org/SSP1/SystemStructure{n}"' for p, n in NAMES.items())
Files = Mapping[str, bytes | str | Path]
UNITS = {
    "m": 'm="1"',
    "km": 'm="1" factor="1000"',
    "mm": 'm="1" factor="0.001"',
    "kg": 'kg="1"',
    "K": 'K="1"',
    "degC": 'K="1" offset="273.15"',
}


def units(*names: str, prefix: str = "ssd") -> str:
    inner = "".join(f'<ssc:Unit name="{n}"><ssc:BaseUnit {UNITS[n]}/></ssc:Unit>' for n in names)
    return f"<{prefix}:Units>{inner}</{prefix}:Units>"


def enumerations(prefix: str = "ssd", **known: Mapping[str, int]) -> str:
    inner = ""
    for name, items in known.items():
        inner += f'<ssc:Enumeration name="{name}">'
        inner += "".join(f'<ssc:Item name="{item}" value="{value}"/>' for item, value in items.items())
        inner += "</ssc:Enumeration>"
    return f"<{prefix}:Enumerations>{inner}</{prefix}:Enumerations>"


def connectors(*stated: str) -> str:
    """`"y output"`, `"y output Real m"`, `"y output Enumeration E"`."""
    inner = ""
    for text in stated:
        name, kind, *typed = text.split()
        attribute = (
            {"Real": "unit", "Float64": "unit", "Enumeration": "name"}.get(typed[0], "") if typed else ""
        )
        more = f' {attribute}="{typed[1]}"' if len(typed) > 1 else ""
        kept = f"<ssc:{typed[0]}{more}/>" if typed else ""
        inner += f'<ssd:Connector name="{name}" kind="{kind}">{kept}</ssd:Connector>'
    return f"<ssd:Connectors>{inner}</ssd:Connectors>" if inner else ""


def component(name: str, *stated: str, source: str = "", bindings: str = "", more: str = "") -> str:
    source = source or f"resources/{name}.fmu"
    inner = connectors(*stated) + bindings
    return f'<ssd:Component name="{name}" source="{source}" {more}>{inner}</ssd:Component>'


def connection(start: str, end: str, inner: str = "", more: str = "") -> str:
    """From `element.connector`, or `connector` of the system itself, to another."""
    text = ""
    for side, port in (("start", start), ("end", end)):
        element, _, name = port.rpartition(".")
        text += f' {side}Element="{element}"' if element else ""
        text += f' {side}Connector="{name}"'
    return f"<ssd:Connection{text} {more}>{inner}</ssd:Connection>"


def linear(factor: object = 1, offset: object = 0) -> str:
    return f'<ssc:LinearTransformation factor="{factor}" offset="{offset}"/>'


def table(kind: str, **entries: object) -> str:
    """`table("Integer", _1=5)`; an underscore before a number is dropped."""
    inner = "".join(f'<ssc:MapEntry source="{s.lstrip("_")}" target="{t}"/>' for s, t in entries.items())
    return f"<ssc:{kind}MappingTransformation>{inner}</ssc:{kind}MappingTransformation>"


def system(name: str, *elements: str, ports: str = "", bindings: str = "", links: str = "") -> str:
    """`ports`: connectors, separated by commas."""
    own = connectors(*filter(None, (p.strip() for p in ports.split(","))))
    inner = f"<ssd:Elements>{''.join(elements)}</ssd:Elements>" if elements else ""
    tail = f"<ssd:Connections>{links}</ssd:Connections>" if links else ""
    return f'<ssd:System name="{name}">{own}{bindings}{inner}{tail}</ssd:System>'


def parameters(more: str = "", version: str = "1.0", **values: str) -> str:
    """A set: `k="Real 2.5 m"`; two underscores in a name are a dot. `more`: units, enumerations."""
    inner = ""
    for name, text in values.items():
        kind, value, *other = text.split()
        attribute = "name" if kind == "Enumeration" else "unit"
        kept = f' {attribute}="{other[0]}"' if other else ""
        inner += f'<ssv:Parameter name="{name.replace("__", ".")}"><ssv:{kind} value="{value}"{kept}/>'
        inner += "</ssv:Parameter>"
    return (
        f'<ssv:ParameterSet {XMLNS} version="{version}" name="set"><ssv:Parameters>{inner}</ssv:Parameters>'
        f"{more}</ssv:ParameterSet>"
    )


def entry(source: str, target: str, inner: str = "", more: str = "") -> str:
    return f'<ssm:MappingEntry source="{source}" target="{target}" {more}>{inner}</ssm:MappingEntry>'


def mapping(*entries: str, version: str = "1.0") -> str:
    return f'<ssm:ParameterMapping {XMLNS} version="{version}">{"".join(entries)}</ssm:ParameterMapping>'


def binding(inline: str = "", mapped: str = "", source: str = "", more: str = "") -> str:
    values = f"<ssd:ParameterValues>{inline}</ssd:ParameterValues>" if inline else ""
    if mapped.startswith("<ssm"):
        mapped = f"<ssd:ParameterMapping>{mapped}</ssd:ParameterMapping>"
    from_file = f'source="{source}"' if source else ""
    return f"<ssd:ParameterBinding {from_file} {more}>{values}{mapped}</ssd:ParameterBinding>"


def bind(*bindings: str) -> str:
    return f"<ssd:ParameterBindings>{''.join(bindings)}</ssd:ParameterBindings>"


def ssd(root: str, *more: str, version: str = "1.0", valid: bool = True) -> str:
    """A SystemStructure.ssd; one that is valid and of SSP 1.0 is checked against the schema."""
    text = (
        f'<ssd:SystemStructureDescription {XMLNS} version="{version}" name="toy">{root}{"".join(more)}'
        "</ssd:SystemStructureDescription>"
    )
    if valid and version == "1.0":
        check("Description", text)
    return text


def check(schema: str, text: str) -> None:
    """Check a document of SSP 1.0 against the standard's schema."""
    read = etree.XMLSchema(file=str(SCHEMAS / f"SystemStructure{schema}.xsd"))
    read.assertValid(etree.fromstring(text.encode()))


def fmu(*variables: V, version: int = 2) -> bytes:
    """An FMU that can be read and not run: its description alone."""
    return description(variables, version).encode()


def package(path: Path, structure: str, files: Files | None = None) -> Path:
    """An .ssp. A description (bytes) is packed as the FMU of that name; a path is copied."""
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("SystemStructure.ssd", structure)
        for name, content in (files or {}).items():
            if isinstance(content, Path):
                packed.write(content, name)
            elif isinstance(content, str):
                packed.writestr(name, content)
            else:
                held = path.with_name(f"{Path(name).name}.zip")
                with zipfile.ZipFile(held, "w") as made:
                    made.writestr("modelDescription.xml", content)
                packed.write(held, name)
    return path


def read(path: Path) -> FmuSystem:
    """The system of a package; its files are gone."""
    with open_ssp(path) as system:
        return system


def refusal(path: Path) -> str:
    """Why a package is refused."""
    with pytest.raises((SspError, ArchiveError, XmlError)) as caught, open_ssp(path):
        pass
    return str(caught.value).removeprefix(f"{path}: ")
