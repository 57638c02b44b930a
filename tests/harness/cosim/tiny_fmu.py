"""FMUs as other tools might make them, good and bad: a few lines of C for each, compiled on the spot."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import fmpy.fmi2
import fmpy.fmi3

from codegen.toolchains.compiler import build_library, find_platform, this_platform

UNITS = {
    "m": 'm="1"',
    "rad": 'rad="1"',
    "deg": 'rad="1" factor="0.017453292519943295"',
    "kg": 'kg="1"',
    "m/s": 'm="1" s="-1"',
    "km/h": 'm="1" s="-1" factor="0.2777777777777778"',
}
ITEMS = {"NONE": 0, "LEFT": 4, "RIGHT": 5}  # of the enumeration E
ENUMERATION = (
    '<TypeDefinitions><SimpleType name="E"><Enumeration>'
    + "".join(f'<Item name="{name}" value="{value}"/>' for name, value in ITEMS.items())
    + "</Enumeration></SimpleType></TypeDefinitions>"
)
C = """#include <stddef.h>
#include <math.h>
typedef struct { double v[32]; } tiny;
static tiny pool[8];
static int used;
static void say(const char *text);
%(outside)s
static int step(tiny *m, double t, double h) {
  double *v = m->v; (void)v; (void)t; (void)h; %(step)s return 0; }
%(api)s
"""
API2 = """
typedef void (*logger)(void *, const char *, int, const char *, const char *, ...);
static logger log_;
void *fmi2Instantiate(const char *n, int k, const char *g, const char *r, const void *f, int a, int b) {
  (void)n; (void)k; (void)g; (void)r; (void)a; (void)b; log_ = *(logger *const *)f ? *(const logger *)f : 0;
  tiny *m = &pool[used++ %% 8]; double *v = m->v; (void)v; %(start)s return m; }
int fmi2DoStep(void *c, double t, double h, int n) { (void)n; return step(c, t, h); }
void fmi2FreeInstance(void *c) { (void)c; %(free)s }
int fmi2Reset(void *c) { double *v = ((tiny *)c)->v; (void)v; %(reset)s return 0; }
int fmi2GetFMUstate(void *c, void **s) {
  if (!*s) *s = __builtin_malloc(sizeof(tiny)); *(tiny *)*s = *(tiny *)c; return 0; }
int fmi2SetFMUstate(void *c, void *s) {
  tiny *m = c; double *v = m->v; (void)v; *m = *(tiny *)s; %(restore)s return 0; }
int fmi2FreeFMUstate(void *c, void **s) { (void)c; __builtin_free(*s); *s = 0; return 0; }
int fmi2SerializedFMUstateSize(void *c, void *s, size_t *n) { (void)c; (void)s; *n = sizeof(tiny); return 0; }
int fmi2SerializeFMUstate(void *c, void *s, char *b, size_t n) {
  (void)c; __builtin_memcpy(b, s, n); return 0; }
int fmi2DeSerializeFMUstate(void *c, const char *b, size_t n, void **s) {
  (void)c; *s = __builtin_malloc(n); __builtin_memcpy(*s, b, n); %(deserialize)s return 0; }
"""
API3 = """
typedef void (*logger)(void *, int, const char *, const char *);
static logger log_;
void *fmi3InstantiateCoSimulation(const char *n, const char *g, const char *r,
  _Bool a, _Bool b, _Bool c, _Bool d, const void *e, size_t f, void *env, logger l, const void *u) {
  (void)n; (void)g; (void)r; (void)a; (void)b; (void)c; (void)d; (void)e; (void)f;
  (void)env; (void)u; log_ = l;
  tiny *m = &pool[used++ %% 8]; double *v = m->v; (void)v; %(start)s return m; }
int fmi3DoStep(void *c, double t, double h, _Bool n, _Bool *e, _Bool *x, _Bool *y, double *z) {
  int status = step(c, t, h);
  const double *v = ((tiny *)c)->v; (void)n;
  *e = v[29] != 0; *x = v[31] != 0; *y = v[30] != 0; *z = t + h - v[30] - v[26]; return status; }
void fmi3FreeInstance(void *c) { (void)c; %(free)s }
int fmi3Reset(void *c) { double *v = ((tiny *)c)->v; (void)v; %(reset)s return 0; }
int fmi3GetFMUState(void *c, void **s) {
  if (!*s) *s = __builtin_malloc(sizeof(tiny)); *(tiny *)*s = *(tiny *)c; return 0; }
int fmi3SetFMUState(void *c, void *s) {
  tiny *m = c; double *v = m->v; (void)v; *m = *(tiny *)s; %(restore)s return 0; }
int fmi3FreeFMUState(void *c, void **s) { (void)c; __builtin_free(*s); *s = 0; return 0; }
int fmi3SerializedFMUStateSize(void *c, void *s, size_t *n) { (void)c; (void)s; *n = sizeof(tiny); return 0; }
int fmi3SerializeFMUState(void *c, void *s, char *b, size_t n) {
  (void)c; __builtin_memcpy(b, s, n); return 0; }
int fmi3DeserializeFMUState(void *c, const char *b, size_t n, void **s) {
  (void)c; *s = __builtin_malloc(n); __builtin_memcpy(*s, b, n); %(deserialize)s return 0; }
"""
SAID = {
    2: 'static void say(const char *text) { log_(0, "plant", 3, "error", text); }',
    3: 'static void say(const char *text) { log_(0, 3, "error", text); }',
}
ACCESS = {
    2: {"Real": "double", "Integer": "int", "Boolean": "int"},
    3: {
        "Float64": "double",
        "Float32": "float",
        "Int8": "signed char",
        "Int32": "int",
        "Int64": "long long",
        "Boolean": "_Bool",
    },
}


@dataclass(frozen=True)
class V:
    """One variable; the C sees it as `v[i]`, i its place in the list."""

    name: str
    causality: str = "output"
    type: str = "Real"
    unit: str = ""
    start: str = "0"


def strict(size: float) -> str:
    """C that refuses a step of another size, or one that does not begin where the last one ended.

    `v[2]` counts the steps, `v[20]` is where the last one ended.
    """
    return f"if (fabs(h - {size}) > 1e-12 || fabs(t - v[20]) > 1e-9) return 3; v[20] = t + h; v[2] += 1; "


def tiny_fmu(
    path: Path,
    variables: Sequence[V],
    step: str = "",
    *,
    version: int = 2,
    start: str = "",
    free: str = "",
    outside: str = "",
    reset: str | None = None,
    restore: str | None = None,
    deserialize: str = "",
    arrays: Sequence[str] = (),
    depends: bool = True,
    step_size: float | None = None,
    fixed: bool = False,
    internal: float | None = None,
) -> Path:
    """Build an FMU.

    Args:
        step: C that is run on each step: `v[i]`, `t`, `h`, `say("...")`, `return <status>`; `v[27]` is the
            status that a get call returns, `v[28]` a set call; in version 3 `v[29] = 1` asks for an event,
            `v[30] = 1` returns 1 s early, `v[31] = 1` asks to end the simulation; `v[26]` s are missing
            from what it says it reached.
        start: C that is run when it is instantiated; `free`: when it is freed.
        outside: C outside of all functions.
        reset: C that is run when it is reset; by default all is as it was when it was instantiated.
        restore: C that is run when a state was restored, `deserialize`: when one was read (`*s`); it offers
            states unless `restore` is None.
        arrays: outputs of two reals each, in version 3.
        depends: its outputs depend on its inputs.
        step_size: preferred, s; `internal`: the fixed one of FMI 3; `fixed`: it cannot vary its steps.
    """
    work = path.parent / f".{path.stem}"
    work.mkdir(parents=True, exist_ok=True)
    slave = fmpy.fmi2.FMU2Slave if version == 2 else fmpy.fmi3.FMU3Slave
    api = (API2 if version == 2 else API3) % {
        "start": start,
        "free": free,
        "reset": f"for (int i = 0; i < 32; i++) v[i] = 0; {start}" if reset is None else reset,
        "restore": restore or "",
        "deserialize": deserialize,
    }
    count = "" if version == 2 else ", size_t k"
    unused = "" if version == 2 else " (void)k;"
    for fmi, c in ACCESS[version].items():
        for verb, body in (
            ("Get", f"x[i] = ({c})v[r[i]]"),
            ("Set", "v[r[i]] = (double)x[i]"),
        ):
            status = 27 if verb == "Get" else 28
            api += f"int fmi{version}{verb}{fmi}(void *m, const unsigned *r, size_t n, {c} *x{count}) "
            api += f"{{{unused} double *v = ((tiny *)m)->v; for (size_t i = 0; i < n; i++) {body}; "
            api += f"return (int)v[{status}]; }}\n"
    written = {
        word.split("(")[0].split()[-1].lstrip("*")
        for word in api.splitlines()
        if f"fmi{version}" in word.split("(")[0]
    }
    for name in dir(slave):
        if name.startswith(f"fmi{version}") and name not in written:
            api += f"int {name}(void) {{ return 0; }}\n"
    api += SAID[version]
    (work / "tiny.c").write_text(C % {"step": step, "api": api, "outside": outside})
    platform = find_platform(this_platform())
    library = build_library(
        work, ["tiny.c"], work / f"tiny{platform.suffix}", what="tiny", flags=("-O1", "-w")
    )
    folder = platform.fmi2 if version == 2 else platform.fmi3
    with zipfile.ZipFile(path, "w") as archive:
        xml = description(
            variables,
            version,
            depends,
            step_size,
            fixed,
            internal=internal,
            states=restore is not None,
            arrays=arrays,
        )
        archive.writestr("modelDescription.xml", xml)
        archive.write(library, f"binaries/{folder}/{library.name}")
    return path


def description(
    variables: Sequence[V],
    version: int = 2,
    depends: bool = True,
    step_size: float | None = None,
    fixed: bool = False,
    *,
    internal: float | None = None,
    states: bool = False,
    arrays: Sequence[str] = (),
) -> str:
    """Its modelDescription.xml."""
    known = {v.unit: UNITS[v.unit] for v in variables if v.unit in UNITS}
    units = "".join(f'<Unit name="{name}"><BaseUnit {base}/></Unit>' for name, base in known.items())
    units = f"<UnitDefinitions>{units}</UnitDefinitions>" if units else ""
    experiment = f'<DefaultExperiment stepSize="{step_size}"/>' if step_size else ""
    varying = f'canHandleVariableCommunicationStepSize="{"false" if fixed else "true"}"'
    if states:
        word = "FMUstate" if version == 2 else "FMUState"
        varying += f' canGetAndSet{word}="true" canSerialize{word}="true"'
    if internal:
        varying += f' fixedInternalStepSize="{internal}"'
    inputs = [i for i, v in enumerate(variables) if v.causality == "input"]
    outputs = [i for i, v in enumerate(variables) if v.causality == "output"]
    write = _xml2 if version == 2 else _xml3
    xml = write(
        variables,
        units=units,
        experiment=experiment,
        varying=varying,
        inputs=inputs if depends else [],
        outputs=outputs,
    )
    vectors = "".join(
        f'<Float64 name="{name}" valueReference="{200 + i}" causality="output">'
        '<Dimension start="2"/></Float64>'
        for i, name in enumerate(arrays)
    )
    return xml.replace("</ModelVariables>", f"{vectors}</ModelVariables>")


def _attributes(v: V) -> str:
    unit = f' unit="{v.unit}"' if v.unit else ""
    start = f' start="{v.start}"' if v.causality in ("input", "parameter") else ""
    return unit + start


def _xml2(
    variables: Sequence[V],
    *,
    units: str,
    experiment: str,
    varying: str,
    inputs: list[int],
    outputs: list[int],
) -> str:
    scalars = ""
    for i, v in enumerate(variables):
        varies = "fixed" if v.causality == "parameter" else "continuous" if v.type == "Real" else "discrete"
        declared = ' declaredType="E"' if v.type == "Enumeration" else ""
        scalars += f'<ScalarVariable name="{v.name}" valueReference="{i}" causality="{v.causality}" '
        scalars += f'variability="{varies}"><{v.type}{declared}{_attributes(v)}/></ScalarVariable>'
    needs = " ".join(str(i + 1) for i in inputs)
    unknowns = "".join(f'<Unknown index="{i + 1}" dependencies="{needs}"/>' for i in outputs)
    initial = "".join(f'<Unknown index="{i + 1}"/>' for i in outputs)
    structure = (
        f"<Outputs>{unknowns}</Outputs><InitialUnknowns>{initial}</InitialUnknowns>" if outputs else ""
    )
    return (
        '<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="tiny" guid="g">'
        f'<CoSimulation modelIdentifier="tiny" {varying}/>{units}'
        f"{ENUMERATION if any(v.type == 'Enumeration' for v in variables) else ''}{experiment}"
        f"<ModelVariables>{scalars}</ModelVariables><ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def _xml3(
    variables: Sequence[V],
    *,
    units: str,
    experiment: str,
    varying: str,
    inputs: list[int],
    outputs: list[int],
) -> str:
    scalars = ""
    for i, v in enumerate(variables):
        kind = {"Real": "Float64", "Integer": "Int32"}.get(v.type, v.type)
        varies = "fixed" if v.causality == "parameter" else "continuous" if "Float" in kind else "discrete"
        scalars += f'<{kind} name="{v.name}" valueReference="{i}" causality="{v.causality}" '
        scalars += f'variability="{varies}"{_attributes(v)}/>'
    needs = " ".join(str(i) for i in inputs)
    unknowns = "".join(f'<Output valueReference="{i}" dependencies="{needs}"/>' for i in outputs)
    unknowns += "".join(f'<InitialUnknown valueReference="{i}"/>' for i in outputs)
    return (
        '<?xml version="1.0"?><fmiModelDescription fmiVersion="3.0" modelName="tiny" instantiationToken="g">'
        f'<CoSimulation modelIdentifier="tiny" {varying}/>{units}{experiment}'
        f'<ModelVariables>{scalars}<Float64 name="time" valueReference="99" causality="independent" '
        f'variability="continuous"/></ModelVariables><ModelStructure>{unknowns}</ModelStructure></fmiModelDescription>'
    )
