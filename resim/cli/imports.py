"""`resim import`: recordings of other formats become recording folders; a command for each of `FORMATS`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, MutableMapping
from dataclasses import replace
from functools import cache
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from resim.cli.app import app, command
from resim.cli.inputs import A_MAP, A_SOURCE
from resim.cli.terminal import add_to_json, say

if TYPE_CHECKING:
    from resim.recordings import Recording, RecordingTables
    from resim.recordings.formats.registry import FormatOption, RecordingFormat


class _FormatCommands(TyperGroup):
    """The commands of all formats, made when one is asked for: readers are slow to import."""

    @property
    def commands(self) -> MutableMapping[str, Any]:
        """The commands by name."""
        return _commands()

    @commands.setter
    def commands(self, none: MutableMapping[str, Any]) -> None:
        """Commands come from the registry alone."""


imports = typer.Typer(
    cls=_FormatCommands,
    help="Turn a recording of another format into a recording folder.",
    no_args_is_help=True,
)
app.add_typer(imports, name="import")


Map = Annotated[Path, typer.Option("--map", callback=A_MAP, help="OpenDRIVE map of the recording.")]
Ego = Annotated[str, typer.Option(help="Id of the object that becomes the EGO.")]
Start = Annotated[
    float | None,
    typer.Option(help="First time [s]; default: the EGO's first sample, or that of all rows."),
]
End = Annotated[
    float | None,
    typer.Option(help="Last time [s]; default: the EGO's last sample, or that of all rows."),
]
Out = Annotated[Path, typer.Option(help="Recording folder to write.")]


@cache
def _commands() -> MutableMapping[str, Any]:
    from resim.recordings.formats.registry import FORMATS

    made = typer.Typer(rich_markup_mode=None)
    for form in FORMATS:
        command(made, form.name, help=f"Import from {form.source}.")(format_command(form))
    command(made, "guess")(guess)
    return typer.main.get_group(made).commands


def guess(
    file: Annotated[
        Path,
        typer.Argument(
            callback=A_SOURCE,
            help="CSV or Parquet table of the ground truth, or a log that Autoware recorded.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Mapping (TOML) to write.")],
    sensor: Annotated[
        Path | None, typer.Option("--sd", metavar="FILE", help="CSV or Parquet table of the sensor data.")
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", callback=A_MAP, help="OpenDRIVE map: used to detect mirrored axes and time or UTM zones."
        ),
    ] = None,
) -> None:
    """Write a first mapping of a table for `resim import table`, from the data, with the reason of each line.

    Unknown entries are marked FILL IN. Of a log, one whose topics are Autoware's gets the mapping that ships.
    """
    from resim.core.errors import InputError
    from resim.recordings.mapped.guess import fill_ins
    from resim.recordings.mapped.guess import guess as guessed
    from resim.results import whole_file
    from resim.road.opendrive import load

    if out.exists():
        raise InputError(out, "exists already", "Remove it or name another file.")
    text = guessed(file, out, sensor=sensor, network=None if map_file is None else load(map_file))
    with whole_file(out, None) as beside:
        beside.write_text(text, encoding="utf-8")
    left = fill_ins(text)
    add_to_json(mapping=out, fill_in=left)
    say(f"{out}: written; {len(left)} lines to fill in, or to take out" if left else f"{out}: written")
    for line in left:
        say(f"  {line}")


def format_command(form: RecordingFormat) -> Callable[..., None]:
    """Give the function behind a command: it takes the format's file, what every import takes, the format's options."""

    def convert(
        *, map_file: Map, ego: Ego, out: Out, start: Start = None, end: End = None, **own: Any
    ) -> None:
        file = own.pop(form.file)
        _write(form.reader(file, map=map_file, ego=ego, start=start, end=end, **own), file, out)

    *common, _ = inspect.signature(convert, eval_str=True).parameters.values()
    file = Annotated[Path, typer.Argument(callback=A_SOURCE, help=form.file_help)]
    first = Parameter(form.file, Parameter.POSITIONAL_OR_KEYWORD, annotation=file)
    free = {"map_file": "map", "ego": "ego"}
    shared = [p.replace(default=None) if free.get(p.name) in form.works_out else p for p in common]
    parameters = [
        first,
        *(p.replace(kind=Parameter.KEYWORD_ONLY) for p in shared),
        *map(_parameter, form.options),
    ]
    convert.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    convert.__annotations__ = {p.name: p.annotation for p in parameters}
    return convert


def _parameter(option: FormatOption) -> Parameter:
    kind = option.type if option.required else option.type | None
    told = Annotated[kind, typer.Option(help=option.help, metavar=option.metavar)]  # type: ignore[valid-type]
    default = Parameter.empty if option.required else None
    return Parameter(option.name, Parameter.KEYWORD_ONLY, default=default, annotation=told)


def _write(found: Recording | RecordingTables, file: Path, out: Path) -> None:
    """Write the recording that was made of a file, and print what it holds and where it is from."""
    from resim.recordings import Recording, RecordingTables, write_tables
    from resim.road.opendrive import load

    tables = (
        replace(RecordingTables.of(found), gt_file=file, sd_file=file)
        if isinstance(found, Recording)
        else found
    )
    load(tables.map)  # a file that is no OpenDRIVE is told of now, not when the recording is run
    write_tables(tables, out)
    objects, span = tables.gt["id"].nunique(), tables.gt["t"].max() - tables.gt["t"].min()
    add_to_json(recording=out, objects=int(objects), duration=float(span), ego=tables.settings.ego,
         provenance=tables.settings.provenance)  # fmt: skip
    say(f"{out}: {objects} objects over {span:.2f} s, EGO {tables.settings.ego}")
    for topic, text in tables.settings.provenance.items():
        say(f"  {topic}: {text}")
