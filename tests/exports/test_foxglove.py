"""Scenes hold what the drive holds, as the published reader of MCAP and the schemas in the file give them."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import HealthCheck, given, settings

from resim.jobs.export import recorded_drive
from resim.recordings import Recording
from resim.road.opendrive import load

pytest.importorskip("foxglove")
pytest.importorskip("mcap_protobuf")
from exports.drives import MAP, recordings
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from resim.exports import foxglove


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=40)
@given(recording=recordings())
def test_what_goes_out_is_read_as_it_was(
    recording: Recording, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Boxes to 1e-6 m, times to 1e-9 s of the recording's clock (of one below 0: from a whole second on); speeds of the
    EGO."""
    folder = tmp_path_factory.mktemp("out")
    drive = recorded_drive(recording, load(MAP))
    foxglove.write(drive, folder)
    found: dict[str, list] = {}
    with (folder / "drive.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, told in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, told))
    moves = [t for _, told in found["/tf"] for t in told.transforms]
    (origin,) = [t.translation for t in moves if t.child_frame_id == "drive"]
    first = min(0, *(math.floor(layer.tracks.t[0]) for layer in drive.layers))
    for layer in drive.layers:
        true, shown = layer.tracks, found[f"/scene/{layer.name}"]
        assert len(shown) == len(true.t)
        for k, (now, told) in enumerate(shown):
            assert abs(Fraction(now, 10**9) + first - Fraction(float(true.t[k]))) <= Fraction(1, 10**9)
            there = {true.ids[n]: n for n in range(len(true)) if true.valid[n, k]}
            assert sorted(entity.id for entity in told.entities) == sorted(there)
            for entity in told.entities:
                n, (box,) = there[entity.id], entity.cubes
                at, turn = box.pose.position, box.pose.orientation
                assert at.x + origin.x == pytest.approx(true.x[n, k], rel=0, abs=1e-6)
                assert at.y + origin.y == pytest.approx(true.y[n, k], rel=0, abs=1e-6)
                turned = 2.0 * math.atan2(turn.z, turn.w) - true.heading[n, k]
                assert math.remainder(turned, math.tau) == pytest.approx(0.0, abs=1e-9)
                assert (box.size.x, box.size.y) == (true.length[n], true.width[n])
        if recording.ego in true.ids:
            n = true.index(recording.ego)
            speeds = [one.v for _, one in found[f"/ego/{layer.name}"]]
            assert speeds == pytest.approx(true.v[n, true.valid[n]].tolist(), abs=1e-12)
