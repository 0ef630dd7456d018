"""Does the Supervisor lose tasks, and does it keep up?

    python tools/validate_supervisor.py [--kills 50] [--users 50] [--rounds 3] [--requests 150000]

Kills: two servers on one catalog do tasks, sweeps in SUMO among them, while every second a server, or the process of a
task, is killed by SIGKILL and servers are started again; afterwards each task must have ended, each attempt must have
been made once, no run of a sweep may have been done twice, and the runs' tables must have the bytes of one that nothing
disturbed. A sweep that was given up after three kills is retried, as a user would. Load: users who ask for a page every
second while a sweep runs as a task, over a catalog of 2,000 results; and how long the sweep takes with and without
them. Memory: as many requests as fast as they are answered, for pages, streams that are opened and closed, and crates,
while tasks end and results come: a day of 50 users who ask twice a minute is 144,000 requests.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path

import httpx2
import psutil

from resim.execution import journal
from resim.results.catalog import Catalog
from resim.results.entry import CatalogEntry, CatalogInput, CatalogOutcome
from resim.results.queue import TaskQueue, new_id
from resim.supervisor.processes import is_alive, number_of, read_whole

ROOT = Path(__file__).parents[1]
PAGES = (
    "/",
    "/experiments",
    "/results",
    "/results?text=drive",
    "/builds",
    "/tasks",
    "/lake?text=pilot",
    "/jobs/run",
)
SWEEPS = 4
"""That are among the tasks of which some are killed."""
CLIENTS = 8
"""That ask at once, without a pause."""


def start(tasks: Path, jobs: int) -> tuple[subprocess.Popen[str], str, str]:
    """Start a server; gives it, its address and its token."""
    command = [sys.executable, "-m", "resim", "serve", "--no-open", "--port", "0", "--jobs", str(jobs)]
    command += ["--tasks", str(tasks), str(ROOT / "scenarios"), str(ROOT / "adfunc")]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    found = re.fullmatch(r"(\S+)/\?token=(\S+)\n", server.stdout.readline())
    assert found is not None
    return server, found[1], found[2]


def home_of(page: str) -> str:
    """Give with what all addresses of a session begin, of the page that lets it in."""
    found = re.search(r"url=(/[0-9a-f]{32})/", page)
    assert found is not None
    return found[1]


def end(server: subprocess.Popen[str]) -> None:
    """Kill a server."""
    server.kill()
    server.wait()
    assert server.stdout is not None
    server.stdout.close()


def put(queue: TaskQueue, tasks: Path, *words: str, out: bool = False) -> str:
    """Put a task in, and give its id."""
    name = new_id()
    more = [f"--out={tasks / name / 'result'}"] if out else []
    again = ("--resume",) if words[0] == "sweep" else ()
    queue.add(name, words[0], [*words[:-1], *more, "--", words[-1]], str(tasks / name), again)
    return name


def kills(folder: Path, count: int, seed: int) -> None:
    """Kill servers and tasks, and say what was lost or done twice."""
    queue, tasks, chance = (
        TaskQueue(Catalog(os.environ["RESIM_CATALOG"])),
        folder / "tasks",
        random.Random(seed),
    )
    drives = sorted(p.parent for p in (ROOT / "scenarios").glob("*/recording.toml"))
    undisturbed = folder / "undisturbed"
    sweep = ["sweep", "run", "--workers=1", str(slow_sweep(folder))]
    subprocess.run(
        [sys.executable, "-m", "resim", *sweep, f"--out={undisturbed}"], check=True, stdout=subprocess.PIPE
    )
    sweeps = [put(queue, tasks, *sweep, out=True) for _ in range(SWEEPS)]
    checks = [put(queue, tasks, "check", str(drives[k % len(drives)])) for k in range(2 * count)]
    names = [*sweeps, *checks]
    servers = [start(tasks, 2)[0] for _ in range(2)]
    killed = Counter[str]()
    for _ in range(count):
        time.sleep(chance.uniform(0.2, 1.5))
        running = [t for t in queue.unfinished() if t.state == "running"]
        if running and chance.random() < 0.5:
            among = [t for t in running if t.job == "sweep"]
            task = chance.choice(among if among and chance.random() < 0.5 else running)
            begun = read_whole(Path(task.folder) / "begun.json")
            if begun and is_alive(str(begun["process"])):
                with suppress(OSError):
                    os.killpg(number_of(str(begun["process"])), signal.SIGKILL)
                killed["tasks"] += 1
                continue
        k = chance.randrange(2)
        end(servers[k])
        servers[k] = start(tasks, 2)[0]
        killed["servers"] += 1
    given_up = _wait(queue, sweeps)
    for server in servers:
        end(server)
    ended = [queue.get(name) for name in names]
    twice = sum(_made(Path(t.folder)) != t.attempt for t in ended)
    states = Counter(t.state for t in ended)
    again = sum(t.attempt > 1 for t in ended)
    print("\n| killed | tasks | done | lost after 3 kills | begun again | an attempt made twice, or none |")
    print("|---|---|---|---|---|---|")
    what = ", ".join(f"{n} {name}" for name, n in sorted(killed.items()))
    print(f"| {what} | {len(names)} | {states['done']} | {states['lost']} | {again} | {twice} |", flush=True)
    attempts = ", ".join(str(task.attempt) for task in ended[: len(sweeps)])
    results = [Path(task.folder) / "result" for task in ended[: len(sweeps)]]
    lines = [sum(p.read_bytes().count(b"\n") for p in (result / "journal").iterdir()) for result in results]
    runs = len({entry.run for entry in journal.read(undisturbed / "journal")})
    same = sum(_tables(result) == _tables(undisturbed) for result in results)
    head = (
        "sweeps in SUMO | attempts of each | given up and retried | runs | done twice | tables as undisturbed"
    )
    print(f"\n| {head} |\n|---|---|---|---|---|---|")
    row = f"{len(sweeps)} | {attempts} | {given_up} | {runs}, each"
    print(f"| {row} | {sum(lines) - runs * len(results)} | {same} |", flush=True)


def slow_sweep(folder: Path) -> Path:
    """Write a sweep whose runs come one by one: in SUMO, and not, as with the engine of our own, in one batch."""
    shipped = (ROOT / "scenarios" / "sweeps" / "perception_latency.toml").read_text()
    text = shipped.replace('engine = "direct"', 'engine = "sumo"').replace("steps = 7", "steps = 3")
    text = text.replace("seeds = 5", "seeds = 2")
    assert text.count('engine = "sumo"') == 1
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "slow.toml"
    path.write_text(text.replace("../../", f"{ROOT}/").replace("../", f"{ROOT / 'scenarios'}/"))
    return path


def _wait(queue: TaskQueue, sweeps: list[str]) -> int:
    """Wait until no task is left, and retry sweeps that were killed too often; gives how often that was."""
    given_up = 0
    while True:
        while queue.unfinished():
            time.sleep(0.5)
        lost = [name for name in sweeps if queue.get(name).state == "lost"]
        if not lost:
            return given_up
        given_up += sum(queue.retry(name) for name in lost)


def _tables(result: Path) -> list[bytes]:
    """What the tables of a sweep's runs hold."""
    found = [path.read_bytes() for path in sorted((result / "runs").glob("*.parquet"))]
    assert found, f"{result} has no table of runs"
    return found


def _made(folder: Path) -> int:
    """How many attempts the log of a task tells of."""
    return (folder / "log.txt").read_text(errors="replace").count("$ resim ")


def fill(catalog: Catalog, count: int) -> None:
    """Put results in, of 200 drives and 5 builds."""
    one = CatalogEntry(
        "verification", "suite", Path("/r"), "host", "", "", "0.1.0", "not verified", {"verified": 1}
    )
    for k in range(count):
        drive, build = f"drive_{k % 200:03}", f"pilot-1.{k % 5}"
        inputs = (
            CatalogInput("recording", drive, "", f"{k % 200:064x}"),
            CatalogInput("build", build, "", f"{k % 5:064x}"),
        )
        verdict = ("verified", "not verified")[k % 3 == 0]
        outcomes = (CatalogOutcome(drive, build, "", verdict),)
        written = f"2026-10-{1 + k % 28:02}T05:00:{k % 60:02}.000+00:00"
        catalog.add(
            replace(
                one,
                folder=Path(f"/r/{k}"),
                digest=f"{k:064x}",
                written=written,
                inputs=inputs,
                outcomes=outcomes,
            )
        )


async def ask(address: str, token: str, users: int, running: asyncio.Event) -> list[float]:
    """Let users ask for pages until the event; gives how long each took [s]."""
    took: list[float] = []
    async with httpx2.AsyncClient(
        base_url=address, timeout=60.0, limits=httpx2.Limits(max_connections=users)
    ) as client:
        entered = (await client.get("/", params={"token": token})).raise_for_status()
        client.base_url = address + home_of(entered.text)

        async def user(k: int) -> None:
            chance = random.Random(k)
            while not running.is_set():
                await asyncio.sleep(chance.uniform(0.5, 1.5))
                begin = time.perf_counter()
                (await client.get(chance.choice(PAGES))).raise_for_status()
                took.append(time.perf_counter() - begin)

        await asyncio.gather(*(user(k) for k in range(users)))
    return took


def load(folder: Path, users: int, rounds: int) -> None:
    """Run sweeps as tasks, in turns with and without users, and say how long pages and sweeps took."""
    catalog = Catalog(os.environ["RESIM_CATALOG"])
    queue, tasks = TaskQueue(catalog), folder / "tasks"
    fill(catalog, 2000)
    server, address, token = start(tasks, 1)
    process = psutil.Process(server.pid)
    sweep, took = ROOT / "scenarios" / "sweeps" / "perception_latency.toml", list[float]()
    times: dict[str, list[float]] = {}

    async def with_users(name: str) -> list[float]:
        over, begin, before = asyncio.Event(), time.monotonic(), sum(process.cpu_times()[:2])
        asking = asyncio.create_task(ask(address, token, users, over))
        while queue.get(name).state in ("waiting", "running"):
            await asyncio.sleep(0.5)
        over.set()
        found = await asking
        share = (sum(process.cpu_times()[:2]) - before) / (time.monotonic() - begin)
        times.setdefault("share", []).append(share)
        return found

    for which in (
        "warm",
        *("without", "with", "with", "without") * (rounds // 2),
        *("without", "with") * (rounds % 2),
    ):
        name = put(queue, tasks, "sweep", "run", "--workers=1", str(sweep), out=True)
        if which == "with":
            took += asyncio.run(with_users(name))
        while (task := queue.get(name)).state in ("waiting", "running"):
            time.sleep(0.2)
        assert task.ended is not None
        assert task.begun is not None
        times.setdefault(which, []).append(task.ended - task.begun)
    memory = process.memory_info().rss / 1e6
    end(server)
    middle, late = statistics.median(took), statistics.quantiles(took, n=20)[-1]
    slower = [100.0 * (b / a - 1.0) for a, b in zip(times["without"], times["with"], strict=True)]
    told = [", ".join(f"{one:.1f}" for one in times[which]) for which in ("without", "with")]
    head = "users | pages | median | 95 % | sweeps without [s] | with [s] | slower, median | server, of a core | [MB]"
    row = f"{users} | {len(took)} | {1e3 * middle:.0f} ms | {1e3 * late:.0f} ms | {told[0]} | {told[1]}"
    share = 100.0 * statistics.median(times["share"])
    print(f"\n| {head} |\n|---|---|---|---|---|---|---|---|---|")
    print(f"| {row} | {statistics.median(slower):.1f} % | {share:.0f} % | {memory:.0f} |", flush=True)


def memory(folder: Path, requests: int) -> None:
    """Ask for pages, streams and crates without a pause, and say how the server's memory grows."""
    catalog = Catalog(os.environ["RESIM_CATALOG"])
    fill(catalog, 2000)
    queue, tasks = TaskQueue(catalog), folder / "tasks"
    server, address, token = start(tasks, 1)
    process, grown, done = psutil.Process(server.pid), [], threading.Event()
    with httpx2.Client(base_url=address, timeout=60.0) as client:
        home = home_of(client.get("/", params={"token": token}).raise_for_status().text)
        client.base_url = address + home
        while not (found := re.findall(r'href="/\w+(/experiments/\w+)"', client.get("/experiments").text)):
            time.sleep(1.0)
        results = re.findall(r'href="/\w+(/results/\w+)"', client.get("/results").text)
        cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
    asking = [Asking(address, home, cookie, [*found, *results], k) for k in range(CLIENTS)]
    grown.append(process.memory_info().rss / 1e6)
    before = sum(process.cpu_times()[:2])
    begin, threads = time.monotonic(), [threading.Thread(target=one.ask, args=(done,)) for one in asking]
    for thread in threads:
        thread.start()
    for part in range(1, 21):
        put(queue, tasks, "check", str(ROOT / "scenarios" / "cut_in_brake"))
        fill(catalog, 20)
        while sum(len(one.took) for one in asking) < requests * part / 20 and not any(
            one.fault for one in asking
        ):
            time.sleep(0.2)
        if part % 5 == 0:
            grown.append(process.memory_info().rss / 1e6)
    done.set()
    for thread in threads:
        thread.join()
    each, open_files, busy = process.num_threads(), process.num_fds(), sum(process.cpu_times()[:2]) - before
    end(server)
    if faults := [one.fault for one in asking if one.fault]:
        raise SystemExit(faults[0])
    took, seconds = [one for own in asking for one in own.took], time.monotonic() - begin
    late = statistics.quantiles(took, n=20)[-1]
    told = ", ".join(f"{one:.0f}" for one in grown)
    head = "requests | in [s] | 95 % | of a core, each | server [MB] before, after each quarter | threads | files"
    row = f"{len(took)} | {seconds:.0f} | {1e3 * late:.0f} ms | {1e3 * busy / len(took):.1f} ms | {told}"
    print(f"\n| {head} |\n|---|---|---|---|---|---|---|")
    print(f"| {row} | {each} | {open_files} |", flush=True)


class Asking:
    """A client with an address of its own that asks for one page after the other. took [s]: by each of them."""

    def __init__(self, address: str, home: str, cookie: str, things: list[str], number: int) -> None:
        self._place, self._cookie, self._things = address.partition("://")[2], cookie, things
        self._home = home
        self._chance, self._from = random.Random(number), f"127.0.0.{number + 2}"
        self.took: list[float] = []
        self.fault = ""

    def ask(self, done: threading.Event) -> None:
        """Ask until it is done, or something is wrong."""
        held = self._opened()
        while not done.is_set() and not self.fault:
            begin = time.perf_counter()
            which = self._chance.random()
            if which < 0.02:  # a stream that is left
                other = self._opened()
                self._sent(other, "/events").readline()
                other.close()
            else:
                path = self._chance.choice(self._things if which < 0.1 else PAGES)
                if which < 0.0205 and "experiments" in path:
                    path = path.replace("experiments", "crate")
                answer = self._sent(held, path)
                answer.read()
                if answer.status not in (200, 409):  # 409: another crate is packed at this moment
                    self.fault = f"{path}: {answer.status}"
            self.took.append(time.perf_counter() - begin)
        held.close()

    def _opened(self) -> HTTPConnection:
        return HTTPConnection(self._place, timeout=60.0, source_address=(self._from, 0))

    def _sent(self, held: HTTPConnection, path: str) -> HTTPResponse:
        held.request("GET", self._home + path, headers={"cookie": self._cookie})
        return held.getresponse()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--users", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=3, help="sweeps without users, and as many with them")
    parser.add_argument("--requests", type=int, default=150_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        for part, job in (
            ("kills", lambda f: kills(f, given.kills, given.seed)),
            ("users", lambda f: load(f, given.users, given.rounds)),
            ("requests", lambda f: memory(f, given.requests)),
        ):
            if getattr(given, part):
                os.environ["RESIM_CATALOG"] = str(Path(name) / part / "catalog.sqlite")
                os.environ["XDG_DATA_HOME"] = str(Path(name) / part)
                job(Path(name) / part)


if __name__ == "__main__":
    main()
