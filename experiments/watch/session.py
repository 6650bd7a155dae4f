"""A session at the bench: what has been seen, what was judged, and what there is to say about it.

Files are read only when they have stopped changing; one that can't be read is tried again whenever it changes, and
reported when it has stayed as it is. A take whose file is written anew is judged anew and replaces the old one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from jointscope.errors import CampaignError, InputError
from jointscope.experiments.watch.arrivals import Stamp, look, settled
from jointscope.experiments.watch.coverage import Coverage, coverage
from jointscope.experiments.watch.judging import Take, judge
from jointscope.experiments.watch.precision import Known, known_so_far
from jointscope.experiments.watch.template import Arrived, Kind, assemble, fits, kinds_of, lacking
from jointscope.recordings.campaign import Campaign
from jointscope.recordings.files import open_data_file
from jointscope.recordings.reader import campaign_of, parse_campaign

PATIENCE = 5.0  # s that an unreadable file may stay as it is before it is reported


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A take was judged.

    Attributes:
        like: Id of the template's run whose keys it was given; empty where campaign.toml names the take itself.
        again: Whether it replaces an earlier take of the same files.
    """

    take: Take
    like: str
    again: bool


@dataclass(frozen=True, kw_only=True)
class Unusable:
    """A file that no take was made of, and why."""

    file: str
    why: str


@dataclass(frozen=True, kw_only=True)
class Standing:
    """What is known and what is missing after the takes so far."""

    takes: int
    repeats: int
    known: tuple[Known, ...]
    coverage: Coverage

    @property
    def next_take(self) -> str | None:
        """The hits that K, J_L and c still want, then what most effects wait for; ``None`` where nothing is missing."""
        more = max((known.more_hits or 0 for known in self.known), default=0)
        if more:
            return f"{more} more hit{'s' if more > 1 else ''} for K, J_L and c"
        return self.coverage.next_take


Event = Judged | Unusable | Standing


class Session:
    """What a watched folder has shown so far."""

    def __init__(self, folder: Path, like: Path | None, *, within: float) -> None:
        """``like``: a campaign whose runs are the template; ``within``: wanted relative half width of K, J_L and c.

        Raises:
            InputError: No such folder, or nothing that says what the columns mean.
        """
        if not folder.is_dir():
            raise InputError(folder, None, "no such folder")
        self.folder, self.within = folder, within
        self.file = folder / "campaign.toml"
        self.template: Mapping[str, Any] | None = None
        if like is not None:
            self.template = parse_campaign(like / "campaign.toml" if like.is_dir() else like)
        elif not self.file.is_file():
            raise InputError(
                folder, None, "nothing says what its columns mean",
                fix="name a campaign with the same columns, --like CAMPAIGN, or make one of the first take: jointscope new",
            )  # fmt: skip
        self.document: Mapping[str, Any] | None = None  # the folder's own campaign.toml, as last readable
        self.seen: dict[Path, Stamp] = {}
        self.handled: dict[Path, Stamp] = {}
        self.reported: dict[Path, Stamp] = {}
        self.pool: list[Arrived] = []
        self.takes: dict[frozenset[Path], Take] = {}
        self.judged_by: dict[
            frozenset[Path], object
        ] = {}  # the run table and the states of the files it was judged by

    # --- one look --------------------------------------------------------------------------------------------------

    def look(self, now: float, quiet: float) -> list[Event]:
        """What is new at ``now`` [s], taking files that have not changed for ``quiet`` [s] as finished."""
        self.seen = look(self.folder, self.seen, now)
        ready = settled(self.seen, now, quiet)
        events: list[Event] = list(self._own_runs(ready, now, quiet))
        events += self._new_files(ready, now, quiet)
        if any(isinstance(event, Judged) for event in events):
            events.append(self.standing())
        return events

    def standing(self) -> Standing:
        """What the usable takes amount to."""
        usable = [take for take in self.takes.values() if take.verdict != "repeat"]
        # what is to be mended would spoil the estimate of what is sound
        sound = [take for take in usable if take.verdict == "good"]
        campaign = self._campaign()
        return Standing(
            takes=len(usable),
            repeats=len(self.takes) - len(usable),
            known=known_so_far(campaign, sound, self.within),
            coverage=coverage(campaign, usable),
        )

    @property
    def waiting(self) -> tuple[Unusable, ...]:
        """Files that still wait for those of another device."""
        kinds = self._kinds()
        found = []
        for file in self.pool:
            others = {len(kind.columns) - 1 for kind, _ in fits(file, kinds)} or {1}
            why = f"waits for the file{'s' if max(others) > 1 else ''} of the other device{'s' if max(others) > 1 else ''}"
            found.append(Unusable(file=file.path.name, why=why))
        return tuple(found)

    # --- runs that the folder's own campaign.toml names ---------------------------------------------------------------

    def _own_runs(self, ready: Sequence[Path], now: float, quiet: float) -> list[Event]:
        events: list[Event] = []
        if self.file in ready and not self.seen[self.file].same(self.handled.get(self.file)):
            try:
                self.document = parse_campaign(self.file)
                self.handled[self.file] = self.seen[self.file]
                self.reported.clear()  # what a file lacked may be what the new text says
            except (CampaignError, OSError) as problem:
                events += self._complaint(self.file, problem, now, quiet)
        for run in (self.document or {}).get("run", ()):
            paths = [self.folder / stream["file"] for stream in run["stream"]]
            if all(path in ready or (path.is_file() and path not in self.seen) for path in paths):
                events += self._judge(run, paths, self.document or {}, "", now, quiet)
        return events

    # --- files that only the template explains ------------------------------------------------------------------------

    def _new_files(self, ready: Sequence[Path], now: float, quiet: float) -> list[Event]:
        named = {self.folder / s["file"] for run in (self.document or {}).get("run", ()) for s in run["stream"]}
        self.pool = [file for file in self.pool if file.path in self.seen and file.path not in named]
        kinds = self._kinds()
        document = self.template or self.document
        events: list[Event] = []
        for path in ready:
            if path == self.file or path in named or not kinds:
                continue
            if any(self.seen[path].same(stamp.get(path)) for stamp in (self.handled, self.reported)):
                continue
            events += self._place(path, kinds, now, quiet)
        takes, self.pool = assemble(self.pool, kinds)
        for taken in takes:
            paths = [file.path for file in taken.files]
            events += self._judge(taken.run, paths, document or {}, str(taken.kind.run["id"]), now, quiet)
        return events

    def _place(self, path: Path, kinds: Sequence[Kind], now: float, quiet: float) -> list[Event]:
        try:
            data = open_data_file(path)
        except (CampaignError, OSError) as problem:
            return self._complaint(path, problem, now, quiet)
        self.handled[path] = self.seen[path]
        file = Arrived(path, frozenset(data.columns) | frozenset(data.aliases))
        self.pool = [other for other in self.pool if other.path != path]
        if fits(file, kinds):
            self.pool.append(file)
            return []
        lacks = ", ".join(sorted(lacking(file, kinds)))
        held = ", ".join(sorted(data.columns)) or "no columns"
        why = f"no run of the template has such columns: it holds {held[:120]}; the nearest also needs {lacks}"
        return [Unusable(file=path.name, why=why)]

    def _judge(
        self, run: Mapping[str, Any], paths: Sequence[Path], document: Mapping[str, Any], like: str, now: float,
        quiet: float,
    ) -> list[Event]:  # fmt: skip
        key = frozenset(paths)
        watched = [path for path in paths if path in self.seen]
        by = (repr(run), [(self.seen[path].size, self.seen[path].modified) for path in watched])
        if self.judged_by.get(key) == by:
            return []
        if watched and self.seen[watched[0]].same(self.reported.get(watched[0])):
            return []
        try:
            campaign = campaign_of({**document, "run": [run]}, self.file)
            before = [take for other, take in self.takes.items() if take.verdict == "good" and other != key]
            take = judge(campaign.runs[0], campaign, before)
        except (
            Exception
        ) as problem:  # a library may raise what it likes at half a file, and the session must go on
            for path in watched:  # placed anew at the next look
                self.handled.pop(path, None)
            return self._complaint(paths[0], problem, now, quiet)
        again = self.takes.pop(key, None) is not None
        self.takes[key], self.judged_by[key] = take, by
        self.handled.update({path: self.seen[path] for path in watched})
        return [Judged(take=take, like=like, again=again)]

    def _complaint(self, path: Path, problem: Exception, now: float, quiet: float) -> list[Event]:
        """A file that can't be read is reported once, when it has stayed as it is; until then it may be half-written."""
        stamp = self.seen.get(path)
        if stamp is None or stamp.same(self.reported.get(path)):
            return []
        if now - stamp.since < (PATIENCE if quiet > 0.0 else 0.0):
            return []
        self.reported[path] = stamp
        return [Unusable(file=path.name, why=" ".join(str(problem).split()))]

    def _kinds(self) -> tuple[Kind, ...]:
        document = self.template or self.document
        return kinds_of(document) if document is not None else ()

    def _campaign(self) -> Campaign:
        """The nameplate that the takes are judged by, without runs."""
        document = self.document or self.template
        if document is None:
            raise CampaignError(self.file, None, "can't be read yet")
        return replace(campaign_of({**document, "run": []}, self.file), runs=())
