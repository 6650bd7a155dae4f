"""At the bench: looks at each take as its files arrive, and says whether it is good, and what is still missing.

FOLDER is a campaign to which runs are added, or the folder that a recorder writes its files into (CSV, npz, HDF5, MAT,
UFF, TDMS, LVM). What the columns mean is taken from FOLDER/campaign.toml, or from another campaign (--like); files of
several devices are put together to one take.

After each take:
  GOOD     it can be used
  MEND     it can be used once something is put right (a reversed sensor, a wrong unit): the line to paste is shown
  REPEAT   take it again: clipping, a second contact, a decay cut off, too low a level, a response unlike that of the
           hits before it, ...
and then how well K, J_L and c are known, with the number of hits still to come, and for each family of effects what
these takes can't show, or can't tell from its look-alikes, and the recording that would. No effect is claimed here:
that is for `jointscope diagnose`.

Files still being written are left alone until they have not changed for --quiet seconds. Ctrl-C ends it.

examples:
  jointscope watch today --like bench
  jointscope watch bench --within 0.005
  jointscope watch bench --once --json         looks once; exit code 1 where a take must be repeated
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from jointscope.experiments.watch.session import Event, Session


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="where takes arrive")
    parser.add_argument("--like", metavar="CAMPAIGN", type=Path, help="campaign whose runs say what columns mean")
    parser.add_argument("--within", metavar="SHARE", type=_share, default=0.01,
                        help="half width wanted of the 95 %% intervals of K, J_L and c (default 0.01)")  # fmt: skip
    parser.add_argument("--every", metavar="S", type=_seconds, default=1.0, help="seconds between looks")
    parser.add_argument("--quiet", metavar="S", type=_seconds, default=1.5,
                        help="seconds that a file must stay as it is to count as finished")  # fmt: skip
    parser.add_argument("--once", action="store_true", help="look once at what is there, then end")
    parser.add_argument("--json", action="store_true", help="one line of JSON per event")


def run(options: argparse.Namespace) -> int:
    """Look, once or until interrupted."""
    from jointscope.experiments.watch.session import Session

    session = Session(options.folder, options.like, within=options.within)
    if options.once:
        _say(session.look(0.0, 0.0), options.json)
        return _close(session, options.json)
    if not options.json:
        print(f"watching {options.folder}; Ctrl-C ends it", flush=True)
    try:
        _follow(session, options)
    except KeyboardInterrupt:
        _close(session, options.json)
    return 0


def _follow(session: Session, options: argparse.Namespace) -> None:
    import time

    told: list[str] = []
    while True:
        _say(session.look(time.monotonic(), options.quiet), options.json, told)
        time.sleep(options.every)


def _say(events: Iterable[Event], as_json: bool, told: list[str] | None = None) -> None:
    """Print events; ``told`` collects what was said to be missing, so that only news is repeated."""
    from jointscope.experiments.watch import lines
    from jointscope.experiments.watch.session import Standing

    for event in events:
        if as_json:
            print(json.dumps(lines.as_json(event), ensure_ascii=False, allow_nan=False), flush=True)
            continue
        print("\n".join(lines.as_lines(event, told or ())), flush=True)
        if told is not None and isinstance(event, Standing):
            told[:] = lines.missing_lines(event)


def _close(session: Session, as_json: bool) -> int:
    """The last words; 1 where a take must be repeated, or nothing could be judged."""
    _say(session.waiting, as_json)
    verdicts = [take.verdict for take in session.takes.values()]
    if as_json:
        return int("repeat" in verdicts or not verdicts)
    again = [take.run.id for take in session.takes.values() if take.verdict == "repeat"]
    said = f"{len(verdicts)} takes: {verdicts.count('good')} good, {verdicts.count('mend')} to mend, {len(again)} to repeat"
    print(said + (f" ({', '.join(again)})" if again else ""), file=sys.stderr, flush=True)
    return int(bool(again) or not verdicts)


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < 3600.0:
        raise argparse.ArgumentTypeError(f"{text}: give seconds, 0 to 3600")
    return value


def _share(text: str) -> float:
    value = float(text)
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError(f"{text}: give a share between 0 and 1, such as 0.01")
    return value
