"""Build the API reference from the docstrings: python docs/build_reference.py OUT. A warning of the builder is an error."""

import sys
import warnings
from pathlib import Path

import glfw  # noqa: F401  asks the system for its version by a process, which the builder would not let it start
import pdoc


def build(out: Path) -> None:
    """Write one page per module below ``out``."""
    warnings.filterwarnings("error", category=UserWarning)
    # a frozen dataclass that extends one of another module inherits annotations whose names live there
    warnings.filterwarnings("ignore", message=r"Error parsing type annotation .*\.__init__")
    pdoc.render.configure(docformat="google", math=True)
    pdoc.pdoc("jointscope", output_directory=out)


if __name__ == "__main__":
    build(Path(sys.argv[1]))
