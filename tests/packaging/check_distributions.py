"""Build the wheel and the sdist and check that they carry every package and data file; prints what it counted."""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATA = (".xml", ".toml", ".csv", ".json", ".css", ".js")


def main() -> int:
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.splitlines()
    rooms = sorted(path.name for path in (ROOT / "src" / "jointscope").iterdir() if path.is_symlink())
    wanted = [name for name in tracked if name.split("/")[0] in rooms and name.endswith((".py", *DATA))]
    with tempfile.TemporaryDirectory() as scratch:
        subprocess.run(
            [sys.executable, "-m", "build", "--outdir", scratch, str(ROOT)], check=True, capture_output=True
        )
        wheel = next(Path(scratch).glob("*.whl"))
        sdist = next(Path(scratch).glob("*.tar.gz"))
        in_wheel = set(zipfile.ZipFile(wheel).namelist())
        with tarfile.open(sdist) as archive:
            in_sdist = set(archive.getnames())
    top = {name.split("/")[0] for name in in_wheel}
    strangers = {name for name in top if name != "jointscope" and not name.endswith(".dist-info")}
    missing = [name for name in wanted if f"jointscope/{name}" not in in_wheel]
    absent = [name for name in wanted if not any(entry.endswith(f"/{name}") for entry in in_sdist)]
    for label, names in (("wheel", missing), ("sdist", absent)):
        for name in names:
            print(f"{label} lacks {name}", file=sys.stderr)
    for name in strangers:
        print(f"wheel installs a top-level {name}", file=sys.stderr)
    models = [name for name in wanted if name.endswith(".xml")]
    if not models:
        print("no MJCF file is tracked: the check looked at nothing", file=sys.stderr)
    print(f"wheel and sdist hold {len(wanted)} files of {len(rooms)} rooms, {len(models)} of them MJCF")
    return 1 if missing or absent or strangers or not models else 0


if __name__ == "__main__":
    sys.exit(main())
