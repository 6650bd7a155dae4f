"""The project's exceptions: each message is one line that names the place, the value and the way out."""

from __future__ import annotations

from pathlib import Path


class JointscopeError(Exception):
    """Base of every error that a user can cause and mend; the command line prints it as one line."""


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
        where = f"{self.file}" + (f": {key}" if key else "")
        shown = "" if value is None else f" = {value!r}"
        way_out = f"; {fix}" if fix else ""
        super().__init__(" ".join(f"{where}{shown}: {problem}{way_out}".split()))


class CampaignError(InputError):
    """A campaign (``campaign.toml`` or a data file it names) breaks the campaign format."""


class RefusedError(JointscopeError):
    """The data can't carry the answer that was asked for; the message says why and what would."""


class MissingExtraError(JointscopeError):
    """An optional dependency is absent; the message is the command that installs it."""

    def __init__(self, purpose: str, extra: str) -> None:
        super().__init__(f"{purpose} needs the extra [{extra}]: pip install 'jointscope[{extra}]'")
