"""The rooms at the top of the repository are the packages that users import."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from jointscope.commands import COMMANDS, MODULES

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ["models", "recordings", "sim", "identification", "prediction", "diagnosis", "experiments"]


@pytest.mark.parametrize("room", ROOMS)
def test_each_room_is_one_package_reached_through_a_relative_link(room):
    """Link, folder and import agree, and the link works in any clone."""
    link = ROOT / "src" / "jointscope" / room
    assert link.is_symlink()
    assert not link.readlink().is_absolute()
    assert link.resolve() == ROOT / room
    assert importlib.import_module(f"jointscope.{room}").__doc__


@pytest.mark.parametrize("name", COMMANDS)
def test_each_listed_command_exists_and_teaches(name):
    """A command has a module, a help text of more than a line, configure and run."""
    module = importlib.import_module(f"jointscope.commands.{MODULES.get(name, name)}")
    assert len(module.__doc__.strip().splitlines()) > 1
    assert callable(module.configure)
    assert callable(module.run)


def test_help_imports_nothing_heavy():
    """``jointscope --help`` stays quick: no NumPy, no MuJoCo."""
    code = (
        "import sys; from jointscope.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print([m for m in ('numpy', 'scipy', 'mujoco', 'matplotlib', 'numba') if m in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert ran.stdout.splitlines()[-1] == "[]"
