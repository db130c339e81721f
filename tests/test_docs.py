"""The README and docs/: their commands and options exist, and what they point to is there."""

from __future__ import annotations

import ast
import csv
import importlib.util
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
TEXT = {str(page.relative_to(ROOT)): page.read_text() for page in PAGES}
BLOCK = re.compile(r"^```\w*\n(.*?)^```", re.MULTILINE | re.DOTALL)

PROGRAMS = ROOT / "docs/measurements/data/toolkit-programs.csv"
TOOLKIT = list(csv.reader(PROGRAMS.read_text().splitlines()))[1:]


def commands(text: str) -> list[str]:
    """Command lines of a page: those that begin a line of code, and those in backquotes."""
    lines = re.findall(r"^gsedit [a-z].*", "\n".join(BLOCK.findall(text)), re.MULTILINE)
    return lines + re.findall(r"`(gsedit [a-z][^`]*)`", BLOCK.sub("", text))


@cache
def verb(name: str) -> Any:
    """The command of `gsedit NAME`, or None."""
    from gsedit_cli.main import app

    group: Any = typer.main.get_command(app)
    found = group.get_command(typer.Context(group), name)
    return found and found.make_context(name, [], resilient_parsing=True).command


def options(command: Any, words: list[str]) -> set[str]:
    """Long options of a command, and of the one below it that the words name."""
    below = getattr(command, "commands", {})
    if words and words[0] in below:
        command = below[words[0]]
    params = command.get_params(typer.Context(command))
    names = {name for param in params for name in (*param.opts, *param.secondary_opts)}
    return {name for name in names if "--set." not in name and "--no-set." not in name}


@pytest.mark.parametrize("page", [page for page, text in TEXT.items() if commands(text)])
def test_commands_of_a_page_have_verbs_and_options_that_exist(page):
    for line in commands(TEXT[page]):
        words = shlex.split(line, comments=True)[1:]
        while words:
            end = words.index("then") if "then" in words else len(words)
            known = {*options(verb(words[0]), words[1:end]), "--help"} if verb(words[0]) else None
            assert known is not None, f"{line}: gsedit has no {words[0]}"
            used = {w.split("=")[0] for w in words[1:end] if re.match(r"--[a-z]", w)}
            if end < len(words) or "then" in line:
                known |= {"--output"}  # of the chain
            assert used <= known, f"{line}: {words[0]} has no {', '.join(sorted(used - known))}"
            words = words[end + 1 :]


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_links_of_a_page_outside_the_site_lead_somewhere(page):
    """mkdocs checks those of the site."""
    for target in re.findall(r"\]\(([^)#]+)", TEXT[page]):
        assert (ROOT / target).exists(), target


def test_the_readme_is_short_and_has_the_commands_of_a_newcomer():
    text = TEXT["README.md"]
    assert len(text.splitlines()) <= 100
    for command in ("git clone", "make demo", "make test", "source .venv/bin/activate"):
        assert command in text


@pytest.mark.skipif(not Path(sys.prefix, "bin/activate").exists(), reason="not in a venv")
def test_the_line_of_the_readme_makes_gsedit_a_command():
    (line,) = re.findall(r"^source \.venv\S*", TEXT["README.md"], re.MULTILINE)
    line = line.replace(".venv", shlex.quote(sys.prefix))
    script = f"{line} && command -v gsedit && gsedit --help"
    path = {"PATH": "/usr/bin:/bin"}
    found = subprocess.run(["bash", "-c", script], env=path, capture_output=True, text=True)
    assert found.stdout.splitlines()[0] == str(Path(sys.prefix, "bin/gsedit"))
    assert found.returncode == 0


@pytest.mark.parametrize("page", list(TEXT))
def test_files_and_experiments_that_a_page_names_exist(page):
    folders = "cli|docs|examples|gsedit|rasterizer|tests"
    for path in re.findall(rf"`((?:{folders})/[\w/.-]*)`", TEXT[page]):
        assert (ROOT / path).exists(), path
    for module in re.findall(r"python\s+-m\s+(research[\w.]+)", TEXT[page]):
        path = ROOT / "examples" / module.rstrip(".").replace(".", "/")
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), module


def test_paths_of_docs_in_the_code_exist():
    for folder in ("cli", "gsedit", "rasterizer", "examples", "tests"):
        for file in (ROOT / folder).rglob("*.py"):
            for path in re.findall(r"\bdocs/[\w/]+\.md", file.read_text()):
                assert (ROOT / path).exists(), f"{file}: {path}"


GLOSSARY = [
    (line.split(" | ")[0].strip("| "), name)
    for line in TEXT["docs/concepts/glossary.md"].splitlines()
    if line.startswith("| ")
    for name in re.findall(r"`([^`]+)`", line.split(" | ")[-1])
]


@cache
def code() -> tuple[dict[str, set[str]], set[str]]:
    """Names that the classes of each name define, and those of their bases in the code; and names
    of classes, functions, fields, constants and texts. The trees are not kept."""
    nodes = [
        node
        for folder in ("gsedit", "rasterizer", "cli")
        for file in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
    ]
    classes: dict[str, list[ast.ClassDef]] = {}
    for node in nodes:
        if isinstance(node, ast.ClassDef):
            classes.setdefault(node.name, []).append(node)

    def of(node: ast.ClassDef) -> set[str]:
        own = {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
        fields = (n.target for n in node.body if isinstance(n, ast.AnnAssign))
        own |= {target.id for target in fields if isinstance(target, ast.Name)}
        bases = (classes.get(ast.unparse(base), []) for base in node.bases)
        return own.union(*(of(base) for found in bases for base in found))

    members = {name: set().union(*map(of, found)) for name, found in classes.items()}
    names = set(members).union(*members.values())
    for node in nodes:
        if isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.add(node.value)
    return members, names


@cache
def every_option() -> set[str]:
    """Long options of all commands."""
    from gsedit_cli.main import app

    group: Any = typer.main.get_command(app)
    context = typer.Context(group)
    return set().union(*(options(verb(name), []) for name in group.list_commands(context)))


@pytest.mark.parametrize(("term", "name"), GLOSSARY)
def test_every_name_of_the_glossary_is_in_the_code(term, name):
    if name.startswith("gsedit "):
        assert verb(name.split()[1])
    elif name.startswith("--"):
        assert name.split()[0] in every_option()
    elif (ROOT / (name.replace(".", "/") + ".py")).is_file():
        return  # a module
    elif "." in name and name[0].isupper():
        record, member = name.split(".")
        assert member in code()[0][record]
    else:
        assert name.removesuffix("()") in code()[1]


def test_the_page_of_all_commands_has_every_option():
    pytest.importorskip("mkdocs")
    spec = importlib.util.spec_from_file_location("hooks", ROOT / "docs/hooks.py")
    assert spec is not None
    assert spec.loader is not None
    hooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hooks)
    page = hooks.command_line()
    known = {name for name in every_option() if name.startswith("--")}
    assert len(known) > 100
    assert known <= set(re.findall(r"--[a-z][\w-]*", page))


def test_the_glossary_was_read():
    assert len(GLOSSARY) > 60


def test_the_toolkit_table_was_read():
    assert len(TOOLKIT) > 30


@pytest.mark.parametrize("row", TOOLKIT, ids=lambda row: row[0])
def test_every_claim_of_the_toolkit_names_tests_that_exist(row):
    claim, proof = row[8], row[9]
    if claim.startswith("–") or proof.startswith("the suite"):
        return
    for test in proof.split(", "):
        found = re.fullmatch(r"(tests/[\w/]+\.py)::(test_\w+)", test)
        assert found, test
        path, name = found.groups()
        assert re.search(rf"^def {name}\(", (ROOT / path).read_text(), re.MULTILINE)


def test_every_place_of_the_architecture_exists():
    named = re.findall(r"`((?:gsedit|cli|tests)/[^`]+)`", TEXT["docs/concepts/architecture.md"])
    assert len(named) > 20
    assert [each for each in named if not (ROOT / each).exists()] == []
