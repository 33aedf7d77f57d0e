"""FMUs made on the spot: compiled from C, or packed by pythonfmu (FMI 2) and pythonfmu3 (FMI 3)."""

import shutil
import subprocess
import sys
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import pytest

HERE = Path(__file__).parent
CC = shutil.which("gcc") or shutil.which("cc")
needs_cc = pytest.mark.skipif(CC is None or sys.platform != "linux", reason="needs a C compiler on Linux")

UNITS = {
    "kg": '<BaseUnit kg="1"/>',
    "kg/s": '<BaseUnit kg="1" s="-1"/>',
    "t/h": '<BaseUnit kg="1" s="-1" factor="0.27777777777777779"/>',
    "s": '<BaseUnit s="1"/>',
    "km/h": '<BaseUnit m="1" s="-1" factor="0.27777777777777779"/>',
    "m/s": '<BaseUnit m="1" s="-1"/>',
    "rpm": '<BaseUnit s="-1" rad="1" factor="0.10471975511965977"/>',
}
# name, causality, unit, start; the value reference is the place in the list
PROCESS = [
    ("grain_in", "input", "kg/s", 0.0),
    ("straw_in", "input", "kg/s", 0.0),
    ("time_constant", "parameter", "s", 1.0),
    ("loss", "parameter", None, 0.01),
    ("fail_at", "parameter", "s", 0.5),
    ("tank_grain", "output", "kg", None),
    ("lost_grain", "output", "kg", None),
    ("dropped_straw", "output", "kg", None),
    ("held_grain", "output", "kg", None),
    ("held_straw", "output", "kg", None),
    ("grain_flow", "output", "kg/s", None),
    ("straw_flow", "output", "kg/s", None),
    ("steps", "output", None, None),
    ("ranges[1]", "input", None, 0.0),
    ("ranges[2]", "input", None, 0.0),
    ("ranges[3]", "input", None, 0.0),
    ("digits", "output", None, None),
]
FEED = {"grain_in": "flow.grain/s", "straw_in": "flow.straw/s"}
CAN = 'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true" canSerializeFMUstate="true"'


def process_xml(*, attributes=CAN, units=None, variables=PROCESS, token="{p}", extra=""):
    """modelDescription.xml of fmu2.c."""
    scalars = []
    for vr, (name, causality, unit, start) in enumerate(variables):
        initial = 'variability="fixed" ' if causality == "parameter" else ""
        value = "" if start is None else f' start="{start}"'
        value += "" if unit is None else f' unit="{unit}"'
        scalars.append(
            f'<ScalarVariable name="{name}" valueReference="{vr}" causality="{causality}" {initial}>'
            f"<Real{value}/></ScalarVariable>"
        )
    scalars.append(
        '<ScalarVariable name="mode" valueReference="0" causality="parameter" variability="fixed">'
        '<Integer start="0"/></ScalarVariable>'
    )
    outputs = [k + 1 for k, v in enumerate(variables) if v[1] == "output"]
    unknowns = "".join(f'<Unknown index="{k}"/>' for k in outputs)
    named = UNITS if units is None else units
    defined = "".join(f'<Unit name="{n}">{b}</Unit>' for n, b in named.items())
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        f'<fmiModelDescription fmiVersion="2.0" modelName="Store" guid="{token}" '
        f'generationTool="hand" {extra}>'
        f'<CoSimulation modelIdentifier="store" {attributes}/>'
        + (f"<UnitDefinitions>{defined}</UnitDefinitions>" if defined else "")
        + f"<ModelVariables>{''.join(scalars)}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns>"
        "</ModelStructure></fmiModelDescription>"
    )


def process_xml1(capabilities='canHandleVariableCommunicationStepSize="true"'):
    """modelDescription.xml of fmu1.c."""
    scalars = []
    for vr, (name, causality, unit, start) in enumerate(PROCESS):
        kind = 'variability="parameter"' if causality == "parameter" else f'causality="{causality}"'
        value = "" if start is None else f' start="{start}"'
        value += "" if unit is None else f' unit="{unit}"'
        scalars.append(
            f'<ScalarVariable name="{name}" valueReference="{vr}" {kind}><Real{value}/></ScalarVariable>'
        )
    defined = "".join(f'<BaseUnit unit="{n}"/>' for n in ("kg", "kg/s", "s"))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<fmiModelDescription fmiVersion="1.0" modelName="Store" modelIdentifier="store" guid="{p}" '
        'generationTool="hand" numberOfContinuousStates="0" numberOfEventIndicators="0">'
        f"<UnitDefinitions>{defined}</UnitDefinitions><ModelVariables>{''.join(scalars)}</ModelVariables>"
        f"<Implementation><CoSimulation_StandAlone><Capabilities {capabilities}/></CoSimulation_StandAlone>"
        "</Implementation></fmiModelDescription>"
    )


ENGINE = [
    ("ground_speed", "input", "km/h", 0.0),
    ("speed", "output", "rpm", None),
    ("fuel", "output", "kg/s", None),
    ("fuel_used", "output", "kg", None),
    ("speed_limit", "output", "km/h", None),
    ("events", "output", None, None),
    ("ticks", "output", None, None),
    ("time_events", "output", None, None),
    ("switches", "output", None, None),
    ("early_at", "parameter", "s", 1e9),
]


def engine_xml(*, clock=True, attributes=""):
    """modelDescription.xml of fmu3.c."""
    made = []
    for vr, (name, causality, unit, start) in enumerate(ENGINE):
        value = "" if start is None else f' start="{start}"'
        value += "" if unit is None else f' unit="{unit}"'
        fixed = ' variability="fixed"' if causality == "parameter" else ""
        made.append(f'<Float64 name="{name}" valueReference="{vr}" causality="{causality}"{fixed}{value}/>')
    made.append(
        '<UInt64 name="length" valueReference="10" causality="structuralParameter" variability="fixed" '
        'start="3"/>'
    )
    dimension = '<Dimension valueReference="10"/>'
    made.append(
        f'<Float64 name="x" valueReference="11" causality="input" start="0 0 0">{dimension}</Float64>'
    )
    made.append(f'<Float64 name="y" valueReference="12" causality="output">{dimension}</Float64>')
    if clock:
        made.append(
            '<Clock name="tick" valueReference="13" causality="input" intervalVariability="constant" '
            'intervalDecimal="0.1"/>'
        )
    made.append(
        '<Int64 name="gear" valueReference="14" causality="parameter" variability="fixed" start="1"/>'
    )
    made.append('<Boolean name="engaged" valueReference="15" causality="input" start="false"/>')
    made.append('<Float64 name="time" valueReference="16" causality="independent" variability="continuous"/>')
    outputs = [vr for vr, v in enumerate(ENGINE) if v[1] == "output"] + [12]
    listed = "".join(f'<Output valueReference="{vr}"/>' for vr in outputs)
    unknown = "".join(f'<InitialUnknown valueReference="{vr}"/>' for vr in outputs)
    defined = "".join(f'<Unit name="{n}">{b}</Unit>' for n, b in UNITS.items())
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<fmiModelDescription fmiVersion="3.0" modelName="Engine" instantiationToken="{e}" '
        'generationTool="hand">'
        f'<CoSimulation modelIdentifier="engine" hasEventMode="true" mightReturnEarlyFromDoStep="true" '
        f'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true" {attributes}/>'
        f"<UnitDefinitions>{defined}</UnitDefinitions><ModelVariables>{''.join(made)}</ModelVariables>"
        f"<ModelStructure>{listed}{unknown}</ModelStructure></fmiModelDescription>"
    )


@cache
def _compiled(source, flags):
    with tempfile.TemporaryDirectory(prefix="swath-test-") as folder:
        out = Path(folder) / f"{source}.so"
        command = [CC, "-shared", "-fPIC", "-O1", "-w", *flags, "-o", out, HERE / f"{source}.c", "-lm"]
        subprocess.run(command, check=True)
        return out.read_bytes()


def store_fmu(folder, name="store.fmu", *, flags=(), binary="binaries/linux64/store.so", **about):
    """The process model as an FMU of FMI 2."""
    file = Path(folder) / name
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("modelDescription.xml", process_xml(**about))
        made.writestr(binary, _compiled("fmu2", tuple(flags)))
    return file


def store1_fmu(folder, name="store1.fmu", **about):
    """The process model as an FMU of FMI 1.0."""
    file = Path(folder) / name
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("modelDescription.xml", process_xml1(**about))
        made.writestr("binaries/linux64/store.so", _compiled("fmu1", ()))
    return file


def engine_fmu(folder, name="engine.fmu", *, flags=(), **about):
    """The engine as an FMU of FMI 3."""
    file = Path(folder) / name
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("modelDescription.xml", engine_xml(**about))
        made.writestr("binaries/x86_64-linux/engine.so", _compiled("fmu3", tuple(flags)))
    return file


PROCESS_PY = '''
from math import exp
from pythonfmu import Fmi2Slave, Fmi2Causality, Fmi2Variability, Real, Integer


class PyStore(Fmi2Slave):
    """Grain and straw leave at once, one percent of the grain is lost; masses per step come in."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.grain = self.straw = 0.0
        self.tank_grain = self.lost_grain = self.dropped_straw = 0.0
        self.held_grain = self.held_straw = self.grain_flow = self.straw_flow = 0.0
        self.loss = 0.01
        for name in ("grain", "straw"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("tank_grain", "lost_grain", "dropped_straw", "held_grain", "held_straw",
                     "grain_flow", "straw_flow"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        self.register_variable(
            Real("loss", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        )

    def do_step(self, t, h):
        self.lost_grain += self.grain * self.loss
        self.tank_grain += self.grain * (1.0 - self.loss)
        self.dropped_straw += self.straw
        self.grain_flow = self.grain * (1.0 - self.loss) / h
        self.straw_flow = self.straw / h
        return True
'''

ENGINE_PY = '''
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Fmi3Status, Fmi3StepResult, Float64, Unit


class PyEngine(Fmi3Slave):
    """Power by throughput, speed by power; in units of the trade."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.register_units([
            Unit("rpm", s=-1, rad=1, factor=0.10471975511965977),
            Unit("km/h", m=1, s=-1, factor=1 / 3.6),
            Unit("kW", kg=1, m=2, s=-3, factor=1000.0),
            Unit("kg/s", kg=1, s=-1),
            Unit("kg", kg=1),
        ])
        self.time = 0.0
        self.ground = self.flow = 0.0
        self.speed, self.power, self.fuel, self.fuel_used, self.speed_limit = 2000.0, 0.0, 0.0, 0.0, 20.0
        self.speed_ratio, self.load = 1.0, 0.0
        cause, kind = Fmi3Causality, Fmi3Variability
        self.register_variable(Float64("time", causality=cause.independent, variability=kind.continuous))
        for name, unit in (("ground", "km/h"), ("flow", "kg/s")):
            self.register_variable(
                Float64(name, causality=cause.input, variability=kind.continuous, unit=unit)
            )
        for name, unit in (("speed", "rpm"), ("power", "kW"), ("fuel", "kg/s"), ("fuel_used", "kg"),
                           ("speed_limit", "km/h"), ("speed_ratio", None), ("load", None)):
            self.register_variable(
                Float64(name, causality=cause.output, variability=kind.continuous, unit=unit)
            )

    def do_step(self, t, h):
        self.power = 60.0 + 10.0 * self.flow + 4.0 * self.ground
        self.load = self.power / 350.0
        self.speed = 2000.0 - 100.0 * self.load
        self.speed_ratio = self.speed / 2000.0
        self.fuel = self.power * 1000.0 * 6e-8
        self.fuel_used += self.fuel * h
        return Fmi3StepResult(status=Fmi3Status.ok)
'''


def python_fmu(folder, text, package):
    """An FMU packed from a Python class by `pythonfmu` (FMI 2) or `pythonfmu3` (FMI 3)."""
    pytest.importorskip(package)
    name = text.partition("class ")[2].partition("(")[0]
    script = Path(folder) / f"{name.lower()}.py"
    script.write_text(text, encoding="utf-8")
    subprocess.run(
        [sys.executable, "-m", package, "build", "-f", script, "-d", folder], check=True, cwd=folder
    )
    return Path(folder) / f"{name}.fmu"


SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" name="works" version="1.0">
{system}
<ssd:Units><ssc:Unit name="kg/s"><ssc:BaseUnit kg="1" s="-1"/></ssc:Unit></ssd:Units>
</ssd:SystemStructureDescription>"""


def connector(name, kind, unit=None):
    """A connector of a system."""
    unit = "" if unit is None else f' unit="{unit}"'
    return f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real{unit}/></ssd:Connector>'


def component(name, file, **values):
    """A component with parameter values."""
    return (
        f'<ssd:Component name="{name}" source="{file}" type="application/x-fmu-sharedlibrary">'
        f"{parameters(**values)}</ssd:Component>"
    )


def parameters(**values):
    """Parameter values in the file."""
    made = "".join(
        f'<ssv:Parameter name="{n}"><ssv:Real value="{v}"/></ssv:Parameter>' for n, v in values.items()
    )
    inner = (
        f"<ssv:ParameterSet name='p' version='1.0'><ssv:Parameters>{made}</ssv:Parameters></ssv:ParameterSet>"
    )
    binding = (
        f"<ssd:ParameterBinding><ssd:ParameterValues>{inner}</ssd:ParameterValues></ssd:ParameterBinding>"
    )
    return f"<ssd:ParameterBindings>{binding}</ssd:ParameterBindings>"


def connection(start, end, inner="", **more):
    """A connection from `element.connector` or `connector` to another."""
    ends = []
    for side, text in (("start", start), ("end", end)):
        element, _, name = text.rpartition(".")
        ends.append((f'{side}Element="{element}" ' if element else "") + f'{side}Connector="{name}"')
    more = " ".join(f'{k}="{v}"' for k, v in more.items())
    return f"<ssd:Connection {' '.join(ends)} {more}>{inner}</ssd:Connection>"


def system(name, connectors, elements, connections, bindings=""):
    """A system of elements."""
    return (
        f'<ssd:System name="{name}"><ssd:Connectors>{"".join(connectors)}</ssd:Connectors>{bindings}'
        f"<ssd:Elements>{''.join(elements)}</ssd:Elements>"
        f"<ssd:Connections>{''.join(connections)}</ssd:Connections></ssd:System>"
    )


def package(folder, name, text, *fmus):
    """A System Structure Package."""
    file = Path(folder) / name
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("SystemStructure.ssd", SSD.format(system=text))
        for fmu in fmus:
            made.write(fmu, f"resources/{fmu.name}")
    return file
