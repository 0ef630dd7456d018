"""Recording formats, one file each: a new one needs its file, and a line here."""
# ruff: noqa: F401  each file adds its format to the registry

import resim.recordings.formats.argoverse
import resim.recordings.formats.commonroad
import resim.recordings.formats.highd
import resim.recordings.formats.mcity
import resim.recordings.formats.openscenario
import resim.recordings.formats.osi
import resim.recordings.formats.table
