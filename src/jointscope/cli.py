"""The console script: finds the command, imports only that command's module, prints errors as one line."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor

from jointscope import __version__
from jointscope.commands import COMMANDS, MODULES
from jointscope.errors import JointscopeError

EPILOG = """start here:
  jointscope demo --out out/demo            the paper's single joint in short, plus pictures
  jointscope inspect CAMPAIGN               what a folder of recordings holds, and what is wrong with it
  jointscope identify CAMPAIGN --out DIR    stiffness, inertia and damping with intervals

Each command explains itself: jointscope COMMAND --help
"""


def _listing() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jointscope",
        description="A validation testbed for elastic robot joints.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=EPILOG,
    )
    parser.add_argument("--version", action="version", version=f"jointscope {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        commands.add_parser(name, help=summary, add_help=False)
    return parser


def _drop_output() -> None:
    """Where output can't be written, forget what waits in its buffer, or Python says so once more when it ends."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: Words after ``jointscope``; the process's own when ``None``.

    Returns:
        The exit code: 0 done, 1 the command's own "no" (a failed check), 2 unusable input, 130 interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words or words[0] not in COMMANDS:
        _listing().parse_args(words)
    name, rest = words[0], words[1:]
    # matrices here are small: threads of BLAS slow them down and make the last digits depend on the machine
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    module = importlib.import_module(f"jointscope.commands.{MODULES.get(name, name)}")
    parser = argparse.ArgumentParser(
        prog=f"jointscope {name}",
        description=module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    module.configure(parser)
    options = parser.parse_args(rest)
    try:
        code = int(module.run(options))
        sys.stdout.flush()
        return code
    except JointscopeError as problem:
        print(f"jointscope {name}: {problem}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        _drop_output()
        return 0
    except OSError as problem:
        place = f"{problem.filename}: " if problem.filename else ""
        print(f"jointscope {name}: {place}{' '.join(str(problem.strerror or problem).split())}", file=sys.stderr)
        _drop_output()
        return 2
    except MemoryError as problem:
        said = " ".join(str(problem).split())
        print(f"jointscope {name}: out of memory{f': {said}' if said else ''}", file=sys.stderr)
        return 2
    except BrokenExecutor:
        said = "a worker process was killed, by the system for its memory perhaps; finished work is kept"
        print(f"jointscope {name}: {said}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"jointscope {name}: interrupted; finished work is kept", file=sys.stderr)
        return 130
