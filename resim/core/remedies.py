"""What to say where a file that somebody names is none of its kind; to be had without the libraries that read it."""

from __future__ import annotations

RECORDING = "A recording is a folder with recording.toml, gt.csv and a map."
DRIVE = "Give a recording, or the folder that `resim run` wrote."
BUILD = 'A build has name, version, factory = "module:name", files = [...], [parameters].'
BUILD_TABLES = {
    "process": '[process] has command = ["./program", ...], or python = "path/to/python" beside factory.',
    "grpc": '[grpc] has address = "host:port", and remote, digest, batches where they are wanted.',
    "fmi": '[fmi] has file = "unit.fmu"; [fmi.inputs] variable = "signal", [fmi.outputs] acceleration = "variable".',
    "recorded": '[recorded] has conversations = "folder", as `resim run --record` writes it.',
}
"""For faults of one table of a build file alone."""
CRITERIA = "See scenarios/criteria/highway.toml."
MODEL = "`resim perception train` writes such files; adfunc/perception/ has some."
SUITE = "See scenarios/suites/highway.toml, or make one with `resim suite new`."
SWEEP = "See scenarios/sweeps/perception_latency.toml."
SWEPT = "Name the folder that `resim sweep --out` wrote."
PLAYED = "Give a recording, the folder that `resim run` or `resim vary` wrote, or a JSCEN file (.json)."
MAP = "Check the path of the map."
