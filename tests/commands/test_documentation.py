"""What the documentation says can be done: every command parses, the pages' commands run, links lead somewhere."""

import argparse
import importlib
import re
import shlex
from pathlib import Path

import pytest

from jointscope.cli import main
from jointscope.commands import COMMANDS, MODULES

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
RUN = sorted([ROOT / "docs" / "tour.md", *(ROOT / "docs" / "how-to").glob("*.md")])
QUICK = ("identify.md", "sensitivity.md")  # the rest of the fenced commands run under the slow marker
FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```", re.M | re.S)
NOTHING_TO_DO = {"confirm": 2}  # exit code where no effect was found

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:dask")


def commands_of(text):
    """Every line that calls this tool, in fenced and indented blocks, continuation lines joined."""
    blocks = [body for kind, body in FENCE.findall(text) if not kind.startswith(("toml", "json", "python", "xml"))]
    rest = FENCE.sub("", text)
    blocks += ["\n".join(re.findall(r"^(?: {4}|\t)(.*)$", rest, re.M))]
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    found = []
    for line in lines:
        call = re.match(r"\s*(?:\$ )?(?:\.venv/bin/)?jointscope (.+)", line)
        if call:
            found.append(re.split(r"\s{3,}|\s+#\s|\s*[|>]\s", call[1])[0])
    return found


def inline_commands(text):
    """Commands inside a sentence or a table, as far as they have arguments."""
    return [c for c in re.findall(r"`jointscope ([^`\n]+)`", FENCE.sub("", text)) if " " in c.strip()]


def parsed(words):
    """The options of a command line, by the command's own parser."""
    name, rest = words[0], words[1:]
    module = importlib.import_module(f"jointscope.commands.{MODULES.get(name, name)}")
    parser = argparse.ArgumentParser(prog=name, exit_on_error=False)
    module.configure(parser)
    return parser.parse_args(rest)


def fails(call):
    words = shlex.split(call.rstrip(".:;,"), comments=True)
    if words[0] not in COMMANDS:
        return f"{call}: no such command"
    if "--help" in words:
        return None
    try:
        parsed(words)
    except (SystemExit, argparse.ArgumentError) as problem:
        return f"{call}: {problem}"
    return None


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_every_command_of_a_page_is_understood(path):
    text = path.read_text(encoding="utf-8")
    wrong = [problem for call in commands_of(text) if (problem := fails(call))]
    assert wrong == []


def test_inline_commands_name_commands_that_exist():
    wrong = [
        f"{path.name}: {call}"
        for path in PAGES
        for call in inline_commands(path.read_text(encoding="utf-8"))
        if call.split()[0] not in COMMANDS and not call.split()[0].isupper()
    ]
    assert wrong == []


def test_the_check_finds_a_command_and_an_option_that_do_not_exist():
    assert (
        fails("identfy bench --out id") and fails("identify bench --output id") and fails("identify") is not None
    )
    assert fails("identify bench --out id --band 5 60") is None


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_and_named_files_are_there(path):
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    targets = [t.partition("#")[0] for t in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in t and t[0] != "#"]
    lost = [t for t in targets if t and not (path.parent / t).exists()]
    named = re.findall(
        r"`((?:docs|models|recordings|identification|prediction|diagnosis|experiments)/[\w./-]+)", text
    )
    lost += [n for n in named if n.endswith((".py", ".md", ".toml", ".xml")) and not (ROOT / n).exists()]
    assert lost == []


def test_every_page_is_reached_from_the_index():
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    pages = [p.relative_to(ROOT / "docs").as_posix() for p in PAGES if p.is_relative_to(ROOT / "docs")]
    shown = {t for t in re.findall(r"\]\(([^)\s#]+)", index)}
    lost = [
        p
        for p in pages
        if p != "README.md" and p not in shown and p.partition("/")[0] not in ("decisions", "examples")
    ]
    assert lost == []


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The campaign that the pages call ``bench``."""
    folder = tmp_path_factory.mktemp("docs") / "bench"
    words = ["simulate", "single-joint", "--out", str(folder), "--seed", "1", "--hits", "3", "--repeats", "1"]
    assert main(words) == 0
    return folder


def run_page(path, bench, folder, monkeypatch, kinds):
    """Run the page's blocks of ``kinds`` from top to bottom, its named files written first."""
    monkeypatch.chdir(folder)
    if not (folder / "bench").exists():
        (folder / "bench").symlink_to(bench, target_is_directory=True)
    ran = 0
    for kind, body in FENCE.findall(path.read_text(encoding="utf-8")):
        language, _, name = kind.strip().partition(" ")
        if language == "toml" and name:
            (folder / name).write_text(body, encoding="utf-8")
        elif kind.strip() in kinds:
            for call in commands_of(f"```sh\n{body}```"):
                words = shlex.split(call)
                if words[:2] == ["simulate", "single-joint"] and "bench" in words:
                    continue  # the shared campaign stands for it
                assert main(words) in {0, NOTHING_TO_DO.get(words[0], 0)}, call
                ran += 1
    return ran


@pytest.mark.parametrize("name", QUICK)
def test_the_commands_of_a_quick_page_run(name, bench, tmp_path, monkeypatch):
    assert run_page(ROOT / "docs" / "how-to" / name, bench, tmp_path, monkeypatch, {"sh"}) > 0


@pytest.mark.slow
@pytest.mark.parametrize("path", RUN, ids=lambda p: p.name)
def test_the_commands_of_a_page_run(path, bench, tmp_path, monkeypatch):
    assert run_page(path, bench, tmp_path, monkeypatch, {"sh", "sh slow"}) > 0
