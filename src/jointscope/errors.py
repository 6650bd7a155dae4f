"""The project's exceptions: each message is one line that names the place, the value and the way out."""

from __future__ import annotations

import reprlib
from pathlib import Path

_LONGEST = 240  # characters of a part of a message; what came from a broken file may have any length
_LONGEST_FIX = 700  # our own words mostly: lists of what is known are longer


class JointscopeError(Exception):
    """Base of every error that a user can cause and mend; the command line prints it as one line."""

    def __init__(self, message: str = "") -> None:
        super().__init__(_printable(message))

    def __reduce__(self) -> tuple[object, ...]:
        """As it is to other processes: by its message, whatever a subclass is made from."""
        return _restored, (type(self), str(self), dict(vars(self)))


def _restored(kind: type[JointscopeError], message: str, attributes: dict[str, object]) -> JointscopeError:
    problem = kind.__new__(kind, message)
    problem.args = (message,)
    vars(problem).update(attributes)
    return problem


class InputError(JointscopeError):
    """Something that was handed in can't be used as it is.

    Attributes:
        file: The file at fault.
        key: The key, channel or record in it, or ``None`` where the whole file is meant.
        value: The offending value as found, or ``None`` where it is absent.
    """

    def __init__(
        self, file: Path | str, key: str | None, problem: str, *, value: object = None, fix: str = ""
    ) -> None:
        self.file = Path(file)
        self.key = key
        self.value = value
        where = f"{self.file}" + (f": {_part(key)}" if key else "")
        shown = "" if value is None else f" = {_shown(value)}"
        way_out = f"; {_part(fix, _LONGEST_FIX)}" if fix else ""
        super().__init__(f"{where}{shown}: {_part(problem)}{way_out}")


def _shown(value: object) -> str:
    """A value as found, cut where it is long, wide or deep."""
    short = reprlib.Repr()
    short.maxstring = short.maxother = short.maxlong = 100
    short.maxlist = short.maxtuple = short.maxdict = 8
    try:
        return short.repr(value)
    except ValueError:  # Python prints no number of thousands of digits
        return f"a {type(value).__name__} of thousands of digits"


def _part(text: str, longest: int = _LONGEST) -> str:
    return text if len(text) <= longest else f"{text[: longest // 2]} ... {text[-longest // 2 :]}"


def _printable(text: str) -> str:
    """One line: white space as single spaces, what a terminal would act on or not show as its escape."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in line)


class CampaignError(InputError):
    """A campaign (``campaign.toml`` or a data file it names) breaks the campaign format."""


class RefusedError(JointscopeError):
    """The data can't carry the answer that was asked for; the message says why and what would."""


class MissingExtraError(JointscopeError):
    """An optional dependency is absent; the message is the command that installs it."""

    def __init__(self, purpose: str, extra: str) -> None:
        super().__init__(f"{purpose} needs the extra [{extra}]: pip install 'jointscope[{extra}]'")
