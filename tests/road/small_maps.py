"""OpenDRIVE text of small maps: straight roads, sections and lanes."""

from __future__ import annotations

WIDTH = '<width sOffset="0" a="{}" b="0" c="0" d="0"/>'


def lane(number, *, before=None, after=None, kind="driving", extra="", width=3.5):
    links = "".join(
        f'<{tag} id="{target}"/>'
        for tag, target in (("predecessor", before), ("successor", after))
        if target is not None
    )
    return f'<lane id="{number}" type="{kind}" {extra}><link>{links}</link>{WIDTH.format(width)}</lane>'


def section(*lanes, s=0.0):
    def side(sign):
        return "".join(text for number, text in lanes if (number > 0) - (number < 0) == sign)

    return (
        f'<laneSection s="{s}"><left>{side(1)}</left><center><lane id="0" type="none"/></center>'
        f"<right>{side(-1)}</right></laneSection>"
    )


def road(name, x, y, heading, length, lanes, *, before="", after="", junction="-1", rule=""):
    def link(tag, what):
        if not what:
            return ""
        kind, number, *contact = what.split(":")
        at = f' contactPoint="{contact[0]}"' if contact else ""
        return f'<{tag} elementType="{kind}" elementId="{number}"{at}/>'

    return (
        f'<road id="{name}" length="{length}" junction="{junction}" {rule}><link>{link("predecessor", before)}'
        f'{link("successor", after)}</link><planView><geometry s="0" x="{x}" y="{y}" hdg="{heading}" '
        f'length="{length}"><line/></geometry></planView><lanes>{lanes}</lanes></road>'
    )
