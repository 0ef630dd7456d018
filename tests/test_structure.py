"""What holds for all of resim's source: names that mean one thing, and functions that a reader can take in."""

import ast
import importlib
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

RESIM = Path(__file__).parents[1] / "resim"
LONGEST = 60
"""Lines of a function at most, with its signature and docstring."""


def modules() -> Iterator[tuple[str, ast.Module]]:
    for path in sorted(RESIM.rglob("*.py")):
        yield path.relative_to(RESIM).as_posix(), ast.parse(path.read_text("utf-8"))


def functions() -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Every function with its file, line and name."""
    for path, module in modules():
        for node in ast.walk(module):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield f"{path}:{node.lineno} {node.name}", node


def aliases(module: ast.Module) -> Iterator[str]:
    """Names of types that a module gives by assignment: `Floats = NDArray[...]`."""
    for node in module.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(target, ast.Name) and target.id[:1].isupper() and not target.id.isupper():
                yield target.id


def test_no_two_classes_share_a_name_nor_a_class_and_a_type_alias() -> None:
    classes, other = defaultdict(list), defaultdict(list)
    for path, module in modules():
        for node in ast.walk(module):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                classes[node.name].append(path)
        # aliases of cli/ are options of commands, named after what they take; those of kernels stand in numba's cache,
        # which cannot be read where one has another name
        if not path.startswith("cli/") and "/kernel/" not in path:
            for name in aliases(module):
                other[name].append(path)
    shared = {
        name: [*where, *other[name]] for name, where in classes.items() if len(where) + len(other[name]) > 1
    }
    assert not shared


def test_no_function_is_longer_than_sixty_lines() -> None:
    long = [
        where
        for where, node in functions()
        if node.end_lineno is not None and node.end_lineno - node.lineno >= LONGEST
    ]
    assert not long


def test_no_more_functions_have_many_parameters() -> None:
    many = [
        where
        for where, node in functions()
        if len(
            {a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)}
            - {"self", "cls"}
        )
        > 6
    ]
    assert len(many) <= 35, many  # commands have their options


def test_what_ruff_knows_by_a_path_is_there() -> None:
    lint = tomllib.loads((RESIM.parent / "pyproject.toml").read_text("utf-8"))["tool"]["ruff"]["lint"]
    paths = lint["flake8-bandit"]["extend-markup-names"] + lint["flake8-bugbear"]["extend-immutable-calls"]
    for path in [*paths, *lint["flake8-tidy-imports"]["banned-api"]]:
        module, _, name = path.rpartition(".")
        assert hasattr(importlib.import_module(module), name), path
    for path in lint["per-file-ignores"]:
        assert list(RESIM.parent.glob(path)), path
