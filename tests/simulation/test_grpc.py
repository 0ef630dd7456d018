"""A function that is asked over gRPC: it drives as the process does that is relayed, and costs its run alone."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st
from processes import below
from simulation.test_process import COMMAND, FOLLOW, HEAD

from resim.core.errors import InputError
from resim.function import packed
from resim.jobs.function import check_function
from resim.simulation.function import grpc_wire
from resim.simulation.function.grpc_wire import METHOD, decode, encode
from resim.simulation.function.interface import load_build

grpc: Any = pytest.importorskip("grpc")
RECORDING = ROOT / "scenarios" / "rear_end"


@pytest.fixture
def process(tmp_path: Path) -> Path:
    """A process build."""
    (tmp_path / "follow.py").write_text(FOLLOW, encoding="utf-8")
    return written(tmp_path / "process.toml", COMMAND)


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def served_at(folder: Path, address: str, more: str = "", top: str = "") -> Path:
    return written(folder / "served.toml", f'{HEAD}{top}[grpc]\naddress = "{address}"\n{more}')


@contextmanager
def server(build: Path, *more: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A server of a build, at a port that was free: its address and process."""
    order = [sys.executable, "-m", "resim", "function", "serve", str(build)]
    started = subprocess.Popen(
        [*order, *(more or ("--address", "127.0.0.1:0"))],
        stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    try:
        assert started.stdout is not None
        head, _, address = started.stdout.readline().strip().rpartition(" ")
        assert head == "listens on"
        yield address, started
    finally:
        started.send_signal(signal.SIGCONT)
        started.terminate()
        started.wait(20)
        assert started.stdout is not None
        started.stdout.close()


def run(path: Path, out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    order = [sys.executable, "-m", "resim", "run", RECORDING, "--basis", "gt", "--build", path, "--out", out]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "400"}
    return subprocess.run([*order, *more], capture_output=True, text=True, check=False, timeout=200, env=env)


def wait(what: Callable[[], bool]) -> None:
    until = time.monotonic() + 30.0
    while not what():
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.slow
def test_it_drives_as_the_process_does_also_two_runs_at_once(process: Path, tmp_path: Path) -> None:
    assert run(process, tmp_path / "alone").returncode in (0, 1)
    tables = ("tracks", "answers", "plans")
    expected = [(tmp_path / "alone" / f"{table}.parquet").read_bytes() for table in tables]
    with server(process) as (address, relay), ThreadPoolExecutor() as pool:
        assert address.startswith("127.0.0.1:")
        build = served_at(tmp_path, address)
        outs = [tmp_path / "one", tmp_path / "two"]
        for out, done in zip(outs, pool.map(lambda out: run(build, out), outs), strict=True):
            assert done.returncode in (0, 1), done.stderr
            assert [(out / f"{table}.parquet").read_bytes() for table in tables] == expected
            assert f"what answers at {address} is not in its hash: not pinned" in " ".join(
                done.stdout.split()
            )
        assert not served(relay)
    assert relay.returncode == 128 + signal.SIGTERM


FAULTS = {
    "exit": ("os._exit(7)", "ended its process with code 7"),
    "hang": ("time.sleep(1e6)", "did not answer within 0.5 s"),
    "rubbish": ("os.write(3, b'hello world, this is rubbish')", "wrote b'hello world"),
    "child": ("__import__('subprocess').Popen(['sleep', '1000']); os._exit(7)", "with code 7"),
    "stay": ("pass  # and stay", "did not end within 5 s"),
}


@pytest.mark.parametrize("some", [("exit",), pytest.param(tuple(FAULTS)[1:], marks=pytest.mark.slow)])
def test_what_a_served_function_does_costs_its_run(
    process: Path, tmp_path: Path, some: tuple[str, ...]
) -> None:
    with server(process) as (address, relay):
        for what in some:
            deed, why = FAULTS[what]
            build = served_at(tmp_path, address, f"[parameters]\nhow = {deed!r}\n", "time_limit = 0.5\n")
            done = run(build, tmp_path / f"out {what}")
            assert (done.returncode, why in done.stderr) == (3, True), done.stderr
            assert "Traceback" not in done.stderr, done.stderr
            assert (tmp_path / f"out {what}" / "run.json").is_file()
            wait(lambda: not served(relay))
        assert run(served_at(tmp_path, address), tmp_path / "after").returncode in (0, 1)


@pytest.mark.slow
def test_a_server_that_is_absent_killed_or_stopped_costs_the_run(process: Path, tmp_path: Path) -> None:
    with ExitStack() as stack:
        address, relay = stack.enter_context(server(process))
        for number, why in ((signal.SIGSTOP, "did not answer within 2 s"), (signal.SIGKILL, "was lost")):
            deed = f"[parameters]\nhow = 'os.kill({relay.pid}, {int(number)}); time.sleep(60.0)'\n"
            done = run(served_at(tmp_path, address, deed, "time_limit = 2.0\n"), tmp_path / number.name)
            assert (done.returncode, why in done.stderr) == (3, True), done.stderr
            relay.send_signal(signal.SIGCONT)
    done = run(served_at(tmp_path, address), tmp_path / "absent")
    assert done.returncode == 3
    assert f"cannot be reached: no server answers at {address}" in done.stderr


@pytest.mark.slow
def test_a_command_that_is_killed_leaves_no_process_with_the_server(process: Path, tmp_path: Path) -> None:
    with server(process) as (address, relay):
        build = served_at(
            tmp_path, address, "[parameters]\nhow = 'time.sleep(1e6)'\n", "time_limit = 100.0\n"
        )
        order = [sys.executable, "-m", "resim", "run", RECORDING, "--build", build, "--out", tmp_path / "out"]
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        command = subprocess.Popen(order, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env)
        wait(lambda: bool(served(relay)))
        command.kill()
        command.wait(30)
        wait(lambda: not served(relay))


def test_a_server_that_is_killed_leaves_no_process_behind(process: Path, tmp_path: Path) -> None:
    how = """[parameters]\nhow = "__import__('subprocess').Popen(['sleep', '1000']); time.sleep(1e6)"\n"""
    with server(process) as (address, relay):
        build = served_at(tmp_path, address, how, "time_limit = 100.0\n")
        order = [sys.executable, "-m", "resim", "run", RECORDING, "--build", build, "--out", tmp_path / "out"]
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        command = subprocess.Popen(order, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env)
        wait(lambda: len(served(relay)) == 2)
        everybody = below(relay.pid)
        relay.kill()
        assert command.wait(60) == 3
        wait(lambda: not any(alive(number) for number in everybody))


def served(relay: subprocess.Popen[str]) -> list[int]:
    """The processes below a server but its guard, which is the first of them."""
    guard = min(below(relay.pid))
    return [number for number in below(relay.pid) if number != guard]


def alive(number: int) -> bool:
    """Whether a process is there, and not only its end, of which nobody took note."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_the_server_listens_on_loopback_alone(process: Path) -> None:
    with server(process, "--address", "localhost:0") as (address, relay):
        assert address.startswith("localhost:")
        port = int(address.rpartition(":")[2])
        inodes = {
            str(link.readlink()) for link in Path(f"/proc/{relay.pid}/fd").iterdir() if link.is_symlink()
        }
        listening = []
        for kind in ("tcp", "tcp6"):
            for row in Path("/proc/net", kind).read_text().splitlines()[1:]:
                _, local, _, state, *rest = row.split()
                if state == "0A" and f"socket:[{rest[5]}]" in inodes:
                    listening.append(local)
        near = ("0100007F", "0000000000000000FFFF00000100007F", "00000000000000000000000001000000")
        assert listening
        assert set(listening) <= {f"{host}:{port:04X}" for host in near}


@contextmanager
def own_server(drive: Callable[..., Iterator[bytes]]) -> Iterator[str]:
    """A server that is no relay."""
    handler = grpc.stream_stream_rpc_method_handler(drive)
    own = grpc.server(ThreadPoolExecutor(2), handlers=[
        grpc.method_handlers_generic_handler("resim.Function", {"Drive": handler})
    ])  # fmt: skip
    port = own.add_insecure_port("127.0.0.1:0")
    own.start()
    yield f"127.0.0.1:{port}"
    own.stop(None).wait()


def _nonsense(requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
    next(requests)
    yield b"\x0a\xff\x01nonsense"


def _ends(requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
    next(requests)
    yield from ()


def _refuses(requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
    context.abort(grpc.StatusCode.UNAUTHENTICATED, "who are you?")
    yield b""


def _answers_before_it_is_asked(requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
    yield encode(packed({"protocol": 1})[4:])
    for _ in range(200):
        yield encode(packed({"acceleration": 0.0, "curvature": 0.0, "plan": None})[4:])
    for asked in requests:
        if decode(asked) == packed({"message": "close"})[4:]:
            return


def _cancels(requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
    context.abort(grpc.StatusCode.CANCELLED, "not today")
    yield b""


def _gives_no_reason(requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
    context.abort(grpc.StatusCode.ABORTED, "")
    yield b""


@pytest.mark.parametrize(
    ("drive", "why"),
    [
        (_answers_before_it_is_asked, "wrote more than one answer to a message"),
        (_cancels, "ended its stream with CANCELLED: not today"),
        (_gives_no_reason, "ended its stream with ABORTED: no reason given"),
        (_nonsense, "answered what is no Message of function.proto"),
        (_ends, "ended its stream with OK"),
        (_refuses, "ended its stream with UNAUTHENTICATED: who are you?"),
    ],
)
def test_what_another_server_answers_is_told(tmp_path: Path, drive: Any, why: str) -> None:
    with own_server(drive) as address:
        (check,) = check_function(served_at(tmp_path, address)).checks
        assert not check.holds
        assert why in check.found


@pytest.mark.slow
def test_it_is_checked_and_recorded_as_a_process_is(process: Path, tmp_path: Path) -> None:
    with server(process) as (address, _):
        build = served_at(tmp_path, address)
        found = check_function(build)
        assert found.good, found.checks
        assert "malformed input" in {check.name for check in found.checks}
        assert run(build, tmp_path / "out", "--record").returncode in (0, 1)
        assert check_function(build, [tmp_path / "out" / "rGT.conversation"]).good
    again = run(tmp_path / "out" / "recorded.toml", tmp_path / "again")
    assert again.returncode in (0, 1), again.stderr
    assert (tmp_path / "again" / "tracks.parquet").read_bytes() == (
        tmp_path / "out" / "tracks.parquet"
    ).read_bytes()


def test_no_thread_or_file_is_left_of_a_run(process: Path, tmp_path: Path) -> None:
    with server(process) as (address, _):
        program = load_build(served_at(tmp_path, address)).program
        assert program is not None

        def used() -> tuple[int, int]:
            for _ in range(3):
                partner = program.partner()
                partner.start()
                partner.exchange(b"\0\0\0\0\x81\xa7message\xa4none")
                partner.kill()
            time.sleep(0.5)
            return threading.active_count(), len(os.listdir("/proc/self/fd"))  # noqa: PTH208

        assert used() == used()


def test_the_hash_covers_address_and_digest_which_the_note_names(tmp_path: Path) -> None:
    builds = [load_build(served_at(tmp_path, f"localhost:{port}", more))
              for port, more in ((1, ""), (2, ""), (2, 'digest = "sha256:12"\n'))]  # fmt: skip
    assert len({build.hash for build in builds}) == 3
    assert builds[2].program is not None
    assert builds[2].program.unpinned == (
        "whether container sha256:12 is what answers at localhost:2 is not in its hash: not pinned"
    )


WRONG = {
    "expected remote = true": 'address = "192.0.2.1:50051"\n',
    "'example.org:50051' is not on this machine's loopback": 'address = "example.org:50051"\n',
    "'[::2]:50051' is not on": 'address = "[::2]:50051"\n',
    "expected host:port": 'address = "localhost"\n',
    "address 'unix:/tmp/socket'": 'address = "unix:/tmp/socket"\n',
    "address 'localhost:99999'": 'address = "localhost:99999"\n',
    "expected factory, or": 'address = "localhost:1"\n[process]\ncommand = ["true"]\n',
}


@pytest.mark.parametrize("why", WRONG)
def test_a_file_that_names_no_near_address_is_refused(tmp_path: Path, why: str) -> None:
    path = written(tmp_path / "build.toml", f"{HEAD}[grpc]\n{WRONG[why]}")
    with pytest.raises(InputError, match=r"build\.toml") as told:
        load_build(path)
    assert why in str(told.value)


@pytest.mark.parametrize("address", ["localhost:1", "127.0.0.9:1", "[::1]:1"])
def test_loopback_and_what_is_said_to_be_remote_are_taken(tmp_path: Path, address: str) -> None:
    load_build(served_at(tmp_path, address))
    load_build(served_at(tmp_path, "192.0.2.1:50051", "remote = true\n"))


def test_without_grpcio_its_install_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grpc_wire.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs grpcio. In resim's own folder: pip install '.\[grpc\]'"):
        load_build(served_at(tmp_path, "localhost:1"))


def test_what_cannot_be_served_is_refused(process: Path, call: Callable[..., tuple[int, str, str]]) -> None:
    code, _, told = call("function", "serve", ROOT / "adfunc" / "builds" / "idm-1.0.toml")
    assert (code, "is no process, which alone is served" in told) == (2, True), told
    code, _, told = call("function", "serve", process, "--address", "nowhere")
    assert (code, "expected host:port" in told) == (2, True), told
    with server(process) as (address, _):
        done = subprocess.run(
            [sys.executable, "-m", "resim", "function", "serve", process, "--address", address],
            capture_output=True, text=True, check=False, timeout=100, env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
    assert done.returncode == 2
    said = f"cannot listen on '{address}': another program listens there. End it, or give another port"
    assert done.stderr.startswith(f"resim: --address: {said}"), (
        done.stderr
    )  # the library's own log is not there
    assert len(done.stderr.splitlines()) == 1, done.stderr


@pytest.mark.parametrize(
    ("address", "why"),
    [("192.0.2.1:50051", "it is no address of this machine"), ("no.invalid:50051", "there is no such host")],
)
def test_where_nobody_can_listen_is_told(
    process: Path, call: Callable[..., tuple[int, str, str]], address: str, why: str
) -> None:
    code, _, told = call("function", "serve", process, "--address", address)
    assert (code, why in told, "127.0.0.1" in told) == (2, True, True), told


@pytest.mark.slow
def test_the_example_container_serves(tmp_path: Path) -> None:
    """The steps of its Dockerfile, done without Docker."""
    compiler = shutil.which("c++")
    if compiler is None:
        pytest.skip("there is no C++ compiler")
    text = (ROOT / "adfunc" / "cpp" / "Dockerfile").read_text(encoding="utf-8")
    shutil.copytree(ROOT / "adfunc" / "cpp", tmp_path / "function")
    (line,) = [line for line in text.splitlines() if line.startswith("RUN c++ ")]
    include = ROOT / "resim" / "function"
    words = line.removeprefix("RUN ").replace('"$(resim function include)"', str(include)).split()
    subprocess.run(words, check=True, cwd=tmp_path / "function")
    assert "USER resim" in text.partition("ENTRYPOINT")[0]
    with server(tmp_path / "function" / "follow.toml") as (address, _):
        found = check_function(served_at(tmp_path, address, "[parameters]\ntime_gap = 1.5\n"))
        assert found.good, found.checks


@given(st.binary(max_size=400))
def test_a_message_there_and_back_is_the_same(body: bytes) -> None:
    assert decode(encode(body)) == body
    assert decode(b"\x10\x96\x01" + encode(body) + b"\x1a\x02hi") == body
    assert METHOD == "/resim.Function/Drive"


@given(st.binary(max_size=40))
def test_any_bytes_are_a_message_or_are_refused(rubbish: bytes) -> None:
    with suppress(ValueError):
        decode(rubbish)
