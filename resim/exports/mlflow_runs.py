"""Results as runs of MLflow, which other teams' boards show: each once, known again by its id in the lake."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from resim.core.errors import InputError

ID = "resim.id"
"""Tag by which a result is known again."""
WHOLE = "FINISHED"
"""State of a run that was written whole."""
_LONGEST = 5_000
"""Letters of a parameter or tag that MLflow takes."""
_AT_ONCE = 100
"""Parameters and tags that MLflow takes at once; of metrics 1,000."""
_STRANGE = re.compile(r"[^\w\-. /]")
"""What no name of MLflow has."""


@dataclass(frozen=True)
class MirroredRun:
    """A result as MLflow shows it.

    Attributes:
        id: In the lake.
        name: What it is called.
        at: When it was written [s since 1970].
        params: What it was made from and with.
        metrics: What came out, as numbers; none that is not finite.
        tags: Verdicts, hashes, where its files lie.
    """

    id: str
    name: str
    at: float
    params: Mapping[str, str]
    metrics: Mapping[str, float]
    tags: Mapping[str, str]


class MlflowStore:
    """An experiment in a tracking store of MLflow.

    Every method raises InputError where the store cannot be used, or MLflow is not installed.
    """

    def __init__(self, address: str, experiment: str) -> None:
        """address: as MLflow takes it. experiment: its name; it is made where there is none."""
        os.environ.setdefault(
            "MLFLOW_DISABLE_TELEMETRY", "true"
        )  # read at the import: nothing is sent elsewhere
        try:
            from mlflow import MlflowClient
            from mlflow.exceptions import MlflowException
        except ImportError:
            remedy = "In resim's own folder: pip install '.[mlflow]'"
            raise InputError("resim lake mirror", "needs MLflow", remedy) from None
        self._address, self._fault = address, MlflowException
        try:
            self._client = MlflowClient(address)
            found = self._client.get_experiment_by_name(experiment)
            self._experiment = (
                self._client.create_experiment(experiment) if found is None else found.experiment_id
            )
        except Exception as e:  # of the store, its database or its driver
            raise self._refused(e) from e

    def known(self) -> set[str]:
        """Give the ids of the results that are there whole; what was broken off is taken out."""
        found = set()
        try:
            for run in self._runs():
                if run.info.status == WHOLE:
                    found.add(run.data.tags[ID])
                else:
                    self._client.delete_run(run.info.run_id)
        except self._fault as e:
            raise self._refused(e) from e
        return found

    def add(self, one: MirroredRun) -> None:
        """Write a result; it counts as there once all of it is."""
        from mlflow.entities import Metric, Param, RunTag

        at = int(1000.0 * one.at)
        try:
            run = self._client.create_run(self._experiment, at, {ID: one.id}, run_name=one.name).info.run_id
            params = [Param(_name(key), value[:_LONGEST]) for key, value in one.params.items()]
            tags = [RunTag(_name(key), value[:_LONGEST]) for key, value in one.tags.items()]
            metrics = [
                Metric(_name(key), value, at, 0) for key, value in one.metrics.items() if math.isfinite(value)
            ]
            for some in _parts(params):
                self._client.log_batch(run, params=some)
            for some in _parts(tags):
                self._client.log_batch(run, tags=some)
            for some in _parts(metrics):
                self._client.log_batch(run, metrics=some)
            self._client.set_terminated(run, WHOLE, at)
        except self._fault as e:
            raise self._refused(e) from e

    def _runs(self) -> Iterator[Any]:
        """All runs of the experiment that are mirrored results."""
        token = None
        while True:
            page = self._client.search_runs([self._experiment], "", page_token=token, max_results=1000)
            yield from (run for run in page if ID in run.data.tags)
            if not (token := page.token):
                return

    def _refused(self, e: Exception) -> InputError:
        reason = (str(e).splitlines() or [type(e).__name__])[0]
        address, reason = (re.sub(r"//[^/@]*@", "//***@", text) for text in (self._address, reason))
        remedy = "Give an address such as sqlite:///mlflow.db, or that of a tracking server."
        return InputError(address, f"cannot be used as the store of MLflow ({reason:.300})", remedy)


def _parts(every: list[Any]) -> Iterable[list[Any]]:
    return (every[k : k + _AT_ONCE] for k in range(0, len(every), _AT_ONCE))


def _name(text: str) -> str:
    return _STRANGE.sub("_", text)[:250]
