"""A co-simulation unit as a function: it drives as the same function in Python does, and costs its run alone."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pages
import pytest
from conftest import ROOT

from resim.core.errors import InputError
from resim.function import EgoState, ObjectList
from resim.function.fmi import FmuFunction, Wiring, lead_of, wiring_of
from resim.jobs.function import check_function
from resim.simulation.function import fmu
from resim.simulation.function.interface import load_build
from resim.simulation.function.program import FunctionProgram

FMPY = importlib.util.find_spec("fmpy")
if FMPY is None or FMPY.origin is None or shutil.which("cc") is None:
    pytest.skip("needs FMPy and a C compiler", allow_module_level=True)
HEADERS = Path(FMPY.origin).parent / "c-code"
HERE = Path(__file__).parent
RECORDING = ROOT / "scenarios" / "rear_end"
FMI2 = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="follow" guid="{follow}"><CoSimulation modelIdentifier="follow"/>
<!-- a comment --><TypeDefinitions><SimpleType name="length"><Real unit="m"/></SimpleType></TypeDefinitions>
<ModelVariables>
<ScalarVariable name="v_ego" valueReference="0" causality="input"><Real start="0" unit="m/s"/></ScalarVariable>
<ScalarVariable name="gap" valueReference="1" causality="input"><Real start="0" declaredType="length"/></ScalarVariable>
<ScalarVariable name="v_lead" valueReference="2" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="lead" valueReference="0" causality="input"><Boolean start="false"/></ScalarVariable>
<ScalarVariable name="in_km_h" valueReference="2" causality="input"><Real start="0" unit="km/h"/></ScalarVariable>
<ScalarVariable name="time_gap" valueReference="3" causality="parameter"><Real start="1.5"/></ScalarVariable>
<ScalarVariable name="fault" valueReference="0" causality="parameter"><Integer start="0"/></ScalarVariable>
<ScalarVariable name="a_wanted" valueReference="4" causality="output"><Real unit="m/s2"/></ScalarVariable>
</ModelVariables></fmiModelDescription>"""
FMI3 = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="3.0" modelName="follow" instantiationToken="{follow}">
<CoSimulation modelIdentifier="follow"/><ModelVariables>
<Float64 name="v_ego" valueReference="0" causality="input" start="0" unit="m/s"/>
<Float64 name="gap" valueReference="1" causality="input" start="0"/>
<Float64 name="v_lead" valueReference="2" causality="input" start="0"/>
<Boolean name="lead" valueReference="10" causality="input" start="false"/>
<Float64 name="many" valueReference="11" causality="input" start="0 0"><Dimension start="2"/></Float64>
<Float64 name="time_gap" valueReference="3" causality="parameter" start="1.5"/>
<Float64 name="a_wanted" valueReference="4" causality="output"/>
</ModelVariables></fmiModelDescription>"""
BUILD = """name = "follow"
version = "1"
{top}
[fmi]
file = "follow.fmu"
[fmi.inputs]
v_ego = "ego.v"
gap = "lead.gap"
v_lead = "lead.v"
lead = "lead.exists"
[fmi.outputs]
acceleration = "a_wanted"
[parameters]
{parameters}
"""
PYTHON = """
from resim.function import Command
from resim.function.fmi import lead_of

class Follow:
    def reset(self, setup):
        self.size = setup.length, setup.width

    def step(self, p):
        gap, v, exists = lead_of(p, *self.size, 200.0)
        a = 0.4 * (25.0 - p.ego.v)
        if exists:
            a = min(a, 0.25 * (gap - 4.0 - 1.2 * p.ego.v) + 0.8 * (v - p.ego.v))
        return Command(min(max(a, -8.0), 2.0), 0.0)

    def close(self):
        pass
"""


def unit(
    folder: Path, version: int = 2, description: str = "", binary: bytes = b"", change: tuple[str, str] = ("", "")
) -> Path:  # fmt: skip
    """A build of the unit of FMI 2 or 3; binary: in place of compiling it; change: of its source, old and new."""
    folder.mkdir(exist_ok=True)
    library = folder / "follow.so"
    if binary:
        library.write_bytes(binary)
    else:
        header = (HEADERS / f"fmi{version}Functions.h").read_text(encoding="utf-8")
        names = re.findall(rf"^#define (fmi{version}\w+) +fmi{version}FullName", header, re.MULTILINE)
        others = folder / "others.c"  # every unit has all functions of the standard
        others.write_text(
            "".join(f"__attribute__((weak)) int {name}(void) {{ return 3; }}\n" for name in names)
        )
        source = folder / "follow.c"
        source.write_text((HERE / f"fmi{version}_follow.c").read_text(encoding="utf-8").replace(*change))
        flags = ["-O1", "-ffp-contract=off", "-shared", "-fPIC", "-I", HEADERS]
        subprocess.run(["cc", *flags, source, others, "-o", library], check=True)
    place = {2: "linux64", 3: "x86_64-linux"}[version]
    # of 1980: the same content gives the same bytes
    with zipfile.ZipFile(folder / "follow.fmu", "w") as packed:
        packed.writestr(zipfile.ZipInfo("modelDescription.xml"), description or {2: FMI2, 3: FMI3}[version])
        packed.writestr(zipfile.ZipInfo(f"binaries/{place}/follow.so"), library.read_bytes())
    library.unlink()
    return build(folder)


def build(folder: Path, top: str = "", parameters: str = "time_gap = 1.2", text: str = BUILD) -> Path:
    path = folder / "follow.toml"
    path.write_text(text.format(top=top, parameters=parameters), encoding="utf-8")
    return path


def run(path: Path, out: Path) -> subprocess.CompletedProcess[str]:
    order = [sys.executable, "-m", "resim", "run", RECORDING, "--basis", "gt", "--build", path, "--out", out]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "400"}
    return subprocess.run(order, capture_output=True, text=True, check=False, timeout=200, env=env)


@pytest.fixture(scope="module")
def unit2(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return unit(tmp_path_factory.mktemp("unit2"))


@pytest.mark.slow
def test_a_unit_drives_as_the_same_function_in_python_does(unit2: Path, tmp_path: Path) -> None:
    (tmp_path / "follow.py").write_text(PYTHON, encoding="utf-8")
    here = tmp_path / "here.toml"
    here.write_text('name = "follow"\nversion = "1"\nfactory = "follow:Follow"\n', encoding="utf-8")
    tables = []
    for name, path in (("here", here), ("two", build(unit2.parent)), ("three", unit(tmp_path / "three", 3))):
        done = run(path, tmp_path / f"out_{name}")
        assert done.returncode in (0, 1), done.stderr
        assert ("not pinned" in " ".join(done.stdout.split())) is (name != "here"), done.stdout
        tables.append((tmp_path / f"out_{name}" / "tracks.parquet").read_bytes())
    assert tables[0] == tables[1] == tables[2]
    assert check_function(build(unit2.parent)).good


@pytest.mark.slow
def test_the_guides_example_holds(unit2: Path) -> None:
    said = pages.named(ROOT / "docs" / "guides" / "outside.md", "toml")["unit.toml"]
    path = unit2.with_name("unit.toml")
    path.write_text(said, encoding="utf-8")
    found = check_function(path)
    assert found.good, found.checks


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        (1, "ended its process by SIGABRT"),
        (2, "did not answer within 0.5 s"),
        (3, "fmi2DoStep gave the status 3 (error); the unit says: no plan for a gap of 80 m at step 20"),
    ],
)
@pytest.mark.slow
def test_what_a_unit_does_costs_its_run(unit2: Path, tmp_path: Path, fault: int, why: str) -> None:
    done = run(build(unit2.parent, "time_limit = 0.5", f"fault = {fault}"), tmp_path / "out")
    assert (done.returncode, why in done.stderr) == (3, True), done.stderr
    assert (tmp_path / "out" / "run.json").is_file()


STEP = "    double *x = unit->real, a"
GET = "value[i] = ((Unit *)c)->real[vr[i]];"
EXIT = "ExitInitializationMode(fmi3Instance c) { return fmi3OK"
SAYS = "static int k; if (k++ > 9) { *event = *terminate = *early = 0; *last = t + step; "
UNDONE = [
    (3, (STEP, SAYS + "*early = 1; *last = t; return 0; }" + STEP), "earlyReturn = true"),
    (3, (STEP, SAYS + "*last = t; return 0; }" + STEP), "did not do its whole step until 0.44 s"),
    (3, (STEP, SAYS + "*last = 0.0 / 0.0; return 0; }" + STEP), "lastSuccessfulTime = nan"),
    (3, (STEP, SAYS + "*event = 1; return 0; }" + STEP), "asked for its event mode"),
    (3, (STEP, SAYS + "*terminate = 1; return 0; }" + STEP), "asked to terminate the simulation"),
    (3, (STEP, SAYS + "return -1; }" + STEP), "fmi3DoStep gave the status -1"),
    (2, (STEP, "static int k; if (k++ > 9) return -1;" + STEP), "fmi2DoStep gave the status -1"),
    (2, (GET, GET + " static int k; if (k++ > 9) return -2;"), "fmi2GetReal gave the status -2"),
    (3, (GET, GET + " static int k; if (k++ > 9) return -2;"), "fmi3GetFloat64 gave the status -2"),
    (3, (EXIT, EXIT.replace("fmi3OK", "-3")), "fmi3ExitInitializationMode gave the status -3"),
]  # fmt: skip


@pytest.mark.parametrize(("version", "change", "why"), UNDONE)
def test_a_unit_that_did_not_do_its_step_fails_by_name(
    tmp_path: Path, version: int, change: tuple[str, str], why: str
) -> None:
    checks = check_function(unit(tmp_path, version, change=change)).checks
    assert any(why in check.found for check in checks if not check.holds), checks


@pytest.mark.slow
def test_a_unit_that_fails_to_terminate_is_told_by_its_error(tmp_path: Path) -> None:
    end = "fmi2Terminate(fmi2Component c) { return fmi2"
    done = run(unit(tmp_path, change=(f"{end}OK", f"{end}Error")), tmp_path / "out")
    assert done.returncode == 3
    assert "on closing failed: RuntimeError: fmi2Terminate gave the status 3 (error)" in done.stderr, (
        done.stderr
    )


def test_what_a_unit_says_is_kept_with_its_run(unit2: Path, tmp_path: Path) -> None:
    run(build(unit2.parent, "time_limit = 0.5", "fault = 3"), tmp_path / "out")
    words = (tmp_path / "out" / "rGT.words.txt").read_text(encoding="utf-8")
    assert "the unit, error: no plan for a gap of 80 m at step 20" in words


SAY = 'static int k; if (k++ > 9) {{ ((Unit *)c)->say(0, {}, "all", {}); return {}; }}' + STEP
MADE = "    unit->real[TIME_GAP] = 1.5;\n"
SAID = [
    (3, (STEP, SAY.format("fmi3Error", '"no gap"', 3)), "3 (error); the unit says: no gap"),
    (3, (STEP, SAY.format("fmi3OK", '"well"', 3)), "fmi3DoStep gave the status 3 (error)"),
    (3, (STEP, SAY.format("fmi3Warning", "0", 4)), "fmi3DoStep gave the status 4 (fatal)"),
    (3, (STEP, SAY.format("9", '"\\xff"', 2)), "2 (discard); the unit says: \ufffd"),
    (2, (MADE, MADE + 'functions->logger(0, name, fmi2Fatal, "all", "no %s", "key"); return 0;'),
     "the unit made no instance; the unit says: no key"),
]  # fmt: skip


@pytest.mark.parametrize(("version", "change", "why"), SAID)
def test_the_last_complaint_of_a_unit_is_told_with_the_call_that_fails(
    tmp_path: Path, version: int, change: tuple[str, str], why: str
) -> None:
    checks = check_function(unit(tmp_path, version, change=change)).checks
    assert any(why in check.found for check in checks if not check.holds), checks


def test_a_library_that_cannot_be_loaded_costs_the_run(tmp_path: Path) -> None:
    (check,) = check_function(unit(tmp_path, binary=b"no library")).checks
    assert "failed: " in check.found


WRONG = {
    "inputs: v_eg: the unit has no variable 'v_eg', did you mean 'v_ego'?": ('v_ego = "', 'v_eg = "'),
    "outputs: acceleration: the unit has no variable 'a'; its outputs are: a_wanted": ('"a_wanted"', '"a"'),
    "'a_wanted' is of causality output, expected input": ('gap = "', 'a_wanted = "'),
    "'lead' is of type Boolean, expected one of Float32": ('"lead.exists"', '"lead.v"'),
    "there is no signal 'lead.gab', did you mean 'lead.gap'?": ('"lead.gap"', '"lead.gab"'),
    "'in_km_h' has the unit km/h, expected m/s": ("v_lead =", "in_km_h ="),
    "'gap' has the unit m, expected m/s": ('"lead.gap"', '"lead.v"'),
    "acceleration is missing": ("acceleration =", "curvature ="),
    "fmi.outputs: a name is 'accel', expected 'acceleration' or 'curvature'": ("acceleration =", "accel ="),
    '[fmi] has file = "unit.fmu"; [fmi.inputs] variable': ("file =", "fil ="),
    "the unit has no parameter 'time_gab', did you mean 'time_gap'?": ("time_gap", "time_gab"),
    "time_gap = 'long', expected a number of type Real": ("time_gap = 1.2", 'time_gap = "long"'),
    "'../follow.fmu' is not beside the build file": ('"follow.fmu"', '"../follow.fmu"'),
    "fmi.file: 'other.fmu' is not a file beside it": ('"follow.fmu"', '"other.fmu"'),
}


@pytest.mark.parametrize("why", WRONG)
def test_a_build_that_does_not_fit_the_unit_is_refused(unit2: Path, why: str) -> None:
    text = BUILD.replace("{parameters}", "time_gap = 1.2").replace(*WRONG[why])
    with pytest.raises(InputError, match=r"follow\.toml") as told:
        load_build(build(unit2.parent, text=text))
    assert why in str(told.value)


@pytest.mark.parametrize(
    ("version", "old", "new", "why"),
    [
        (2, "CoSimulation", "ModelExchange", "follow.fmu is for ModelExchange, expected a unit for co-simulation"),
        (2, 'fmiVersion="2.0"', 'fmiVersion="1.0"', "is of FMI 1.0, expected FMI 2 or 3"),
        (2, 'Identifier="follow"', 'Identifier="f"', "has no binaries/linux64/f.so; it has: binaries/linux64/follow"),
        (2, "</fmiModelDescription>", "", "is no functional mock-up unit"),
        (2, 'Identifier="follow"', 'Identifier="../follow"', "modelIdentifier is '../follow'"),
        (2, ' modelIdentifier="follow"', '', "modelIdentifier is '', expected the name of its library"),
        (2, 'valueReference="1"', 'valueReference="one"', "valueReference is 'one', expected"),
        (2, 'valueReference="1"', 'valueReference="4294967296"', "valueReference is '4294967296', expected"),
        (2, 'valueReference="1"', '', "valueReference is missing, expected a whole number"),
        (3, 'valueReference="1"', 'valueReference="-1"', "valueReference is '-1', expected a whole number"),
        (2, '<ModelVariables>', '<ModelVariables><ScalarVariable name="a"/>', "variable 1 (a) has no type"),
        (2, '<ModelVariables>', '<ModelVariables><ScalarVariable valueReference="90"/>', "variable 1 has no name"),
        (2, '</TypeDefinitions>', '<SimpleType name="x"/></TypeDefinitions>', "type 2 has no type"),
        (3, 'name="gap"', 'name="gab"', "the unit has no variable 'gap'"),
        (3, 'name="many"', 'name="gap"', "'gap' is of type array of Float64"),
    ],
)  # fmt: skip
def test_a_unit_of_another_kind_is_refused(
    tmp_path: Path, version: int, old: str, new: str, why: str
) -> None:
    description = {2: FMI2, 3: FMI3}[version].replace(old, new)
    with pytest.raises(InputError, match=r"follow\.toml") as told:
        load_build(unit(tmp_path, version, description, b"none"))
    assert why in str(told.value)


def _method(packed: bytearray) -> None:
    packed[8:10] = b"\x63\0"
    central = packed.find(b"PK\1\2")
    packed[central + 10 : central + 12] = b"\x63\0"


def _encrypted(packed: bytearray) -> None:
    packed[6] |= 1
    packed[packed.find(b"PK\1\2") + 8] |= 1


def _flipped(packed: bytearray) -> None:
    packed[60] ^= 0xFF
    packed[70] ^= 0xFF


@pytest.mark.parametrize("damage", [_method, _encrypted, _flipped])
def test_a_unit_that_cannot_be_unpacked_is_refused(
    tmp_path: Path, damage: Callable[[bytearray], None]
) -> None:
    with zipfile.ZipFile(tmp_path / "follow.fmu", "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("modelDescription.xml", FMI2)
    packed = bytearray((tmp_path / "follow.fmu").read_bytes())
    damage(packed)
    (tmp_path / "follow.fmu").write_bytes(packed)
    with pytest.raises(
        InputError, match=r"follow\.fmu is no functional .* cannot be read \(.*\)\. Export the unit again"
    ):
        load_build(build(tmp_path))


def test_the_hash_covers_the_unit(tmp_path: Path) -> None:
    hashes = {load_build(unit(tmp_path, binary=content)).hash for content in (b"one", b"two", b"one")}
    assert len(hashes) == 2


def test_what_a_unit_needs_or_loads_is_not_pinned(tmp_path: Path) -> None:
    needs = FMI2.replace("<CoSimulation ", '<CoSimulation needsExecutionTool="true" ')
    for description, what in (
        (needs, "the tool that follow.fmu needs"),
        (FMI2, "what follow.fmu loads beside the files of the build"),
    ):
        program = load_build(unit(tmp_path, 2, description, b"none")).program
        assert program is not None
        assert program.unpinned == f"{what} is not in its hash: not pinned"


def test_without_fmpy_its_install_is_told(unit2: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs FMPy. In resim's own folder: pip install '.\[fmi\]'"):
        load_build(build(unit2.parent))


def test_a_parameter_that_the_build_does_not_set_may_be_swept(unit2: Path) -> None:
    program = load_build(build(unit2.parent, parameters="")).program
    assert isinstance(program, FunctionProgram)
    assert set(wiring_of(program.command[-1]).parameters) == {"time_gap", "fault"}


def seen(x: list[float], y: list[float], yaw_rate: float = 0.0) -> ObjectList:
    n = len(x)
    ego = EgoState(0.0, 0.0, 0.0, 20.0, 0.0, yaw_rate)
    ids = np.array([str(k) for k in range(n)])
    columns = (np.array(x), np.array(y), np.zeros(n), 10.0 + np.arange(n), np.full(n, 4.0), np.full(n, 2.0))
    return ObjectList(0.0, ego, ids, ids, *columns, np.zeros(n))


@pytest.mark.parametrize(
    ("x", "y", "yaw_rate", "expected"),
    [
        ([30.0, 20.0, -10.0], [0.0, 0.5, 0.0], 0.0, (16.0, 11.0, True)),
        ([20.0, 30.0], [1.9, 2.1], 0.0, (16.0, 10.0, True)),
        ([20.0], [2.1], 0.0, (100.0, 20.0, False)),
        ([150.0], [0.0], 0.0, (100.0, 20.0, False)),
        (
            [40.0, 60.0],
            [0.0, 9.0],
            0.1,
            (55.794, 11.0, True),
        ),  # the bend of 200 m goes 4 m, and 9 m to the left, where it is turned by 0.3 rad
        ([], [], 0.0, (100.0, 20.0, False)),
    ],
)
def test_the_lead_vehicle_is_the_next_in_the_corridor(
    x: list[float], y: list[float], yaw_rate: float, expected: tuple[float, float, bool]
) -> None:
    assert lead_of(seen(x, y, yaw_rate), 4.0, 2.0, 100.0) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(
    ("y", "heading", "expected"),
    [
        (5.0, 0.5 * np.pi, (30.0 - 2.35 - 1.25, 0.0, True)),  # its front is 1 m over the EGO's centre line
        (0.0, 0.5 * np.pi, (30.0 - 2.35 - 1.25, 0.0, True)),
        (0.0, np.pi, (30.0 - 2.35 - 6.0, 0.0, True)),
        (7.5, 0.5 * np.pi, (200.0, 20.0, False)),
        (
            0.0,
            0.25 * np.pi,
            (30.0 - 2.35 - 1.25 * 2.0**0.5 - 0.95, 0.0, True),
        ),  # by its side, at the corridor's edge
    ],
)
def test_a_lead_vehicle_is_as_it_is_turned(
    y: float, heading: float, expected: tuple[float, float, bool]
) -> None:
    truck = seen([30.0], [y])._replace(
        heading_ego=np.array([heading]), v=np.zeros(1), length=np.array([12.0]), width=np.array([2.5])
    )
    assert lead_of(truck, 4.7, 1.9, 200.0) == pytest.approx(expected, abs=1e-9)


def test_objects_are_told_by_how_near_they_are() -> None:
    names = [f"object[{k}].{name}" for k in range(3) for name in ("x", "y", "v", "exists")]
    inputs = tuple((name, k, "Real") for k, name in enumerate(names))
    function = FmuFunction(Wiring("", 2, "", "", inputs, (), {}, 100.0, {}))
    function._length, function._width = 4.0, 2.0
    found = function._signals(seen([30.0, -10.0], [1.0, 2.0]))
    assert [found[name] for name in names] == [
        -10.0,
        2.0,
        11.0,
        True,
        30.0,
        1.0,
        10.0,
        True,
        100.0,
        0.0,
        0.0,
        False,
    ]
