"""Kernels: components, their number, what they reconstruct, and their file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from traced import kernel, kernel_file, lane_changes

from resim.core.correlation import pearson
from resim.core.errors import InputError, ResimError
from resim.variations.evaluation import ENOUGH, evaluate, of_humans
from resim.variations.features import POINTS
from resim.variations.kernels import fit_kernel, read_kernels, reconstruction_error, write_kernels


def test_components_are_those_of_the_singular_values() -> None:
    features = lane_changes(300)
    found = fit_kernel("lane_change_right", features, features[:0], components=5)
    centred = features - features.mean(axis=0)
    _, values, axes = np.linalg.svd(centred, full_matrices=False)
    np.testing.assert_allclose(np.abs(np.sum(found.axes * axes[:5], axis=1)), 1.0, atol=1e-9)
    np.testing.assert_allclose(found.sd, values[:5] / np.sqrt(300), rtol=1e-9)
    np.testing.assert_allclose(found.explained, values[:5] ** 2 / np.sum(values**2), rtol=1e-9)
    scores = found.components(features)
    np.testing.assert_allclose(scores.min(axis=0), found.low)
    np.testing.assert_allclose(scores.max(axis=0), found.high)
    np.testing.assert_allclose(pearson(scores), np.eye(5), atol=1e-9)


def test_twenty_components_reconstruct_to_the_published_error() -> None:
    held_out = lane_changes(200, seed=5)
    found = kernel()
    assert 10 < found.count <= 20
    assert reconstruction_error(found.axes, found.mean, held_out) < 1e-3
    np.testing.assert_allclose(found.features(found.components(held_out)), held_out, atol=0.1)


def test_the_number_follows_from_a_stated_error() -> None:
    features = lane_changes(300)
    found = fit_kernel("lane_change_right", features, features[:0], error=1e-3)
    fewer = fit_kernel("lane_change_right", features, features[:0], components=found.count - 1)
    assert found.reconstruction <= 1e-3 < fewer.reconstruction


def test_time_of_components_stays_equitemporal() -> None:
    """So that a variation's points are again equally far apart in time."""
    times = kernel().axes[:, :POINTS]
    even = times[:, -1:] * np.linspace(0.0, 1.0, POINTS)
    np.testing.assert_allclose(times, even, atol=1e-9)


def test_too_few_traces_are_no_kernel() -> None:
    with pytest.raises(ResimError, match="1 traces of lane_change_right are too few"):
        fit_kernel("lane_change_right", lane_changes(1), lane_changes(0).reshape(0, 3 * POINTS))


def test_the_file_gives_back_what_was_written_and_tells_of_changes(tmp_path: Path) -> None:
    made, path = kernel_file("lane_change_right"), tmp_path / "kernels.json"
    write_kernels(made, path)
    found = read_kernels(path)
    one, other = made.kernels["lane_change_right"], found.kernels["lane_change_right"]
    for name in ("mean", "axes", "sd", "low", "high", "explained"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert found.sources == made.sources
    path.write_text(path.read_text().replace('"synthetic"', '"real"'))
    with pytest.raises(InputError, match="was changed after it was written"):
        read_kernels(path)


def test_below_enough_held_out_traces_nothing_is_shown() -> None:
    few = evaluate(kernel(), lane_changes(120, seed=3))
    assert (few.missing, few.uncorrelated, few.reconstructed) == (ENOUGH - 120, None, None)
    many = evaluate(kernel(), lane_changes(ENOUGH, seed=3))
    assert many.missing == 0
    assert many.reconstructed is not None


def test_of_humans_only_what_was_looked_at_may_be_claimed() -> None:
    made = kernel_file("lane_change_right")
    assert [*of_humans(made, ["lane_change_right"])] == [
        "the kernels come from synthetic drives: nothing is claimed of how humans drive"
    ]
    few = made.kernels["lane_change_right"]
    many = replace(few, label="follow_lane", held_out=ENOUGH)
    real = replace(made, data="real", kernels={"lane_change_right": few, "follow_lane": many})
    first, second = of_humans(real, ["lane_change_right", "follow_lane", "lane_change_right"])
    assert first.endswith("not shown: 100 of 500 held-out traces, 400 are missing")
    assert "see the report" in second


def test_correlated_components_are_told() -> None:
    made = kernel(components=3)
    rng = np.random.default_rng(2)
    first = rng.normal(size=ENOUGH)
    scores = np.column_stack([first, first + 0.1 * rng.normal(size=ENOUGH), rng.normal(size=ENOUGH)])
    assert evaluate(made, made.features(scores)).uncorrelated is False
    assert evaluate(made, made.features(rng.normal(size=(ENOUGH, 3)))).uncorrelated is True


def test_many_components_of_few_traces_are_not_blamed_for_their_axes() -> None:
    """20 components that are uncorrelated in truth: 0.19 is what axes and coefficients of 500 traces each come to."""
    rng = np.random.default_rng(5)
    spread = 0.8 ** np.arange(20)
    mixed = np.linalg.qr(rng.normal(size=(150, 150)))[0][:20]
    trained, held = (rng.normal(size=(ENOUGH, 20)) * spread @ mixed for _ in range(2))
    found = evaluate(fit_kernel("follow_lane", trained, held, components=20), held)
    assert found.linear + found.linear_bias > 0.15
    assert found.uncorrelated is True
