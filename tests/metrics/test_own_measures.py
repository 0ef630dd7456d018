"""A user's own measure: a Python function that the file of criteria names."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT

from resim.core.errors import InputError
from resim.metrics import criteria
from resim.metrics.criteria import read_criteria

CRITERIA = """name = "mine"

[[measure]]
name = "gap to the side"
function = "my_measures:beside"
unit = "m"
kind = "quantitative"
worst = "low"

[[criterion]]
name = "keeps clear"
measure = "gap to the side"
below = {limit}
"""

MODULE = """import numpy as np


def beside(drive, network):
    state, own = drive.scenes.state, drive.own
    return np.hypot(state[..., 0] - own.x[0, :, None], state[..., 1] - own.y[0, :, None])
"""


MASKED = "import numpy as np\n\n\ndef beside(drive, network):\n    return np.ma.masked_less(drive.t, 5.0)\n"


@pytest.fixture
def judged(call, tmp_path):
    """Assess the overtaking by own criteria; gives exit code, output and errors."""

    def run(module=MODULE, criteria=CRITERIA, limit=1.0):
        (tmp_path / "my_measures.py").write_text(module)
        (tmp_path / "mine.toml").write_text(criteria.format(limit=limit))
        scenario = ROOT / "scenarios" / "overtake"
        return call("assess", scenario, "--criteria", tmp_path / "mine.toml", "--out", tmp_path / "out")

    return run


def test_it_is_assessed_and_judged_like_any_other(judged, tmp_path):
    assert judged(limit=1.0)[0] == 0
    code, out, _ = judged(limit=50.0)
    assert code == 1
    assert "gap to the side" in out
    found = json.loads((tmp_path / "out" / "assessment.json").read_text())
    verdict = found["criteria"]["keeps clear"]
    assert (verdict["verdict"], verdict["unit"]) == ("FAIL", "m")
    assert verdict["value"] == min(min(v) for v in found["measures"]["gap to the side"].values())


@pytest.mark.slow
def test_it_has_no_number_for_who_is_not_there_and_cannot_change_the_drive(judged, tmp_path):
    module = MODULE.replace(
        "    return", "    drive.scenes.state[...] = 0.0\n    drive.own.x[...] = 0.0\n    return"
    )
    assert judged(module, limit=8.0)[0] == 1
    whole = json.loads((tmp_path / "out" / "assessment.json").read_text())
    assert whole["criteria"]["keeps clear"]["value"] < 8.0  # the EGO's y, as it left it
    assert min(x for x in whole["measures"]["gap ahead"]["2"] if x is not None) > 50.0


@pytest.mark.parametrize(
    ("module", "says"),
    [
        ("def beside(drive, network):\n    return 1 / 0\n", "my_measures:beside raised ZeroDivisionError"),
        (
            "def beside(drive, network):\n    return [1.0, 2.0]\n",
            r"gave an array (2,); expected an array of real",
        ),
        ("def beside(drive, network):\n    return 'no'\n", "gave values of type <U2 in an array ()"),
        ("def beside(drive, network):\n    return drive.t + 1j\n", "gave complex numbers in an array (101,)"),
        (MASKED, "gave a masked array"),
        ("def beside(drive, network):\n    return drive.t.astype(object)\n", "gave values of type object"),
        (
            "def beside(drive, network):\n    return drive.t.astype('M8[s]')\n",
            "gave values of type datetime64[s]",
        ),
        ("def beside(drive, network):\n    return [[1.0], [1.0, 2.0]]\n", "gave a list that is not an array"),
        ("def beside(drive, network):\n    return None\n", "gave values of type object in an array ()"),
        ("def beside(drive, network):\n    return drive.t[:, None] + drive.t\n", "gave an array (101, 101)"),
        ("def beside(drive, network):\n    return drive.t + float('inf')\n", "my_measures:beside gave inf"),
        ("import nothing_of_this_name\n", "cannot be imported"),
        ("other = 1\n", "has no beside"),
    ],
)
def test_what_is_wrong_with_it_is_told_and_nothing_is_written(judged, tmp_path, module, says):
    code, _, error = judged(module)
    assert code == 2
    assert error.count("\n") == 1
    assert says in error
    assert str(tmp_path / "mine.toml") in error
    assert not (tmp_path / "out").exists()


def test_one_that_never_returns_is_told_by_name(tmp_path, set_constant, network):
    set_constant(criteria, "MEASURE_LIMIT", 0.1)  # a minute
    (tmp_path / "my_measures.py").write_text("def beside(drive, network):\n    while True: pass\n")
    (tmp_path / "mine.toml").write_text(CRITERIA.format(limit=3.0))
    own = criteria.read_criteria(tmp_path / "mine.toml").own[0]
    with pytest.raises(InputError, match=r"my_measures:beside did not answer within 0.1 s"):
        own.of(
            SimpleNamespace(drive=SimpleNamespace(t=np.arange(3.0), present=np.ones((3, 1))), network=network)
        )


def test_one_that_takes_the_name_of_ours_is_refused(judged):
    code, _, error = judged(criteria=CRITERIA.replace('"gap to the side"', '"TTC"'))
    assert (code, "the measure 'TTC' is a duplicate" in error) == (2, True)


@pytest.mark.parametrize("state", ["calls.append(1)", "random.random()"])
def test_it_knows_nothing_of_the_drives_before(tmp_path, state, network):
    module = f"import random\nimport numpy as np\n\ncalls = []\n\n\ndef beside(drive, network):\n    kept = {state}\n"
    (tmp_path / "my_measures.py").write_text(module + "    return np.full(3, kept or len(calls))\n")
    (tmp_path / "mine.toml").write_text(CRITERIA.format(limit=1.0))
    (mine,) = read_criteria(tmp_path / "mine.toml").own
    drive = SimpleNamespace(t=np.arange(3.0), present=np.ones((3, 1), dtype=bool))
    values = [mine.of(SimpleNamespace(drive=drive, network=network)).value.tolist() for _ in range(3)]
    assert values[0] == values[1] == values[2]


MAPPER = """import numpy as np


def beside(drive, network):
    network.roads.clear()
    return np.zeros(len(drive.t))
"""


def test_one_that_changes_the_map_is_named(judged):
    code, out, err = judged(MAPPER)
    assert code == 3
    assert "mine.toml: the code changed roads[" in err.replace("\n", "")
    assert "PASS" not in out


def test_the_name_that_the_table_had_is_told_what_to_write(judged):
    code, _, error = judged(criteria=CRITERIA.replace("[[measure]]", "[[objectification]]"))
    assert code == 2
    assert "there is no table [[objectification]]" in error
    assert "Write [[measure]]" in error


ENDLESS = """class Endless:
    def __array__(self, *arguments, **named):
        while True:
            pass


def beside(drive, network):
    return Endless()
"""


def test_one_whose_array_never_comes_is_told_by_name(tmp_path, set_constant, network):
    (tmp_path / "my_measures.py").write_text(ENDLESS)
    (tmp_path / "mine.toml").write_text(CRITERIA.format(limit=1.0))
    (mine,) = read_criteria(tmp_path / "mine.toml").own
    set_constant(criteria, "MEASURE_LIMIT", 0.5)
    drive = SimpleNamespace(t=np.arange(3.0), present=np.ones((3, 1), dtype=bool))
    with pytest.raises(InputError, match=r"did not answer within"):
        mine.of(SimpleNamespace(drive=drive, network=network))


def test_one_that_opens_a_file_its_hash_does_not_know_is_told(judged, tmp_path):
    (tmp_path / "limit.txt").write_text("0.5")
    file = str(tmp_path / "limit.txt")
    opens = f"import numpy as np\n\n\ndef beside(drive, network):\n    with open({file!r}) as file:\n"
    _, out, err = judged(opens + "        return np.full(len(drive.t), float(file.read()))\n")
    assert "the code opened limit.txt beside mine.toml, which its hash does not know" in " ".join(
        (out + err).split()
    )
