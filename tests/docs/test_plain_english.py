"""Words and phrases that readers stumbled over, and the better ones: the former stand in no text that a user reads."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HISTORIC = ("validation.md",)  # says of what was measured then, in the words of then

STOP = {
    r"[^*\[]\bobjectification": "measure",
    r"because of whom": "which object",
    r"\b(?:go|goes|gone|going) on with\b": "is resumed",
    r"in spite of (?:which|findings)": "continue despite findings with this code",
    r"\bparted by\b": "separated by",
    r"\bresults of before\b": "past results",
    r"[Ee]qual are\b": "KPI outcomes match; values may differ",
    r"\botherwise than\b": "differently from",
    r"\bless (?:measured|before|true|old|that)\b": "minus; change (new - old); after removing it",
    r"\b(?:they|EGOs|ways) part at\b": "they diverge at",
    r"\blimits? (?:of the suite )?(?:is|are|was|were) (?:broken|kept)\b|\blimits? (?:broken|kept)\b": "exceeded, met",
    r"\brests on\b": "is judged by",
    r"\bsame looks first\b|\b[Ll]ook a map over\b": "runs the same checks first",
    r"\bends as it would\b": "the job's outcome is unaffected",
    r"\bis no object of it\b": "was not found in",
    r"\bwrites one of all\b": "writes a suite of all",
    r"\bno value swept keeps\b|\bholds in no run\b": "never met in this sweep",
    r"\btaken apart\b": "decomposed",
    r"\btells no\b": "gives no",
    r"\bstands twice\b": "duplicate",
    r"\blets? be seen\b": "runs GT through this model",
    r"\bput right\b|\bis left is told\b": "repairs what is safe, reports the rest",
    r"How late, how wrong, how blind\?": "Sweep perception errors",
    r"\b(?:nobody|anybody) knows\b": "it is unknown",
    r"\bno (?:result|results|such file|file) of resim\b": "not a resim result",
    r"\b[Ww]hoever\b": "which object, or the user",
    r"\b(?:is|are|was|were) told (?:by|line|only|as well)\b|\btold only\b": "is reported",
    r"\bless the time\b": "minus the time",
    r"\bas good: ": "equally good",
}
"""What must not be said: what may stand in its place."""


def pages() -> Iterator[tuple[str, str]]:
    """What stands on pages, help of commands and findings among it, without code of examples."""
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        if path.name not in HISTORIC:
            page = re.sub(r"^```(?:python|toml|json).*?^```", "", path.read_text("utf-8"), flags=re.M | re.S)
            for k, paragraph in enumerate(page.split("\n\n")):
                yield f"{path.relative_to(ROOT)}, paragraph {k}", re.sub(r"\s+", " ", paragraph)


def messages() -> Iterator[tuple[str, str]]:
    """What the code says: its strings, f-strings with {} where a value stands; no docstrings."""
    for path in sorted((ROOT / "resim").rglob("*.py")):
        inside: set[ast.AST] = set()
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Expr):  # a docstring, of a constant too
                inside.add(node.value)
            elif isinstance(node, ast.JoinedStr):
                inside.update(node.values)
                parts = [v.value if isinstance(v, ast.Constant) else "{}" for v in node.values]
                yield f"{path.relative_to(ROOT)}:{node.lineno}", "".join(map(str, parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in inside:
                yield f"{path.relative_to(ROOT)}:{node.lineno}", node.value


@pytest.mark.parametrize("texts", [pages, messages])
def test_texts_have_none_of_the_phrases_that_readers_stumbled_over(texts) -> None:
    rules = [(re.compile(bad), good) for bad, good in STOP.items()]
    found = [
        f"{where}: {hit[0]!r}, better {good!r}, in: {text[max(hit.start() - 40, 0) : hit.end() + 40]}"
        for where, text in texts()
        for rule, good in rules
        if (hit := rule.search(text))
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "text", ["a limit of the suite is broken", "the verdict rests on GT", "0.1 m less that"]
)
def test_the_phrases_are_found(text: str) -> None:
    assert any(re.search(bad, text) for bad in STOP)
