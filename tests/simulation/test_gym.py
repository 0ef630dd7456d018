"""A recording as an environment of gymnasium: the drive is the one of a function that does the same."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
import warnings
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pages
import pytest
from conftest import ROOT

import resim
from resim.core.errors import InputError, ResimError
from resim.simulation.stepped import SteppedDrive

checker: Any = pytest.importorskip("gymnasium.utils.env_checker")
gym: Any = pytest.importorskip("resim.gym")
RECORDING = ROOT / "scenarios" / "rear_end"
FOLLOW = """
from resim.function import Command

class Follow:
    def reset(self, setup):
        pass

    def step(self, p):
        near = p.x_ego.tolist()
        gap = min(near) - 5.0 if near else 100.0
        return Command(0.5 * (min(20.0, gap / 1.5) - p.ego.v), 0.001)

    def close(self):
        pass
"""


@pytest.fixture(scope="module")
def env() -> Any:
    return gym.DriveEnvironment(RECORDING, objects=2)


@pytest.fixture(scope="module")
def seeing() -> Any:
    model = ROOT / "adfunc" / "perception" / "proving_ground.json"
    return gym.DriveEnvironment(RECORDING, perception=model)


def followed(observed: Any) -> Any:
    gap = observed["objects"][0, 0] - 5.0 if observed["present"][0] else 100.0
    return np.array([0.5 * (min(20.0, gap / 1.5) - observed["ego"][3]), 0.001])


def episode(env: Any, seed: int | None = None) -> tuple[Any, float, Any]:
    """What was observed of the EGO (T, 6) and of the nearest object, the sum of rewards, and the last info."""
    observed, info = env.reset(seed=seed)
    seen, total = [np.concatenate([observed["ego"], observed["objects"][0]])], 0.0
    while "end" not in info:
        observed, reward, terminated, truncated, info = env.step(followed(observed))
        seen.append(np.concatenate([observed["ego"], observed["objects"][0]]))
        total += reward
        assert (terminated or truncated) is ("end" in info)
    return np.array(seen), total, info


def test_it_passes_the_check_of_gymnasium(env: Any, seeing: Any) -> None:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*recommend using a symmetric and normalized space")
        warnings.filterwarnings("ignore", ".*Not able to test alternative render modes")
        checker.check_env(env)
        checker.check_env(seeing)


def test_an_agent_drives_as_a_function_that_does_the_same(env: Any, tmp_path: Path) -> None:
    (tmp_path / "follow.py").write_text(FOLLOW, encoding="utf-8")
    build = tmp_path / "follow.toml"
    build.write_text('name = "follow"\nversion = "1"\nfactory = "follow:Follow"\n', encoding="utf-8")
    result = resim.resimulate(RECORDING, build, resim.ResimulationOptions(bases=("GT",)))
    ego = result.tracks.query("source == 'rGT' and id == 'ego'")
    seen, total, info = episode(env)
    drive = result.resimulation.drives["rGT"]
    assert (seen[:, :2] == ego[["x", "y"]].to_numpy()).all()
    assert (seen[:, 3] == ego["v"].to_numpy()).all()
    assert (info["end"], info["t"]) == (drive.end, drive.truth.t[-1])
    driven = np.hypot(*np.diff(seen[:, :2], axis=0).T).sum() - 100.0 * (drive.end != "duration")
    assert total == pytest.approx(driven)


def test_the_same_seed_gives_the_same_episodes_and_another_another(seeing: Any) -> None:
    one, again, other = (episode(seeing, seed)[0] for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    following = episode(seeing)[0]
    episode(seeing, 2)
    assert np.array_equal(following, episode(seeing)[0])


def test_full_speed_ends_in_a_collision_and_a_turn_off_the_road(env: Any) -> None:
    for action, end in (((5.0, 0.0), "collision"), ((0.0, 0.02), "off_road")):
        env.reset()
        terminated = truncated = False
        while not (terminated or truncated):
            _, reward, terminated, truncated, info = env.step(np.array(action))
        assert (terminated, truncated, info["end"]) == (True, False, end)
        assert reward < -95.0
        assert bool(info["collisions"]) is (end == "collision")
        with pytest.raises(ResimError, match="the drive is over"):
            env.step(np.zeros(2))


@pytest.mark.parametrize(
    "given", [{"objects": 0}, {"objects": -1}, {"objects": 1.5}, {"objects": True}, {"step": 0.0},
              {"step": -0.04}, {"step": np.nan}, {"step": np.inf}, {"step": 2.0}, {"step": "0.04"}],
)  # fmt: skip
def test_an_environment_of_no_objects_or_steps_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(given))}: is .*, expected"):
        gym.DriveEnvironment(RECORDING, **given)


def test_actions_are_bounded_and_nonsense_is_refused(env: Any) -> None:
    states = []
    for action in ([50.0, 0.0], [gym.HARDEST, 0.0]):
        env.reset()
        states.append(env.step(np.array(action))[0]["ego"])
    assert np.array_equal(*states)
    none: list[Any] = [
        np.array([np.nan, 0.0]), np.zeros(3), ["a", "b"], np.array([1j, 0.0]), [[1.0], [1.0, 2.0]], None, [None, 0.0],
        [True, False],
    ]  # fmt: skip
    for wrong in none:
        with pytest.raises(InputError, match=r"action: is .*, expected two finite numbers"):
            env.step(wrong)
    env.step([1.0, 0.0])  # nothing has changed
    env.close()
    with pytest.raises(InputError, match="Call reset first"):
        env.step(np.zeros(2))


def test_two_environments_do_not_disturb_each_other(env: Any) -> None:
    alone = episode(env, 1)[0]
    other = gym.DriveEnvironment(RECORDING, objects=2)
    one, _ = env.reset(seed=1)
    other.reset(seed=1)
    seen = []
    for k in range(len(alone) - 1):
        one = env.step(followed(one))[0]
        seen.append(one["ego"])
        if k % 2:
            other.step(np.zeros(2))
    assert np.array_equal(alone[1:, :6], np.array(seen))


def test_nothing_is_left_of_an_episode(env: Any) -> None:
    before = threading.active_count(), os.getcwd(), len(os.listdir("/proc/self/fd"))  # noqa: PTH109, PTH208
    drives = []
    for _ in range(20):
        env.reset()
        env.step(np.zeros(2))
        drives.append(weakref.ref(env._drive))
        assert isinstance(env._drive, SteppedDrive)
    env.close()
    gc.collect()
    assert not any(drive() for drive in drives)
    assert before == (threading.active_count(), os.getcwd(), len(os.listdir("/proc/self/fd")))  # noqa: PTH109, PTH208


def test_the_guides_agent_does_what_it_says() -> None:
    said = pages.named(ROOT / "docs" / "guides" / "outside.md", "python")["agent.py"]
    done = subprocess.run([sys.executable, "-c", said], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (expected,) = [line.partition("  # ")[2] for line in said.splitlines() if line.startswith("print(")]
    assert done.stdout.strip() == expected


def test_without_gymnasium_its_install_is_told() -> None:
    code = "import sys; sys.modules['gymnasium'] = None; import resim.gym"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "needs gymnasium. In resim's own folder: pip install '.[gym]'" in done.stderr
