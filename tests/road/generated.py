"""Draws valid OpenDRIVE roads: sections, widths, borders, lane offsets, heights and limits that begin anywhere."""

from __future__ import annotations

from hypothesis import strategies as st

ZERO = (0.0, 0.0, 0.0)


@st.composite
def roads(draw):
    """One <road> as text."""
    length = draw(st.floats(40.0, 900.0))
    starts = [0.0, *ascending(draw, length, 3)]
    sections, sides = [], []
    for k, (start, end) in enumerate(zip(starts, [*starts[1:], length], strict=True)):
        single = k > 0 and draw(st.booleans())
        told = draw(st.sampled_from(["left", "right"] if single else ["right", "left", "right left"])).split()
        sections.append(section(draw, start, end - start, told, single))
        sides.append(told)
    offsets = records(
        draw, "laneOffset", "s", length, st.floats(-2.0, 2.0), first=draw(st.sampled_from([0.0, 0.3, 0.6]))
    )
    heights = records(draw, "elevation", "s", length, st.floats(-50.0, 50.0))
    rolls = records(draw, "superelevation", "s", length, st.floats(-0.1, 0.1), slope=1e-5)
    bend = draw(
        st.sampled_from(
            ["<line/>", '<arc curvature="0.002"/>', '<spiral curvStart="-0.001" curvEnd="0.003"/>']
        )
    )
    return (
        f'<road id="1" length="{length!r}" junction="-1"><planView><geometry s="0" x="10" y="-20" hdg="0.7" '
        f'length="{length!r}">{bend}</geometry></planView><elevationProfile>{heights}</elevationProfile>'
        f"<lateralProfile>{rolls}</lateralProfile><lanes>{offsets}{''.join(sections)}</lanes></road>"
    )


def ascending(draw, end, most):
    """Some places between 0 and end that are a metre or more apart, some of them of few digits."""
    digits = draw(st.sampled_from([1, 3, 17]))
    found = sorted(
        round(draw(st.floats(0.02, 0.98)) * end, digits) for _ in range(draw(st.integers(0, most)))
    )
    return [s for i, s in enumerate(found) if s > 1.0 and (i == 0 or s - found[i - 1] > 1.0)]


def section(draw, start, length, sides, single):
    text = ""
    for side, sign in (("left", 1), ("center", 0), ("right", -1)):
        count = draw(st.integers(1, 3)) if side in sides else 0
        lanes = "".join(lane(draw, sign * number, length) for number in range(1, count + 1))
        if sign == 0:
            lanes = '<lane id="0" type="none"/>'
        text += f"<{side}>{lanes}</{side}>" if lanes else ""
    return f'<laneSection s="{start!r}" singleSide="{str(single).lower()}">{text}</laneSection>'


def lane(draw, number, length):
    side = 1 if number > 0 else -1
    if draw(st.integers(0, 3)):
        shape = records(draw, "width", "sOffset", length, st.floats(0.5, 5.0))
    else:
        shape = records(
            draw,
            "border",
            "sOffset",
            length,
            st.floats(3.0 * abs(number), 3.0 * abs(number) + 1).map(lambda t: side * t),
        )
    limit = "".join(
        f'<speed sOffset="{s!r}" max="{10 + 5 * i}" unit="m/s"/>'
        for i, s in enumerate(ascending(draw, length, 2))
    )
    return f'<lane id="{number}" type="driving">{shape}{limit}</lane>'


def records(draw, tag, s, length, values, *, first=0.0, slope=1e-3):
    """Polynomials one after the other, each from a drawn value on: the lane may step where one takes over."""
    text = ""
    for at in [first * length, *(s for s in ascending(draw, length, 3) if s > first * length + 1.0)]:
        a, b, c = draw(values), draw(st.floats(-slope, slope)), draw(st.floats(-1e-6, 1e-6))
        text += f'<{tag} {s}="{at!r}" a="{a!r}" b="{b!r}" c="{c!r}" d="0"/>'
    return text


def opendrive(road):
    return f'<OpenDRIVE><header revMajor="1" revMinor="8"/>{road}</OpenDRIVE>'
