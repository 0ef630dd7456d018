from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import duckdb
import pandas as pd
import pytest
from conftest import ROOT

from resim.core.errors import InputError, StopError
from resim.core.sealed import sealed
from resim.recordings import Recording
from resim.resimulation import ResimulationOptions, resimulate
from resim.results import (
    MODEL,
    PREDICTION,
    RUN,
    check_output,
    folders,
    locked,
    remove_results,
    whole_file,
    whole_folder,
    write_json,
    write_parquet,
    write_resimulation,
)
from resim.results.entry import digest
from resim.results.folders import FolderKind
from resim.scenario.jscen import read_jscen
from resim.simulation.function.interface import Build


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_a_folder_appears_whole(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "deep" / "out") as folder:
        (folder / "a").write_text("1")
        assert not (tmp_path / "deep" / "out").exists()
    assert names(tmp_path / "deep") == ["out"]
    assert (tmp_path / "deep" / "out" / "a").read_text() == "1"


def test_a_folder_in_which_an_input_lies_is_not_replaced(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "link").symlink_to(out)
    for one in (out, tmp_path / "link" / "inner" / "build.toml"):
        with pytest.raises(InputError, match="lies within --out"):
            check_output(tmp_path / "link", RUN, [one])
    check_output(out, RUN, [tmp_path, tmp_path / "out.toml"])


def mark(folder: Path, text: str) -> None:
    listed = [path.name for path in folder.iterdir()]
    write_json(sealed({"versions": {"resim": text}, "files": listed}), folder / RUN.mark)


def fail(out: Path, error: type[BaseException]) -> None:
    with whole_folder(out) as folder:
        mark(folder, "half")
        raise error


def test_what_is_nested_without_end_is_no_result(tmp_path: Path) -> None:
    (tmp_path / RUN.mark).write_text("[" * 100_000)
    with pytest.raises(InputError, match="is not a results folder"):
        check_output(tmp_path)


@pytest.mark.usefixtures("ends")
def test_a_pipe_is_no_result_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / RUN.mark)
    with pytest.raises(InputError, match="is not a results folder"):
        check_output(tmp_path)


@pytest.mark.usefixtures("ends")
def test_a_pipe_among_results_is_not_waited_for_by_who_registers_them(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"times": {}, "perception": {}, "checksum": ""}')
    os.mkfifo(tmp_path / "report.json")
    with pytest.raises(InputError, match=r"report.json: cannot be read"):
        digest(tmp_path, "run")


def test_results_go_where_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "far")
    with whole_folder(tmp_path / "out") as folder:
        mark(folder, "1")
    assert (tmp_path / "out").is_symlink()
    assert names(tmp_path / "far") == [RUN.mark]
    assert names(tmp_path) == ["far", "out"]


def test_one_command_at_a_time_writes_into_a_folder(tmp_path: Path) -> None:
    with (
        locked(tmp_path, "another `resim verify`"),
        pytest.raises(InputError, match="is written by another `resim verify`"),
        locked(tmp_path, "another `resim verify`"),
    ):
        pass
    with locked(tmp_path, "another `resim verify`"):
        pass


@pytest.mark.parametrize("shared", [False, True])
def test_what_a_command_writes_into_is_not_deleted(tmp_path: Path, shared: bool) -> None:
    with whole_folder(tmp_path / "out") as folder:
        mark(folder, "1")
    with (
        locked(tmp_path / "out", "this", shared=shared),
        locked(tmp_path / "out", "this", shared=True) if shared else contextlib.nullcontext(),
        pytest.raises(InputError, match="is written by another command at this moment"),
    ):
        remove_results(tmp_path / "out", RUN)
    remove_results(tmp_path / "out", RUN)
    assert names(tmp_path) == []


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_leaves_nothing_behind_and_the_old_results_as_they_were(
    tmp_path: Path, error: type[BaseException]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(error):
        fail(out, error)
    assert names(tmp_path) == []
    with whole_folder(out) as folder:
        mark(folder, "old")
    with pytest.raises(error):
        fail(out, error)
    assert names(tmp_path) == ["out"]
    assert "old" in (out / RUN.mark).read_text()


def test_new_results_take_the_place_of_old_ones(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for k in range(2):
        with whole_folder(out) as folder:
            (folder / f"map{k}.xodr").touch()
            mark(folder, str(k))
    assert names(out) == ["map1.xodr", RUN.mark]
    assert names(tmp_path) == ["out"]


def test_folders_that_are_no_results_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    check_output(tmp_path / "empty")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").touch()
    with pytest.raises(
        InputError, match=r"exists and is not a results folder \(it has no run\.json of resim"
    ):
        check_output(tmp_path / "mine")
    with pytest.raises(InputError, match="is no folder, expected one"):
        check_output(tmp_path / "mine" / "thesis.txt")
    os.mkfifo(tmp_path / "pipe")  # as devices are: /dev/null too
    with pytest.raises(InputError, match="is no folder, expected one"), whole_folder(tmp_path / "pipe"):
        pass
    assert (tmp_path / "pipe").is_fifo()
    (tmp_path / "loop").symlink_to("loop")
    for name, why in (
        ("loop", "is a link that leads to itself"),
        ("x" * 250, "a name of more than 230 bytes"),
    ):
        with pytest.raises(InputError, match=why):
            check_output(tmp_path / name)
    with pytest.raises(InputError, match=r"thesis\.txt is no folder that you may write"):
        check_output(tmp_path / "mine" / "thesis.txt" / "out")
    with (
        pytest.raises(InputError, match="is not a results folder"),
        whole_folder(tmp_path / "mine"),
    ):
        pass
    assert names(tmp_path / "mine") == ["thesis.txt"]


def test_files_of_others_in_a_results_folder_are_not_lost(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out) as folder:
        mark(folder, "1")
    (out / "notes.txt").touch()
    with pytest.raises(InputError, match=r"holds notes\.txt, which is not a resim result and would be lost"):
        check_output(out)
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / RUN.mark).write_text('{"my": "run"}')
    with pytest.raises(InputError, match="is not a results folder"):
        check_output(foreign)
    with pytest.raises(InputError, match="File name too long"):
        check_output(tmp_path / ("x" * 300))


@pytest.mark.parametrize("name", ["my_map_edit.xodr", "report.html", "old.xodr", "kpis.parquet"])
@pytest.mark.parametrize("what", ["file", "folder", "link"])
def test_only_plain_files_that_its_mark_lists_are_replaced(tmp_path: Path, name: str, what: str) -> None:
    out, far = tmp_path / "out", tmp_path / "far"
    far.write_text("precious")
    with whole_folder(out) as folder:
        (folder / "old.xodr").touch()
        mark(folder, "1")
    mine = out / name
    mine.unlink(missing_ok=True)
    if what == "folder":
        mine.mkdir()
        (mine / "thesis.txt").write_text("precious")
    elif what == "link":
        mine.symlink_to(far)
    else:
        mine.write_text("precious")
    ours = what == "file" and name != "my_map_edit.xodr"  # of a name that resim itself gave
    for refused in (check_output, lambda out: remove_results(out, RUN)):
        if not ours:
            with pytest.raises(InputError, match=f"holds {name}, which is not a resim result"):
                refused(out)
    assert mine.exists()
    check_output(out) if ours else None


def test_what_came_while_a_command_worked_is_kept_and_so_are_its_results(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for k in range(3):
        with pytest.raises(InputError) as told, whole_folder(out) as folder:  # noqa: PT012
            mark(folder, f"result {k}")
            out.mkdir(exist_ok=True)
            (out / "thesis.txt").write_text("precious")
        if k == 0:
            assert "was changed while the command ran (exists and is not a results folder" in str(told.value)
            assert str(told.value).endswith(f"was left alone. The results are in {tmp_path / 'out.new'}.")
        (out / "thesis.txt").rename(tmp_path / f"thesis{k}.txt")
    assert names(tmp_path) == [
        "out",
        "out.new",
        "out.new-1",
        "out.new-2",
        *(f"thesis{k}.txt" for k in range(3)),
    ]
    assert "result 2" in (tmp_path / "out.new-2" / RUN.mark).read_text()


@pytest.mark.parametrize("what", ["file", "link", "notes among results"])
def test_what_else_may_come_is_kept(tmp_path: Path, what: str) -> None:
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"The results are in .*out\.new\."), whole_folder(out) as folder:  # noqa: PT012
        mark(folder, "now")
        if what == "file":
            out.write_text("precious")
        elif what == "link":
            out.symlink_to(tmp_path / "nowhere")
        else:
            out.mkdir()
            mark(out, "other")
            (out / "notes.txt").touch()
    assert os.path.lexists(out)
    assert names(tmp_path) == ["out", "out.new"]


def test_results_of_another_command_that_ended_first_are_replaced(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out) as folder:
        mark(folder, "last")
        (tmp_path / "there").mkdir()
        mark(tmp_path / "there", "first")
        (tmp_path / "there").rename(out)
    assert "last" in (out / RUN.mark).read_text()
    assert names(tmp_path) == ["out"]


def test_an_edited_mark_lists_nothing(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out) as folder:
        mark(folder, "1")
    (out / "thesis.txt").touch()
    text = (out / RUN.mark).read_text()
    (out / RUN.mark).write_text(text.replace('"files": []', '"files": ["thesis.txt"]'))
    with pytest.raises(InputError, match="or one that was changed since"):
        check_output(out)


def test_a_disk_that_takes_no_more_ends_in_one_error_and_nothing_half_written(tmp_path: Path) -> None:
    program = f"""
import resource
from pathlib import Path
import pandas as pd
from resim.core.errors import InputError
from resim.results import whole_folder, write_json, write_parquet
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
for write in (lambda f: write_json(list(range(50_000)), f / "a.json"),
              lambda f: write_parquet(pd.DataFrame({{"x": [str(hash(k)) for k in range(50_000)]}}), f / "a.parquet")):
    try:
        with whole_folder(Path({str(tmp_path / "out")!r})) as folder:
            write(folder)
    except InputError as e:
        print(e)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 2
    assert all(line.startswith(f"{tmp_path / 'out'}: cannot be written: ") for line in lines)
    assert all("File too large" in line for line in lines)
    assert names(tmp_path) == []


def test_json_is_the_same_bytes_and_holds_no_nan(tmp_path: Path) -> None:
    write_json({"b": [1.5, None], "a": "ü"}, tmp_path / "a.json")
    assert json.loads((tmp_path / "a.json").read_text()) == {"b": [1.5, None], "a": "ü"}
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json({"a": float("nan")}, tmp_path / "b.json")


def test_tables_come_back_from_parquet_wherever_they_are_written(tmp_path: Path) -> None:
    table = pd.DataFrame({"id": ["a", "b"], "x": [1.5, float("nan")]})
    folder = tmp_path / "it's here"
    folder.mkdir()
    write_parquet(table, folder / "t.parquet")
    with duckdb.connect() as db:
        rows = db.read_parquet(str(folder / "t.parquet")).fetchall()
    assert rows[0] == ("a", 1.5)
    assert rows[1][0] == "b"


def test_results_are_written_with_everything_that_went_in_and_came_out(
    shipped: Callable[[str], Recording], build: Callable[[str], Build], tmp_path: Path
) -> None:
    recording = shipped("cut_in_brake")
    result = resimulate(recording, build("highway_pilot"), ResimulationOptions(seed=3))
    write_resimulation(result, tmp_path)
    jscen = [f"{name}.jscen.json" for name in ("GT", "SD", "rGT", "rSD")]
    assert names(tmp_path) == sorted(
        [
            *jscen,
            "answers.parquet",
            "plans.parquet",
            "proving_ground.xodr",
            "report.json",
            "run.json",
            "tracks.parquet",
        ]
    )
    for name in jscen:
        scenario = read_jscen(tmp_path / name)
        assert (tmp_path / scenario.map).read_bytes() == recording.map.read_bytes()
        assert (scenario.ego.id, [o.id for o in scenario.objects]) == ("ego", ["1"])
    with duckdb.connect() as db:
        query = f"SELECT source, count(*), min(t), max(t) FROM '{tmp_path}/tracks.parquet' GROUP BY source"
        rows = {row[0]: row[1:] for row in db.execute(query).fetchall()}
    assert set(rows) == {"GT", "SD", "rGT", "rSD", "perceived_rGT", "perceived_rSD"}
    assert rows["GT"][0] == len(recording.gt.to_frame())
    assert rows["perceived_rGT"][1:] == rows["rGT"][1:]
    run = json.loads((tmp_path / "run.json").read_text())
    text = json.dumps(run)
    for wanted in (build("highway_pilot").hash, "libsumo", "numpy", "gt.csv", "sd.csv", '"seed": 3'):
        assert wanted in text


def test_the_root_is_no_folder_for_results() -> None:
    with pytest.raises(InputError, match="is not a results folder"):
        check_output(Path("/"))


@pytest.mark.parametrize("renames", [1, 2])
def test_a_signal_while_results_take_their_place_loses_neither(tmp_path: Path, renames: int) -> None:
    out = tmp_path / "out"
    out.mkdir()
    mark(out, "before")
    seen = 0

    def stop(frame: object, event: str, of: object) -> None:
        nonlocal seen
        seen += event == "c_return" and of is os.rename
        if seen == renames:
            sys.setprofile(None)
            raise StopError(143)

    with pytest.raises(StopError), whole_folder(out) as folder:  # noqa: PT012
        mark(folder, "now")
        sys.setprofile(stop)
    assert ("before" if renames == 1 else "now") in (out / RUN.mark).read_text()
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("notes", [False, True])
def test_who_takes_the_name_meanwhile_loses_nothing_and_nobody_else_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, notes: bool
) -> None:
    """Between the two renamings somebody makes a folder of that name: all three are kept."""
    out = tmp_path / "out"
    out.mkdir()
    mark(out, "before")

    def look(folder: Path, kind: FolderKind = RUN) -> None:
        if folder.name.endswith(".old"):
            out.mkdir()
            (out / "log.txt").touch()
        check_output(folder, kind)

    with pytest.raises(InputError, match=r"The results are in .*out\.new"), whole_folder(out) as folder:  # noqa: PT012
        mark(folder, "now")
        if notes:
            (out / "notes.txt").touch()
        monkeypatch.setattr(folders, "check_output", look)
    assert names(tmp_path) == ["out", "out.new", "out.old"]
    assert names(out) == ["log.txt"]
    assert "before" in (tmp_path / "out.old" / RUN.mark).read_text()
    assert "now" in (tmp_path / "out.new" / RUN.mark).read_text()
    assert (tmp_path / "out.old" / "notes.txt").is_file() is notes


def test_a_file_that_somebody_wrote_by_hand_is_not_replaced(tmp_path: Path) -> None:
    """A perception model, or JSON that has a word of a prediction's in it."""
    model = tmp_path / "model.json"
    shutil.copy(ROOT / "adfunc" / "perception" / "latency.json", model)
    mine = tmp_path / "mine.json"
    mine.write_text('{"my precious notes": 1, "kinds": ["a", "b"], "fitted": true}')
    for path, kind in ((model, MODEL), (mine, PREDICTION)):
        before = path.read_bytes()
        with pytest.raises(InputError, match="would be lost"), whole_file(path, kind) as file:
            file.write_text("{}")
        assert path.read_bytes() == before
    trained = tmp_path / "trained.json"
    shutil.copy(ROOT / "adfunc" / "perception" / "proving_ground.json", trained)
    with whole_file(trained, MODEL) as file:
        file.write_text("{}")
    assert trained.read_text() == "{}"
