"""How this project's pictures look, and how they are saved: whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from jointscope.atomic import replaced_file

MEASURED = "#1f4e79"
PREDICTED = "#d1495b"
THIRD = "#2a9d8f"
QUIET = "#8d99ae"
BAND = "#f2c1c7"

_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.6,
    "axes.edgecolor": "#6b7280",
    "xtick.color": "#374151",
    "ytick.color": "#374151",
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
}


@contextmanager
def style() -> Iterator[None]:
    """The project's look for every figure drawn inside."""
    with rc_context(_STYLE):
        yield


def save(figure: Figure, path: Path) -> Path:
    """Write ``figure`` as PNG to ``path``."""
    with replaced_file(path) as temporary:
        figure.savefig(temporary, dpi=130, format="png")
    return path
