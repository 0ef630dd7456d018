"""A co-simulation unit (FMI 2 or 3) as a function: what its build file says, held against the unit's description."""

from __future__ import annotations

import importlib.util
import json
import lzma
import posixpath
import re
import struct
import sys
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from lxml import etree
from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictStr, field_validator, model_validator

import resim.function.fmi as adapter
from resim.core.errors import InputError
from resim.core.spelling import did_you_mean

_SIGNAL = re.compile(r"object\[(0|[1-9][0-9]?)\]\.(\w+)")
_NUMBERS = {"Real", "Float32", "Float64"}
_TYPES = {
    *_NUMBERS,
    "Integer",
    "Int8",
    "UInt8",
    "Int16",
    "UInt16",
    "Int32",
    "UInt32",
    "Int64",
    "UInt64",
    "Boolean",
}
_PLATFORM = {2: "linux64", 3: "x86_64-linux"}
_SAME = {"m/s^2": "m/s2", "m/s²": "m/s2", "m.s-2": "m/s2", "m.s-1": "m/s", "rad.s-1": "rad/s", "m-1": "1/m"}
"""Other ways to write a unit."""
_MESSAGES = {
    "OSMPSensorViewIn": "input", "OSMPTrafficUpdateOut": "output", "OSMPTrafficCommandIn": "input",
    "OSMPGroundTruthInit": "parameter", "OSMPSensorViewInConfigRequest": "calculatedParameter",
    "OSMPSensorViewInConfig": "parameter",
}  # fmt: skip
"""Messages of OSMP that a unit may get or give, and their causality; the first two it has to have."""
_INTEGERS = ("base.lo", "base.hi", "size")
_OUTPUTS = {"acceleration": "m/s2", "curvature": "1/m"}
_UNREADABLE = (
    OSError, EOFError, KeyError, RuntimeError, ValueError, struct.error, zlib.error, lzma.LZMAError, zipfile.BadZipFile,
    etree.XMLSyntaxError,
)  # fmt: skip
"""What zipfile and lxml raise for files that are damaged, encrypted, or compressed in a way that they do not know."""
_REFERENCE = re.compile(r"\s*\+?([0-9]{1,10})\s*")
DAMAGED = "Export the unit again."
REMEDY = "The variables are in modelDescription.xml of the unit."


class FmiTable(BaseModel):
    """`[fmi]`: a co-simulation unit, and how it is connected.

    Attributes:
        file: The unit (FMI 2 or 3), beside the build file.
        inputs: Input variable = signal.
        outputs: `acceleration`, and `curvature` if it steers = output variable.
        reach: m up to which there is a lead vehicle.
        osmp: Whether it is a traffic participant model of OSMP, which gets and gives messages of OSI.
    """

    model_config = ConfigDict(extra="forbid")
    file: StrictStr
    inputs: dict[StrictStr, StrictStr] = Field(default_factory=dict)
    outputs: dict[Literal["acceleration", "curvature"], StrictStr] = Field(default_factory=dict)
    reach: float = Field(strict=True, default=200.0, gt=0.0, le=1e6)
    osmp: StrictBool = False

    @field_validator("file")
    @classmethod
    def _is_beside(cls, file: str) -> str:
        if posixpath.normpath(file).startswith(("..", "/")):
            raise ValueError(f"{file!r} is not beside the build file, expected a name relative to its folder")
        return file

    @field_validator("inputs")
    @classmethod
    def _signals_exist(cls, inputs: dict[str, str]) -> dict[str, str]:
        for signal in inputs.values():
            if _unit_of(signal) is None:
                known = [*adapter.SIGNALS, *(f"object[0].{name}" for name in adapter.OF_OBJECT)]
                near = did_you_mean(signal, known)
                raise ValueError(f"there is no signal {signal!r}{near}; there are: {', '.join(known)}")
        return inputs

    @model_validator(mode="after")
    def _answers(self) -> FmiTable:
        if self.osmp and self.outputs:
            raise ValueError("outputs: with osmp the answer is OSMPTrafficUpdateOut; leave them out")
        if not self.osmp and "acceleration" not in self.outputs:
            raise ValueError("outputs: acceleration is missing, or osmp = true")
        return self


@dataclass(frozen=True)
class FmuVariable:
    """A variable of a unit: value reference, type, causality, and its unit if it has one."""

    reference: int
    type: str
    causality: str
    unit: str


def fmu_files(path: Path, fmi: FmiTable) -> list[str]:
    """Give the unit, as seen from the build file's folder. Raises InputError without it or FMPy."""
    if importlib.util.find_spec("fmpy") is None:
        raise InputError(path, "[fmi] needs FMPy", "In resim's own folder: pip install '.[fmi]'")
    if fmi.osmp and importlib.util.find_spec("osi3") is None:
        raise InputError(path, "osmp needs osi-python", "In resim's own folder: pip install '.[fmi,osi]'")
    file = posixpath.normpath(fmi.file)
    if not (path.parent / file).is_file():
        raise InputError(
            path, f"fmi.file: {file!r} is not a file beside it", "Name it relative to this file's folder."
        )
    return [file]


def fmu_command(
    path: Path, fmi: FmiTable, parameters: Mapping[str, Any], folder: Path
) -> tuple[tuple[str, ...], bool]:
    """Give the command that serves a unit, and whether that needs a tool of its vendor.

    folder: where the unit lies. Raises InputError where the build file does not fit the unit.
    """
    name = posixpath.normpath(fmi.file)
    root, version = _description(path, name, folder / name)
    simulation = root.find("CoSimulation")
    if simulation is None:
        kinds = [kind for kind in ("ModelExchange", "ScheduledExecution") if root.find(kind) is not None]
        raise InputError(path, f"fmi: {name} is for {' and '.join(kinds)}, expected a unit for co-simulation")
    identifier = simulation.get("modelIdentifier", "")
    if not identifier or "/" in identifier or "\\" in identifier:
        problem = (
            f"fmi: {name}: CoSimulation: modelIdentifier is {identifier!r}, expected the name of its library"
        )
        raise InputError(path, problem, DAMAGED)
    _refuse_other_platforms(path, name, folder / name, f"binaries/{_PLATFORM[version]}/{identifier}.so")
    try:
        known = _variables(root, version)
    except ValueError as e:
        raise InputError(path, f"fmi: {name}: modelDescription.xml: {e}", DAMAGED) from e
    inputs = tuple(
        (signal, *_checked(path, f"inputs: {variable}", variable, known, "input", str(_unit_of(signal))))
        for variable, signal in fmi.inputs.items()
    )
    outputs = tuple(
        (out, *_checked(path, f"outputs: {out}", variable, known, "output", _OUTPUTS[out]))
        for out, variable in fmi.outputs.items()
    )
    for one, value in parameters.items():
        _refuse_parameter(path, one, value, known)
    settings = {
        one: (variable.reference, variable.type)
        for one, variable in known.items()
        if variable.causality == "parameter" and variable.type in _TYPES
    }
    token = root.get("guid" if version == 2 else "instantiationToken", "")
    messages = _messages(path, known) if fmi.osmp else {}
    wiring = adapter.Wiring(name, version, identifier, token, inputs, outputs, settings, fmi.reach, messages)
    needs_tool = simulation.get("needsExecutionTool") in ("true", "1")
    return (sys.executable, adapter.__file__, json.dumps(wiring._asdict())), needs_tool


def _unit_of(signal: str) -> str | None:
    """The unit of a signal, None where there is no such signal."""
    of_object = _SIGNAL.fullmatch(signal)
    return adapter.SIGNALS.get(signal) if of_object is None else adapter.OF_OBJECT.get(of_object[2])


def _description(path: Path, name: str, file: Path) -> tuple[Any, int]:
    """The description of a unit, and the version of FMI, 2 or 3."""
    try:
        with zipfile.ZipFile(file) as packed:
            raw = packed.read("modelDescription.xml")
        root = etree.fromstring(raw, etree.XMLParser(resolve_entities=False, no_network=True))
    except _UNREADABLE as e:
        problem = f"fmi: {name} is no functional mock-up unit: modelDescription.xml cannot be read ({e})"
        raise InputError(path, problem, DAMAGED) from e
    version = root.get("fmiVersion", "")
    if version[:2] not in ("2.", "3."):
        raise InputError(path, f"fmi: {name} is of FMI {version or 'without a version'}, expected FMI 2 or 3")
    return root, int(version[0])


def _refuse_other_platforms(path: Path, name: str, file: Path, binary: str) -> None:
    with zipfile.ZipFile(file) as packed:
        binaries = sorted(one for one in packed.namelist() if one.startswith("binaries/") and one[-1] != "/")
    if binary not in binaries:
        raise InputError(path, f"fmi: {name} has no {binary}; it has: {', '.join(binaries) or 'none'}")


def _variables(root: Any, version: int) -> dict[str, FmuVariable]:
    """The variables of a unit, by name. Raises ValueError, with the element, where its description is damaged."""
    found = {}
    defined = {
        one.get("name"): _typed(one, version, f"TypeDefinitions: type {k}").get("unit", "")
        for k, one in enumerate(root.iterfind("TypeDefinitions/*"), start=1)
    }
    for k, one in enumerate(root.iterfind("ModelVariables/*"), start=1):
        name, where = one.get("name"), f"ModelVariables: variable {k} ({one.get('name')})"
        if name is None:
            raise ValueError(f"ModelVariables: variable {k} has no name")
        kind = _typed(one, version, where)
        is_array = version == 3 and one.find("Dimension") is not None
        form = f"array of {kind.tag}" if is_array else kind.tag
        unit = kind.get("unit") or defined.get(kind.get("declaredType"), "")
        reference = _REFERENCE.fullmatch(one.get("valueReference", ""))
        if reference is None or int(reference[1]) >= 1 << 32:
            told = one.get("valueReference")
            is_ = "is missing" if told is None else f"is {told!r:.60}"
            raise ValueError(f"{where}: valueReference {is_}, expected a whole number below 2^32")
        found[name] = FmuVariable(int(reference[1]), form, one.get("causality", "local"), unit)
    return found


def _typed(one: Any, version: int, where: str) -> Any:
    """The element that says which type a variable, or a defined type, is: within it in FMI 2, itself in FMI 3."""
    kind = one.find("*") if version == 2 else one
    if kind is None:
        raise ValueError(f"{where} has no type, such as <Real/>")
    return kind


def _checked(
    path: Path, where: str, name: str, known: Mapping[str, FmuVariable], causality: str, unit: str
) -> tuple[int, str]:
    """Value reference and type of a variable that is to be an input or output in this unit."""
    if (found := known.get(name)) is None:
        there = [one for one, variable in known.items() if variable.causality == causality]
        near = did_you_mean(name, there) or f"; its {causality}s are: {', '.join(there) or 'none'}"
        raise InputError(path, f"fmi: {where}: the unit has no variable {name!r}{near}", REMEDY)
    if found.causality != causality:
        problem = f"fmi: {where}: {name!r} is of causality {found.causality}, expected {causality}"
        raise InputError(path, problem, REMEDY)
    fits = _NUMBERS if unit or causality == "output" else _TYPES
    if found.type not in fits:
        problem = f"fmi: {where}: {name!r} is of type {found.type}, expected one of {', '.join(sorted(fits))}"
        raise InputError(path, problem, REMEDY)
    if found.unit and _SAME.get(found.unit, found.unit) != unit and unit:
        raise InputError(path, f"fmi: {where}: {name!r} has the unit {found.unit}, expected {unit}", REMEDY)
    return found.reference, found.type


def _messages(path: Path, known: Mapping[str, FmuVariable]) -> dict[str, tuple[int, ...]]:
    """The value references of each message of OSMP that a unit has: of one variable, or of three integers."""
    found = {}
    for prefix, causality in _MESSAGES.items():
        names = [prefix] if prefix in known else [f"{prefix}.{part}" for part in _INTEGERS]
        there = [known[name] for name in names if name in known]
        if not there:
            continue
        expected = ("Binary", 1) if names == [prefix] else ("Integer", 3)
        if (there[0].type, len(there)) != expected or {one.causality for one in there} != {causality}:
            problem = (
                f"fmi: {prefix} is no message of OSMP, expected one variable of type Binary, or "
                f"{', '.join(_INTEGERS)} of type Integer, of causality {causality}"
            )
            raise InputError(path, problem, REMEDY)
        found[prefix] = tuple(one.reference for one in there)
    for prefix in [*_MESSAGES][:2]:
        if prefix not in found:
            has = sorted({name.split(".")[0] for name in known if name.startswith("OSMP")})
            problem = f"fmi: the unit has no {prefix}; its messages are: {', '.join(has) or 'none'}"
            raise InputError(path, problem, "Take a traffic participant model with one SensorView.")
    return found


def _refuse_parameter(path: Path, name: str, value: Any, known: Mapping[str, FmuVariable]) -> None:
    """Raise InputError for a parameter that cannot be set so."""
    found = known.get(name)
    if found is None or found.causality != "parameter":
        there = [one for one, variable in known.items() if variable.causality == "parameter"]
        near = did_you_mean(name, there) or f"; its parameters are: {', '.join(there) or 'none'}"
        raise InputError(path, f"parameters: the unit has no parameter {name!r}{near}", REMEDY)
    expected = bool if found.type == "Boolean" else int if found.type not in _NUMBERS else (int, float)
    if (
        found.type not in _TYPES
        or isinstance(value, bool) != (expected is bool)
        or not isinstance(value, expected)
    ):
        raise InputError(
            path, f"parameters: {name} = {value!r}, expected a number of type {found.type}", REMEDY
        )
