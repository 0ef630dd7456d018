"""A function that is a process of its own: asked as one in this process is, and nothing that it does hurts others."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import duckdb
import pytest
from conftest import ROOT

from resim.core.errors import FunctionError, InputError
from resim.jobs.function import check_function
from resim.simulation.function.interface import load_build

RECORDING = ROOT / "scenarios" / "rear_end"
FOLLOW = """
import os, sys, time
from resim.function import Command, serve

class Follow:
    def __init__(self, time_gap=1.5, how=""):
        self.gap, self.how = time_gap, how

    def reset(self, setup):
        self.wanted, self.asked = setup.start.v, 0
        if hasattr(setup.road, "lanes"):  # it is a process of its own
            assert len(setup.road.lanes) > 10 and os.path.isfile(setup.road.file)
            assert any(lane.after for lane in setup.road.lanes)
            assert all(lane.along is (lane.lane < 0) for lane in setup.road.lanes)  # traffic is on the right
        print("printed, which is no answer")

    def step(self, p):
        self.asked += 1
        if self.asked == 20 and self.how:
            exec(self.how)
        a = 0.4 * (self.wanted - p.ego.v)
        for x, y, v, length in zip(p.x_ego.tolist(), p.y_ego.tolist(), p.v.tolist(), p.length.tolist()):
            if x >= 0.0 and abs(y) <= 1.5:
                a = min(a, 0.25 * (x - 0.5 * length - 2.5 - 4.0 - self.gap * p.ego.v) + 0.8 * (v - p.ego.v))
        return Command(min(max(a, -8.0), 2.0), 0.0)

    def close(self):
        if "stay" in self.how:
            time.sleep(1e6)

if __name__ == "__main__":
    serve(Follow)
"""
HEAD = 'name = "follow"\nversion = "1"\n'
HERE = HEAD + 'factory = "follow:Follow"\n'
APART = HERE + f'[process]\npython = "{sys.executable}"\n'
COMMAND = HEAD + f'[process]\ncommand = ["{sys.executable}", "follow.py"]\n'
CPP = HEAD + '[process]\ncommand = ["./follow"]\n'


@pytest.fixture
def build(tmp_path: Path) -> Callable[..., Path]:
    (tmp_path / "follow.py").write_text(FOLLOW, encoding="utf-8")

    def write(text: str, name: str = "build", **parameters: object) -> Path:
        told = "".join(f"{key} = {value!r}\n" for key, value in parameters.items())
        path = tmp_path / f"{name}.toml"
        path.write_text(text + ("[parameters]\n" + told if told else ""), encoding="utf-8")
        return path

    return write


def run(path: Path, out: Path, *more: object) -> subprocess.CompletedProcess[str]:
    order = [
        sys.executable,
        "-m",
        "resim",
        "run",
        RECORDING,
        "--basis",
        "gt",
        "--build",
        path,
        "--out",
        out,
        *more,
    ]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(order, capture_output=True, text=True, check=False, timeout=200, env=env)


def tracks(out: Path) -> object:
    return duckdb.sql(f"select * from '{out}/tracks.parquet' where source = 'rGT'").fetchall()


def test_a_process_drives_as_the_same_class_does_here(build: Callable[..., Path], tmp_path: Path) -> None:
    """In Python, served from a file or by its class, and in C++."""
    compiler = shutil.which("c++") or shutil.which("g++")
    ways = {"here": HERE, "apart": APART, "command": COMMAND}
    if compiler is not None:
        header = ROOT / "resim" / "function"
        source = ROOT / "adfunc" / "cpp" / "follow.cpp"
        flags = ["-std=c++17", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
        subprocess.run([compiler, *flags, "-I", header, source, "-o", tmp_path / "follow"], check=True)
        ways["cpp"] = CPP
    found = {}
    for name, text in ways.items():
        path = build(text, name, time_gap=1.2)
        done = run(path, tmp_path / f"out_{name}")
        assert done.returncode in (0, 1), done.stderr
        found[name] = tracks(tmp_path / f"out_{name}")
        pinned = "not pinned" not in " ".join(done.stdout.split())
        assert pinned is (name == "here"), done.stdout
    assert all(one == found["here"] for one in found.values())
    assert len(found["here"]) > 100  # type: ignore[arg-type]


FAULTS = {
    "exit": (
        "sys.stderr.write('my last words'); sys.stderr.flush(); os._exit(7)",
        "ended its process with code 7",
    ),
    "signal": ("os.kill(os.getpid(), 11)", "ended its process by SIGSEGV"),
    "hang": ("time.sleep(1e6)", "did not answer within 0.5 s"),
    "error": ("raise ValueError('oh no')", "failed: ValueError: oh no"),
    "rubbish": ("os.write(3, b'hello world, this is rubbish')", "wrote b'hello world"),
    "no number": ("self.wanted = float('nan')", "answered acceleration nan, expected a finite number"),
    "a process of its own": (
        "subprocess = __import__('subprocess').Popen(['sleep', '1000'])",
        "left processes behind",
    ),
    "stay": ("pass  # and stay", "did not end within"),
}


OFTEN = ("exit", "hang", "rubbish", "a process of its own")  # the others in `make validate`


@pytest.mark.parametrize(
    "what", [pytest.param(what, marks=() if what in OFTEN else pytest.mark.slow) for what in FAULTS]
)
def test_what_a_process_does_costs_its_run(build: Callable[..., Path], tmp_path: Path, what: str) -> None:
    deed, why = FAULTS[what]
    text = marked(COMMAND, tmp_path).replace("[process]", "time_limit = 0.5\n[process]")
    done = run(build(text, how=deed), tmp_path / "out")
    assert (done.returncode, why in done.stderr) == (3, True), done.stderr
    assert "Traceback" not in done.stderr or what == "error", done.stderr
    if what == "exit":
        assert "my last words" in done.stderr
    assert (tmp_path / "out" / "run.json").is_file()
    assert not _running(tmp_path)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_no_process_outlives_its_command(build: Callable[..., Path], tmp_path: Path, how: int) -> None:
    path = build(
        marked(COMMAND, tmp_path).replace("[process]", "time_limit = 100.0\n[process]"), how="time.sleep(1e6)"
    )
    order = [sys.executable, "-m", "resim", "run", RECORDING, "--build", path, "--out", tmp_path / "out"]
    command = subprocess.Popen(order, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                               env={**os.environ, "PYTHONPATH": str(ROOT)})  # fmt: skip
    _wait(lambda: bool(_running(tmp_path)))
    command.send_signal(how)
    command.wait(30)
    _wait(lambda: not _running(tmp_path))


def _wait(what: Callable[[], bool]) -> None:
    until = time.monotonic() + 100.0
    while not what():
        assert time.monotonic() < until
        time.sleep(0.05)


def marked(text: str, folder: Path) -> str:
    """A build file whose command names the folder of the test, so that its processes are told from others'."""
    return text.replace('"follow.py"]', f'"follow.py", "{folder}"]')


def _running(folder: Path) -> list[str]:
    """Processes that serve a function of this test."""
    found = []
    for process in Path("/proc").iterdir():
        try:
            if process.name.isdigit() and str(folder) in (process / "cmdline").read_text().split("\0"):
                found.append(process.name)
        except OSError:
            pass
    return found


def test_its_hash_is_of_all_that_the_command_names(build: Callable[..., Path], tmp_path: Path) -> None:
    path = build(COMMAND)
    before = load_build(path).hash
    assert load_build(path).hash == before
    (tmp_path / "follow.py").write_text(FOLLOW.replace("0.4 *", "0.5 *"), encoding="utf-8")
    changed = load_build(path).hash
    assert changed != before
    program = tmp_path / "python"
    program.write_bytes(Path(sys.executable).resolve().read_bytes())
    program.chmod(0o755)
    (tmp_path / "elsewhere").mkdir()
    own = tmp_path / "elsewhere" / "own.toml"
    own.write_text(HEAD + '[process]\ncommand = ["../python", "-c", "pass"]\n')
    hashes = {load_build(own).hash}
    with program.open("ab") as file:
        file.write(b"\0")
    hashes.add(load_build(own).hash)
    assert len(hashes) == 2


WRONG = {
    "there is no program 'env/bin/python'. Make the environment": HEAD
    + '[process]\npython = "env/bin/python"\n',
    "there is no program 'nowhere'": HEAD + '[process]\ncommand = ["nowhere"]\n',
    "'./follow.py' is no program that you may execute": HEAD + '[process]\npython = "./follow.py"\n',
    "expected factory, or": HEAD,
    "expected command, or python": HEAD + "[process]\n",
    "factory and": HERE + '[process]\ncommand = ["true"]\n',
    "batches": HEAD + '[process]\ncommand = ["true"]\nbatches = "yes"\n',
}


@pytest.mark.parametrize("why", WRONG)
def test_a_file_that_names_no_program_is_refused(build: Callable[..., Path], why: str) -> None:
    text = WRONG[why].replace("[process]\npython", 'factory = "a:b"\n[process]\npython')
    with pytest.raises(InputError, match=r"build\.toml") as told:
        load_build(build(text))
    assert why in str(told.value)


BATCHED = FOLLOW.replace(
    "    def close",
    """    def reset_batch(self, setups):
        self.each = [Follow(self.gap) for _ in setups]
        for one, setup in zip(self.each, setups):
            one.reset(setup)

    def step_batch(self, lists):
        return [one.step(p) for one, p in zip(self.each, lists)]

    def close""",
)


@pytest.mark.slow
def test_a_process_may_answer_many_runs_at_once(build: Callable[..., Path], tmp_path: Path) -> None:
    path = build(COMMAND + "batches = true\n")
    (tmp_path / "follow.py").write_text(BATCHED, encoding="utf-8")
    found = {check.name: check for check in check_function(path).checks}
    assert found["batches"].holds, found["batches"].found
    wrong = BATCHED.replace("[one.step(p) for", "[one.step(p._replace(x_ego=p.x_ego + 1.0)) for")
    (tmp_path / "follow.py").write_text(wrong, encoding="utf-8")
    found = {check.name: check for check in check_function(path).checks}
    assert not found["batches"].holds
    ragged = BATCHED.replace(
        "[one.step(p) for",
        "[one.step(p)._replace(plan=[(p.t + k, 0, 0, 0) for k in range(2 + (one is self.each[0]))]) for",
    )
    (tmp_path / "follow.py").write_text(ragged, encoding="utf-8")
    found = {check.name: check for check in check_function(path).checks}
    assert "plans with different numbers of rows" in found["batches"].found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[one.step(p) for one, p in zip(self.each, lists)]", "[self.each[k].step(lists[k]) for k in (1, 2, 0)]"),
        ("[one.step(p) for one, p in zip(self.each, lists)]", "[one.step(lists[-1]) for one in self.each]"),
        ("zip(self.each, setups)", "zip(self.each, setups[:1] * 3)"),
    ],
)  # fmt: skip
def test_a_batch_that_mixes_up_its_runs_does_not_hold(
    build: Callable[..., Path], tmp_path: Path, old: str, new: str
) -> None:
    assert old in BATCHED
    (tmp_path / "follow.py").write_text(BATCHED.replace(old, new), encoding="utf-8")
    found = {check.name: check for check in check_function(build(COMMAND + "batches = true\n")).checks}
    assert not found["batches"].holds
    assert " of 3 at once, from " in found["batches"].found


CHECKED = {
    "units": "globals()['Command'] = lambda a, k: type('C', (), dict(acceleration=a, curvature=3.0, plan=None))",
    "determinism": "self.wanted = time.time() % 5.0",
    "clock": "self.wanted = 20.0 if time.monotonic() - self.begin < 0.5 else 0.0",
    "answers": "os._exit(3)",
}


@pytest.mark.parametrize("name", CHECKED)
def test_what_does_not_hold_is_found(build: Callable[..., Path], tmp_path: Path, name: str) -> None:
    source = FOLLOW.replace("if self.asked == 20 and self.how:", "if self.how:")
    source = source.replace(
        "self.wanted, self.asked =", "self.begin, self.wanted, self.asked = time.monotonic(),"
    )
    (tmp_path / "follow.py").write_text(source, encoding="utf-8")
    found = check_function(build(COMMAND, how=CHECKED[name]))
    broken = [check.name for check in found.checks if not check.holds]
    assert name in broken, found.checks


PLANNED = """
import itertools, os, pathlib, random
from resim.function import Command

class Follow:
    def __init__(self, lock=""):
        self.lock = pathlib.Path(lock)
    def reset(self, setup):
        {reset}
    def step(self, p):
        return Command(0.0, 0.0, [[p.t, 0.0, 0.0, {v}]])
    def close(self):
        {close}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reset", "v", "close"),
    [
        ("determinism", "pass", "random.random()", "pass"),
        (
            "clock",
            "import time; self.begin = time.monotonic()",
            "time.monotonic() - self.begin > 0.5",
            "pass",
        ),
        ("restart", "self.lock.touch(exist_ok=False)", "1.0", "self.lock.unlink()"),
    ],
)
def test_what_only_plans_or_a_restart_show_is_found(
    build: Callable[..., Path], tmp_path: Path, name: str, reset: str, v: str, close: str
) -> None:
    source = PLANNED.format(reset=reset, v=v.replace("time.", "__import__('time')."), close=close)
    (tmp_path / "follow.py").write_text(source, encoding="utf-8")
    checks = check_function(build(APART, lock=str(tmp_path / "lock"))).checks
    found = {check.name: check for check in checks}
    assert not found[name].holds, found


def test_what_resim_opens_for_a_process_is_not_told_of_its_code(
    build: Callable[..., Path], tmp_path: Path
) -> None:
    """As the guide has it: the environment beside the build file, and the command in their folder."""
    (tmp_path / "venv" / "bin").mkdir(parents=True)
    python = tmp_path / "venv" / "bin" / "python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    path = build(HEAD + 'factory = "follow:Follow"\n[process]\npython = "venv/bin/python"\n')
    order = [sys.executable, "-m", "resim", "run", RECORDING, "--basis", "gt", "--build", path.name]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "400"}
    done = subprocess.run(
        [*order, "--out", "out"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
        env=env,
    )
    assert done.returncode in (0, 1), done.stderr
    told = " ".join((done.stdout + done.stderr).split())
    assert "opened" not in told, told
    assert "what venv/bin/python loads beside the files of the build is not in its hash" in told


def test_a_check_does_not_print_the_tracebacks_that_it_asks_for(
    build: Callable[..., Path], capfd: pytest.CaptureFixture[str]
) -> None:
    found = check_function(build(COMMAND))
    assert found.good, found.checks
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.slow
def test_what_ships_holds() -> None:
    for name in ("highway_pilot-1.0", "idm-1.0", "constant_velocity-1.0"):
        found = check_function(ROOT / "adfunc" / "builds" / f"{name}.toml")
        assert found.good, found.checks
        assert {check.name for check in found.checks} >= {
            "answers",
            "units",
            "determinism",
            "clock",
            "latency",
            "batches",
        }


COUNTS = """
import os, pathlib
from resim.function import Command, serve

class Counts:
    def reset(self, setup):
        state = pathlib.Path("state.txt")
        self.before = int(state.read_text()) if state.exists() else 0
        state.write_text(str(self.before + 1))
        pathlib.Path("follow.py").write_text("")
        self.brake = float(os.environ.get("BRAKE", 0))

    def step(self, p):
        return Command(-1.0 * self.before - self.brake, 0.0)

    def close(self):
        pass

serve(Counts)
"""


@pytest.mark.slow
def test_no_run_finds_what_another_wrote_nor_variables_that_the_build_does_not_name(
    build: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = build(COMMAND)
    (tmp_path / "follow.py").write_text(COUNTS, encoding="utf-8")
    first = run(path, tmp_path / "one")
    monkeypatch.setenv("BRAKE", "6")
    again = run(path, tmp_path / "two")
    assert (first.returncode, again.returncode) == (0, 0), first.stderr + again.stderr
    assert tracks(tmp_path / "one") == tracks(tmp_path / "two")
    asks = build(COMMAND + 'environment = ["BRAKE"]\n', "asks")
    told = run(asks, tmp_path / "three")
    assert tracks(tmp_path / "three") != tracks(tmp_path / "one")
    assert "what BRAKE of the environment is" in " ".join(told.stdout.split())


def test_a_script_is_not_pinned_as_its_interpreter_is_not(build: Callable[..., Path], tmp_path: Path) -> None:
    script = tmp_path / "run.sh"
    script.write_text(f"#!/bin/sh\nexec {sys.executable} follow.py\n", encoding="utf-8")
    script.chmod(0o755)
    found = load_build(build(HEAD + '[process]\ncommand = ["./run.sh", "follow.py"]\n'))
    assert found.program is not None
    assert found.program.unpinned.startswith("what ./run.sh loads beside the files of the build")


@pytest.mark.slow
def test_a_package_of_resims_environment_is_not_that_of_the_environment_asked(
    build: Callable[..., Path], tmp_path: Path
) -> None:
    """`pyrate` is installed here, by a path, and in the other environment, where it brakes."""
    here, there = tmp_path / "here", tmp_path / "env"
    for place, brakes in ((here, "0.0"), (there / "lib", "-3.0")):
        package = place / "pyrate"
        package.mkdir(parents=True)
        (package / "__init__.py").write_text(
            "from resim.function import Command\nclass Own:\n    def reset(self, setup): pass\n"
            f"    def step(self, seen): return Command({brakes}, 0.0)\n    def close(self): pass\n"
        )
    python = there / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH={there / "lib"} exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    text = f'name = "own"\nversion = "1"\nfactory = "pyrate:Own"\n[process]\npython = "{python}"\n'
    env = {**os.environ, "PYTHONPATH": f"{ROOT}:{here}", "COLUMNS": "400"}
    out = tmp_path / "out"
    order = [
        sys.executable,
        "-m",
        "resim",
        "run",
        RECORDING,
        "--basis",
        "gt",
        "--build",
        build(text),
        "--out",
        out,
    ]
    done = subprocess.run(order, capture_output=True, text=True, check=False, timeout=200, env=env)
    assert done.returncode in (0, 1), done.stderr
    least = duckdb.sql(f"select min(acceleration) from '{out}/answers.parquet'").fetchall()
    assert least == [(-3.0,)]


def test_a_program_that_was_built_anew_is_not_run_under_the_old_hash(
    build: Callable[..., Path], tmp_path: Path
) -> None:
    tool = tmp_path / "elsewhere" / "python"
    tool.parent.mkdir()
    tool.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n', encoding="utf-8")
    tool.chmod(0o755)
    found = load_build(build(HEAD + f'[process]\ncommand = ["{tool}", "follow.py"]\n'))
    assert found.program is not None
    partner = found.program.partner()
    partner.start()
    partner.kill()
    other = tool.with_name("other")
    other.write_text(tool.read_text() + "# built anew\n", encoding="utf-8")
    other.chmod(0o755)
    other.replace(tool)
    with pytest.raises(FunctionError, match="has changed since it was first read"):
        found.program.partner().start()


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        ("{'acceleration': 0.0, 'curvature': 0.0}, twice=True", "wrote more than one answer to a message"),
        *(
            pytest.param(answer, "expected acceleration, curvature and plan", marks=pytest.mark.slow)
            for answer in (
                "{'acceleration': True, 'curvature': 0.0}",
                "{'acceleration': 0.0, 'curvature': 0.0, 'plan': [['0', '1', '2', '3']]}",
            )
        ),
    ],
)
def test_an_answer_too_many_or_of_another_kind_is_refused(
    build: Callable[..., Path], tmp_path: Path, answer: str, why: str
) -> None:
    path = build(COMMAND)
    (tmp_path / "follow.py").write_text(
        "import struct, sys, msgpack\n"
        "def tell(told, twice=False):\n"
        "    body = msgpack.packb(told)\n"
        "    sys.stdout.buffer.write((struct.pack('<I', len(body)) + body) * (2 if twice else 1))\n"
        "    sys.stdout.buffer.flush()\n"
        "while head := sys.stdin.buffer.read(4):\n"
        "    asked = msgpack.unpackb(sys.stdin.buffer.read(struct.unpack('<I', head)[0]))['message']\n"
        "    if asked == 'close':\n"
        "        break\n"
        "    if asked == 'reset':\n"
        "        tell({'protocol': 1})\n"
        "    else:\n"
        f"        tell({answer})\n",
        encoding="utf-8",
    )
    done = run(path, tmp_path / "out")
    assert done.returncode == 3
    assert why in done.stderr


@pytest.mark.slow
def test_a_verification_says_once_that_a_build_is_not_pinned(
    build: Callable[..., Path], tmp_path: Path
) -> None:
    suite = tmp_path / "suite.toml"
    named = (f'[[recording]]\nfolder = "{ROOT}/scenarios/{name}"\n' for name in ("cut_in_brake", "overtake"))
    suite.write_text(
        f'name = "two"\ncriteria = "{ROOT}/scenarios/criteria/highway.toml"\nbases = ["GT"]\n'
        + "".join(named)
    )
    order = ["verify", suite, "--build", build(APART, time_gap=1.2), "--driven-by"]
    order += ["highway_pilot-1.0", "--out", tmp_path / "out", "--workers", "1"]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "400"}
    done = subprocess.run(
        [sys.executable, "-m", "resim", *order],
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
        env=env,
    )
    assert done.stdout.count("not pinned") == 1, done.stdout + done.stderr
    assert "2 of 2 recordings: note: " in done.stdout


@pytest.mark.parametrize(
    ("factory", "why"),
    [
        ("follow:Folow", "AttributeError: module 'follow' has no attribute 'Folow'"),
        pytest.param("folow:Follow", "ModuleNotFoundError: No module named 'folow'", marks=pytest.mark.slow),
    ],
)
def test_a_class_that_is_not_there_is_told_as_the_reason(
    build: Callable[..., Path], tmp_path: Path, factory: str, why: str
) -> None:
    path = build(
        f'name = "f"\nversion = "1"\nfactory = "{factory}"\n[process]\npython = "{sys.executable}"\n'
    )
    done = run(path, tmp_path / "out")
    assert done.returncode == 3
    assert why in done.stderr


@pytest.mark.slow
def test_a_run_that_rewrites_the_copy_of_its_program_stops_the_next_one(
    build: Callable[..., Path], tmp_path: Path
) -> None:
    """Both are of one user, so nothing keeps it from writing there; what it wrote is not run under the old hash."""
    (tmp_path / "talk.py").write_text(
        "import glob, os\n"
        "from resim.function import Command, serve\n"
        "class Rewrites:\n"
        "    def reset(self, setup):\n"
        "        for file in glob.glob(os.environ['CACHE'] + '/resim/inputs/*/home/talk.py'):\n"
        "            os.chmod(file, 0o755)\n"
        "            text = open(file).read()\n"
        "            open(file, 'w').write(text.replace('Command(0' + '.0', 'Command(-3' + '.0'))\n"
        "    def step(self, p):\n"
        "        return Command(0.0, 0.0)\n"
        "    def close(self):\n"
        "        pass\n"
        "serve(Rewrites)\n",
        encoding="utf-8",
    )
    command = f'command = ["{sys.executable}", "talk.py"]\nenvironment = ["CACHE", "PYTHONPATH"]\n'
    path = build(f'name = "r"\nversion = "1"\n[process]\n{command}')
    cache = tmp_path / "cache"
    order = [sys.executable, "-m", "resim", "run", RECORDING, "--build", path, "--out", tmp_path / "out"]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(cache), "CACHE": str(cache)}
    done = subprocess.run(order, capture_output=True, text=True, check=False, timeout=200, env=env)
    assert done.returncode == 3
    assert "rSD: r-1" in done.stderr
    assert "the copy of its file 'talk.py' has changed since it was made" in done.stderr
