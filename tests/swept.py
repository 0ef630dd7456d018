"""A finished sweep with a known truth, as `resim sweep` writes it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from resealed import edit

from resim.core.geometry import Floats
from resim.core.sealed import sealed
from resim.core.spec import to_json
from resim.results import write_json, write_parquet
from resim.sweeps.file import Sweep, SweepBoundary, boundaries, check_plan, runs
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import PLANS
from resim.sweeps.sweep_file import SweepFile

LATENCY = SweepParameter(name="perception.latency.speed", low=0.0, high=1.0, steps=11)
BIAS = SweepParameter(name="perception.errors.longitudinal.bias.constant", low=-2.0, high=2.0, steps=9)
GAP = SweepParameter(name="function.time_gap", low=0.5, high=2.5, steps=3)
TWO, THREE = (LATENCY, BIAS), (LATENCY, BIAS, GAP)


def design(parameters: tuple[SweepParameter, ...], plan: str, points: int, seed: int) -> Floats:
    """Give the points of a plan that does not grow."""
    made = PLANS[plan].design
    assert made is not None
    return made(parameters, points, seed)


def write_swept(
    folder: Path, parameters: tuple[SweepParameter, ...] = TWO, plan: str = "grid", *, points: int = 0, seeds: int = 5,
    sections: tuple[tuple[str, str], ...] = (("cut_in", "pilot-1.0"),), failed: int = 0,
) -> pd.DataFrame:  # fmt: skip
    """Write a sweep whose risk is 0.2 latency + 0.02 |bias - 0.5| and noise, and whose limit of risk is 0.1.

    failed: how many of the first runs have no result. Gives the table.
    """
    x = design(parameters, plan, points, 0)
    shape = (len(sections), len(x), seeds)
    s, p, k = (index.ravel() for index in np.indices(shape))
    table = {
        "run": np.arange(len(s)), "recording": np.array([name for name, _ in sections])[s],
        "build": np.array([f"../{build}.toml" for _, build in sections])[s], "point": p, "seed": k,
    }  # fmt: skip
    table |= {q.name: x[p, i] for i, q in enumerate(parameters)}
    rows = pd.DataFrame(table | _outcomes(x[p], failed))
    _write(folder, rows, parameters, {"plan": plan, "seeds": seeds}, sections, {"failed": failed})
    return rows


def write_adaptive(
    folder: Path, parameters: tuple[SweepParameter, ...], *, points: int = 1000, share: float = 0.5, seeds: int = 5,
    outcome: str = "same_decision",
) -> tuple[SweepBoundary, ...]:  # fmt: skip
    """Write an adaptive sweep of the same truth: as measured where the latency is above 0.3 s + 0.1 bias.

    With less than 0.04 s more, the last of the seeds is not. Gives its boundaries.
    """
    file = SweepFile.model_validate({
        "name": "known", "recording": [{"folder": "cut_in"}], "build": ["../pilot-1.0.toml"], "plan": "adaptive",
        "criteria": "highway.toml", "perception": "model.json", "adaptive": {"outcome": outcome, "share": share},
        "points": points, "seeds": seeds, "parameter": [p.model_dump() for p in parameters],
    })  # fmt: skip
    check_plan(folder / "sweep.toml", file)
    sweep = Sweep(path=folder / "sweep.toml", file=file, folders={"cut_in": folder})
    rows: dict[int, Any] = {}
    while len(table := runs(sweep, rows)) > len(rows):
        x = table[[p.name for p in parameters]].to_numpy()
        found = pd.DataFrame(_outcomes(x, 0))
        over = x[:, 0] - 0.3 - 0.1 * (x[:, 1] if x.shape[1] > 1 else 0.0)
        number = table.groupby(["recording", "build", "point"]).cumcount()
        found["same_decision"] = ((over > 0.04) | (over > 0.0) & (number < seeds - 1)).astype(object)
        rows = dict(enumerate(found.to_dict("records")))
    told = boundaries(sweep, rows)
    more = {"plan": "adaptive", "seeds": seeds, "points": points, "adaptive": file.adaptive.model_dump()}
    whole = pd.concat([table, found], axis=1)
    _write(
        folder,
        whole,
        parameters,
        more,
        (("cut_in", "pilot-1.0"),),
        {"failed": 0, "boundaries": [to_json(one) for one in told]},
    )
    return told


def _write(
    folder: Path, rows: pd.DataFrame, parameters: tuple[SweepParameter, ...], file: dict[str, Any],
    sections: tuple[tuple[str, str], ...], told: dict[str, Any],
) -> None:  # fmt: skip
    """Write the folder of a finished sweep. file, told: what else its file and its manifest say."""
    said = SweepFile.model_validate({
        "name": "known", "recording": [{"folder": name} for name, _ in sections], "perception": "model.json",
        "build": [f"../{b}.toml" for b in dict.fromkeys(b for _, b in sections)], "criteria": "highway.toml",
        **file, "parameter": [q.model_dump() for q in parameters],
    })  # fmt: skip
    inputs: dict[str, Any] = {
        "sweep": said.model_dump(mode="json"),
        "vehicle": "kinematic",
        "criteria": {"path": "highway.toml", "hash": "0" * 64},
        "perception": {"path": "model.json", "hash": "1" * 64},
        "builds": {f"../{b}.toml": {"path": f"../{b}.toml", "hash": "2" * 64, "label": b} for _, b in sections},
        "recordings": {name: {"path": f"../{name}", "hash": "3" * 64} for name, _ in sections},
    }  # fmt: skip
    (folder / "runs").mkdir(parents=True)
    write_parquet(rows, folder / "runs" / "part-00000.parquet")
    held = {"versions": {"resim": "0.1.0"}, "inputs": inputs}
    write_json(sealed(held), folder / "sweep.json")
    more = {"runs": len(rows), **told, "columns": list(rows.columns)}
    write_json(sealed({"schema": "resim-sweep-1", **held, **more}), folder / "manifest.json")
    state_hashes(folder)


def state_hashes(folder: Path) -> None:
    """Have manifest.json of a sweep state the hashes of its table as it is."""
    parts = sorted((folder / "runs").glob("part-*.parquet"))
    files = {f"runs/{p.name}": hashlib.sha256(p.read_bytes()).hexdigest() for p in parts}
    edit(folder / "manifest.json", lambda said: said.update(files=files))


def _outcomes(x: np.ndarray[Any, np.dtype[np.float64]], failed: int) -> dict[str, Any]:
    rng = np.random.default_rng(7)
    latency, bias = x[:, 0], x[:, 1] if x.shape[1] > 1 else np.zeros(len(x))
    risk = np.maximum(0.2 * latency + 0.02 * np.abs(bias - 0.5) + rng.normal(0.0, 0.005, len(x)), 0.0)
    hit, same = risk > 0.22, latency > 0.3 + 0.1 * bias
    out: dict[str, Any] = {
        "end": np.full(len(x), "duration", dtype=object), "failure": np.full(len(x), None, dtype=object),
        "decision": np.where(same, "brake", "brake, lane_change_left").astype(object),
        "same_decision": same.astype(object),
        "reaction": 6.0 + latency, "reaction_difference": latency - 0.5, "collision": hit.astype(object), "risk": risk,
        "end_position_error": np.hypot(bias, latency),
        "verdict": np.where(risk > 0.1, "FAIL", "PASS").astype(object),
        "kpi accident risk": np.where(risk > 0.1, "FAIL", "PASS").astype(object), "value accident risk": risk,
        "unit accident risk": np.full(len(x), "1", dtype=object), "unit lane": np.full(len(x), "m", dtype=object),
        "kpi lane": np.full(len(x), "PASS", dtype=object), "value lane": np.full(len(x), -0.5),
    }  # fmt: skip
    for name, column in out.items():
        column[:failed] = {"end": "failed", "failure": "the process was ended by SIGSEGV"}.get(
            name, None if column.dtype == object else np.nan
        )
    return out


def read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found
