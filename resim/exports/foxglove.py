"""What viewers draw of a drive, as one MCAP file that needs no OSI, and a layout that shows it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from resim.exports.mcap_file import scene_topics, write_topics
from resim.exports.scenes import DRIVE_FRAME
from resim.exports.states import first_second, topic_of
from resim.report.player import PlayedDrive
from resim.report.player.colors import layer_colors

FILE, LAYOUT = "drive.mcap", "layout.json"


def write(drive: PlayedDrive, folder: Path) -> dict[str, str]:
    """Write scenes, curves and the log, and a layout for Foxglove and Lichtblick. Gives the file of each source."""
    with (folder / FILE).open("wb") as stream:
        write_topics(scene_topics(drive, first_second(drive)), stream, {"resim": {"drive": drive.name}})
    text = json.dumps(layout(drive), indent=2, ensure_ascii=False, sort_keys=True)
    (folder / LAYOUT).write_text(text + "\n", encoding="utf-8")
    return dict.fromkeys((layer.name for layer in drive.layers), FILE)


def layout(drive: PlayedDrive) -> dict[str, Any]:
    """Give panels that show a drive: from above, following the EGO; its speed, risk and TTC; and what happened."""
    shown = {f"/scene/{topic_of(layer.name)}": {"visible": layer.shown} for layer in drive.layers}
    having = [layer.name for layer in drive.layers if drive.ego in layer.tracks.ids]
    seen = {
        "followTf": f"EGO {'rGT' if 'rGT' in having else having[0]}" if having else DRIVE_FRAME,
        "followMode": "follow-position",
        "topics": {"/map": {"visible": True}, **shown}, "transforms": {f"frame:{DRIVE_FRAME}": {"visible": False}},
        "cameraState": {"perspective": False, "distance": 120, "phi": 0, "thetaOffset": 0},
    }  # fmt: skip
    curves = {
        "Plot!speed": [("ego", "v", False)],
        "Plot!risk": [("risk", "risk", True)],
        "Plot!ttc": [("risk", "ttc", True)],
    }
    panels: dict[str, Any] = {"3D!drive": seen, "RosOut!log": {}}
    for panel, wanted in curves.items():
        panels[panel] = {
            "paths": [
                {
                    "value": f"/{kind}/{topic_of(layer.name)}.{field}", "label": f"{layer.name} {field}",
                    "color": layer_colors(layer.name).ego[0], "enabled": True, "timestampMethod": "receiveTime",
                }
                for kind, field, of_danger in wanted
                for layer in drive.layers
                if layer.shown and (layer.danger is not None or not of_danger)
            ],
            "showLegend": True, "isSynced": True, "legendDisplay": "floating",
        }  # fmt: skip
    return {
        "configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row", "splitPercentage": 60, "first": "3D!drive",
            "second": {
                "direction": "column", "splitPercentage": 30, "first": "Plot!speed",
                "second": {
                    "direction": "column", "splitPercentage": 40, "first": "Plot!risk",
                    "second": {"direction": "column", "first": "Plot!ttc", "second": "RosOut!log"},
                },
            },
        },
    }  # fmt: skip
